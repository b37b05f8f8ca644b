"""The table ``tyres`` as lines to draw: measured and modelled signals of each run, and how far they differ.

The model begins anew at each window, with initial states of its own; its lines are broken there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.report.condense import Array, Line, broken, contiguous
from ident.report.poses import Poses, from_first, poses_of
from ident.results import TyresResult

SIGNALS = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")
DYNAMIC = SIGNALS[:3]
"""Signals that are drawn first: they hold most of what the tyres do."""


class Compared(NamedTuple):
    """One signal of one run."""

    measured: Line
    modelled: Line
    residual: Line


def runs_of(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Split a table into its runs, in its order."""
    return {str(name): rows for name, rows in table.groupby("run", sort=False, observed=True)}


def column(rows: pd.DataFrame, name: str) -> Array:
    """Give a column as numbers, all NaN where there is none."""
    return rows[name].to_numpy(dtype=np.float64) if name in rows else np.full(len(rows), np.nan)


def measured_signals(rows: pd.DataFrame) -> list[str]:
    """Name the signals that were measured at least once."""
    return [name for name in SIGNALS if np.isfinite(column(rows, name)).any()]


def compared(rows: pd.DataFrame, signal: str) -> Compared:
    """Give the lines of one signal of one run, over the time since the start of the run [s]."""
    time, window = column(rows, "time"), column(rows, "window").astype(np.int64)
    measured, modelled = column(rows, signal), column(rows, f"{signal}_model")
    there = np.isfinite(measured)
    stretches = contiguous(time[there], window[there])
    return Compared(
        broken(time[there], measured[there], contiguous(time[there])),
        broken(time, modelled, contiguous(time, window)),
        broken(time[there], (measured - modelled)[there], stretches),
    )


def modelled(rows: pd.DataFrame, name: str) -> Line:
    """Give what the model says of a quantity, or what drives it, broken where it begins anew."""
    time, window = column(rows, "time"), column(rows, "window").astype(np.int64)
    return broken(time, column(rows, name), contiguous(time, window))


def by_agreement(result: TyresResult, runs: Sequence[str]) -> list[str]:
    """Sort runs by how well the model follows them, the best first.

    Compared is the root mean square of each signal in the run over that in all runs, the mean over signals.
    """
    told = {run.run: run.rms for run in result.by_run if run.used}
    common = next((fit.rms for fit in result.fits if fit.kind == result.chosen), {})

    def error(run: str) -> float:
        shares = [value / common[name] for name, value in told[run].items() if common.get(name)]
        return float(np.mean(shares)) if shares else np.inf

    return sorted((run for run in runs if run in told), key=error)


def force_points(table: pd.DataFrame, axle: str) -> dict[str, Array]:
    """Give the points of the force inversion of one axle, those that are finite."""
    rows = table[table["axle"] == axle]
    names = ("slip_angle", "force", "lateral_acceleration", "measured_force")
    found = {name: column(rows, name) for name in names}
    there = np.isfinite(found["slip_angle"]) & np.isfinite(found["force"])
    return {name: values[there] for name, values in found.items()}


def poses(rows: pd.DataFrame) -> dict[str, Poses]:
    """Give where the truck was measured ("measured") and simulated ("modelled"), each where it is known.

    Both are counted from the first place measured, or simulated where none is: positions on a map are
    millions of metres, more than a viewer can draw to the decimetre. Where no position was measured nothing
    tells where a window begins: each is put to the end of the one before.
    """
    ways = {"measured": "", "modelled": "_model"}
    found = {way: pose for way, ending in ways.items() if (pose := _poses(rows, ending)).time.size}
    if not found:
        return {}
    if "measured" not in found:
        found = {way: _joined(pose) for way, pose in found.items()}
    return from_first(found)


def _poses(rows: pd.DataFrame, ending: str) -> Poses:
    """Take the places, with the heading between its own samples, else that of the model, else the course."""
    window = column(rows, "window").astype(np.int64)
    place = (column(rows, f"position_x{ending}"), column(rows, f"position_y{ending}"))
    headings = [column(rows, name) for name in (f"heading{ending}", "heading_model")]
    return poses_of(column(rows, "time"), window, place, headings)


def _joined(pose: Poses) -> Poses:
    """Put each window to the end of the one before."""
    begins = np.flatnonzero(np.diff(pose.window) != 0) + 1
    x, y = (_without_jumps(values, begins) for values in (pose.x, pose.y))
    return pose._replace(x=x, y=y)


def _without_jumps(values: Array, begins: NDArray[np.int_]) -> Array:
    jumps = np.zeros(values.size)
    jumps[begins] = values[begins] - values[begins - 1]
    return np.asarray(values - np.cumsum(jumps))
