"""The actuator that may fall short, held against closed forms: exact without faults, and each fault alone."""

import dataclasses

import numpy as np
import pytest
from generator.actuator import WheelState, held_response
from generator.driving import Speed
from generator.injected import Injected
from generator.injected_actuator import ARREST, play, wheel_angle
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import PchipInterpolator

GRID = np.arange(0.0, 20.0, 5e-4)
SENT_TIME = np.arange(-1.0, 20.0, 0.01) + 0.0003


def steady(speed: float) -> Speed:
    return Speed(PchipInterpolator([-100.0, 0.0, 100.0], [speed, speed, speed]))


@pytest.fixture
def actuator(truth):
    return truth.steering.actuator


def answer(actuator, sent, *injected, speed=10.0, grid=GRID):
    random = np.random.default_rng(1)
    return wheel_angle(actuator, injected, SENT_TIME, sent, grid, steady(speed), random)


def step(size: float, at: float = 1.0) -> np.ndarray:
    return np.where(at <= SENT_TIME, size, 0.0)


def test_without_faults_it_is_the_exact_response_of_two_lags(actuator):
    sent = np.where(SENT_TIME > 0.5, 2.0 * np.sin(3.0 * SENT_TIME) + step(1.0, 7.0), 0.0)
    exact, _ = held_response(actuator, SENT_TIME, sent, GRID, WheelState(-1.0, 0.0, 0.0, 0.0))
    assert_allclose(answer(actuator, sent), exact, rtol=0, atol=1e-11)


def test_two_equal_lags_are_no_special_case(actuator):
    equal = dataclasses.replace(actuator, time_constant_1=0.2, time_constant_2=0.2)
    near = dataclasses.replace(actuator, time_constant_1=0.2001, time_constant_2=0.1999)
    assert_allclose(answer(equal, step(1.0)), answer(near, step(1.0)), rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    "nothing",
    [
        Injected("steering_column_play", {"width": 0.0}),
        Injected("steering_dead_zone", {"width": 0.0}),
        Injected("steering_rate_limit", {"rate": np.inf}),
        Injected("steering_friction", {"band": 0.0}),
        Injected("command_quantisation", {"step": 0.0}),
        Injected("command_hold", {"probability": 0.0}),
        Injected("steering_asymmetry", {"gain_difference": 0.0}),
        Injected("speed_dependent_steering", {"lag_slope": 0.0}),
    ],
    ids=lambda one: one.name,
)
def test_a_fault_of_no_size_is_none(actuator, nothing):
    sent = 1.5 * np.sin(2.0 * SENT_TIME)
    assert_array_equal(answer(actuator, sent, nothing), answer(actuator, sent))


def test_a_limited_rate_makes_straight_lines_of_that_slope(actuator):
    limit = 1.7
    angle = answer(actuator, step(4.0), Injected("steering_rate_limit", {"rate": limit}))
    slope = np.diff(angle) / np.diff(GRID)
    assert np.max(slope) == pytest.approx(limit, rel=1e-9)
    straight = np.isclose(slope, limit, rtol=1e-9)
    assert np.sum(straight) * 5e-4 > 0.7 * 4.0 * actuator.gain / limit
    assert angle[-1] == pytest.approx(4.0 * actuator.gain, rel=1e-9)


def test_a_small_step_does_not_feel_the_limit(actuator):
    limited = answer(actuator, step(0.2), Injected("steering_rate_limit", {"rate": 1.7}))
    assert_allclose(limited, answer(actuator, step(0.2)), rtol=0, atol=1e-15)


def test_the_play_is_what_the_two_branches_of_a_slow_sine_are_apart(actuator):
    width, sent = 0.13, np.sin(0.8 * SENT_TIME)
    driving = answer(actuator, sent)
    driven = answer(actuator, sent, Injected("steering_column_play", {"width": width}))
    assert np.max(driving - driven) == pytest.approx(width / 2.0, rel=1e-9)
    assert np.max(driven - driving) == pytest.approx(width / 2.0, rel=1e-9)
    late = GRID > 5.0
    resting = np.diff(driven[late]) == 0.0
    turn = np.argmax(driving[late])
    first_moving = turn + np.argmin(resting[turn:])
    assert driving[late][turn] - driving[late][first_moving] == pytest.approx(
        width, abs=5e-4
    )  # half a millisecond of the sine


