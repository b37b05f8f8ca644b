"""Refusals are told once a reason."""

from __future__ import annotations

from ident.report.refusals import by_reason
from ident.results import Refusal


def test_one_refusal_is_told_as_it_is() -> None:
    assert by_reason([Refusal("bandwidth", "no chirp")]) == [("bandwidth", "no chirp")]
    assert by_reason([]) == []


def test_what_is_refused_for_the_same_reason_is_told_together_in_the_order_of_the_reasons() -> None:
    found = [Refusal("b", "no request"), Refusal("gain", "no step"), Refusal("a", "no request")]
    assert by_reason(found) == [("b, a", "no request"), ("gain", "no step")]


def test_many_runs_of_a_folder_are_counted_and_few_are_named() -> None:
    many = [Refusal(f"other/day_{day}/run_{number}", "another truck") for day in (1, 2) for number in (1, 2)]
    few = [Refusal(f"more/run_{number}", "another truck") for number in (1, 2, 3)]
    ((what, _),) = by_reason([*many, *few])
    assert what == "other/… (4 runs), more/run_1, more/run_2, more/run_3"


def test_of_very_many_names_the_rest_is_counted() -> None:
    ((what, _),) = by_reason([Refusal(f"run_{number:02d}", "late") for number in range(20)])
    assert what.startswith("run_00, run_01, ")
    assert what.endswith("run_07 and 12 more")


def test_a_topic_is_no_folder_of_runs() -> None:
    topics = [Refusal(f"/imu/{number}", "lost") for number in range(5)]
    assert by_reason(topics) == [("/imu/0, /imu/1, /imu/2, /imu/3, /imu/4", "lost")]
