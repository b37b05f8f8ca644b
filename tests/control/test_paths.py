"""Paths are checked by integrating their curvature again, and against the geometry of the standard."""

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, cumulative_trapezoid

from ident.control.paths import (
    Path,
    double_lane_change,
    double_lane_change_scaled,
    lane_change_length,
    mirrored,
    single_lane_change,
    truncated_slalom,
)
from ident.errors import BadRecipe

WIDTH = 2.5
SHARPEST = 2.0 / 15.0**2
PATHS = {
    "single": single_lane_change(60.0),
    "double": double_lane_change(width=WIDTH),
    "scaled": double_lane_change_scaled(SHARPEST, width=WIDTH),
    "slalom": truncated_slalom(SHARPEST),
    "mirrored": mirrored(truncated_slalom(SHARPEST)),
}
every_path = pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())


@every_path
def test_curvature_integrated_gives_heading_and_position_back(path: Path):
    fine = np.unique(np.concatenate([path.arc_length, np.linspace(0, path.arc_length[-1], 20001)]))
    curvature = np.interp(fine, path.arc_length, path.curvature)
    heading = cumulative_trapezoid(curvature, fine, initial=0)
    x = cumulative_simpson(np.cos(heading), x=fine, initial=0)
    y = cumulative_simpson(np.sin(heading), x=fine, initial=0)
    at = np.searchsorted(fine, path.arc_length)
    np.testing.assert_allclose(heading[at], path.heading, atol=1e-9)
    np.testing.assert_allclose(x[at], path.position_x, atol=1e-6)
    np.testing.assert_allclose(y[at], path.position_y, atol=1e-6)


@every_path
def test_curvature_never_jumps(path: Path):
    steps = np.diff(path.arc_length)
    assert np.all(steps > 0)
    assert np.max(steps) <= 0.25 + 1e-12
    change = np.abs(np.diff(path.curvature))
    longest_ramp = 4.0 * path.sharpest / 8.0  # no clothoid of these paths is shorter than 8 m
    assert np.all(change <= longest_ramp * steps + 1e-12)


@every_path
def test_begins_and_ends_straight_along_x(path: Path):
    before = path.arc_length <= 50.0
    after = path.arc_length >= path.arc_length[-1] - 100.0
    for straight in (before, after):
        assert np.count_nonzero(straight) > 100
        np.testing.assert_allclose(path.curvature[straight], 0, atol=1e-9)
        np.testing.assert_allclose(path.heading[straight], 0, atol=1e-9)


def test_a_lane_change_goes_over_by_its_offset_within_its_length():
    path = single_lane_change(60.0, offset=3.5, lead_in=20.0, run_out=40.0)
    assert path.position_x[-1] == pytest.approx(120.0, abs=1e-9)
    assert path.position_y[-1] == pytest.approx(3.5, abs=1e-9)
    across = np.interp([20.0, 50.0, 80.0], path.position_x, path.position_y)
    np.testing.assert_allclose(across, [0.0, 1.75, 3.5], atol=1e-9)
    assert np.all(np.diff(path.position_y) >= -1e-12)


@pytest.mark.parametrize("sharpest", [2.0 / 10.0**2, 2.0 / 22.2**2, 3.0 / 25.0**2])
def test_scaled_paths_are_as_sharp_as_asked_for(sharpest: float):
    single = single_lane_change(lane_change_length(sharpest))
    for path in (single, double_lane_change_scaled(sharpest), truncated_slalom(sharpest)):
        assert np.max(np.abs(path.curvature)) == pytest.approx(sharpest, rel=1e-9)


def test_a_gentle_lane_change_is_as_long_as_small_angles_say():
    # Three ramps of y'' over L/3 each, 0 to k to -k to 0, integrated twice: d = k L^2/9.
    assert lane_change_length(0.001, offset=3.5) == pytest.approx(3 * np.sqrt(3.5 / 0.001), rel=2e-3)


