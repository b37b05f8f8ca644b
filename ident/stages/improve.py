"""Find what a model leaves, trace it to an effect, add that, and tell the error before and after.

Sensors are compared with each other first, without a model. Then the loop runs over the layers that the logs
hold (METHODS section 6, :mod:`ident.estimation.improvement`), and what it added is judged on runs that took
no part in the fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.before_after import same_size
from ident.estimation.improvement import Improvement, improve_layers, with_term
from ident.estimation.residual_tests import Screened
from ident.results import (
    DIFFERENT_SIZES,
    SCHEMA_VERSION,
    Confirmation,
    ErrorComparison,
    FoundEffect,
    ImproveResult,
    SensorCheck,
    Verdict,
)
from ident.signals.run import LoadedLogs
from ident.stages.improve_data import NOT_NAMED, LayerData, layer_data
from ident.stages.improve_held_out import (
    Compared,
    confirmation,
    error_comparison,
    held_out_table,
    held_up,
    unit_of,
)
from ident.stages.improve_model import model_part
from ident.stages.improve_settings import ImproveSettings
from ident.stages.improve_tables import improve_table, with_regressor
from ident.stages.improve_told import (
    discovered,
    found_effects,
    minimum_detectable,
    next_experiment,
    not_testable,
    step_of,
)
from ident.stages.inputs import InputSettings, load, provenance
from ident.stages.output import Context, StageOutput

Array = NDArray[np.float64]

NO_ERROR = ErrorComparison({}, {}, {}, "none")
TOLD_BY_SENSORS = ("wheel_speed_scale", "sensor_bias yaw_rate", "sensor_latency yaw_rate")
NOT_INTEGRATED = ("yaw_rate", "lateral_acceleration")  # errors of others add up along a run
FARTHER, FEWEST_OTHERS = 1.5, 2  # error of a run over that of the others, from which it is told
MILLI = ("rad", "rad/s")


def improve(
    logs: Sequence[Path], inputs: InputSettings, settings: ImproveSettings, context: Context
) -> StageOutput[ImproveResult]:
    """Run the loop on the runs under LOGS.

    Raises
    ------
    UnusableLog
        If there is no log that can be read.
    NotIdentifiable
        If the logs hold neither request and angle, nor angle and motion, nor two sensors to compare.
    """
    loaded = load(logs, inputs, context)
    context.progress("compare the sensors", 0, 1)
    data = layer_data(loaded, inputs, settings.runs)
    sensors = data.sensors
    if not data.layers:
        return _sensors_only(loaded, context, sensors, data)
    found = improve_layers(
        data.layers,
        level=settings.level,
        draws=settings.draws,
        seed=inputs.seed,
        effects=settings.effects,
        known=known_sizes(sensors),
        survivors=settings.survivors,
        most_effects=settings.most_effects,
        progress=context.progress,
    )
    verdict = verdict_of(found)
    term = with_term(found) if verdict[0] == "unexplained" else None
    parts = [held_up(found, name, settings.folds, context.progress) for name in found.layers]
    error = error_comparison(parts, inputs.seed)
    table, regressor = with_regressor(improve_table(found, loaded), error, [key for _, key in found.added])
    if term is not None and term[1].key not in found.fits[term[0]].keys:
        term = None  # it did not hold on data that took no part
    result = _result(loaded, context, data, found, parts, error, sensors, regressor, inputs.seed, term)
    tables = {"improve": table, "improve_held_out": held_out_table(parts)}
    return StageOutput(result, tables, model_part(found, data))


def known_sizes(sensors: Sequence[SensorCheck]) -> dict[str, tuple[float, float]]:
    """Sizes that the sensors tell by themselves, by the key of the effect."""
    made = {}
    for one in sensors:
        estimate = one.estimate
        if one.verdict != "differs" or one.effect is None or estimate.value is None or estimate.std is None:
            continue
        keys = [one.effect, *(f"{one.effect} {signal}" for signal in one.signals)]
        key = next((key for key in keys if key in TOLD_BY_SENSORS), None)
        if key is not None:
            made[key] = (estimate.value - one.expected, estimate.std)
    return made


def _sensors_only(
    loaded: LoadedLogs, context: Context, sensors: list[SensorCheck], data: LayerData
) -> StageOutput[ImproveResult]:
    """Answer with the sensors alone, where no layer can be looked at."""
    if not any(one.verdict != "not_testable" for one in sensors):
        reasons = "; ".join(f"{one.what}: {one.reason}" for one in data.refused if one.reason != NOT_NAMED)
        raise NotIdentifiable(f"nothing to improve: {reasons}")
    differ = [one.name for one in sensors if one.verdict == "differs"]
    told = (
        f"no model could be looked at, only the sensors: {len(differ)} of {len(sensors)} comparisons differ"
    )
    missing = {name: _why(data, name) for name in ("actuator", "motion")}
    nothing = Improvement({}, {}, {})
    result = ImproveResult(
        schema_version=SCHEMA_VERSION,
        provenance=provenance(context, loaded),
        verdict="unexplained",
        told=told,
        base="no model: sensors against each other",
        layers=[],
        sensors=sensors,
        effects=[],
        discovered=None,
        candidates=[],
        steps=[],
        minimum_detectable={},
        next_experiment=None,
        error=NO_ERROR,
        confirmation=None,
        not_testable=not_testable(nothing, None, missing),
        runs=[run.health for run in loaded.runs],
        refused=[*data.refused, *loaded.unreadable],
        warnings=[*loaded.warnings, *data.warnings],
    )
    return StageOutput(result)


def _why(data: LayerData, layer: str) -> str:
    return next((one.reason for one in data.refused if one.what.startswith(layer)), "no data")


def _result(
    loaded: LoadedLogs,
    context: Context,
    data: LayerData,
    found: Improvement,
    parts: list[Compared],
    error: ErrorComparison,
    sensors: list[SensorCheck],
    regressor: Any,
    seed: int,
    term: tuple[str, Screened] | None,
) -> ImproveResult:
    gate = found.rounds[-1].screen
    effects = found_effects(found, parts)
    verdict, why = verdict_of(found)
    if found.dropped:
        verdict, why = "unexplained", f"{', '.join(found.dropped)} did not hold on data that took no part"
    steps = [step_of(one, found.layers) for one in found.rounds]
    confirmed = confirmation(parts, seed) if found.added or term else None
    missing = {name: _why(data, name) for name in ("actuator", "motion") if name not in found.layers}
    return ImproveResult(
        schema_version=SCHEMA_VERSION,
        provenance=provenance(context, loaded),
        verdict=verdict,
        told=_told(verdict, why, effects, error, confirmed),
        base=_base(found),
        layers=list(found.layers),  # type: ignore[arg-type]
        sensors=sensors,
        effects=effects,
        discovered=None if term is None else discovered(found, *term, parts, seed),
        candidates=next((one.candidates for one in reversed(steps) if one.candidates), []),
        steps=steps,
        minimum_detectable=minimum_detectable(gate, found.layers),
        next_experiment=next_experiment(found, gate),
        error=error,
        confirmation=confirmed,
        not_testable=not_testable(found, gate, missing),
        runs=[run.health for run in loaded.runs],
        refused=[*data.refused, *loaded.unreadable],
        warnings=[*loaded.warnings, *data.warnings, *_doubts(found, effects, parts)],
        regressor=regressor,
    )


def verdict_of(found: Improvement) -> tuple[Verdict, str]:
    """The verdict, and the reason where it is not plain."""
    if not found.passes:
        return "unexplained", found.rounds[-1].why
    for layer, key in found.added:
        p_value = same_size(*found.fits[layer].sizes_by_run(key))
        if p_value is not None and p_value < DIFFERENT_SIZES:
            return "unexplained", f"{key} is not of one size in all runs (p = {p_value:.1g})"
    if not found.added:
        return "adequate", ""
    return ("equivalent" if any(len(found.members(key)) > 1 for _, key in found.added) else "named"), ""


def _base(found: Improvement) -> str:
    told = {
        "actuator": "linear actuator with dead time and two lags",
        "motion": "planar bicycle with Magic Formula axles, no offset, bias or bank",
    }
    return "; ".join(told[name] for name in found.layers)


def _left_in(parts: Sequence[Compared]) -> list[str]:
    """Why some runs are in every fit."""
    return [why for part in parts for why in part.left_in.values()]


def _unlike(effects: Sequence[FoundEffect]) -> list[str]:
    return [
        f"{one.key}: its size differs between runs (p = {one.same_in_runs_p:.2g})"
        for one in effects
        if one.same_in_runs_p is not None and one.same_in_runs_p < DIFFERENT_SIZES
    ]


def _doubts(found: Improvement, effects: Sequence[FoundEffect], parts: Sequence[Compared]) -> list[str]:
    """What speaks against the answer though it is given."""
    unseen = farther_off(parts) if found.passes else []
    return [*_unlike(effects), *_left_in(parts), *unseen]


def farther_off(parts: Sequence[Compared]) -> list[str]:
    """Runs that are predicted clearly worse than the others."""
    told = []
    for part, signal in product(parts, NOT_INTEGRATED):
        size = _error_by_run(part.rows[signal]) if signal in part.rows else {}
        worst = max(size, key=lambda run: size[run], default=-1)
        others = [value for run, value in size.items() if run != worst]
        if len(others) >= FEWEST_OTHERS and size[worst] > FARTHER * float(np.median(others)):
            times = size[worst] / float(np.median(others))
            where = f"{signal} in {part.runs[worst]}: {times:.1f} times the error of the other runs"
            told.append(f"{where}, of which the gate sees nothing; drive such a run again")
    return told


def _error_by_run(rows: Array) -> dict[int, float]:
    """Run -> root mean square of measured minus improved model, of rows as ``Compared`` has them."""
    run, error = rows[:, 0].astype(int), rows[:, 2] - rows[:, 4]
    return {int(one): float(np.sqrt(np.mean(error[run == one] ** 2))) for one in np.unique(run)}


def _told(
    verdict: Verdict,
    why: str,
    effects: Sequence[FoundEffect],
    error: ErrorComparison,
    confirmed: Confirmation | None,
) -> str:
    """The verdict in one line."""
    if verdict == "adequate":
        return "adequate: nothing is left that noise does not explain"
    names = " and ".join(_named(one) for one in effects) or "no effect of the catalogue"
    where = _largest(error)
    if verdict == "unexplained":
        added = f"; added so far: {names}{where}" if effects else ""
        return f"unexplained: {why}{added}"
    sure = "" if confirmed is None or confirmed.confirmed else ", not confirmed on runs that took no part"
    return f"{names}{where}{sure}"


def _named(one: FoundEffect) -> str:
    name, estimate = next(iter(one.parameters.items()))
    plain = one.key.replace("_", " ")
    others = (
        f" (or {', '.join(key.replace('_', ' ') for key in one.members[1:])})" if len(one.members) > 1 else ""
    )
    if estimate.value is None or estimate.std is None:
        return plain + others
    factor, unit = _shown(estimate.unit, estimate.value)
    size = f"{factor * estimate.value:.3g} ± {factor * 1.96 * estimate.std:.1g}"
    after = "" if unit == "1" else f" {unit}"
    return f"{plain}, {name.replace('_', ' ')} {size}{after}{others}"


def _shown(unit: str, value: float) -> tuple[float, str]:
    """Factor and unit in which a size is told."""
    factor, own = (1e3, f"m{unit}") if unit in MILLI and abs(value) < 1 else (1.0, unit)
    return factor, own.replace("^2", "²").replace("^3", "³")


def _largest(error: ErrorComparison) -> str:
    """Error before and after of the signal that gains most."""
    gains: Mapping[str, float] = {
        name: one.value / max(error.after[name].value, 1e-300) for name, one in error.before.items()
    }
    name = max(gains, key=lambda key: gains[key], default=None)
    if name is None or gains[name] <= 1:
        return ""
    factor, unit = _shown(unit_of(name), error.before[name].value)
    before, after = error.before[name].value * factor, error.after[name].value * factor
    return f"; {name.replace('_', ' ')} error {before:.3g} → {after:.3g} {unit}"
