"""The simulated trucks: steady states, symmetry, energy, limits and rigid-body kinematics."""

import dataclasses

import numpy as np
import pytest
from generator import vehicle as kernels
from generator.driving import drivers_wheel, steady_wheel_angle, varied_speed
from generator.motion import HEADING, V_X, V_Y, YAW_RATE, X, Y, drive, imu_signals, rear_axle_signals
from generator.truth import AxleTyre, Planar, Truth, TwoTrack
from generator.vehicle import STEP, Motion, simulate
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

SPEED = 12.0
MIRROR = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])


def inputs(wheel: np.ndarray, speed: float = SPEED) -> np.ndarray:
    return np.column_stack([wheel, np.full_like(wheel, speed), np.zeros_like(wheel)])


def half_steps(duration: float) -> np.ndarray:
    return STEP / 2.0 * np.arange(2 * round(duration / STEP) + 1)


def steer(vehicle: Planar | TwoTrack, wheel: np.ndarray, speed: float = SPEED) -> Motion:
    return simulate(vehicle, np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.0, inputs(wheel, speed))


def axle_force(tyre: AxleTyre, slip: float) -> float:
    b, c, d, e = tyre.stiffness, tyre.shape, tyre.peak, tyre.curvature
    return d * np.sin(c * np.arctan(b * slip - e * (b * slip - np.arctan(b * slip))))


def planar_rates(truck: Planar, v_x: float, v_y: float, r: float, delta: float) -> tuple[float, float]:
    """The equations of the planar truck, written down a second time."""
    body = truck.body
    front = axle_force(truck.front, delta - np.arctan((v_y + body.cg_to_front_axle * r) / v_x))
    rear = axle_force(truck.rear, -np.arctan((v_y - body.cg_to_rear_axle * r) / v_x))
    across = (front * np.cos(delta) + rear) / body.mass - v_x * r
    turning = body.cg_to_front_axle * front * np.cos(delta) - body.cg_to_rear_axle * rear
    return across, turning / body.yaw_inertia


@pytest.fixture(scope="module")
def weaving(truth: Truth) -> np.ndarray:
    time = half_steps(8.0)
    return 2.5 * np.sin(1.3 * time) * (1.0 - np.exp(-time))


def test_planar_truck_settles_in_the_steady_state_of_its_equations(truth):
    truck, wheel = truth.planar, 3.0
    motion = steer(truck, np.full(2 * 15_000 + 1, wheel))
    delta = wheel / truck.steering_ratio
    v_y, r = fsolve(lambda x: planar_rates(truck, SPEED, x[0], x[1], delta), [0.0, 0.3], xtol=1e-13)
    np.testing.assert_allclose(motion.states[-1, [V_Y, YAW_RATE]], [v_y, r], rtol=0, atol=1e-9)
    acceleration = imu_signals(dataclasses.replace(truck, imu_position=(0.0, 0.0, 0.0)), motion)
    lateral = acceleration["lateral_acceleration"](motion.time[-1:])
    assert lateral[0] == pytest.approx(SPEED * r, abs=1e-9)
    assert abs(lateral[0]) > 3.0


def test_gentle_steady_turn_has_the_understeer_of_the_axles(truth):
    truck, body, wheel = truth.planar, truth.planar.body, 0.02
    r = steer(truck, np.full(2 * 15_000 + 1, wheel)).states[-1, YAW_RATE]
    front, rear = (t.stiffness * t.shape * t.peak for t in (truck.front, truck.rear))
    wheelbase = body.cg_to_front_axle + body.cg_to_rear_axle
    gradient = body.mass / wheelbase * (body.cg_to_rear_axle / front - body.cg_to_front_axle / rear)
    assert gradient > 0.0
    assert wheel / truck.steering_ratio == pytest.approx((wheelbase / SPEED + gradient * SPEED) * r, rel=1e-4)


