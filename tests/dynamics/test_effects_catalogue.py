"""The catalogue: complete, consistent, and true to the effects that are built."""

from __future__ import annotations

import re

import pytest
import sympy

from ident.dynamics.effects import (
    BODY_ROLL,
    LOAD_TRANSFER,
    STEERING_RATIO_NONLINEARITY,
    TYRE_RELAXATION,
    WHEEL_SPEED_SCALE,
    Effect,
)
from ident.dynamics.effects.actuator_effect import ActuatorEffect
from ident.dynamics.effects.catalogue import CATALOGUE, Entry, Usual, not_built
from ident.dynamics.effects.catalogue.longitudinal import LONGITUDINAL
from ident.dynamics.effects.catalogue.sensors import SENSORS
from ident.dynamics.effects.catalogue.steering import STEERING
from ident.dynamics.effects.catalogue.vehicle import VEHICLE
from ident.dynamics.effects.steering_column_play import STEERING_COLUMN_PLAY
from ident.dynamics.effects.steering_dead_zone import STEERING_DEAD_ZONE
from ident.dynamics.effects.steering_rate_limit import STEERING_RATE_LIMIT

EVERY = pytest.mark.parametrize("entry", CATALOGUE.values(), ids=lambda entry: entry.name)
BUILT = [entry for entry in CATALOGUE.values() if entry.built]
OF_THE_MOTION = (TYRE_RELAXATION, LOAD_TRANSFER, BODY_ROLL, STEERING_RATIO_NONLINEARITY, WHEEL_SPEED_SCALE)
OF_THE_ACTUATOR = (STEERING_COLUMN_PLAY, STEERING_DEAD_ZONE, STEERING_RATE_LIMIT)
FIRST_TWELVE = {
    "steering_column_play", "steering_linkage_play", "steering_rate_limit", "steering_dead_zone",
    "steering_offset", "steering_ratio_nonlinearity", "tyre_relaxation", "load_transfer", "sensor_latency",
    "sensor_bias", "wheel_speed_scale", "body_roll",
}  # fmt: skip


def test_every_effect_stands_once() -> None:
    assert len(CATALOGUE) == len(STEERING) + len(VEHICLE) + len(SENSORS) + len(LONGITUDINAL) == 45


def test_the_first_twelve_are_built_and_the_others_are_listed_as_not_built() -> None:
    built = {entry.name for entry in BUILT}
    assert built >= FIRST_TWELVE
    assert {entry.name for entry in not_built()} == set(CATALOGUE) - built
    assert "slosh" in {entry.name for entry in not_built()}


@EVERY
def test_an_entry_says_what_it_means_and_what_looks_like_it(entry: Entry) -> None:
    assert re.fullmatch(r"[A-Z].*[.]", entry.meaning)
    assert entry.shown_by
    assert set(re.split(", ", entry.enters)) <= set("AGTYRXM")
    assert entry.name not in entry.confusable
    assert {name for name in entry.confusable if "_" in name} <= set(CATALOGUE)


@EVERY
def test_usual_sizes_are_a_range(entry: Entry) -> None:
    names = [one.name for one in entry.parameters]
    assert len(set(names)) == len(names) >= 1
    for one in entry.parameters:
        assert one.low < one.high
        assert one.low < one.typical < one.high


@pytest.mark.parametrize(("low", "high", "typical"), [(1.0, 4.0, 2.0), (-4.0, -1.0, -2.0), (-3.0, 3.0, 1.5)])
def test_the_typical_size_lies_in_the_middle(low: float, high: float, typical: float) -> None:
    assert Usual("size", "1", low, high).typical == pytest.approx(typical)


@pytest.mark.parametrize("entry", BUILT, ids=lambda entry: entry.name)
def test_what_is_built_has_an_equation_that_can_be_typeset(entry: Entry) -> None:
    assert entry.equation is not None
    text = sympy.printing.mathml(entry.equation, printer="presentation")
    assert text.startswith("<")
    assert "Derivative" not in text


@pytest.mark.parametrize("effect", OF_THE_MOTION, ids=lambda effect: effect.name)
def test_an_effect_of_the_motion_has_the_parameters_of_its_entry(effect: Effect) -> None:
    entry = CATALOGUE[effect.name]
    assert [f"{effect.name}.{one.name}" for one in entry.parameters] == [
        one.name for one in effect.parameters
    ]
    for usual, parameter in zip(entry.parameters, effect.parameters, strict=True):
        assert usual.unit == parameter.unit
        assert parameter.low < usual.low <= parameter.typical <= usual.high < parameter.high
    assert effect.meaning == entry.meaning
    assert set(effect.enters) <= set(entry.enters)


@pytest.mark.parametrize("effect", OF_THE_ACTUATOR, ids=lambda effect: effect.name)
def test_an_effect_of_the_actuator_has_the_size_of_its_entry(effect: ActuatorEffect) -> None:
    (usual,) = CATALOGUE[effect.name].parameters
    assert (usual.name, usual.unit) == (effect.size.name, effect.size.unit)
    assert effect.size.low < usual.low <= effect.size.typical <= usual.high < effect.size.high
