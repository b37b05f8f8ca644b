"""Figures of steady cornering against closed forms, on a truck that shares nothing with the models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_truck import BODY, NOISE, STEP, PlaneTruck, linear

from ident.estimation.handling import (
    SteadyStates,
    drives,
    end_of_linear_range,
    speed_classes,
    std_of_difference,
    steady,
    steady_states,
    understeer_gradient,
    yaw_rate_gain,
)
from ident.estimation.vehicle_records import MotionRecord, Samples

FRONT, REAR = 330e3, 417e3
SHARES = {  # of the mass over the wheelbase that each axle carries
    "front": BODY.mass * BODY.cg_to_rear_axle / BODY.wheelbase,
    "rear": BODY.mass * BODY.cg_to_front_axle / BODY.wheelbase,
}
GRADIENT = SHARES["front"] / FRONT - SHARES["rear"] / REAR
TRUCK = PlaneTruck(linear(FRONT), linear(REAR), offset=0.002)


def slow_drive(seconds=90.0, most=0.03, speed=11.0, faster=1.5):
    times = STEP * np.arange(round(seconds / STEP) + 1)
    angle = most * np.sin(2 * np.pi * 0.05 * times)
    return angle, speed + faster * np.sin(2 * np.pi * 0.013 * times)


def with_noise(record: MotionRecord, seed: int) -> MotionRecord:
    random = np.random.default_rng(seed)
    measured = {
        name: Samples(one.times, one.values + NOISE[name] * random.standard_normal(one.times.size))
        for name, one in record.measured.items()
    }
    return replace(record, measured=measured)


@pytest.fixture(scope="module")
def slow() -> MotionRecord:
    return TRUCK.drive(*slow_drive())


def states_of(record: MotionRecord) -> SteadyStates:
    found = drives([record], BODY)
    return steady_states(found, [steady(one, BODY.wheelbase) for one in found])


def test_a_record_stays_one_stretch_with_the_motion_of_the_centre_of_gravity(slow: MotionRecord) -> None:
    (found,) = drives([slow], BODY)
    assert found.speed.size == slow.times.size
    assert found.is_felt
    inner = found.valid
    assert inner.mean() > 0.95
    steady_part = found.speed * found.yaw_rate
    assert found.lateral_acceleration[inner] == pytest.approx(steady_part[inner], abs=0.05)


def test_stretches_of_different_runs_stay_apart(slow: MotionRecord) -> None:
    found = drives([slow, replace(slow, run=1)], BODY)
    assert [one.run for one in found] == [0, 1]


def test_the_understeer_gradient_is_that_of_linear_tyres(slow: MotionRecord) -> None:
    found = understeer_gradient(states_of(with_noise(slow, 1)), BODY.wheelbase)
    assert found.status == "identified"
    assert found.unit == "rad s^2/m"
    assert found.value == pytest.approx(GRADIENT, rel=0.03)


def test_the_standard_error_of_the_gradient_is_its_spread(slow: MotionRecord) -> None:
    found = [understeer_gradient(states_of(with_noise(slow, seed)), BODY.wheelbase) for seed in range(24)]
    exact = understeer_gradient(states_of(slow), BODY.wheelbase).value
    scores = np.array([(one.value - exact) / one.std for one in found])
    assert 0.6 < np.sqrt(np.mean(scores**2)) < 1.5


def test_figures_of_the_same_driving_have_their_errors_in_common(slow: MotionRecord) -> None:
    noisy = understeer_gradient(states_of(with_noise(slow, 1)), BODY.wheelbase)
    again = understeer_gradient(states_of(with_noise(slow, 1)), BODY.wheelbase)
    other = understeer_gradient(states_of(with_noise(slow, 2)), BODY.wheelbase)
    assert std_of_difference(noisy, again) == 0.0
    assert std_of_difference(noisy, other) == pytest.approx(np.hypot(noisy.std, other.std), rel=0.3)


def test_the_heading_alone_tells_the_gradient(slow: MotionRecord) -> None:
    heading = replace(with_noise(slow, 2), measured={"heading": slow.measured["heading"]})
    (found,) = drives([heading], BODY)
    assert not found.is_felt
    assert understeer_gradient(states_of(heading), BODY.wheelbase).value == pytest.approx(GRADIENT, rel=0.03)


def test_a_truck_that_does_not_slip_has_no_gradient() -> None:
    angle, speed = slow_drive()
    times = STEP * np.arange(angle.size)
    rolling = Samples(times, speed * np.tan(angle) / BODY.wheelbase)
    record = MotionRecord(0, times, angle, speed, {"yaw_rate": rolling})
    found = understeer_gradient(states_of(record), BODY.wheelbase)
    assert abs(found.value) < 0.002 * GRADIENT


@pytest.mark.parametrize("speed", [10.0])
def test_the_steady_gain_is_that_of_the_closed_form(slow: MotionRecord, speed: float) -> None:
    states = states_of(with_noise(slow, 3))
    assert speed in speed_classes(states)
    found = yaw_rate_gain(states, BODY.wheelbase, speed)
    assert found.status == "identified"
    assert found.value == pytest.approx(speed / (BODY.wheelbase + GRADIENT * speed**2), rel=0.01)


def test_the_linear_range_ends_where_the_tyres_do_not_stay_linear() -> None:
    growth = 0.04  # of the slip of the front axle: slip = k a (1 + growth a²)
    per_force = 1 / FRONT

    def front(slip: float) -> float:
        linear_acceleration = slip / (SHARES["front"] * per_force)
        root = np.sqrt(3 * growth)
        acceleration = 2 / root * np.sinh(np.arcsinh(1.5 * root * linear_acceleration) / 3)
        return float(SHARES["front"] * acceleration)

    times = STEP * np.arange(12001)
    angle = 0.13 * np.sin(2 * np.pi * 0.02 * times)
    record = with_noise(PlaneTruck(front, linear(REAR)).drive(angle, np.full(times.size, 12.0)), 4)
    found = end_of_linear_range(states_of(record), BODY.wheelbase)
    cubic = SHARES["front"] * per_force * growth
    expected = np.sqrt(0.1 * (BODY.wheelbase / 144 + GRADIENT) / cubic)
    assert found.value == pytest.approx(expected, rel=0.1)
    assert found.low < expected < found.high or found.value == pytest.approx(expected, rel=0.05)


def test_linear_tyres_have_no_end_of_the_linear_range(slow: MotionRecord) -> None:
    found = end_of_linear_range(states_of(with_noise(slow, 5)), BODY.wheelbase)
    assert found.status == "not_identifiable"
    assert found.value is None
    assert "the hardest driven" in found.reason


def test_refuses_straight_driving() -> None:
    angle, speed = slow_drive(60.0, most=0.002)
    found = understeer_gradient(states_of(TRUCK.drive(angle, speed, seed=1)), BODY.wheelbase)
    assert found.status == "not_identifiable"
    assert "spans" in found.reason


def test_refuses_driving_that_is_never_steady() -> None:
    times = STEP * np.arange(3001)
    angle = 0.05 * np.sin(2 * np.pi * 0.5 * times)
    states = states_of(TRUCK.drive(angle, np.full(times.size, 12.0), seed=1))
    found = understeer_gradient(states, BODY.wheelbase)
    assert found.status == "not_identifiable"
    assert "nearly steady" in found.reason
    assert not speed_classes(states)


def test_refuses_a_yaw_rate_that_does_not_follow_the_steering(slow: MotionRecord) -> None:
    own = slow.measured["yaw_rate"]
    slower = Samples(own.times, 0.08 * np.sin(2 * np.pi * 0.021 * own.times))
    strange = replace(slow, measured={"yaw_rate": slower})
    found = understeer_gradient(states_of(strange), BODY.wheelbase)
    assert found.status == "not_identifiable"
    assert "correlation" in found.reason
