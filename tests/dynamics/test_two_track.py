"""Two tracks against the bicycle, equations written out by hand, weight, mirror and the textbook's tandem."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pac2002_published import published
from plane_truck import linear, magic
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve
from two_track_written_out import accelerations, gradient, in_numbers, wheel_loads
from tyre_files import tyre_text
from vehicle_values import KINDS, MOUNTED, TILTED, truck

from ident.dynamics.axle_groups import AxleGroup
from ident.dynamics.bicycle import bicycle
from ident.dynamics.effects import (
    BODY_ROLL,
    LOAD_TRANSFER,
    ROAD_BANK,
    STEERING_OFFSET,
    TYRE_RELAXATION,
    Effect,
)
from ident.dynamics.two_track import FRONT, REAR, TANDEM, two_track, two_track_parameters
from ident.dynamics.tyres import Tyre
from ident.dynamics.tyres.pac2002_axle import pac2002_axle, scaling_of
from ident.dynamics.tyres.pac2002_coefficients import pac2002_from_file
from ident.dynamics.tyres.property_file import parse_property_file

Array = NDArray[np.float64]
Numbers = Callable[[Mapping[str, float]], dict[str, float]]

TAG = AxleGroup("rear", axles=2, lifted=1)
TRIDEM = AxleGroup("rear", axles=3)
STEEL = pac2002_from_file(parse_property_file(tyre_text().encode(), "some.tir"))
TYPICAL = {
    "cg_height": 1.4,
    "front_roll_share": 0.45,
    "ackermann_share": 0.7,
    "load_sensitivity": 0.3,
    "front_track": 2.05,
    "rear_track": 1.85,
    "rear_spacing": 1.35,
    "rear_lift": 0.4,
}
STATE = ("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")
INPUTS = ("road_wheel_angle", "longitudinal_velocity")


@cache
def numbers(
    front: str | Tyre, rear: str | Tyre, effects: tuple[Effect, ...] | None = None, group: AxleGroup = REAR
) -> Numbers:
    chosen = (STEERING_OFFSET, ROAD_BANK) if effects is None else effects
    return in_numbers(two_track(front, rear, chosen, (FRONT, group)))


@cache
def one_track(kind: str) -> Numbers:
    return in_numbers(bicycle(kind, kind))


def drawn(seed: int) -> dict[str, float]:
    """A state and inputs of a lively drive."""
    random = np.random.default_rng(seed)
    sizes = dict(zip((*STATE, INPUTS[0]), (0.7, 0.25, 2.0, 10.0, 10.0, 0.15), strict=True))
    point = {name: float(random.normal(0, size)) for name, size in sizes.items()}
    return point | {"longitudinal_velocity": float(random.uniform(4, 22))}


# --- limits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_without_track_it_is_the_bicycle_though_the_loads_move(kind: str) -> None:
    narrow = {"front_track": 1e-7, "rear_track": 1e-7, "cg_height": 5e-8, "load_sensitivity": 0.0}
    values = truck(kind, MOUNTED, TILTED, TYPICAL, narrow)
    for seed in range(10):
        point = drawn(seed) | values
        point["yaw_rate"] = float(np.clip(point["yaw_rate"], -3.0, 3.0) / point["longitudinal_velocity"])
        ours, theirs = numbers(kind, kind)(point), one_track(kind)(point)
        loads = [ours[f"front_{side}_vertical_force"] for side in ("left", "right")]
        assert loads[0] != pytest.approx(loads[1], rel=1e-3)
        for name, value in theirs.items():
            assert ours[name] == pytest.approx(value, rel=1e-6, abs=1e-6), name


def test_without_height_and_ackermann_two_tracks_differ_from_one_by_their_slip_angles_only() -> None:
    """The outer wheel rolls faster, so its slip angle is smaller; both together are right to first order."""
    values = truck("linear", TYPICAL, {"cg_height": 0.0, "ackermann_share": 0.0})
    point = drawn(0) | {"lateral_velocity": -0.1, "yaw_rate": 0.2, "road_wheel_angle": 0.03} | values
    ours, theirs = numbers("linear", "linear")(point), one_track("linear")(point)
    second_order = (0.2 * 1.0 / point["longitudinal_velocity"]) ** 2
    assert ours["rear_lateral_force"] != pytest.approx(theirs["rear_lateral_force"], rel=1e-8)
    assert ours["rear_lateral_force"] == pytest.approx(theirs["rear_lateral_force"], rel=2 * second_order)


@pytest.mark.parametrize("seed", range(3))
def test_with_full_ackermann_all_wheels_roll_freely_about_one_point_on_the_rear_axle(seed: int) -> None:
    values = truck("linear", TYPICAL, {"ackermann_share": 1.0})
    angle, speed = (0.55, -0.3, 0.1)[seed], 2.5
    turn = speed * math.tan(angle) / (values["cg_to_front_axle"] + values["cg_to_rear_axle"])
    motion = {"yaw_rate": turn, "lateral_velocity": values["cg_to_rear_axle"] * turn}
    point = drawn(seed) | values | motion | {"road_wheel_angle": angle, "longitudinal_velocity": speed}
    read = numbers("linear", "linear")(point)
    assert read["front_lateral_force"] == pytest.approx(0.0, abs=1e-6)
    assert read["rear_lateral_force"] == pytest.approx(0.0, abs=1e-6)
    parallel = numbers("linear", "linear")(point | {"ackermann_share": 0.0})
    assert abs(parallel["d.yaw_rate"]) > 1e-3


# --- equations written out by hand -----------------------------------------------------------------


def varied(seed: int, kind: str) -> dict[str, float]:
    random = np.random.default_rng([seed, 5])
    own = {name: value * random.uniform(0.7, 1.3) for name, value in truck(kind).items()}
    return own | {name: value * random.uniform(0.6, 1.4) for name, value in TYPICAL.items()}


def curves_of(kind: str, p: Mapping[str, float]) -> dict[str, Callable[[float], float]]:
    made = {"linear": linear, "magic_formula": magic}[kind]
    names = ("cornering_stiffness", "peak_force", "shape", "curvature")[: 1 if kind == "linear" else 4]
    return {group: made(*(p[f"{group}.{name}"] for name in names)) for group in ("front", "rear")}


@pytest.mark.parametrize(
    ("group", "axles", "lifted"), [(REAR, 1, None), (TANDEM, 2, None), (TAG, 2, 1), (TRIDEM, 3, None)]
)
@pytest.mark.parametrize("kind", ["linear", "magic_formula"])
def test_accelerations_are_those_of_equations_written_out(
    kind: str, group: AxleGroup, axles: int, lifted: int | None
) -> None:
    model = numbers(kind, kind, (), group)
    for seed in range(25):
        p, point = varied(seed, kind), drawn(seed)
        state, angle, speed = [point[name] for name in STATE], point[INPUTS[0]], point[INPUTS[1]]
        p["rear_lift"] = min(p["rear_lift"], 1.0)
        felt, turning = accelerations(state, angle, speed, p, curves_of(kind, p), (1, axles), lifted)
        ours = model(point | p)
        assert ours["d.lateral_velocity"] == pytest.approx(felt - speed * state[1], rel=1e-9, abs=1e-9)
        assert ours["d.yaw_rate"] == pytest.approx(turning, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_a_drive_is_that_of_equations_written_out_under_another_integrator(seed: int) -> None:
    p = varied(seed, "magic_formula")
    model, curves = numbers("magic_formula", "magic_formula", (), TANDEM), curves_of("magic_formula", p)

    def steered(t: float) -> tuple[float, float]:
        return 0.06 * math.sin(1.9 * t), 12.0 + 2.0 * math.sin(0.5 * t)

    def ours(t: float, x: Array) -> list[float]:
        read = model(p | dict(zip((*STATE, *INPUTS), (*x, *steered(t)), strict=True)))
        return [read[f"d.{name}"] for name in STATE]

    def theirs(t: float, x: Array) -> list[float]:
        angle, speed = steered(t)
        felt, turning = accelerations(x, angle, speed, p, curves, (1, 2))
        cosine, sine = math.cos(x[2]), math.sin(x[2])
        moved = (speed * cosine - x[0] * sine, speed * sine + x[0] * cosine)
        return [felt - speed * x[1], turning, x[1], *moved]

    ends = [
        solve_ivp(rates, (0, 6), np.zeros(5), method=method, rtol=1e-8, atol=1e-10).y[:, -1]
        for rates, method in ((ours, "DOP853"), (theirs, "LSODA"))
    ]
    assert np.abs(ends[1][4]) > 1.0
    assert ends[0] == pytest.approx(ends[1], rel=1e-5, abs=1e-6)


# --- loads ----------------------------------------------------------------------------------------


@given(sideways=st.floats(-20, 20), height=st.floats(0.3, 3), share=st.floats(0, 1), lift=st.floats(0, 1))
@settings(max_examples=60, deadline=None)
def test_wheels_bear_the_weight_and_never_less_than_nothing(
    sideways: float, height: float, share: float, lift: float
) -> None:
    own = {"cg_height": height, "front_roll_share": share, "rear_lift": lift}
    p = truck("linear", TYPICAL, own)
    point = dict.fromkeys(STATE, 0.0) | {"road_wheel_angle": 0.0, "longitudinal_velocity": 10.0}
    read = numbers("linear", "linear", (), TAG)(point | p | {"yaw_rate": sideways / 10.0})
    loads = [value for name, value in read.items() if name.endswith("_vertical_force")]
    assert len(loads) == 6
    assert min(loads) >= -1e-9
    assert sum(loads) == pytest.approx(p["mass"] * 9.81, rel=1e-12)
    assert loads == pytest.approx(wheel_loads(p, (1, 2), 1, sideways), rel=1e-9, abs=1e-6)


def test_until_a_wheel_lifts_the_shift_holds_the_overturning_moment() -> None:
    p = truck("linear", TYPICAL)
    point = drawn(3) | p | {"yaw_rate": 0.2, "longitudinal_velocity": 12.0}
    read = numbers("linear", "linear", (), TANDEM)(point)
    moment = sum(
        value * p[f"{name.split('_')[0]}_track"] / 2 * (1 if "right" in name else -1)
        for name, value in read.items()
        if name.endswith("_vertical_force")
    )
    assert moment == pytest.approx(p["mass"] * 2.4 * p["cg_height"], rel=1e-12)


def test_a_lifted_axle_bears_nothing_pushes_nothing_and_leaves_its_load_to_the_other() -> None:
    p = truck("linear", TYPICAL, {"rear_lift": 1.0})
    read = numbers("linear", "linear", (), TAG)(drawn(4) | p | {"yaw_rate": 0.05})
    assert read["rear_2_left_vertical_force"] == read["rear_2_right_vertical_force"] == 0.0
    l_f, drive = p["cg_to_front_axle"], p["cg_to_rear_axle"] - p["rear_spacing"] / 2
    rear = read["rear_1_left_vertical_force"] + read["rear_1_right_vertical_force"]
    assert rear == pytest.approx(p["mass"] * 9.81 * l_f / (l_f + drive), rel=1e-12)


def test_load_that_moves_costs_the_stiffness_that_the_effect_of_the_bicycle_says() -> None:
    """C = C_0 (1 - s (ΔF_z/F_z)²) of an axle whose wheels have one slip angle."""
    narrow = {"front_track": 1e-7, "rear_track": 1e-7, "cg_height": 6e-8, "ackermann_share": 0.0}
    p = truck("linear", TYPICAL, narrow)
    point = drawn(5) | p | {"yaw_rate": 0.2, "longitudinal_velocity": 15.0, "lateral_velocity": -0.4}
    read, before = numbers("linear", "linear", ())(point), one_track("linear")(point)
    for axle in ("front", "rear"):
        left, right = (read[f"{axle}_{side}_vertical_force"] for side in ("left", "right"))
        shift = (right - left) / (right + left)
        assert shift > 0.3
        expected = before[f"{axle}_lateral_force"] * (1 - p["load_sensitivity"] * shift**2)
        assert read[f"{axle}_lateral_force"] == pytest.approx(expected, rel=1e-6)


def test_the_stiffness_of_a_wheel_stays_at_its_peak_under_more_load() -> None:
    """An axle with the load of two, at the largest sensitivity, still pushes against its slip."""
    p = truck("linear", TYPICAL, {"rear_lift": 1.0, "load_sensitivity": 0.9})
    point = drawn(6) | p | {"yaw_rate": 0.3, "lateral_velocity": -0.5, "longitudinal_velocity": 15.0}
    read = numbers("linear", "linear", (), TAG)(point)
    assert read["rear_slip_angle"] > 0.0
    assert read["rear_lateral_force"] > 0.0


@pytest.mark.parametrize("group", [REAR, TAG])
def test_a_mirrored_state_has_the_mirrored_rates(group: AxleGroup) -> None:
    for tyre in ("brush", pac2002_axle(STEEL, 4)):
        model = numbers(tyre, tyre, (), group)
        scaling = {f"{axle}.{n}": v for axle in ("front", "rear") for n, v in scaling_of(STEEL).items()}
        p = truck("brush", TYPICAL, scaling)
        for seed in range(5):
            point = drawn(seed)
            turned = {name: -value for name, value in point.items()}
            turned |= {name: point[name] for name in ("longitudinal_velocity", "position_x")}
            here, there = model(point | p), model(turned | p)
            for name in ("d.lateral_velocity", "d.yaw_rate", "front_lateral_force"):
                assert there[name] == pytest.approx(-here[name], rel=1e-9, abs=1e-9)
            left, right = here["front_left_vertical_force"], there["front_right_vertical_force"]
            assert left == pytest.approx(right)


# --- tandem ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [2.0, 8.0, 18.0])
def test_a_tandem_turns_as_a_vehicle_of_its_equivalent_wheelbase(speed: float) -> None:
    """Winkler 1998: L_e = L (1 + T/L² (1 + C_r/C_f)), T = (s/2)², beside the understeer of the bicycle."""
    flat = {"cg_height": 0.0, "ackermann_share": 0.0, "front_track": 1e-6, "rear_track": 1e-6}
    p = truck("linear", TYPICAL, flat)
    mass, l_f, l_r, c_f, c_r = (
        p[name]
        for name in (
            "mass",
            "cg_to_front_axle",
            "cg_to_rear_axle",
            "front.cornering_stiffness",
            "rear.cornering_stiffness",
        )
    )
    turn, model = 1e-4, numbers("linear", "linear", (), TANDEM)

    def unbalanced(unknown: Array) -> list[float]:
        values = dict(zip(STATE, (unknown[0] * turn, turn, 0.0, 0.0, 0.0), strict=True))
        read = model(p | values | {"road_wheel_angle": unknown[1] * turn, "longitudinal_velocity": speed})
        return [read["d.lateral_velocity"] / turn, read["d.yaw_rate"] / turn]

    angle = turn * float(fsolve(unbalanced, [0.0, 1.0], xtol=1e-10)[1])
    wheelbase, tandem = l_f + l_r, (p["rear_spacing"] / 2) ** 2
    equivalent = wheelbase * (1 + tandem / wheelbase**2 * (1 + c_r / c_f))
    understeer = mass / wheelbase * (l_r / c_f - l_f / c_r)
    assert angle == pytest.approx(equivalent * turn / speed + understeer * speed * turn, rel=1e-6)
    assert equivalent - wheelbase == pytest.approx(0.224, abs=0.001)


# --- tyres from a file, effects, refusals ---------------------------------------------------------


def test_tyres_from_a_file_take_the_load_of_their_own_wheel() -> None:
    """Each of the dual wheels of a tandem, by the published formula, the left ones mirrored."""
    axles = (pac2002_axle(STEEL, 2), pac2002_axle(STEEL, 8))
    scaling = {f"{axle}.{n}": v for axle in ("front", "rear") for n, v in scaling_of(STEEL).items()}
    p = truck("linear", TYPICAL, scaling)
    point = drawn(8) | {"yaw_rate": 0.15, "longitudinal_velocity": 14.0, "lateral_velocity": -0.5}
    read = numbers(*axles, (), TANDEM)(point | p)
    values, expected, coefficients = point | p, 0.0, dict(STEEL.coefficients)
    for name in ("rear_1", "rear_2"):
        x = -values["cg_to_rear_axle"] + (0.5 if name == "rear_1" else -0.5) * values["rear_spacing"]
        for side, sign in (("left", 1), ("right", -1)):
            along = values["longitudinal_velocity"] - sign * values["rear_track"] / 2 * 0.15
            slip = -math.atan2(values["lateral_velocity"] + x * 0.15, along)
            load = read[f"{name}_{side}_vertical_force"] / 2
            own = STEEL.side in {"symmetric", side}
            turned = 1 if own else -1
            expected += 2 * turned * published(coefficients, load, -turned * slip).fy0
    assert read["rear_lateral_force"] == pytest.approx(expected, rel=1e-9)


def test_a_wheel_of_a_file_that_lifts_has_no_force_and_a_finite_gradient() -> None:
    axle = pac2002_axle(STEEL, 2, free=("LKY",))
    scaling = {f"{end}.{n}": v for end in ("front", "rear") for n, v in scaling_of(STEEL).items()}
    p = truck("linear", TYPICAL, scaling, {"cg_height": 3.0})
    point = drawn(9) | p | {"yaw_rate": 1.5, "longitudinal_velocity": 15.0}
    read = numbers(axle, axle, ())(point)
    assert read["front_left_vertical_force"] == read["rear_left_vertical_force"] == 0.0
    assert all(np.isfinite(value) for value in read.values())
    slopes = gradient(two_track(axle, axle, ()), point)
    assert slopes["d.yaw_rate", "lateral_velocity"] != 0.0
    assert all(np.isfinite(value) for value in slopes.values())


def test_tyres_of_a_file_that_do_not_divide_among_the_wheels_are_refused() -> None:
    with pytest.raises(ValueError, match="6 tyres in the group rear of 2 axles"):
        two_track(pac2002_axle(STEEL, 2), pac2002_axle(STEEL, 6), (), (FRONT, TANDEM))


def test_with_roll_the_loads_follow_the_springs_and_end_where_they_do_without() -> None:
    p = truck(
        "linear", TYPICAL, {"body_roll.gain": 0.012, "body_roll.frequency": 6.0, "body_roll.damping": 0.3}
    )
    model = numbers("linear", "linear", (STEERING_OFFSET, ROAD_BANK, BODY_ROLL))
    point = drawn(10) | p | {"yaw_rate": 0.12, "longitudinal_velocity": 15.0}
    upright = model(point | {"body_roll_angle": 0.0, "body_roll_rate": 0.0})
    assert upright["front_left_vertical_force"] == upright["front_right_vertical_force"]
    leaning = model(point | {"body_roll_angle": 0.012 * 1.8, "body_roll_rate": 0.0})
    steady = numbers("linear", "linear")(point)
    for wheel in ("front_left", "rear_right"):
        name = f"{wheel}_vertical_force"
        assert leaning[name] == pytest.approx(steady[name], rel=1e-12)
    stiff = model(point | {"body_roll.gain": 0.0, "body_roll_angle": 0.0, "body_roll_rate": 0.0})
    assert all(np.isfinite(value) for value in stiff.values())


def test_the_lag_of_tyres_composes_and_load_transfer_comes_only_once() -> None:
    p = truck("linear", TYPICAL, {"tyre_relaxation.length": 0.5})
    forces = {"front_relaxed_force": 11e3, "rear_relaxed_force": 9e3}
    point = drawn(11) | p | forces | {"ackermann_share": 0.0, "road_wheel_angle": 0.0}
    read = numbers("linear", "linear", (TYRE_RELAXATION,))(point)
    assert read["d.lateral_velocity"] == pytest.approx(
        20e3 / p["mass"] - point["longitudinal_velocity"] * point["yaw_rate"], rel=1e-12
    )
    with pytest.raises(ValueError, match=r"load_transfer enters at .*front_axle_force"):
        two_track("linear", "linear", (LOAD_TRANSFER,))


def test_groups_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="need front and rear"):
        two_track("linear", "linear", (), (REAR, FRONT))
    with pytest.raises(ValueError, match="another one has to stay"):
        AxleGroup("rear", axles=1, lifted=0)
    with pytest.raises(ValueError, match="9 axles"):
        AxleGroup("rear", axles=9)


def test_the_parameters_beyond_the_bicycle_are_told_with_their_units() -> None:
    own = {one.name: one.unit for one in two_track_parameters("linear", "linear", (FRONT, TAG))}
    assert own["cg_height"] == own["rear_spacing"] == "m"
    assert own["load_sensitivity"] == own["rear_lift"] == "1"
    axle = pac2002_axle(STEEL)
    assert "load_sensitivity" not in [one.name for one in two_track_parameters(axle, axle)]
