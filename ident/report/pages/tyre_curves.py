"""Figures of the tyre page that stand for the model: force against slip angle, and correlations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ident.glossary import AXLES
from ident.report import figures, shades
from ident.report.condense import Array, spread_out
from ident.report.numbers import count
from ident.report.page import Figure
from ident.report.tyre_parameters import KINDS, chosen_fit, short_name
from ident.report.tyre_signals import force_points
from ident.results import AxleCurve, TyreFit, TyreKind, TyresResult

BEYOND = 1.6
"""How far beyond the excited slip angles the curves are drawn, in parts of the largest of them [-]."""
ROOM = 1.25
"""How far beyond the largest force that is to be seen the axis reaches [-]."""
CELLS = (130, 90)
"""Of points that fall into one cell of so many across and high, one is drawn."""
NORMAL_95 = 1.96
OTHERS = ("other_1", "other_2", "other_3", "other_4")
HOVER = "%{y:.2f} kN at %{x:.1f} mrad"
POINT_HOVER = HOVER + ", |lateral acceleration| %{customdata:.2f} m/s²"


def force_figure(result: TyresResult, forces: pd.DataFrame) -> Figure:
    """Draw the force of each axle against its slip angle: points from the motion, the curve of each kind."""
    roles = _roles(result)
    found = {axle: force_points(forces, axle) for axle in AXLES}
    panels = [_axle_panel(result, axle, found[axle], roles, _highest(found)) for axle in AXLES]
    spec, height = figures.grid(panels, figures.Layout(columns=2, row_height=352, gap=66))
    spec["layout"]["margin"]["r"] = 66
    return Figure(spec, height, "Lateral force against slip angle", _caption(result, found))


def _roles(result: TyresResult) -> dict[TyreKind, str]:
    """Give each kind its colour, the chosen one that of the model."""
    others = [fit.kind for fit in result.fits if fit.kind != result.chosen]
    return {result.chosen: "modelled"} | dict(zip(others, OTHERS, strict=False))


def _highest(found: dict[str, dict[str, Array]]) -> float:
    """Find the largest lateral acceleration of all points, to either side [m/s²]."""
    sizes = [np.abs(points["lateral_acceleration"]) for points in found.values()]
    return max((float(np.nanmax(size)) for size in sizes if np.isfinite(size).any()), default=1.0)


def _axle_panel(
    result: TyresResult, axle: str, points: dict[str, Array], roles: dict[TyreKind, str], highest: float
) -> figures.Panel:
    chosen = chosen_fit(result)
    scale = shades.shading("|lateral acceleration| [m/s²]", 0.0, highest, shown=axle == AXLES[-1])
    reach = _reach(chosen, axle, points["slip_angle"])
    traces = [*_band(chosen.curves.get(axle), reach), *_points(points, scale)]
    for fit in sorted(result.fits, key=lambda fit: fit.kind == result.chosen):
        traces += _curve(fit, axle, reach, roles[fit.kind], bold=fit is chosen)
    largest = _largest(chosen.curves.get(axle), points, reach)
    return figures.Panel(
        f"{axle} axle",
        traces,
        x="slip angle [mrad]",
        y="lateral force of the axle [kN]",
        x_range=(-1e3 * reach, 1e3 * reach),
        y_range=(-ROOM * largest, ROOM * largest),
        marks=[figures.level(0.0, "grid"), figures.level(0.0, "grid", along="y")],
        ticks=(9, 9),
    )


def _reach(fit: TyreFit, axle: str, slip: Array) -> float:
    """Say how far the axis of the slip angle goes to either side [rad]."""
    excited = max((abs(end) for end in fit.excited.get(axle, [])), default=0.0)
    seen = float(np.percentile(np.abs(slip), 99.5)) if slip.size else 0.0
    return max(BEYOND * excited, 1.05 * seen) or 0.1


def _largest(curve: AxleCurve | None, points: dict[str, Array], reach: float) -> float:
    """Find the largest force that is to be seen [kN]."""
    sizes = [1e-3 * float(np.percentile(np.abs(points["force"]), 99.5))] if points["force"].size else []
    if curve is not None:
        slip, force = np.array(curve.slip_angle), np.abs(curve.force)
        inside = force[np.abs(slip) <= reach]
        sizes += [1e-3 * float(inside.max())] if inside.size else []
    return max(sizes, default=0.0) or 1.0


def _points(points: dict[str, Array], scale: dict[str, Any]) -> list[figures.Trace]:
    slip, force = 1e3 * points["slip_angle"], 1e-3 * points["force"]
    kept = spread_out(slip, force, CELLS)
    acceleration = np.abs(points["lateral_acceleration"])
    order = kept[np.argsort(np.nan_to_num(acceleration[kept]))]
    drawn = [
        shades.points(
            slip[order], force[order], acceleration[order], "from the motion", scale=scale, hover=POINT_HOVER
        )
    ]
    measured = 1e-3 * points["measured_force"]
    there = np.flatnonzero(np.isfinite(measured))
    if there.size:
        kept = there[spread_out(slip[there], measured[there], CELLS)]
        drawn.append(
            shades.dots(slip[kept], measured[kept], "measured", "measured at the wheels", hover=HOVER)
        )
    return drawn


def _band(curve: AxleCurve | None, reach: float) -> list[figures.Trace]:
    """Fill what the errors of the parameters leave open of the chosen curve."""
    if curve is None:
        return []
    slip, force, std = (np.array(part) for part in (curve.slip_angle, curve.force, curve.force_std))
    inside = np.abs(slip) <= reach
    slip, force, room = 1e3 * slip[inside], 1e-3 * force[inside], 1e-3 * NORMAL_95 * std[inside]
    return [shades.filled(slip, force - room, force + room, "band", "95 % band")]


def _curve(fit: TyreFit, axle: str, reach: float, role: str, *, bold: bool) -> list[figures.Trace]:
    """Draw a curve solid where the data excites it and dashed beyond."""
    curve = fit.curves.get(axle)
    if curve is None:
        return []
    slip, force = np.array(curve.slip_angle), np.array(curve.force)
    low, high = fit.excited.get(axle) or [0.0, 0.0]
    x = np.unique(np.concatenate([slip[np.abs(slip) <= reach], np.clip([low, high], slip[0], slip[-1])]))
    y = np.interp(x, slip, force)
    traces = []
    for inside, dash in (
        (np.where((x >= low) & (x <= high), y, np.nan), "solid"),
        (_outside(x, y, low, high), "7px,5px"),
    ):
        trace = figures.curve(1e3 * x, 1e-3 * inside, role, KINDS[fit.kind], dash=dash, hover=HOVER)
        line = {**trace["line"], "width": 3.5 if bold else 1.8}
        traces.append({**trace, "line": line, "legendgroup": fit.kind, "connectgaps": False})
    return traces


def _outside(x: Array, y: Array, low: float, high: float) -> Array:
    """Keep what lies beyond an interval, its ends included."""
    return np.where((x <= low) | (x >= high), y, np.nan)


def _caption(result: TyresResult, found: dict[str, dict[str, Array]]) -> str:
    total = sum(points["slip_angle"].size for points in found.values())
    drawn = sum(spread_out(points["slip_angle"], points["force"], CELLS).size for points in found.values())
    curves = (
        f"Curves: each fit, bold the chosen one ({KINDS[result.chosen]}) with its 95 % band; solid where the "
        "data excites the slip angle, dashed beyond, where the curve is a guess."
    )
    parts = ["Points: force that the motion needs (force inversion), shaded by lateral acceleration.", curves]
    if drawn < total:
        parts.append(
            f"{count(drawn, 'point')} drawn of {count(total, 'point')}, so that the cloud keeps its shape."
        )
    return " ".join(parts)


def correlation_figure(fit: TyreFit) -> Figure | None:
    """Draw the correlations of the parameters of a fit as a map, None for fewer than two."""
    if len(fit.parameters) < 2:
        return None
    names = [short_name(name) for name in fit.parameters]
    values = np.array(fit.correlation, dtype=np.float64)
    trace = shades.heat(values, names, names, hover="%{y} and %{x}: %{z:.3f}")
    side = 30 * len(names)
    spec, height = figures.grid(
        [figures.Panel("", [trace], x="", y="")],
        figures.Layout(columns=1, row_height=max(200, 60 + side), left=110, legend=False),
    )
    layout = spec["layout"]
    layout["yaxis"] |= {"autorange": "reversed", "showgrid": False}
    layout["xaxis"] |= {"showgrid": False}
    for axis in ("xaxis", "yaxis"):
        layout[axis].pop("nticks", None)
        layout[axis] |= {"tickmode": "linear"}
    return Figure(spec, height, "How far can the parameters stand for each other?", strongest(fit))


def strongest(fit: TyreFit) -> str:
    """Name the pair of parameters that stand for each other most."""
    values = np.abs(np.array(fit.correlation, dtype=np.float64))
    np.fill_diagonal(values, 0.0)
    values = np.nan_to_num(values)
    first, second = np.unravel_index(int(values.argmax()), values.shape)
    pair: Sequence[str] = (fit.parameters[first], fit.parameters[second])
    text = (
        "Correlation of the errors: near ±1 the data fix only a combination of the two. "
        f"Strongest: {short_name(pair[0])} and {short_name(pair[1])} ({fit.correlation[first][second]:.2f})."
    )
    return text.replace("-", "−")
