"""Speed profiles against their limits, closed forms, and a linear program that knows nothing of passes."""

import numpy as np
import pytest
from scipy.optimize import linprog

from ident.control.paths import single_lane_change
from ident.control.speed_profile import SpeedLimits, given_profile, speed_profile
from ident.errors import BadRecipe

LIMITS = SpeedLimits(20.0, lateral_acceleration=2.0, acceleration=0.5, deceleration=1.0)


def curves() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    arc_length = np.concatenate([[0.0], np.cumsum(random.uniform(1.0, 8.0, 119))])
    curvature = 0.03 * np.sin(arc_length / 23.0) * np.exp(-(((arc_length - 250.0) / 120.0) ** 2))
    return arc_length, curvature


def test_keeps_every_limit_everywhere():
    arc_length, curvature = curves()
    found = speed_profile(arc_length, curvature, LIMITS)
    slope = np.diff(found.speed**2) / (2 * np.diff(arc_length))
    assert np.all(found.speed <= 20.0 + 1e-12)
    assert np.max(np.abs(curvature) * found.speed**2) <= 2.0 + 1e-12
    assert np.min(slope) >= -1.0 - 1e-9
    assert np.max(slope) <= 0.5 + 1e-9
    np.testing.assert_allclose(found.acceleration[:-1], slope, atol=1e-12)


def test_no_profile_within_the_limits_is_faster_anywhere():
    arc_length, curvature = curves()
    n, steps = arc_length.size, np.diff(arc_length)
    rise = np.zeros((n - 1, n))
    rise[np.arange(n - 1), np.arange(n - 1)] = -1.0
    rise[np.arange(n - 1), np.arange(1, n)] = 1.0
    highest = np.minimum(400.0, 2.0 / np.maximum(np.abs(curvature), 1e-12))
    best = linprog(
        -np.ones(n),
        A_ub=np.concatenate([rise, -rise]),
        b_ub=np.concatenate([2 * 0.5 * steps, 2 * 1.0 * steps]),
        bounds=np.stack([np.zeros(n), highest], axis=1),
    )
    assert best.success
    found = speed_profile(arc_length, curvature, LIMITS)
    np.testing.assert_allclose(found.speed**2, best.x, rtol=1e-7)


def test_slows_before_a_curve_and_gathers_speed_after_it():
    arc_length = np.arange(0.0, 1000.5, 0.5)
    curvature = np.where(np.abs(arc_length - 500.0) <= 10.0, 0.02, 0.0)
    found = speed_profile(arc_length, curvature, LIMITS)
    in_curve = np.sqrt(2.0 / 0.02)
    braking = (400.0 - in_curve**2) / (2 * 1.0)
    driving = (400.0 - in_curve**2) / (2 * 0.5)
    np.testing.assert_allclose(found.speed[np.abs(arc_length - 500.0) <= 10.0], in_curve)
    slower = arc_length[found.speed < 20.0 - 1e-9]
    assert slower[0] == pytest.approx(490.0 - braking, abs=0.5)
    assert slower[-1] == pytest.approx(510.0 + driving, abs=0.5)
    time = (
        (490.0 - braking + 1000.0 - 510.0 - driving) / 20.0
        + 20.0 / in_curve
        + (20.0 - in_curve) * (1 / 1.0 + 1 / 0.5)
    )
    assert found.time[-1] == pytest.approx(time, rel=1e-3)


def test_a_gentle_path_is_driven_at_the_set_speed():
    path = single_lane_change(200.0)
    found = speed_profile(path.arc_length, path.curvature, LIMITS)
    np.testing.assert_allclose(found.speed, 20.0)
    np.testing.assert_allclose(found.time, path.arc_length / 20.0, rtol=1e-9)
    np.testing.assert_allclose(found.acceleration, 0.0, atol=1e-9)


def test_driving_the_other_way_with_exchanged_limits_is_the_mirror_image():
    arc_length, curvature = curves()
    there = speed_profile(arc_length, curvature, LIMITS)
    exchanged = SpeedLimits(20.0, 2.0, acceleration=1.0, deceleration=0.5)
    back = speed_profile(arc_length[-1] - arc_length[::-1], -curvature[::-1], exchanged)
    np.testing.assert_allclose(back.speed[::-1], there.speed, rtol=1e-12)
    assert back.time[-1] == pytest.approx(there.time[-1])


def test_a_held_acceleration_takes_the_time_of_the_textbook():
    time = np.linspace(0.0, 10.0, 11)
    found = given_profile(5.0 * time + 0.3 * time**2, 5.0 + 0.6 * time)
    np.testing.assert_allclose(found.time, time, rtol=1e-12)
    np.testing.assert_allclose(found.acceleration, 0.6, rtol=1e-12)


@pytest.mark.parametrize(
    "wrong", [{"set_speed": 0.0}, {"deceleration": -1.0}, {"lateral_acceleration": np.nan}]
)
def test_refuses_limits_that_are_not_positive(wrong: dict[str, float]):
    with pytest.raises(
        BadRecipe, match=rf"{next(iter(wrong))} of a speed profile is .*: need a positive number"
    ):
        SpeedLimits(**{"set_speed": 20.0, **wrong})
