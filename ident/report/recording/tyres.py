"""The part of the tyres: the truck on its path, measured and simulated, beside the signals."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd
import rerun as rr
import rerun.blueprint as rrb

from ident.glossary import SIGNALS
from ident.report.numbers import plain, shorten
from ident.report.outline import Outline, outline_of
from ident.report.recording.motion import log_trucks, maps, send_trucks
from ident.report.recording.parts import MOST_TABS, Part, log_style, origin, send, series
from ident.report.summary import describe_tyres
from ident.report.tyre_signals import by_agreement, compared, measured_signals, poses, runs_of
from ident.report.tyre_signals import modelled as driven
from ident.results import TyresResult

MOST_SIGNALS = 3


def tyres_part(result: TyresResult, tables: Mapping[str, pd.DataFrame]) -> Part:
    """Show the truck on its path, measured and simulated, beside the signals: a tab for each run.

    The runs that the model follows worst come first.

    Parameters
    ----------
    tables : "tyres", as ``ident.report.pages.tyres`` describes it
    """
    found = runs_of(tables["tyres"])
    ranked = by_agreement(result, list(found))[::-1]
    runs = {name: found[name] for name in [*ranked, *(name for name in found if name not in ranked)]}

    def styles(recording: rr.RecordingStream) -> None:
        for run, rows in runs.items():
            _log_still(recording, origin("tyres", run), rows, outline_of(result, run))

    def data(recording: rr.RecordingStream) -> None:
        for run, rows in runs.items():
            _send_motion(recording, origin("tyres", run), rows)
            begin, steering = float(rows["time"].min()), driven(rows, "road_wheel_angle")
            shape, root = outline_of(result, run), origin("tyres", run)
            send_trucks(recording, root, poses(rows), shape, steering, begin)

    tabs = [_motion_tab(run, rows) for run, rows in list(runs.items())[:MOST_TABS]]
    return Part("tyres", "Tyres", result.provenance, describe_tyres(result), tabs, styles, data)


def _log_still(recording: rr.RecordingStream, root: str, rows: pd.DataFrame, outline: Outline) -> None:
    """Log what stands still: paths, the outline of the truck in its own frame, colours of lines."""
    for signal in measured_signals(rows):
        unit = _unit(signal)
        for role in ("measured", "modelled", "residual"):
            width = 2.5 if role == "measured" else 1.5
            log_style(recording, f"{root}/{signal}/{role}", role, f"{role} [{unit}]", width)
    for name in ("road_wheel_angle", "speed"):
        log_style(recording, f"{root}/{name}", "request", f"{name.replace('_', ' ')} [{_unit(name)}]", 1.5)
    log_trucks(recording, root, poses(rows), outline, {way: way for way in ("measured", "modelled")})


def _send_motion(recording: rr.RecordingStream, root: str, rows: pd.DataFrame) -> None:
    for signal in measured_signals(rows):
        for role, line in compared(rows, signal)._asdict().items():
            send(recording, f"{root}/{signal}/{role}", line)
    for name in ("road_wheel_angle", "speed"):
        send(recording, f"{root}/{name}", driven(rows, name))


def _motion_tab(run: str, rows: pd.DataFrame) -> rrb.Container:
    """Show the path from above with the truck near by below it, left of the signals."""
    root, time = origin("tyres", run), driven(rows, "speed").time
    span = (float(time.min()), float(time.max())) if time.size else (0.0, 1.0)
    signals = _signal_views(root, rows, span)
    found = poses(rows)
    title = shorten(plain(run), 40)
    if not found:
        return rrb.Vertical(signals, name=title)
    return rrb.Horizontal(maps(root, found), signals, column_shares=[1.0, 1.3], name=title)


def _unit(signal: str) -> str:
    return SIGNALS[signal].unit.replace("^2", "²")


def _signal_views(root: str, rows: pd.DataFrame, span: tuple[float, float]) -> rrb.Vertical:
    """Show the steering, then the first signals that were measured, each with its residual below."""
    steering = {"road_wheel_angle": driven(rows, "road_wheel_angle")}
    views, shares = [series(root, span, "road-wheel angle [rad]", steering)], [1.2]
    for signal in measured_signals(rows)[:MOST_SIGNALS]:
        lines, unit = compared(rows, signal)._asdict(), _unit(signal)
        entities = {f"{signal}/{role}": line for role, line in lines.items()}
        residual = {f"{signal}/residual": entities.pop(f"{signal}/residual")}
        views.append(series(root, span, f"{signal.replace('_', ' ')} [{unit}]", entities))
        views.append(series(root, span, f"residual [{unit}]", residual))
        shares += [2.0, 1.0]
    return rrb.Vertical(*views, row_shares=shares, name="signals")
