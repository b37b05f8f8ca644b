"""The planar truck with effects, held against the truck without, linear theory, statics and symmetry."""

import dataclasses

import numpy as np
import pytest
from generator.injected import Injected
from generator.injected_motion import (
    FORCE_F,
    FORCE_R,
    GRIP,
    INPUTS,
    PULL,
    ROLL,
    SLOSHED,
    SPEED,
    STEER,
    STEER_RATE_IN,
    STIFFNESS,
    TRAILER_CG,
    TURN,
    V_Y,
    axle_force,
    simulate_truck,
)
from generator.vehicle import GRAVITY, STEP, magic_formula, simulate
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import fsolve

POSE = np.array([3.0, -2.0, 0.4])
V = 11.0


def half_steps(duration: float) -> np.ndarray:
    return STEP / 2.0 * np.arange(2 * round(duration / STEP) + 1)


def inputs(time: np.ndarray, steer: np.ndarray, speed: float = V) -> np.ndarray:
    made = np.zeros((len(time), INPUTS))
    made[:, STEER], made[:, STEER_RATE_IN] = steer, np.gradient(steer, time)
    made[:, SPEED], made[:, GRIP], made[:, STIFFNESS] = speed, 1.0, 1.0
    return made


def drive(truck, steer, *injected, speed=V):
    """Driven with a road-wheel angle as a function of time."""
    time = half_steps(12.0)
    return simulate_truck(truck, injected, time, inputs(time, steer(time), speed), POSE)


def weave(time: np.ndarray) -> np.ndarray:
    return 0.11 * np.sin(1.7 * time) * (1.0 - np.exp(-time))


def settled(truck, angle, *injected, speed=V):
    """The last moment of a long steady turn."""
    time = half_steps(30.0)
    return simulate_truck(truck, injected, time, inputs(time, np.full_like(time, angle), speed), POSE)


def response(signal: np.ndarray, time: np.ndarray, frequency: float) -> complex:
    """Complex amplitude of the last three periods."""
    last = time > time[-1] - 3.0 * 2.0 * np.pi / frequency
    basis = np.column_stack([np.sin(frequency * time[last]), np.cos(frequency * time[last])])
    (sine, cosine), *_ = np.linalg.lstsq(basis, signal[last], rcond=None)
    return complex(sine, cosine)


@pytest.fixture
def truck(truth):
    return truth.planar


def test_without_effects_it_is_the_truck_of_the_sample_logs(truck):
    time = half_steps(12.0)
    road = weave(time)
    wheel = truck.steering_ratio * road
    plain = simulate(
        truck, np.array([V, 0, 0, *POSE]), 0.0, np.column_stack([wheel, np.full_like(wheel, V), 0 * wheel])
    )
    driven = drive(truck, weave)
    assert_allclose(driven.states[:, :5], plain.states[:, [1, 2, 3, 4, 5]], rtol=0, atol=1e-11)
    assert_allclose(driven.across_rate, plain.rates[:, 1], rtol=0, atol=1e-10)


NOTHING = [
    Injected("compliance_lag", {"compliance": 0.0}),
    Injected("rear_axle_steer", {"ratio": 0.0}),
    Injected("tyre_relaxation", {"length": 0.0}),
    Injected("load_transfer", {"sensitivity": 0.0}),
    Injected("combined_slip", {"strength": 0.0}),
    Injected("quadratic_yaw_damping", {"coefficient": 0.0}),
    Injected("sideslip_moment", {"coefficient": 0.0}),
    Injected("speed_moment", {"coefficient": 0.0}),
    Injected("steer_rate_moment", {"coefficient": 0.0}),
    Injected("tandem_scrub", {"moment": 0.0}),
    Injected("crosswind", {"force": 0.0}),
    Injected("road_bank", {"angle": 0.0}),
    Injected("local_bank", {"angle": 0.0}),
    Injected("trailer", {"mass": 0.0}),
    Injected("slosh", {"mass": 0.0}),
    Injected("roll_steer", {"coefficient": 0.0}),
]


@pytest.mark.parametrize("nothing", NOTHING, ids=lambda one: one.name)
def test_an_effect_of_no_size_is_none(truck, nothing):
    plain, changed = drive(truck, weave), drive(truck, weave, nothing)
    assert_array_equal(changed.states[:, [V_Y, TURN]], plain.states[:, [V_Y, TURN]])
    assert_array_equal(changed.felt, plain.felt)


