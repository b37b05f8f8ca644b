"""Effects at first order: what the probes carry to the outputs is what a small effect does in the model."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from vehicle_values import AT_CG, BODY, LEVEL, tyres

from ident.dynamics.bicycle import bicycle
from ident.dynamics.blocks import lagged, oscillating, play
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
from ident.dynamics.effects.first_order import (
    FRONT_SHARES,
    PLAY_WIDTHS,
    ROLL_DAMPINGS,
    ROLL_FREQUENCIES,
    ShapeColumns,
    Trajectory,
    first_order,
    relaxation_of_length,
    trajectory_of,
)
from ident.dynamics.engine import Engine, compiled

Array = NDArray[np.float64]

STEP = 0.01
BASE = (STEERING_OFFSET, ROAD_BANK, PROBES)
EVERYTHING = (
    STEERING_RATIO_NONLINEARITY,
    STEERING_OFFSET,
    ROAD_BANK,
    WHEEL_SPEED_SCALE,
    LOAD_TRANSFER,
    BODY_ROLL,
    PROBES,
)
VALUES = BODY | tyres("magic_formula", "magic_formula") | AT_CG | LEVEL | {"imu_x": 0.6, "imu_y": 0.1}
NONE = {
    "steering_ratio_nonlinearity.cubic": 0.0,
    "steering_ratio_nonlinearity.quadratic": 0.0,
    "wheel_speed_scale.scale": 0.0,
    "load_transfer.sensitivity": 0.0,
    "load_transfer.front_share": FRONT_SHARES[1],
    "load_transfer.height_over_track": 0.7,
    "body_roll.gain": 0.0,
    "body_roll.frequency": ROLL_FREQUENCIES[1],
    "body_roll.damping": ROLL_DAMPINGS[0],
}
OFFSETS = np.array([0, 500, 1200])


def engine_of(*effects: Effect) -> Engine:
    return compiled(bicycle("magic_formula", "magic_formula", effects))


def drive() -> tuple[Array, Array]:
    """Inputs and steps of two segments."""
    time = STEP * np.arange(OFFSETS[-1])
    angle = 0.05 * np.sin(0.9 * time) + 0.03 * np.sin(4.0 * time)
    speed = 11.0 + 3.0 * np.sin(0.5 * time)
    return np.stack([angle, speed], axis=1), np.full(time.size, STEP)


def padded(engine: Engine, inputs: Array) -> Array:
    return np.pad(inputs, ((0, 0), (0, len(engine.inputs) - 2)))


def outputs_of(engine: Engine, inputs: Array, values: dict[str, float], starts: Array | None = None) -> Array:
    if starts is None:
        starts = np.zeros((2, len(engine.states)))
    steps = np.full(OFFSETS[-1], STEP)
    p = engine.vector(VALUES | values)
    return engine.simulate(starts, padded(engine, inputs), steps, OFFSETS, p)[1]


def nominal() -> tuple[Engine, Trajectory]:
    engine = engine_of(*BASE)
    inputs, steps = drive()
    given = BODY | {"load_transfer.height_over_track": 0.7}
    outputs = outputs_of(engine, inputs, {})
    return engine, trajectory_of(engine, padded(engine, inputs), outputs, steps, OFFSETS, given)


def carried(engine: Engine, shape: ShapeColumns) -> dict[str, Array]:
    """Output -> (N, d) what the columns of a shape do to it."""
    inputs, steps = drive()
    inputs = padded(engine, inputs)
    count = len(shape.free)
    chain = np.zeros((*inputs.shape, count))
    for name, columns in shape.inputs.items():
        chain[:, engine.inputs.index(name)] += columns
    found = engine.sensitivities(
        np.zeros((2, 5)),
        inputs,
        steps,
        OFFSETS,
        engine.vector(VALUES),
        active=[f"unit {column}" for column in range(count)],
        input_derivatives=chain,
    )[2]
    made = {name: found[row, :, 5:] for row, name in enumerate(engine.outputs)}
    return {name: columns + shape.signals.get(name, 0.0) for name, columns in made.items()}


def assert_alike(found: dict[str, Array], expected: dict[str, Array], share: float) -> None:
    """Every output to a share of what the effect does to it."""
    for name, values in expected.items():
        size = np.max(np.abs(values))
        assert np.max(np.abs(found[name] - values)) <= share * size + 1e-9, name


# A column of the shape, and the parameter of the model that it is of, with a small size.
SMOOTH = {
    "steering_offset": ("steering_offset", 0, 1e-6),
    "steering_ratio_nonlinearity": ("steering_ratio_nonlinearity.cubic", 0, 1e-4),
    "steering_ratio_nonlinearity, quadratic": ("steering_ratio_nonlinearity.quadratic", 1, 1e-4),
    "road_bank": ("bank_sin", 1, 1e-6),
    "wheel_speed_scale": ("wheel_speed_scale.scale", 0, 1e-5),
    "load_transfer": ("load_transfer.sensitivity", 0, 1e-4),
}


@pytest.mark.parametrize("case", SMOOTH)
def test_a_small_effect_does_what_its_column_says(case: str) -> None:
    engine, along = nominal()
    parameter, column, size = SMOOTH[case]
    shapes = first_order(case.partition(",")[0], along)
    shape = shapes[1] if case == "load_transfer" else shapes[0]
    extended = engine_of(*EVERYTHING)
    inputs, _ = drive()
    up, down = (outputs_of(extended, inputs, NONE | {parameter: way * size}) for way in (1, -1))
    difference = dict(zip(extended.outputs, ((up - down) / (2 * size)).T, strict=True))
    found = {name: columns[:, column] for name, columns in carried(engine, shape).items()}
    signals = {
        name: difference[name] for name in ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading")
    }
    # Columns run linearly between grid points, the effect itself does not quite.
    assert_alike(found, signals, 2e-3)


def test_load_transfer_has_a_shape_for_each_way_to_share_the_load() -> None:
    _, along = nominal()
    shapes = first_order("load_transfer", along)
    assert [shape.at["front_share"] for shape in shapes] == list(FRONT_SHARES)
    assert {shape.free for shape in shapes} == {("sensitivity",)}
    first, last = (np.abs(shape.inputs["probe.front_slip_angle"]).max() for shape in (shapes[0], shapes[-1]))
    assert last / first == pytest.approx((FRONT_SHARES[-1] / FRONT_SHARES[0]) ** 2)


def test_a_bias_and_a_late_sensor_change_their_own_signal_only() -> None:
    engine, along = nominal()
    (bias,) = first_order("sensor_bias lateral_acceleration", along)
    assert bias.inputs == {}
    assert bias.signals.keys() == {"lateral_acceleration"}
    assert np.all(bias.signals["lateral_acceleration"] == 1.0)
    (late,) = first_order("sensor_latency yaw_rate", along)
    values = outputs_of(engine, drive()[0], {})[:, engine.outputs.index("yaw_rate")]
    time = STEP * np.arange(500)
    moved = (np.interp(time - 2e-3, time, values[:500]) - values[:500]) / 2e-3
    column = late.signals["yaw_rate"][:500, 0]
    assert np.max(np.abs(moved - column)[20:]) < 0.02 * np.max(np.abs(column))
    assert late.signals["yaw_rate"][500, 0] == pytest.approx(-(values[501] - values[500]) / STEP)


def test_a_relaxing_tyre_does_what_the_shape_of_its_length_says() -> None:
    engine, along = nominal()
    length = 0.3
    relaxed = engine_of(STEERING_OFFSET, ROAD_BANK, PROBES, TYRE_RELAXATION)
    inputs, _ = drive()
    base = outputs_of(engine, inputs, {})
    starts = np.zeros((2, 7))
    for column, axle in ((5, "front"), (6, "rear")):
        starts[:, column] = base[OFFSETS[:-1], engine.outputs.index(f"{axle}_static_force")]
    after = outputs_of(relaxed, inputs, {"tyre_relaxation.length": length}, starts)
    found = carried(engine, relaxation_of_length(along, length))
    for name in ("yaw_rate", "lateral_velocity", "lateral_acceleration"):
        change = after[:, relaxed.outputs.index(name)] - base[:, engine.outputs.index(name)]
        told = length * found[name][:, 0]
        assert np.corrcoef(told, change)[0, 1] > 0.995
        assert np.std(told) == pytest.approx(np.std(change), rel=0.1)
    half = relaxation_of_length(along, length / 8)
    force = along.values["front_static_force"]
    slope = -np.gradient(force[:500], STEP) / along.values["longitudinal_velocity"][:500]
    column = half.inputs["probe.front_lateral_force"][50:450, 0]
    assert column == pytest.approx(slope[50:450], abs=0.03 * np.max(np.abs(slope)))


def test_a_leaning_body_does_what_the_shape_of_its_mode_says() -> None:
    engine, along = nominal()
    shapes = first_order("body_roll", along)
    assert len(shapes) == len(ROLL_FREQUENCIES) * len(ROLL_DAMPINGS)
    place = [shape.at for shape in shapes].index(
        {"frequency": ROLL_FREQUENCIES[1], "damping": ROLL_DAMPINGS[0]}
    )
    extended = engine_of(*EVERYTHING)
    inputs, _ = drive()
    felt = along.values["felt_acceleration"]
    gain = 1e-4
    starts = np.zeros((2, 7))
    starts[:, extended.states.index("body_roll_angle")] = gain * felt[OFFSETS[:-1]]
    leaning = outputs_of(extended, inputs, NONE | {"body_roll.gain": gain}, starts)
    level = outputs_of(extended, inputs, NONE)
    change = ((leaning - level) / gain)[:, extended.outputs.index("lateral_acceleration")]
    found = carried(engine, shapes[place])
    assert found["lateral_acceleration"][:, 0] == pytest.approx(change, abs=1e-4 * np.max(np.abs(change)))
    assert np.all(found["yaw_rate"] == 0)


def test_a_linkage_with_play_does_what_the_shape_of_its_width_says() -> None:
    engine, along = nominal()
    shapes = first_order("steering_linkage_play", along)
    assert [shape.at["width"] for shape in shapes] == list(PLAY_WIDTHS)
    inputs, _ = drive()
    shape = shapes[1]
    width = shape.at["width"]
    loose = inputs.copy()
    for first, last in ((0, 500), (500, 1200)):
        loose[first:last, 0] = play(inputs[first:last, 0], width)[0]
    change = outputs_of(engine, loose, {}) - outputs_of(engine, inputs, {})
    found = carried(engine, shape)
    for name in ("yaw_rate", "lateral_acceleration"):
        values = change[:, engine.outputs.index(name)]
        assert width * found[name][:, 0] == pytest.approx(values, abs=0.02 * np.max(np.abs(values)))


def test_what_acts_on_the_truck_mirrored_is_mirrored() -> None:
    _, along = nominal()
    values = {
        name: -part if name not in ("longitudinal_velocity", "position_x") else part
        for name, part in along.values.items()
    }
    mirrored = Trajectory(values, along.steps, along.offsets, along.parameters)
    for key in ("tyre_relaxation", "load_transfer", "body_roll", "steering_linkage_play"):
        for left, right in zip(first_order(key, along), first_order(key, mirrored), strict=True):
            for name, columns in (left.inputs | left.signals).items():
                assert (right.inputs | right.signals)[name] == pytest.approx(-columns, rel=1e-12, abs=1e-12)


def test_refuses_what_it_has_no_form_for() -> None:
    _, along = nominal()
    with pytest.raises(KeyError, match="slosh"):
        first_order("slosh", along)


# --- the filters -------------------------------------------------------------------------------------


def test_a_lag_with_a_constant_rate_is_exact_on_a_ramp() -> None:
    time = 0.1 * np.arange(50)
    rate = 3.0
    found = lagged(2.0 * time, np.full(50, rate), np.full(50, 0.1), np.array([0, 50]))
    assert found == pytest.approx(2.0 * (time - (1 - np.exp(-rate * time)) / rate), abs=1e-12)


def test_a_lag_begins_anew_in_each_segment() -> None:
    values = np.concatenate([np.zeros(20), np.full(20, 5.0)])
    found = lagged(values, np.full(40, 2.0), np.full(40, 0.1), np.array([0, 20, 40]))
    assert found == pytest.approx(values)


def test_an_oscillator_settles_at_its_input_with_its_frequency() -> None:
    time = 0.01 * np.arange(1000)
    values = np.where(time < 0.005, 0.0, 1.0)
    found = oscillating(values, 5.0, 0.2, np.full(1000, 0.01), np.array([0, 1000]))
    damped = 5.0 * np.sqrt(1 - 0.2**2)
    late = time - 0.005
    expected = 1 - np.exp(-late) * (np.cos(damped * late) + 0.2 / np.sqrt(1 - 0.04) * np.sin(damped * late))
    # The step takes one interval of the grid, which is (h ω)²/24 = 1e-4 wrong at first.
    assert found[1:] == pytest.approx(expected[1:], abs=1.2e-4)
