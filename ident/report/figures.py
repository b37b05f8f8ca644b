"""Figures as plotly.js specifications: plain dictionaries, drawn by the script in the page.

A figure is a grid of panels, each with its own two axes (never two scales on one axis). plotly.js reads
some HTML in its labels, so every text that may come from a log goes through ``label``.
"""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ident.report.condense import Line
from ident.report.numbers import plain, shorten
from ident.report.palette import LIGHT

Array = NDArray[np.float64]
Trace = dict[str, Any]

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Noto Sans', 'DejaVu Sans', sans-serif"
WIDTH = 1180.0
"""Width at which the gaps between panels are right [px]; figures stretch with the window."""


LEGEND = 22
"""Height of the line that holds the figure's title and its legend [px]."""
RIGHT = 12
"""Margin at the right [px]."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    x, y : titles of the axes with their units
    x_range, y_range : by default what the data needs
    categories : labels of the y axis at 0, 1, 2, …, in place of numbers
    marks : shapes under the lines, as ``band`` and ``level`` make them
    x_log, y_log : where labels may stand on a logarithmic axis; without them the axis is linear
    x_ticks : whether the x axis has labels; without them where the panel below has the same axis
    ticks : how many labels the x and the y axis have at most
    """

    title: str
    traces: Sequence[Trace]
    x: str
    y: str
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    categories: Sequence[str] | None = None
    marks: Sequence[dict[str, Any]] = ()
    x_ticks: bool = True
    ticks: tuple[int, int] = (7, 7)
    x_log: Sequence[float] = ()
    y_log: Sequence[float] = ()


@dataclass(frozen=True)
class Layout:
    """How panels are arranged.

    columns : panels side by side
    row_height : of one row of panels, the mean where ``row_shares`` differ [px]
    share_x : the panels of a column zoom together along x
    left : room for the labels of the y axis [px]
    gap : room between two panels [px], with those labels
    """

    columns: int
    row_height: int
    share_x: bool = False
    left: int = 56
    gap: int = 58
    legend: bool = True
    row_shares: Sequence[float] = field(default_factory=tuple)


EMPTY = Panel("", (), x="", y="")
"""Leaves a place of the grid free."""


def label(text: str, length: int = 60) -> str:
    """Make text from a log safe to be a label: escaped, on one line, cut in its middle when too long."""
    return html.escape(shorten(plain(text), length), quote=False).replace("%{", "% {")


def line(
    drawn: Line,
    role: str,
    name: str,
    *,
    unit: str = "rad",
    held: bool = False,
    width: float = 1.6,
    opacity: float = 1.0,
) -> Trace:
    """Draw a line in the colour of its role (a key of the palette).

    held : the value stays until the next, as a command does
    """
    return {
        "type": "scatter",
        "mode": "lines",
        "x": drawn.time,
        "y": drawn.value,
        "name": label(name),
        "legendgroup": role,
        "opacity": opacity,
        "connectgaps": False,
        "line": {"color": LIGHT[role], "width": width, "shape": "hv" if held else "linear"},
        "hovertemplate": f"%{{y:.4g}} {label(unit)} at %{{x:.3f}} s<extra>{label(name)}</extra>",
    }


