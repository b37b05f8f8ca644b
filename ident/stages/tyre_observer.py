"""Axle forces observed from the motion of the tyre stage, and how they stand beside the force inversion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.force_observer import LEVEL, ObservedForces, observe_forces, white_variance
from ident.estimation.force_system import MEASURED
from ident.estimation.noise import NoiseModel
from ident.estimation.noise_band import noise_above_the_motion
from ident.estimation.tyre_fit import KindFit
from ident.estimation.vehicle_records import MotionRecord
from ident.glossary import AXLES
from ident.results import ForceObserver
from ident.stages.tyre_data import TyreData

Array = NDArray[np.float64]

FROM_FIT = "the fit of the tyres, which leaves nothing but noise"
FROM_BAND = "what the sensors read at 4 to 8 Hz, because the fit leaves more than noise"
FEWEST = 100  # instants with measured wheel forces


def observe(
    data: TyreData, found: KindFit, forces: pd.DataFrame
) -> tuple[pd.DataFrame, ForceObserver | None, list[str]]:
    """Observe the forces with yaw inertia, offset and biases of the fit.

    Parameters
    ----------
    forces : table ``tyre_forces``

    Returns
    -------
    forces, observer, warnings : the table with the columns observed_force and observed_std [N], NaN where
        nothing is observed; what is told of it; what is wrong with it, in words
    """
    noise = _noise(data, found)
    try:
        observed = observe_forces(
            _records(data, found),
            found.body,
            noise,
            yaw_inertia=found.parameters["yaw_inertia"],
            bias=_biases(data, found),
        )
    except NotIdentifiable as error:
        nothing = forces.assign(observed_force=np.nan, observed_std=np.nan)
        return nothing, None, [f"no observed axle forces: {error}"]
    table = _beside(forces, observed, {run.name: number for number, run in enumerate(data.runs)})
    if table["observed_force"].isna().all():
        return (
            table,
            None,
            ["no observed axle forces: no instant at which the force inversion tells them, too"],
        )
    told = _told(observed, noise, table, FROM_BAND if found.fit.is_coloured else FROM_FIT)
    return table, told, _contradictions(told)


def _noise(data: TyreData, found: KindFit) -> dict[str, NoiseModel]:
    """Of each sensor from the fit, or where that leaves more than noise from the band above the motion."""
    above = noise_above_the_motion(data.records, MEASURED)
    of_fit = {} if found.fit.is_coloured else found.fit.point.noise
    return {name: of_fit.get(name, above[name]) for name in MEASURED if name in above}


def _records(data: TyreData, found: KindFit) -> list[MotionRecord]:
    place = found.parameters.get("reference_x")
    return [one if place is None else replace(one, reference_x=place) for one in data.records]


def _biases(data: TyreData, found: KindFit) -> dict[int, dict[str, float]]:
    terms = [term.name for term in found.problem.run_terms]
    offset = found.parameters["steering_offset"]
    of_runs = found.fit.point.of_runs
    return {
        number: dict(zip(terms, of_runs[number].tolist(), strict=True)) | {"steering_offset": offset}
        for number in range(len(data.runs))
    }


def _beside(forces: pd.DataFrame, observed: ObservedForces, numbers: Mapping[str, int]) -> pd.DataFrame:
    """The table with what is observed at the same instants."""
    force, std = (np.full(len(forces), np.nan) for _ in range(2))
    names, axles = forces["run"].astype(str).to_numpy(), forces["axle"].astype(str).to_numpy()
    for name, number in numbers.items():
        own = np.flatnonzero(observed.run == number)
        if not own.size:
            continue
        for column, axle in enumerate(AXLES):
            rows = np.flatnonzero((names == name) & (axles == axle))
            place = _nearest(observed.times[own], forces["time"].to_numpy(np.float64)[rows])
            force[rows[place >= 0]] = observed.forces[own[place[place >= 0]], column]
            std[rows[place >= 0]] = observed.force_std[own[place[place >= 0]], column]
    return forces.assign(observed_force=force, observed_std=std)


def _nearest(grid: Array, times: Array) -> NDArray[np.intp]:
    """Place of each time on a grid that rises, -1 where it is not on it."""
    place = np.clip(np.searchsorted(grid, times - 1e-6), 0, grid.size - 1)
    return np.where(np.abs(grid[place] - times) < 1e-5, place, -1).astype(np.intp)


def _told(
    observed: ObservedForces, noise: Mapping[str, NoiseModel], table: pd.DataFrame, source: str
) -> ForceObserver:
    seen = table[table["observed_force"].notna()]
    of_axles = {axle: seen[seen["axle"] == axle] for axle in AXLES}
    wheels = {axle: rows[rows["measured_force"].notna()] for axle, rows in of_axles.items()}
    return ForceObserver(
        rate=observed.rate,
        noise={name: float(np.sqrt(white_variance(one))) for name, one in noise.items()},
        noise_from=source,
        half_width={axle: LEVEL * float(rows["observed_std"].median()) for axle, rows in of_axles.items()},
        from_inversion={
            axle: _rms(rows["observed_force"] - rows["force"]) for axle, rows in of_axles.items()
        },
        from_wheels={
            axle: {
                "observer": _rms(rows["observed_force"] - rows["measured_force"]),
                "inversion": _rms(rows["force"] - rows["measured_force"]),
            }
            for axle, rows in wheels.items()
            if len(rows) >= FEWEST
        },
        innovations={name: [one.mean, one.low, one.high] for name, one in observed.consistency.items()},
    )


def _rms(error: pd.Series[float]) -> float:
    return float(np.sqrt(np.mean(np.square(error.to_numpy(np.float64)))))


def _contradictions(told: ForceObserver) -> list[str]:
    """Name the signals that do not fit the others, or a noise that is larger than it was taken for."""
    wrong = [name for name, (mean, _, high) in told.innovations.items() if mean > 2 * high]
    if not wrong:
        return []
    parts = ", ".join(f"{name.replace('_', ' ')} {told.innovations[name][0]:.1f}" for name in wrong)
    needed = "need about 1: these signals contradict the others or are noisier than taken for"
    why = f"squared innovations over their variance are {parts}, {needed}"
    return [f"observed axle forces: {why}, and the bands are too narrow"]
