from __future__ import annotations

import pytest

from ident.experiments.splits import draw_split, last_third, manoeuvre_of


@pytest.mark.parametrize(
    ("name", "manoeuvre"),
    [
        ("manual_c", "manual"),
        ("day_1/slow_circle_02", "slow_circle"),
        ("circle12", "circle"),
        ("lane-change-3", "lane-change"),
        ("planar", "planar"),
        ("a", "a"),
        ("7", "7"),
    ],
)
def test_repeats_of_a_manoeuvre_have_one_name(name: str, manoeuvre: str) -> None:
    assert manoeuvre_of(name) == manoeuvre


def names(**groups: int) -> tuple[list[str], list[str]]:
    made = [(f"{group}_{number}", group) for group, count in groups.items() for number in range(count)]
    return [name for name, _ in made], [group for _, group in made]


@pytest.mark.parametrize("seed", range(20))
def test_holds_out_its_share_of_every_group_and_never_all_of_one(seed: int) -> None:
    runs, groups = names(circle=10, slalom=3, step=2)
    held_out = draw_split(runs, groups, seed, 0.3)
    counts = {
        group: sum(name.startswith(group) for name in held_out) for group in ("circle", "slalom", "step")
    }
    assert counts["circle"] == 3
    assert counts["slalom"] == 1
    assert counts["step"] in (0, 1)
    assert len(held_out) in (4, 5)
    assert held_out == sorted(held_out, key=runs.index)


def test_is_drawn_by_the_seed_alone() -> None:
    runs, groups = names(circle=6, slalom=6)
    drawn = {tuple(draw_split(runs, groups, seed, 0.3)) for seed in range(20)}
    assert len(drawn) > 5
    back = draw_split(runs[::-1], groups[::-1], 4, 0.3)
    assert sorted(back) == sorted(draw_split(runs, groups, 4, 0.3))


def test_a_new_run_elsewhere_changes_nothing() -> None:
    runs, groups = names(circle=10, slalom=10)
    more, more_groups = names(circle=10, slalom=10, step=10)
    held_out = draw_split(more, more_groups, 1, 0.3)
    assert [name for name in held_out if not name.startswith("step")] == draw_split(runs, groups, 1, 0.3)


def test_manoeuvres_that_were_driven_once_are_one_group() -> None:
    runs = ["circle", "slalom", "step", "ramp"]
    assert len(draw_split(runs, runs, 1, 0.3)) == 1
    assert len(draw_split(runs, runs, 1, 0.99)) == 3


def test_at_least_one_is_held_out_however_small_the_share() -> None:
    runs, groups = names(circle=3)
    assert len(draw_split(runs, groups, 1, 0.01)) == 1


def test_one_run_is_never_held_out_whole() -> None:
    assert draw_split(["a"], ["a"], 1, 0.5) == []


def test_the_last_third_is_held_out_of_a_run() -> None:
    assert last_third(10.0, 40.0) == pytest.approx((30.0, 40.0))
