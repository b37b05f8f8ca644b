"""The tables of the steering stage, from which report and recording are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.estimation.actuator_runs import RunsFit
from ident.experiments.steering_data import SteeringRun
from ident.results import Experiment

Array = NDArray[np.float64]


def steering_tables(
    data: Sequence[SteeringRun], fit: RunsFit, experiments: Sequence[Experiment]
) -> dict[str, pd.DataFrame]:
    """``steering``: every measured sample with what the model says; ``steering_request``: the commands.

    Columns of ``steering``: run, part, time [s since the start of the run], measured [rad], modelled [rad]
    (NaN where the sample is not modelled), residual [rad], experiment (index into ``experiments``, -1 for
    none), used (whether the common fit uses it). Columns of ``steering_request``: run, part, time, request
    [rad], lost (whether the log has lost this command; its value is then a guess).
    """
    modelled = {place: number for number, place in enumerate(fit.places)}
    answers, requests = [], []
    for run in data:
        for part, stretch in enumerate(run.stretches):
            place = (run.name, run.excited.index(part)) if part in run.excited else None
            residual = _residual(stretch.times, modelled.get(place) if place else None, fit)
            answers.append(
                {
                    "run": run.name,
                    "part": part,
                    "time": stretch.times,
                    "measured": stretch.measured,
                    "modelled": stretch.measured - residual,
                    "residual": residual,
                    "experiment": _experiment_of(run.name, stretch.times, experiments),
                    "used": np.isfinite(residual),
                }
            )
            lost = np.zeros(stretch.command_times.size, dtype=bool)
            lost[stretch.lost] = True
            requests.append(
                {
                    "run": run.name,
                    "part": part,
                    "time": stretch.command_times,
                    "request": stretch.command_values,
                    "lost": lost,
                }
            )
    return {"steering": _table(answers), "steering_request": _table(requests)}


def _table(parts: Sequence[Mapping[str, object]]) -> pd.DataFrame:
    return pd.concat([pd.DataFrame(dict(part)) for part in parts], ignore_index=True)


def _residual(times: Array, number: int | None, fit: RunsFit) -> Array:
    """Residual at each sample of a stretch, NaN where the fit does not use it."""
    residual = np.full(times.size, np.nan)
    if number is not None:
        own = fit.common.fit.residuals[number]
        residual[times.size - own.size :] = own
    return residual


def _experiment_of(run: str, times: Array, experiments: Sequence[Experiment]) -> NDArray[np.int32]:
    index = np.full(times.size, -1, dtype=np.int32)
    for number, one in enumerate(experiments):
        if one.run == run:
            index[(times >= one.start) & (times < one.end)] = number
    return index
