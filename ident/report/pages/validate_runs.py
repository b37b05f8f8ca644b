"""Figures of the runs that the validation opened, and of the logged runs against the simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from ident.glossary import CONTROLLERS, controller_name
from ident.report import figures
from ident.report.condense import Array, Line
from ident.report.improved import column
from ident.report.page import Figure
from ident.report.pages.validate_figures import broken_above, with_legend_below
from ident.report.palette import LIGHT
from ident.report.validated import LEVELS, controllers_of, level_unit, run_title, scenario_name, style_of
from ident.report.validated_runs import (
    Path,
    Start,
    along,
    horizons,
    lane_outline,
    levels_drawn,
    logged_lines,
    reference_of,
    some_horizons,
    sources_of,
)
from ident.results.validate import ClosedLoopRun, ValidateResult

BINS = 300
PATH_HEIGHT, SIGNAL_HEIGHT = 230, 140
MOST_HORIZONS = 14
EQUAL_FROM = 0.3
"""A path whose width is at least so much of its length is drawn to scale."""
ARC_LENGTH = "arc length [m]"
LEVEL_SIGNALS = {
    0: ("yaw_rate", "lateral_error"),
    1: ("steering_angle", "yaw_rate", "lateral_error"),
    2: ("steering_request",),
    3: ("lateral_error", "heading_error", "steering_request", "speed"),
}
"""What is drawn of each level, where the lines have it."""
SHORT = {
    "lateral_error": "e_y",
    "heading_error": "e_ψ",
    "steering_request": "request",
    "steering_angle": "angle",
}


def worst_figures(
    result: ValidateResult, tables: Mapping[str, pd.DataFrame], rows: pd.DataFrame
) -> list[Figure]:
    """Draw the worst run: its path in the lane with its horizons, then its signals over the arc length."""
    run = result.runs[int(rows["run"].iloc[0])]
    path = reference_of(tables, run)
    return [_path_figure(result, tables, rows, path), _signals_figure(result, rows, run)]


def _path_figure(
    result: ValidateResult, tables: Mapping[str, pd.DataFrame], rows: pd.DataFrame, path: Path | None
) -> Figure:
    """Draw where the truck was, with the lane and what the controller expected."""
    x, y = column(rows, "x"), column(rows, "y")
    expected = horizons(tables, int(rows["run"].iloc[0]))
    traces = [] if path is None else _lane_traces(path, result.lane_half_width)
    if expected:
        line = some_horizons(expected, MOST_HORIZONS)
        traces.append(_place(line.time, line.value, "other_1", "predicted horizons", 1.4))
    traces.append(_place(x, y, "modelled", "truck (CG)", 2.2))
    panel = figures.Panel("", traces, x="x [m]", y="y [m]")
    spec, height = figures.grid([panel], figures.Layout(columns=1, row_height=PATH_HEIGHT))
    to_scale = np.ptp(y) > EQUAL_FROM * np.ptp(x)
    said = "To scale." if _scaled(spec, to_scale=bool(to_scale)) else "y is stretched: not to scale."
    if expected:
        said += f" Horizons: {min(len(expected), MOST_HORIZONS)} of {len(expected)}, evenly spread."
    return Figure(spec, height, "Path", said)


def _scaled(spec: dict[str, Any], *, to_scale: bool) -> bool:
    if to_scale:
        spec["layout"]["yaxis"] |= {"scaleanchor": "x", "scaleratio": 1}
    return to_scale


def _lane_traces(path: Path, half_width: float) -> list[figures.Trace]:
    x, y = lane_outline(path, half_width)
    lane = _place(x, y, "axis", "lane", 1.0)
    lane |= {"fill": "toself", "fillcolor": LIGHT["page"], "hoverinfo": "skip"}
    return [lane, _place(path.x, path.y, "measured", "reference", 1.4, dash="5px,4px")]


def _place(x: Array, y: Array, role: str, name: str, width: float, dash: str = "solid") -> figures.Trace:
    trace = figures.curve(x, y, role, name, dash=dash, hover="x %{x:.1f} m, y %{y:.2f} m")
    return {**trace, "connectgaps": False, "line": {**trace["line"], "width": width}}


def _signals_figure(result: ValidateResult, rows: pd.DataFrame, run: ClosedLoopRun) -> Figure:
    """Draw lateral error, steering and speed over the arc length."""
    lane = result.lane_half_width
    steering = [("steering_request", "request", "request"), ("steering_angle", "modelled", "truck")]
    speed = [("reference_speed", "measured", "reference"), ("speed", "modelled", "truck")]
    panels = [
        figures.Panel(
            "",
            [_signal(rows, "lateral_error", "modelled", "truck")],
            x="",
            y="e_y [m]",
            marks=_lane_marks(rows, lane),
        ),
        figures.Panel("", [_signal(rows, *one) for one in steering], x="", y="steering [rad]"),
        figures.Panel("", [_signal(rows, *one) for one in speed], x="", y="speed [m/s]"),
    ]
    if np.isfinite(column(rows, "acceleration_request")).any():
        driven = [("acceleration_request", "request", "request"), ("acceleration", "modelled", "truck")]
        panels.append(figures.Panel("", [_signal(rows, *one) for one in driven], x="", y="accel. [m/s²]"))
    caption = f"{run_title(run)}. Steering before the ratio map; every cycle is in signals/validate.parquet."
    return _stacked(panels, "Signals along the path", caption)


def _signal(rows: pd.DataFrame, name: str, role: str, told: str) -> figures.Trace:
    line = along(rows, name, BINS)
    trace = figures.curve(line.time, line.value, role, told, hover="%{y:.3g} at %{x:.1f} m")
    return {**trace, "legendgroup": role, "line": {**trace["line"], "width": 1.6}}


def _lane_marks(rows: pd.DataFrame, lane: float) -> list[dict[str, Any]]:
    """Draw the edges of the lane where the error comes near them, and the middle."""
    largest = np.nanmax(np.abs(column(rows, "lateral_error")), initial=0.0)
    middle = [figures.level(0.0, "axis", along="y")]
    if largest < lane / 2:
        return middle
    return middle + [figures.level(side * lane, "bad_line", along="y", dash="5px,4px") for side in (-1, 1)]


def _stacked(panels: Sequence[figures.Panel], title: str, caption: str, *, many: bool = False) -> Figure:
    """Put panels below each other on one arc length."""
    shown = [replace(panel, x_ticks=False, ticks=(14, 5)) for panel in panels[:-1]]
    shown.append(replace(panels[-1], x=ARC_LENGTH, ticks=(14, 5)))
    layout = figures.Layout(columns=1, row_height=SIGNAL_HEIGHT, share_x=True, left=66)
    spec, height = figures.grid(shown, layout)
    return Figure(*(with_legend_below(spec, height) if many else (spec, height)), title, caption)


def start_figure(result: ValidateResult, start: Start) -> Figure:
    """Draw every controller from one start: lateral error, steering and speed over the arc length."""
    names = {"lateral_error": "e_y [m]", "road_wheel_angle": "wheels [mrad]", "speed": "speed [m/s]"}
    panels = []
    order = sorted(start.runs, key=lambda index: controllers_of(result).index(result.runs[index].controller))
    for name, axis in names.items():
        factor = 1e3 if name == "road_wheel_angle" else 1.0
        traces = [_of_controller(result.runs[index], start.runs[index], name, factor) for index in order]
        largest = max(start.runs.values(), key=_largest_error)
        marks = _lane_marks(largest, result.lane_half_width) if name == "lateral_error" else []
        panels.append(figures.Panel("", broken_above(traces), x="", y=axis, marks=marks))
    caption = (
        "All from the start at which one of them did worst; dashed red: edge of the lane, where it is near."
    )
    return _stacked(
        panels, f"All controllers: {scenario_name(start.scenario, start.logged)}", caption, many=True
    )


def _largest_error(rows: pd.DataFrame) -> float:
    return float(np.nanmax(np.abs(column(rows, "lateral_error")), initial=0.0))


def _of_controller(run: ClosedLoopRun, rows: pd.DataFrame, name: str, factor: float) -> figures.Trace:
    role, dash = style_of(run.controller)
    line = along(rows, name, BINS)
    told = controller_name(run.controller)
    trace = figures.curve(
        line.time, factor * line.value, role, told, dash=dash, hover="%{y:.3g} at %{x:.1f} m"
    )
    return {**trace, "legendgroup": run.controller, "line": {**trace["line"], "width": 1.6}}


def logged_figures(tables: Mapping[str, pd.DataFrame], run: str) -> list[Figure]:
    """Draw a logged run, measured and simulated, over the arc length: a figure for each level there is."""
    return [
        drawn
        for level in levels_drawn(tables, run)
        if (drawn := _level_figure(tables, run, level)) is not None
    ]


def _level_figure(tables: Mapping[str, pd.DataFrame], run: str, level: int) -> Figure | None:
    found = {
        name: logged_lines(tables, run, level, name, BINS)
        for name in LEVEL_SIGNALS.get(level, ("lateral_error",))
    }
    found = {name: lines for name, lines in found.items() if set(lines) - {"log"}}
    if not found:
        return None
    panels = [_level_panel(name, lines) for name, lines in found.items()]
    sources = len(sources_of(list(found.values())))
    told = LEVELS.get(level, "")
    caption = "Errors from the logged reference; lines break between engaged stretches."
    if level <= 1:
        caption += (
            " Simulated freely from the beginning of each stretch, so that the place drifts; whether the "
            "level agrees is judged over short windows."
        )
    return _stacked(panels, f"Level {level}: {told}", caption, many=sources > 4)


def _level_panel(name: str, lines: Mapping[str, Line]) -> figures.Panel:
    factor, unit = level_unit(name)
    traces = [_of_source(source, lines[source], factor) for source in sources_of([lines])]
    told = SHORT.get(name, name.replace("_", " "))
    return figures.Panel("", traces, x="", y=f"{told} [{unit}]" if unit else told)


def _of_source(source: str, line: Line, factor: float) -> figures.Trace:
    known = {"log": ("measured", "solid"), "model": ("modelled", "solid")}
    role, dash = known.get(source) or style_of(source)
    told = {"log": "measured", "model": "simulated"}.get(source)
    name = told or (controller_name(source) if source in CONTROLLERS else source)
    trace = figures.curve(
        line.time, factor * line.value, role, name, dash=dash, hover="%{y:.3g} at %{x:.1f} m"
    )
    width = 2.2 if source == "log" else 1.4
    return {**trace, "connectgaps": False, "legendgroup": source, "line": {**trace["line"], "width": width}}
