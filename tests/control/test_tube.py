"""The tube: a set that disturbances never drive the error out of, and how far it reaches."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from ident.control.tube import SIGMAS, bounds_of_corrections, invariant_tube

Array = NDArray[np.float64]

OSCILLATING = np.array([[0.9, 0.2, 0.0], [-0.2, 0.9, 0.1], [0.0, 0.0, 0.5]])
BOUNDS = np.array([0.02, 0.0, 0.05])


def is_inside(point: Array, generators: Array) -> bool:
    """Whether a point is a sum of the generators with factors between -1 and 1, by a linear program."""
    count = generators.shape[0]
    found = linprog(np.zeros(count), A_eq=generators.T, b_eq=point, bounds=[(-1.0, 1.0)] * count)
    return bool(found.status == 0)


def test_disturbances_never_drive_the_error_out_of_the_tube() -> None:
    tube = invariant_tube(OSCILLATING, BOUNDS)
    random = np.random.default_rng(1)
    for way in range(4):
        error, direction = np.zeros(3), random.standard_normal(3)
        for step in range(120):
            if way == 0:  # whatever drives it out fastest along one direction
                pushed = BOUNDS * np.sign(np.linalg.matrix_power(OSCILLATING, 119 - step).T @ direction)
            else:
                pushed = BOUNDS * random.choice([-1.0, 1.0], 3)
            error = OSCILLATING @ error + pushed
            assert np.all(np.abs(error) <= tube.box + 1e-12)
        assert is_inside(error, tube.generators)


def test_the_set_holds_its_own_image_and_the_disturbance_on_top() -> None:
    tube = invariant_tube(OSCILLATING, BOUNDS)
    directions = np.random.default_rng(2).standard_normal((2000, 3))
    image = tube.reach(directions @ OSCILLATING) + np.abs(directions) @ BOUNDS
    assert np.all(image <= tube.reach(directions) * (1 + 1e-12))


def test_the_set_is_hardly_larger_than_the_smallest() -> None:
    tube = invariant_tube(OSCILLATING, BOUNDS)
    directions = np.random.default_rng(3).standard_normal((200, 3))
    power, smallest = np.eye(3), np.zeros(200)
    for _ in range(500):
        smallest += np.abs(directions @ power) @ BOUNDS
        power = power @ OSCILLATING
    reached = tube.reach(directions)
    assert np.all(reached >= smallest)
    assert np.all(reached <= 1.08 * smallest)


def test_a_first_order_lag_has_the_tube_of_the_textbook() -> None:
    tube = invariant_tube(np.array([[0.8]]), np.array([0.1]))
    assert tube.box[0] == pytest.approx(0.1 / (1 - 0.8), rel=0.06)


def test_twice_the_disturbance_is_twice_the_tube() -> None:
    one, two = (invariant_tube(OSCILLATING, scale * BOUNDS).box for scale in (1.0, 2.0))
    assert two == pytest.approx(2 * one)


def test_there_is_no_tube_about_a_loop_that_is_not_stable() -> None:
    with pytest.raises(ValueError, match=r"eigenvalue of size 1\.0100"):
        invariant_tube(np.diag([0.5, 1.01]), np.ones(2))


def test_a_disturbance_that_cannot_be_held_to_the_bounds_leaves_the_tube() -> None:
    tube = invariant_tube(OSCILLATING, BOUNDS)
    error = np.zeros(3)
    for _ in range(60):
        error = OSCILLATING @ error + 3.0 * np.array([0.02, 0.0, 0.05])
    assert not np.all(np.abs(error) <= tube.box)


def test_bounds_are_what_an_estimator_corrects_when_the_residuals_are_as_large_as_told() -> None:
    names = ("lateral_error", "heading_error", "yaw_rate")
    gain = np.array([[0.3, 2.0, 0.1], [0.001, 0.4, 0.02], [0.0, 0.5, 0.7]])
    sizes = {"position_across": 0.02, "heading": 0.002, "yaw_rate": 0.001}
    innovations = np.random.default_rng(5).standard_normal((40_000, 3)) * list(sizes.values())
    corrections = innovations @ gain.T
    bounds = bounds_of_corrections(sizes, names, gain)
    for column, name in enumerate(names):
        assert bounds[name] == pytest.approx(SIGMAS * corrections[:, column].std(), rel=0.02)


def test_a_state_without_a_known_residual_has_no_bound() -> None:
    gain = np.full((2, 2), 0.5)
    bounds = bounds_of_corrections({"road_wheel_angle": 0.001}, ("steering_angle", "yaw_rate"), gain)
    assert bounds == {"steering_angle": pytest.approx(SIGMAS * 0.5 * 0.001)}
