"""Figures of the steering page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.report import figures, residuals, responses
from ident.report.condense import Array, Line, evenly, thinned
from ident.report.numbers import count, shorten, significant
from ident.report.page import Figure
from ident.report.steering_parameters import PARAMETERS
from ident.results import AmplitudeFit, Estimate, Noise, SteeringModel, SteeringResult

TIME_OF_STEP = "time since the step [s]"
TIME_OF_SINE = "time since the sine began [s]"
TIME_OF_RUN = "time since the start of the run [s]"
STEP_KINDS = {"step", "pulse"}
PANELS_FIRST = 4
STEPS_FIRST = 3
BINS_RESPONSE = 500
BINS_RUN, BINS_ALL = 1500, 20_000
"""Bins of a whole run, and of all runs together."""
MOST_RUNS_COMPARED = 30
PARAMETERS_COMPARED = 5


def first_responses(chosen: Sequence[responses.Group], found: int) -> Figure | None:
    """Draw the groups that ``choose_first`` chose of so many found."""
    if not chosen:
        return None
    return _responses(chosen, "Measured against modelled response", height=384, left=found - len(chosen))


def choose_first(groups: Sequence[responses.Group], total_lag: float | None) -> list[responses.Group]:
    """Choose the four groups that show most: three amplitudes of steps and one sine, where there are both.

    The sine is the one nearest to the corner frequency 1/(L + T1 + T2), where the lag shows most.
    """
    steps = [group for group in groups if group.kind in STEP_KINDS]
    sines = [group for group in groups if group.kind == "sine"]
    corner = 1 / (total_lag or responses.LAG_UNKNOWN)
    nearest = sorted(sines, key=lambda group: abs(np.log((group.size or corner) / corner)))
    room = STEPS_FIRST if sines else PANELS_FIRST
    chosen = [steps[index] for index in evenly(len(steps), room)]
    chosen += sorted(nearest[: PANELS_FIRST - len(chosen)], key=lambda group: group.size or 0.0)
    others = [group for group in groups if group.kind == "other"]
    return chosen + others[: PANELS_FIRST - len(chosen)]


def more_responses(groups: Sequence[responses.Group], title: str) -> list[Figure]:
    """Draw groups of one sort, four side by side."""
    fours = [groups[start : start + PANELS_FIRST] for start in range(0, len(groups), PANELS_FIRST)]
    named = [title if index == 0 else f"{title}, continued" for index in range(len(fours))]
    return [_responses(four, name, height=330) for four, name in zip(fours, named, strict=True)]


def _responses(groups: Sequence[responses.Group], title: str, *, height: int, left: int = 0) -> Figure:
    """Draw groups side by side, the angle above and the residual below on the same time axis."""
    columns = PANELS_FIRST if len(groups) > 2 else max(2, len(groups))
    padding = [figures.EMPTY] * (columns - len(groups))
    angles = [angle_panel(group) for group in groups]
    below = [residual_panel(group) for group in groups]
    layout = figures.Layout(columns=columns, row_height=height // 2, share_x=True, row_shares=(2.1, 1.0))
    spec, drawn_height = figures.grid([*angles, *padding, *below], layout)
    return Figure(spec, drawn_height, title, _caption(groups, left))


def angle_panel(group: responses.Group) -> figures.Panel:
    """Draw one group: the request grey behind, the measured angle dark, the modelled one thin on top."""
    many = len(group.responses) > 4
    requests, measured, modelled = (_joined([item[index] for item in group.responses]) for index in range(3))
    traces = [
        figures.line(requests, "request", "requested", held=True, width=1.3),
        figures.line(measured, "measured", "measured", width=2.5 if many else 4),
        figures.line(modelled, "modelled", "modelled", width=1.5),
    ]
    is_step = group.kind in STEP_KINDS
    title = f"{group.title} ({len(group.responses)}×)" if is_step else group.title
    y = "change of angle [rad]" if is_step else "angle [rad]"
    return figures.Panel(title, traces, x="", y=y, x_ticks=False)


def residual_panel(group: responses.Group) -> figures.Panel:
    """Draw the residuals of one group [mrad]."""
    lines = [Line(item.residual.time, item.residual.value * 1e3) for item in group.responses]
    trace = figures.line(_joined(lines), "residual", "residual", unit="mrad", width=1.0)
    x = TIME_OF_STEP if group.kind in STEP_KINDS else TIME_OF_SINE if group.kind == "sine" else TIME_OF_RUN
    return figures.Panel("", [trace], x=x, y="residual [mrad]", ticks=(7, 4))


def _joined(lines: Sequence[Line]) -> Line:
    """Put lines one after the other with the pen lifted between, thinned."""
    drawn = [thinned(line, BINS_RESPONSE) for line in lines if line.time.size]
    if not drawn:
        return Line(np.empty(0), np.empty(0))
    gap = np.array([np.nan])
    time = np.concatenate([part for line in drawn for part in (line.time, gap)])
    value = np.concatenate([part for line in drawn for part in (line.value, gap)])
    return Line(time[:-1], value[:-1])


def _caption(groups: Sequence[responses.Group], left: int) -> str:
    parts = []
    if any(group.kind in STEP_KINDS for group in groups):
        parts.append("Steps and pulses of equal size lie on each other, negative ones mirrored.")
    if any(group.kind == "sine" for group in groups):
        parts.append("Of a sine, a few periods from its middle are shown.")
    hidden = sum(group.found - len(group.responses) for group in groups)
    if hidden:
        parts.append(f"{count(hidden, 'more response')} of these sizes not drawn.")
    if left:
        parts.append(f"{left} more under Responses.")
    return " ".join(parts)


def runs_compared(result: SteeringResult) -> Figure | None:
    """Draw each parameter as fitted to each run alone against the common interval."""
    fits = [fit for fit in result.by_run if fit.model is not None][:MOST_RUNS_COMPARED]
    if len(fits) < 2:
        return None
    names = [shorten(fit.run, 26) for fit in fits]
    spec, height = _compared(result, names, [fit.model for fit in fits])
    caption = "Dots: each run alone, with its 95 % interval. Line and band: the model common to all runs."
    left_out = len(result.by_run) - len(fits)
    if left_out:
        caption += f" Not drawn: {count(left_out, 'run')} without a fit of its own or beyond the first"
        caption += f" {MOST_RUNS_COMPARED}."
    return Figure(spec, height, "Do the runs agree?", caption)


def amplitudes_compared(result: SteeringResult) -> Figure | None:
    """Draw each parameter as fitted to the steps of each size alone against the common interval."""
    fits = result.by_amplitude[:MOST_RUNS_COMPARED]
    if len(fits) < 2:
        return None
    names = [f"{significant(fit.amplitude)} rad ({fit.steps}×)" for fit in fits]
    spec, height = _compared(result, names, fits)
    caption = "Dots: the steps of each size alone, with 95 % intervals. Line and band: the common model."
    return Figure(spec, height, _amplitude_question(result), caption)


def _amplitude_question(result: SteeringResult) -> str:
    p = result.amplitude_p
    if p is None:
        return "Do steps of different size agree?"
    told = "p < 0.001" if p < 0.001 else f"p = {p:.2g}"
    return f"Do steps of different size agree? {'Yes' if p >= 0.05 else 'No'} ({told})"


def _compared(
    result: SteeringResult, names: Sequence[str], models: Sequence[SteeringModel | AmplitudeFit | None]
) -> tuple[dict[str, Any], int]:
    panels = [_parameter_panel(result, names, models, index) for index in range(PARAMETERS_COMPARED)]
    layout = figures.Layout(
        columns=len(panels), row_height=82 + 26 * len(names), left=190, gap=22, legend=False
    )
    return figures.grid(panels, layout)


def _parameter_panel(
    result: SteeringResult,
    names: Sequence[str],
    models: Sequence[SteeringModel | AmplitudeFit | None],
    index: int,
) -> figures.Panel:
    parameter = PARAMETERS[index]
    common = _interval(getattr(result.model, parameter.field))
    own = np.array([_interval(getattr(model, parameter.field)) for model in models])
    known = np.flatnonzero(np.isfinite(own[:, 0]))
    unit = getattr(result.model, parameter.field).unit
    marks = []
    if np.isfinite(common[0]):
        marks = [figures.band(common[1], common[2], "band"), figures.level(common[0], "modelled")]
    value, low, high = own[known].T
    trace = figures.whiskers(
        value, low, high, known.astype(np.float64), "measured", parameter.name, unit=unit
    )
    return figures.Panel(
        parameter.symbol,
        [trace],
        x=parameter.name + (f" [{unit}]" if unit != "1" else ""),
        y="",
        x_range=shown_range(np.vstack([own, common])),
        categories=list(names) if index == 0 else [""] * len(names),
        marks=marks,
        ticks=(4, 7),
    )


def _interval(estimate: Estimate) -> tuple[float, float, float]:
    """Give value, low and high; NaN without a value, an interval of no length where there is none."""
    value = estimate.value
    if value is None:
        return (math.nan, math.nan, math.nan)
    ends = [value if end is None else end for end in (estimate.low, estimate.high)]
    return (value, ends[0], ends[1])


def shown_range(intervals: Array) -> tuple[float, float] | None:
    """Choose an axis that shows every value, and every interval but those far longer than the others.

    Parameters
    ----------
    intervals : (n, 3) value, low, high; NaN where there is none
    """
    rows = intervals[np.isfinite(intervals[:, 0])]
    if rows.size == 0:
        return None
    value, reach = rows[:, 0], np.maximum(rows[:, 0] - rows[:, 1], rows[:, 2] - rows[:, 0])
    reach = np.minimum(reach, 4 * np.median(reach))
    low, high = float((value - reach).min()), float((value + reach).max())
    room = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
    return (low - room, high + room)


def residual_tests(blocks: list[residuals.Block], noise: Noise) -> Figure | None:
    """Draw the distribution of the residual, its autocorrelation and that of its innovations."""
    found = residuals.correlation(blocks, noise)
    if found is None:
        return None
    panels = [_distribution(blocks, noise), _autocorrelation(found), _innovations(found)]
    spec, height = figures.grid(panels, figures.Layout(columns=3, row_height=260, gap=66))
    outside = int(np.sum(np.abs(found.innovation[1:]) > found.bound))
    lags = found.lag.size - 1
    caption = (
        "If the model explains the data, the residual is distributed and correlated like the noise, and what "
        "remains after the noise model has predicted each sample is uncorrelated: "
        f"{outside} of {lags} lags lie outside the 95 % bound, about {round(0.05 * lags)} would by chance."
    )
    return Figure(spec, height, "Is the residual only noise?", caption)


def _distribution(blocks: list[residuals.Block], noise: Noise) -> figures.Panel:
    centre, height, outside = residuals.density(blocks)
    width = float(centre[1] - centre[0])
    x = np.linspace(centre[0], centre[-1], 201)
    spread = noise.total_std
    normal = (
        np.exp(-0.5 * (x / spread) ** 2) / (spread * np.sqrt(2 * np.pi)) if spread > 0 else np.zeros(x.size)
    )
    hover = "%{y:.3g} per mrad at %{x:.3g} mrad"
    traces = [
        figures.bars(centre * 1e3, height / 1e3, "residual", "residual", width=width * 1e3, hover=hover),
        figures.curve(x * 1e3, normal / 1e3, "modelled", "noise model", hover=hover),
    ]
    title = "distribution" if outside < 5e-4 else f"distribution ({outside * 100:.1f} % lie outside)"
    return figures.Panel(title, traces, x="residual [mrad]", y="density [1/mrad]")


def _autocorrelation(found: residuals.Correlation) -> figures.Panel:
    hover = "%{y:.3f} at a lag of %{x:.3f} s"
    traces = [
        figures.curve(found.lag, found.residual, "residual", "residual", hover=hover),
        figures.curve(found.lag, found.noise, "modelled", "noise model", hover=hover),
    ]
    return figures.Panel("autocorrelation of the residual", traces, x="lag [s]", y="autocorrelation [–]")


def _innovations(found: residuals.Correlation) -> figures.Panel:
    hover = "%{y:.4f} at a lag of %{x:.3f} s"
    trace = figures.bars(
        found.lag[1:],
        found.innovation[1:],
        "residual",
        "residual",
        width=float(found.lag[1] - found.lag[0]) * 0.8,
        hover=hover,
    )
    marks = [figures.band(-found.bound, found.bound, "band", along="y")]
    reach = 1.25 * max(found.bound * 2, float(np.abs(found.innovation[1:]).max()))
    return figures.Panel(
        "autocorrelation after the noise model",
        [trace],
        x="lag [s]",
        y="autocorrelation [–]",
        y_range=(-reach, reach),
        marks=marks,
    )


def whole_run(signals: responses.Signals, runs: int) -> Figure:
    """Draw a run from end to end: the angles above, the residual below.

    Parameters
    ----------
    runs : how many runs the page shows, which share ``BINS_ALL`` bins
    """
    bins = int(np.clip(BINS_ALL / max(runs, 1), 200, BINS_RUN))
    lines = responses.whole_run(signals)
    residual = Line(lines.residual.time, lines.residual.value * 1e3)
    drawn = [thinned(line, bins) for line in (*lines[:3], residual)]
    angles = [
        figures.line(drawn[0], "request", "requested", held=True, width=1.3),
        figures.line(drawn[1], "measured", "measured", width=3),
        figures.line(drawn[2], "modelled", "modelled", width=1.3),
    ]
    below = [figures.line(drawn[3], "residual", "residual", unit="mrad", width=1.1)]
    panels = [
        figures.Panel("", angles, x="", y="angle [rad]", x_ticks=False, ticks=(14, 7)),
        figures.Panel("", below, x=TIME_OF_RUN, y="residual [mrad]", ticks=(14, 5)),
    ]
    layout = figures.Layout(columns=1, row_height=210, share_x=True, row_shares=(1.6, 1.0))
    spec, height = figures.grid(panels, layout)
    return Figure(spec, height, "From end to end", _thinned_caption(lines, drawn, bins))


def _thinned_caption(lines: Sequence[Line], drawn: Sequence[Line], bins: int) -> str:
    before, after = (sum(line.time.size for line in kind) for kind in (lines, drawn))
    if after == before:
        return "Every sample is drawn."
    return (
        f"{count(after, 'point')} drawn of {count(before, 'sample')}: the first, lowest, highest and last in "
        f"each of {bins} stretches of time, so no extreme is lost. All samples are in run.rrd."
    )
