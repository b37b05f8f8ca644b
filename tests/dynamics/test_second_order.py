"""The closed form of two lags against an integration of the equation, the matrix exponential and symmetry."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from generator.actuator import WheelState
from generator.actuator import held_response as independent_response
from generator.truth import Actuator
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm, expm_frechet
from scipy.signal import impulse, lsim

from ident.dynamics.second_order import (
    free_response,
    held_response,
    impulse_response,
    lags_from_time_constants,
    step_response,
    time_constants,
)

Array = NDArray[np.float64]

SHAPES = {
    "overdamped": (0.33, 0.02),
    "critical": (0.5, 0.0625),
    "just above critical": (0.5, 0.0625 * (1 - 1e-9)),
    "just below critical": (0.5, 0.0625 * (1 + 1e-9)),
    "underdamped": (0.2, 0.09),
    "hardly damped": (0.02, 0.01),
    "near first order": (0.3, 1e-4 * 0.3**2),
    "very fast": (1e-3, 2e-7),
}
ALL = pytest.mark.parametrize(("a1", "a2"), SHAPES.values(), ids=SHAPES.keys())
AT_REST = {"initial_angle": 0.0, "initial_rate": 0.0}


def system(a1: float, a2: float) -> Array:
    """A of e' = A e."""
    return np.array([[0.0, 1.0], [-1.0 / a2, -a1 / a2]])


def commands(count: int = 20, seed: int = 3) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    return np.cumsum(random.uniform(0.01, 0.05, count)), random.uniform(-1.0, 1.0, count)


def integrated(a1: float, a2: float, arrival: Array, values: Array, times: Array, state: Array) -> Array:
    """(n, 2) y and y' by numerical integration from ``times[0]``, from arrival to arrival of a command."""
    knots = np.unique(np.concatenate([times, arrival[(arrival > times[0]) & (arrival < times[-1])]]))
    states = {knots[0]: np.asarray(state, dtype=np.float64)}
    for begin, end in pairwise(knots):
        held = max(int(np.searchsorted(arrival, begin, side="right")) - 1, 0)

        def rates(_t: float, x: Array, u: float = float(values[held])) -> list[float]:
            return [x[1], (u - x[0] - a1 * x[1]) / a2]

        found = solve_ivp(rates, (begin, end), states[begin], method="LSODA", rtol=1e-11, atol=1e-13)
        states[end] = found.y[:, -1]
    return np.array([states[t] for t in times])


def stepped(
    a1: float, a2: float, arrival: Array, values: Array, times: Array, state: Array
) -> tuple[Array, Array, Array]:
    """(n, 2) y, y' and their derivatives to a1 and a2, by matrix exponentials (Fréchet)."""
    by = [np.array([[0, 0], [0, -1 / a2]]), np.array([[0, 0], [1 / a2**2, a1 / a2**2]])]
    x, slopes = np.asarray(state, dtype=np.float64), [np.zeros(2), np.zeros(2)]
    rows = [(x, *slopes)]
    knots = np.unique(np.concatenate([times, arrival[(arrival > times[0]) & (arrival < times[-1])]]))
    for begin, end in pairwise(knots):
        target = np.array([values[max(int(np.searchsorted(arrival, begin, side="right")) - 1, 0)], 0.0])
        t = end - begin
        whole = expm(system(a1, a2) * t)
        changes = [expm_frechet(system(a1, a2) * t, part * t, compute_expm=False) for part in by]
        slopes = [
            change @ (x - target) + whole @ slope for change, slope in zip(changes, slopes, strict=True)
        ]
        x = target + whole @ (x - target)
        if end in times:
            rows.append((x, *slopes))
    return tuple(np.array([row[i] for row in rows]) for i in range(3))  # type: ignore[return-value]


@ALL
def test_a_held_command_is_answered_as_an_integration_of_the_equation_says(a1: float, a2: float) -> None:
    sent, values = commands()
    times = np.sort(np.concatenate([[0.02], np.random.default_rng(1).uniform(0.02, 1.2, 12)]))
    state = np.array([0.3, -0.7])
    expected = integrated(a1, a2, sent + 0.117, values, times, state)
    answer = held_response(0.117, a1, a2, sent, values, times, initial_angle=0.3, initial_rate=-0.7)
    np.testing.assert_allclose(answer[:, 0], expected[:, 0], rtol=0, atol=3e-8)
    scale = np.abs(expected[:, 1]).max()
    np.testing.assert_allclose(answer[:, 1], expected[:, 1], rtol=0, atol=1e-7 * scale)


