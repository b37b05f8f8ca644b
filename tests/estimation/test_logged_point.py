"""The point that a lateral velocity or a position belongs to is found from the motion alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_truck import BODY, REFERENCE_X, STEP, PlaneTruck, linear

from ident.estimation.logged_point import point_of_lateral_velocity, point_of_position
from ident.estimation.vehicle_records import MotionRecord, Samples

TRUCK = PlaneTruck(linear(330e3), linear(417e3))


def drive(seconds: float = 90.0, slowest: float = 5.0, fastest: float = 13.0, seed: int = 1) -> MotionRecord:
    times = STEP * np.arange(round(seconds / STEP) + 1)
    middle, half = (fastest + slowest) / 2, (fastest - slowest) / 2
    speed = middle - half * np.cos(2 * np.pi * 0.03 * times)
    waves = [np.sin(2 * np.pi * f * times + phase) for f, phase in ((0.07, 0.3), (0.19, 1.1), (0.4, 2.0))]
    return TRUCK.drive(0.35 * sum(waves) / speed, speed, seed=seed)


@pytest.fixture(scope="module")
def record() -> MotionRecord:
    return drive()


def moved(record: MotionRecord, forward: float) -> MotionRecord:
    """The record with velocity and position of a point farther ahead."""
    measured = dict(record.measured)
    rate, heading = measured["yaw_rate"].values, measured["heading"].values
    x, y, across = (measured[name] for name in ("position_x", "position_y", "lateral_velocity"))
    measured["lateral_velocity"] = Samples(across.times, across.values + forward * rate)
    measured["position_x"] = Samples(x.times, x.values + forward * np.cos(heading))
    measured["position_y"] = Samples(y.times, y.values + forward * np.sin(heading))
    return replace(record, measured=measured)


@pytest.mark.parametrize("forward", [0.0, 2.12, -1.5])
def test_the_point_of_the_lateral_velocity_is_found(record: MotionRecord, forward: float) -> None:
    found = point_of_lateral_velocity([moved(record, forward)], BODY)
    ahead = REFERENCE_X + BODY.cg_to_rear_axle + forward
    assert found.value == pytest.approx(ahead, abs=0.1)
    assert found.std < 0.1


@pytest.mark.parametrize("forward", [0.0, 2.12])
def test_the_point_of_the_position_is_found(record: MotionRecord, forward: float) -> None:
    found = point_of_position([moved(record, forward)], BODY)
    ahead = REFERENCE_X + BODY.cg_to_rear_axle + forward
    assert found.value == pytest.approx(ahead, abs=max(0.15, 3 * found.std))
    assert found.std < 0.4


def test_a_late_position_is_not_taken_for_another_point(record: MotionRecord) -> None:
    measured = dict(record.measured)
    for name in ("position_x", "position_y"):
        own = measured[name]
        measured[name] = Samples(own.times[:-8], np.interp(own.times[:-8] - 0.08, own.times, own.values))
    found = point_of_position([replace(record, measured=measured)], BODY)
    assert found.value == pytest.approx(0.0, abs=max(0.15, 3 * found.std))


def test_a_turned_sensor_is_not_taken_for_another_point(record: MotionRecord) -> None:
    own = record.measured["lateral_velocity"]
    turned = Samples(own.times, own.values + 0.02 * record.speed + 0.05)
    found = point_of_lateral_velocity(
        [replace(record, measured={**record.measured, "lateral_velocity": turned})], BODY
    )
    assert found.value == pytest.approx(0.0, abs=0.1)


def test_one_speed_tells_less_than_two(record: MotionRecord) -> None:
    steady = drive(slowest=9.0, fastest=9.01)
    one, two = (point_of_lateral_velocity([each], BODY) for each in (steady, record))
    assert one.std > 3 * two.std


def test_refuses_straight_driving() -> None:
    times = STEP * np.arange(4001)
    found = point_of_lateral_velocity(
        [TRUCK.drive(np.zeros(times.size), np.full(times.size, 9.0), seed=1)], BODY
    )
    assert found.value is None
    assert "yaw rate varies" in found.reason


def test_refuses_a_few_seconds(record: MotionRecord) -> None:
    found = point_of_lateral_velocity([drive(seconds=8.0)], BODY)
    assert found.value is None
    assert "instants" in found.reason