def test_planar_truck_agrees_with_an_independent_integration(truth, weaving):
    truck = truth.planar
    motion = steer(truck, weaving)

    def rates(t: float, x: np.ndarray) -> list[float]:
        delta = 2.5 * np.sin(1.3 * t) * (1.0 - np.exp(-t)) / truck.steering_ratio
        v_y, r, _, _, heading = x
        east = SPEED * np.cos(heading) - v_y * np.sin(heading)
        north = SPEED * np.sin(heading) + v_y * np.cos(heading)
        return [*planar_rates(truck, SPEED, v_y, r, delta), east, north, r]

    exact = solve_ivp(rates, (0.0, 8.0), np.zeros(5), rtol=1e-12, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(motion.states[-1, 1:], exact, rtol=0, atol=2e-9)


@pytest.mark.parametrize("which", ["planar", "truck"])
def test_mirrored_steering_gives_the_mirrored_motion(truth, weaving, which):
    vehicle = getattr(truth, which)
    left, right = steer(vehicle, weaving), steer(vehicle, -weaving)
    np.testing.assert_allclose(right.states, left.states * MIRROR, rtol=0, atol=1e-12)
    assert np.max(np.abs(left.states[:, YAW_RATE])) > 0.2


def kinetic_energy(truck: TwoTrack, motion: Motion) -> np.ndarray:
    v_x, v_y, r = motion.states[:, V_X], motion.states[:, V_Y], motion.states[:, YAW_RATE]
    return (truck.body.mass * (v_x**2 + v_y**2) + truck.body.yaw_inertia * r**2) / 2.0


def test_tyres_only_take_energy(truth, weaving):
    coasting = dataclasses.replace(truth.truck, speed_gain=0.0)
    energy = kinetic_energy(coasting, steer(coasting, weaving))
    assert np.all(np.diff(energy) < 1e-6)
    assert 0.75 < energy[-1] / energy[0] < 0.99


def test_coasting_straight_on_keeps_the_energy(truth):
    coasting = dataclasses.replace(truth.truck, speed_gain=0.0)
    motion = steer(coasting, np.zeros(2 * 3000 + 1))
    energy = kinetic_energy(coasting, motion)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-13)
    assert motion.states[-1, X] == pytest.approx(3.0 * SPEED, rel=1e-12)


def test_narrow_low_truck_on_two_tracks_is_the_planar_truck(truth):
    truck = truth.truck
    flat = dataclasses.replace(
        truck, body=dataclasses.replace(truck.body, track=1e-6, cg_height=0.0), speed_gain=200.0
    )
    axles = {}
    for name, lever in (("front", truck.body.cg_to_rear_axle), ("rear", truck.body.cg_to_front_axle)):
        tyre = getattr(truck, name)
        wheelbase = truck.body.cg_to_front_axle + truck.body.cg_to_rear_axle
        load = truck.body.mass * 9.81 * lever / wheelbase / 2.0
        excess = (load - tyre.nominal_load) / tyre.nominal_load
        peak = tyre.friction * (1.0 - tyre.friction_slope * excess) * load
        cornering = tyre.stiffness_max * np.sin(2.0 * np.arctan(load / tyre.load_at_max))
        axles[name] = AxleTyre(cornering / (tyre.shape * peak), tyre.shape, 2.0 * peak, tyre.curvature)
    wheel = 0.3 * np.sin(1.5 * half_steps(6.0))
    on_tracks, plane = steer(flat, wheel), steer(dataclasses.replace(truth.planar, **axles), wheel)
    scale = np.max(np.abs(plane.states[:, YAW_RATE]))
    difference = np.max(np.abs(on_tracks.states[:, YAW_RATE] - plane.states[:, YAW_RATE]))
    assert difference < 1e-4 * scale


def test_wheel_loads_belong_to_the_accelerations_that_they_allow(truth):
    p = kernels._numbers(truth.truck)
    state, delta = np.array([SPEED, -0.4, 0.3, 0.0, 0.0, 0.0]), 0.17
    along, across, turning = kernels._two_track_forces(state, delta, 0.0, p)
    loads = kernels._wheel_loads(p, along, across)
    assert sum(loads) == pytest.approx(truth.truck.body.mass * kernels.GRAVITY, rel=1e-12)
    assert loads[1] > loads[0]  # turning left loads the right side
    assert loads[3] > loads[2]
    body, forces, moment, half = truth.truck.body, np.zeros(2), 0.0, truth.truck.body.track / 2.0
    for k, (ahead, left) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        x = body.cg_to_front_axle if ahead == 1 else -body.cg_to_rear_axle
        y, angle = left * half, delta if ahead == 1 else 0.0
        slip = angle - np.arctan((state[V_Y] + x * state[YAW_RATE]) / (SPEED - y * state[YAW_RATE]))
        force = kernels.wheel_force(slip, loads[k], p[8:15] if ahead == 1 else p[15:22])
        pushed = force * np.array([-np.sin(angle), np.cos(angle)])
        forces += pushed
        moment += x * pushed[1] - y * pushed[0]
    np.testing.assert_allclose(forces / body.mass, [along, across], rtol=0, atol=1e-9)
    assert moment / body.yaw_inertia == pytest.approx(turning, abs=1e-9)


