"""Figures of the evaluation page: accuracy against cost, coverage, errors by band and window, runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ident.glossary import SIGNALS
from ident.report import evaluate_signals as signals_of_run
from ident.report import figures, shades
from ident.report.condense import Array, Line, spread_out, thinned
from ident.report.evaluated import (
    INPUTS,
    STANDARD,
    driven_by,
    model_name,
    over_acceptable,
    roles,
    shown_error,
    shown_model,
    signals_of,
    window_seconds,
)
from ident.report.numbers import count, shorten, significant
from ident.report.page import Figure
from ident.report.tyre_parameters import SHORT_SIGNALS, signal_head, signal_unit
from ident.results import AccelerationBand, Error, EvaluatedModel, EvaluateResult

TIME_OF_RUN = "time since the start of the run [s]"
LEAD_HEIGHT = 250
LEAD_TICKS = (5, 6)
BINS_LEAD, BINS_RUN, BINS_ALL, FEWEST_BINS = 250, 220, 660, 80
"""Bins of a line on the first screen, of a whole run, of all runs together; at least so many."""
SIGNAL_HEIGHT = 170
CELLS = (400, 300)
FIRST = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")
"""Signals whose errors are drawn by band and by length of window."""
POSITIONS = signals_of_run.POSITIONS
LENGTH_HOVER = "%{y:.3g} (%{customdata[0]:.3g} … %{customdata[1]:.3g})"


def lead_figure(result: EvaluateResult, runs: Mapping[str, pd.DataFrame], ranked: Sequence[str]) -> Figure:
    """Draw accuracy against cost, what was driven, and the best and the worst held-out run."""
    shown = shown_model(result)
    panels = [_cost_panel(result), _coverage_panel(result)]
    chosen = [("best", ranked[0]), ("worst", ranked[-1])] if len(ranked) > 1 else [("run", r) for r in ranked]
    if shown is not None:
        panels += [_overlay(runs[run], run, rank, shown.name) for rank, run in chosen if run in runs]
    spec, height = figures.grid(panels, figures.Layout(columns=4, row_height=LEAD_HEIGHT, gap=68))
    return Figure(spec, height, "Accuracy and coverage", _lead_caption(result, shown))


def _lead_caption(result: EvaluateResult, shown: EvaluatedModel | None) -> str:
    told = (
        f"Accuracy: the largest of all errors over its acceptable size, over windows of {STANDARD}; below 1 "
        "the model is good enough; open circles: driven by the request. Coverage: seconds of held-out driving"
    )
    told += "; crosses: driven in training only." if "training" in result.coverage else "."
    if shown is not None:
        told += f" Runs: {model_name(shown.name)}, simulated freely from the first instant held out."
    return told


def _cost_panel(result: EvaluateResult) -> figures.Panel:
    colours = roles(result)
    traces: list[figures.Trace] = []
    for model in result.models:
        worst = over_acceptable(result, model)
        if worst is None or model.cost_ns_per_step <= 0:
            continue
        hover = (
            f"{figures.label(worst[0].replace('_', ' '))}: {significant(worst[1])} of what is acceptable, "
            f"{significant(model.cost_ns_per_step)} ns a step, {INPUTS[model.input]}"
        )
        filled = model.input == "measured"
        name = model_name(model.name)
        traces.append(
            shades.mark(
                model.cost_ns_per_step, worst[1], colours[model.name], name, filled=filled, hover=hover
            )
        )
    costs, errors = ([trace[axis][0] for trace in traces] for axis in "xy")
    marks = [figures.level(1.0, "good", along="y", dash="5px,4px")]
    return figures.Panel(
        "Accuracy against cost",
        traces,
        ticks=LEAD_TICKS,
        x="cost [ns/step]",
        y="error over acceptable [–]",
        x_range=_room(costs),
        y_range=_room([*errors, 1.0] if errors else []),
        marks=marks if errors else [],
        x_log=log_ticks(costs),
        y_log=log_ticks([*errors, 1.0] if errors else []),
    )


def _room(values: Sequence[float]) -> tuple[float, float] | None:
    return (min(values) / 1.6, max(values) * 1.6) if values else None


def log_ticks(values: Sequence[float]) -> list[float]:
    """Give 1, 2 and 5 times the powers of ten about positive values."""
    if not values:
        return []
    low, high = (math.log10(end) for end in (min(values), max(values)))
    powers = range(math.floor(low) - 1, math.ceil(high) + 2)
    factors = (1.0, 2.0, 5.0) if high - low < 2.5 else (1.0,)
    return [float(f"{factor:g}e{power}") for power in powers for factor in factors]


def _coverage_panel(result: EvaluateResult) -> figures.Panel:
    """Shade what was driven; mark what only the training has; draw how far the shown model is good."""
    held, training = coverage_of(result)
    traces: list[figures.Trace] = []
    if held.size:
        hover = "%{x:.3g} m/s, %{y:.3g} m/s²: %{z:.1f} s"
        blank = np.where(held > 0, held, np.nan).T
        traces.append(
            shades.cells(blank, result.speed_edges, result.acceleration_edges, "driven", hover=hover)
        )
    only = (
        np.argwhere((training > 0) & (held <= 0)) if training.shape == held.shape else np.empty((0, 2), int)
    )
    if only.size:
        middles = [
            np.convolve(edges, [0.5, 0.5], mode="valid")
            for edges in (result.speed_edges, result.acceleration_edges)
        ]
        x, y = middles[0][only[:, 0]], middles[1][only[:, 1]]
        traces.append(
            shades.dots(x, y, "muted", "training only", hover="in training only", symbol="x-thin-open")
        )
        traces[-1]["marker"] |= {"size": 6, "opacity": 0.8}
    shown = shown_model(result)
    reach = shown.valid_to if shown else None
    return figures.Panel(
        "Held-out driving" if reach is None else f"Held out; line: good to {reach:g} m/s²",
        traces,
        x="speed [m/s]",
        y="|lateral acceleration| [m/s²]",
        x_range=_extent(held + training, result.speed_edges),
        marks=[] if reach is None else [{**_reach(reach), "layer": "above"}],
        ticks=LEAD_TICKS,
    )


def _reach(acceleration: float) -> dict[str, Any]:
    return figures.level(acceleration, "modelled", along="y", dash="5px,4px")


def _extent(seconds: Array, edges: Sequence[float]) -> tuple[float, float] | None:
    """Give the range of speeds that were driven."""
    driven = np.flatnonzero(seconds.sum(axis=1) > 0) if seconds.size else np.empty(0, np.int64)
    return (edges[int(driven[0])], edges[int(driven[-1]) + 1]) if driven.size else None


def coverage_of(result: EvaluateResult) -> tuple[Array, Array]:
    """Give the seconds of held-out and of training driving: (speed, lateral acceleration) cells each.

    Where the coverage is not told apart all of it counts as held out.
    """
    shape = (max(len(result.speed_edges) - 1, 0), max(len(result.acceleration_edges) - 1, 0))
    fitting = {
        name: np.array(cells, dtype=np.float64)
        for name, cells in result.coverage.items()
        if np.shape(cells) == shape
    }
    training = fitting.get("training", np.zeros(shape))
    if "held_out" in fitting:
        return fitting["held_out"], training
    return sum((cells for name, cells in fitting.items() if name != "training"), np.zeros(shape)), training


def _overlay(rows: pd.DataFrame, run: str, rank: str, model: str) -> figures.Panel:
    """Draw the yaw rate of a run as measured and as simulated; the path where no yaw rate was measured."""
    title = f"{rank}: {shorten(run, 26)}"
    compared = signals_of_run.measured_signals(rows, [model])
    if "yaw_rate" not in compared and {"position_x", "position_y"} <= set(compared):
        return figures.Panel(title, path_traces(rows, {model: "modelled"}), x="x from start [m]", y="y [m]")
    signal = "yaw_rate" if "yaw_rate" in compared or not compared else compared[0]
    unit = _unit(signal)
    drawn = [
        ("measured", "measured", signals_of_run.measured(rows, signal), 2.4),
        ("modelled", model_name(model), signals_of_run.simulated(rows, signal, model), 1.4),
    ]
    traces = [
        figures.line(thinned(line, BINS_LEAD), role, name, unit=unit, width=width)
        for role, name, line, width in drawn
    ]
    y = f"{signal.replace('_', ' ')} [{unit}]"
    return figures.Panel(title, traces, x="time in the run [s]", y=y, ticks=LEAD_TICKS)


def _short(signal: str) -> str:
    return SHORT_SIGNALS.get(signal, signal.replace("_", " "))


def _unit(signal: str) -> str:
    return SIGNALS[signal].unit.replace("^2", "²")


def bands_figure(result: EvaluateResult) -> Figure | None:
    """Draw the error of each model over the size of the lateral acceleration; None without bands."""
    lines: dict[str, list[Points]] = {}
    for model in driven_by(result, "measured") or result.models:
        bands = [band for band in model.by_lateral_acceleration if band.seconds > 0]
        for signal in FIRST:
            at = [(_middle(band), band.rms[signal]) for band in bands if signal in band.rms]
            lines.setdefault(signal, []).append(Points(model, at))
    return _errors_figure(
        result,
        lines,
        "|lateral acceleration| [m/s²]",
        "Errors by lateral acceleration",
        "RMS error over the shortest windows while the lateral acceleration is in a band, at its middle, "
        f"with 95 % intervals; green: the acceptable size, over windows of {STANDARD}.",
    )


def windows_figure(result: EvaluateResult) -> Figure | None:
    """Draw the error of each model over the length of the windows; None where there are no windows."""
    lines: dict[str, list[Points]] = {}
    for model in driven_by(result, "measured") or result.models:
        lengths = sorted(model.windows, key=window_seconds)
        for signal in FIRST:
            at = [
                (window_seconds(length), model.windows[length][signal])
                for length in lengths
                if signal in model.windows[length] and math.isfinite(window_seconds(length))
            ]
            lines.setdefault(signal, []).append(Points(model, at))
    return _errors_figure(
        result,
        lines,
        "length of the windows [s]",
        "Errors by length of the windows",
        "RMS error over windows from many starts, with 95 % intervals; green: the acceptable size at "
        f"{STANDARD}.",
    )


class Points(NamedTuple):
    """Errors of one model over something."""

    model: EvaluatedModel
    at: Sequence[tuple[float, Error]]


def _middle(band: AccelerationBand) -> float:
    return band.lowest + 0.5 if band.highest is None else (band.lowest + band.highest) / 2


def _errors_figure(
    result: EvaluateResult, lines: Mapping[str, Sequence[Points]], x: str, title: str, caption: str
) -> Figure | None:
    found = {signal: [one for one in points if one.at] for signal, points in lines.items()}
    drawn = [signal for signal in signals_of(result) if found.get(signal)]
    if not drawn:
        return None
    columns = min(3, len(drawn))
    panels = [
        _errors_panel(result, signal, found[signal], x if index >= len(drawn) - columns else "")
        for index, signal in enumerate(drawn)
    ]
    spec, height = figures.grid(panels, figures.Layout(columns=columns, row_height=210, gap=62))
    return Figure(spec, height, title, caption)


def _errors_panel(result: EvaluateResult, signal: str, found: Sequence[Points], x: str) -> figures.Panel:
    factor, colours = signal_unit(signal)[0], roles(result)
    traces = []
    for one in found:
        errors = [error for _, error in one.at]
        value, low, high = (
            factor * np.array([getattr(error, part) or error.value for error in errors])
            for part in ("value", "low", "high")
        )
        at = np.array([place for place, _ in one.at])
        name = model_name(one.model.name)
        traces.append(shades.ranges(at, value, low, high, colours[one.model.name], name, hover=LENGTH_HOVER))
    limit = result.acceptable.get(signal)
    marks = [figures.level(factor * limit.value, "good", along="y", dash="5px,4px")] if limit else []
    ends = [float(value) for trace in traces for value in trace["y"] if value > 0]
    ends += [factor * limit.value] if limit and ends else []
    return figures.Panel(
        "", traces, x=x, y=signal_head(signal), y_range=_room(ends), marks=marks, y_log=log_ticks(ends)
    )


def run_figure(result: EvaluateResult, rows: pd.DataFrame, models: Sequence[str], runs: int) -> Figure | None:
    """Draw the signals of a run, each with the residuals of all models below it; None without any.

    Parameters
    ----------
    models : on measured steering, in the order in which they are drawn
    runs : how many runs the page shows, which share ``BINS_ALL`` bins
    """
    compared = signals_of_run.measured_signals(rows, models)
    if not compared:
        return None
    bins = int(np.clip(BINS_ALL / max(runs, 1), FEWEST_BINS, BINS_RUN))
    shown = shown_model(result)
    first = shown.name if shown and shown.name in models else models[0]
    panels: list[figures.Panel] = []
    for signal in compared:
        last = signal == compared[-1]
        panels += _signal_panels(result, rows, signal, [first, *models], bins, last=last)
    layout = figures.Layout(
        columns=1,
        row_height=round(SIGNAL_HEIGHT * len(compared) / len(panels)) + 26,
        share_x=True,
        row_shares=(1.5, 1.0) * len(compared),
        left=62,
    )
    spec, height = figures.grid(panels, layout)
    caption = (
        f"Above: measured, and {model_name(first)} simulated freely from the logged initial state; below: "
        "measured minus simulated, for every model. Extremes are kept where lines are thinned; all samples "
        "are in signals/evaluate.parquet."
    )
    return Figure(spec, height, "Measured and simulated", caption)


def _signal_panels(
    result: EvaluateResult, rows: pd.DataFrame, signal: str, models: Sequence[str], bins: int, *, last: bool
) -> list[figures.Panel]:
    """Give the panel of a signal with the first model, and that of the residuals of the others."""
    (factor, small), unit, colours = signal_unit(signal), _unit(signal), roles(result)
    models = [model for model in models if signals_of_run.compares(rows, signal, [model])]
    first = models[0]
    seen = thinned(signals_of_run.measured(rows, signal), bins)
    line = thinned(signals_of_run.simulated(rows, signal, first), bins)
    above = [
        figures.line(seen, "measured", "measured", unit=unit, width=2.6),
        _variant(line, first, colours, unit),
    ]
    below = []
    for model in dict.fromkeys(models):
        line = signals_of_run.residual(rows, signal, model)
        line = thinned(Line(line.time, factor * line.value), bins)
        below.append(_variant(line, model, colours, small))
    title = _short(signal) + (" from start" if signal in POSITIONS else "")
    return [
        figures.Panel("", above, x="", y=f"{title} [{unit}]", x_ticks=False, ticks=(14, 5)),
        figures.Panel("", below, x=TIME_OF_RUN if last else "", y=f"[{small}]", x_ticks=last, ticks=(14, 4)),
    ]


def _variant(line: Line, model: str, colours: Mapping[str, str], unit: str) -> figures.Trace:
    """Draw a model's line, dashed where it was driven by the request."""
    role = colours[model.removesuffix(signals_of_run.REQUEST)]
    trace = figures.line(line, role, model_name(model), unit=unit, width=1.1)
    return {**trace, "line": {**trace["line"], "dash": "5px,3px"}} if model not in colours else trace


