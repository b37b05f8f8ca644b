"""Which model is good enough, and for what: every model that exists, predicting runs that took no part.

A model predicts from the logged initial state, driven by the measured steering, and where a request was
followed by the request through the identified actuator (METHODS section 4).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from ident.estimation.evaluation import Candidate, paired
from ident.estimation.repeats import repeat_noise
from ident.estimation.vehicle_records import MotionRecord
from ident.results import (
    SCHEMA_VERSION,
    Check,
    Comparison,
    Error,
    Estimate,
    EvaluatedModel,
    EvaluateResult,
    ModelName,
    Refusal,
    Requirement,
    SteeringResult,
    TyresResult,
)
from ident.signals.run import LoadedLogs
from ident.stages.evaluate_characteristics import characteristics
from ident.stages.evaluate_checks import checks
from ident.stages.evaluate_data import HeldOut, held_out_data, held_out_motion
from ident.stages.evaluate_errors import JUDGED, Evaluated, Level, levels
from ident.stages.evaluate_models import TWO_TRACK, candidates, cost_ratios, from_file
from ident.stages.evaluate_settings import UNITS, EvaluateSettings
from ident.stages.evaluate_tables import evaluate_tables
from ident.stages.inputs import InputSettings, SplitSettings, load, provenance
from ident.stages.output import Context, StageOutput
from ident.stages.two_track_model import two_track_told
from ident.stages.tyre_data import TyreData

Array = NDArray[np.float64]

NAMES: dict[ModelName, str] = {
    "kinematic": "kinematic",
    "linear": "linear",
    "piecewise_linear": "piecewise linear",
    "brush": "brush",
    "magic_formula": "Magic Formula",
    "pac2002": "PAC2002",
    "two_track": "two-track",
}
COMPARED = ("yaw_rate", "lateral_acceleration", "position_y", "heading")
SIGNIFICANT = 0.05
SPEED_STEP, ACCELERATION_STEP = 2.5, 1.0  # [m/s], [m/s²] of the map of what was driven


def evaluate(
    logs: Sequence[Path],
    inputs: InputSettings,
    settings: EvaluateSettings,
    context: Context,
    *,
    tyres: TyresResult,
    steering: SteeringResult | None = None,
) -> StageOutput[EvaluateResult]:
    """Predict the held-out runs under LOGS with every model.

    Parameters
    ----------
    tyres : what the models come from
    steering : the actuator, where it was identified

    Raises
    ------
    UnusableLog
        If there is no log that can be read.
    NotIdentifiable
        If no held-out run holds steering, speed and motion.
    """
    loaded = load(logs, inputs, context)
    motion = held_out_motion(loaded, inputs, tyres)
    data = held_out_data(motion, loaded.runs, tyres, steering)
    models = candidates(tyres, settings.models)
    at = levels(data)
    evaluated = _evaluated(models, at, context)
    noise = repeat_noise(data.records, data.names)
    told = [one.told(data.names, settings.acceptable, noise) for one in evaluated]
    result = _result(loaded, context, settings, motion, data, evaluated, told, noise, inputs.split)
    return StageOutput(result, evaluate_tables(data, evaluated))


def _evaluated(models: Sequence[Candidate], at: Sequence[Level], context: Context) -> list[Evaluated]:
    pairs = [(model, level) for level in at for model in models]
    made = []
    for number, (model, level) in enumerate(pairs):
        context.progress(f"predict with the {model.name.replace('_', ' ')} model", number, len(pairs))
        made.append(Evaluated(model, level))
    return made


def _result(
    loaded: LoadedLogs,
    context: Context,
    settings: EvaluateSettings,
    motion: TyreData,
    data: HeldOut,
    evaluated: Sequence[Evaluated],
    told: Sequence[EvaluatedModel],
    noise: Mapping[str, float],
    split: SplitSettings,
) -> EvaluateResult:
    measured = [one for one in told if one.input == "measured"]
    held_out = data.parts(split)
    chosen = choose(measured, settings.acceptable)
    own = [one for one in evaluated if one.level.name == "measured"]
    found = checks(data.runs, data.motion, data.tyres, motion.vehicle, held_out)
    speed, acceleration, coverage = _coverage(data)
    compared = chosen or _best(measured).name
    return EvaluateResult(
        schema_version=SCHEMA_VERSION,
        provenance=provenance(context, loaded),
        verdict=_verdict(measured, chosen, data, settings.acceptable),
        next_step=_next_step(measured, chosen),
        models=list(told),
        acceptable={name: Error(v, None, None, UNITS[name]) for name, v in settings.acceptable.items()},
        chosen=chosen,
        why=_why(measured, chosen, settings.acceptable),
        split_by=split.by,
        held_out=held_out,
        training=[run.run for run in data.tyres.by_run if run.used],
        comparisons=[*_comparisons(own, compared), *_against(settings, own, data.tyres.chosen)],
        characteristics=characteristics(
            own[0].level.cuts["whole"],
            {one.candidate.name: one.predictions["whole"] for one in own},
            motion.body,
            settings.tolerance,
        ),
        checks=found,
        requirements=_requirements(measured, chosen, settings.require),
        coverage={"seconds": coverage},
        speed_edges=speed,
        acceleration_edges=acceleration,
        repeat_noise=dict(noise),
        runs=[run.health for run in loaded.runs],
        refused=[*motion.left_out, *_refused(settings, told, data.tyres), *loaded.unreadable],
        warnings=list(dict.fromkeys([*loaded.warnings, *motion.warnings, *_doubts(found)])),
        against=None if settings.against is None else str(settings.against),
        geometry={
            "cg_to_front_axle": motion.body.cg_to_front_axle,
            "cg_to_rear_axle": motion.body.cg_to_rear_axle,
            "reference_x": data.records[0].reference_x,
        },
        cost_ratios=cost_ratios(measured, data.tyres),
        two_track=_two_tracks(told, data.tyres),
    )


def _two_tracks(told: Sequence[EvaluatedModel], tyres: TyresResult) -> str | None:
    there = any(one.name == TWO_TRACK for one in told)
    fit = tyres.two_track if there else None
    return None if fit is None else two_track_told(fit, NAMES[fit.kind])


def _doubts(found: Sequence[Check]) -> list[str]:
    return [one.text for one in found if one.verdict != "fine"]


def is_acceptable(one: EvaluatedModel, acceptable: Mapping[str, float]) -> bool:
    """Whether every signal with a limit is within it over windows."""
    rms = one.windows.get(JUDGED, {})
    limited = [name for name in acceptable if name in rms]
    return bool(limited) and all(rms[name].value <= acceptable[name] for name in limited)


def choose(models: Sequence[EvaluatedModel], acceptable: Mapping[str, float]) -> ModelName | None:
    """The model within the acceptable band at the least cost; None where none is within it."""
    good = [one for one in models if is_acceptable(one, acceptable)]
    return min(good, key=lambda one: one.cost_ns_per_step).name if good else None


def _best(models: Sequence[EvaluatedModel]) -> EvaluatedModel:
    """The most accurate: least geometric mean of the errors over windows."""

    def size(one: EvaluatedModel) -> float:
        rms = [error.value for error in one.windows.get(JUDGED, one.rms).values() if error.value > 0]
        return float(np.mean(np.log(rms))) if rms else np.inf

    return min(models, key=size)


def _why(models: Sequence[EvaluatedModel], chosen: ModelName | None, acceptable: Mapping[str, float]) -> str:
    if chosen is None:
        best = _best(models)
        over = {name: _over(best, name, acceptable) for name in acceptable}
        parts = [
            f"{name.replace('_', ' ')} {size:.1f} times its limit" for name, size in over.items() if size > 1
        ]
        return f"none is within the acceptable errors; the best, {NAMES[best.name]}, has {', '.join(parts)}"
    own = next(one for one in models if one.name == chosen)
    others = [one for one in models if one.name != chosen and is_acceptable(one, acceptable)]
    if not others:
        return "the only model within the acceptable errors"
    dearer = ", ".join(
        f"{NAMES[one.name]} costs {one.cost_ns_per_step / own.cost_ns_per_step:.1f} times as much"
        for one in sorted(others, key=lambda one: one.cost_ns_per_step)
    )
    return f"the cheapest of {len(others) + 1} models within the acceptable errors: {dearer}"


def _over(one: EvaluatedModel, name: str, acceptable: Mapping[str, float]) -> float:
    rms = one.windows.get(JUDGED, {})
    return rms[name].value / acceptable[name] if name in rms else 0.0


def _verdict(
    models: Sequence[EvaluatedModel],
    chosen: ModelName | None,
    data: HeldOut,
    acceptable: Mapping[str, float],
) -> str:
    """One line: what the model is good for, and how far."""
    if chosen is None:
        return f"No model is usable for control on these runs: {_why(models, None, acceptable)}"
    own = next(one for one in models if one.name == chosen)
    speed = np.concatenate([record.speed for record in data.records])
    low, high = np.quantile(speed, [0.01, 0.99])
    up_to = "small lateral accelerations" if own.valid_to is None else f"{own.valid_to:g} m/s²"
    told = f"The {NAMES[chosen]} model is usable for control up to {up_to} at {low:.0f} to {high:.0f} m/s"
    yaw_rate = own.windows[JUDGED].get("yaw_rate")
    if yaw_rate is None:
        return told
    return f"{told}: over 2 s its yaw rate is within {1e3 * yaw_rate.value:.1f} mrad/s (rms)"


def _next_step(models: Sequence[EvaluatedModel], chosen: ModelName | None) -> str | None:
    if chosen is None:
        return "see which signal exceeds its limit, and at which lateral acceleration, in the report"
    own = next(one for one in models if one.name == chosen)
    last = own.by_lateral_acceleration[-1] if own.by_lateral_acceleration else None
    if last is not None and last.highest is not None:
        return (
            f"nothing above {last.highest:g} m/s² was driven: hold out a harder run to know the model there"
        )
    return None


def _comparisons(evaluated: Sequence[Evaluated], chosen: str) -> list[Comparison]:
    """Compare the chosen model with each other one."""
    own = next(one for one in evaluated if one.candidate.name == chosen)
    made = []
    for other in evaluated:
        if other is not own:
            made += _pairwise(own, other)
    return made


def _pairwise(own: Evaluated, other: Evaluated) -> list[Comparison]:
    made = []
    for signal in COMPARED:
        if signal not in own.predictions[JUDGED].errors or signal not in other.predictions[JUDGED].errors:
            continue
        sums = own.sums(JUDGED, signal), other.sums(JUDGED, signal)
        first_is_better = sums[0].rms <= sums[1].rms
        ordered = sums if first_is_better else (sums[1], sums[0])
        names = own.candidate.name, other.candidate.name
        better, worse = names if first_is_better else (names[1], names[0])
        value, low, high, p = paired(*ordered, own.level.weights[JUDGED])
        std = (high - low) / (2 * float(norm.ppf(0.975)))
        status = "identified" if p < SIGNIFICANT else "weak"
        reason = None if p < SIGNIFICANT else "the difference is within the spread between blocks"
        ratio = Estimate(value, std, low, high, "1", status, reason)  # type: ignore[arg-type]
        made.append(Comparison(better, worse, signal, ratio, p))
    return made


def _against(settings: EvaluateSettings, evaluated: Sequence[Evaluated], name: ModelName) -> list[Comparison]:
    """Compare a model with that of another file, on the same windows."""
    if settings.against is None:
        return []
    own = next(one for one in evaluated if one.candidate.name == name)
    return _pairwise(own, Evaluated(from_file(settings.against), own.level))


def _requirements(
    models: Sequence[EvaluatedModel], chosen: ModelName | None, require: Mapping[str, float]
) -> list[Requirement]:
    own = next((one for one in models if one.name == chosen), None) or _best(models)
    made = []
    for name, limit in require.items():
        measured = own.rms[name].value if name in own.rms else None
        met = None if measured is None else measured <= limit
        made.append(Requirement(name, limit, measured, UNITS[name], met))
    return made


def _coverage(data: HeldOut) -> tuple[list[float], list[float], list[list[float]]]:
    """Seconds in cells of speed and size of the lateral acceleration, with the edges of the cells."""
    speed = np.concatenate([record.speed for record in data.records])
    turn = np.concatenate([_turning(record.speed, record) for record in data.records])
    period = data.records[0].period
    edges = [
        step * np.arange(max(2, int(np.ceil(float(values.max()) / step)) + 1))
        for values, step in ((speed, SPEED_STEP), (turn, ACCELERATION_STEP))
    ]
    counts, _, _ = np.histogram2d(speed, turn, bins=(edges[0], edges[1]))
    return edges[0].tolist(), edges[1].tolist(), (counts * period).tolist()


def _turning(speed: Array, record: MotionRecord) -> Array:
    if "yaw_rate" not in record.measured:
        return np.zeros(speed.size)
    turn = record.measured["yaw_rate"]
    return np.abs(speed * np.interp(record.times, turn.times, turn.values))


def _refused(settings: EvaluateSettings, told: Sequence[EvaluatedModel], tyres: TyresResult) -> list[Refusal]:
    there, identified = {one.name for one in told}, tyres.chosen
    asked = settings.models or [name for name in NAMES if name != "pac2002"]
    why: dict[str, str] = {
        one.what: f"is not testable: {one.reason}" for one in tyres.refused if one.what == TWO_TRACK
    }
    made = [Refusal(name, why.get(name, "was not fitted")) for name in asked if name not in there]
    if settings.against is not None and identified not in there:
        made.append(Refusal("comparison with another model", f"{NAMES[identified]} is not among the models"))
    if all(one.input == "measured" for one in told):
        made.append(
            Refusal(
                "request through the actuator",
                "no held-out run has a request that was followed, or the actuator is not identified",
            )
        )
    return made
