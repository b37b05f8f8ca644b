"""The part of the validation: the truck in its lane with what the controller expects, beside its signals."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb

from ident.glossary import controller_name
from ident.report.condense import Array, Line
from ident.report.numbers import fixed, plain, shorten
from ident.report.outline import Outline, outline_from
from ident.report.palette import DARK
from ident.report.recording.motion import log_trucks, maps, send_trucks
from ident.report.recording.parts import MOST_TABS, TIMELINE, Part, log_style, origin, rgb, send, series
from ident.report.validate_summary import describe_validate
from ident.report.validated import run_title, scenario_name
from ident.report.validated_runs import (
    Path,
    horizons,
    lane_edges,
    opened,
    over_time,
    poses,
    reference_of,
)
from ident.results.validate import ValidateResult

STAGE = "validate"
TRUCK = "truck"
HORIZON_ABOVE = 0.08
"""How far above the ground the horizon is drawn, over the truck [m]."""
LINES: dict[str, tuple[str, str, str]] = {
    "lateral_error": ("modelled", "e_y [m]", "lateral error [m]"),
    "steering_request": ("request", "request [rad]", "steering before the ratio map [rad]"),
    "steering_angle": ("modelled", "angle [rad]", "steering before the ratio map [rad]"),
    "reference_speed": ("measured", "reference [m/s]", "speed [m/s]"),
    "speed": ("modelled", "truck [m/s]", "speed [m/s]"),
}
"""Column of the table -> colour, name of the line, name of its view."""


def validate_part(result: ValidateResult, tables: Mapping[str, pd.DataFrame]) -> Part:
    """Show each opened run in a tab of its own, the worst first.

    Parameters
    ----------
    tables : "validate", "validate_reference" and "validate_horizon"; any may be missing
    """
    found, shape = opened(result, tables), outline_from({})
    roots = {index: origin(STAGE, _name(result, index)) for index in found}

    def styles(recording: rr.RecordingStream) -> None:
        for index, rows in found.items():
            path = reference_of(tables, result.runs[index])
            _log_still(recording, roots[index], rows, shape)
            if path is not None:
                _log_lane(recording, roots[index], path, result.lane_half_width)

    def data(recording: rr.RecordingStream) -> None:
        for index, rows in found.items():
            for name in _lines(rows):
                send(recording, f"{roots[index]}/{name}", over_time(rows, name))
            steering, begin = over_time(rows, "road_wheel_angle"), float(rows["time"].min())
            send_trucks(recording, roots[index], {TRUCK: poses(rows)}, shape, steering, begin)
            _send_horizons(recording, roots[index], horizons(tables, index))

    tabs = [_tab(result, index, found[index]) for index in list(found)[:MOST_TABS]]
    return Part(STAGE, "Validation", result.provenance, describe_validate(result), tabs, styles, data)


def _name(result: ValidateResult, index: int) -> str:
    """Name a run so that no other has the name."""
    return f"{index} {run_title(result.runs[index])}"


def _lines(rows: pd.DataFrame) -> dict[str, Line]:
    """Give every line of a run that has any value."""
    lines = {name: over_time(rows, name) for name in LINES}
    return {name: line for name, line in lines.items() if np.isfinite(line.value).any()}


def _log_still(recording: rr.RecordingStream, root: str, rows: pd.DataFrame, shape: Outline) -> None:
    log_trucks(recording, root, {TRUCK: poses(rows)}, shape, {TRUCK: "modelled"})
    for name in _lines(rows):
        role, told, _ = LINES[name]
        log_style(recording, f"{root}/{name}", role, told, 1.5)


def _log_lane(recording: rr.RecordingStream, root: str, path: Path, half_width: float) -> None:
    """Log the reference and the edges of the lane about it."""
    middle = np.column_stack([path.x, path.y])
    drawn = {"reference": ([middle], "measured", 1.2), "lane": (lane_edges(path, half_width), "axis", 1.0)}
    for name, (strips, role, width) in drawn.items():
        flat = [_on_ground(strip, 0.0) for strip in strips]
        line = rr.LineStrips3D(flat, colors=[rgb(DARK[role])], radii=rr.Radius.ui_points(width))
        recording.log(f"{root}/path/{name}", line, static=True, strict=True)


def _on_ground(strip: Array, height: float) -> Array:
    return np.column_stack([strip, np.full(len(strip), height)])


def _send_horizons(recording: rr.RecordingStream, root: str, found: Mapping[float, Array]) -> None:
    """Send what the controller expected in each cycle."""
    for time, points in found.items():
        recording.set_time(TIMELINE, duration=time)
        strip = _on_ground(points, HORIZON_ABOVE)
        line = rr.LineStrips3D([strip], colors=[rgb(DARK["other_1"])], radii=rr.Radius.ui_points(2.0))
        recording.log(f"{root}/path/horizon", line, strict=True)
    recording.reset_time()


def _tab(result: ValidateResult, index: int, rows: pd.DataFrame) -> rrb.Container:
    """Show the path and the truck near by, left of its signals."""
    root, run, lines = origin(STAGE, _name(result, index)), result.runs[index], _lines(rows)
    span = (float(rows["time"].min()), float(rows["time"].max()))
    views = list(dict.fromkeys(LINES[name][2] for name in lines))
    shown = [
        series(root, span, view, {name: line for name, line in lines.items() if LINES[name][2] == view})
        for view in views
    ]
    where = scenario_name(run.scenario, run.scenario_run)
    title = f"{controller_name(run.controller)}: {where}, {fixed(3.6 * run.speed, 0)} km/h"
    signals = rrb.Vertical(*shown, name="signals")
    placed = maps(root, {TRUCK: poses(rows)})
    return rrb.Horizontal(placed, signals, column_shares=[1.0, 1.3], name=shorten(plain(title), 60))