def path_figure(result: EvaluateResult, rows: pd.DataFrame, models: Sequence[str]) -> Figure | None:
    """Draw the path of a run from above with that of each model; None where no position was measured."""
    colours = roles(result)
    of_models = {model: colours[model.removesuffix(signals_of_run.REQUEST)] for model in models}
    traces = path_traces(rows, of_models)
    if not traces or traces[0]["name"] != "measured":
        return None
    panel = figures.Panel("", traces, x="x from start [m]", y="y from start [m]")
    spec, height = figures.grid([panel], figures.Layout(columns=1, row_height=330, left=62))
    spec["layout"]["yaxis"] |= {"scaleanchor": "x", "scaleratio": 1}
    drawn = count(sum(np.size(trace["x"]) for trace in traces), "point")
    return Figure(spec, height, "Path from above", f"Equal scales; {drawn} drawn.")


def path_traces(rows: pd.DataFrame, models: Mapping[str, str]) -> list[figures.Trace]:
    """Give the paths as measured and as simulated, each model with its colour."""
    found = signals_of_run.places(rows, list(models))
    traces = []
    for way, pose in found.items():
        kept = spread_out(pose.x, pose.y, CELLS)
        role = "measured" if way == "measured" else models[way]
        name = "measured" if way == "measured" else model_name(way)
        dash = "5px,3px" if way.endswith(signals_of_run.REQUEST) else "solid"
        hover = "%{x:.1f} m, %{y:.1f} m"
        trace = figures.curve(pose.x[kept], pose.y[kept], role, name, dash=dash, hover=hover)
        traces.append({**trace, "line": {**trace["line"], "width": 2.6 if way == "measured" else 1.3}})
    return traces


def largest_error(run: str, result: EvaluateResult) -> str:
    """Say how far the shown model is off in a run, for the line that opens it."""
    model = shown_model(result)
    told = next((one.rms for one in model.by_run if one.run == run), {}) if model else {}
    parts = [
        f"{_short(name)} {shown_error(name, told[name])} {signal_unit(name)[1]}"
        for name in FIRST[:2]
        if name in told
    ]
    return "RMS " + ", ".join(parts) if parts else ""
