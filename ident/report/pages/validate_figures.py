"""Figures of the validation page that are drawn from the result alone: measures, pairs, mismatch, times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.glossary import controller_name
from ident.report import figures
from ident.report.condense import Array
from ident.report.numbers import significant, with_unit
from ident.report.page import Figure
from ident.report.pages.evaluate_figures import log_ticks
from ident.report.palette import LIGHT
from ident.report.validated import (
    SHORT_SCENARIOS,
    cell_of,
    controllers_of,
    lost_share,
    measure_of,
    measures_of,
    mismatch_name,
    scenario_name,
    scenarios_of,
    score_of,
    simulated_name,
    style_of,
)
from ident.results.validate import MismatchCurve, ModelPair, ScenarioName, ValidateResult

COMPARED = (
    "lateral_error_rms",
    "lateral_error_settled",
    "steering_rate_rms",
    "braking_work",
    "arrival_time_error",
)
"""Measures that are drawn: what the first table asks, then what the source claims."""
MARKS: dict[ScenarioName, tuple[str, str]] = {
    "single_lane_change": ("other_1", "circle"),
    "double_lane_change": ("modelled", "square"),
    "double_lane_change_scaled": ("other_2", "diamond"),
    "truncated_slalom": ("other_3", "triangle-up"),
    "logged": ("measured", "x"),
}
"""Colour and symbol of a scenario."""
ROW_HEIGHT, NAMES = 24, 152
PANEL_HEIGHT = 230
MOST_MEASURES = 5
LOST_ABOVE = 1.06
"""Where lost runs are marked, in parts of the highest value drawn."""


def measures_figure(result: ValidateResult) -> Figure | None:
    """Draw the measures of every controller in every scenario with their intervals; None without any."""
    measures = [name for name in COMPARED if name in measures_of(result.cells)][:MOST_MEASURES]
    names = controllers_of(result)
    if not measures or not names:
        return None
    panels = [_measure_panel(result, name, names, first=name == measures[0]) for name in measures]
    height = 74 + ROW_HEIGHT * len(names)
    spec, height = figures.grid(panels, figures.Layout(len(panels), height, left=NAMES, gap=24))
    caption = (
        "Median over the runs that came to the end, with its 95 % interval; less is better everywhere; "
        "where nothing is drawn every run was lost."
    )
    return Figure(*with_legend_below(spec, height), "Controllers compared", caption)


def _measure_panel(
    result: ValidateResult, measure: str, names: Sequence[str], *, first: bool
) -> figures.Panel:
    scenarios = scenarios_of(result)
    shifts = np.linspace(-0.28, 0.28, len(scenarios)) if len(scenarios) > 1 else np.zeros(1)
    traces = []
    for scenario, shift in zip(scenarios, shifts, strict=True):
        found = [score_of(cell_of(result, name, scenario), measure) for name in names]
        own = [(row, score) for row, score in enumerate(found) if score is not None]
        if not own:
            continue
        factor = measure_of(measure, own[0][1].unit).factor
        sizes = factor * np.array(
            [[s.value if e is None else e for e in (s.value, s.low, s.high)] for _, s in own]
        )
        rows = np.array([row for row, _ in own]) + shift
        traces.append(_scenario_marks(sizes, rows, scenario, measure_of(measure, own[0][1].unit).unit))
    return figures.Panel(
        "",
        traces,
        x=measure_of(measure, _unit_of(result, measure)).head,
        y="",
        x_range=(0.0, 1.06 * _furthest(traces)),
        categories=list(names) and [controller_name(name) if first else "" for name in names],
        marks=[figures.band(row - 0.5, row + 0.5, "page", along="y") for row in range(1, len(names), 2)],
        ticks=(4, 4),
    )


def _furthest(traces: Sequence[figures.Trace]) -> float:
    """Give the largest end of the intervals drawn; 1 where all are zero."""
    ends = [float(np.max(trace["x"] + trace["error_x"]["array"])) for trace in traces]
    return max(ends, default=0.0) or 1.0


def _unit_of(result: ValidateResult, measure: str) -> str:
    scores = (score for cell in result.cells for score in cell.scores)
    return next(score.unit for score in scores if score.measure == measure)


def _scenario_marks(sizes: Array, rows: Array, scenario: str, unit: str) -> figures.Trace:
    role, symbol = {str(name): style for name, style in MARKS.items()}[scenario]
    name = {str(key): text for key, text in SHORT_SCENARIOS.items()}[scenario]
    trace = figures.whiskers(sizes[:, 0], sizes[:, 1], sizes[:, 2], rows, role, name, unit=unit)
    marker = {"color": LIGHT[role], "size": 7, "symbol": symbol}
    return {**trace, "marker": marker, "legendgroup": scenario}


def with_legend_below(spec: dict[str, Any], height: int) -> tuple[dict[str, Any], int]:
    """Give the legend a line of its own under the title, for one of many names."""
    layout, line = spec["layout"], figures.LEGEND
    margin = {**layout["margin"], "t": layout["margin"]["t"] + line}
    legend = {**layout["legend"], "x": 0.0, "xref": "container", "y": 1 - line / (height + line)}
    changed = {**layout, "height": height + line, "margin": margin, "legend": legend}
    return {**spec, "layout": changed}, height + line


def broken_above(traces: Sequence[figures.Trace]) -> list[figures.Trace]:
    """Draw broken lines over solid ones, so that all are seen; the legend keeps its order."""
    ranked = [{**trace, "legendrank": rank} for rank, trace in enumerate(traces, 1)]
    return sorted(ranked, key=lambda trace: bool(trace["line"]["dash"] == "solid"), reverse=True)


def pairs_figure(result: ValidateResult) -> Figure | None:
    """Draw prediction model against simulation model, one map for each controller; None without pairs."""
    found: dict[str, list[ModelPair]] = {}
    for one in result.pairs:
        found.setdefault(one.controller, []).append(one)
    if not found:
        return None
    order = [name for name in controllers_of(result) if name in found]
    order += [name for name in found if name not in order]
    simulated = list(dict.fromkeys(one.simulation_model for one in result.pairs))
    predicted = list(dict.fromkeys(one.prediction_model for one in result.pairs))
    columns = min(len(order), 3 if len(simulated) < 4 else 2)
    panels = [
        _pair_panel(found[name], predicted, simulated, result.lane_half_width, first=place % columns == 0)
        for place, name in enumerate(order)
    ]
    panels = [_titled(panel, controller_name(name)) for panel, name in zip(panels, order, strict=True)]
    height = 110 + 40 * len(predicted)
    spec, height = figures.grid(panels, figures.Layout(columns, height, left=NAMES, gap=24, legend=False))
    _name_columns(spec, [simulated_name(name) for name in simulated], len(panels))
    caption = (
        "Down: the model that the controller predicts with; across: the model that is simulated. In the "
        "cells: the largest lateral error [m], darker where it takes more of the lane; red with ✗: runs lost "
        "their path."
    )
    return Figure(spec, height, "Prediction model against simulation model", caption)


def _titled(panel: figures.Panel, title: str) -> figures.Panel:
    return figures.Panel(title, panel.traces, panel.x, panel.y, categories=panel.categories)


def _pair_panel(
    found: Sequence[ModelPair],
    predicted: Sequence[str],
    simulated: Sequence[str],
    lane: float,
    *,
    first: bool,
) -> figures.Panel:
    shade = np.full((len(predicted), len(simulated)), np.nan)
    text = [["" for _ in simulated] for _ in predicted]
    for one in found:
        row, across = predicted.index(one.prediction_model), simulated.index(one.simulation_model)
        lost = lost_share(one.completed)
        shade[row, across] = 2.0 if lost else min(1.0, one.lateral_error_max / lane if lane > 0 else 0.0)
        size = significant(one.lateral_error_max, 2)
        text[row][across] = f"✗ {lost}" if one.completed <= 0 else f"{size}<br>✗ {lost}" if lost else size
    names = [simulated_name(name) if first else "" for name in predicted]
    return figures.Panel("", [_map(shade, text)], x=" ", y="", categories=names)


def _map(shade: Array, text: Sequence[Sequence[str]]) -> figures.Trace:
    """Draw a map: 0 … 1 from light to dark, 2 in the colour of what is lost."""
    stops = [
        (0.0, "scale_low"),
        (0.25, "scale_middle"),
        (0.5, "scale_high"),
        (0.5, "bad_line"),
        (1.0, "bad_line"),
    ]
    return {
        "type": "heatmap",
        "name": "",
        "z": shade,
        "zmin": 0.0,
        "zmax": 2.0,
        "xgap": 2,
        "ygap": 2,
        "colorscale": [[place, LIGHT[role]] for place, role in stops],
        "showscale": False,
        "text": text,
        "texttemplate": "%{text}",
        "textfont": {"size": 12},
        "hovertemplate": "%{text}<extra></extra>",
    }


def _name_columns(spec: dict[str, Any], names: Sequence[str], panels: int) -> None:
    """Label the x axes of maps with names, and leave their lines out."""
    for number in range(panels):
        place = "" if number == 0 else str(number + 1)
        axis = spec["layout"][f"xaxis{place}"]
        axis.pop("nticks", None)
        axis["tickvals"] = list(range(len(names)))
        axis["ticktext"] = [_in_lines(name) for name in names]
        axis["range"] = [-0.5, len(names) - 0.5]
        for name in ("xaxis", "yaxis"):
            spec["layout"][f"{name}{place}"] |= {"showgrid": False, "showline": False, "ticks": ""}
        spec["layout"][f"yaxis{place}"]["range"] = [
            len(spec["layout"][f"yaxis{place}"]["tickvals"]) - 0.5,
            -0.5,
        ]


def _in_lines(name: str) -> str:
    """Put each effect of a model on a line of its own, those after the second counted."""
    model, *effects = (figures.label(part, 24) for part in name.split(" + "))
    if len(effects) > 2:
        effects = [effects[0], f"{len(effects) - 1} effects"]
    return "<br>+ ".join([model, *effects])


def mismatch_figures(result: ValidateResult) -> list[Figure]:
    """Draw how the error grows with each mismatch, a figure for each scenario."""
    found: dict[str, list[MismatchCurve]] = {}
    for curve in result.mismatch:
        found.setdefault(curve.scenario, []).append(curve)
    return [_mismatch_figure(result, name, curves) for name, curves in found.items()]


def _mismatch_figure(result: ValidateResult, scenario: str, curves: Sequence[MismatchCurve]) -> Figure:
    kinds = list(dict.fromkeys((curve.what, curve.unit) for curve in curves))
    top = _highest(curves, result.lane_half_width)
    columns = min(3, len(kinds))
    panels = [
        _mismatch_panel(
            result, [c for c in curves if (c.what, c.unit) == kind], top, first=place % columns == 0
        )
        for place, kind in enumerate(kinds)
    ]
    spec, height = figures.grid(panels, figures.Layout(columns, PANEL_HEIGHT, gap=46))
    caption = (
        "Largest lateral error over the size of one mismatch of the simulated truck, all else as the "
        "controller believes; crosses at the top: the path was lost; dashed red: edge of the lane "
        f"({with_unit(result.lane_half_width, 'm')})."
    )
    return Figure(*with_legend_below(spec, height), f"Mismatch: {scenario_name(scenario)}", caption)


def _highest(curves: Sequence[MismatchCurve], lane: float) -> float:
    """Give the highest error drawn, or the edge of the lane where that is near or was crossed."""
    sizes = [size for curve in curves for size in curve.lateral_error_max if size is not None]
    lost = any(size is None for curve in curves for size in curve.lateral_error_max)
    highest = max(sizes, default=lane) or 1.0
    return max(highest, lane) if lost or highest > lane / 2 else highest


def _mismatch_panel(
    result: ValidateResult, curves: Sequence[MismatchCurve], top: float, *, first: bool
) -> figures.Panel:
    factor, axis = mismatch_axis(curves[0])
    order = controllers_of(result)
    traces: list[figures.Trace] = []
    for curve in sorted(
        curves, key=lambda one: order.index(one.controller) if one.controller in order else 99
    ):
        traces += _mismatch_traces(curve, factor, LOST_ABOVE * top)
    return figures.Panel(
        "",
        broken_above(traces),
        x=axis,
        y="|e_y| max [m]" if first else "",
        y_range=(0.0, 1.12 * top),
        marks=[figures.level(result.lane_half_width, "bad_line", along="y", dash="5px,4px")],
        ticks=(7, 6),
    )


def mismatch_axis(curve: MismatchCurve) -> tuple[float, str]:
    """Give the factor and the title of the axis of a mismatch; shares are in percent, friction as it is."""
    name = figures.label(mismatch_name(curve.what), 40)
    if curve.unit != "1":
        return (1e3, f"{name} [mrad]") if curve.unit == "rad" else (1.0, f"{name}, change [{curve.unit}]")
    if curve.what == "friction" and min(curve.sizes, default=0.0) > 0:
        return 1.0, f"{name} [–]"
    return 100.0, f"{name}, change [%]"


def _mismatch_traces(curve: MismatchCurve, factor: float, lost_at: float) -> list[figures.Trace]:
    """Draw a curve that ends where the path was lost, and crosses there."""
    role, dash = style_of(curve.controller)
    name = controller_name(curve.controller)
    points = sorted(zip(curve.sizes, curve.lateral_error_max, strict=True), key=lambda one: one[0])
    x = factor * np.array([size for size, _ in points])
    y = np.array([np.nan if error is None else error for _, error in points])
    drawn = figures.curve(x, y, role, name, dash=dash, hover="%{y:.3g} m at %{x:.3g}")
    marker = {"color": LIGHT[role], "size": 5}
    drawn |= {"mode": "lines+markers", "marker": marker, "legendgroup": curve.controller}
    lost = x[np.isnan(y)]
    if not lost.size:
        return [drawn]
    crosses = figures.curve(
        lost, np.full(lost.size, lost_at), role, name, dash=dash, hover="path lost at %{x:.3g}"
    )
    crosses |= {"mode": "markers", "marker": {"color": LIGHT[role], "size": 8, "symbol": "x"}}
    return [drawn, {**crosses, "legendgroup": curve.controller}]


def times_figure(result: ValidateResult) -> Figure | None:
    """Draw the time of a step of each controller against the period; None without runs."""
    found = [
        (name, own)
        for name in controllers_of(result)
        if (own := [run for run in result.runs if run.controller == name])
    ]
    sizes = [
        (float(np.median([run.solve_time_p50 for run in own])), max(run.solve_time_p99 for run in own))
        for _, own in found
    ]
    if not found or min(low for low, _ in sizes) <= 0:
        return None
    p50, p99 = (1e3 * np.array(ends) for ends in zip(*sizes, strict=True))
    rows = np.arange(len(found), dtype=np.float64)
    traces = [
        _time_marks(p50, rows, "other_1", "p50", "circle-open"),
        _time_marks(p99, rows, "modelled", "p99", "circle"),
    ]
    ends = [*p50, *p99, 1e3 * result.period]
    panel = figures.Panel(
        "",
        traces,
        x="time of a step [ms]",
        y="",
        x_range=(min(ends) / 1.5, max(ends) * 1.5),
        x_log=log_ticks(ends),
        categories=[controller_name(name) for name, _ in found],
        marks=[figures.level(1e3 * result.period, "bad_line", dash="5px,4px")],
    )
    spec, height = figures.grid([panel], figures.Layout(1, 70 + ROW_HEIGHT * len(found), left=NAMES))
    caption = "Median and 99th percentile of the whole step, the largest of all runs; dashed: the period."
    return Figure(spec, height, "Time of a step against the period", caption)


def _time_marks(x: Array, rows: Array, role: str, name: str, symbol: str) -> figures.Trace:
    trace = figures.whiskers(x, x, x, rows, role, name, unit="ms")
    del trace["error_x"]
    marker = {"color": LIGHT[role], "size": 9, "symbol": symbol}
    return {**trace, "marker": marker, "hovertemplate": f"{name} %{{x:.3g}} ms<extra></extra>"}