SYMMETRIC = [
    "compliance_lag",
    "roll_steer",
    "rear_axle_steer",
    "tyre_relaxation",
    "load_transfer",
    "body_roll",
    "quadratic_yaw_damping",
    "sideslip_moment",
    "steer_rate_moment",
    "tandem_scrub",
    "trailer",
    "slosh",
]


@pytest.mark.parametrize("name", SYMMETRIC)
def test_a_truck_that_is_symmetric_drives_the_mirrored_way(truck, name):
    left, right = (drive(truck, lambda t, s=side: s * weave(t), Injected(name)) for side in (1.0, -1.0))
    assert_array_equal(left.states[:, [V_Y, TURN]], -right.states[:, [V_Y, TURN]])
    assert_array_equal(left.felt, -right.felt)


@pytest.mark.parametrize("name", ["crosswind", "road_bank", "speed_moment"])
def test_what_comes_from_outside_does_not_mirror(truck, name):
    left, right = (drive(truck, lambda t, s=side: s * weave(t), Injected(name)) for side in (1.0, -1.0))
    assert np.max(np.abs(left.states[:, TURN] + right.states[:, TURN])) > 1e-3


def linear_turn(truck, length, frequency):
    """Yaw rate per road-wheel angle of the linear bicycle whose axle forces lag by length / V."""
    body = truck.body
    c_f, c_r = (t.stiffness * t.shape * t.peak for t in (truck.front, truck.rear))
    m, i, a, b = body.mass, body.yaw_inertia, body.cg_to_front_axle, body.cg_to_rear_axle
    s = 1j * frequency
    lag = 1.0 / (1.0 + s * length / V)
    f, r = c_f * lag, c_r * lag
    matrix = np.array(
        [
            [m * s + (f + r) / V, (a * f - b * r) / V + m * V],
            [(a * f - b * r) / V, i * s + (a**2 * f + b**2 * r) / V],
        ]
    )
    return np.linalg.solve(matrix, np.array([f, a * f]))[1]


@pytest.mark.parametrize("frequency", [1.0, 4.0, 9.0])
@pytest.mark.parametrize("length", [0.0, 0.5, 1.2])
def test_relaxed_tyres_answer_a_gentle_sine_as_linear_theory_says(truck, length, frequency):
    time, size = half_steps(25.0), 1e-4
    steer = size * np.sin(frequency * time)
    driven = simulate_truck(
        truck, [Injected("tyre_relaxation", {"length": length})], time, inputs(time, steer), POSE
    )
    found = response(driven.states[:, TURN], driven.time, frequency) / size
    assert found == pytest.approx(linear_turn(truck, length, frequency), rel=2e-5)


def test_a_relaxed_force_lags_by_its_length_over_the_speed_at_low_frequency(truck):
    time, frequency, length = half_steps(60.0), 0.5, 0.6
    steer = 1e-4 * np.sin(frequency * time)
    late, prompt = (
        simulate_truck(truck, effects, time, inputs(time, steer), POSE)
        for effects in ([Injected("tyre_relaxation", {"length": length})], [])
    )
    tend = magic_slip(truck, late, steer[::2])
    phase = np.angle(response(late.states[:, FORCE_F], late.time, frequency)) - np.angle(
        response(tend, late.time, frequency)
    )
    assert -phase / frequency == pytest.approx(length / V, rel=1e-3)
    assert np.all(prompt.states[:, FORCE_F] == 0.0)


def magic_slip(truck, driven, steer):
    slip = steer - np.arctan(
        (driven.states[:, V_Y] + truck.body.cg_to_front_axle * driven.states[:, TURN]) / V
    )
    tyre = truck.front
    return np.array([magic_formula(s, tyre.stiffness, tyre.shape, tyre.peak, tyre.curvature) for s in slip])


def test_axles_relax_by_lengths_of_their_own(truck):
    both = Injected("tyre_relaxation", {"length": 0.4, "length_rear": 0.9})
    driven = drive(truck, weave, both)
    assert np.any(
        driven.states[:, FORCE_R] != drive(truck, weave, Injected("tyre_relaxation")).states[:, FORCE_R]
    )
    assert_allclose(
        settled(truck, 0.05, both).states[-1, TURN], settled(truck, 0.05).states[-1, TURN], rtol=1e-9
    )


@pytest.mark.parametrize("shift", [0.0, 0.2, -0.5])
def test_a_moved_load_costs_an_axle_the_square_of_its_shift(shift):
    sensitivity, slip = 0.45, 1e-6
    unload = sensitivity / (1.0 + sensitivity)
    plain = axle_force(slip, 5.0, 1.3, 4e4, -0.4, 0.0, 0.0)
    moved = axle_force(slip, 5.0, 1.3, 4e4, -0.4, shift, unload)
    assert moved / plain == pytest.approx(1.0 - sensitivity * shift**2, rel=1e-6)


