"""Figures of the tyre page over time: measured and modelled signals, and the forces of the axles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ident.glossary import AXLES, SIGNALS
from ident.report import figures
from ident.report.condense import Array, Line, broken, contiguous, thinned
from ident.report.numbers import count, shorten
from ident.report.page import Figure
from ident.report.pages import tyre_observer
from ident.report.tyre_parameters import signal_unit
from ident.report.tyre_signals import Compared, column, compared, measured_signals, modelled

TIME_OF_RUN = "time since the start of the run [s]"
BINS_RUN, BINS_ALL = 700, 4000
"""Bins of a whole run, and of all runs together."""
FEWEST_BINS = 150
BINS_FORCE = 400
SIGNAL_HEIGHT = 190
POSITIONS = ("position_x", "position_y")


def run_figure(
    rows: pd.DataFrame, signals: Sequence[str], driver: str, runs: int, title: str
) -> Figure | None:
    """Draw signals of a run, measured and modelled, each with its residual below; None where there is none.

    Parameters
    ----------
    driver : what drives the model, on top
    runs : how many runs the page shows, which share ``BINS_ALL`` bins
    """
    shown = [name for name in signals if name in measured_signals(rows)]
    if not shown:
        return None
    bins = int(np.clip(BINS_ALL / max(runs, 1), FEWEST_BINS, BINS_RUN))
    lines = {name: _from_start(compared(rows, name), name) for name in shown}
    panels = [_driver_panel(rows, driver, bins)]
    for name in shown:
        panels += _signal_panels(name, lines[name], bins, last=name == shown[-1])
    layout = figures.Layout(
        columns=1,
        row_height=round((SIGNAL_HEIGHT * len(shown) + 90) / len(panels)) + 26,
        share_x=True,
        row_shares=(0.7, *[1.6, 0.8] * len(shown)),
        left=62,
    )
    spec, height = figures.grid(panels, layout)
    return Figure(
        spec,
        height,
        title,
        _thinned_caption([line for all_three in lines.values() for line in all_three], bins),
    )


def _from_start(lines: Compared, name: str) -> Compared:
    """Count a position from where the run begins: maps put it millions of metres away."""
    if name not in POSITIONS:
        return lines
    start = lines.measured.value[0]
    measured, predicted = (Line(line.time, line.value - start) for line in lines[:2])
    return Compared(measured, predicted, lines.residual)


def _driver_panel(rows: pd.DataFrame, name: str, bins: int) -> figures.Panel:
    unit = SIGNALS[name].unit
    title = name.replace("_", " ").replace("road wheel", "road-wheel")
    trace = figures.line(thinned(modelled(rows, name), bins), "request", title, unit=unit, width=1.3)
    short = "δ" if name == "road_wheel_angle" else title
    return figures.Panel("", [trace], x="", y=f"{short} [{unit}]", x_ticks=False, ticks=(14, 4))


def _signal_panels(name: str, lines: Compared, bins: int, *, last: bool) -> list[figures.Panel]:
    unit = SIGNALS[name].unit.replace("^2", "²")
    factor, small_unit = signal_unit(name)
    measured, predicted = (thinned(line, bins) for line in lines[:2])
    residual = thinned(Line(lines.residual.time, lines.residual.value * factor), bins)
    above = [
        figures.line(measured, "measured", "measured", unit=unit, width=2.6),
        figures.line(predicted, "modelled", "modelled", unit=unit, width=1.4),
    ]
    below = [figures.line(residual, "residual", "residual", unit=small_unit, width=1.0)]
    title = name.replace("_", " ") + (" from start" if name in POSITIONS else "")
    return [
        figures.Panel("", above, x="", y=f"{title} [{unit}]", x_ticks=False, ticks=(14, 6)),
        figures.Panel(
            "", below, x=TIME_OF_RUN if last else "", y=f"[{small_unit}]", x_ticks=last, ticks=(14, 4)
        ),
    ]


def _thinned_caption(lines: Sequence[Line], bins: int) -> str:
    before = sum(line.time.size for line in lines)
    after = sum(thinned(line, bins).time.size for line in lines)
    told = "The modelled lines begin anew at each window, with states of their own."
    if after == before:
        return f"{told} Every sample is drawn."
    return (
        f"{told} {count(after, 'point')} drawn of {count(before, 'sample')}: the first, lowest, highest and "
        f"last in each of {bins} stretches of time. All samples are in run.rrd."
    )


def axle_forces(
    tyres: dict[str, pd.DataFrame], forces: dict[str, pd.DataFrame], runs: Sequence[tuple[str, str]]
) -> Figure | None:
    """Draw the forces of both axles over time, from the motion and from the model.

    Parameters
    ----------
    runs : title and name of each run, side by side
    """
    drawn = [(title, name) for title, name in runs if name in tyres and name in forces]
    if not drawn:
        return None
    panels = []
    for axle in AXLES:
        last = axle == AXLES[-1]
        for title, name in drawn:
            told = f"{title}: {shorten(name, 36)}" if axle == AXLES[0] else ""
            panels.append(_force_panel(tyres[name], forces[name], axle, told, last=last))
    layout = figures.Layout(columns=len(drawn), row_height=205, share_x=True, gap=66)
    spec, height = figures.grid(panels, layout)
    caption = "From the motion: force inversion of the measured accelerations. Modelled: the chosen tyres."
    if any(tyre_observer.is_observed(forces[name]) for _, name in drawn):
        caption = f"{caption} {tyre_observer.CAPTION}"
    return Figure(spec, height, "Lateral forces of the axles", caption)


def _force_panel(
    rows: pd.DataFrame, points: pd.DataFrame, axle: str, title: str, *, last: bool
) -> figures.Panel:
    own = points[points["axle"] == axle]
    traces = [
        *tyre_observer.traces(own),
        figures.line(_kilo(_line(own, "force")), "measured", "from the motion", unit="kN", width=2.4),
        figures.line(
            _kilo(modelled(rows, f"{axle}_lateral_force")), "modelled", "modelled", unit="kN", width=1.5
        ),
    ]
    wheels = _line(own, "measured_force")
    if wheels.time.size:
        traces.append(figures.line(_kilo(wheels), "other_2", "measured at the wheels", unit="kN", width=1.3))
    return figures.Panel(
        title, traces, x=TIME_OF_RUN if last else "", y=f"{axle} axle [kN]", x_ticks=last, ticks=(8, 6)
    )


def _line(points: pd.DataFrame, name: str) -> Line:
    time, values = column(points, "time"), column(points, name)
    there = np.isfinite(values)
    return broken(time[there], values[there], contiguous(time[there]))


def _kilo(line: Line) -> Line:
    values: Array = 1e-3 * line.value
    return thinned(Line(line.time, values), BINS_FORCE)