def test_the_track_of_the_standard_is_125_m_long_with_lanes_that_depend_on_the_width():
    first, second, third = PATHS["double"].lanes
    assert (first.end - first.begin, second.end - second.begin, third.end - third.begin) == (15, 25, 30)
    assert (second.begin - first.end, third.begin - second.end) == (30, 25)
    assert third.end - first.begin == 125
    assert [lane.width for lane in (first, second, third)] == pytest.approx([3.0, 3.25, 3.5])
    assert [lane.centre for lane in (first, second, third)] == [0, 3.5, 0]


@pytest.mark.parametrize("name", ["double", "scaled"])
def test_a_vehicle_on_the_path_stays_between_the_cones(name: str):
    path = PATHS[name]
    for lane in path.lanes:
        inside = (path.position_x >= lane.begin) & (path.position_x <= lane.end)
        assert np.count_nonzero(inside) > 40
        for side in (-WIDTH / 2, WIDTH / 2):
            edge = path.position_y[inside] + side * np.cos(path.heading[inside])
            assert np.all(np.abs(edge - lane.centre) < lane.width / 2 - 0.11)


@pytest.mark.parametrize("name", ["double", "scaled"])
def test_the_double_lane_change_uses_half_of_the_room_between_the_narrowest_cones(name: str):
    path = PATHS[name]
    first, second, third = path.lanes
    cones = [first.end, second.begin, second.end, third.begin]
    off = np.interp(cones, path.position_x, path.position_y) - [0.0, 3.5, 3.5, 0.0]
    np.testing.assert_allclose(off, [0.125, -0.125, -0.125, 0.125], rtol=0.03)


def test_the_scaled_track_is_that_of_the_standard_stretched_along_x():
    own, scaled = PATHS["double"], PATHS["scaled"]
    assert (own.name, scaled.name) == ("double_lane_change", "double_lane_change_scaled")
    factor = (scaled.lanes[2].end - scaled.lanes[0].begin) / 125.0
    assert 1.2 < factor < 2
    for lane, stretched in zip(own.lanes, scaled.lanes, strict=True):
        assert stretched.width == lane.width
        assert stretched.end - stretched.begin == pytest.approx(factor * (lane.end - lane.begin))
    assert np.max(scaled.position_y) == pytest.approx(3.5)


def test_the_slalom_passes_its_cones_left_and_right_and_comes_back():
    path = truncated_slalom(SHARPEST, amplitude=1.5, cones=4, lead_in=50.0, run_out=100.0)
    level = np.abs(path.position_y) > 1.5 - 1e-9
    tops = path.position_x[level]
    distance = tops[1] - tops[0]
    np.testing.assert_allclose(tops, 50.0 + distance * np.arange(1, 5), atol=1e-6)
    np.testing.assert_allclose(path.position_y[level], [1.5, -1.5, 1.5, -1.5], atol=1e-9)
    np.testing.assert_allclose(path.heading[level], 0, atol=1e-9)
    assert np.max(np.abs(path.position_y)) <= 1.5 + 1e-9
    assert path.position_x[-1] == pytest.approx(50.0 + 5 * distance + 100.0)
    sine = 1.5 * np.cos(np.pi * (path.position_x - tops[0]) / distance)
    between = (path.position_x > tops[0]) & (path.position_x < tops[-1])
    assert np.max(np.abs(sine - path.position_y)[between]) < 0.02 * 1.5


def test_mirrored_lanes_lie_to_the_right():
    path = mirrored(PATHS["double"])
    assert [lane.centre for lane in path.lanes] == [0, -3.5, 0]
    np.testing.assert_array_equal(path.position_y, -PATHS["double"].position_y)
    np.testing.assert_array_equal(path.curvature, -PATHS["double"].curvature)


@pytest.mark.parametrize("sharpest", [1e-7, 10.0])
def test_refuses_a_sharpness_that_no_change_has(sharpest: float):
    with pytest.raises(BadRecipe, match=r"curvature of .* 1/m: it is between .* another speed"):
        double_lane_change_scaled(sharpest)
