"""Projection on a path, against circles in closed form and a search over many points."""

from __future__ import annotations

import numpy as np
import pytest
from bench_case import circle, straight

from ident.control.reference import Reference
from ident.control.tracking import project


def winding(step=0.5):
    """A path whose curvature is a sine, integrated on a grid that is much finer than its samples."""
    fine = np.arange(0.0, 200.0 + 1e-9, 0.005)
    heading = 0.6 * np.sin(fine / 15.0)
    x, y = (
        np.concatenate([[0.0], np.cumsum((f[1:] + f[:-1]) / 2) * 0.005])
        for f in (np.cos(heading), np.sin(heading))
    )
    every = slice(None, None, round(step / 0.005))
    none = np.zeros(fine[every].size)
    path = Reference(
        "winding",
        fine[every],
        x[every],
        y[every],
        heading[every],
        (0.04 * np.cos(fine / 15.0))[every],
        *(none + 10.0, fine[every] / 10.0, none, none, none, none, none),
    )
    return path, x, y


@pytest.mark.parametrize("curvature", [0.0, 0.02, -0.05])
def test_errors_from_a_circle_are_those_of_its_radius(curvature):
    path = circle(curvature, 10.0, 60.0)
    s, left = np.array([5.3, 20.0, 41.7]), np.array([0.7, -1.3, 2.0])
    angle = curvature * s
    x, y = s, np.zeros(3)
    if curvature:
        x, y = np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature
    found = project(path, x - left * np.sin(angle), y + left * np.cos(angle), s + 3.0)
    np.testing.assert_allclose(found[0], s, atol=1e-6)
    np.testing.assert_allclose(found[1], left, atol=1e-6)
    np.testing.assert_allclose(found[2], angle, atol=1e-7)
    np.testing.assert_allclose(found[3], curvature, atol=1e-12)


def test_the_nearest_point_is_the_nearest_of_many():
    path, fine_x, fine_y = winding()
    random = np.random.default_rng(2)
    s = random.uniform(5.0, 190.0, 40)
    place = np.round(s / 0.005).astype(int)
    x = fine_x[place] + random.uniform(-3.0, 3.0, 40)
    y = fine_y[place] + random.uniform(-3.0, 3.0, 40)
    away = np.hypot(fine_x[:, None] - x, fine_y[:, None] - y)
    _, left, _, _ = project(path, x, y, s)
    np.testing.assert_allclose(np.abs(left), away.min(axis=0), atol=2e-4)


def test_beyond_its_ends_the_path_runs_straight_on():
    path = circle(0.02, 10.0, 50.0)
    end_x, end_y, angle = path.position_x[-1], path.position_y[-1], path.heading[-1]
    x = np.array([-4.0, end_x + 6.0 * np.cos(angle) - 0.5 * np.sin(angle)])
    y = np.array([0.3, end_y + 6.0 * np.sin(angle) + 0.5 * np.cos(angle)])
    s, left, _, curvature = project(path, x, y, np.array([0.0, 50.0]))
    np.testing.assert_allclose(s, [-4.0, 56.0], atol=1e-9)
    np.testing.assert_allclose(left, [0.3, 0.5], atol=1e-9)
    assert np.all(curvature == 0.0)


def test_a_truck_that_drives_round_twice_is_where_it_was_last():
    path = circle(0.1, 10.0, 120.0)
    s, _, _, _ = project(path, path.position_x[200:201], path.position_y[200:201], np.array([99.0]))
    assert s[0] == pytest.approx(100.0, abs=1e-6)
    s, _, _, _ = project(path, path.position_x[200:201], path.position_y[200:201], np.array([37.0]))
    assert s[0] == pytest.approx(100.0 - 20 * np.pi, abs=1e-4)


def test_a_number_that_is_none_stays_one():
    s, left, _, _ = project(straight(10.0, 20.0), np.array([np.nan]), np.array([0.0]), np.array([1.0]))
    assert np.isnan(left[0])
    assert s[0] == 1.0
