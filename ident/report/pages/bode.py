"""The frequency response on the steering page: Bode plot, harmonics, coherence, bandwidth check."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ident.report import bode, figures
from ident.report.bode import Bode, Marks
from ident.report.estimates import estimate_cells
from ident.report.numbers import (
    NONE,
    fixed,
    percent,
    significant,
    unit_text,
)
from ident.report.page import Block, Cell, Column, Figure, Table, Text, Tone
from ident.report.palette import LIGHT
from ident.results import Bandwidth, Cutoff, Estimate, FrequencyPoint, SteeringResult

FREQUENCY = "frequency [rad/s]"
NAMES = {"sine": "sine", "h1": "spectrum (H1)"}
ROLES = {"sine": "measured", "h1": "residual"}
SYMBOLS = {"sine": "circle", "h1": "diamond-open"}
TICKS = [base * 10.0**power for power in range(-3, 4) for base in (1, 2, 5)]
MOST_ROWS = 14


def frequency_blocks(result: SteeringResult) -> list[Block]:
    """Give the bandwidth check in one line, the plots and the tables."""
    blocks: list[Block] = []
    if result.bandwidth:
        blocks += [Text(*verdict(result.bandwidth)), bandwidth_table(result.bandwidth)]
    gathered = bode.gather(result)
    if gathered.gain or gathered.curve_gain:
        blocks.append(bode_figure(gathered, result.bandwidth))
    points = result.frequency_response
    if not points:
        return [*blocks, Text("No sine and no chirp was found: drive sines of 0.1 to 10 rad/s.", "muted")]
    linear = linearity_figure(points)
    return [*blocks, *([linear] if linear else []), points_table(points)]


def verdict(bandwidth: Bandwidth) -> tuple[str, Tone]:
    """Say whether model and measurements agree on the bandwidth, and in which colour."""
    if bandwidth.overlap is None:
        return f"Bandwidth check not possible: {bandwidth.reason}.", "caution"
    if bandwidth.overlap:
        return f"Bandwidth check passed: {bandwidth.reason}.", "good"
    return f"Bandwidth check failed: {bandwidth.reason}.", "bad"


def bandwidth_table(bandwidth: Bandwidth) -> Table:
    """Give the three bandwidths side by side."""
    columns = [
        Column("bandwidth"),
        Column("value", "number"),
        Column("95 % interval", "number"),
        Column("unit"),
        Column("status"),
    ]
    rows = [
        _estimate_row("Bode: −3 dB of the transfer function", bandwidth.bode),
        _estimate_row("measured: −3 dB crossing of the points", bandwidth.measured),
        _cutoff_row(bandwidth.sine_cutoff),
    ]
    notes = [
        "−3 dB: 1/√2 of the DC gain, which is the identified K",
        "sine cut-off: from the fastest sine whose answer is still significant to the next one driven",
    ]
    return Table(columns, rows, notes=notes, download="bandwidth.csv")


def _estimate_row(name: str, one: Estimate) -> list[Cell]:
    return [Cell(name, detail=one.reason), *estimate_cells(one)]


def _cutoff_row(cutoff: Cutoff | None) -> list[Cell]:
    name = "sine cut-off"
    if cutoff is None:
        return [Cell(name, detail="no sines"), Cell(NONE), Cell(NONE), Cell("rad/s"), Cell(NONE)]
    if cutoff.high is None:
        text, status = f"above {significant(cutoff.low)}", Cell("not reached", tone="caution", badge=True)
    else:
        text, status = f"{significant(cutoff.low)} … {significant(cutoff.high)}", Cell(NONE)
    return [Cell(name), Cell(NONE), Cell(text), Cell(unit_text(cutoff.unit)), status]


def bode_figure(gathered: Bode, bandwidth: Bandwidth | None) -> Figure:
    """Draw gain and phase over frequency, and below how far the points lie off the model."""
    window = _window(gathered)
    marks = _bandwidth_marks(bandwidth)
    limit = (
        [] if gathered.limit is None else [figures.level(gathered.limit, "bad_line", along="y", dash="dash")]
    )
    gain_traces = [*_curve(gathered.curve_gain, "dB"), *_points(gathered.gain, "dB")]
    phase_traces = [*_curve(gathered.curve_phase, "rad"), *_points(gathered.phase, "rad")]
    panels = [
        _panel("gain", gain_traces, "gain [dB]", window, [*marks, *limit]),
        _panel("phase", phase_traces, "phase [rad]", window, marks),
    ]
    shares: tuple[float, ...] = (1.0,)
    if gathered.gain_off:
        gain_off = [*_curve(gathered.curve_gain_off, "%"), *_points(gathered.gain_off, "%")]
        phase_off = [*_curve(gathered.curve_phase_off, "mrad"), *_points(gathered.phase_off, "mrad")]
        panels += [
            _panel("", gain_off, "gain off the model [%]", window, marks, _range_off(gathered.gain_off)),
            _panel("", phase_off, "off the model [mrad]", window, marks, _range_off(gathered.phase_off)),
        ]
        shares = (1.6, 1.0)
    layout = figures.Layout(columns=2, row_height=270, share_x=True, gap=70, left=62, row_shares=shares)
    spec, height = figures.grid(panels, layout)
    return Figure(spec, height, "Bode plot", _bode_caption(gathered, bandwidth))


def _panel(
    title: str,
    traces: Sequence[figures.Trace],
    y: str,
    window: tuple[float, float],
    marks: Sequence[dict[str, Any]],
    y_range: tuple[float, float] | None = None,
) -> figures.Panel:
    return figures.Panel(
        title,
        traces,
        x=FREQUENCY,
        y=y,
        x_range=window,
        y_range=y_range,
        marks=marks,
        x_log=TICKS,
        ticks=(7, 6),
    )


def _window(gathered: Bode) -> tuple[float, float]:
    """Smallest and largest frequency drawn [rad/s]."""
    all_marks = [*gathered.gain.values(), *([gathered.curve_gain] if gathered.curve_gain else [])]
    low = min(float(marks.frequency.min()) for marks in all_marks)
    high = max(float(marks.frequency.max()) for marks in all_marks)
    return low / 1.05, high * 1.05


def _range_off(points: Mapping[str, Marks]) -> tuple[float, float]:
    """Choose an axis about zero that shows every point, and every whisker but the very long ones."""
    value = np.concatenate([marks.value for marks in points.values()])
    half = np.concatenate([marks.high - marks.value for marks in points.values()])
    reach = float(np.max(np.abs(value) + np.minimum(half, 4 * np.median(half))))
    return (-1.1 * reach, 1.1 * reach) if reach > 0 else (-1.0, 1.0)


def _bandwidth_marks(bandwidth: Bandwidth | None) -> list[dict[str, Any]]:
    """Shade the sine cut-off and the bandwidth of the model, and draw a line at the latter."""
    marks: list[dict[str, Any]] = []
    if bandwidth is None:
        return marks
    cutoff, one = bandwidth.sine_cutoff, bandwidth.bode
    if cutoff is not None and cutoff.high is not None and cutoff.low > 0:
        marks.append(figures.band(cutoff.low, cutoff.high, "good_fill"))
    if one.value is not None:
        if one.low is not None and one.high is not None:
            marks.append(figures.band(one.low, one.high, "band"))
        marks.append(figures.level(one.value, "modelled", dash="dot"))
    return marks


def _curve(curve: Marks | None, unit: str) -> list[figures.Trace]:
    """Draw the model with its 95 % band."""
    if curve is None:
        return []
    around = np.concatenate([curve.frequency, curve.frequency[::-1]])
    edge = np.concatenate([curve.high, curve.low[::-1]])
    band = {
        **figures.curve(around, edge, "band", "model, 95 %"),
        "fill": "toself",
        "fillcolor": LIGHT["band"],
        "line": {"color": LIGHT["band"], "width": 0},
        "hoverinfo": "skip",
    }
    del band["hovertemplate"]
    hover = f"%{{y:.4g}} {unit} at %{{x:.4g}} rad/s"
    return [band, figures.curve(curve.frequency, curve.value, "modelled", "model", hover=hover)]


def _points(points: Mapping[str, Marks], unit: str) -> list[figures.Trace]:
    return [_marks(marks, ROLES[name], NAMES[name], SYMBOLS[name], unit) for name, marks in points.items()]


def _marks(marks: Marks, role: str, name: str, symbol: str, unit: str) -> figures.Trace:
    """Draw points with whiskers up and down, without where they have no length."""
    whiskers = {
        "type": "data",
        "array": marks.high - marks.value,
        "arrayminus": marks.value - marks.low,
        "color": LIGHT[role],
        "thickness": 1.4,
        "width": 4,
        "visible": bool(np.any(marks.high > marks.low)),
    }
    return {
        "error_y": whiskers,
        "type": "scatter",
        "mode": "markers",
        "x": marks.frequency,
        "y": marks.value,
        "name": figures.label(name),
        "legendgroup": role,
        "marker": {"color": LIGHT[role], "size": 7, "symbol": symbol},
        "text": [figures.label(run, 40) for run in marks.labels],
        "customdata": np.column_stack([marks.low, marks.high]),
        "hovertemplate": "%{y:.4g} (%{customdata[0]:.4g} … %{customdata[1]:.4g}) "
        + unit
        + " at %{x:.4g} rad/s, %{text}<extra></extra>",
    }


def _bode_caption(gathered: Bode, bandwidth: Bandwidth | None) -> str:
    text = "Points: measured, with 95 % intervals. Line and band: the identified transfer function."
    if gathered.limit is not None:
        text += f" Dashed: −3 dB below the DC gain, {fixed(gathered.limit, 2)} dB."
    if bandwidth and bandwidth.bode.value is not None:
        text += " Dotted: bandwidth of the transfer function, its 95 % interval shaded."
    if bandwidth and bandwidth.sine_cutoff and bandwidth.sine_cutoff.high is not None:
        text += " Green: from the last sine above −3 dB to the first below."
    if gathered.gain_off:
        text += " Below: the same points against the model, on a scale that shows their errors."
    return text


def linearity_figure(points: Sequence[FrequencyPoint]) -> Figure | None:
    """Draw the harmonics of the sines and what noise alone would give, and the coherence of spectra."""
    window = min(p.frequency for p in points) / 1.2, max(p.frequency for p in points) * 1.2
    panels = [panel for order in (2, 3) if (panel := _harmonic_panel(points, order, window))]
    loss = bode.coherence(points)
    if loss.value.size:
        traces = [_marks(loss, "residual", NAMES["h1"], SYMBOLS["h1"], "")]
        panels.append(
            figures.Panel(
                "1 − coherence",
                traces,
                x=FREQUENCY,
                y="1 − coherence [–]",
                x_range=window,
                x_log=TICKS,
                y_log=[10.0**power for power in range(-12, 1)],
                y_range=(0.3 * float(loss.value.min()), min(1.0, 3 * float(loss.value.max()))),
            )
        )
    if not panels:
        return None
    layout = figures.Layout(columns=max(2, len(panels)), row_height=250, gap=70, left=62)
    spec, height = figures.grid([*panels, *[figures.EMPTY] * (2 - len(panels))], layout)
    return Figure(spec, height, "Is the answer linear?", _linearity_caption(points))


def _harmonic_panel(
    points: Sequence[FrequencyPoint], order: int, window: tuple[float, float]
) -> figures.Panel | None:
    marks = bode.harmonics(points, order)
    if marks.value.size == 0:
        return None
    noise = bode.noise_level(points, order)
    hover = "%{y:.3g} % at %{x:.4g} rad/s"
    traces = [
        figures.curve(
            noise.frequency, noise.value, "modelled", "95 % of noise alone", dash="dot", hover=hover
        ),
        _marks(marks, "measured", "sine", "circle", "%"),
    ]
    top = 1.15 * float(max(np.max(marks.value), np.max(noise.value)))
    return figures.Panel(
        f"harmonic {order}",
        traces,
        x=FREQUENCY,
        y="of the fundamental [%]",
        x_range=window,
        x_log=TICKS,
        y_range=(0.0, top or 1.0),
    )


def _linearity_caption(points: Sequence[FrequencyPoint]) -> str:
    sines = [p for p in points if p.method == "sine"]
    parts = []
    if sines:
        strong = bode.significant_harmonics(sines)
        said = {0: "none is", 1: "one is"}.get(strong, f"{strong} are")
        parts.append(f"A linear actuator has no harmonics: {said} more than three times the level of noise.")
    if any(p.coherence is not None for p in points):
        parts.append("Coherence: share of the measured power that the request explains linearly.")
    return " ".join(parts)


def points_table(points: Sequence[FrequencyPoint]) -> Table:
    """Give every point with its standard errors."""
    columns = [
        Column("frequency [rad/s]", "number"),
        Column("from"),
        Column("run", wrap=True),
        Column("amplitude [rad]", "number"),
        Column("gain", "number"),
        Column("phase [rad]", "number"),
        Column("harmonic 2", "number"),
        Column("harmonic 3", "number"),
        Column("coherence", "number"),
    ]
    rows = [_point_row(point) for point in points]
    notes = ["± standard error; gain and phase are against the held command's own fundamental"]
    return Table(columns, rows, notes=notes, download="frequency_response.csv", scroll=len(rows) > MOST_ROWS)


def _point_row(point: FrequencyPoint) -> list[Cell]:
    coherent = point.coherence
    return [
        Cell(significant(point.frequency, 4), raw=point.frequency),
        Cell(NAMES[point.method]),
        Cell(point.run),
        Cell(significant(point.amplitude), raw=point.amplitude),
        _with_error(point.gain, point.gain_std),
        _with_error(point.phase, point.phase_std),
        _with_error(point.harmonic_2, point.harmonic_2_std, share=True),
        _with_error(point.harmonic_3, point.harmonic_3_std, share=True),
        Cell(percent(coherent), raw=coherent),
    ]


def _with_error(value: float | None, std: float | None, *, share: bool = False) -> Cell:
    """Give a value to two digits of its standard error, with that below."""
    if value is None or std is None:
        return Cell(NONE)
    factor, unit = (100.0, "\u00a0%") if share else (1.0, "")
    places = _places(factor * std)
    return Cell(
        fixed(factor * value, places) + unit, raw=value, detail=f"± {fixed(factor * std, places)}{unit}"
    )


def _places(std: float) -> int:
    return int(np.clip(1 - np.floor(np.log10(max(std, 1e-9))), 0, 9))