def test_steady_turn_with_moved_loads_is_what_four_wheels_give(truck):
    angle, share, sensitivity = 0.085, 0.35, 0.9
    effect = Injected("load_transfer", {"sensitivity": sensitivity, "front_share": share})
    driven = settled(truck, angle, effect)
    expected = fsolve(lambda x: four_wheels(truck, *x, angle, sensitivity, share), [0.0, 0.2], xtol=1e-13)
    assert_allclose(driven.states[-1, [V_Y, TURN]], expected, rtol=0, atol=1e-8)
    assert driven.felt[-1] > 2.0
    assert abs(settled(truck, angle).states[-1, TURN] / expected[1] - 1.0) > 5e-3


def four_wheels(truck, v_y, r, angle, sensitivity, share):
    """Balance of a steady turn, wheel by wheel, with C = c1 F - c2 F²: zero where it holds."""
    body, across = truck.body, V * r
    wheelbase = body.cg_to_front_axle + body.cg_to_rear_axle
    forces = []
    for tyre, slip, part, other in (
        (truck.front, angle - np.arctan((v_y + body.cg_to_front_axle * r) / V), share, body.cg_to_rear_axle),
        (truck.rear, -np.arctan((v_y - body.cg_to_rear_axle * r) / V), 1.0 - share, body.cg_to_front_axle),
    ):
        load = body.mass * GRAVITY * other / wheelbase / 2.0
        moved = part * body.mass * across * body.cg_height / body.track
        static = tyre.stiffness * tyre.shape * tyre.peak / 2.0
        c2 = sensitivity * static / load**2
        c1 = static / load + c2 * load
        total = 0.0
        for wheel in (load + moved, load - moved):
            top = tyre.peak / 2.0 * wheel / load
            slope = (c1 * wheel - c2 * wheel**2) / (tyre.shape * top)
            x = slope * slip
            total += top * np.sin(tyre.shape * np.arctan(x - tyre.curvature * (x - np.arctan(x))))
        forces.append(total)
    front = forces[0] * np.cos(angle)
    return (
        (front + forces[1]) / body.mass - across,
        (body.cg_to_front_axle * front - body.cg_to_rear_axle * forces[1]) / body.yaw_inertia,
    )


@pytest.mark.parametrize("ratio", [0.3, 1.0, 1.8])
def test_the_body_rolls_as_a_damped_mode(truck, ratio):
    gain, frequency, damping = 0.011, 5.0, 0.25
    roll = Injected("body_roll", {"gain": gain, "frequency": frequency, "damping": damping})
    at = ratio * frequency
    time = half_steps(25.0)
    driven = simulate_truck(truck, [roll], time, inputs(time, 0.01 * np.sin(at * time)), POSE)
    found = response(driven.states[:, ROLL], driven.time, at) / response(driven.felt, driven.time, at)
    expected = gain / (1.0 - ratio**2 + 2j * damping * ratio)
    assert found == pytest.approx(expected, rel=1e-3)


def test_a_steady_left_turn_rolls_the_left_side_up(truck):
    driven = settled(truck, 0.06, Injected("body_roll", {"gain": 0.02}))
    assert driven.states[-1, ROLL] == pytest.approx(0.02 * driven.felt[-1], rel=1e-6)
    assert driven.states[-1, ROLL] > 0.0


def test_gravity_on_a_bank_pulls_and_is_not_felt(truck):
    bank = Injected("road_bank", {"angle": 0.04, "heading": POSE[2]})
    driven = drive(truck, lambda t: 0.0 * t, bank)
    assert driven.across_rate[0] == pytest.approx(-GRAVITY * np.sin(0.04), rel=1e-12)
    assert driven.felt[0] == 0.0
    falling = driven.across_rate + V * driven.states[:, TURN] - driven.felt
    heading = driven.states[:, 4]
    assert_allclose(falling, -GRAVITY * np.sin(0.04 * np.cos(heading - POSE[2])), rtol=0, atol=1e-12)


def test_wind_pushes_to_the_other_side_on_the_way_back(truck):
    wind = Injected("crosswind", {"force": 2000.0, "heading": POSE[2], "arm": 0.5})
    there = drive(truck, lambda t: 0.0 * t, wind)
    time = half_steps(12.0)
    turned = POSE + np.array([0.0, 0.0, np.pi])
    back = simulate_truck(truck, [wind], time, inputs(time, 0.0 * time), turned)
    assert there.felt[0] == pytest.approx(2000.0 / truck.body.mass, rel=1e-9)
    assert there.turn_rate[0] == pytest.approx(1000.0 / truck.body.yaw_inertia, rel=1e-9)
    assert_allclose(there.states[:, TURN], -back.states[:, TURN], rtol=0, atol=1e-9)


