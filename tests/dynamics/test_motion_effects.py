"""Effects of the motion: against a truck integrated by hand, at zero size, mirrored, and in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from effect_truck import EffectTruck, magic
from generator.injected import Injected
from generator.injected_motion import (
    GRIP,
    INPUTS,
    ROLL,
    SPEED,
    STEER,
    STIFFNESS,
    TURN,
    V_Y,
    simulate_truck,
)
from generator.truth import Planar, load_truth
from numpy.typing import NDArray
from vehicle_values import AT_CG, BODY, LEVEL, tyres

from ident.dynamics.bicycle import bicycle
from ident.dynamics.effects import (
    BODY_ROLL,
    LOAD_TRANSFER,
    PROBES,
    ROAD_BANK,
    STEERING_OFFSET,
    STEERING_RATIO_NONLINEARITY,
    TYRE_RELAXATION,
    WHEEL_SPEED_SCALE,
    Effect,
)
from ident.dynamics.effects.tyre_relaxation import LARGEST_DECAY, shortest_length
from ident.dynamics.engine import Engine, compiled
from ident.dynamics.tyres.magic_formula import from_bcde

Array = NDArray[np.float64]

STEP = 0.01
SETTLED = 100  # grid points after which a start that does not fit no longer shows
BASE = (STEERING_OFFSET, ROAD_BANK)
VALUES = BODY | tyres("magic_formula", "magic_formula") | AT_CG | LEVEL
SIGNALS = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")

RELAXED = {"tyre_relaxation.length": 0.6}
SHIFTED = {
    "load_transfer.sensitivity": 0.4,
    "load_transfer.front_share": 0.7,
    "load_transfer.height_over_track": 0.6,
}
LEANING = {"body_roll.gain": 0.012, "body_roll.frequency": 4.4, "body_roll.damping": 0.2}
CURVED = {"steering_ratio_nonlinearity.cubic": 1.5, "steering_ratio_nonlinearity.quadratic": -0.3}
FAST = {"wheel_speed_scale.scale": 0.03}
STATIC = (STEERING_RATIO_NONLINEARITY, *BASE, WHEEL_SPEED_SCALE, LOAD_TRANSFER, BODY_ROLL, PROBES)
ROLLING = (*STATIC, TYRE_RELAXATION)
NONE = {
    "steering_ratio_nonlinearity.cubic": 0.0,
    "steering_ratio_nonlinearity.quadratic": 0.0,
    "wheel_speed_scale.scale": 0.0,
    **SHIFTED,
    "load_transfer.sensitivity": 0.0,
    **LEANING,
    "body_roll.gain": 0.0,
}
TRANSFER = {"sensitivity": 0.4, "front_share": 0.7, "height_over_track": 0.6}
ALL = TRANSFER | {"roll": (0.012, 4.4, 0.2), "ratio": (1.5, -0.3), "scale": 0.03}
CASES: dict[str, tuple[dict[str, float], dict[str, Any]]] = {
    "relaxation": (RELAXED, {"length": 0.6}),
    "load transfer": (SHIFTED, TRANSFER),
    "relaxation and load transfer": (RELAXED | SHIFTED, TRANSFER | {"length": 0.6}),
    "roll": (LEANING, {"roll": (0.012, 4.4, 0.2)}),
    "ratio": (CURVED, {"ratio": (1.5, -0.3)}),
    "wheel speed": (FAST, {"scale": 0.03}),
    "all but relaxation": (SHIFTED | LEANING | CURVED | FAST, ALL),
    "all": (RELAXED | SHIFTED | LEANING | CURVED | FAST, ALL | {"length": 0.6}),
}
EVERY = pytest.mark.parametrize("case", CASES)


def engine_of(*effects: Effect) -> Engine:
    return compiled(bicycle("magic_formula", "magic_formula", effects or BASE))


def of_case(case: str) -> tuple[Engine, dict[str, float]]:
    """A model that has all effects, and the sizes of this case; the others are at zero."""
    values = CASES[case][0]
    return engine_of(*(ROLLING if "tyre_relaxation.length" in values else STATIC)), NONE | values


def wiggle(seconds: float = 12.0, most: float = 0.09, speed: float = 11.0) -> tuple[Array, Array]:
    """Steering that begins at zero, to about 0.35 g, at a speed that varies."""
    time = STEP * np.arange(round(seconds / STEP) + 1)
    angle = most * (0.6 * np.sin(0.9 * time) + 0.4 * np.sin(4.0 * time))
    return angle, speed + 3.0 * np.sin(0.5 * time)


def driven(engine: Engine, angle: Array, speed: Array, values: dict[str, float]) -> dict[str, Array]:
    inputs = np.zeros((angle.size, len(engine.inputs)))
    inputs[:, 0], inputs[:, 1] = angle, speed
    p = engine.vector(VALUES | values)
    steps = np.full(angle.size, STEP)
    starts = np.zeros((1, len(engine.states)))
    outputs = engine.simulate(starts, inputs, steps, [0, angle.size], p, substeps=np.full(angle.size, 2))[1]
    return dict(zip(engine.outputs, outputs.T, strict=True))


@EVERY
def test_a_model_with_effects_moves_as_a_truck_that_was_integrated_by_hand(case: str) -> None:
    engine, values = of_case(case)
    by_hand = CASES[case][1]
    angle, speed = wiggle(6.0)
    found = driven(engine, angle, speed, values)
    expected = EffectTruck(magic(3.3e5), magic(4e5), **by_hand).drive(angle, speed, STEP)
    plain = EffectTruck(magic(3.3e5), magic(4e5)).drive(angle, speed, STEP)
    # Which load the forces of the moment shift is found by one step of Newton's method.
    closed = "sensitivity" in by_hand and "length" not in by_hand
    for name in (*SIGNALS, "roll_angle", "roll_rate"):
        wrong = np.max(np.abs(found[name] - expected[name]))
        effect = np.max(np.abs(expected[name] - plain[name]))
        assert wrong <= (5e-4 * effect if closed else 1e-9 * np.max(np.abs(expected[name]))), name
    assert max(np.max(np.abs(plain[n] - expected[n])) / np.ptp(plain[n]) for n in SIGNALS) > 0.01


@EVERY
def test_mirrored_steering_gives_the_mirrored_motion(case: str) -> None:
    engine, values = of_case(case)
    values = {name: 0.0 if name.endswith("quadratic") else value for name, value in values.items()}
    angle, speed = wiggle(6.0)
    left, right = (driven(engine, way * angle, speed, values) for way in (1, -1))
    for name in SIGNALS:
        sign = 1 if name == "position_x" else -1
        assert right[name] == pytest.approx(sign * left[name], rel=1e-12, abs=1e-12)


def test_size_zero_is_no_effect_to_the_last_digit_and_its_slope_is_there() -> None:
    angle, speed = wiggle(6.0)
    engine = engine_of(*STATIC)
    found, base = driven(engine, angle, speed, NONE), driven(engine_of(), angle, speed, {})
    for name in SIGNALS:
        assert found[name] == pytest.approx(base[name], rel=1e-13, abs=1e-13)
    sizes = [name for name, value in NONE.items() if value == 0]
    count = angle.size
    inputs = np.zeros((count, len(engine.inputs)))
    inputs[:, 0], inputs[:, 1] = angle, speed
    _, _, slopes = engine.sensitivities(
        np.zeros((1, len(engine.states))),
        inputs,
        np.full(count, STEP),
        [0, count],
        engine.vector(VALUES | NONE),
        active=sizes,
    )
    assert np.all(np.isfinite(slopes))
    largest = np.max(np.abs(slopes[:, :, len(engine.states) :]), axis=(0, 1))
    assert dict(zip(sizes, largest > 1e-3, strict=True)) == dict.fromkeys(sizes, True)


# --- relaxation --------------------------------------------------------------------------------------


def test_a_short_relaxation_length_is_hardly_an_effect_and_twice_as_long_is_twice_the_effect() -> None:
    angle, speed = wiggle(6.0)
    engine, base = engine_of(*ROLLING), driven(engine_of(), angle, speed, {})
    least = shortest_length(speed, STEP / 2)
    change = {
        length: driven(engine, angle, speed, NONE | {"tyre_relaxation.length": length})["yaw_rate"][SETTLED:]
        - base["yaw_rate"][SETTLED:]
        for length in (least, 2 * least)
    }
    size = np.max(np.abs(change[least]))
    assert size < 0.02 * np.max(np.abs(base["yaw_rate"]))
    assert np.max(np.abs(change[2 * least] - 2 * change[least])) < 0.1 * size


@pytest.mark.parametrize("speed", [5.0, 15.0])
def test_the_force_lags_behind_the_static_one_by_length_over_speed(speed: float) -> None:
    length, frequency = 0.5, 2 * math.pi * 0.5
    time = STEP * np.arange(1601)
    angle = 0.02 * np.sin(frequency * time)
    drive = driven(
        engine_of(*ROLLING),
        angle,
        np.full(time.size, speed),
        NONE | {"tyre_relaxation.length": length},
    )
    whole = slice(800, 1600)
    turn = np.exp(-1j * frequency * time[whole])
    for axle in ("front", "rear"):
        static = np.sum(drive[f"{axle}_static_force"][whole] * turn)
        force = np.sum(drive[f"{axle}_lateral_force"][whole] * turn)
        lag = -np.angle(force / static)
        assert lag == pytest.approx(math.atan(frequency * length / speed), rel=2e-3)


def test_the_shortest_length_is_where_a_step_of_the_grid_is_still_right() -> None:
    speed, step = 20.0, 0.02
    length = shortest_length([-speed, 3.0], step)
    assert length == pytest.approx(speed * step / LARGEST_DECAY)
    decay = speed * step / length
    taken = 1 - decay + decay**2 / 2 - decay**3 / 6 + decay**4 / 24
    assert taken == pytest.approx(math.exp(-decay), rel=0.025)
    assert shortest_length([], step) == pytest.approx(step / LARGEST_DECAY)


# --- load transfer -----------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_load_transfer_changes_the_understeer_by_where_the_load_is_shifted(share: float) -> None:
    speed, angle = np.full(4000, 10.0), np.full(4000, 0.06)
    values = NONE | SHIFTED | {"load_transfer.front_share": share}
    turned = driven(engine_of(*STATIC), angle, speed, values)["yaw_rate"][-1]
    base = driven(engine_of(), angle, speed, {})["yaw_rate"][-1]
    assert (turned < base) == (share > 0.5) or share == 0.5
    assert abs(turned / base - 1) > 0.003 or share == 0.5


def test_no_more_than_the_sensitivity_is_lost_where_the_inner_wheels_lift() -> None:
    """Stiffness, that is: friction stays as it is."""
    values = NONE | SHIFTED | {"load_transfer.height_over_track": 1.4, "load_transfer.front_share": 1.0}
    angle, speed = np.full(800, 0.2), np.full(800, 10.0)
    drive = driven(engine_of(*STATIC), angle, speed, values)
    slip = drive["front_slip_angle"][-1]
    assert drive["front_static_force"][-1] == pytest.approx(magic(3.3e5)(0.6 * slip), rel=1e-9)


# --- roll --------------------------------------------------------------------------------------------


def test_a_steady_turn_leans_by_the_gain_and_gravity_adds_to_the_accelerometer() -> None:
    angle, speed = np.full(4000, 0.03), np.full(4000, 10.0)
    drive = driven(engine_of(*STATIC), angle, speed, NONE | LEANING)
    felt = driven(engine_of(), angle, speed, {})["lateral_acceleration"][-1]
    assert felt > 0.5
    assert drive["roll_angle"][-1] == pytest.approx(0.012 * felt, rel=1e-6)
    assert drive["lateral_acceleration"][-1] == pytest.approx(felt + 9.81 * math.sin(0.012 * felt), rel=1e-6)


def test_the_roll_rings_at_its_frequency() -> None:
    time = STEP * np.arange(1501)
    angle = np.where(time < 1.0, 0.0, 0.03)
    values = NONE | LEANING | {"body_roll.frequency": 6.0, "body_roll.damping": 0.05}
    drive = driven(engine_of(*STATIC), angle, np.full(time.size, 10.0), values)
    swing = drive["roll_angle"][600:] - drive["roll_angle"][-1]
    crossings = np.flatnonzero(np.diff(np.sign(swing)))[:8]
    period = 2 * np.mean(np.diff(crossings)) * STEP
    assert 2 * math.pi / period == pytest.approx(6.0, rel=0.02)


# --- probes ------------------------------------------------------------------------------------------


def test_the_accelerometer_feels_the_wind_and_not_the_bank() -> None:
    engine = engine_of(*STATIC)
    inputs = np.zeros((800, len(engine.inputs)))
    inputs[:, 1] = 12.0
    for probe, by_hand in (("probe.lateral_force", {"push": 900.0}), ("probe.bank_force", {"tilt": 900.0})):
        pushed = inputs.copy()
        pushed[:, engine.inputs.index(probe)] = 900.0
        outputs = engine.simulate(
            np.zeros((1, 7)), pushed, np.full(800, STEP), [0, 800], engine.vector(VALUES | NONE)
        )[1]
        truck = EffectTruck(magic(3.3e5), magic(4e5), **by_hand)
        expected = truck.drive(np.zeros(800), np.full(800, 12.0), STEP)
        for name in SIGNALS:
            found = outputs[:, engine.outputs.index(name)]
            assert np.max(np.abs(found - expected[name])) < 1e-7 * max(1.0, np.max(np.abs(expected[name])))


def test_what_a_probe_carries_to_the_outputs_is_what_a_small_push_does() -> None:
    engine = engine_of(*ROLLING)
    angle, speed = wiggle(6.0)
    count = angle.size
    inputs = np.zeros((count, len(engine.inputs)))
    inputs[:, 0], inputs[:, 1] = angle, speed
    p = engine.vector(VALUES | NONE | LEANING | RELAXED)
    rest = (np.full(count, STEP), [0, count], p)
    names = [name for name in engine.inputs if name.startswith("probe.")]
    shape = np.sin(0.02 * np.arange(count)) ** 3
    sizes = [1e-5 if name.endswith("angle") else 1.0 for name in names]
    chain = np.zeros((count, len(engine.inputs), len(names)))
    for column, name in enumerate(names):
        chain[:, engine.inputs.index(name), column] = shape
    starts = np.zeros((1, 9))
    carried = engine.sensitivities(starts, inputs, *rest, active=names, input_derivatives=chain)[2]
    for column, (name, size) in enumerate(zip(names, sizes, strict=True)):
        pushed = [inputs.copy(), inputs.copy()]
        for one, way in zip(pushed, (1, -1), strict=True):
            one[:, engine.inputs.index(name)] += way * size * shape
        up, down = (engine.simulate(starts, one, *rest)[1] for one in pushed)
        difference = (up - down) / (2 * size)
        largest = np.max(np.abs(difference), axis=0)
        wrong = np.max(np.abs(carried[:, :, 9 + column].T - difference), axis=0)
        assert np.all(wrong <= 1e-4 * largest + 1e-9), name


# --- the truck of the undeclared runs ----------------------------------------------------------------

INJECTED: dict[str, tuple[dict[str, float], dict[str, float], float]] = {
    # name -> what is injected, the same for the model, largest difference as a share of the effect
    "tyre_relaxation": ({"length": 0.5}, {"tyre_relaxation.length": 0.5}, 1e-5),
    "body_roll": (
        {"gain": 0.011, "frequency": 5.0, "damping": 0.25},
        {"body_roll.gain": 0.011, "body_roll.frequency": 5.0, "body_roll.damping": 0.25},
        1e-5,
    ),
    "load_transfer": (
        {"sensitivity": 0.45, "front_share": 0.4},
        {"load_transfer.sensitivity": 0.45, "load_transfer.front_share": 0.4},
        2e-3,  # a_y goes by one step of Newton's method
    ),
}


def of_truck(truth: Planar) -> dict[str, float]:
    body = {name: getattr(truth.body, name) for name in BODY}
    axles = {"front": truth.front, "rear": truth.rear}
    tyres_of = {
        f"{axle}.{name}": value
        for axle, one in axles.items()
        for name, value in from_bcde(one.stiffness, one.shape, one.peak, one.curvature).items()
    }
    return body | tyres_of | {"load_transfer.height_over_track": truth.body.cg_height / truth.body.track}


@pytest.mark.parametrize("name", INJECTED)
def test_an_effect_is_what_the_truck_of_the_undeclared_runs_has(name: str) -> None:
    truth = load_truth().planar
    injected, values, share = INJECTED[name]
    own = of_truck(truth)
    angle, speed = wiggle(6.0, most=0.07)
    half = 0.5e-3 * np.arange(2 * round(6.0 / 1e-3) + 1)
    given = np.zeros((half.size, INPUTS))
    given[:, STEER] = np.interp(half, STEP * np.arange(angle.size), angle)
    given[:, SPEED] = np.interp(half, STEP * np.arange(angle.size), speed)
    given[:, [GRIP, STIFFNESS]] = 1.0
    after, before = (
        simulate_truck(truth, effects, half, given, np.zeros(3))
        for effects in ([Injected(name, injected)], [])
    )
    engine = engine_of(*(ROLLING if name == "tyre_relaxation" else STATIC))
    found = driven(engine, angle, speed, NONE | own | values)
    base = driven(engine_of(), angle, speed, {n: v for n, v in own.items() if "." not in n or n in VALUES})
    for signal, of in {
        "yaw_rate": lambda one: one.states[:, TURN],
        "lateral_velocity": lambda one: one.states[:, V_Y],
        "lateral_acceleration": lambda one: one.felt + 9.81 * np.sin(one.states[:, ROLL]),
    }.items():
        truth_change = of(after)[::10] - of(before)[::10]
        change = found[signal] - base[signal]
        size = np.max(np.abs(truth_change))
        assert np.max(np.abs(change - truth_change)) <= share * size + 1e-7, signal
    assert np.max(np.abs(after.felt + 9.81 * after.states[:, ROLL] - before.felt)) > 0.02
