"""Identify the steering dynamics: the transfer function (2.25) from request to measured angle.

All excitation of all runs goes into one maximum-likelihood fit on the raw stamps; the step methods stand
beside it. Every run is also fitted alone and the fits are compared: a parameter that depends on how the
actuator was excited is a nonlinearity that the linear model cannot have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from ident.errors import NotIdentifiable
from ident.estimation.actuator_fit import classify, doubted, joint_covariance, steering_model
from ident.estimation.actuator_likelihood import ActuatorRecord
from ident.estimation.actuator_runs import RunRecords, RunsFit, identify_runs
from ident.estimation.actuator_verdict import judge, run_fits
from ident.estimation.noise import AutoRegression, ContinuousAr1
from ident.experiments.steering_data import SteeringRun, choose_pair, steering_run, why_not_excited
from ident.experiments.stretches import Stretch, jitter_of, period_of
from ident.glossary import STEERING_PAIRS
from ident.results import (
    SCHEMA_VERSION,
    Estimate,
    Experiment,
    Noise,
    Pair,
    Provenance,
    Refusal,
    SteeringModel,
    SteeringResult,
)
from ident.signals.run import LoadedLogs
from ident.stages.inputs import InputSettings, load, provenance
from ident.stages.output import Context, StageOutput
from ident.stages.steering_amplitude import amplitude_fits
from ident.stages.steering_experiments import list_experiments
from ident.stages.steering_frequency import with_frequency_response
from ident.stages.steering_ratio import ratio_map
from ident.stages.steering_tables import steering_tables
from ident.stages.steering_vehicle import runs_of_one_vehicle

DEGREES = 180 / np.pi
NEAR_DEGREES = 0.2


class SteeringSettings(BaseModel):
    """Settings of this stage.

    pair : whether to identify the steering wheel's or the road wheel's actuator; None: the one that
        most runs have
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    pair: Pair | None = None


def steering(
    logs: Sequence[Path], inputs: InputSettings, settings: SteeringSettings, context: Context
) -> StageOutput[SteeringResult]:
    """Identify the steering dynamics from the runs under LOGS, all of one vehicle.

    Raises
    ------
    UnusableLog
        If there is no log that can be read.
    NotIdentifiable
        If no run has a request with its measured angle, if no request changes, or if the measured angle does
        not follow it.
    """
    everything = load(logs, inputs, context)
    alike, others = runs_of_one_vehicle(everything.runs, settings.pair)
    loaded = replace(everything, runs=alike)
    pair = settings.pair or choose_pair(loaded.runs)
    data, left_out = _excited(loaded, pair)
    if not data:
        reasons = sorted({refusal.reason for refusal in left_out})
        raise NotIdentifiable(
            f"no run excites the steering: {'; '.join(reasons)}: drive steps, pulses or sines by the request"
        )
    total = len(data) + 1
    context.progress("identify the steering", 0, total)
    fit = identify_runs(
        [_records(run) for run in data],
        progress=lambda done, of: context.progress("identify the steering", done, of),
    )
    model = steering_model(fit.common.fit)
    _refuse_wrong_unit(model.gain, pair)
    made_from = provenance(context, everything)
    result = _result(loaded, made_from, pair, data, [*left_out, *others], fit, model)
    result = _with_ratio(result, loaded, inputs)
    result = with_frequency_response(result, data, fit)
    part = _model_part(result, fit, data)
    return StageOutput(result, steering_tables(data, fit, result.experiments), part)


def _excited(loaded: LoadedLogs, pair: Pair) -> tuple[list[SteeringRun], list[Refusal]]:
    """Runs with excitation, and why the others have none."""
    data, left_out = [], []
    for run in loaded.runs:
        found = steering_run(run, pair)
        if isinstance(found, str):
            left_out.append(Refusal(run.name, found))
        elif not found.excited:
            left_out.append(Refusal(run.name, why_not_excited(found)))
        else:
            data.append(found)
    return data, left_out


def _records(run: SteeringRun) -> RunRecords:
    records = [actuator_record(run.stretches[i]) for i in run.excited]
    return RunRecords(run.name, records, jitter_of(run.measured.time))


def actuator_record(stretch: Stretch) -> ActuatorRecord:
    """What the likelihood needs of a stretch."""
    return ActuatorRecord(
        run=0,
        command_times=stretch.command_times,
        command_values=stretch.command_values,
        times=stretch.times,
        measured=stretch.measured,
        starts=stretch.starts,
        lost=stretch.lost,
        start_uncertainty=stretch.command_period / np.sqrt(3),
        rest_rate=stretch.rest_rate,
    )


def _refuse_wrong_unit(gain: Estimate, pair: Pair) -> None:
    """A gain of 57 or 1/57 is no gain but a unit."""
    if gain.value is None:
        return
    request, measured = STEERING_PAIRS[pair]
    for factor, name in ((DEGREES, measured), (1 / DEGREES, request)):
        if abs(gain.value / factor - 1) < NEAR_DEGREES:
            raise NotIdentifiable(
                f"gain {gain.value:.4g}, near {factor:.4g}: {name} seems to be in degrees, and its unit "
                f"says rad: set unit: deg for {name} in channels.yaml"
            )