def test_a_trailer_leans_on_the_hitch_with_its_share_in_a_steady_turn(truck):
    """Its axle carries a/d of its lateral force, the hitch the rest."""
    mass = 2000.0
    driven = settled(truck, 0.02, Injected("trailer", {"mass": mass, "length": 5.0, "stiffness": 9e4}))
    r, v_y = driven.states[-1, TURN], driven.states[-1, V_Y]
    body = truck.body
    front = magic_at(truck.front, 0.02 - np.arctan((v_y + body.cg_to_front_axle * r) / V)) * np.cos(0.02)
    rear = magic_at(truck.rear, -np.arctan((v_y - body.cg_to_rear_axle * r) / V))
    hitch = driven.felt[-1] * body.mass - front - rear
    assert hitch == pytest.approx(-(1.0 - TRAILER_CG) * mass * driven.felt[-1], rel=1e-3)
    moment = body.cg_to_front_axle * front - body.cg_to_rear_axle * rear
    assert moment == pytest.approx((body.cg_to_rear_axle + 1.2) * hitch, rel=1e-3)


def magic_at(tyre, slip):
    return magic_formula(slip, tyre.stiffness, tyre.shape, tyre.peak, tyre.curvature)


def test_what_sloshes_rests_where_its_spring_holds_it(truck):
    mode = Injected("slosh", {"mass": 2500.0, "frequency": 3.0, "damping": 0.3})
    driven = settled(truck, 0.04, mode)
    assert driven.states[-1, SLOSHED] == pytest.approx(-driven.felt[-1] / 9.0, rel=1e-4)
    assert_allclose(driven.states[-1, TURN], settled(truck, 0.04).states[-1, TURN], rtol=1e-5)


def test_damping_of_the_yaw_is_quadratic(truck):
    coefficient = 5e4
    driven = settled(truck, 0.05, Injected("quadratic_yaw_damping", {"coefficient": coefficient}))
    r, v_y, body = driven.states[-1, TURN], driven.states[-1, V_Y], truck.body
    front = magic_at(truck.front, 0.05 - np.arctan((v_y + body.cg_to_front_axle * r) / V)) * np.cos(0.05)
    rear = magic_at(truck.rear, -np.arctan((v_y - body.cg_to_rear_axle * r) / V))
    moment = body.cg_to_front_axle * front - body.cg_to_rear_axle * rear
    assert moment == pytest.approx(coefficient * r**2, rel=1e-6)


def test_less_friction_lowers_the_peak_and_leaves_the_stiffness(truck):
    time = half_steps(12.0)
    for size, least, most in ((0.004, 0.0, 1e-3), (0.14, 0.02, 0.5)):
        plain = inputs(time, size * np.sin(1.5 * time))
        slippery = plain.copy()
        slippery[:, GRIP] = 0.7
        one, other = (simulate_truck(truck, [], time, table, POSE) for table in (plain, slippery))
        difference = np.max(np.abs(one.felt - other.felt)) / np.max(np.abs(one.felt))
        assert least < difference < most


def test_drive_takes_from_the_rear_axle(truck):
    time = half_steps(4.0)
    pulling = inputs(time, np.full_like(time, 0.06))
    pulling[:, PULL] = 1.5
    slipping = simulate_truck(truck, [Injected("combined_slip", {"strength": 3.0})], time, pulling, POSE)
    plain = simulate_truck(truck, [], time, pulling, POSE)
    assert np.min(slipping.states[:, V_Y]) < np.min(plain.states[:, V_Y]) - 0.01


def test_standing_still_moves_nothing(truck):
    time = half_steps(3.0)
    for effects in ([], [Injected("tyre_relaxation")], [Injected("trailer")]):
        driven = simulate_truck(truck, effects, time, inputs(time, 0.2 * np.sin(time), 0.0), POSE)
        assert_allclose(driven.states[:, [V_Y, TURN]], 0.0, atol=1e-12)


def test_lighter_truck_answers_faster(truck):
    light = dataclasses.replace(truck, body=dataclasses.replace(truck.body, yaw_inertia=3e4))
    heavy, quick = drive(truck, lambda t: 0.02 + 0.0 * t), drive(light, lambda t: 0.02 + 0.0 * t)
    assert quick.states[100, TURN] > heavy.states[100, TURN]
