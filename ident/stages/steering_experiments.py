"""The experiments of the steering stage: what each is used for, and why it is not used for the rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.errors import NotIdentifiable
from ident.estimation.actuator_runs import RunsFit
from ident.estimation.step_methods import STEP_METHODS, combined
from ident.estimation.step_response import StepModel, StepRecord
from ident.experiments.found import Found
from ident.experiments.steering_data import SteeringRun
from ident.experiments.stretches import Stretch
from ident.results import Experiment, StepFit, StepMethod

LIKELIHOOD = "likelihood"
SHOWN_BEFORE = 0.5  # [s] of rest before a step that a step method sees


def list_experiments(data: Sequence[SteeringRun], fit: RunsFit) -> tuple[list[Experiment], list[StepFit]]:
    """All experiments with their use, and what the step methods give for those that they can use."""
    used: dict[StepMethod, list[tuple[StepRecord, StepModel]]] = {method: [] for method in STEP_METHODS}
    listed = []
    for run in data:
        for number, (stretch, found) in enumerate(zip(run.stretches, run.experiments, strict=True)):
            why_not = _why_not_likelihood(run, number, fit)
            early = _hidden_start(run, number, fit)
            foreign = fit.excluded.get(run.name)
            listed += [
                _experiment(run.name, stretch, _known_start(one, early), why_not, used, foreign)
                for one in found
            ]
    fits = [combined(method, pairs) for method, pairs in used.items()]
    return listed, fits


def _hidden_start(run: SteeringRun, number: int, fit: RunsFit) -> float | None:
    """How much earlier than its first command a stretch's first change was [s], None where it was not."""
    for one in fit.hidden:
        if one.run == run.name and run.excited[one.record] == number:
            return one.early
    return None


def _known_start(found: Found, early: float | None) -> Found:
    """Widen the uncertainty of a step with which a stretch begins, where the fit has found it earlier."""
    if early is None or found.level_before is not None or found.begin != 0:
        return found
    return replace(found, start_uncertainty=max(found.start_uncertainty, early))


def _why_not_likelihood(run: SteeringRun, number: int, fit: RunsFit) -> str | None:
    if run.name in fit.excluded:
        return fit.excluded[run.name]
    if number not in run.excited:
        return "the request is constant"
    if (run.name, run.excited.index(number)) not in fit.places:
        return "too short once the answer to unknown commands before it is left out"
    return None


def _experiment(
    run: str,
    stretch: Stretch,
    found: Found,
    why_not: str | None,
    used: Mapping[StepMethod, list[tuple[StepRecord, StepModel]]],
    foreign: str | None,
) -> Experiment:
    """List one experiment; nothing uses those of a run that is ``foreign`` to the others, for that reason."""
    users = [] if why_not else [LIKELIHOOD]
    rejected = {LIKELIHOOD: why_not} if why_not else {}
    for method, apply in STEP_METHODS.items():
        reason = foreign or _not_a_step(found)
        if reason is None:
            record = _step_record(stretch, found)
            try:
                used[method].append((record, apply(record)))
                users.append(method)
            except NotIdentifiable as error:
                reason = str(error)
        if reason is not None:
            rejected[method] = reason
    if found.kind == "sine" and found.rejected:
        rejected["sine"] = found.rejected
    return Experiment(
        run=run,
        kind="other" if found.kind == "sine" and found.rejected else found.kind,
        start=found.start,
        end=found.end_time,
        start_uncertainty=found.start_uncertainty,
        level_before=found.level_before,
        level_after=found.level_after,
        amplitude=found.amplitude,
        frequency=found.frequency,
        used_by=users,
        rejected=rejected,
    )


def _not_a_step(found: Found) -> str | None:
    if found.kind not in ("step", "pulse"):
        return "a sine, not a step" if found.kind == "sine" else "the request changes all the time: no step"
    if found.level_before is None:
        return "the log begins with it: how long before is not known"
    return None


def _step_record(stretch: Stretch, found: Found) -> StepRecord:
    begin = found.start - min(found.hold_before, SHOWN_BEFORE)
    window = (stretch.times >= begin) & (stretch.times < found.end_time)
    return StepRecord(
        times=np.ascontiguousarray(stretch.times[window] - found.start),
        measured=np.ascontiguousarray(stretch.measured[window]),
        request=found.amplitude,
    )