def curve(
    x: Array, y: Array, role: str, name: str, *, dash: str = "solid", hover: str = "%{y:.3g} at %{x:.3g}"
) -> Trace:
    """Draw a curve that is not a signal over time."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": label(name),
        "line": {"color": LIGHT[role], "width": 2, "dash": dash},
        "hovertemplate": f"{hover}<extra>{label(name)}</extra>",
    }


def bars(
    x: Array, y: Array, role: str, name: str, *, width: float, hover: str = "%{y:.3g} at %{x:.3g}"
) -> Trace:
    """Draw bars centred on ``x``."""
    return {
        "type": "bar",
        "x": x,
        "y": y,
        "width": width,
        "name": label(name),
        "marker": {"color": LIGHT[role], "opacity": 0.75, "line": {"width": 0}},
        "hovertemplate": f"{hover}<extra>{label(name)}</extra>",
    }


def whiskers(value: Array, low: Array, high: Array, row: Array, role: str, name: str, *, unit: str) -> Trace:
    """Draw a dot for each value with its interval, one a row."""
    shown = unit if unit != "1" else ""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": value,
        "y": row,
        "name": label(name),
        "marker": {"color": LIGHT[role], "size": 8},
        "error_x": {
            "type": "data",
            "array": high - value,
            "arrayminus": value - low,
            "color": LIGHT[role],
            "thickness": 1.6,
            "width": 4,
        },
        "customdata": np.column_stack([low, high]),
        "hovertemplate": "%{x:.4g} (%{customdata[0]:.4g} … %{customdata[1]:.4g}) "
        + label(shown)
        + "<extra></extra>",
    }


def band(low: float, high: float, role: str, *, along: str = "x") -> dict[str, Any]:
    """Shade the range low … high of one axis, behind the lines."""
    across = (
        {"yref": "y domain", "y0": 0, "y1": 1} if along == "x" else {"xref": "x domain", "x0": 0, "x1": 1}
    )
    return {
        "type": "rect",
        "layer": "below",
        "fillcolor": LIGHT[role],
        "line": {"width": 0},
        f"{along}0": low,
        f"{along}1": high,
        f"{along}ref": along,
        **across,
    }


def level(at: float, role: str, *, along: str = "x", dash: str = "solid") -> dict[str, Any]:
    """Draw a straight line across the panel where the axis ``along`` has the value ``at``."""
    return {
        **band(at, at, role, along=along),
        "type": "line",
        "line": {"color": LIGHT[role], "width": 1.2, "dash": dash},
    }


def grid(panels: Sequence[Panel], arrangement: Layout) -> tuple[dict[str, Any], int]:
    """Arrange panels row by row.

    Returns
    -------
    spec, height : of plotly.js; height of the whole figure [px]
    """
    rows = -(-len(panels) // arrangement.columns)
    height = rows * arrangement.row_height + (LEGEND if arrangement.legend else 8)
    layout = _base_layout(arrangement, height)
    boxes = _boxes(panels, arrangement, height - layout["margin"]["t"])
    traces: list[Trace] = []
    seen: set[str] = set()
    for index, panel in enumerate(panels):
        if panel is EMPTY:
            continue
        place = "" if index == 0 else str(index + 1)
        box = boxes[index]
        layout[f"xaxis{place}"] = _x_axis(panel, place, box)
        if arrangement.share_x and index >= arrangement.columns:
            above = index % arrangement.columns
            layout[f"xaxis{place}"]["matches"] = f"x{above + 1 if above else ''}"
        layout[f"yaxis{place}"] = _y_axis(panel, place, box)
        layout["annotations"] += [_title(panel, box)] if panel.title else []
        layout["shapes"] += [_on_axes(mark, place) for mark in panel.marks]
        for trace in panel.traces:
            shown = arrangement.legend and trace["name"] not in seen
            seen.add(trace["name"])
            traces.append({**trace, "xaxis": f"x{place}", "yaxis": f"y{place}", "showlegend": shown})
    return {"data": traces, "layout": layout}, height


def _base_layout(arrangement: Layout, height: int) -> dict[str, Any]:
    return {
        "height": height,
        "margin": {"l": arrangement.left, "r": RIGHT, "t": LEGEND if arrangement.legend else 8, "b": 0},
        "font": {"family": FONT, "size": 12, "color": LIGHT["text"]},
        "paper_bgcolor": LIGHT["surface"],
        "plot_bgcolor": LIGHT["surface"],
        "hovermode": "closest",
        "bargap": 0,
        "showlegend": arrangement.legend,
        "legend": {
            "orientation": "h",
            "x": 0.32,
            "xanchor": "left",
            "y": 1,
            "yanchor": "top",
            "yref": "container",
            "font": {"size": 12},
        },
        "annotations": [],
        "shapes": [],
    }


@dataclass(frozen=True)
class _Box:
    """Place of a panel's axes, in parts of the drawing area."""

    left: float
    right: float
    bottom: float
    top: float


HEAD, BARE_HEAD = 26, 10
"""Room above the axes, with and without a title [px]."""
FOOT, TICKS_FOOT, BARE_FOOT = 46, 24, 10
"""Room below the axes, with a title, with tick labels only, with neither [px]."""


