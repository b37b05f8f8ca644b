"""Figures of the improvement page: errors before and after, the residual, the evidence, runs over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from ident.report import figures, shades
from ident.report.condense import Array, Line, spread_out, thinned
from ident.report.improved import (
    ROLES,
    activity_of,
    against_regressor,
    binned_means,
    column,
    compared_signals,
    effect_name,
    line_of,
    main_signal,
    over_noise,
    place_name,
    ranked,
    residual_of,
    signals_of,
    unit_of,
)
from ident.report.numbers import shorten, unit_text
from ident.report.page import Figure
from ident.report.pages.evaluate_figures import log_ticks
from ident.report.pages.improve_tables import ratio_of
from ident.report.palette import LIGHT
from ident.report.tyre_parameters import SHORT_SIGNALS, signal_unit
from ident.results import ImproveResult, ImproveStep, Regressor

LEAD_HEIGHT = 268
SIGNAL_HEIGHT, REST_HEIGHT = 270, 110
ROW_HEIGHT, LEAST_HEIGHT = 21, 130
CLOUD = (70, 46)
BINS_ALL, BINS_RUN, FEWEST_BINS = 660, 220, 80
"""Bins of the lines of all runs together, of one run, and at least."""
MOST_CANDIDATES = 12
MOST_RUNS = 30
SHORT = {**SHORT_SIGNALS, "steering_wheel_angle": "steering wheel"}
TIME_OF_RUN = "time since the start of the run [s]"
DOTS = {"before": "circle-open", "after": "circle"}


def short(signal: str) -> str:
    """Name a signal where there is little room."""
    return SHORT.get(signal, signal.replace("_", " "))


def lead_figure(result: ImproveResult, table: pd.DataFrame | None) -> Figure | None:
    """Draw the errors before and after, and beside them what explains the residual, or what could hide."""
    panels = [panel] if (panel := _errors_panel(result)) else []
    said = ["Errors on held-out data over their noise floor, with 95 % intervals"] if panels else []
    cloud = [] if table is None else residual_panels(result, table, main_signal(result))
    if cloud:
        panels += cloud
        said.append(_cloud_caption(result))
    elif (hidden := _detectable_panel(result)) is not None:
        panels.append(hidden)
        said.append(
            "What these data would show at 85 % power, over the typical size: below 1 it would be seen"
        )
    if not panels:
        return None
    gap = 66 if cloud else 190
    layout = figures.Layout(columns=len(panels), row_height=LEAD_HEIGHT, left=_room(panels[0]), gap=gap)
    spec, height = figures.grid(panels, layout)
    return Figure(spec, height, "Before and after", ". ".join(said) + ".")


def _room(panel: figures.Panel) -> int:
    """Give the room that the labels of the y axis of a panel need [px]."""
    return 24 + 7 * max((min(len(name), 30) for name in panel.categories or ()), default=4)


def _errors_panel(result: ImproveResult) -> figures.Panel | None:
    """Draw the error of each signal before and after in parts of its noise floor, joined by a line."""
    signals = [name for name in signals_of(result) if over_noise(result, name, after=True)]
    if not signals:
        return None
    found = {way: [over_noise(result, name, after=way == "after") for name in signals] for way in DOTS}
    sizes = {way: np.array([one or (np.nan,) * 3 for one in each]).T for way, each in found.items()}
    row = np.arange(len(signals), dtype=np.float64)
    traces = [_dots(sizes[way], row + shift, way) for way, shift in (("before", -0.1), ("after", 0.1))]
    joined = [
        _joined(float(before), float(after), place)
        for place, (before, after) in enumerate(zip(sizes["before"][0], sizes["after"][0], strict=True))
        if np.isfinite(before)
    ]
    ends = [1.0, *[float(value) for size in sizes.values() for value in size.ravel() if value > 0]]
    return figures.Panel(
        "Error over noise floor",
        traces,
        x="RMS error over noise floor [–]",
        y="",
        x_range=(min(ends) / 1.15, max(ends) * 1.25),
        x_log=_ratio_ticks(ends),
        categories=[short(name) for name in signals],
        marks=[*joined, figures.level(1.0, "good", dash="5px,4px")],
    )


def _ratio_ticks(ends: Sequence[float]) -> list[float]:
    """Give where labels may stand on an axis of ratios, closer ones where all is near one."""
    near = [0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.5, 2.0, 3.0, 4.0, 5.0]
    return near if max(ends) / min(ends) < 4 else log_ticks(ends)


def _joined(before: float, after: float, row: int) -> dict[str, Any]:
    """Draw a thick line from before to after, under the dots."""
    ends = {"xref": "x", "x0": before, "x1": after, "yref": "y", "y0": row, "y1": row}
    return {"type": "line", "layer": "below", "line": {"color": LIGHT["grid"], "width": 6}, **ends}


def _dots(sizes: Array, row: Array, way: str) -> figures.Trace:
    trace = figures.whiskers(sizes[0], sizes[1], sizes[2], row, ROLES[way], way, unit="times the noise")
    marker = {"color": LIGHT[ROLES[way]], "size": 9, "symbol": DOTS[way]}
    return {**trace, "marker": marker, "legendgroup": way}


def _cloud_caption(result: ImproveResult) -> str:
    signal = main_signal(result)
    named = signal.replace("_", " ") if signal else "the signal"
    return (
        f"Residual of the {named}, measured minus modelled, over what explains it; lines: means of bins that "
        "hold equally many samples of all runs"
    )


def residual_panels(result: ImproveResult, table: pd.DataFrame, signal: str | None) -> list[figures.Panel]:
    """Draw what is left of a signal over the variable that explains it, before and after, on equal scales."""
    variable = result.regressor
    if variable is None or signal is None:
        return []
    x, before, after = against_regressor(table, signal)
    if x.size == 0:
        return []
    factor, unit = signal_unit(signal)
    left = {"before": factor * before, "after": factor * after}
    top = 1.05 * max(float(np.quantile(np.abs(values), 0.998)) for values in left.values()) or 1.0
    return [
        figures.Panel(
            f"{short(signal)}: {way}",
            _cloud(x, values, way, unit),
            x=_axis(variable),
            y=f"residual [{unit}]" if way == "before" else "",
            y_range=(-top, top),
            marks=[figures.level(0.0, "axis", along="y")],
            ticks=(5, 6),
        )
        for way, values in left.items()
    ]


def _axis(variable: Regressor) -> str:
    return f"{figures.label(variable.name, 44)} [{unit_text(variable.unit)}]"


def _cloud(x: Array, y: Array, way: str, unit: str) -> list[figures.Trace]:
    """Draw a cloud that keeps its shape, and the means over all samples."""
    kept = spread_out(x, y, CLOUD)
    hover = f"%{{y:.3g}} {figures.label(unit)} at %{{x:.3g}}"
    cloud = shades.dots(x[kept], y[kept], ROLES[way], way, hover=hover, symbol="circle")
    cloud["marker"] |= {"opacity": 0.25}
    at, mean = binned_means(x, y)
    line = figures.curve(at, mean, "text", "mean", hover=hover)
    return [cloud, {**line, "mode": "lines+markers", "marker": {"size": 5, "color": LIGHT["text"]}}]


def residual_figure(result: ImproveResult, table: pd.DataFrame) -> Figure | None:
    """Draw the residual of every compared signal over what explains it, before and after."""
    panels = [panel for signal in signals_of(result) for panel in residual_panels(result, table, signal)]
    if not panels:
        return None
    spec, height = figures.grid(panels, figures.Layout(columns=4, row_height=230, gap=66))
    caption = "Every signal, all runs; where the mean after stays flat the effect has taken what was there."
    return Figure(spec, height, "Residuals over what explains them", caption)


def _detectable_panel(result: ImproveResult) -> figures.Panel | None:
    """Draw the smallest size of each effect that would show, over its typical size."""
    found = [
        (key, ratio)
        for key, size in result.minimum_detectable.items()
        if math.isfinite(ratio := ratio_of(size)) and ratio > 0
    ]
    if not found:
        return None
    found = sorted(found, key=lambda one: one[1])[:MOST_CANDIDATES]
    values = np.array([ratio for _, ratio in found])
    row = np.arange(values.size, dtype=np.float64)
    trace = figures.whiskers(
        values, values, values, row, "other_2", "smallest size shown", unit="times typical"
    )
    ends = [1.0, *values.tolist()]
    return figures.Panel(
        "What would show",
        [trace],
        x="smallest size shown over typical [–]",
        y="",
        x_range=(min(ends) / 1.3, max(ends) * 1.3),
        x_log=log_ticks(ends),
        categories=[effect_name(key) for key, _ in found],
        marks=[figures.level(1.0, "good", dash="5px,4px")],
    )


def evidence_figure(step: ImproveStep) -> Figure | None:
    """Draw where a step points, and how its candidates compare."""
    places = sorted(step.localisation, key=lambda one: -one.share)
    compared = ranked(step.candidates)[:MOST_CANDIDATES]
    panels, said = [], []
    if places:
        shares = [100 * one.share for one in places]
        bars = _bars(shares, "other_2", "share", "%{x:.1f} %")
        names = [place_name(one.equation) for one in places]
        panels.append(
            figures.Panel("Where", [bars], x="share explained [%]", y="", x_range=(0, 100), categories=names)
        )
        said.append(
            "Where: share of what is above noise that a free error in each equation alone would explain"
        )
    if compared:
        panels.append(_candidates_panel(step))
        said.append("Candidates: open, what one step would gain (score); filled, what the full fit gains")
    if not panels:
        return None
    most = max(len(places), len(compared))
    layout = figures.Layout(
        columns=len(panels), row_height=max(LEAST_HEIGHT, 72 + ROW_HEIGHT * most), left=200, gap=210
    )
    spec, height = figures.grid(panels, layout)
    return Figure(spec, height, "Evidence", ". ".join(said) + ".")


def _candidates_panel(step: ImproveStep) -> figures.Panel:
    compared = ranked(step.candidates)[:MOST_CANDIDATES]
    row = np.arange(len(compared), dtype=np.float64)
    score = np.array([one.statistic for one in compared])
    gain = np.array([np.nan if one.gain is None else one.gain for one in compared])
    traces = [_marks(score, row, "before", "score"), _marks(gain, row, "after", "full fit")]
    ends = [float(value) for value in (*score, *gain) if value > 0] or [1.0]
    added = [place for place, one in enumerate(compared) if one.why_not is None]
    return figures.Panel(
        "Candidates",
        traces,
        x="2 log likelihood gained [–]",
        y="",
        x_range=(min(ends) / 1.5, max(ends) * 1.5),
        x_log=log_ticks(ends),
        categories=[shorten(effect_name(one.key), 30) for one in compared],
        marks=[figures.band(place - 0.45, place + 0.45, "good_fill", along="y") for place in added],
    )


def _marks(x: Array, row: Array, way: str, name: str) -> figures.Trace:
    trace = figures.whiskers(x, x, x, row, ROLES[way], name, unit="")
    del trace["error_x"]
    marker = {"color": LIGHT[ROLES[way]], "size": 9, "symbol": DOTS[way]}
    return {**trace, "marker": marker, "hovertemplate": f"{name} %{{x:.4g}}<extra></extra>"}


def _bars(values: Sequence[float], role: str, name: str, hover: str) -> figures.Trace:
    """Draw bars to the right, one a row."""
    trace = figures.bars(
        np.array(values), np.arange(len(values), dtype=np.float64), role, name, width=0.7, hover=hover
    )
    return {**trace, "orientation": "h"}


def confirmation_figure(result: ImproveResult) -> Figure | None:
    """Draw what each run gains while it takes no part in the fit."""
    found = result.confirmation
    if found is None or not found.by_run:
        return None
    gains = sorted(found.by_run.items(), key=lambda one: -one[1])
    drawn = gains if len(gains) <= MOST_RUNS else [*gains[: MOST_RUNS // 2], *gains[-MOST_RUNS // 2 :]]
    bars = _bars([gain for _, gain in drawn], "modelled", "gain", "%{x:.3g} a sample")
    panel = figures.Panel(
        "",
        [bars],
        x="log likelihood gained on runs that took no part [1/sample]",
        y="",
        categories=[shorten(run, 30) for run, _ in drawn],
        marks=[figures.level(0.0, "axis")],
    )
    height = max(LEAST_HEIGHT, 56 + ROW_HEIGHT * len(drawn))
    spec, height = figures.grid([panel], figures.Layout(1, height, left=220, legend=False))
    left = len(gains) - len(drawn)
    caption = (
        f"{left} runs between the best and the worst are left out; improve.json has them." if left else ""
    )
    return Figure(spec, height, "Gain by run", caption)


def run_figure(rows: pd.DataFrame, runs: int) -> Figure | None:
    """Draw the signals of a run, each with what is left of it below, and when the effect acts.

    Parameters
    ----------
    rows : of one run
    runs : how many runs the page shows, which share ``BINS_ALL`` bins
    """
    signals = compared_signals(rows)
    if not signals:
        return None
    bins = int(np.clip(BINS_ALL / max(runs, 1), FEWEST_BINS, BINS_RUN))
    panels = [panel for signal in signals for panel in _signal_panels(rows, signal, bins)]
    heights = [1.5, 1.0] * len(signals)
    active = activity_of(rows)
    if np.isfinite(column(rows, "activity")).any():
        line = figures.line(thinned(active, bins), ROLES["activity"], "effect acts", unit="", width=1.4)
        panels.append(figures.Panel("", [line], x="", y="acts [–]", y_range=(-0.05, 1.05), ticks=(14, 3)))
        heights.append(0.7)
    panels = [replace(panel, x_ticks=False) for panel in panels[:-1]] + [replace(panels[-1], x=TIME_OF_RUN)]
    layout = figures.Layout(
        columns=1,
        row_height=round((SIGNAL_HEIGHT * len(signals) + REST_HEIGHT) / len(panels)),
        share_x=True,
        row_shares=heights,
        left=66,
    )
    spec, height = figures.grid(panels, layout)
    caption = (
        "Above: measured, and the model before and after; below: measured minus modelled. Extremes are kept "
        "where lines are thinned; all samples are in signals/improve.parquet."
    )
    return Figure(spec, height, "Measured, before and after", caption)


def _signal_panels(rows: pd.DataFrame, signal: str, bins: int) -> list[figures.Panel]:
    factor, small = signal_unit(signal)
    unit = unit_of(signal)
    widths = {"measured": 2.6, "before": 1.2, "after": 1.4}
    above = [
        figures.line(thinned(line_of(rows, signal, way), bins), ROLES[way], way, unit=unit, width=width)
        for way, width in widths.items()
    ]
    below = []
    for way in DOTS:
        line = residual_of(rows, signal, way)
        line = thinned(Line(line.time, factor * line.value), bins)
        below.append(figures.line(line, ROLES[way], way, unit=small, width=1.2))
    return [
        figures.Panel("", above, x="", y=f"{short(signal)} [{unit}]", ticks=(14, 5)),
        figures.Panel("", below, x="", y=f"[{small}]", ticks=(14, 4)),
    ]
