"""From request to motion: against one integration of everything together, and its derivatives."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from vehicle_values import MOUNTED, TILTED, truck

from ident.dynamics.actuator import actuator
from ident.dynamics.bicycle import bicycle
from ident.dynamics.blocks import held, ratio_map
from ident.dynamics.cascade import STEERING, Course, Request, Steering, sensitivities, simulate, steer
from ident.dynamics.engine import compiled
from ident.dynamics.second_order import held_response

Array = NDArray[np.float64]

TABLE = np.array([[-8.0, -0.38], [-1.0, -0.05], [1.0, 0.05], [8.0, 0.38]])
STEERING_TRUTH = Steering(0.98, 0.11, 0.36, 0.023, TABLE)
RANDOM = np.random.default_rng(8)
REQUEST = Request(np.cumsum(RANDOM.uniform(0.1, 0.5, 12)) - 0.5, RANDOM.uniform(-2.5, 2.5, 12))
WHEEL = (0.2, -0.5)


def course(step: float, seconds: float = 3.0) -> Course:
    times = np.arange(round(seconds / step) + 1) * step
    return Course(times, 9.0 + np.sin(times), np.array([0.1, 0.05, 0.2, 1.0, -2.0]), WHEEL)


def engine_and_values() -> tuple[object, Array]:
    engine = compiled(bicycle("magic_formula", "magic_formula"))
    return engine, engine.vector(truck("magic_formula", MOUNTED, TILTED))


def integrated(whole: Course, p: Array) -> Array:
    """States of the bicycle from one integration of lags and bicycle together, change by change."""
    engine, steering = engine_and_values()[0], STEERING_TRUTH

    def rates(time: float, state: Array, command: float) -> Array:
        towards = steering.gain * command - state[0] - steering.sum_of_lags * state[1]
        road, _ = ratio_map(TABLE, state[:1])
        inputs = [road[0], 9.0 + np.sin(time)]
        return np.concatenate(
            [[state[1], towards / steering.product_of_lags], engine.rates(state[2:], inputs, p)]
        )

    changes = REQUEST.times + steering.dead_time
    knots = np.unique(np.concatenate([whole.times, changes[(changes > 0) & (changes < whole.times[-1])]]))
    states = {0.0: np.concatenate([WHEEL, whole.start])}
    for begin, end in pairwise(knots):
        command = held(REQUEST.times, REQUEST.values, steering.dead_time, np.array([(begin + end) / 2]))[0]
        found = solve_ivp(rates, (begin, end), states[begin], args=(command,), rtol=1e-10, atol=1e-12)
        states[end] = found.y[:, -1]
    return np.array([states[time] for time in whole.times])


def test_the_cascade_is_one_system() -> None:
    engine, p = engine_and_values()
    coarse, fine = course(0.02, 2.0), course(0.01, 2.0)
    expected = integrated(coarse, p)
    response = steer(REQUEST, STEERING_TRUTH, coarse.times, WHEEL)
    assert response.steering_wheel_angle == pytest.approx(expected[:, 0], abs=1e-8)
    assert response.steering_wheel_rate == pytest.approx(expected[:, 1], abs=1e-7)
    assert np.max(np.abs(expected[:, 0])) > 1.1, "the table is used on one stretch only"
    errors = [
        np.max(np.abs(simulate(engine, REQUEST, STEERING_TRUTH, grid, p)[0][::stride] - expected[:, 2:]))
        for grid, stride in ((coarse, 1), (fine, 2))
    ]
    assert errors[0] < 5e-4
    assert errors[1] < errors[0] / 3, "between grid points the angle runs linearly: second order"


def test_the_derivatives_are_those_of_the_cascade() -> None:
    engine, p = engine_and_values()
    active = ["front.cornering_stiffness", *STEERING, "steering_offset"]
    grid = course(0.02)
    states, _, derivatives = sensitivities(engine, REQUEST, STEERING_TRUTH, grid, p, active=active)
    plain = simulate(engine, REQUEST, STEERING_TRUTH, grid, p)
    assert np.max(np.abs(states - plain[0])) < 1e-10
    assert derivatives.shape == (len(engine.outputs), grid.times.size, 5 + len(active))
    for column, name in enumerate(STEERING, start=6):
        step = 1e-5 * getattr(STEERING_TRUTH, name)
        moved = [
            simulate(
                engine,
                REQUEST,
                replace(STEERING_TRUTH, **{name: getattr(STEERING_TRUTH, name) + sign * step}),
                grid,
                p,
            )[1].T
            for sign in (1, -1)
        ]
        numeric = (moved[0] - moved[1]) / (2 * step)
        size = np.max(np.abs(numeric), axis=1, keepdims=True)
        assert np.max(np.abs(derivatives[:, :, column] - numeric) / size) < 1e-5, name


def test_the_actuator_as_equation_and_in_closed_form_are_the_same() -> None:
    engine = compiled(actuator())
    first, second = 0.25, 0.08
    times = np.arange(400) * 0.01
    commands = np.where(times < 1.0, 0.3, -0.2)
    p = engine.vector({"gain": 0.97, "time_constant_1": first, "time_constant_2": second})
    _, outputs = engine.simulate(
        [[0.1, 0.4]],
        commands[:, None],
        np.full(400, 0.01),
        [0, 400],
        p,
        held=["steering_wheel_request"],
        substeps=np.full(400, 4),
    )
    expected = held_response(
        0.0,
        first + second,
        first * second,
        times,
        0.97 * commands,
        times,
        initial_angle=0.1,
        initial_rate=0.4,
    )
    assert np.max(np.abs(outputs - expected[:, :2]) / [0.3, 2.0]) < 1e-8