def _result(
    loaded: LoadedLogs,
    made_from: Provenance,
    pair: Pair,
    data: Sequence[SteeringRun],
    left_out: Sequence[Refusal],
    fit: RunsFit,
    model: SteeringModel,
) -> SteeringResult:
    shape, why = classify(fit.common.fit)
    by_amplitude, amplitude_p = amplitude_fits(data, fit)
    judgement = judge(fit, model, shape, by_amplitude, amplitude_p)
    experiments, step_methods = list_experiments(data, fit)
    excitation = {run.name: _kinds(run.name, experiments) for run in data}
    return SteeringResult(
        schema_version=SCHEMA_VERSION,
        provenance=made_from,
        verdict=judgement.verdict,
        next_step=judgement.next_step,
        pair=pair,
        model=model if judgement.adequate else doubted(model),
        classification=shape,
        classification_reason=why,
        adequate=judgement.adequate,
        agreement_p=judgement.agreement_p,
        rms_error=fit.common.rms,
        vaf=fit.common.vaf,
        samples=fit.common.samples,
        noise=_noise(loaded, pair, data, fit),
        step_methods=step_methods,
        by_run=run_fits(fit, excitation),
        experiments=experiments,
        runs=[run.health for run in loaded.runs],
        refused=[*_refused(model), *left_out, *loaded.unreadable],
        by_amplitude=by_amplitude,
        amplitude_p=amplitude_p,
        warnings=[*loaded.warnings, *_warnings(fit, adequate=judgement.adequate)],
    )


def _with_ratio(result: SteeringResult, loaded: LoadedLogs, inputs: InputSettings) -> SteeringResult:
    table, source, refused = ratio_map(loaded.runs, inputs.align)
    return replace(result, ratio=table, ratio_source=source, refused=[*result.refused, *refused])


def _kinds(run: str, experiments: Sequence[Experiment]) -> list[str]:
    return sorted({one.kind for one in experiments if one.run == run})


def _refused(model: SteeringModel) -> list[Refusal]:
    parts = ("gain", "dead_time", "time_constant_1", "time_constant_2")
    estimates = {name: getattr(model, name) for name in parts}
    return [
        Refusal(name, estimate.reason or "not identifiable")
        for name, estimate in estimates.items()
        if estimate.status == "not_identifiable"
    ]


def _warnings(fit: RunsFit, *, adequate: bool) -> list[str]:
    told = [f"{run}: left out of the common fit: {reason}" for run, reason in fit.excluded.items()]
    told += [
        f"{one.run}: its part {one.record + 1} begins {1e3 * one.early:.0f} ms after the request had changed"
        for one in fit.hidden
    ]
    if not fit.common.fit.converged:
        told.append("the fit has not converged: its errors are not to be trusted")
    dead_time, spread = fit.common.fit.shared[1], np.sqrt(fit.common.fit.covariance[1, 1])
    if adequate and dead_time < -2 * spread:
        told.append(
            f"the dead time is negative ({1e3 * dead_time:.0f} ms): the measured angle leads its request; "
            "the two are stamped by different clocks"
        )
    return told


def _noise(loaded: LoadedLogs, pair: Pair, data: Sequence[SteeringRun], fit: RunsFit) -> Noise:
    noise = fit.common.fit.noise
    measured = STEERING_PAIRS[pair][1]
    steps = [run.health.signals[measured].resolution for run in loaded.runs if measured in run.health.signals]
    known = [step for step in steps if step is not None]
    quantisation = min(known) if known else None
    if isinstance(noise.shape, ContinuousAr1):
        return Noise(
            "continuous_ar1", noise.std, noise.total_std, [], noise.shape.correlation_time, quantisation
        )
    if not isinstance(noise.shape, AutoRegression):
        raise TypeError(f"unknown noise {noise.shape}")
    period = float(np.median([period_of(run.measured.time) for run in data]))
    return Noise(
        kind="ar",
        std=noise.std,
        total_std=noise.total_std,
        ar=[float(a) for a in noise.shape.coefficients],
        correlation_time=noise.shape.lasts(period),
        quantisation=quantisation,
    )


def _model_part(result: SteeringResult, fit: RunsFit, data: Sequence[SteeringRun]) -> Mapping[str, Any]:
    """Return the part of ``model.yaml`` that this stage knows."""
    names, covariance = joint_covariance(fit.common.fit)
    estimates = {name: getattr(result.model, name) for name in SteeringModel.__dataclass_fields__}
    kept = ("value", "std", "unit")
    values = {name: {key: asdict(one)[key] for key in kept} for name, one in estimates.items()}
    noise: dict[str, Any] = {"std": result.noise.std, "ar": result.noise.ar}
    if result.noise.kind == "ar":
        noise["sample_period"] = float(np.median([period_of(run.measured.time) for run in data]))
    else:
        noise["correlation_time"] = result.noise.correlation_time
    return {
        "steering": {**values, "pair": result.pair, "ratio": result.ratio or None},
        "noise": {STEERING_PAIRS[result.pair][1]: noise},
        "parameters": names,
        "covariance": [[float(x) for x in row] for row in covariance],
    }
