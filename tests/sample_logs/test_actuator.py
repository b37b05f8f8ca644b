"""The simulated steering actuator against closed forms and an independent integration."""

import numpy as np
import pytest
from generator.actuator import WheelState, held_response
from generator.truth import Actuator
from scipy.integrate import solve_ivp

AT_REST = WheelState(time=0.0, angle=0.0, rate=0.0, command=0.0)
TIMES = np.linspace(0.0, 4.0, 1601)
SENT = 0.4  # [s]


def step(actuator: Actuator, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    return held_response(actuator, np.array([SENT]), np.array([size]), TIMES, AT_REST)


def since_arrival(actuator: Actuator) -> np.ndarray:
    return np.maximum(TIMES - SENT - actuator.dead_time, 0.0)


def test_step_of_two_lags_is_the_closed_form(truth):
    actuator = truth.steering.actuator
    t, T1, T2 = since_arrival(actuator), actuator.time_constant_1, actuator.time_constant_2
    expected = actuator.gain * (1.0 - (T1 * np.exp(-t / T1) - T2 * np.exp(-t / T2)) / (T1 - T2))
    expected_rate = actuator.gain * (np.exp(-t / T1) - np.exp(-t / T2)) / (T1 - T2)
    angle, rate = step(actuator)
    np.testing.assert_allclose(angle, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rate, expected_rate, rtol=0, atol=1e-12)


def test_step_of_two_equal_lags_is_the_closed_form():
    actuator = Actuator(0.9, 0.1, 0.2, 0.2)
    t = since_arrival(actuator) / 0.2
    np.testing.assert_allclose(step(actuator)[0], 0.9 * (1.0 - (1.0 + t) * np.exp(-t)), rtol=0, atol=1e-12)


def test_nearly_equal_lags_do_not_cancel():
    equal, nearly = Actuator(1.0, 0.1, 0.2, 0.2), Actuator(1.0, 0.1, 0.2, 0.2 * (1.0 - 1e-10))
    np.testing.assert_allclose(step(nearly)[0], step(equal)[0], rtol=0, atol=1e-9)


def test_step_of_one_lag_is_the_closed_form():
    actuator = Actuator(1.1, 0.05, 0.3, 0.0)
    angle, rate = step(actuator)
    decay = np.exp(-since_arrival(actuator) / 0.3)
    np.testing.assert_allclose(angle, 1.1 * (1.0 - decay), rtol=0, atol=1e-12)
    moving = SENT + actuator.dead_time < TIMES
    np.testing.assert_allclose(rate[moving], (1.1 / 0.3 * decay)[moving], rtol=0, atol=1e-12)


def test_underdamped_step_is_the_closed_form():
    natural, damping = 8.0, 0.35
    actuator = Actuator.from_damping(1.0, 0.1, natural, damping)
    t, damped = since_arrival(actuator), natural * np.sqrt(1.0 - damping**2)
    wave = np.cos(damped * t) + damping * natural / damped * np.sin(damped * t)
    expected = 1.0 - np.exp(-damping * natural * t) * wave
    angle = step(actuator)[0]
    np.testing.assert_allclose(angle, expected, rtol=0, atol=1e-12)
    overshoot = np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2))
    assert np.max(angle) == pytest.approx(1.0 + overshoot, abs=1e-4)


def test_nothing_moves_before_the_dead_time_is_over(truth):
    actuator = truth.steering.actuator
    angle, _ = step(actuator)
    before = SENT + actuator.dead_time > TIMES
    assert np.all(angle[before] == 0.0)
    assert np.all(angle[SENT + actuator.dead_time < TIMES] > 0.0)


def test_held_commands_agree_with_an_integration_of_the_equation(truth):
    actuator = truth.steering.actuator
    random = np.random.default_rng(3)
    sent_time = np.cumsum(random.uniform(0.01, 0.05, 40))
    sent = random.uniform(-1.0, 1.0, 40)
    T1, T2 = actuator.time_constant_1, actuator.time_constant_2
    state, reached = np.zeros(2), 0.0
    for k, arrival in enumerate(sent_time + actuator.dead_time):
        target = actuator.gain * (sent[k - 1] if k else 0.0)

        def rates(_t: float, x: np.ndarray, target: float = target) -> list[float]:
            return [x[1], (target - x[0] - (T1 + T2) * x[1]) / (T1 * T2)]

        state = solve_ivp(rates, (reached, arrival), state, rtol=1e-12, atol=1e-13).y[:, -1]
        reached = arrival
        angle, rate = held_response(actuator, sent_time, sent, np.array([arrival]), AT_REST)
        np.testing.assert_allclose([angle[0], rate[0]], state, rtol=0, atol=1e-9)


def test_a_response_carried_on_from_its_own_state_is_the_same_response(truth):
    actuator = truth.steering.actuator
    sent_time, sent = np.array([0.1, 0.3, 0.5]), np.array([1.0, -0.5, 0.2])
    whole, _ = held_response(actuator, sent_time, sent, TIMES, AT_REST)
    until = 0.55  # the first two commands have arrived, the third has not
    angle, rate = held_response(actuator, sent_time, sent, np.array([until]), AT_REST)
    halfway = WheelState(until, float(angle[0]), float(rate[0]), command=-0.5)
    later = TIMES[until <= TIMES]
    rest, _ = held_response(actuator, sent_time[2:], sent[2:], later, halfway)
    np.testing.assert_allclose(rest, whole[until <= TIMES], rtol=0, atol=1e-13)


def test_refuses_a_time_before_the_initial_state(truth):
    with pytest.raises(ValueError, match="before the initial state"):
        held_response(truth.steering.actuator, np.array([1.0]), np.ones(1), np.array([-0.1]), AT_REST)
