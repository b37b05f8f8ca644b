"""The part of the improvement: measured, before and after, what each leaves, and when the effect acts."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd
import rerun as rr
import rerun.blueprint as rrb

from ident.report.condense import Line
from ident.report.improved import (
    ROLES,
    WAYS,
    activity_of,
    compared_signals,
    line_of,
    main_signal,
    residual_of,
    runs_in,
    unit_of,
)
from ident.report.numbers import plain, shorten
from ident.report.recording.parts import MOST_TABS, Part, log_style, origin, send, series
from ident.report.summary import describe_improve
from ident.results import ImproveResult

MOST_SIGNALS = 3
STAGE = "improve"
ACTIVITY = "activity"


def improve_part(result: ImproveResult, tables: Mapping[str, pd.DataFrame]) -> Part:
    """Show each run in a tab of its own, that in which the effect acts most first.

    Parameters
    ----------
    tables : "improve", as ``ident.report.improved`` describes it
    """
    runs = runs_in(tables)

    def styles(recording: rr.RecordingStream) -> None:
        for run, rows in runs.items():
            for entity in _lines(rows):
                _log_style(recording, f"{origin(STAGE, run)}/{entity}", entity)

    def data(recording: rr.RecordingStream) -> None:
        for run, rows in runs.items():
            for entity, line in _lines(rows).items():
                send(recording, f"{origin(STAGE, run)}/{entity}", line)

    tabs = [_tab(result, run, runs[run]) for run in list(runs)[:MOST_TABS]]
    return Part(STAGE, "Improvement", result.provenance, describe_improve(result), tabs, styles, data)


def _lines(rows: pd.DataFrame) -> dict[str, Line]:
    """Give every line of a run by its entity."""
    lines: dict[str, Line] = {}
    for signal in compared_signals(rows):
        lines |= {f"{signal}/{way}": line_of(rows, signal, way) for way in WAYS}
        lines |= {f"{signal}/residual/{way}": residual_of(rows, signal, way) for way in WAYS[1:]}
    lines[ACTIVITY] = activity_of(rows)
    return {entity: line for entity, line in lines.items() if line.time.size}


def _log_style(recording: rr.RecordingStream, entity: str, line: str) -> None:
    if line == ACTIVITY:
        log_style(recording, entity, ROLES[ACTIVITY], "effect acts [–]", 1.5)
        return
    signal, *_, way = line.split("/")
    told = f"{way} [{unit_of(signal)}]"
    log_style(recording, entity, ROLES[way], told, 2.5 if way == "measured" else 1.5)


def _tab(result: ImproveResult, run: str, rows: pd.DataFrame) -> rrb.Vertical:
    """Show the signal that is explained, what is left of the first signals, and when the effect acts."""
    root, lines = origin(STAGE, run), _lines(rows)
    span = (float(rows["time"].min()), float(rows["time"].max()))
    first = main_signal(result)
    signals = sorted(compared_signals(rows), key=lambda name: name != first)[:MOST_SIGNALS]
    views, shares = [], []
    for signal in signals:
        name, unit = signal.replace("_", " "), unit_of(signal)
        own = {key: line for key, line in lines.items() if key.startswith(f"{signal}/")}
        left = {key: own.pop(key) for key in list(own) if "/residual/" in key}
        if signal == signals[0]:
            views.append(series(root, span, f"{name} [{unit}]", own))
            shares.append(1.6)
        views.append(series(root, span, f"{name}, residual [{unit}]", left))
        shares.append(1.0)
    if ACTIVITY in lines:
        views.append(series(root, span, "effect acts [–]", {ACTIVITY: lines[ACTIVITY]}))
        shares.append(0.6)
    return rrb.Vertical(*views, row_shares=shares, name=shorten(plain(run), 40))
