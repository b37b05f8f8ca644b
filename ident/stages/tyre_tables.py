"""Tables of the tyre stage: measured and modelled motion on the grid, and points of the force inversion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.estimation.force_inversion import ForcePoints, invert_forces
from ident.estimation.tyre_fit import MISALIGNED, WINDOW, KindFit
from ident.estimation.vehicle_records import GAP, MotionRecord, Samples, Windows, cut
from ident.glossary import AXLES
from ident.signals.run import Run
from ident.stages.tyre_data import TyreData

Array = NDArray[np.float64]

SIGNALS = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")
SHOWN = ("front_slip_angle", "rear_slip_angle", "front_lateral_force", "rear_lateral_force")


def tyre_tables(data: TyreData, found: KindFit, runs: list[Run]) -> dict[str, pd.DataFrame]:
    """Tables ``tyres`` and ``tyre_forces``."""
    return {"tyres": _motion(data, found), "tyre_forces": _forces(data, found, runs)}


def _motion(data: TyreData, found: KindFit) -> pd.DataFrame:
    """One row a grid point: inputs, measured and modelled signals, slip angles and forces of the model."""
    point, problem = found.fit.point, found.problem
    outputs = point.outputs
    columns = dict(zip(problem.engine.outputs, outputs.T, strict=True))
    windows = problem.windows
    lengths = np.diff(windows.offsets)
    run = np.repeat(windows.run, lengths)
    biases = {term.name: point.of_runs[run, i] for i, term in enumerate(problem.run_terms)}
    table: dict[str, object] = {
        "run": pd.Categorical(np.array([one.name for one in data.runs], dtype=object)[run]),
        "window": np.repeat(np.arange(len(lengths)), lengths),
        "time": windows.times,
    }
    for name in SIGNALS:
        table[name] = measured_on_grid(windows, name)
        table[f"{name}_model"] = columns[name] + biases.get(name, 0.0)
    if MISALIGNED.name in biases:
        table["lateral_velocity_model"] += biases[MISALIGNED.name] * windows.inputs[:, 1]
    table |= {"road_wheel_angle": windows.inputs[:, 0], "speed": windows.inputs[:, 1]}
    return pd.DataFrame(table | {name: columns[name] for name in SHOWN})


def measured_on_grid(windows: Windows, name: str) -> Array:
    """(N,) measured signal on the grid of all windows, NaN where there is none."""
    nothing = Samples(np.zeros(0), np.zeros(0))
    return np.concatenate([_on_grid(r, r.measured.get(name, nothing)) for r in windows.records])


def _on_grid(record: MotionRecord, samples: Samples) -> Array:
    if samples.times.size < 2:
        return np.full(record.times.size, np.nan)
    values = np.interp(record.times, samples.times, samples.values, left=np.nan, right=np.nan)
    period = float(np.median(np.diff(samples.times)))
    after = np.clip(np.searchsorted(samples.times, record.times), 1, samples.times.size - 1)
    apart = samples.times[after] - samples.times[after - 1]
    return np.where(apart > 2 * GAP * max(period, record.period), np.nan, values)


def _forces(data: TyreData, found: KindFit, runs: list[Run]) -> pd.DataFrame:
    """Points of the force inversion with the yaw inertia and the biases of the fit."""
    by_name = {run.name: run for run in runs}
    parts = [
        _of_axle(axle, by_name[run.name], points)
        for number, run in enumerate(data.runs)
        for points in [_points(data, found, number)]
        for axle in AXLES
    ]
    table = pd.concat(parts, ignore_index=True)
    return table.astype({"run": "category", "axle": "category"})


def _points(data: TyreData, found: KindFit, number: int) -> ForcePoints:
    own = [part for record in data.records if record.run == number for part in cut(record, WINDOW)]
    terms = [term.name for term in found.problem.run_terms]
    model = found.parameters
    bias = dict(zip(terms, found.fit.point.of_runs[number].tolist(), strict=True))
    bias["steering_offset"] = model["steering_offset"]
    if "reference_x" in model:
        own = [replace(part, reference_x=model["reference_x"]) for part in own]
    return invert_forces(own, found.body, yaw_inertia=model["yaw_inertia"], bias=bias)


def _of_axle(axle: str, run: Run, points: ForcePoints) -> pd.DataFrame:
    times = points.times[points.valid]
    return pd.DataFrame(
        {
            "run": run.name,
            "time": times,
            "axle": axle,
            "slip_angle": points.slip_angle(axle)[points.valid],
            "force": points.force(axle)[points.valid],
            "lateral_acceleration": points.lateral_acceleration[points.valid],
            "measured_force": _logged_force(run, axle, times),
        }
    )


def _logged_force(run: Run, axle: str, times: Array) -> Array:
    """Sum of the measured lateral forces of both wheels of an axle [N], NaN where they are not logged."""
    names = [f"{axle}_{side}_lateral_force" for side in ("left", "right")]
    if any(name not in run.signals or run.signals[name].raw for name in names):
        return np.full(times.size, np.nan)
    sides = [
        np.interp(times, run.signals[name].time, run.signals[name].values, left=np.nan, right=np.nan)
        for name in names
    ]
    return np.asarray(sides[0] + sides[1])
