"""Repeated runs are found, whenever and wherever they were driven, and nothing else is taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_truck import NOISE, STEP, PlaneTruck, inputs, linear

from ident.estimation.repeats import find_repeats, repeat_noise
from ident.estimation.vehicle_records import MotionRecord, Samples, part_of

TRUCK = PlaneTruck(linear(330e3), linear(417e3))
NAMES = ["first", "second", "third"]


def driven(run: int, seed: int, begin: float = 0.0, pose=(0.3, 40.0, -25.0), **how) -> MotionRecord:
    """One drive of 40 s, of which the first ``begin`` seconds were not recorded; its clock starts there."""
    record = TRUCK.drive(*inputs(40.0, **how), run=run, seed=seed, pose=pose)
    first = round(begin / STEP)
    part = part_of(record, first, record.times.size - 1)
    measured = {name: Samples(one.times - begin, one.values) for name, one in part.measured.items()}
    return replace(part, times=part.times - begin, measured=measured)


def test_the_noise_of_a_repeated_run_is_recovered() -> None:
    records = [driven(0, 1), driven(1, 2, begin=6.4, pose=(2.1, -300.0, 80.0))]
    (found,) = find_repeats(records, NAMES)
    assert found.lag == pytest.approx(-6.4, abs=0.003)
    assert found.end - found.begin == pytest.approx(33.6, abs=0.05)
    noise = repeat_noise(records, NAMES)
    assert set(noise) == set(NOISE)
    for name in ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading"):
        assert 0.88 * NOISE[name] < noise[name] < 1.08 * NOISE[name]
    # the start of the second heading is known to 0.001 / sqrt(50), which turns a path of 400 m
    assert noise["position_x"] < 0.08
    assert noise["position_y"] < 0.08


def test_three_repeats_are_three_pairs() -> None:
    records = [driven(run, run) for run in range(3)]
    assert len(find_repeats(records, NAMES)) == 3


@pytest.mark.parametrize(
    "other",
    [{"seed_of_drive": 9}, {"most": 0.1}, {"speed": 12.8}],
    ids=["other steering", "larger", "faster"],
)
def test_another_drive_is_no_repeat(other: dict) -> None:
    how = {("seed" if key == "seed_of_drive" else key): value for key, value in other.items()}
    record = TRUCK.drive(*inputs(40.0, **how), run=1, seed=2)
    assert repeat_noise([driven(0, 1), record], NAMES) == {}


def test_straight_driving_is_no_repeat() -> None:
    straight = [driven(run, run, most=0.003) for run in range(2)]
    assert repeat_noise(straight, NAMES) == {}


def test_a_short_overlap_is_no_repeat() -> None:
    whole = driven(0, 1)
    late = driven(1, 2, begin=32.0)
    assert repeat_noise([whole, late], NAMES) == {}


def test_parts_of_one_run_are_not_compared() -> None:
    records = [driven(0, 1), driven(1, 2)]
    assert repeat_noise(records, ["same", "same"]) == {}


def test_a_signal_that_one_run_lacks_is_left_out() -> None:
    one, other = driven(0, 1), driven(1, 2)
    kept = {name: each for name, each in other.measured.items() if name not in ("heading", "yaw_rate")}
    noise = repeat_noise([one, replace(other, measured=kept)], NAMES)
    assert set(noise) == {"lateral_acceleration", "lateral_velocity"}
    assert np.isfinite(list(noise.values())).all()
