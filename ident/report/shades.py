"""Traces that show a third value or an area: shaded points, marks, bands between curves, matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.report.condense import Array
from ident.report.figures import Trace, label
from ident.report.numbers import fixed
from ident.report.palette import LIGHT

MOST_LABELLED = 9
"""A map of more cells than this side by side has no numbers in them."""


def points(
    x: Array,
    y: Array,
    shade: Array,
    name: str,
    *,
    scale: dict[str, Any],
    hover: str,
    size: float = 4,
) -> Trace:
    """Draw points whose shade tells a third value, on a ``scale`` as ``shading`` gives it."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": x,
        "y": y,
        "name": label(name),
        "marker": {"color": shade, "size": size, **scale},
        "customdata": shade,
        "hovertemplate": f"{hover}<extra>{label(name)}</extra>",
    }


def dots(x: Array, y: Array, role: str, name: str, *, hover: str, symbol: str = "x-thin-open") -> Trace:
    """Draw small marks of one colour."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": x,
        "y": y,
        "name": label(name),
        "marker": {"color": LIGHT[role], "size": 3, "symbol": symbol, "opacity": 0.5},
        "hovertemplate": f"{hover}<extra>{label(name)}</extra>",
    }


def shading(title: str, low: float, high: float, *, shown: bool) -> dict[str, Any]:
    """Give the scale that ``points`` are shaded with.

    shown : draw the bar that explains it, right of all panels
    """
    stops = ("scale_low", "scale_middle", "scale_high")
    text = {"size": 11, "color": LIGHT["muted"]}
    bar = {"thickness": 10, "outlinewidth": 0, "len": 0.92, "tickfont": text}
    return {
        "cmin": low,
        "cmax": high,
        "colorscale": [[index / 2, LIGHT[role]] for index, role in enumerate(stops)],
        "showscale": shown,
        "colorbar": {**bar, "title": {"text": title, "side": "right", "font": text}},
    }


def filled(x: Array, low: Array, high: Array, role: str, name: str) -> Trace:
    """Fill between two curves."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": np.concatenate([x, x[::-1]]),
        "y": np.concatenate([high, low[::-1]]),
        "name": label(name),
        "fill": "toself",
        "fillcolor": LIGHT[role],
        "line": {"width": 0, "color": LIGHT[role]},
        "hoverinfo": "skip",
    }


def heat(values: Array, x: Sequence[str], y: Sequence[str], *, hover: str) -> Trace:
    """Draw a matrix of values in -1 … 1, the numbers in its cells where they fit."""
    stops = ("minus", "between", "plus")
    cells = [["" if np.isnan(value) else fixed(float(value), 2) for value in row] for row in values]
    return {
        "type": "heatmap",
        "name": "",
        "z": values,
        "x": [label(name, 30) for name in x],
        "y": [label(name, 30) for name in y],
        "zmin": -1,
        "zmax": 1,
        "xgap": 1,
        "ygap": 1,
        "colorscale": [[index / 2, LIGHT[role]] for index, role in enumerate(stops)],
        "colorbar": {"thickness": 10, "outlinewidth": 0, "tickfont": {"size": 11, "color": LIGHT["muted"]}},
        "text": cells,
        "texttemplate": "%{text}" if len(x) <= 12 else "",
        "hovertemplate": f"{hover}<extra></extra>",
    }


def ranges(x: Array, y: Array, low: Array, high: Array, role: str, name: str, *, hover: str) -> Trace:
    """Draw a line through values with their intervals."""
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": x,
        "y": y,
        "name": label(name),
        "legendgroup": label(name),
        "line": {"color": LIGHT[role], "width": 1.8},
        "marker": {"color": LIGHT[role], "size": 5},
        "error_y": {
            "type": "data",
            "array": high - y,
            "arrayminus": y - low,
            "color": LIGHT[role],
            "thickness": 1.2,
            "width": 3,
        },
        "customdata": np.column_stack([low, high]),
        "hovertemplate": f"{hover}<extra>{label(name)}</extra>",
    }


def mark(x: float, y: float, role: str, name: str, *, filled: bool, hover: str) -> Trace:
    """Draw one large mark, filled or open."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [x],
        "y": [y],
        "name": label(name),
        "legendgroup": label(name),
        "marker": {
            "color": LIGHT[role],
            "size": 12,
            "symbol": "circle" if filled else "circle-open",
            "line": {"width": 2, "color": LIGHT[role]},
        },
        "hovertemplate": f"{hover}<extra>{label(name)}</extra>",
    }


def cells(values: Array, x: Sequence[float], y: Sequence[float], name: str, *, hover: str) -> Trace:
    """Draw a map of values over cells: (len(y) - 1, len(x) - 1) values between the edges, NaN left blank."""
    stops = ("scale_low", "scale_middle", "scale_high")
    return {
        "type": "heatmap",
        "name": label(name),
        "z": values,
        "x": list(x),
        "y": list(y),
        "xgap": 1,
        "ygap": 1,
        "zmin": 0,
        "colorscale": [[index / 2, LIGHT[role]] for index, role in enumerate(stops)],
        "showscale": False,
        "text": [[_whole_seconds(float(value)) for value in row] for row in values],
        "texttemplate": "%{text}" if len(x) <= MOST_LABELLED else "",
        "textfont": {"size": 10},
        "hovertemplate": f"{hover}<extra></extra>",
    }


def _whole_seconds(value: float) -> str:
    if not np.isfinite(value):
        return ""
    return "< 1 s" if value < 1 else f"{value:.0f} s"
