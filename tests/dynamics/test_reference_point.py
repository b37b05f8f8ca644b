"""Motion moved between points of a rigid body, against positions that are differentiated."""

from __future__ import annotations

import numpy as np
import pytest

from ident.dynamics.reference_point import (
    CG,
    ReferencePoint,
    front_axle,
    moved_acceleration,
    moved_position,
    moved_velocity,
    rear_axle,
)

TIME = np.linspace(0.0, 2.0, 4001)
STEP = TIME[1] - TIME[0]
HEADING = 0.7 * np.sin(1.3 * TIME)
POINT = ReferencePoint("imu", 0.8, -0.4)


def rates(values: np.ndarray) -> np.ndarray:
    return np.gradient(values, STEP, edge_order=2)


def in_vehicle(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    cosine, sine = np.cos(HEADING), np.sin(HEADING)
    return x * cosine + y * sine, y * cosine - x * sine


def test_velocity_and_acceleration_are_those_of_the_moved_position() -> None:
    position = (8 * TIME, np.sin(TIME))
    moved = moved_position(position, np.cos(HEADING), np.sin(HEADING), CG, POINT)
    turn, turning = rates(HEADING), rates(rates(HEADING))
    for level, move in ((1, moved_velocity), (2, moved_acceleration)):
        at_cg, expected = position, moved
        for _ in range(level):
            at_cg, expected = tuple(map(rates, at_cg)), tuple(map(rates, expected))
        arguments = (turn,) if level == 1 else (turn, turning)
        found = move(*in_vehicle(*at_cg), *arguments, CG, POINT)
        for one, other in zip(found, in_vehicle(*expected), strict=True):
            assert np.max(np.abs(one - other)[5:-5]) < 1e-5


def test_there_and_back_changes_nothing() -> None:
    there = moved_velocity(9.0, 0.3, 0.2, rear_axle(2.1), POINT)
    assert moved_velocity(*there, 0.2, POINT, rear_axle(2.1)) == pytest.approx((9.0, 0.3))


def test_axles_lie_before_and_behind_the_centre_of_gravity() -> None:
    assert rear_axle(2.1).to(front_axle(2.4)) == pytest.approx((4.5, 0))
    assert CG.to(rear_axle(2.1)) == (-2.1, 0)
    assert moved_velocity(10.0, 0.0, 0.1, CG, rear_axle(2.1)) == pytest.approx((10.0, -0.21))