def _boxes(panels: Sequence[Panel], arrangement: Layout, area: float) -> list[_Box]:
    """Place all panels in an area so many pixels high."""
    columns = arrangement.columns
    rows = [panels[start : start + columns] for start in range(0, len(panels), columns)]
    heads = [HEAD if any(panel.title for panel in row) else BARE_HEAD for row in rows]
    feet = [_foot(row) for row in rows]
    shares = np.array(arrangement.row_shares or [1.0] * len(rows))
    heights = shares / shares.sum() * (area - sum(heads) - sum(feet))
    tops = np.cumsum([head + 0.0 for head in heads])
    tops[1:] += np.cumsum(heights + feet)[:-1]
    gap = arrangement.gap / (WIDTH - arrangement.left - RIGHT)
    width = (1 - gap * (columns - 1)) / columns
    boxes = []
    for index in range(len(panels)):
        row, column = divmod(index, columns)
        left, below = column * (width + gap), tops[row] + heights[row]
        boxes.append(
            _Box(left, min(1.0, left + width), max(0.0, float(1 - below / area)), float(1 - tops[row] / area))
        )
    return boxes


def _foot(row: Sequence[Panel]) -> int:
    if any(panel.x for panel in row):
        return FOOT
    return TICKS_FOOT if any(panel.x_ticks for panel in row) else BARE_FOOT


def _axis(title: str, domain: list[float], anchor: str) -> dict[str, Any]:
    return {
        "title": {"text": title, "standoff": 6, "font": {"size": 12, "color": LIGHT["muted"]}},
        "domain": domain,
        "anchor": anchor,
        "gridcolor": LIGHT["grid"],
        "linecolor": LIGHT["axis"],
        "showline": True,
        "zeroline": False,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": LIGHT["axis"],
        "tickfont": {"size": 11, "color": LIGHT["muted"]},
    }


def _x_axis(panel: Panel, place: str, box: _Box) -> dict[str, Any]:
    axis = _axis(panel.x, [box.left, box.right], f"y{place}")
    axis["nticks"] = panel.ticks[0]
    axis["tickangle"] = 0
    if panel.x_range:
        axis["range"] = list(panel.x_range)
    if panel.x_ticks is False:
        axis["showticklabels"] = False
    return _logarithmic(axis, panel.x_log)


def _y_axis(panel: Panel, place: str, box: _Box) -> dict[str, Any]:
    axis = _axis(panel.y, [box.bottom, box.top], f"x{place}")
    axis["nticks"] = panel.ticks[1]
    if panel.y_range:
        axis["range"] = list(panel.y_range)
    if panel.categories is not None:
        axis["tickvals"] = list(range(len(panel.categories)))
        axis["ticktext"] = [label(name, 30) for name in panel.categories]
        axis["range"] = [len(panel.categories) - 0.4, -0.6]
        del axis["nticks"]
    return _logarithmic(axis, panel.y_log)


def _logarithmic(axis: dict[str, Any], ticks: Sequence[float]) -> dict[str, Any]:
    """Make an axis logarithmic with labels where they may stand; without such places leave it linear.

    plotly.js wants the range of such an axis as logarithms, and shapes on it as plain values.
    """
    if not ticks:
        return axis
    shown = {**axis, "type": "log", "tickvals": list(ticks), "ticktext": [f"{tick:g}" for tick in ticks]}
    if "range" in axis:
        shown["range"] = [math.log10(end) for end in axis["range"]]
    del shown["nticks"]
    return shown


def _title(panel: Panel, box: _Box) -> dict[str, Any]:
    return {
        "text": f"<b>{label(panel.title)}</b>",
        "xref": "paper",
        "yref": "paper",
        "x": box.left,
        "xanchor": "left",
        "y": box.top,
        "yanchor": "bottom",
        "yshift": 3,
        "showarrow": False,
        "font": {"size": 12.5},
    }


def _on_axes(mark: dict[str, Any], place: str) -> dict[str, Any]:
    """Move a shape made for the first panel to the panel at ``place``."""
    moved = dict(mark)
    for key in ("xref", "yref"):
        letter, _, rest = str(mark[key]).partition(" ")
        moved[key] = f"{letter}{place} {rest}".strip()
    return moved
