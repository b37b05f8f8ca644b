from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from ident.errors import BadRecipe
from ident.model_file import (
    EffectPart,
    Model,
    SignalNoise,
    SteeringPart,
    TyresPart,
    ValidRange,
    Value,
    VehiclePart,
    model_from,
    model_text,
    read_model,
)
from ident.results import LogFile, Provenance

finite = st.floats(allow_nan=False, allow_infinity=False)


def load(text: str) -> dict[str, object]:
    return YAML(typ="safe", pure=True).load(text)


def a_model(dead_time: float = 0.1234, std: float | None = 2.5e-05) -> Model:
    none = Value(None, None, "s")
    stiffness = {"cornering_stiffness": Value(2.5e5, 3e3, "N/rad")}
    return Model(
        vehicle=VehiclePart(mass=Value(12500.0, None, "kg"), yaw_inertia=Value(52000.0, 400.0, "kg m^2")),
        reference_point="rear_axle",
        tyres=TyresPart("linear", stiffness, stiffness),
        effects=[
            EffectPart("sensor_bias", "M", {"bias": Value(0.002, 1e-4, "rad/s")}, of="yaw_rate"),
            EffectPart("steering_offset", "G", {"angle": Value(0.004, 1e-4, "rad")}, run="a/1"),
        ],
        valid_range=ValidRange(speed=(5.0, 15.0), lateral_acceleration=(-4.4, 4.1)),
        steering=SteeringPart(
            Value(0.985, 1e-4, "1"), Value(dead_time, std, "s"), none, none, ratio=[(0.0, 0.0)]
        ),
        noise={"steering_wheel_angle": SignalNoise(1e-3, [0.7, -0.1], 0.01)},
        parameters=["steering.gain", "steering.dead_time"],
        covariance=[[1e-8, -3e-12], [-3e-12, 6.25e-10]],
        provenance={
            "steering": Provenance("0.1.0", "ident steering logs", 1, "now", [LogFile("a", "00", 3)])
        },
    )


def test_reads_back_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "model.yaml"
    path.write_text(model_text(a_model()), encoding="utf-8")
    assert read_model(path) == a_model()


@settings(deadline=None)
@given(finite, finite | st.none())
def test_keeps_every_digit_of_a_number(value: float, std: float | None) -> None:
    model = a_model(value, std)
    assert model_from(load(model_text(model)), "text") == model


def test_writes_a_parameter_on_one_line_and_null_where_there_is_none() -> None:
    text = model_text(a_model())
    assert "\n  dead_time: {value: 0.1234, std: 2.5e-05, unit: s}\n" in text
    assert "\n  time_constant_1: {value: null, std: null, unit: s}\n" in text
    assert "\n    cornering_stiffness: {value: 250000.0, std: 3000.0, unit: N/rad}\n" in text
    assert text.startswith("schema: ident.model/1\n")


def test_writes_numbers_that_yaml_1_1_reads_as_numbers() -> None:
    assert "1.0e-08" in model_text(a_model())


def test_leaves_out_the_parts_that_it_does_not_have() -> None:
    assert model_text(Model()) == "schema: ident.model/1\n"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("gain:", "gian:", "unknown key 'steering.gian': did you mean 'gain'?"),
        ("ident.model/1", "ident.model/9", "schema: input should be 'ident.model/1', not 'ident.model/9'"),
        ("kind: linear", "kind: round", "tyres.kind: input should be"),
        ("reference_point: rear_axle", "reference_point: roof", "reference_point: input should be"),
        ("value: 0.1234", "value: much", "steering.dead_time.value: input should be a valid number"),
        ("value: 0.1234", "value: .nan", "steering.dead_time.value is nan, need a finite number or null"),
        ("[-3.0e-12, 6.25e-10]", "[-3.0e-12]", "covariance has rows of [2, 1] values, need 2 rows of 2"),
        ("[steering.gain, ", "[", "covariance has rows of [2, 2] values, need 1 rows of 1"),
    ],
)
def test_refuses_a_model_that_is_not_whole(tmp_path: Path, old: str, new: str, expected: str) -> None:
    text = model_text(a_model())
    assert old in text
    path = tmp_path / "model.yaml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(BadRecipe) as raised:
        read_model(path)
    assert expected in str(raised.value)
