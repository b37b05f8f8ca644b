"""What is held out: runs that the others come near, blocks where runs are few, nothing that nobody covers."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from motion_case import layer_of
from numpy.typing import NDArray

from ident.estimation.layer import HeldOut, Likelihood
from ident.estimation.vehicle_records import MotionRecord, Samples
from ident.stages.improve_folds import BLOCK, GUARD, blocks, dealt, reach

Array = NDArray[np.float64]
RUNS = ["calm_a", "calm_b", "hard_a", "hard_b", "calm_c"]
SIZES = np.array([1.0, 1.2, 3.9, 4.0, 0.8])


def driven(seconds: float, run: int = 0, period: float = 0.02) -> MotionRecord:
    times = np.arange(0.0, seconds, period)
    swing = 0.02 * np.sin(times)
    return MotionRecord(run, times, swing, np.full(times.size, 10.0), {"yaw_rate": Samples(times, swing)})


def test_a_run_that_goes_twice_as_far_as_all_others_is_in_every_fit() -> None:
    groups, left_in = dealt(["calm", "ramp", "step"], {"lateral_acceleration": np.array([1.0, 10.5, 3.7])}, 4)
    assert sorted(name for group in groups for name in group) == ["calm", "step"]
    assert list(left_in) == ["ramp"]
    assert "lateral acceleration reaches 10.5, that of the other runs 3.7" in left_in["ramp"]


def test_a_run_goes_too_far_in_one_signal_alone() -> None:
    reached = {"yaw_rate": np.array([0.3, 0.3, 0.3]), "lateral_velocity": np.array([0.1, 0.1, 0.3])}
    assert list(dealt(["a", "b", "c"], reached, 3)[1]) == ["c"]


def test_runs_that_go_alike_are_all_held_out_once() -> None:
    groups, left_in = dealt(RUNS, {"lateral_acceleration": SIZES}, 4)
    assert left_in == {}
    assert sorted(name for group in groups for name in group) == sorted(RUNS)
    assert len(groups) == 4


def test_the_two_that_go_furthest_are_never_held_out_together() -> None:
    for count in (2, 3, 4):
        groups, _ = dealt(RUNS, {"lateral_acceleration": SIZES}, count)
        assert not any({"hard_a", "hard_b"} <= set(group) for group in groups)


def test_the_order_of_the_runs_changes_no_group() -> None:
    order = [3, 0, 4, 2, 1]
    one, _ = dealt(RUNS, {"lateral_acceleration": SIZES}, 2)
    other, _ = dealt([RUNS[k] for k in order], {"lateral_acceleration": SIZES[order]}, 2)
    assert sorted(one) == sorted(other)


def test_reach_is_that_of_the_measured_signal_without_where_the_run_is() -> None:
    run = np.repeat([0, 1], 200)
    measured = np.where(run == 0, 1.0, -3.0)
    likelihood = Likelihood(run, np.zeros(400), np.zeros(400))
    held = HeldOut(
        errors={"yaw_rate": measured - 0.5, "heading": measured},
        modelled={"yaw_rate": np.full(400, 0.5), "heading": np.zeros(400)},
        run={"yaw_rate": run, "heading": run},
        time={"yaw_rate": np.zeros(400), "heading": np.zeros(400)},
        likelihood=likelihood,
    )
    found = reach(held, 3)
    assert list(found) == ["yaw_rate"]
    np.testing.assert_allclose(found["yaw_rate"], [1.0, 3.0, 0.0])


def test_a_long_run_is_cut_into_blocks_that_lie_apart() -> None:
    made = blocks(layer_of([driven(100.0)]))
    assert made is not None
    layer, of = made
    assert len(layer.runs) == round(100.0 / BLOCK) == len(of)
    assert set(of.values()) == {"run_0"}
    assert [record.run for record in layer.records] == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    for before, after in pairwise(layer.records):
        gap = after.measured["yaw_rate"].times[0] - before.measured["yaw_rate"].times[-1]
        assert gap == pytest.approx(0.02 if before.run == after.run else GUARD + 0.02, abs=0.021)


def test_windows_of_blocks_are_those_of_the_run_but_for_the_guards() -> None:
    layer = layer_of([driven(60.0), driven(47.0, run=1)])
    made = blocks(layer)
    assert made is not None
    whole, apart = layer.windows.records, made[0].windows.records
    assert len(whole) == len(apart) == len(made[0].records)
    for one, other in zip(whole, apart, strict=True):
        size = other.times.size
        np.testing.assert_array_equal(other.times, one.times[:size])
        assert size in {one.times.size, one.times.size - round(GUARD / 0.02)}
        samples = other.measured["yaw_rate"]
        np.testing.assert_array_equal(samples.times, one.measured["yaw_rate"].times[: samples.times.size])
        assert samples.times[-1] <= other.times[-1]


def test_generic_terms_go_with_their_windows() -> None:
    layer = layer_of([driven(100.0)])
    values = (tuple(window.times.copy() for window in layer.windows.records),)
    made = blocks(replace(layer, terms={"yaw_moment: t": {"yaw_moment": values}}))
    assert made is not None
    parts = made[0].terms["yaw_moment: t"]["yaw_moment"]
    for record, (part,) in zip(made[0].records, parts, strict=True):
        np.testing.assert_array_equal(part, record.times)


def test_a_short_run_has_no_blocks() -> None:
    assert blocks(layer_of([driven(40.0)])) is None
