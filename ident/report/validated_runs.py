"""The runs of the validation that were opened, as lines to draw: signals, paths, lanes, horizons.

The tables are those of the stage: "validate", "validate_reference", "validate_horizon", "validate_logged".
All of them may be missing or empty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ident.report.condense import Array, Line, evenly, thinned
from ident.report.improved import column
from ident.report.poses import Poses, poses_of
from ident.results.validate import ClosedLoopRun, ValidateResult

Tables = Mapping[str, pd.DataFrame]
SAME_SPEED = 1e-6
"""Set speeds nearer than this are the same [m/s]."""


class Path(NamedTuple):
    """A path by points: (n,) place [m], heading [rad], arc length [m], speed along it [m/s]."""

    x: Array
    y: Array
    heading: Array
    arc_length: Array
    speed: Array


class Start(NamedTuple):
    """Runs of several controllers from one start: their scenario, speed and logged path, and their rows."""

    scenario: str
    speed: float
    logged: str | None
    runs: dict[int, pd.DataFrame]


def opened(result: ValidateResult, tables: Tables) -> dict[int, pd.DataFrame]:
    """Give index of a run -> its rows in time, the worst run first."""
    table = tables.get("validate")
    if table is None or not len(table):
        return {}
    found = {
        index: table[table["run"] == index].sort_values("time", kind="stable")
        for index in sorted({int(run) for run in column(table, "run")})
        if 0 <= index < len(result.runs)
    }
    return dict(sorted(found.items(), key=lambda item: item[0] != result.worst))


def starts(result: ValidateResult, found: Mapping[int, pd.DataFrame]) -> list[Start]:
    """Put runs together that begin in the same way on the same path with the same truck, the worst first.

    found : index of a run -> its rows, as ``opened`` gives them
    """
    together: dict[tuple[object, ...], Start] = {}
    for index, rows in found.items():
        run = result.runs[index]
        start = Start(run.scenario, run.speed, run.scenario_run, {})
        key = (*start[:-1], run.simulation_model, run.seed, *sorted(run.disturbance.items()))
        together.setdefault(key, start).runs[index] = rows
    return list(together.values())


def reference_of(tables: Tables, run: ClosedLoopRun) -> Path | None:
    """Give the path that a run had to follow, None where it is not in the tables."""
    table = tables.get("validate_reference")
    if table is None or not len(table):
        return None
    same = (table["scenario"].astype(str) == run.scenario) & (
        table["run"].astype(str) == (run.scenario_run or "")
    )
    if run.scenario_run is None:
        same &= np.abs(column(table, "set_speed") - run.speed) < SAME_SPEED
    rows = table[same].sort_values("arc_length", kind="stable")
    if not len(rows):
        return None
    return Path(*(column(rows, name) for name in Path._fields))


def lane_edges(path: Path, half_width: float) -> list[Array]:
    """Give the (n, 2) points of the left and of the right edge of the lane about a path."""
    across = np.column_stack([-np.sin(path.heading), np.cos(path.heading)])
    middle = np.column_stack([path.x, path.y])
    return [middle + side * half_width * across for side in (1.0, -1.0)]


def lane_outline(path: Path, half_width: float) -> tuple[Array, Array]:
    """Give x and y of the closed outline of the lane about a path."""
    left, right = lane_edges(path, half_width)
    outline = np.concatenate([left, right[::-1], left[:1]])
    return outline[:, 0], outline[:, 1]


def horizons(tables: Tables, index: int) -> dict[float, Array]:
    """Give time of a cycle -> (k, 2) places that the controller of a run expected then."""
    table = tables.get("validate_horizon")
    if table is None or not len(table):
        return {}
    rows = table[table["run"] == index].sort_values(["time", "step"], kind="stable")
    if not len(rows):
        return {}
    points = np.column_stack([column(rows, "x"), column(rows, "y")])
    times, first = np.unique(column(rows, "time"), return_index=True)
    return dict(zip(times.tolist(), np.split(points, first[1:]), strict=True))


def some_horizons(found: Mapping[float, Array], most: int) -> Line:
    """Give at most so many horizons, evenly spread over the run, as one line with the pen lifted between."""
    chosen = [list(found.values())[place] for place in evenly(len(found), most)]
    if not chosen:
        return Line(np.empty(0), np.empty(0))
    lifted = np.concatenate([np.vstack([points, [[np.nan, np.nan]]]) for points in chosen])[:-1]
    return Line(lifted[:, 0], lifted[:, 1])


def over_time(rows: pd.DataFrame, name: str) -> Line:
    """Give a signal over time [s]."""
    return Line(column(rows, "time"), column(rows, name))


def along(rows: pd.DataFrame, name: str, bins: int) -> Line:
    """Give a signal over the arc length [m], thinned in time so that no extreme is lost."""
    line = thinned(over_time(rows, name), bins)
    return Line(np.interp(line.time, column(rows, "time"), column(rows, "arc_length")), line.value)


def poses(rows: pd.DataFrame) -> Poses:
    """Give where the truck was."""
    time, window = column(rows, "time"), np.zeros(len(rows), dtype=np.int64)
    return poses_of(time, window, (column(rows, "x"), column(rows, "y")), [column(rows, "heading")])


def logged_runs(tables: Tables) -> list[str]:
    """Name every logged run of which there are lines."""
    table = tables.get("validate_logged")
    return [] if table is None else [str(run) for run in dict.fromkeys(table["run"].astype(str))]


def logged_lines(tables: Tables, run: str, level: int, name: str, bins: int) -> dict[str, Line]:
    """Give source -> a signal of one level of a logged run over the arc length, only those that have any.

    Engaged stretches are lines of their own; what was logged is the same for every level, and is taken from
    another one where this has no such rows.
    """
    table = tables["validate_logged"]
    rows = table[table["run"].astype(str) == run]
    logged = rows[rows["source"].astype(str) == "log"]
    own = rows[rows["level"] == level]
    if not (own["source"].astype(str) == "log").any() and len(logged):
        own = pd.concat([logged[logged["level"] == logged["level"].min()], own])
    found: dict[str, Line] = {}
    for source, part in own.groupby(own["source"].astype(str), sort=False):
        if np.isfinite(column(part, name)).any():
            found[str(source)] = _of_parts(part.sort_values(["part", "time"], kind="stable"), name, bins)
    return found


def _of_parts(rows: pd.DataFrame, name: str, bins: int) -> Line:
    pieces = [along(part, name, bins) for _, part in rows.groupby("part", sort=False)]
    lifted = [Line(np.append(one.time, np.nan), np.append(one.value, np.nan)) for one in pieces]
    return Line(*(np.concatenate([getattr(one, axis) for one in lifted])[:-1] for axis in Line._fields))


def levels_drawn(tables: Tables, run: str) -> list[int]:
    """Name the levels of a logged run of which there are lines, lowest first."""
    table = tables["validate_logged"]
    return sorted({int(level) for level in table.loc[table["run"].astype(str) == run, "level"]})


def sources_of(lines: Sequence[Mapping[str, Line]]) -> list[str]:
    """Name every source of some lines, the log first."""
    found = dict.fromkeys(source for own in lines for source in own)
    return sorted(found, key=lambda source: source != "log")