@ALL
def test_the_derivatives_are_those_of_the_matrix_exponential(a1: float, a2: float) -> None:
    sent, values = commands(12)
    times = np.linspace(0.02, 0.9, 23)
    answer = held_response(0.08, a1, a2, sent, values, times, initial_angle=0.3, initial_rate=-0.7)
    x, by_a1, by_a2 = stepped(a1, a2, sent + 0.08, values, times, np.array([0.3, -0.7]))
    for column, expected in ((0, x[:, 0]), (1, x[:, 1]), (2, by_a1[:, 0]), (3, by_a2[:, 0])):
        scale = max(np.abs(expected).max(), 1e-3)
        np.testing.assert_allclose(answer[:, column], expected, rtol=0, atol=2e-9 * scale)


def test_the_response_and_its_derivatives_pass_smoothly_through_critical_damping() -> None:
    sent, values = commands(12)
    times = np.linspace(0.02, 0.9, 50)
    a1 = 0.5
    around = [0.0625 * (1 + off) for off in (-1e-4, -1e-7, -1e-9, -1e-12, 0.0, 1e-12, 1e-9, 1e-7, 1e-4)]
    answers = np.array([held_response(0.1, a1, a2, sent, values, times, **AT_REST) for a2 in around])
    lines = np.linspace(0, 1, 2)[:, None, None] * (answers[-1] - answers[0]) + answers[0]
    for a2, answer in zip(around, answers, strict=True):
        share = (a2 - around[0]) / (around[-1] - around[0])
        expected = lines[0] + share * (lines[1] - lines[0])
        np.testing.assert_allclose(answer, expected, rtol=0, atol=2e-7)


@pytest.mark.parametrize("factor", [0.99, 1.01], ids=["before", "after"])
@pytest.mark.parametrize("sign", [1, -1], ids=["overdamped", "underdamped"])
def test_the_series_meets_the_closed_form_where_one_replaces_the_other(factor: float, sign: int) -> None:
    a2, t = 0.04, 0.1
    delta = sign * factor * 1e-4 / t**2
    a1 = 2 * a2 * np.sqrt(delta + 1 / a2)
    times = np.array([0.0, t])
    answer = held_response(
        0.0, a1, a2, np.array([-1.0]), np.array([1.0]), times, initial_angle=0.2, initial_rate=3.0
    )
    x, by_a1, by_a2 = stepped(a1, a2, np.array([-1.0]), np.array([1.0]), times, state=np.array([0.2, 3.0]))
    expected = [x[1, 0], x[1, 1], by_a1[1, 0], by_a2[1, 0]]
    np.testing.assert_allclose(answer[1], expected, rtol=1e-10)


def test_agrees_with_the_truck_that_made_the_sample_logs() -> None:
    actuator = Actuator(1.0, 0.1173, 0.262, 0.081)
    sent, values = commands(200, seed=9)
    times = np.linspace(0.0, 6.0, 1201)
    at_rest = WheelState(time=0.0, angle=0.0, rate=0.0, command=0.0)
    angle, rate = independent_response(actuator, sent, values, times, at_rest)
    a1, a2 = lags_from_time_constants(0.262, 0.081)
    known = np.concatenate([[-1.0], sent]), np.concatenate([[0.0], values])
    answer = held_response(0.1173, a1, a2, *known, times, **AT_REST)
    np.testing.assert_allclose(answer[:, 0], angle, rtol=0, atol=1e-12)
    np.testing.assert_allclose(answer[:, 1], rate, rtol=0, atol=1e-11)


@ALL
def test_a_step_and_an_impulse_are_those_of_the_transfer_function(a1: float, a2: float) -> None:
    t = np.linspace(0.0, 6 * a1, 1201)
    _, expected, _ = lsim(([1.0], [a2, a1, 1.0]), np.ones_like(t), t)
    np.testing.assert_allclose(step_response(a1, a2, t), expected, rtol=0, atol=1e-8)
    _, expected = impulse(([1.0], [a2, a1, 1.0]), T=t)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(impulse_response(a1, a2, t), expected, rtol=0, atol=1e-8 * scale)


def test_nothing_answers_before_its_cause() -> None:
    early = np.array([-3.0, -1e-9])
    for response in (step_response, impulse_response):
        np.testing.assert_array_equal(response(0.3, 0.02, early), 0.0)
    np.testing.assert_array_equal(free_response(0.3, 0.02, early), np.zeros((2, 2)))
    angle, rate = free_response(0.3, 0.02, np.zeros(1))
    assert (angle[0], rate[0]) == (1.0, 0.0)


