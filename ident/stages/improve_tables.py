"""Tables of the improvement: measured, before and after along each run, and where the added effect acts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.estimation.improvement import Improvement
from ident.estimation.layer import HeldOut, Layer
from ident.results import ErrorComparison, Regressor
from ident.signals.run import LoadedLogs, Run

Array = NDArray[np.float64]

RATE = 25.0  # [1/s] of the rows
GAP = 0.3  # [s] between samples, above which nothing is drawn
EXPLAINS = {
    "road_wheel_angle": ("steering angle", "rad"),
    "steering_wheel_angle": ("steering wheel angle", "rad"),
    "steering_rate": ("rate of the steering angle", "rad/s"),
    "yaw_rate": ("yaw rate", "rad/s"),
    "lateral_acceleration": ("lateral acceleration", "m/s^2"),
    "acceleration_rate": ("rate of the lateral acceleration", "m/s^3"),
    "speed": ("speed", "m/s"),
    "heading": ("heading", "rad"),
}
BINS = 20


def improve_table(found: Improvement, loaded: LoadedLogs) -> pd.DataFrame:
    """One row a time of each run and layer, see :mod:`ident.report.improved`."""
    frames = []
    for name, layer in found.layers.items():
        before = layer.held_out(found.base[name], layer.runs)
        after = before if not found.fits[name].keys else layer.held_out(found.fits[name], layer.runs)
        for number, run in enumerate(layer.runs):
            frames.append(_of_run(name, layer, number, run, before, after, loaded))
    frames = [frame for frame in frames if len(frame)]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame({"run": [], "time": []})


def _of_run(
    name: str, layer: Layer, number: int, run: str, before: HeldOut, after: HeldOut, loaded: LoadedLogs
) -> pd.DataFrame:
    del layer
    stamps = {s: before.time[s][before.run[s] == number] for s in before.errors}
    begin = min((t.min() for t in stamps.values() if t.size), default=0.0)
    end = max((t.max() for t in stamps.values() if t.size), default=-1.0)
    times = np.arange(begin, end, 1 / RATE)
    made: dict[str, object] = {"run": run, "time": times, "layer": name}
    for signal, own in stamps.items():
        here = before.run[signal] == number
        for way, held in (("before", before), ("after", after)):
            made[f"{signal}_{way}"] = _at(times, own, held.modelled[signal][here])
        made[f"{signal}_measured"] = _at(
            times, own, before.modelled[signal][here] + before.errors[signal][here]
        )
    source = next((one for one in loaded.runs if one.name == run), None)
    made |= {f"by_{key}": values for key, values in _explaining(source, times).items()}
    return pd.DataFrame(made)


def _at(times: Array, stamps: Array, values: Array) -> Array:
    """Values at times, NaN where no sample is near."""
    if stamps.size < 2:
        return np.full(times.size, np.nan)
    order = np.argsort(stamps)
    stamps, values = stamps[order], values[order]
    made = np.interp(times, stamps, values, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(stamps, times), 1, stamps.size - 1)
    made[stamps[after] - stamps[after - 1] > GAP] = np.nan
    return made


def _explaining(run: Run | None, times: Array) -> dict[str, Array]:
    """Variables on which a residual may hang."""
    made: dict[str, Array] = {}
    if run is None:
        return made
    for name in (
        "road_wheel_angle",
        "steering_wheel_angle",
        "yaw_rate",
        "lateral_acceleration",
        "speed",
        "heading",
    ):
        if name in run.signals:
            signal = run.signals[name]
            known = signal.values  # noqa: PD011
            good = np.isfinite(known)
            made[name] = np.interp(times, signal.time[good], known[good])
    angle = made.get("road_wheel_angle", made.get("steering_wheel_angle"))
    if angle is not None and times.size > 2:
        made["steering_rate"] = np.gradient(_smooth(angle), times)
    if "lateral_acceleration" in made and times.size > 2:
        made["acceleration_rate"] = np.gradient(_smooth(made["lateral_acceleration"]), times)
    return made


def _smooth(values: Array) -> Array:
    kernel = np.ones(9) / 9
    return np.convolve(np.pad(values, 4, mode="edge"), kernel, mode="valid")


def with_regressor(
    table: pd.DataFrame, error: ErrorComparison, added: Sequence[str]
) -> tuple[pd.DataFrame, Regressor | None]:
    """Choose the signal that the effects change most and the variable that explains its residual best."""
    plain = [column for column in table.columns if not column.startswith("by_")]
    if not added:
        return table[plain], None
    direct = [name for name in error.before if not name.startswith(("position", "heading"))]
    signal = max(direct or list(error.before), key=lambda name: _gained(error, name))
    residual = (table[f"{signal}_measured"] - table[f"{signal}_before"]).to_numpy(dtype=float)
    shares = {name: _explained(table[f"by_{name}"].to_numpy(dtype=float), residual) for name in _there(table)}
    best = max(shares, key=lambda name: shares[name], default=None)
    moved = (table[f"{signal}_after"] - table[f"{signal}_before"]).abs().to_numpy(dtype=float)
    top = np.nanquantile(moved, 0.995) if np.isfinite(moved).any() else 0.0
    made = table[plain].assign(activity=np.clip(moved / top, 0.0, 1.0) if top > 0 else 0.0)
    if best is None:
        return made, None
    made = made.assign(regressor=table[f"by_{best}"])
    return made, Regressor(EXPLAINS[best][0], EXPLAINS[best][1], signal)


def _there(table: pd.DataFrame) -> list[str]:
    return [name for name in EXPLAINS if f"by_{name}" in table.columns]


def _gained(error: ErrorComparison, name: str) -> float:
    """How much of the error over noise goes."""
    noise = max(error.noise.get(name, 0.0), 1e-12)
    return (error.before[name].value - error.after[name].value) / noise


def _explained(variable: Array, residual: Array) -> float:
    """Share of a residual's variance that its means over bins of a variable hold."""
    good = np.isfinite(variable) & np.isfinite(residual)
    if np.count_nonzero(good) < 10 * BINS or np.ptp(variable[good]) == 0:
        return 0.0
    variable, residual = variable[good], residual[good]
    edges = np.quantile(variable, np.linspace(0, 1, BINS + 1)[1:-1])
    where = np.searchsorted(edges, variable)
    count = np.bincount(where, minlength=BINS)
    mean = np.bincount(where, residual, minlength=BINS) / np.maximum(count, 1)
    return float(
        np.sum(count * (mean - residual.mean()) ** 2) / max(np.sum((residual - residual.mean()) ** 2), 1e-300)
    )
