"""Effects: each changes its port and all that follows; several compose; what does not fit is refused."""

from __future__ import annotations

import numpy as np
import pytest
import sympy
from vehicle_values import AT_CG, BODY, segments, tyres

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
    sensor_bias,
)
from ident.dynamics.effects.sensor_bias import SIZES
from ident.dynamics.kinematic import kinematic
from ident.dynamics.longitudinal import driven_bicycle
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol
from ident.dynamics.system import System

COMPLIANCE = Effect(
    "compliance_steer",
    "G",
    (Parameter("compliance", "rad/N", 0.0, 1e-5, 5e-7, "steer of the wheels per axle force"),),
    {
        "front_slip_angle": lambda slip, known: (
            slip / (1 + symbol("compliance") * known["front.cornering_stiffness"])
        )
    },
)
WIND = Effect(
    "crosswind",
    "Y",
    tuple(Parameter(name, "N", -1e4, 1e4, 2e3, name) for name in ("wind_force", "wind_moment")),
    {
        "felt_force": lambda force, _: force + symbol("wind_force"),
        "yaw_moment": lambda moment, _: moment + symbol("wind_moment"),
    },
)


def evaluated(system: System, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Rates and outputs of a model at some points, without compiling it."""
    starts, inputs, _, _ = segments(5, [1] * 6, 0.5)
    found: dict[str, list[float]] = {}
    for state, entry in zip(starts, inputs, strict=True):
        at = (
            dict(zip(system.states, state, strict=True))
            | dict(zip(system.inputs, entry, strict=True))
            | values
        )
        known = {symbol(name): sympy.Float(value) for name, value in at.items()}
        for name, expression in system.intermediates.items():
            known[symbol(name)] = sympy.sympify(expression).xreplace(known)
        for group, expressions in (("rate", system.states), ("output", system.outputs)):
            for name, expression in expressions.items():
                value = float(sympy.sympify(expression).xreplace(known))
                found.setdefault(f"{group} {name}", []).append(value)
    return {name: np.array(values) for name, values in found.items()}


VALUES = BODY | tyres("linear", "linear") | AT_CG


def test_a_model_has_the_parameters_of_its_effects_and_of_no_others() -> None:
    assert bicycle("linear", "linear").parameters[-3:] == ("steering_offset", "bank_cos", "bank_sin")
    bare = bicycle("linear", "linear", effects=()).parameters
    assert not {"steering_offset", "bank_cos", "bank_sin"} & set(bare)
    assert bicycle("linear", "linear", effects=(ROAD_BANK,)).parameters == (*bare, "bank_cos", "bank_sin")


@pytest.mark.parametrize("effect", [STEERING_OFFSET, ROAD_BANK, COMPLIANCE, WIND], ids=lambda e: e.name)
def test_an_effect_of_size_zero_changes_nothing(effect: Effect) -> None:
    with_it = evaluated(
        bicycle("linear", "linear", effects=(effect,)), VALUES | dict.fromkeys(effect.names, 0.0)
    )
    without = evaluated(bicycle("linear", "linear", effects=()), VALUES)
    assert with_it.keys() == without.keys()
    for name in without:
        assert with_it[name] == pytest.approx(without[name], rel=1e-12, abs=1e-12)


def test_compliance_acts_as_a_softer_axle() -> None:
    soft = bicycle("linear", "linear", effects=(COMPLIANCE,))
    compliance, stiffness = 5e-7, VALUES["front.cornering_stiffness"]
    found = evaluated(soft, VALUES | {"compliance": compliance})
    softer = VALUES | {"front.cornering_stiffness": stiffness / (1 + compliance * stiffness)}
    expected = evaluated(bicycle("linear", "linear", effects=()), softer)
    for name in expected.keys() - {"output front_slip_angle"}:
        assert found[name] == pytest.approx(expected[name], rel=1e-9, abs=1e-12)


def test_wind_pushes_and_turns_and_the_accelerometer_feels_it_and_not_a_bank() -> None:
    found = evaluated(
        bicycle("linear", "linear", effects=(WIND,)), VALUES | {"wind_force": 900.0, "wind_moment": 300.0}
    )
    still = evaluated(bicycle("linear", "linear", effects=()), VALUES)
    pushed = found["rate lateral_velocity"] - still["rate lateral_velocity"]
    turned = found["rate yaw_rate"] - still["rate yaw_rate"]
    assert pushed == pytest.approx(900.0 / BODY["mass"], rel=1e-6)
    assert turned == pytest.approx(300.0 / BODY["yaw_inertia"], rel=1e-6)
    read = "output lateral_acceleration"
    assert found[read] - still[read] == pytest.approx(900.0 / BODY["mass"], rel=1e-6)
    banked = evaluated(
        bicycle("linear", "linear", effects=(ROAD_BANK,)), VALUES | {"bank_cos": 0.1, "bank_sin": 0}
    )
    assert banked[read] == pytest.approx(still[read], rel=1e-9)


def test_effects_compose() -> None:
    both = bicycle("linear", "linear", effects=(STEERING_OFFSET, WIND))
    sizes = {"steering_offset": 0.01, "wind_force": 900.0, "wind_moment": 300.0}
    found = evaluated(both, VALUES | sizes)
    offset = evaluated(bicycle("linear", "linear", effects=(STEERING_OFFSET,)), VALUES | sizes)
    pushed = found["rate lateral_velocity"] - offset["rate lateral_velocity"]
    assert pushed == pytest.approx(900.0 / BODY["mass"], rel=1e-6)


@pytest.mark.parametrize("signal", SIZES)
def test_a_bias_is_on_its_own_sensor_only(signal: str) -> None:
    effect = sensor_bias(signal)
    found = evaluated(bicycle("linear", "linear", effects=(effect,)), VALUES | {effect.names[0]: 0.05})
    expected = evaluated(bicycle("linear", "linear", effects=()), VALUES)
    for name, values in expected.items():
        bias = 0.05 if name == f"output {signal}" else 0.0
        assert found[name] == pytest.approx(values + bias, rel=1e-12, abs=1e-14)


def test_refuses_an_effect_at_a_port_that_the_model_does_not_have() -> None:
    with pytest.raises(ValueError, match="road_bank enters at lateral_force"):
        kinematic(effects=(ROAD_BANK,))


def test_effects_of_the_measurement_join_the_kinematic_model_and_those_of_the_tyres_do_not() -> None:
    joined = (STEERING_RATIO_NONLINEARITY, STEERING_OFFSET, WHEEL_SPEED_SCALE, BODY_ROLL)
    system = kinematic(effects=joined)
    assert tuple(system.states)[-2:] == ("body_roll_angle", "body_roll_rate")
    values = VALUES | {name: 0.0 for effect in joined for name in effect.names}
    kept = {name: value for name, value in values.items() if name in system.parameters}
    states = {"heading": 0.1, "position_x": 0.0, "position_y": 0.0, "body_roll_rate": 0.0}
    at = kept | states | {"body_roll_angle": 0.02, "road_wheel_angle": 0.05, "longitudinal_velocity": 8.0}
    known = {symbol(name): value for name, value in at.items()}
    for name, expression in system.intermediates.items():
        known[symbol(name)] = sympy.sympify(expression).xreplace(known)
    turn = 8.0 * np.tan(0.05) / (BODY["cg_to_front_axle"] + BODY["cg_to_rear_axle"])
    read = sympy.sympify(system.outputs["lateral_acceleration"]).xreplace(known)
    assert float(read) == pytest.approx(8.0 * turn + 9.81 * np.sin(0.02))
    for effect in (TYRE_RELAXATION, LOAD_TRANSFER, PROBES):
        with pytest.raises(ValueError, match=effect.name):
            kinematic(effects=(effect,))


def test_effects_with_states_join_the_driven_model() -> None:
    effects = (STEERING_OFFSET, ROAD_BANK, TYRE_RELAXATION, LOAD_TRANSFER, BODY_ROLL, PROBES)
    system = driven_bicycle("linear", "linear", effects)
    added = ("front_relaxed_force", "rear_relaxed_force", "body_roll_angle", "body_roll_rate")
    assert tuple(system.states)[-4:] == added
    assert set(PROBES.inputs) <= set(system.inputs)
    assert "load_transfer.height_over_track" in system.parameters
    with pytest.raises(ValueError, match="wheel_speed_scale enters at longitudinal_velocity"):
        driven_bicycle("linear", "linear", (WHEEL_SPEED_SCALE,))


@pytest.mark.parametrize("kind", ["linear", "piecewise_linear", "brush"])
def test_two_effects_that_read_the_same_value_of_the_model_give_it_once(kind: str) -> None:
    system = bicycle(kind, kind, (TYRE_RELAXATION, PROBES))
    assert system.outputs["front_static_force"] == symbol("at.front_lateral_force")
    assert system.outputs["front_lateral_force"] == symbol("front_relaxed_force")


def test_sizes_lie_inside_their_bounds() -> None:
    for effect in (STEERING_OFFSET, ROAD_BANK, *map(sensor_bias, SIZES)):
        for parameter in effect.parameters:
            assert parameter.low < 0 < parameter.typical < parameter.high
