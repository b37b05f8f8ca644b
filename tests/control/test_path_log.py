"""Paths of logs: points made from clothoids and circles, with what logs do to them."""

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, cumulative_trapezoid
from scipy.signal import lfilter

from ident.control.path_log import path_of_log, reference_of_log
from ident.control.paths import Path, truncated_slalom
from ident.control.truck import SteeringActuator, Truck
from ident.errors import NotIdentifiable

SPEED = 15.0
SLALOM = truncated_slalom(2.0 / SPEED**2, cones=3, lead_in=40.0, run_out=40.0)
SAMPLES = np.arange(0.0, SLALOM.arc_length[-1], 0.15)
INSIDE = slice(40, -40)  # 10 m from the ends, where nothing on one side holds the curve


def points(arc_length: np.ndarray = SAMPLES) -> tuple[np.ndarray, np.ndarray]:
    x = np.interp(arc_length, SLALOM.arc_length, SLALOM.position_x)
    return x, np.interp(arc_length, SLALOM.arc_length, SLALOM.position_y)


def at_speed(x: np.ndarray, speed: float = SPEED) -> np.ndarray:
    return np.full(x.size, speed)


def away(found: Path) -> tuple[np.ndarray, np.ndarray]:
    """Distance across and error of the curvature, by the slalom's own place along x."""
    across = np.interp(found.position_x, SLALOM.position_x, SLALOM.position_y) - found.position_y
    bend = np.interp(found.position_x, SLALOM.position_x, SLALOM.curvature) - found.curvature
    return across[INSIDE], bend[INSIDE]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_points_without_noise_give_the_path_back():
    found = path_of_log("run", *points(), at_speed(SAMPLES))
    across, bend = away(found.path)
    assert np.max(np.abs(across)) < 1e-3
    assert rms(bend) < 0.01 * SLALOM.sharpest
    assert found.path.arc_length[-1] == pytest.approx(SAMPLES[-1], abs=0.01)
    assert found.scatter < 1e-3
    assert found.lost == ()


@pytest.mark.parametrize(("noise", "least"), [(0.01, 0.03), (0.05, 0.06), (0.15, 0.11)])
def test_white_noise_is_smoothed_away(noise: float, least: float):
    random = np.random.default_rng(7)
    x, y = (column + noise * random.standard_normal(column.size) for column in points())
    found = path_of_log("run", x, y, at_speed(x))
    across, bend = away(found.path)
    assert rms(across) < 0.3 * noise
    assert rms(bend) < least * SLALOM.sharpest
    assert found.scatter == pytest.approx(noise, rel=0.1)
    assert found.path.sharpest == pytest.approx(SLALOM.sharpest, rel=0.2)


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_slow_errors_of_a_localisation_do_not_pass_for_curvature(seed: int):
    # Leaving out one point at a time gives an error of 0.22 to 0.29 of the sharpest curvature here.
    random = np.random.default_rng(seed)

    def slow() -> np.ndarray:  # an error that lasts for 10 samples, 1.5 m
        return lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], 0.01 * random.standard_normal(SAMPLES.size))

    x, y = (column + slow() for column in points())
    found = path_of_log("run", x, y, at_speed(x))
    assert rms(away(found.path)[1]) < 0.13 * SLALOM.sharpest
    assert found.path.sharpest == pytest.approx(SLALOM.sharpest, rel=0.25)


def test_heading_and_position_are_those_of_the_curvature():
    random = np.random.default_rng(5)
    x, y = (column + 0.02 * random.standard_normal(column.size) for column in points())
    path = path_of_log("run", x, y, at_speed(x)).path
    heading = path.heading[0] + cumulative_trapezoid(path.curvature, path.arc_length, initial=0)
    np.testing.assert_allclose(heading, path.heading, atol=1e-3)
    along = cumulative_simpson(np.cos(path.heading), x=path.arc_length, initial=0)
    np.testing.assert_allclose(path.position_x[0] + along, path.position_x, atol=1e-3)
    assert np.all(np.diff(path.arc_length) > 0)


def test_a_circle_has_its_radius():
    angle = np.arange(0.0, 5.5, 0.01)
    found = path_of_log("run", 1e5 + 40 * np.cos(angle), 40 * np.sin(angle), at_speed(angle, 8.0))
    np.testing.assert_allclose(found.path.curvature[INSIDE], 1 / 40, rtol=1e-3)
    assert found.path.arc_length[-1] == pytest.approx(40 * angle[-1], rel=1e-4)


def test_the_other_side_is_the_mirror_image_and_a_turned_map_the_same_path():
    random = np.random.default_rng(9)
    x, y = (column + 0.02 * random.standard_normal(column.size) for column in points())
    found = path_of_log("run", x, y, at_speed(x)).path
    other = path_of_log("run", x, -y, at_speed(x)).path
    np.testing.assert_allclose(other.curvature, -found.curvature, atol=1e-12)
    turned = path_of_log("run", -y + 3000.0, x - 500.0, at_speed(x)).path
    np.testing.assert_allclose(turned.curvature, found.curvature, atol=1e-8)


