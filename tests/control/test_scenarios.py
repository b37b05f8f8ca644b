"""Scenarios as references: all columns agree with each other."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from ident.control.scenarios import SCENARIOS, scenario, scenario_path
from ident.control.speed_profile import SpeedLimits
from ident.control.truck import SteeringActuator, Truck
from ident.errors import BadRecipe

TRUCK = Truck(
    "linear",
    {
        "mass": 12500.0,
        "yaw_inertia": 48000.0,
        "cg_to_front_axle": 2.38,
        "cg_to_rear_axle": 2.12,
        "front.cornering_stiffness": 2.9e5,
        "rear.cornering_stiffness": 4.6e5,
    },
    SteeringActuator(1.0, 0.1, 0.2, 0.1, np.array([[-10.0, -0.5], [10.0, 0.5]])),
)
LIMITS = SpeedLimits(80 / 3.6)


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_columns_of_a_reference_agree(name: str):
    found = scenario(name, TRUCK, LIMITS, tracked_x=-2.12)
    assert found.name == name
    assert found.tracked_x == -2.12
    columns = [value for value in vars(found).values() if isinstance(value, np.ndarray)]
    assert {column.shape for column in columns} == {found.arc_length.shape}
    assert all(np.all(np.isfinite(column)) for column in columns)
    assert np.max(np.abs(found.curvature) * found.speed**2) <= 2.0 + 1e-9
    slow = cumulative_trapezoid(1 / found.speed, found.arc_length, initial=0)
    np.testing.assert_allclose(found.time, slow, atol=2e-3)
    drift = found.speed * np.sin(found.heading_error) + found.lateral_velocity * np.cos(found.heading_error)
    np.testing.assert_allclose(drift, 0, atol=1e-10)
    sharp = np.abs(found.curvature) > 1e-6
    assert np.all(found.heading_error[sharp] != 0)
    np.testing.assert_array_equal(np.sign(found.road_wheel_angle[sharp]), np.sign(found.curvature[sharp]))


@pytest.mark.parametrize("name", ["single_lane_change", "double_lane_change_scaled", "truncated_slalom"])
def test_scaled_scenarios_use_the_lateral_acceleration_that_they_may(name: str):
    found = scenario(name, TRUCK, LIMITS)
    np.testing.assert_allclose(found.speed, 80 / 3.6)
    assert np.max(np.abs(found.curvature) * found.speed**2) == pytest.approx(2.0, rel=1e-9)


def test_the_track_of_the_standard_is_driven_slowly_enough():
    found = scenario("double_lane_change", TRUCK, LIMITS)
    assert np.min(found.speed) < 11.0
    assert np.max(np.abs(found.curvature) * found.speed**2) == pytest.approx(2.0, rel=1e-9)


def test_errors_have_time_to_settle():
    path = scenario_path("single_lane_change", LIMITS)
    curved = path.arc_length[np.abs(path.curvature) > 1e-9]
    assert curved[0] > 2.9 * LIMITS.set_speed
    assert path.arc_length[-1] - curved[-1] > 5.9 * LIMITS.set_speed


def test_refuses_an_unknown_scenario():
    with pytest.raises(BadRecipe, match="no scenario moose: need one of single_lane_change"):
        scenario("moose", TRUCK, LIMITS)
