"""Steps of tyre parameters against the force curves that they promise, by a formula written here."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ident.dynamics.tyres import tyre_of
from ident.estimation.coordinates import Coordinate
from ident.estimation.tyre_steps import FittedAxle

Array = NDArray[np.float64]

NAMES = ("cornering_stiffness", "peak_force", "shape", "curvature")
COORDINATES = [
    Coordinate("front.cornering_stiffness", low=np.log(1e4), high=np.log(1e7)),
    Coordinate("front.peak_force", low=np.log(1e3), high=np.log(1e6)),
    Coordinate("front.shape", low=np.log(0.5), high=np.log(2.5)),
    Coordinate("yaw_inertia"),
    Coordinate("front.curvature", logarithmic=False, low=-5.0, high=1.0),
]
AXLE = FittedAxle(tyre_of("magic_formula"), 0.0, {}, dict(zip(NAMES, (0, 1, 2, 4), strict=True)))
AT = np.array([np.log(3.3e5), np.log(5.5e4), np.log(1.22), 2.0, 0.18])
LARGEST = 0.15  # [rad]
SLIPS = np.linspace(0.01, LARGEST, 60)


def force(at: Array) -> Array:
    stiffness, peak, shape = np.exp(at[:3])
    stretched = stiffness / (shape * peak) * SLIPS
    return peak * np.sin(shape * np.arctan(stretched - at[4] * (stretched - np.arctan(stretched))))


def slope(at: Array) -> Array:
    steps = 1e-6 * np.eye(5)
    return np.column_stack([(force(at + step) - force(at - step)) / 2e-6 for step in steps])


def flat_direction() -> Array:
    """The step of peak, shape and curvature that changes the force least, made long."""
    own = slope(AT)[:, [1, 2, 4]]
    step = np.zeros(5)
    step[[1, 2, 4]] = np.linalg.svd(own, full_matrices=False)[2][-1]
    return step * 0.6 / abs(step[4])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_long_step_along_the_valley_keeps_its_promise_where_a_straight_one_leaves_it(sign: float) -> None:
    step = sign * flat_direction()
    promised = slope(AT) @ step
    straight = np.abs(force(AT + step) - force(AT) - promised).max()
    carried = AXLE.moved(COORDINATES, AT, step, LARGEST)
    assert np.abs(force(AT + carried) - force(AT) - promised).max() < 0.1 * straight
    assert carried[3] == step[3]
    assert sign * carried[4] * flat_direction()[4] > 0.04


def test_a_small_step_is_the_straight_one() -> None:
    step = np.array([1e-4, -2e-4, 1e-4, 0.3, 5e-4])
    assert AXLE.moved(COORDINATES, AT, step, LARGEST) == pytest.approx(step, rel=0.05)


def test_the_ends_of_what_is_possible_are_kept() -> None:
    at = AT.copy()
    at[4] = 0.95
    made = at + AXLE.moved(COORDINATES, at, np.array([0.0, 0.3, 0.0, 0.0, 0.9]), LARGEST)
    assert made[4] <= 1.0
    assert np.isfinite(made).all()


def test_no_step_stays_none() -> None:
    assert AXLE.moved(COORDINATES, AT, np.zeros(5), LARGEST).tolist() == [0.0] * 5
