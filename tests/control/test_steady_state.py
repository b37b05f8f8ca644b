"""Steady cornering against the textbook, and against a bicycle written here and integrated by scipy."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ident.control.steady_state import SteadyCornering, steady_cornering
from ident.control.truck import SteeringActuator, Truck
from ident.errors import BadRecipe

RATIO = np.array([[-10.0, -0.5], [10.0, 0.5]])
STEERING = SteeringActuator(1.0, 0.1, 0.2, 0.1, RATIO)
MASS, INERTIA, FRONT, REAR = 12500.0, 48000.0, 2.38, 2.12
BODY = {"mass": MASS, "yaw_inertia": INERTIA, "cg_to_front_axle": FRONT, "cg_to_rear_axle": REAR}
C_F, C_R = 2.9e5, 4.6e5
LINEAR = {**BODY, "front.cornering_stiffness": C_F, "rear.cornering_stiffness": C_R}
PEAKS = {"front": 45e3, "rear": 52e3}
SHAPE, CURVATURE = 1.4, -0.8
MAGIC = {
    **LINEAR,
    **{f"{axle}.peak_force": peak for axle, peak in PEAKS.items()},
    **{f"{axle}.shape": SHAPE for axle in PEAKS},
    **{f"{axle}.curvature": CURVATURE for axle in PEAKS},
}
SPEEDS = np.array([5.0, 12.0, 20.0, 25.0])


def linear(**changes: object) -> Truck:
    return Truck(**{"model": "linear", "parameters": LINEAR, "steering": STEERING, **changes})


def magic() -> Truck:
    return Truck("magic_formula", MAGIC, STEERING)


def one(truck: Truck, curvature: float, speed: float, tracked_x: float = 0.0) -> SteadyCornering:
    return steady_cornering(truck, np.array([curvature]), np.array([speed]), tracked_x=tracked_x)


def magic_force(slip: float, stiffness: float, peak: float) -> float:
    b = stiffness / (SHAPE * peak) * slip
    return peak * np.sin(SHAPE * np.arctan(b - CURVATURE * (b - np.arctan(b))))


def settled(angle: float, speed: float) -> tuple[float, float]:
    """Lateral velocity and yaw rate that a nonlinear bicycle comes to rest at."""

    def rates(_: float, state: np.ndarray) -> list[float]:
        across, turn = state
        slip_f = angle - np.arctan((across + FRONT * turn) / speed)
        slip_r = -np.arctan((across - REAR * turn) / speed)
        front = magic_force(slip_f, C_F, PEAKS["front"]) * np.cos(angle)
        rear = magic_force(slip_r, C_R, PEAKS["rear"])
        return [(front + rear) / MASS - speed * turn, (FRONT * front - REAR * rear) / INERTIA]

    found = solve_ivp(rates, (0.0, 60.0), [0.0, 0.0], method="LSODA", rtol=1e-10, atol=1e-12)
    return found.y[0, -1], found.y[1, -1]


def test_linear_tyres_give_the_understeer_gradient_of_the_textbook():
    curvature = np.full(4, 1e-5)
    found = steady_cornering(linear(), curvature, SPEEDS)
    wheelbase = FRONT + REAR
    gradient = MASS / wheelbase * (REAR / C_F - FRONT / C_R)
    np.testing.assert_allclose(
        found.road_wheel_angle, curvature * (wheelbase + gradient * SPEEDS**2), rtol=1e-6
    )
    drift = curvature * SPEEDS * (REAR - MASS * FRONT * SPEEDS**2 / (wheelbase * C_R))
    np.testing.assert_allclose(found.lateral_velocity, drift, rtol=1e-6)
    np.testing.assert_allclose(found.yaw_rate, curvature * SPEEDS, rtol=1e-6)
    np.testing.assert_allclose(found.heading_error, -drift / SPEEDS, rtol=1e-6)
    assert np.all(np.sign(found.heading_error) == [-1, -1, 1, 1])


def test_nonlinear_tyres_give_what_a_simulated_truck_comes_to_rest_at():
    for curvature, speed in [(0.005, 20.0), (0.04, 9.0), (-0.008, 20.0)]:
        found = one(magic(), curvature, speed)
        drift, turn = settled(found.road_wheel_angle[0], speed)
        assert found.lateral_velocity[0] == pytest.approx(drift, abs=1e-6)
        assert found.yaw_rate[0] == pytest.approx(turn, abs=1e-7)
        assert turn / np.hypot(speed, drift) == pytest.approx(curvature, rel=1e-5)


@pytest.mark.parametrize("tracked_x", [0.0, -REAR, 3.0])
def test_the_tracked_point_stays_on_its_circle(tracked_x: float):
    found = one(magic(), 0.006, 20.0, tracked_x)
    error, drift = found.heading_error[0], found.lateral_velocity[0]
    assert error != 0
    assert 20.0 * np.sin(error) + drift * np.cos(error) == pytest.approx(0, abs=1e-12)
    progress = 20.0 * np.cos(error) - drift * np.sin(error)
    assert found.yaw_rate[0] == pytest.approx(0.006 * progress, rel=1e-12)


def test_the_kinematic_truck_is_plane_geometry():
    found = one(Truck("kinematic", LINEAR, STEERING), 0.05, 10.0, tracked_x=-REAR)
    assert found.road_wheel_angle[0] == pytest.approx(np.arctan(0.05 * (FRONT + REAR)), rel=1e-12)
    assert found.heading_error[0] == pytest.approx(0, abs=1e-12)
    at_cg = one(Truck("kinematic", LINEAR, STEERING), 0.05, 10.0)
    rear_radius = np.sqrt(1 / 0.05**2 - REAR**2)
    assert at_cg.road_wheel_angle[0] == pytest.approx(np.arctan((FRONT + REAR) / rear_radius), rel=1e-12)
    assert at_cg.heading_error[0] == pytest.approx(-np.arctan(REAR / rear_radius), rel=1e-12)


@pytest.mark.parametrize("model", ["kinematic", "linear", "magic_formula"])
def test_left_and_right_are_mirror_images(model: str):
    truck = Truck(model, MAGIC, STEERING)
    curvature = np.array([0.002, 0.004, 0.006])
    left = steady_cornering(truck, curvature, np.full(3, 20.0))
    right = steady_cornering(truck, -curvature, np.full(3, 20.0))
    for name in vars(left):
        np.testing.assert_allclose(getattr(right, name), -getattr(left, name), rtol=1e-9)


def test_repeated_points_in_any_order_get_the_same_answer():
    curvature = np.array([0.004, 0.0, 0.004, -0.002, 0.0])
    speed = np.array([20.0, 10.0, 20.0, 15.0, 10.0])
    found = steady_cornering(magic(), curvature, speed)
    alone = [one(magic(), k, v).road_wheel_angle[0] for k, v in zip(curvature, speed, strict=True)]
    np.testing.assert_allclose(found.road_wheel_angle, alone, rtol=1e-9, atol=1e-15)
    assert found.road_wheel_angle[1] == 0


@cache
def sharpest_circle() -> float:
    """Largest curvature that any road-wheel angle gives at 20 m/s."""
    at_rest = [settled(angle, 20.0) for angle in np.arange(0.2, 0.6, 0.01)]
    return max(turn / np.hypot(20.0, drift) for drift, turn in at_rest)


def test_holds_close_to_the_limit_of_the_tyres_and_stays_before_their_peak():
    found = one(magic(), 0.98 * sharpest_circle(), 20.0)
    drift, turn = settled(found.road_wheel_angle[0], 20.0)
    assert found.yaw_rate[0] == pytest.approx(turn, rel=1e-6)
    assert found.lateral_velocity[0] == pytest.approx(drift, rel=1e-5)
    more = settled(found.road_wheel_angle[0] + 0.005, 20.0)[1]
    assert more > turn


@pytest.mark.parametrize("factor", [1.02, 1.5, 4.0])
def test_refuses_in_one_line_what_the_tyres_cannot_hold(factor: float):
    curvature = np.array([0.0, factor * sharpest_circle()])
    with pytest.raises(
        BadRecipe, match=r"no steady cornering .* m/s² across: it holds at .*; lower"
    ) as refusal:
        steady_cornering(magic(), curvature, np.array([20.0, 20.0]))
    assert "\n" not in str(refusal.value)


def test_refuses_saturated_piecewise_tyres():
    parameters = {**LINEAR, "front.saturation_slip": 0.1, "rear.saturation_slip": 0.1}
    truck = Truck("piecewise_linear", parameters, STEERING)
    limit = C_F * 0.1 * (FRONT + REAR) / REAR / MASS
    curvature = 0.9 * limit / 400.0
    expected = one(linear(), curvature, 20.0).road_wheel_angle
    np.testing.assert_allclose(one(truck, curvature, 20.0).road_wheel_angle, expected, rtol=1e-9)
    with pytest.raises(BadRecipe, match="no steady cornering"):
        one(truck, 1.1 * limit / 400.0, 20.0)


def test_refuses_a_circle_that_the_wheels_do_not_turn_for():
    with pytest.raises(
        BadRecipe, match=r"needs 0\.\d+ rad at the road wheels, they reach 0\.2 rad: take a wider"
    ):
        one(linear(highest_angle=0.2), 0.1, 3.0)


def test_a_steering_offset_is_steered_against():
    truck = linear(effects={"steering_offset": {"angle": 0.01}})
    straight, curved = one(truck, 0.0, 15.0), one(truck, 0.004, 15.0)
    assert straight.road_wheel_angle[0] == pytest.approx(-0.01, rel=1e-9)
    assert straight.heading_error[0] == pytest.approx(0, abs=1e-12)
    without = one(linear(), 0.004, 15.0)
    assert curved.road_wheel_angle[0] == pytest.approx(without.road_wheel_angle[0] - 0.01, rel=1e-9)


def test_tyre_relaxation_changes_nothing_in_the_steady_state():
    truck = linear(effects={"tyre_relaxation": {"length": 0.6}})
    relaxed, without = one(truck, 0.005, 15.0), one(linear(), 0.005, 15.0)
    for name in vars(without):
        np.testing.assert_allclose(getattr(relaxed, name), getattr(without, name), rtol=1e-9)


def test_oversteering_trucks_steer_less_and_beyond_the_critical_speed_the_other_way():
    parameters = {**LINEAR, "front.cornering_stiffness": 6e5, "rear.cornering_stiffness": 3e5}
    truck = linear(parameters=parameters)
    gradient = MASS / (FRONT + REAR) * (REAR / 6e5 - FRONT / 3e5)
    critical = np.sqrt(-(FRONT + REAR) / gradient)
    slow, fast = one(truck, 1e-5, 0.8 * critical), one(truck, 1e-5, 1.2 * critical)
    assert 0 < slow.road_wheel_angle[0] < 1e-5 * (FRONT + REAR)
    assert fast.road_wheel_angle[0] == pytest.approx(
        1e-5 * (FRONT + REAR + gradient * (1.2 * critical) ** 2), rel=1e-5
    )
    assert fast.road_wheel_angle[0] < 0