def test_less_than_the_play_moves_nothing():
    assert_array_equal(play(0.04 * np.sin(np.linspace(0.0, 30.0, 1000)), 0.1), np.zeros(1000))


def test_a_request_inside_the_dead_zone_is_not_answered(actuator):
    zone = Injected("steering_dead_zone", {"width": 0.06})
    assert_array_equal(answer(actuator, step(-0.06), zone), np.zeros(len(GRID)))
    assert answer(actuator, step(-0.1), zone)[-1] == pytest.approx(-0.04 * actuator.gain, rel=1e-9)


def test_friction_holds_the_wheel_until_its_band_and_then_lets_it_jump(actuator):
    band = 0.1
    sent = 0.02 * np.maximum(SENT_TIME, 0.0)  # a slow ramp
    smooth = answer(actuator, sent)
    angle = answer(actuator, sent, Injected("steering_friction", {"band": band}))
    moves = np.flatnonzero(np.diff(angle) != 0.0)
    assert smooth[moves[0]] == pytest.approx(band, abs=3e-3)
    rests = np.flatnonzero(np.diff(angle[moves[0] + 1 :]) == 0.0) + moves[0] + 1
    assert smooth[rests[0]] - angle[rests[0]] == pytest.approx(ARREST * band, abs=2.5e-3)
    assert angle[rests[0]] == pytest.approx((1.0 - ARREST) * band, rel=0.1)
    assert len(rests) > 0.8 * (len(angle) - moves[0])


def test_a_resonance_overshoots_as_its_damping_says(actuator):
    quick = dataclasses.replace(actuator, time_constant_1=1e-4)
    damping, frequency = 0.35, 12.0
    mode = Injected("steering_resonance", {"frequency": frequency, "damping": damping})
    angle = answer(quick, step(1.0), mode) / actuator.gain
    expected = np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2))
    assert np.max(angle) - 1.0 == pytest.approx(expected, rel=1e-3)
    peak = GRID[np.argmax(angle)] - 1.0 - actuator.dead_time
    assert peak == pytest.approx(np.pi / (frequency * np.sqrt(1.0 - damping**2)), abs=0.012)


def test_gains_differ_by_the_asymmetry(actuator):
    sides = Injected("steering_asymmetry", {"gain_difference": 0.06})
    left, right = answer(actuator, step(1.0), sides)[-1], answer(actuator, step(-1.0), sides)[-1]
    assert left + right == pytest.approx(0.06 * actuator.gain, rel=1e-9)


def test_the_lag_grows_towards_standstill(actuator):
    slower = Injected("speed_dependent_steering", {"lag_slope": 0.8})
    standing = dataclasses.replace(actuator, time_constant_1=1.8 * actuator.time_constant_1)
    assert_allclose(
        answer(actuator, step(1.0), slower, speed=0.0), answer(standing, step(1.0)), rtol=0, atol=1e-12
    )
    assert_array_equal(answer(actuator, step(1.0), slower, speed=13.0), answer(actuator, step(1.0)))


def test_commands_are_rounded_held_and_saturated_as_said(actuator):
    coarse = answer(actuator, step(0.131), Injected("command_quantisation", {"step": 0.05}))
    assert coarse[-1] == pytest.approx(0.15 * actuator.gain, rel=1e-9)
    bounded = answer(actuator, step(3.0), Injected("request_saturation", {"level": 2.0}))
    assert bounded[-1] == pytest.approx(2.0 * np.tanh(1.5) * actuator.gain, rel=1e-9)
    sent = np.sin(2.0 * SENT_TIME)
    deaf = answer(actuator, sent, Injected("command_hold", {"probability": 0.5}))
    assert 1e-3 < np.max(np.abs(deaf - answer(actuator, sent))) < 0.1


def test_an_effect_that_nobody_knows_is_refused():
    with pytest.raises(ValueError, match="no effect wobble"):
        Injected("wobble")
    with pytest.raises(ValueError, match="has no length, but width"):
        Injected("steering_column_play", {"length": 1.0})
