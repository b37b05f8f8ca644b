"""Identify the axle tyres of the dynamic bicycle from runs in which the vehicle turns.

Every kind of tyre is fitted to the same windows of motion by maximum likelihood (METHODS section 3), from a
start that the data give. The kind that goes on is the simplest one whose criterion is not clearly worse than
the best.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.noise import AutoRegression
from ident.estimation.signal_noise import noise_of_residuals
from ident.estimation.tyre_estimates import Uncertainty, tyre_fit, uncertainty
from ident.estimation.tyre_fit import SENSOR_BIAS, KindFit, criteria, fit_tyres
from ident.estimation.tyre_scaling import fit_scaling
from ident.estimation.tyre_start import tyre_starts
from ident.estimation.vehicle_fit import RunAgreement, run_agreement
from ident.estimation.vehicle_problem import ACROSS, ALONG, POSITION
from ident.glossary import AXLES, SIGNALS
from ident.results import (
    SCHEMA_VERSION,
    Estimate,
    Refusal,
    ResidualNoise,
    TyreFit,
    TyreKind,
    TyreRun,
    TyresResult,
)
from ident.signals.run import LoadedLogs
from ident.stages.inputs import InputSettings, load, provenance
from ident.stages.output import Context, StageOutput
from ident.stages.two_track_model import two_track_fit
from ident.stages.tyre_data import TyreData, fixed_values, tyre_data, without_run
from ident.stages.tyre_files import PAC2002, FileTyres, doubts_of_load, read_tyre_files, tyres_of_files
from ident.stages.tyre_forces import compare_forces
from ident.stages.tyre_model import model_part
from ident.stages.tyre_nuisance import nuisance, told_reference
from ident.stages.tyre_observer import observe
from ident.stages.tyre_settings import TyresSettings
from ident.stages.tyre_tables import tyre_tables

Array = NDArray[np.float64]

CLEARLY = 10.0  # of the criterion: below this, the simpler kind is as good
SIMPLE_FIRST: tuple[TyreKind, ...] = ("linear", "piecewise_linear", "brush", "magic_formula", "pac2002")
NAMES = {
    "linear": "Linear",
    "piecewise_linear": "Piecewise linear",
    "brush": "Brush",
    "magic_formula": "Magic Formula",
    "pac2002": "PAC2002",
}
UNITS = {name: SIGNALS[name].unit for name in (*SENSOR_BIAS, *POSITION)}
UNITS |= dict.fromkeys((ALONG, ACROSS), UNITS["position_x"])
TELLS = 0.25  # largest relative standard error of a parameter that a run alone tells
DISAGREES = 1e-3
LIKE_A_BRUSH = {"shape": 1.35, "curvature": -0.5}
PRACTICAL, FOREIGN = 0.03, 0.5  # relative
COMPARED = ("front.cornering_stiffness", "rear.cornering_stiffness", "front.LKY", "rear.LKY", "yaw_inertia")


def tyres(
    logs: Sequence[Any], inputs: InputSettings, settings: TyresSettings, context: Context
) -> StageOutput[TyresResult]:
    """Identify the axle tyres from the runs under LOGS.

    Raises
    ------
    UnusableLog
        If there is no log that can be read.
    NotIdentifiable
        If the vehicle file lacks mass or the distances of the axles, if no run holds steering, speed and
        motion, or if the vehicle hardly turns; if PAC2002 tyres are asked for without a property file.
    BadRecipe
        If a property file of the vehicle cannot be used.
    """
    loaded = load(logs, inputs, context)
    data = tyre_data(loaded, inputs.align, settings.runs, settings.least_speed, split=inputs.split)
    file_tyres = _file_tyres(data, settings)
    data, found = _fit_alike(data, settings, context, file_tyres)
    known = {kind: uncertainty(one, data.ratio_std) for kind, one in found.items()}
    told = criteria(found)
    fits = [tyre_fit(found[kind], known[kind], told[kind]) for kind in found]
    chosen = choose(told)
    result = _result(loaded, context, data, fits, chosen, found[chosen], known[chosen])
    tables = tyre_tables(data, found[chosen], loaded.runs)
    tables["tyre_forces"], observer, doubts = observe(data, found[chosen], tables["tyre_forces"])
    own = next(fit for fit in fits if fit.kind == chosen)
    compared = compare_forces(own, found[chosen], tables["tyre_forces"], tables["tyres"], loaded.runs)
    warnings = [*result.warnings, *doubts]
    result = replace(result, measured_forces=compared, observer=observer, warnings=warnings)
    result = replace(result, **_of_files(file_tyres, result, data))
    result = _with_two_tracks(result, data, settings, context, found)
    return StageOutput(result, tables, model_part(data, result, found[chosen], known[chosen]))


def _with_two_tracks(
    result: TyresResult,
    data: TyreData,
    settings: TyresSettings,
    context: Context,
    found: Mapping[TyreKind, KindFit],
) -> TyresResult:
    """Add the two-track model, or why there is none."""
    if not settings.two_track:
        return result
    context.progress("fit the two-track model", 0, 1)
    try:
        return replace(result, two_track=two_track_fit(data, found, result.chosen))
    except NotIdentifiable as error:
        return replace(result, refused=[*result.refused, Refusal("two_track", str(error))])


def _file_tyres(data: TyreData, settings: TyresSettings) -> FileTyres | None:
    """Return the tyres of the property files, None where they are not asked for or there are none."""
    if settings.kinds is not None and PAC2002 not in settings.kinds:
        return None
    if data.vehicle.tyres is not None:
        return tyres_of_files(read_tyre_files(data.vehicle.tyres), "vehicle file")
    if settings.kinds is not None:
        raise NotIdentifiable(
            "PAC2002 tyres need a property file, the vehicle file names none: add `tyres: file.tir` to it"
        )
    return None


def _of_files(tyres: FileTyres | None, result: TyresResult, data: TyreData) -> dict[str, Any]:
    """Return what the result says of the property files."""
    if tyres is None:
        return {}
    return {
        "property_files": tyres.files,
        "warnings": [*result.warnings, *doubts_of_load(tyres, data.body)],
    }


def _fit_alike(
    data: TyreData, settings: TyresSettings, context: Context, file_tyres: FileTyres | None
) -> tuple[TyreData, dict[TyreKind, KindFit]]:
    """Fit every kind, without runs that are of another vehicle or whose signals contradict the others.

    Such a run is left out where the rest is longer than it.
    """
    found = _fit_all(data, settings, context, file_tyres)
    for _ in range(len(data.runs) - 1):
        foreign = _foreign(data, found[choose(criteria(found))])
        if foreign is None:
            break
        data = without_run(data, *foreign)
        found = _fit_all(data, settings, context, file_tyres)
    return data, found


def _foreign(data: TyreData, found: KindFit) -> tuple[int, str] | None:
    """Return the run that disagrees most, for certain and by much, and why it is left out."""
    agreement = run_agreement(found.fit)
    shifts = [_shift(found, one) for one in agreement]
    seconds = [sum(r.times[-1] - r.times[0] for r in data.records if r.run == i) for i in range(len(shifts))]
    doubtful = [
        number
        for number, one in enumerate(agreement)
        if shifts[number] > FOREIGN
        and one.p * len(agreement) < DISAGREES
        and seconds[number] < sum(seconds) / 2
    ]
    if not doubtful:
        return None
    worst = max(doubtful, key=lambda number: shifts[number])
    return worst, (
        f"alone it would move stiffness or yaw inertia by {100 * shifts[worst]:.0f} % (p = "
        f"{agreement[worst].p:.1g}): another load, another vehicle, or signals that contradict each other: "
        "fit it by itself"
    )


def _shift(found: KindFit, one: RunAgreement) -> float:
    """Largest change of a stiffness or of the yaw inertia that a run alone would make, relative.

    Of those that it tells: a run on a straight road cannot contradict a stiffness.
    """
    index = [found.names.index(name) for name in COMPARED if name in found.names]
    told = one.std[index] < TELLS
    return float(np.abs(one.shift[index] * told).max())


def _fit_all(
    data: TyreData, settings: TyresSettings, context: Context, file_tyres: FileTyres | None
) -> dict[TyreKind, KindFit]:
    there = [kind for kind in SIMPLE_FIRST if kind != PAC2002 or file_tyres is not None]
    kinds = [kind for kind in there if settings.kinds is None or kind in settings.kinds]
    found: dict[TyreKind, KindFit] = {}
    for number, kind in enumerate(kinds):
        context.progress(f"fit {_in_a_sentence(kind)} tyres", number, len(kinds))
        try:
            if kind == PAC2002 and file_tyres is not None:
                own = file_tyres.own
                found[kind] = fit_scaling(data.records, file_tyres.tyres, own, data.body, floor=data.floor)
                continue
            starts = [*tyre_starts(kind, data.records, data.body), *_inherited(kind, found)]
            found[kind] = fit_tyres(data.records, kind, data.body, starts, floor=data.floor)
        except ValueError as error:
            raise NotIdentifiable(
                f"{_in_a_sentence(kind)} tyres: {error}: look at the signs and units of the signals with "
                "`ident info`"
            ) from error
    return found


def _inherited(kind: TyreKind, found: Mapping[TyreKind, KindFit]) -> list[dict[str, float]]:
    """Start a Magic Formula where the brush ended: it holds a curve much like it."""
    if kind != "magic_formula" or "brush" not in found:
        return []
    bent = {f"{axle}.{name}": value for axle in AXLES for name, value in LIKE_A_BRUSH.items()}
    return [{**found["brush"].parameters, **bent}]


def _in_a_sentence(kind: TyreKind) -> str:
    return NAMES[kind] if kind == PAC2002 else NAMES[kind].lower()


def choose(told: Mapping[TyreKind, float]) -> TyreKind:
    """The simplest kind whose criterion is within CLEARLY of the best.

    PAC2002 goes on only where no other kind was fitted, for what comes after the evaluation does not use such
    tyres; else it stands beside the chosen kind in ``model.yaml``.
    """
    others: Mapping[TyreKind, float] = {k: size for k, size in told.items() if k != PAC2002} or told
    best = min(others.values())
    return next(kind for kind in SIMPLE_FIRST if kind in others and others[kind] <= best + CLEARLY)


def _why(fits: Sequence[TyreFit], chosen: TyreKind) -> str:
    by_kind = {fit.kind: fit for fit in fits}
    others = [kind for kind in by_kind if kind != chosen]
    if not others:
        return "the only kind that was fitted"
    best = by_kind[chosen].criterion
    told = ", ".join(f"{_in_a_sentence(kind)} {by_kind[kind].criterion - best:+.0f}" for kind in others)
    aside = "; PAC2002 goes on only where it alone is asked for, and stands beside it for `ident export`"
    least = f"its information criterion is the least, or the simplest near it: {told} against it"
    return least + (aside if PAC2002 in by_kind else "")


def _result(
    loaded: LoadedLogs,
    context: Context,
    data: TyreData,
    fits: Sequence[TyreFit],
    chosen: TyreKind,
    found: KindFit,
    known: Uncertainty,
) -> TyresResult:
    own = next(fit for fit in fits if fit.kind == chosen)
    agreement = run_agreement(found.fit)
    return TyresResult(
        schema_version=SCHEMA_VERSION,
        provenance=provenance(context, loaded),
        verdict=_verdict(own, found),
        next_step=_next_step(own, data),
        fits=list(fits),
        chosen=chosen,
        why=_why(fits, chosen),
        excited=own.excited,
        understeer_gradient=own.understeer_gradient,
        characteristic_speed=own.characteristic_speed,
        nuisance=nuisance(data, found, known.covariance),
        fixed=fixed_values(data),
        noise=_noise(found, data.floor),
        by_run=_by_run(data, found, agreement),
        agreement_p=min(1.0, min(one.p for one in agreement) * len(agreement))
        if len(agreement) > 1
        else None,
        speed=_range(found.problem.windows.inputs[:, 1]),
        lateral_acceleration=_range(_acceleration(found)),
        samples=sum(one.residual.size for one in found.fit.point.residuals.values()),
        runs=[run.health for run in loaded.runs],
        refused=[*data.left_out, *_refused(own), *loaded.unreadable],
        warnings=[
            *loaded.warnings,
            *data.warnings,
            *told_reference(found, known.covariance),
            *own.warnings,
            *_disagreeing(data, found, agreement),
        ],
    )


def _verdict(own: TyreFit, found: KindFit) -> str:
    parts = [f"{axle} {_kilo(getattr(own, axle)['cornering_stiffness'])}" for axle in AXLES]
    name = "yaw_rate" if "yaw_rate" in own.rms else next(iter(own.rms), None)
    rms = "" if name is None else f"; {name.replace('_', ' ')} to {_size(own.rms[name], UNITS[name])} (rms)"
    rest = ", more than its noise: the model lacks something" if found.fit.is_coloured else ""
    stiffness = f"{NAMES[own.kind]} axles, stiffness {', '.join(parts)} kN/rad"
    return f"{stiffness}; {_handling(own.understeer_gradient)}{rms}{rest}"


def _kilo(one: Estimate) -> str:
    if one.value is None or one.std is None:
        return "unknown"
    return f"{one.value / 1e3:.4g} ± {1.96 * one.std / 1e3:.2g}"


def _size(value: float, unit: str) -> str:
    """An error as it is read: angles in mrad, powers raised."""
    factor, shown = (1e3, f"m{unit}") if unit.startswith("rad") else (1.0, unit.replace("^2", "²"))
    return f"{factor * value:.2g} {shown}"


def _handling(gradient: Estimate) -> str:
    if gradient.value is None or gradient.std is None:
        return "understeer unknown"
    value, half = 1e3 * gradient.value, 1.96e3 * gradient.std
    if abs(value) < half:
        return f"neutral within its error ({value:.2g} ± {half:.2g} mrad/(m/s²))"
    kind = "understeers" if value > 0 else "oversteers"
    return f"{kind} by {abs(value):.3g} ± {half:.2g} mrad/(m/s²)"


def _next_step(own: TyreFit, data: TyreData) -> str | None:
    """Say what would tell the parameters that the data do not."""
    estimates = {
        **{f"front {k}": v for k, v in own.front.items()},
        **{f"rear {k}": v for k, v in own.rear.items()},
        "yaw inertia": own.yaw_inertia,
    }
    open_ones = [name.replace("_", " ") for name, one in estimates.items() if one.status != "identified"]
    if "mass" not in data.vehicle.std:
        mass = "state how well the mass is known in vehicle.yaml (mass: 12500 kg ± 300 kg)"
    else:
        mass = ""
    drive = f"to know {', '.join(open_ones[:4])}: drive harder" if open_ones else ""
    return "; ".join(part for part in (drive, mass) if part) or None


def _refused(own: TyreFit) -> list[Refusal]:
    told = {f"front.{k}": v for k, v in own.front.items()} | {f"rear.{k}": v for k, v in own.rear.items()}
    told["yaw_inertia"] = own.yaw_inertia
    return [
        Refusal(name, one.reason or "not identifiable")
        for name, one in told.items()
        if one.status == "not_identifiable"
    ]


def _disagreeing(data: TyreData, found: KindFit, agreement: Sequence[RunAgreement]) -> list[str]:
    """Name the runs that differ for certain, and by more than what is of no consequence."""
    told = []
    for run, one in zip(data.runs, agreement, strict=True):
        shift = _shift(found, one)
        if len(agreement) > 1 and one.p * len(agreement) < DISAGREES and shift > PRACTICAL:
            told.append(
                f"{run.name}: alone it would move stiffness or yaw inertia by {100 * shift:.0f} % (p = "
                f"{one.p:.1g}): another load, another vehicle, or something that the model lacks"
            )
    return told


def _noise(found: KindFit, floor: Mapping[str, float]) -> dict[str, ResidualNoise]:
    """Noise of each signal; where something is left that is none, the weights of the fit are not its size."""
    made = {}
    fit = found.fit
    noises = noise_of_residuals(fit.point, floor) if fit.is_coloured else fit.point.noise
    for name, one in fit.point.residuals.items():
        noise = noises[name]
        shape = noise.shape
        coefficients = shape.coefficients.tolist() if isinstance(shape, AutoRegression) else []
        total = float(np.sqrt(np.mean(one.residual**2))) if fit.is_coloured else noise.total_std
        slow = name in fit.slow
        made[name] = ResidualNoise(UNITS[name], noise.std, total, coefficients, one.samples.period, slow)
    return made


def _by_run(data: TyreData, found: KindFit, agreement: Sequence[RunAgreement]) -> list[TyreRun]:
    windows, acceleration = found.problem.windows, _acceleration(found)
    lengths = np.diff(windows.offsets)
    of_grid = np.repeat(windows.run, lengths)
    made = []
    for number, run in enumerate(data.runs):
        own = of_grid == number
        seconds = sum(float(r.times[-1] - r.times[0]) for r in windows.records if r.run == number)
        made.append(
            TyreRun(
                run=run.name,
                windows=int(np.count_nonzero(windows.run == number)),
                seconds=seconds,
                speed=_range(windows.inputs[own, 1]),
                lateral_acceleration=_range(acceleration[own]),
                rms=_rms_of_run(found, number),
                reference_x=found.parameters.get("reference_x", run.reference_x),
                spans=[[float(r.times[0]), float(r.times[-1])] for r in data.records if r.run == number],
                agreement_p=agreement[number].p if len(agreement) > 1 else None,
            )
        )
    return made


def _rms_of_run(found: KindFit, number: int) -> dict[str, float]:
    made = {}
    for name, one in found.fit.point.residuals.items():
        own = found.problem.windows.run[one.samples.window] == number
        if own.any():
            made[name] = float(np.sqrt(np.mean(one.residual[own] ** 2)))
    return made


def _acceleration(found: KindFit) -> Array:
    """(N,) lateral acceleration of the model at the CG, from the forces of its axles [m/s²]."""
    point, engine = found.fit.point, found.problem.engine
    outputs = point.outputs
    total = np.zeros(len(outputs))
    for axle in AXLES:
        total += outputs[:, engine.outputs.index(f"{axle}_lateral_force")]
    return np.asarray(total / found.body.mass)


def _range(values: Array) -> list[float]:
    return [float(values.min()), float(values.max())]
