"""Figures of transient driving against the transfer function of the linear bicycle, computed here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_truck import BODY, INERTIA, NOISE, STEP, PlaneTruck, linear
from scipy.signal import StateSpace, lsim

from ident.estimation.handling import drives, std_of_difference
from ident.estimation.handling_transient import (
    equivalent_delay,
    find_steps,
    response,
    response_time,
    stretches,
)
from ident.estimation.vehicle_records import MotionRecord, Samples

FRONT, REAR, SPEED = 330e3, 417e3, 12.0
TRUCK = PlaneTruck(linear(FRONT), linear(REAR))


def linear_bicycle() -> StateSpace:
    """Lateral velocity and yaw rate from the road-wheel angle; out come yaw rate and lateral acceleration."""
    a, b, m = BODY.cg_to_front_axle, BODY.cg_to_rear_axle, BODY.mass
    across = np.array([-(FRONT + REAR) / (m * SPEED), -(a * FRONT - b * REAR) / (m * SPEED)])
    turning = np.array(
        [-(a * FRONT - b * REAR) / (INERTIA * SPEED), -(a**2 * FRONT + b**2 * REAR) / (INERTIA * SPEED)]
    )
    system = np.array([across - [0, SPEED], turning])
    steered = np.array([[FRONT / m], [a * FRONT / INERTIA]])
    return StateSpace(system, steered, np.array([[0, 1], across]), np.array([[0], [FRONT / m]]))


def answer(frequency: float) -> np.ndarray:
    """Response (yaw rate, lateral acceleration) at a frequency [Hz]."""
    model = linear_bicycle()
    inverse = np.linalg.inv(2j * np.pi * frequency * np.eye(2) - model.A)
    return (model.C @ inverse @ model.B + model.D)[:, 0]


def broad(seconds: float, highest: float = 1.4, most: float = 0.004) -> np.ndarray:
    random = np.random.default_rng(5)
    times = STEP * np.arange(round(seconds / STEP) + 1)
    lines = np.arange(0.04, highest, 0.037)
    waves = np.sin(2 * np.pi * lines * times[:, None] + random.uniform(0, 2 * np.pi, lines.size))
    return most * waves.sum(axis=1)


def with_noise(record: MotionRecord, seed: int) -> MotionRecord:
    random = np.random.default_rng(seed)
    measured = {
        name: Samples(one.times, one.values + NOISE[name] * random.standard_normal(one.times.size))
        for name, one in record.measured.items()
    }
    return replace(record, measured=measured)


@pytest.fixture(scope="module")
def lively() -> MotionRecord:
    angle = broad(90.0)
    return TRUCK.drive(angle, np.full(angle.size, SPEED))


@pytest.mark.parametrize("frequency", [0.2, 0.5, 1.0])
@pytest.mark.parametrize(("place", "signal"), [(0, "yaw_rate"), (1, "lateral_acceleration")])
def test_gain_and_phase_are_those_of_the_transfer_function(
    lively: MotionRecord, frequency: float, place: int, signal: str
) -> None:
    parts = stretches(drives([with_noise(lively, 1)], BODY))
    assert list(parts) == [10.0]
    assert len(parts[10.0]) == 4
    found = response(parts[10.0], signal, frequency)
    expected = answer(frequency)[place]
    assert found.reason is None
    assert found.gain == pytest.approx(abs(expected), rel=0.03)
    assert found.phase == pytest.approx(np.angle(expected), abs=0.03)
    gain, phase = found.estimates("1/s")
    assert gain.status == phase.status == "identified"
    assert gain.low < abs(expected) < gain.high or gain.value == pytest.approx(abs(expected), rel=0.015)


def test_the_standard_errors_are_the_spread(lively: MotionRecord) -> None:
    exact = response(stretches(drives([lively], BODY))[10.0], "lateral_acceleration", 1.0)
    found = [
        response(stretches(drives([with_noise(lively, s)], BODY))[10.0], "lateral_acceleration", 1.0)
        for s in range(24)
    ]
    for score in (
        [(one.gain - exact.gain) / one.gain_std for one in found],
        [(one.phase - exact.phase) / one.phase_std for one in found],
    ):
        assert 0.6 < np.sqrt(np.mean(np.square(score))) < 1.5


def test_the_error_of_a_difference_on_the_same_driving_is_its_spread(lively: MotionRecord) -> None:
    exact = response(stretches(drives([lively], BODY))[10.0], "yaw_rate", 1.0).estimates("1/s")
    scores = []
    for seed in range(24):
        parts = stretches(drives([with_noise(lively, seed)], BODY))[10.0]
        for one, true in zip(response(parts, "yaw_rate", 1.0).estimates("1/s"), exact, strict=True):
            scores.append((one.value - true.value) / std_of_difference(one, true))
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_the_equivalent_delay_is_phase_over_frequency(lively: MotionRecord) -> None:
    found = equivalent_delay(response(stretches(drives([lively], BODY))[10.0], "yaw_rate", 0.5))
    assert found.value == pytest.approx(-np.angle(answer(0.5)[0]) / np.pi, abs=0.005)


def test_refuses_a_frequency_that_was_not_driven() -> None:
    angle = broad(60.0, highest=0.3)
    record = TRUCK.drive(angle, np.full(angle.size, SPEED), seed=3)
    found = response(stretches(drives([record], BODY))[10.0], "yaw_rate", 1.0)
    assert found.reason is not None
    gain, phase = found.estimates("1/s")
    assert gain.value is None
    assert phase.value is None
    assert gain.status == "not_identifiable"
    assert "1 Hz" in gain.reason
    assert equivalent_delay(found).value is None


def test_a_short_run_has_no_spectrum() -> None:
    angle = broad(15.0)
    assert stretches(drives([TRUCK.drive(angle, np.full(angle.size, SPEED))], BODY)) == {}


def stepped(size: float, seconds: float = 40.0, every: float = 8.0) -> np.ndarray:
    """Up and down every few seconds, each ramp takes 0.2 s."""
    times = STEP * np.arange(round(seconds / STEP) + 1)
    corners, values = [0.0], [0.0]
    for number in range(1, int(seconds / every)):
        corners += [every * number, every * number + 0.2]
        values += [values[-1], size if number % 2 else 0.0]
    return np.interp(times, corners, values)


def test_the_response_time_is_that_of_the_linear_bicycle() -> None:
    angle = stepped(0.02)
    record = TRUCK.drive(angle, np.full(angle.size, SPEED), seed=4)
    found = drives([record], BODY)
    steps = [find_steps(one) for one in found]
    assert np.array(steps[0]) * STEP == pytest.approx([8.1, 16.1, 24.1, 32.1], abs=0.2)

    times = STEP * np.arange(800)
    one_step = np.interp(times, [2.0, 2.2], [0.0, 1.0])
    _, motion, _ = lsim(linear_bicycle(), one_step, times)
    risen = motion[:, 0] / motion[-1, 0]
    expected = times[np.argmax(risen >= 0.9)] - 2.1
    time = response_time(found, steps)
    assert time.value == pytest.approx(expected, abs=0.02)
    assert time.std < 0.02


def test_driving_without_steps_has_none(lively: MotionRecord) -> None:
    (found,) = drives([lively], BODY)
    assert find_steps(found) == []


def test_a_yaw_rate_that_does_not_answer_has_no_response_time() -> None:
    angle = stepped(0.02)
    record = TRUCK.drive(angle, np.full(angle.size, SPEED), seed=4)
    random = np.random.default_rng(1)
    dead = Samples(record.times, 0.0015 * random.standard_normal(record.times.size))
    found = drives([replace(record, measured={"yaw_rate": dead})], BODY)
    time = response_time(found, [find_steps(one) for one in found])
    assert time.value is None
    assert "does not settle" in time.reason
