"""Measured against modelled responses, cut out of the logged signals, one experiment at a time.

Steps and pulses are put on one time axis that begins at each step, taken relative to the request before
it and mirrored where they are negative, so that equal steps lie on each other. Sines are shown as they
are, a few periods from the middle of the experiment, where the start has died away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from ident.report.condense import Array, Line, broken, contiguous, evenly
from ident.results import Experiment

SAME_AMPLITUDE = 0.05
"""Steps whose amplitudes differ by less than this share are of one group [-]."""
LEAD = 0.15
"""How much of a response is shown before its step, in parts of what is shown after it [-]."""
LAGS_SHOWN = 5.0
"""A step response is shown for so many total lags; then it has settled to 0.7 % where one lag dominates."""
LAG_UNKNOWN = 1.0
"""Total lag assumed for the window of a response where none was identified [s]."""
PERIODS_SHOWN = 3.0
LONGEST_OTHER = 20.0
"""How much of an experiment that is neither step nor sine is shown [s]."""


class Response(NamedTuple):
    """One experiment cut out: request, measured and modelled angle and residual [rad] over time [s]."""

    request: Line
    measured: Line
    modelled: Line
    residual: Line


@dataclass(frozen=True)
class Group:
    """Experiments that are drawn together.

    found : how many there are; ``responses`` may hold fewer
    size : amplitude [rad] of steps, frequency [rad/s] of sines, None for the others
    length : what is shown of each [s]
    """

    title: str
    kind: str
    size: float | None
    length: float
    found: int
    responses: list[Response]


@dataclass(frozen=True)
class Signals:
    """The tables of a run as arrays: (n,) measured and (m,) request samples."""

    time: Array
    part: Array
    measured: Array
    modelled: Array
    request_time: Array
    request_part: Array
    request: Array


def signals_of(steering: pd.DataFrame, request: pd.DataFrame) -> dict[str, Signals]:
    """Split the tables ``steering`` and ``steering_request`` into runs.

    A request marked ``lost`` was not logged but assumed by the fit; it is left out.
    """
    if "lost" in request:
        request = request[~request["lost"].astype(bool)]
    requests = dict(tuple(request.groupby("run", sort=False)))
    none = request.iloc[:0]
    return {
        str(name): _signals(rows, requests.get(name, none))
        for name, rows in steering.groupby("run", sort=False)
    }


def _signals(rows: pd.DataFrame, request: pd.DataFrame) -> Signals:
    def numbers(table: pd.DataFrame, column: str) -> Array:
        return table[column].to_numpy(dtype=np.float64)

    return Signals(
        time=numbers(rows, "time"),
        part=numbers(rows, "part"),
        measured=numbers(rows, "measured"),
        modelled=numbers(rows, "modelled"),
        request_time=numbers(request, "time"),
        request_part=numbers(request, "part"),
        request=numbers(request, "request"),
    )


def step_groups(
    experiments: Sequence[Experiment], runs: dict[str, Signals], *, total_lag: float | None, most: int = 12
) -> list[Group]:
    """Group the steps and pulses by the size of their amplitude, the smallest first.

    Parameters
    ----------
    experiments : all that were found; left out are those that nothing uses, unless none is used, and
        those whose beginning is not in the log, which have no common zero of time with the others
    runs : as ``signals_of`` gives them
    total_lag : of the model [s], from which the length shown follows
    most : responses drawn in one group: those that most methods use, the longest of them
    """
    steps = [step for step in _used(experiments, ("step", "pulse"), runs) if step.amplitude]
    steps = [step for step in steps if _before(step) is not None and _begins_in_log(step, runs[step.run])]
    steps.sort(key=lambda step: abs(step.amplitude or 0.0))
    groups: list[list[Experiment]] = []
    for step in steps:
        size = abs(step.amplitude or 0.0)
        if groups and size <= abs(groups[-1][0].amplitude or 0.0) * (1 + SAME_AMPLITUDE):
            groups[-1].append(step)
        else:
            groups.append([step])
    return [_step_group(group, runs, LAGS_SHOWN * (total_lag or LAG_UNKNOWN), most) for group in groups]


def _used(
    experiments: Sequence[Experiment], kinds: tuple[str, ...], runs: dict[str, Signals]
) -> list[Experiment]:
    found = [experiment for experiment in experiments if experiment.kind in kinds and experiment.run in runs]
    return [experiment for experiment in found if experiment.used_by] or found


def _before(step: Experiment) -> float | None:
    """Give the request before a step, from the one after it where the log begins with the step."""
    if step.level_before is not None:
        return step.level_before
    if step.kind == "step" and step.level_after is not None and step.amplitude is not None:
        return step.level_after - step.amplitude
    return None


def _begins_in_log(step: Experiment, signals: Signals) -> bool:
    """Say whether the request before the step was logged, without a gap between."""
    index = int(np.searchsorted(signals.request_time, step.start - 1e-9))
    if signals.request_time.size == 0:
        return True
    return 0 < index < signals.request_time.size and bool(
        signals.request_part[index - 1] == signals.request_part[index]
    )


def _worth(step: Experiment) -> tuple[int, float]:
    """Rank steps: one that the step methods use has settled, and a long one shows more."""
    return len(step.used_by), step.end - step.start


def _step_group(group: list[Experiment], runs: dict[str, Signals], length: float, most: int) -> Group:
    size = float(np.median([abs(step.amplitude or 0.0) for step in group]))
    longest = max(step.end - step.start for step in group)
    length = min(length, longest) if longest > 0 else length
    responses = []
    for step in sorted(group, key=_worth, reverse=True)[:most]:
        sign, level = np.sign(step.amplitude or 1.0), _before(step) or 0.0
        end = min(step.start + length, step.end)
        cut = cut_out(runs[step.run], step.start - LEAD * length, end, zero=step.start)
        request, measured, modelled = (Line(line.time, sign * (line.value - level)) for line in cut[:3])
        residual = Line(cut.residual.time, sign * cut.residual.value)
        responses.append(Response(request, measured, modelled, residual))
    kinds = sorted({step.kind for step in group})
    return Group(f"{' and '.join(kinds)} of {size:.3g} rad", kinds[0], size, length, len(group), responses)


def sine_groups(
    experiments: Sequence[Experiment], runs: dict[str, Signals], *, most: int = 12
) -> list[Group]:
    """Give the sines, one a group, the slowest first; with more than ``most``, evenly chosen ones."""
    sines = [sine for sine in _used(experiments, ("sine",), runs) if sine.frequency]
    sines.sort(key=lambda sine: sine.frequency or 0.0)
    return [_sine_group(sines[index], runs) for index in evenly(len(sines), most)]


def _sine_group(sine: Experiment, runs: dict[str, Signals]) -> Group:
    period = 2 * np.pi / (sine.frequency or 1.0)
    length = min(PERIODS_SHOWN * period, sine.end - sine.start)
    begin = sine.start + (sine.end - sine.start - length) / 2
    title = f"sine of {sine.frequency:.3g} rad/s"
    if sine.amplitude is not None:
        title += f", {abs(sine.amplitude):.3g} rad"
    response = cut_out(runs[sine.run], begin, begin + length, zero=sine.start)
    return Group(title, "sine", sine.frequency, length, 1, [response])


def other_groups(
    experiments: Sequence[Experiment], runs: dict[str, Signals], *, most: int = 4
) -> list[Group]:
    """Give the longest experiments that are neither steps nor sines, from the middle of each."""
    others = _used(experiments, ("other",), runs)
    others.sort(key=lambda other: other.start - other.end)
    groups = []
    for other in others[:most]:
        length = min(LONGEST_OTHER, other.end - other.start)
        begin = other.start + (other.end - other.start - length) / 2
        response = cut_out(runs[other.run], begin, begin + length, zero=0.0)
        groups.append(Group(f"{other.run} from {begin:.1f} s", "other", None, length, 1, [response]))
    return groups


def cut_out(signals: Signals, begin: float, end: float, *, zero: float) -> Response:
    """Cut begin … end [s] out of a run, its time counted from ``zero``; gaps break the lines.

    The request begins with the value held at ``begin`` and ends with that held until ``end``, what is
    sent at ``end`` not among it: that is the next step.
    """
    inside = (signals.time >= begin) & (signals.time <= end)
    time, part = signals.time[inside], signals.part[inside].astype(np.int64)
    stretches = contiguous(time, part)
    measured, modelled = signals.measured[inside], signals.modelled[inside]
    return Response(
        request=_held(signals, begin, end, zero),
        measured=broken(time - zero, measured, stretches),
        modelled=broken(time - zero, modelled, stretches),
        residual=broken(time - zero, measured - modelled, stretches),
    )


def _held(signals: Signals, begin: float, end: float, zero: float) -> Line:
    """Cut a held signal: the sample before ``begin`` still counts if it is of the same part."""
    first = max(int(np.searchsorted(signals.request_time, begin, side="right")) - 1, 0)
    last = int(np.searchsorted(signals.request_time, end, side="left"))
    time, values = signals.request_time[first:last], signals.request[first:last]
    stretches = contiguous(time, signals.request_part[first:last].astype(np.int64))
    if stretches and stretches[0] == slice(0, 1) and time[0] < begin:
        stretches = stretches[1:]
    line = broken(np.maximum(time, begin) - zero, values, stretches)
    if line.time.size == 0 or np.isnan(line.value[-1]):
        return line
    return Line(np.append(line.time, end - zero), np.append(line.value, line.value[-1]))


def whole_run(signals: Signals) -> Response:
    """Give a whole run with its gaps."""
    begin = min(signals.time[:1].tolist() + signals.request_time[:1].tolist(), default=0.0)
    end = max(signals.time[-1:].tolist() + signals.request_time[-1:].tolist(), default=0.0)
    return cut_out(signals, begin, float(np.nextafter(end, np.inf)), zero=0.0)
