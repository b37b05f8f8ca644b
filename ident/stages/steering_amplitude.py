"""Does the steering depend on how far it is turned? The steps and pulses of each size, fitted alone.

A linear actuator has the same gain, dead time and lags at every amplitude. Each size gets its own maximum
likelihood, and Cochran's Q tells whether the differences are larger than the errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.actuator_fit import ActuatorFit, agreement, fit_actuator, steering_model
from ident.estimation.actuator_likelihood import BIAS, ActuatorRecord
from ident.estimation.actuator_runs import RunsFit
from ident.experiments.found import Found
from ident.experiments.steering_data import SteeringRun
from ident.experiments.stretches import Stretch
from ident.results import AmplitudeFit

SAME_SIZE = 0.05  # relative
SEEN_BEFORE = 0.5  # [s] of the answer before a step
KNOWN_BEFORE = 3.0  # [s] of commands before that
FEWEST_SAMPLES = 20


def amplitude_fits(data: Sequence[SteeringRun], fit: RunsFit) -> tuple[list[AmplitudeFit], float | None]:
    """One fit a size of step, by rising size, and the p-value of the hypothesis that all are the same.

    The p-value is None below two sizes.
    """
    sizes = _by_size([run for run in data if run.name in fit.used])
    fitted = []
    for size, records in sizes:
        try:
            own = fit_actuator(
                records, start=_start(fit, records), shape=fit.common.fit.noise.shape, jitter=0.0
            )
        except NotIdentifiable:
            continue
        fitted.append((size, len(records), own))
    listed = [_listed(size, steps, own) for size, steps, own in fitted]
    return listed, agreement([own for _, _, own in fitted])


def _start(fit: RunsFit, records: Sequence[ActuatorRecord]) -> NDArray[np.float64]:
    biases = np.zeros(1 + max(record.run for record in records))
    return np.append(fit.common.fit.shared[:BIAS], biases)


def _listed(size: float, steps: int, own: ActuatorFit) -> AmplitudeFit:
    model = steering_model(own.fit)
    return AmplitudeFit(
        amplitude=size,
        steps=steps,
        gain=model.gain,
        dead_time=model.dead_time,
        time_constant_1=model.time_constant_1,
        time_constant_2=model.time_constant_2,
        total_lag=model.total_lag,
    )


def _by_size(data: Sequence[SteeringRun]) -> list[tuple[float, list[ActuatorRecord]]]:
    """Records of the steps of each size, with the size, rising; runs are numbered anew within a size."""
    steps = sorted(
        (
            (abs(one.amplitude), run.name, stretch, one)
            for run in data
            for stretch, found in zip(run.stretches, run.experiments, strict=True)
            for one in found
            if one.kind in ("step", "pulse") and one.level_before is not None and not one.start_uncertainty
        ),
        key=lambda step: step[:2],
    )
    groups: list[list[tuple[float, str, Stretch, Found]]] = []
    for step in steps:
        if groups and step[0] <= groups[-1][0][0] * (1 + SAME_SIZE):
            groups[-1].append(step)
        else:
            groups.append([step])
    sized = []
    for group in groups:
        names = sorted({name for _, name, _, _ in group})
        records = [_record(stretch, one, names.index(name)) for _, name, stretch, one in group]
        kept = [record for record in records if record is not None]
        if kept:
            sized.append((float(np.median([size for size, *_ in group])), _renumbered(kept)))
    return sized


def _renumbered(records: list[ActuatorRecord]) -> list[ActuatorRecord]:
    """Records with their runs numbered without a hole."""
    runs = sorted({record.run for record in records})
    return [replace(record, run=runs.index(record.run)) for record in records]


def _record(stretch: Stretch, found: Found, run: int) -> ActuatorRecord | None:
    """Cut out the part of a stretch about one step, with the commands that still act in it."""
    seen = (stretch.times >= found.start - min(SEEN_BEFORE, found.hold_before)) & (
        stretch.times < found.end_time
    )
    known = (stretch.command_times >= found.start - SEEN_BEFORE - KNOWN_BEFORE) & (
        stretch.command_times < found.end_time
    )
    if seen.sum() < FEWEST_SAMPLES or not known.any():
        return None
    first = int(np.flatnonzero(seen)[0])
    starts = np.unique(np.append(0, stretch.starts[stretch.starts > first] - first))
    lost = stretch.lost - int(np.flatnonzero(known)[0])
    return ActuatorRecord(
        run=run,
        command_times=stretch.command_times[known],
        command_values=stretch.command_values[known],
        times=stretch.times[seen],
        measured=stretch.measured[seen],
        starts=starts[starts < seen.sum()].astype(np.intp),
        lost=lost[(lost > 0) & (lost < known.sum())].astype(np.intp),
    )
