"""The simulated truck against equations written by hand, limits and mirror images."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from bench_case import BODY, RATIO, STEERING, STIFFNESS, direct, truck
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ident.control.actuation import LOWEST_SPEED
from ident.control.controllers.controller import Command
from ident.control.plant import COLUMNS, Plant, Start, Stretch, steering_angle_for
from ident.control.simulated import effects_of
from ident.control.truck import Truck
from ident.dynamics.blocks import ratio_map
from ident.dynamics.effects import LOAD_TRANSFER
from ident.errors import BadRecipe

M, J, LF, LR = BODY.values()
CF, CR = STIFFNESS.values()
COAST = 0.0


def driven(plant, commands, period=0.05, start=None, seed=0):
    """Drive with one command a period; the whole motion, each time once."""
    ride = plant.begin(start or Start(20.0), seed)
    parts = [ride.advance(command, period * (k + 1)) for k, command in enumerate(commands)]
    times = np.concatenate([parts[0].times, *(part.times[1:] for part in parts[1:])])
    values = {
        name: np.concatenate([parts[0].values[name], *(part.values[name][1:] for part in parts[1:])])
        for name in COLUMNS
    }
    return Stretch(times, values)


def steered(requests, acceleration=COAST):
    return [Command(float(request), acceleration) for request in requests]


def weave(count, period=0.05, size=1.0, frequency=0.4):
    return size * np.sin(2 * np.pi * frequency * period * np.arange(count))


def rates_by_hand(t, x, u, a):
    """Truck of ``bench_case`` with linear tyres; a plain transcription of the equations of the book."""
    v_y, r, psi, _, _, angle, rate, v_x, acc = x
    delta = angle / RATIO
    along, across = (
        v_x * np.cos(delta) + (v_y + LF * r) * np.sin(delta),
        (v_y + LF * r) * np.cos(delta) - v_x * np.sin(delta),
    )
    front = -CF * np.arctan(across / along)
    rear = -CR * np.arctan((v_y - LR * r) / v_x)
    lags = STEERING.time_constant_1 + STEERING.time_constant_2
    product = STEERING.time_constant_1 * STEERING.time_constant_2
    return [
        (front * np.cos(delta) + rear) / M - v_x * r,
        (LF * front * np.cos(delta) - LR * rear) / J,
        r,
        v_x * np.cos(psi) - v_y * np.sin(psi),
        v_x * np.sin(psi) + v_y * np.cos(psi),
        rate,
        (STEERING.gain * u - angle - lags * rate) / product,
        acc,
        (a - acc) / 0.3,
    ]


def test_motion_equals_the_equations_by_hand_with_each_command_at_its_own_time():
    period, count = 0.05, 40
    requests, pedal = weave(count), 0.5 * np.cos(0.3 * np.arange(count))
    plant = Plant(truck("linear"), step=0.005)
    found = driven(plant, [Command(*pair) for pair in zip(requests.tolist(), pedal.tolist(), strict=True)])
    end = period * count
    sent = period * np.arange(count)
    edges = np.unique(np.concatenate([[0.0, end], sent + 0.12, sent + 0.1]))
    edges = edges[edges <= end]
    x = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0, 0.0])
    for first, last in pairwise(edges):
        in_force = [np.flatnonzero(sent + late <= (first + last) / 2) for late in (0.12, 0.1)]
        u = requests[in_force[0][-1]] if in_force[0].size else 0.0
        a = pedal[in_force[1][-1]] if in_force[1].size else 0.0
        x = solve_ivp(rates_by_hand, (first, last), x, args=(u, a), rtol=1e-11, atol=1e-12).y[:, -1]
    names = ("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")
    names = (*names, "steering_angle", "steering_rate", "longitudinal_velocity", "longitudinal_acceleration")
    told = np.array([found.values[name][-1] for name in names])
    np.testing.assert_allclose(told, x, rtol=2e-7, atol=2e-8)
    assert abs(x[4]) > 0.1  # it has moved


def test_without_lags_the_linear_bicycle_answers_as_its_matrix_exponential():
    speed, angle, time = 18.0, 1e-5, 0.6  # so small that the equations are linear
    a = np.array(
        [
            [-(CF + CR) / (M * speed), -(LF * CF - LR * CR) / (M * speed) - speed],
            [-(LF * CF - LR * CR) / (J * speed), -(LF**2 * CF + LR**2 * CR) / (J * speed)],
        ]
    )
    b = np.array([CF / M, LF * CF / J]) * angle
    exact = np.linalg.solve(a, (expm(a * time) - np.eye(2)) @ b)
    found = driven(Plant(direct(), step=0.0025), steered(np.full(12, angle)), start=Start(speed))
    told = [found.values[name][-1] for name in ("lateral_velocity", "yaw_rate")]
    np.testing.assert_allclose(told, exact, rtol=1e-6)


@pytest.mark.parametrize("dead_time", [0.0, 0.0173, 0.05, 0.1237, 0.2])
def test_dead_time_is_exact_at_any_fraction_of_a_step(dead_time):
    size = 0.8
    plant = Plant(truck(dead_time=dead_time), step=0.02)
    found = driven(plant, steered(np.full(12, size)))
    t1, t2 = STEERING.time_constant_1, STEERING.time_constant_2
    since = np.maximum(found.times - dead_time, 0.0)
    decay = (t1 * np.exp(-since / t1) - t2 * np.exp(-since / t2)) / (t1 - t2)
    np.testing.assert_allclose(
        found.values["steering_angle"], STEERING.gain * size * (1 - decay), rtol=0, atol=1e-12
    )
    assert np.min(np.abs(found.times - dead_time)) < 1e-9
    assert np.max(found.values["steering_angle"]) > 0.1


def test_integration_converges_with_order_four_where_the_input_is_smooth():
    commands = steered(weave(24, size=1.2), 0.3)
    names = ("lateral_velocity", "yaw_rate", "position_y")

    def end(step):
        found = driven(Plant(truck("magic_formula", dead_time=0.117), step=step), commands)
        return np.array([found.values[name][-1] for name in names])

    exact = end(0.0005)
    errors = np.array([np.linalg.norm(end(step) - exact) for step in (0.05 / 2, 0.05 / 4, 0.05 / 8)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(orders > 3.6), (errors, orders)
    assert errors[-1] < 1e-6


@pytest.mark.parametrize("speed", [5.0, 15.0, 25.0])
def test_steady_cornering_follows_the_understeer_gradient(speed):
    """r = v δ/(L + K_us v²), K_us = m (l_r C_r - l_f C_f)/(L C_f C_r), for small angles."""
    angle, length = 1e-4, LF + LR
    gradient = M * (LR * CR - LF * CF) / (length * CF * CR)
    found = driven(Plant(direct()), steered(np.full(200, angle)), start=Start(speed))
    expected = speed * angle / (length + gradient * speed**2)
    assert found.values["yaw_rate"][-1] == pytest.approx(expected, rel=1e-5)
    assert found.values["lateral_acceleration"][-1] == pytest.approx(speed * expected, rel=1e-5)


@pytest.mark.parametrize("model", ["kinematic", "linear", "magic_formula"])
def test_a_mirrored_command_gives_the_mirrored_motion(model):
    one = truck(model, rate_limit=2.0, play=0.05, dead_zone=0.02)
    requests = weave(40, size=2.0) + 0.3
    start = Start(18.0, position_y=0.4, heading=0.03)
    other = Start(18.0, position_y=-0.4, heading=-0.03)
    left = driven(Plant(one), steered(requests), start=start)
    right = driven(Plant(one), steered(-requests), start=other)
    for name in ("position_y", "heading", "yaw_rate", "lateral_acceleration", "road_wheel_angle"):
        np.testing.assert_allclose(left.values[name], -right.values[name], atol=1e-10)
    np.testing.assert_allclose(left.values["position_x"], right.values["position_x"], atol=1e-10)


def test_kinematic_truck_drives_the_circle_of_its_geometry():
    angle, speed = 0.1, 5.0
    found = driven(Plant(direct("kinematic")), steered(np.full(40, angle)), start=Start(speed))
    x, y, psi = (found.values[name] for name in ("position_x", "position_y", "heading"))
    rear_x, rear_y = x - LR * np.cos(psi), y - LR * np.sin(psi)
    radius = (LF + LR) / np.tan(angle)
    np.testing.assert_allclose(np.hypot(rear_x + LR, rear_y - radius), radius, rtol=1e-8)
    np.testing.assert_allclose(psi, speed * found.times / radius, atol=5e-8)


def test_at_low_speed_the_bicycle_rolls_like_the_kinematic_one():
    requests = steered(np.full(60, 0.05))
    slow = [driven(Plant(direct(model)), requests, start=Start(0.6)) for model in ("linear", "kinematic")]
    turning = [found.values["yaw_rate"][-1] for found in slow]
    assert turning[0] == pytest.approx(turning[1], rel=1e-3)
    assert np.all(np.isfinite(slow[0].values["lateral_velocity"]))


def test_a_ride_begins_where_it_is_told_and_stays_in_steady_cornering():
    """Relaxed forces and the steering stand at once where they belong: nothing moves at the start."""
    speed, angle = 20.0, 0.01
    relaxed = direct(effects={"tyre_relaxation": {"length": 0.8}})
    settled = driven(Plant(relaxed), steered(np.full(240, angle)), start=Start(speed))
    now = {name: float(settled.values[name][-1]) for name in ("lateral_velocity", "yaw_rate")}
    again = driven(
        Plant(relaxed), steered(np.full(10, angle)), start=Start(speed, road_wheel_angle=angle, **now)
    )
    np.testing.assert_allclose(again.values["yaw_rate"], now["yaw_rate"], rtol=1e-6)
    np.testing.assert_allclose(again.values["lateral_velocity"], now["lateral_velocity"], rtol=1e-6)


def test_road_wheels_follow_the_ratio_table_and_stop_at_their_highest_angle():
    table = np.array([[-8.0, -0.3], [0.0, 0.0], [4.0, 0.25], [8.0, 0.7]])
    one = truck(ratio=table, highest_angle=0.4, gain=1.0)
    found = driven(Plant(one), steered(np.full(60, 7.0)), start=Start(2.0))
    expected = np.minimum(np.interp(found.values["steering_angle"], *table.T), 0.4)
    np.testing.assert_allclose(found.values["road_wheel_angle"], expected, atol=1e-12)
    assert np.max(found.values["road_wheel_angle"]) == pytest.approx(0.4)


def test_steering_offset_is_a_shifted_request_and_roll_is_seen_by_no_controller():
    requests = weave(30, size=0.02)
    shifted = driven(Plant(direct("magic_formula")), steered(requests + 0.004))
    offset = direct("magic_formula", effects={"steering_offset": {"angle": 0.004}})
    start = Start(20.0)
    np.testing.assert_allclose(
        driven(Plant(offset), steered(requests), start=start).values["yaw_rate"],
        shifted.values["yaw_rate"],
        atol=1e-7,
    )
    roll = {"body_roll": {"gain": 0.01, "frequency": 5.0, "damping": 0.3}}
    with_roll = driven(Plant(direct("magic_formula", effects=roll)), steered(requests + 0.004))
    for name in COLUMNS:
        np.testing.assert_array_equal(with_roll.values[name], shifted.values[name])


def test_relaxation_delays_the_force_and_leaves_the_steady_turn():
    requests = steered(np.full(60, 0.03))
    plain = driven(Plant(direct()), requests)
    late = driven(Plant(direct(effects={"tyre_relaxation": {"length": 2.0}})), requests)
    early = plain.times < 0.1
    assert np.max(late.values["yaw_rate"][late.times < 0.1]) < 0.8 * np.max(plain.values["yaw_rate"][early])
    assert late.values["yaw_rate"][-1] == pytest.approx(plain.values["yaw_rate"][-1], rel=2e-3)


def test_parameters_of_effects_are_taken_by_short_and_by_full_names():
    given = {"load_transfer": {"sensitivity": 0.5, "load_transfer.front_share": 0.4}}
    given["road_bank"] = {"bank_cos": 0.02, "bank_sin": 0.0}
    found = {effect.name: own for effect, own in effects_of(truck("magic_formula", effects=given)).items()}
    height = found["load_transfer"].pop("load_transfer.height_over_track")
    assert height == LOAD_TRANSFER.given[0].typical
    assert found == {
        "load_transfer": {"load_transfer.sensitivity": 0.5, "load_transfer.front_share": 0.4},
        "road_bank": {"bank_cos": 0.02, "bank_sin": 0.0},
    }


def test_a_sensor_of_the_steering_that_reads_late_leaves_the_wheels_earlier():
    late = {"sensor_latency steering_angle": {"delay": 0.05}}
    ride = Plant(truck(effects=late, dead_time=0.15)).begin(Start(20.0))
    earlier = Plant(truck(dead_time=0.10)).begin(Start(20.0))
    reads, truth = [], []
    for k in range(12):
        measured = ride.measured()
        reads.append(measured.steering_angle)
        truth.append(earlier.now["steering_angle"])
        for one in (ride, earlier):
            one.advance(Command(0.5, 0.0), 0.05 * (k + 1))
        assert ride.now["road_wheel_angle"] == pytest.approx(earlier.now["road_wheel_angle"], abs=1e-12)
    np.testing.assert_allclose(reads[1:], truth[:-1], atol=1e-12)  # 0.05 s later than it was
    assert reads[-1] > 0.1


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: truck(effects={"crosswind": {"force": 1.0}}), "crosswind cannot be simulated"),
        (lambda: truck(effects={"yaw_moment: r|r|": {"size": 1.0}}), "the effect yaw_moment: r|r| cannot be"),
        (
            lambda: truck(effects={"steering_rate_limit": {"rate": 1.0}}),
            "steering_rate_limit is an effect of",
        ),
        (
            lambda: truck("kinematic", effects={"tyre_relaxation": {"length": 1.0}}),
            "kinematic model cannot be",
        ),
        (lambda: truck(effects={"tyre_relaxation": {"size": 1.0}}), "tyre_relaxation: missing"),
        (lambda: truck(effects={"sensor_bias": {"bias": 1.0}}), "of which signal"),
        (
            lambda: truck(effects={"sensor_latency yaw_rate": {"delay": -0.1}}),
            "latency of yaw_rate is -0.1 s",
        ),
        (lambda: truck(effects={"sensor_latency steering_angle": {"delay": 0.2}}), "at most the dead time"),
        (lambda: truck(gain=0.0), "gain of the simulated truck is 0, need more than 0"),
        (lambda: truck(dead_time=-0.1), "dead_time of the simulated truck is -0.1, need 0 or more"),
        (lambda: truck(ratio=np.array([[0.0, 0.0], [0.0, 1.0]])), "rising steering angle"),
        (lambda: truck("linear", parameters={**truck().parameters, "mass": float("nan")}), "mass of the"),
        (lambda: truck("linear", parameters={"mass": 1.0}), "needs cg_to_front_axle"),
    ],
)
def test_refuses_what_no_truck_is(made, message):
    with pytest.raises(BadRecipe) as found:
        Plant(made()).begin(Start(20.0))
    assert message in str(found.value)
    assert "\n" not in str(found.value)


def test_refuses_an_unknown_model():
    with pytest.raises(BadRecipe, match="no simulation model trailer"):
        Plant(Truck("trailer", {}, STEERING)).begin(Start(5.0))


def test_a_ride_never_stands_and_drives_on():
    brakes = [Command(0.0, -3.0)] * 60 + [Command(0.0, 1.0)] * 40
    found = driven(Plant(truck()), brakes, start=Start(3.0))
    speed = found.values["longitudinal_velocity"]
    assert np.min(speed) == pytest.approx(LOWEST_SPEED)
    assert np.all(np.isfinite(found.values["yaw_rate"]))
    assert speed[-1] > 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_angle_before_the_ratio_map_is_found_from_the_road_wheels(sign):
    table = np.array([[-8.0, -0.3 * sign], [0.0, 0.0], [4.0, 0.25 * sign], [8.0, 0.7 * sign]])
    steering = truck(ratio=table).steering
    for wheel in (-9.0, -8.0, -1.0, 0.0, 3.0, 4.0, 7.0, 8.5):
        road, _ = ratio_map(table, np.array([wheel]))
        assert steering_angle_for(steering, float(road[0])) == pytest.approx(wheel, abs=1e-12)