def test_a_command_before_the_first_sample_acts_at_once_and_the_first_value_before_its_time() -> None:
    times = np.array([1.0, 1.5])
    sent, values = np.array([0.0, 0.5, 5.0]), np.array([0.2, 0.7, 9.0])
    answer = held_response(0.1, 0.3, 0.02, sent, values, times, initial_angle=0.7, initial_rate=0.0)
    np.testing.assert_allclose(answer[:, 0], 0.7, rtol=0, atol=1e-15)
    unsent = held_response(
        0.1, 0.3, 0.02, np.array([4.0, 5.0]), np.array([0.2, 9.0]), times, initial_angle=0.2, initial_rate=0.0
    )
    np.testing.assert_allclose(unsent[:, 0], 0.2, rtol=0, atol=1e-15)


def test_a_negative_dead_time_answers_before_the_command() -> None:
    times = np.linspace(0.0, 1.0, 101)
    sent, values = np.array([-1.0, 0.5]), np.array([0.0, 1.0])
    answer = held_response(-0.1, 0.3, 0.02, sent, values, times, **AT_REST)[:, 0]
    np.testing.assert_allclose(answer, step_response(0.3, 0.02, times - 0.4), rtol=0, atol=1e-13)


def test_no_samples_give_no_rows() -> None:
    nothing = np.zeros(0)
    assert held_response(0.1, 0.3, 0.02, *commands(), nothing, **AT_REST).shape == (0, 4)


lags = st.tuples(st.floats(0.02, 2.0), st.floats(1e-3, 4.0)).map(
    lambda pair: (pair[0], pair[1] * pair[0] ** 2 / 4)
)


@settings(max_examples=40, deadline=None)
@given(lags, st.floats(0.0, 0.5), st.integers(0, 10**6))
def test_a_mirrored_command_gives_the_mirrored_response(
    shape: tuple[float, float], dead_time: float, seed: int
) -> None:
    sent, values = commands(20, seed)
    times = np.linspace(0.0, 1.5, 60)
    left = held_response(dead_time, *shape, sent, values, times, initial_angle=0.4, initial_rate=-0.2)
    right = held_response(dead_time, *shape, sent, -values, times, initial_angle=-0.4, initial_rate=0.2)
    np.testing.assert_array_equal(left, -right)


@settings(max_examples=40, deadline=None)
@given(lags, st.floats(0.0, 0.5), st.sampled_from([-64.0, 16.0, 1024.0]), st.integers(0, 10**6))
def test_the_response_does_not_depend_on_the_origin_of_time(
    shape: tuple[float, float], dead_time: float, shift: float, seed: int
) -> None:
    sent, values = commands(20, seed)
    times = np.linspace(0.0, 1.5, 60)
    here = held_response(dead_time, *shape, sent, values, times, **AT_REST)
    there = held_response(dead_time, *shape, sent + shift, values, times + shift, **AT_REST)
    np.testing.assert_allclose(there[:, 0], here[:, 0], rtol=0, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(lags, st.floats(0.0, 0.5), st.integers(0, 10**6))
def test_responses_superpose(shape: tuple[float, float], dead_time: float, seed: int) -> None:
    sent, first = commands(20, seed)
    _, second = commands(20, seed + 1)
    times = np.linspace(0.0, 1.5, 60)
    one = held_response(dead_time, *shape, sent, first, times, initial_angle=0.4, initial_rate=0.0)
    two = held_response(dead_time, *shape, sent, second, times, initial_angle=0.0, initial_rate=1.5)
    both = held_response(
        dead_time, *shape, sent, first + 2 * second, times, initial_angle=0.4, initial_rate=3.0
    )
    scale = np.abs(both).max(axis=0)
    np.testing.assert_allclose((one + 2 * two) / scale, both / scale, rtol=0, atol=1e-11)


@settings(max_examples=40, deadline=None)
@given(lags, st.integers(1, 58), st.integers(0, 10**6))
def test_a_response_carried_on_from_its_own_state_is_the_same_response(
    shape: tuple[float, float], at: int, seed: int
) -> None:
    sent, values = commands(20, seed)
    times = np.linspace(0.0, 1.5, 60)
    whole = held_response(0.1, *shape, sent, values, times, **AT_REST)
    rest = held_response(
        0.1, *shape, sent, values, times[at:], initial_angle=whole[at, 0], initial_rate=whole[at, 1]
    )
    np.testing.assert_allclose(rest[:, 0], whole[at:, 0], rtol=0, atol=1e-10)


@pytest.mark.parametrize(("first", "second"), [(0.3, 0.1), (0.25, 0.25), (1.0, 1e-4)])
def test_time_constants_are_found_again_from_their_sum_and_product(first: float, second: float) -> None:
    found = time_constants(*lags_from_time_constants(first, second))
    assert found == pytest.approx((first, second), rel=1e-9)


def test_an_underdamped_response_has_no_real_time_constants() -> None:
    assert time_constants(0.2, 0.0100001) is None
