"""The loop on runs whose effects nobody declared, held against the answers of the program that made them.

Some sets are left to `make study` (IDENT_EVERY_SET=1), because each takes a good part of a minute.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from ident.results import FoundEffect, ImproveResult
from ident.stages.improve import improve
from ident.stages.improve_settings import CATALOGUE, ImproveSettings
from ident.stages.inputs import InputSettings
from ident.stages.output import Context
from ident.vehicle import read_vehicle

ROOT = Path(__file__).resolve().parents[2]
SETS = ROOT / "sample_logs" / "undeclared"
ANSWERS = ROOT / "tests" / "truth" / "undeclared.yaml"
NAMES = {name for names in CATALOGUE.values() for name in names}
QUICK = ("set_m2", "set_f8")
SURE = 4.0  # standard errors
LOST = 1.02  # share of its error before by which no signal may be worse after: chance of a fit


@dataclass(frozen=True)
class Truth:
    """One effect that a truck has: its key in the loop, and its parameters."""

    key: str
    parameters: dict[str, float]


def answers() -> dict[str, list[Truth]]:
    """Return what each truck has."""
    read = YAML(typ="safe").load(ANSWERS.read_text(encoding="utf-8"))
    return {
        name: [
            Truth(" ".join([one["name"], *([one["of"]] if "of" in one else [])]), one["parameters"])
            for one in given or ()
        ]
        for name, given in read.items()
    }


def is_known(truths: list[Truth]) -> bool:
    """Whether the catalogue has all of it."""
    return all(one.key.partition(" ")[0] in NAMES for one in truths)


@cache
def improved(name: str) -> ImproveResult:
    context = Context(command="test", date="2026-01-01T00:00:00Z")
    return improve([SETS / name], InputSettings(), ImproveSettings(), context).result


def sets(*, known: bool, something: bool = True) -> list[object]:
    """Return the sets of a kind; those that take long are skipped unless all are asked for."""
    every = pytest.mark.skipif(
        "IDENT_EVERY_SET" not in os.environ, reason="part of `make study` (IDENT_EVERY_SET)"
    )
    return [
        pytest.param(name, marks=() if name in QUICK else every)
        for name, truths in answers().items()
        if is_known(truths) == known and bool(truths) == something
    ]


def of_class(found: list[FoundEffect], truth: Truth) -> FoundEffect:
    (one,) = [one for one in found if truth.key in (one.key, *one.members)]
    return one


@pytest.mark.parametrize("name", sets(known=True, something=False))
def test_a_truck_that_lacks_nothing_is_adequate(name: str) -> None:
    result = improved(name)
    assert (result.verdict, result.effects, result.discovered) == ("adequate", [], None)
    assert result.layers == ["actuator", "motion"]
    assert not result.steps[-1].gate.rejected
    assert result.minimum_detectable
    assert result.error.after == result.error.before
    assert [one.name for one in result.sensors if one.verdict == "differs"] == []


@pytest.mark.parametrize("name", sets(known=True))
def test_the_effects_of_a_truck_are_found_all_of_them_and_no_other(name: str) -> None:
    result, truths = improved(name), answers()[name]
    assert result.verdict in ("named", "equivalent"), result.told
    assert len(result.effects) == len(truths), [one.key for one in result.effects]
    for truth in truths:
        assert len(of_class(result.effects, truth).members) <= 3
    assert not result.steps[-1].gate.rejected


@pytest.mark.parametrize("name", sets(known=True))
def test_the_true_size_of_an_effect_lies_in_its_interval(name: str) -> None:
    for truth in answers()[name]:
        found = of_class(improved(name).effects, truth)
        if found.key != truth.key:
            continue  # another of its class stands for it; its size is of another kind
        size, true = next(iter(truth.parameters.items()))
        estimate = found.parameters[size]
        assert estimate.value is not None
        assert estimate.std is not None
        allowed = SURE * estimate.std + noise_in(name, truth)
        assert abs(estimate.value - true) < allowed, (truth.key, estimate)


def noise_in(name: str, truth: Truth) -> float:
    """What the noise of the measured angle adds to a play behind its sensor [rad at the road wheel].

    The play follows the noise too: its peaks on both sides seem to widen it.
    """
    ratio = read_vehicle(SETS / name / "vehicle.yaml").steering_ratio
    assert isinstance(ratio, float)
    angle = improved(name).error.noise["steering_wheel_angle"]
    return 2 * angle / ratio if truth.key == "steering_linkage_play" else 0.0


@pytest.mark.parametrize("name", sets(known=True))
def test_the_error_of_runs_that_took_no_part_falls_and_no_signal_gets_worse(name: str) -> None:
    result = improved(name)
    before, after = result.error.before, result.error.after
    assert result.confirmation is not None
    assert result.confirmation.confirmed
    assert min(after[signal].value / before[signal].value for signal in before) < 0.9
    assert {signal for signal in before if after[signal].value > LOST * before[signal].value} == set()


@pytest.mark.parametrize("name", sets(known=False))
def test_what_is_in_no_catalogue_is_not_named_as_something_else(name: str) -> None:
    result = improved(name)
    assert result.verdict == "unexplained"
    assert result.discovered is not None
    assert result.discovered.equation == "yaw_moment"