def test_held_and_quantised_points_are_no_steps():
    x, y = points(np.repeat(np.round(SAMPLES, 0), 4))
    found = path_of_log("run", np.round(x, 2), np.round(y, 2), at_speed(x))
    across, bend = away(found.path)
    assert rms(across) < 0.005
    assert rms(bend) < 0.05 * SLALOM.sharpest


def test_standing_before_and_after_changes_nothing():
    x, y = points()
    before, after = np.full(200, x[0]), np.full(300, x[-1])
    random = np.random.default_rng(1)
    long_x = np.concatenate([before, x, after]) + 0.01 * random.standard_normal(x.size + 500)
    long_y = np.concatenate([0 * before, y, 0 * after]) + 0.01 * random.standard_normal(x.size + 500)
    speed = np.concatenate([0 * before, at_speed(x), 0 * after])
    found = path_of_log("run", long_x, long_y, speed)
    assert found.path.arc_length[-1] == pytest.approx(SAMPLES[-1], abs=0.3)
    assert rms(away(found.path)[1]) < 0.05 * SLALOM.sharpest
    np.testing.assert_allclose(found.speed[INSIDE], SPEED, rtol=1e-9)


def test_the_longest_stretch_between_stops_is_taken_and_that_is_told():
    x, y = points()
    cut = SAMPLES.size // 4
    speed = at_speed(x)
    speed[cut : cut + 40] = 0.0
    found = path_of_log("run", x, y, speed)
    assert found.path.position_x[0] == pytest.approx(x[cut + 40], abs=0.5)
    assert found.lost == ("1 of 2 stretches between stops: the longest is taken",)


def test_points_that_are_no_numbers_are_left_out_and_counted():
    x, y = points()
    x[100:103] = np.nan
    found = path_of_log("run", x, y, at_speed(x))
    assert found.lost == (f"3 of {x.size} points without a number",)
    assert np.max(np.abs(away(found.path)[0])) < 1e-3


def test_the_reference_of_a_log_goes_at_the_logged_speeds():
    x, y = points()
    speed = 12.0 + 0.01 * SAMPLES
    body = {"mass": 12500.0, "yaw_inertia": 48000.0, "cg_to_front_axle": 2.38, "cg_to_rear_axle": 2.12}
    stiffness = {"front.cornering_stiffness": 2.9e5, "rear.cornering_stiffness": 4.6e5}
    steering = SteeringActuator(1.0, 0.1, 0.2, 0.1, np.array([[-10.0, -0.5], [10.0, 0.5]]))
    truck = Truck("linear", body | stiffness, steering)
    found = reference_of_log(path_of_log("run 7", x, y, speed), truck, tracked_x=-2.12)
    assert (found.name, found.tracked_x) == ("run 7", -2.12)
    np.testing.assert_allclose(found.speed, 12.0 + 0.01 * found.arc_length, atol=0.02)
    assert found.time[-1] == pytest.approx(np.log(found.speed[-1] / 12.0) / 0.01, rel=1e-3)
    assert np.max(np.abs(found.heading_error)) > 1e-3


def test_refuses_a_path_that_is_too_short():
    x, y = points(SAMPLES[:150])
    with pytest.raises(NotIdentifiable, match=r"run: the path is .* m long, need 30 m: take"):
        path_of_log("run", x, y, at_speed(x))


def test_refuses_a_gap():
    x, y = (np.delete(column, slice(400, 500)) for column in points())
    with pytest.raises(
        NotIdentifiable, match=r"two neighbouring points .* are 15\.\d m apart, need 10 m: cut"
    ):
        path_of_log("run", x, y, at_speed(x))


def test_refuses_a_path_that_goes_back():
    there_and_back = np.concatenate([SAMPLES, SAMPLES[::-1]])
    with pytest.raises(NotIdentifiable, match=r"turns by 1\d\d degrees within 4 m, near x = .* cut the run"):
        path_of_log("run", *points(there_and_back), at_speed(there_and_back))


def test_refuses_a_path_that_is_driven_backwards():
    x, y = points()
    with pytest.raises(NotIdentifiable, match=r"the path runs \d+ m backwards: take another run"):
        path_of_log("run", x, y, at_speed(x), heading=np.full(x.size, np.pi))


@pytest.mark.parametrize("speed", [0.0, -5.0])
def test_refuses_a_truck_that_does_not_drive_on(speed: float):
    x, y = points()
    with pytest.raises(NotIdentifiable, match=r"the highest speed on the path is .* m/s, need 1 m/s: take"):
        path_of_log("run", x, y, at_speed(x, speed))


def test_refuses_points_without_any_number():
    with pytest.raises(NotIdentifiable, match="no point of the path has a number"):
        path_of_log("run", np.full(100, np.nan), np.zeros(100), np.ones(100))
