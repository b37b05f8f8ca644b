"""The nonlinear actuator against a plain integration, its sensitivities against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from actuator_integrated import Truck
from numpy.typing import NDArray

from ident.dynamics.actuator_nonlinear import ROLES, WIDTH, Lags, by_ratio, by_skew, nonlinear_response
from ident.dynamics.effects.steering_dead_zone import dead_zone
from ident.dynamics.second_order import held_response

Array = NDArray[np.float64]

random = np.random.default_rng(0)
SENT = np.arange(0.0, 12.0, 0.02) + random.uniform(0, 0.004, 600)
REQUEST = np.where(np.floor(SENT / 3) % 2 == 0, 0.6, -0.4) + 0.3 * np.sin(2 * SENT)
TIMES = np.arange(0.013, 12.0, 0.01)
LONG_AGO = -1e6
COLUMNS = ROLES + 3  # angle, rate and gain

# a1, skew, L, rate, width, shift of the first command, initial angle, initial rate, gain
CASES = {
    "limit and play": (0.3, 0.4, 0.12, 0.5, 0.05, 0.0, 0.3, 0.2, 1.1),
    "limit in the slower lag": (0.3, -0.4, 0.12, 0.5, 0.05, 0.0, 0.3, 0.2, 1.0),
    "limit alone": (0.3, 0.6, 0.12, 0.9, 0.0, 0.0, 0.3, 0.2, 1.0),
    "limit exceeded at the start": (0.3, 0.1, 0.12, 2.0, 0.1, 0.0, 0.3, -3.0, 1.0),
    "wide play alone": (0.3, 0.5, 0.0, 1e3, 0.4, 0.0, 0.0, 0.0, 0.9),
}


def response(case: tuple[float, ...]) -> tuple[Array, Array]:
    a1, skew, dead_time, rate, width, shift, angle, initial_rate, gain = case
    lags = replace(by_skew(a1, skew), rate=rate, width=width)
    sent = np.concatenate([[LONG_AGO], SENT])
    sent[1] += shift
    values = np.concatenate([[0.3], gain * REQUEST])
    by_command = np.zeros((sent.size, COLUMNS))
    by_command[1:, ROLES + 2] = REQUEST
    by_start = np.zeros((3, COLUMNS))
    by_start[[0, 2], ROLES] = 1.0
    by_start[1, ROLES + 1] = 1.0
    start = (np.array([angle, initial_rate, angle]), by_start)
    return nonlinear_response(lags, dead_time, (sent, values, by_command), TIMES, start)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_agrees_with_an_integration_in_small_steps(case: tuple[float, ...]) -> None:
    a1, skew, dead_time, rate, width, _, angle, initial_rate, gain = case
    truck = Truck(gain, dead_time, a1 * (1 + skew) / 2, a1 * (1 - skew) / 2, rate, width)
    expected = truck.answer(SENT, REQUEST, TIMES, start=(angle, initial_rate), steps=16, before=0.3)
    np.testing.assert_allclose(response(case)[0][:, 0], expected, rtol=0, atol=5e-6)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_sensitivities_agree_with_differences(case: tuple[float, ...]) -> None:
    sensitivities = response(case)[1]
    columns = [0, 1, 2, 3, WIDTH, 5, ROLES, ROLES + 1, ROLES + 2]
    for index, column in enumerate(columns):
        if column == WIDTH and case[4] == 0:
            continue
        step = 1e-6
        more, less = list(case), list(case)
        more[index] += step
        less[index] -= step
        difference = (response(tuple(more))[0] - response(tuple(less))[0])[:, 0] / (2 * step)
        scale = max(1.0, float(np.abs(difference).max()))
        np.testing.assert_allclose(sensitivities[:, column], difference, rtol=0, atol=1e-6 * scale)


@pytest.mark.parametrize("ratio", [1e-4, 0.1, 0.25, 0.6, 4.0])
def test_without_effects_it_is_the_linear_actuator_exactly(ratio: float) -> None:
    a1 = 0.3
    nothing = np.zeros((SENT.size, ROLES))
    start = (np.array([0.3, 0.1, 0.3]), np.zeros((3, ROLES)))
    out, by = nonlinear_response(by_ratio(a1, ratio), 0.12, (SENT, REQUEST, nothing), TIMES, start)
    linear = held_response(0.12, a1, ratio * a1**2, SENT, REQUEST, TIMES, initial_angle=0.3, initial_rate=0.1)
    np.testing.assert_allclose(out[:, 1:], linear[:, :2], rtol=0, atol=1e-13)
    np.testing.assert_array_equal(out[:, 0], out[:, 1])
    np.testing.assert_allclose(by[:, 0], linear[:, 2] + 2 * ratio * a1 * linear[:, 3], rtol=0, atol=1e-11)
    np.testing.assert_allclose(by[:, 1], a1**2 * linear[:, 3], rtol=0, atol=1e-8)


def test_a_limit_that_nothing_reaches_changes_nothing() -> None:
    start = (np.zeros(3), np.zeros((3, 0)))
    command = (SENT, REQUEST, np.zeros((SENT.size, 0)))
    free = nonlinear_response(by_skew(0.3, 0.4), 0.1, command, TIMES, start)[0]
    limit = float(np.abs(free[:, 2]).max()) * 1.5
    limited = nonlinear_response(replace(by_skew(0.3, 0.4), rate=limit), 0.1, command, TIMES, start)[0]
    np.testing.assert_allclose(limited, free, rtol=0, atol=1e-13)


def test_the_rate_never_passes_its_limit() -> None:
    lags = replace(by_skew(0.3, 0.4), rate=0.7)
    command = (SENT, REQUEST, np.zeros((SENT.size, 0)))
    out, _ = nonlinear_response(lags, 0.1, command, TIMES, (np.zeros(3), np.zeros((3, 0))))
    assert np.abs(out[:, 2]).max() == 0.7
    assert np.abs(np.diff(out[:, 0])).max() <= 0.7 * 0.01 * (1 + 1e-9)


def test_mirrored_requests_give_mirrored_answers() -> None:
    lags: Lags = replace(by_skew(0.3, 0.4), rate=0.6, width=0.1)
    answers = []
    for side in (1.0, -1.0):
        values, *_ = dead_zone(side * REQUEST, 0.2)
        command = (SENT, values, np.zeros((SENT.size, 0)))
        answers.append(nonlinear_response(lags, 0.1, command, TIMES, (np.zeros(3), np.zeros((3, 0))))[0])
    np.testing.assert_allclose(answers[0], -answers[1], rtol=0, atol=1e-14)


def test_the_dead_zone_takes_its_width_from_every_larger_request() -> None:
    values, by_width, slope = dead_zone(np.array([-0.5, -0.2, 0.0, 0.1, 0.9]), 0.2)
    np.testing.assert_allclose(values, [-0.3, 0.0, 0.0, 0.0, 0.7])
    np.testing.assert_array_equal(by_width, [1.0, 0.0, 0.0, 0.0, -1.0])
    np.testing.assert_array_equal(slope, [1.0, 0.0, 0.0, 0.0, 1.0])