def test_more_load_transfer_in_front_means_more_understeer_in_hard_turns_only(truth):
    soft, stiff = (dataclasses.replace(truth.truck, front_roll_share=share) for share in (0.3, 0.7))
    ratios = []
    for wheel in (0.1, 2.6):
        turning = [steer(t, np.full(2 * 8000 + 1, wheel)).states[-1, YAW_RATE] for t in (stiff, soft)]
        ratios.append(turning[0] / turning[1])
    assert ratios[0] == pytest.approx(1.0, abs=1e-3)
    assert 0.8 < ratios[1] < 0.97


@pytest.fixture(scope="module", params=["planar", "truck"])
def driven(truth: Truth, request: pytest.FixtureRequest) -> tuple[Planar | TwoTrack, Motion]:
    vehicle, random = getattr(truth, request.param), np.random.default_rng(5)
    speed = varied_speed(10.0, 15.0, 20.0, random)
    wheel = drivers_wheel(truth.planar, 4.5, speed, 20.0, random)
    return vehicle, drive(vehicle, wheel, speed, 20.0, np.array([50.0, -20.0, 2.9]))


def along_and_across(motion: Motion, east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn a vector in the map into the vehicle's axes."""
    cosine, sine = np.cos(motion.states[:, HEADING]), np.sin(motion.states[:, HEADING])
    return cosine * east + sine * north, cosine * north - sine * east


def test_odometry_of_the_rear_axle_is_the_motion_of_a_point_of_the_body(driven):
    vehicle, motion = driven
    odometry = {name: signal(motion.time) for name, signal in rear_axle_signals(vehicle, motion).items()}
    distance = np.hypot(odometry["x"] - motion.states[:, X], odometry["y"] - motion.states[:, Y])
    np.testing.assert_allclose(distance, vehicle.body.cg_to_rear_axle, rtol=1e-12)
    moved = [np.gradient(odometry[axis], STEP) for axis in ("x", "y")]
    along, across = along_and_across(motion, *moved)
    inner = slice(5, -5)
    np.testing.assert_allclose(along[inner], odometry["longitudinal_velocity"][inner], rtol=0, atol=2e-5)
    np.testing.assert_allclose(across[inner], odometry["lateral_velocity"][inner], rtol=0, atol=2e-5)
    turned = np.gradient(odometry["heading"], STEP)
    np.testing.assert_allclose(turned[inner], odometry["yaw_rate"][inner], rtol=0, atol=1e-5)


def test_inertial_unit_feels_the_acceleration_of_its_own_place(driven):
    vehicle, motion = driven
    vehicle = dataclasses.replace(vehicle, imu_position=(0.7, -0.4, 0.2))
    heading = motion.states[:, HEADING]
    x = motion.states[:, X] + 0.7 * np.cos(heading) + 0.4 * np.sin(heading)
    y = motion.states[:, Y] + 0.7 * np.sin(heading) - 0.4 * np.cos(heading)
    accelerated = [np.gradient(np.gradient(axis, STEP), STEP) for axis in (x, y)]
    along, across = along_and_across(motion, *accelerated)
    imu = {name: signal(motion.time) for name, signal in imu_signals(vehicle, motion).items()}
    inner = slice(5, -5)
    np.testing.assert_allclose(along[inner], imu["longitudinal_acceleration"][inner], rtol=0, atol=2e-3)
    np.testing.assert_allclose(across[inner], imu["lateral_acceleration"][inner], rtol=0, atol=2e-3)


def test_drivers_reach_but_do_not_pass_the_lateral_acceleration_of_the_campaign(driven):
    vehicle, motion = driven
    at_cg = dataclasses.replace(vehicle, imu_position=(0.0, 0.0, 0.0))
    largest = np.max(np.abs(imu_signals(at_cg, motion)["lateral_acceleration"](motion.time)))
    assert 3.3 < largest < 4.6


def test_a_driver_knows_the_angle_of_a_steady_bend(truth):
    wheel = steady_wheel_angle(truth.planar, np.array([3.0]), np.array([SPEED]))[0]
    r = steer(truth.planar, np.full(2 * 15_000 + 1, wheel)).states[-1, YAW_RATE]
    assert SPEED * r == pytest.approx(3.0, rel=0.02)


def test_truck_on_two_tracks_holds_the_speed_that_it_is_asked_for(truth, weaving):
    motion = steer(truth.truck, weaving)
    assert np.max(np.abs(motion.states[:, V_X] - SPEED)) < 0.4
