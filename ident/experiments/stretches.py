"""Uninterrupted stretches of a command and its measured answer.

A recorder that loses messages does not stop the actuator, which acts on what was *sent*. So a short loss in
a steady command is kept as commands of unknown value; a longer one ends the stretch, because nothing is
known of the command in between. A command that did not change across a short loss has lost nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LONGEST_LOSS = 3  # lost commands in a row whose values are still worth estimating
GAP = 1.5  # periods
STEADY_SHARE = 0.8
STEADY_SPREAD = 0.3
FEWEST_SAMPLES = 10
REST_SECONDS = 0.06
REST_SAMPLES = 3
MOVED_SHARE = 0.1  # of a constant command: the answer to a change just before the stretch
MOVED_NOISE = 10.0  # times the noise of the answer


@dataclass(frozen=True)
class Stretch:
    """A command and its answer without interruption.

    command_times, command_values : (m,) stamps [s since the start of the run] and values [rad], lost ones
        in place with an interpolated guess
    lost : indices of the lost commands
    times, measured : (n,) stamps [s] and values [rad] of the measured angle
    starts : indices of ``times`` after an interruption of the measurement, the first is 0
    rest_rate : largest rate that the measured angle can have had when the stretch began without the test for
        rest noticing it, halved as a standard deviation [rad/s]; infinite where it was not at rest
    """

    command_times: Array
    command_values: Array
    lost: NDArray[np.intp]
    times: Array
    measured: Array
    starts: NDArray[np.intp]
    rest_rate: float

    @property
    def at_rest(self) -> bool:
        """Whether the measured angle was at rest when the stretch began."""
        return bool(np.isfinite(self.rest_rate))

    @property
    def steady(self) -> bool:
        """Whether commands come at a rate, and not whenever something changes."""
        return is_steady(self.command_times)

    @property
    def command_period(self) -> float:
        """Median time between commands [s]; zero where they come when something changes, then at once."""
        return period_of(self.command_times) if self.steady else 0.0

    @property
    def end(self) -> float:
        """Until when the last command is known to be held [s]."""
        return float(self.command_times[-1]) + self.command_period if self.steady else float(self.times[-1])

    @property
    def excited(self) -> bool:
        """Whether the command changes at all, or the answer shows that it changed just before."""
        if np.ptp(self.command_values) > 0:
            return True
        level = abs(float(self.command_values[0]))
        moved = np.ptp(self.measured) > max(MOVED_SHARE * level, MOVED_NOISE * noise_level(self.measured))
        return bool(self.at_rest and level > 0 and moved)


def is_steady(times: Array) -> bool:
    """Whether messages come at a rate, and not whenever something changes."""
    if times.size < 3:
        return False
    intervals = np.diff(times)
    period = float(np.median(intervals))
    near = np.abs(intervals - period) <= STEADY_SPREAD * period
    return bool(near.mean() >= STEADY_SHARE)


def period_of(times: Array) -> float:
    """Median time between samples [s]."""
    return float(np.median(np.diff(times)))


def jitter_of(times: Array) -> float:
    """Spread of the period in parts of it (half of the 16-84 % range), interruptions apart."""
    intervals = np.diff(times)
    period = float(np.median(intervals))
    inner = intervals[intervals < GAP * period]
    low, high = np.quantile(inner, [0.16, 0.84])
    return float((high - low) / 2 / period)


def find_stretches(
    command_times: Array,
    command_values: Array,
    times: Array,
    measured: Array,
    *,
    enabled: Sequence[tuple[float, float]] | None = None,
) -> list[Stretch]:
    """Divide a run wherever the command is not known or not acted on.

    Parameters
    ----------
    command_times, command_values : (m,) strictly increasing stamps [s], held values [rad]
    times, measured : (n,) strictly increasing stamps [s], measured angle [rad]
    enabled : intervals [s] in which the actuator follows the command; None: always

    Returns
    -------
    list of Stretch, in the order of time, each with at least FEWEST_SAMPLES measured samples
    """
    if command_times.size < 2 or times.size < FEWEST_SAMPLES:
        return []
    steady = is_steady(command_times)
    period = period_of(command_times)
    missing = _missing(command_times, period) if steady else np.zeros(command_times.size - 1, dtype=np.intp)
    cuts = np.flatnonzero(missing > LONGEST_LOSS) + 1
    found = []
    for first, last in zip([0, *cuts.tolist()], [*cuts.tolist(), command_times.size], strict=True):
        hold = period if steady else np.inf
        for begin, end, until in _enabled_parts(command_times[first:last], enabled, hold):
            part = slice(first + begin, first + end)
            window = (command_times[part][0], min(command_times[part][-1] + GAP * hold, until))
            stretch = _stretch(
                command_times[part], command_values[part], missing[part], times, measured, window
            )
            if stretch is not None:
                found.append(stretch)
    return found


def _missing(times: Array, period: float) -> NDArray[np.intp]:
    """How many messages are missing after each one."""
    missing: NDArray[np.intp] = np.maximum(np.rint(np.diff(times) / period) - 1, 0).astype(np.intp)
    return missing


def _enabled_parts(
    times: Array, enabled: Sequence[tuple[float, float]] | None, hold: float
) -> list[tuple[int, int, float]]:
    """Index ranges of the commands that are acted on, and until when they are."""
    if enabled is None:
        return [(0, times.size, np.inf)]
    parts = []
    for low, high in enabled:
        begin, end = np.searchsorted(times, [low, high])
        if end - begin > 1 and times[end - 1] - times[begin] > 2 * min(hold, 1.0):
            parts.append((int(begin), int(end), high))
    return parts


def _stretch(
    command_times: Array,
    command_values: Array,
    missing: NDArray[np.intp],
    times: Array,
    measured: Array,
    window: tuple[float, float],
) -> Stretch | None:
    if command_times.size < 2:
        return None
    begin, end = np.searchsorted(times, window)
    if end - begin < FEWEST_SAMPLES:
        return None
    own, values = times[begin:end], measured[begin:end]
    known_times, known_values, lost = _with_lost(command_times, command_values, missing)
    gaps = np.flatnonzero(np.diff(own) > GAP * period_of(times)) + 1
    starts = np.concatenate([[0], gaps]).astype(np.intp)
    return Stretch(known_times, known_values, lost, own, values, starts, _rest_rate(times, measured, own))


def _with_lost(
    times: Array, values: Array, missing: NDArray[np.intp]
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Put a guess in the place of each lost command where the command was changing."""
    gaps = [i for i in range(times.size - 1) if missing[i] and values[i + 1] != values[i]]
    if not gaps:
        return times, values, np.zeros(0, dtype=np.intp)
    new_times, new_values, after = [], [], []
    for i in gaps:
        share = np.arange(1, missing[i] + 1) / (missing[i] + 1)
        new_times.extend(times[i] + share * (times[i + 1] - times[i]))
        new_values.extend(values[i] + share * (values[i + 1] - values[i]))
        after.extend([i + 1] * int(missing[i]))
    lost = np.asarray(after) + np.arange(len(after))
    return np.insert(times, after, new_times), np.insert(values, after, new_values), lost.astype(np.intp)


def noise_level(measured: Array) -> float:
    """Standard deviation of the fast part of a signal, from its second differences [unit of the signal]."""
    if measured.size < 3:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(measured, 2))) / np.sqrt(6))


def _rest_rate(times: Array, measured: Array, own: Array) -> float:
    """Rate that the test for rest could have missed; infinite where the first samples move apart."""
    begin = int(np.searchsorted(times, own[0]))
    count = min(max(REST_SAMPLES, int(np.searchsorted(own, own[0] + REST_SECONDS))), own.size)
    head = measured[begin : begin + count]
    steps = np.abs(np.diff(np.unique(measured)))
    resolution = float(steps.min()) if steps.size else 0.0
    allowed = max(6 * noise_level(measured), 2 * resolution, 1e-9)
    duration = float(own[count - 1] - own[0])
    return allowed / duration / 2 if np.ptp(head) <= allowed * 1.0001 and duration > 0 else np.inf
