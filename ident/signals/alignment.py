"""RUN -> ONE TIME BASE: every signal of a run at the same instants.

What a signal does between its samples is said in the glossary. A command is held: its value is that of the
last sample at or before the instant, never a later one. A measurement is interpolated linearly, a heading
along the shorter arc. Where the common rate is lower than half of what a measurement may hold, it is
low-passed first by a symmetric FIR filter (Kaiser window, no delay): within 0.1 % up to 0.35 of the common
rate, below -60 dB from 0.5 of it on, where it would fold. Commands are not filtered: they stay exact.

A gap stays a gap. It is longer than ``max_gap`` and than two median periods of the signal (one at 1 Hz has
no gap at 1 s); a flag that is sent only when it changes is held until it does. Before the first and after
the last sample there is nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import firwin, kaiserord, oaconvolve

from ident.glossary import SIGNALS
from ident.signals.health import STEADY
from ident.signals.signal import Run, Signal

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PASS, STOP, SUPPRESSION_DB = 0.35, 0.5, 66.0
GAP_PERIODS = 2.0


@dataclass(frozen=True)
class AlignedRun:
    """Signals of a run at the same instants.

    time : (n,) since the start of the run, uniform [s]
    columns : signal -> (n,) values, NaN where there is none
    valid : signal -> (n,) whether there is a value
    """

    name: str
    time: Array
    columns: Mapping[str, Array]
    valid: Mapping[str, Mask]


def align(run: Run, *, rate: float, max_gap: float, names: Iterable[str] | None = None) -> AlignedRun:
    """Bring signals of a run to one time base.

    Parameters
    ----------
    rate : of the time base [1/s]
    max_gap : the longest stretch without samples that is bridged [s]
    names : which signals; None: all
    """
    time = np.arange(int(np.floor(run.duration * rate)) + 1) / rate
    columns = {name: sample(run.signals[name], time, rate, max_gap) for name in names or run.signals}
    return AlignedRun(run.name, time, columns, {name: np.isfinite(x) for name, x in columns.items()})


def sample(signal: Signal, grid: Array, rate: float, max_gap: float) -> Array:
    """Value of a signal at each instant of a uniform grid (m,) of this rate, NaN where there is none."""
    limit = longest_bridge(signal, max_gap)
    kind = SIGNALS[signal.name].between
    if kind == "held":
        return hold(signal.time, signal.values, grid, limit)
    values = np.unwrap(signal.values) if kind == "angle" else signal.values
    filtered = low_pass(signal.time, values, rate, limit)
    return interpolate(signal.time, filtered, grid, limit)


def longest_bridge(signal: Signal, max_gap: float) -> float:
    """Longest stretch between two samples that is no gap [s]."""
    steps = np.diff(signal.time)
    if not len(steps):
        return max_gap
    period = float(np.median(steps))
    low, high = np.percentile(steps, [16, 84])
    quantity = SIGNALS[signal.name]
    if quantity.between == "held" and quantity.unit == "1" and (high - low) / 2 > STEADY * period:
        return np.inf
    return max(max_gap, GAP_PERIODS * period)


def hold(time: Array, values: Array, grid: Array, limit: float) -> Array:
    """Value of the last sample at or before each instant (zero-order hold).

    Parameters
    ----------
    time, values : (n,) samples, time rising [s]
    grid : (m,) instants [s]
    limit : between samples further apart than this there is no value [s]; the last sample is held for
        one median period
    """
    last = np.searchsorted(time, grid, side="right") - 1
    steps = np.diff(time)
    until = np.append(np.where(steps > limit, 0.0, np.inf), np.median(steps) if len(steps) else 0.0)
    held = np.where(last >= 0, values[last], np.nan)
    return np.where(grid - time[last] <= until[last], held, np.nan)


def interpolate(time: Array, values: Array, grid: Array, limit: float) -> Array:
    """Linear interpolation between samples (n,) at instants (m,), NaN outside and in gaps above ``limit``."""
    if not len(time):
        return np.full(len(grid), np.nan)
    result = np.interp(grid, time, values, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(time, grid, side="left"), 1, max(len(time) - 1, 1))
    if len(time) > 1:
        inside = (time[after] - time[after - 1] > limit) & (grid > time[after - 1]) & (grid < time[after])
        result[inside] = np.nan
    return np.asarray(result)


def low_pass(time: Array, values: Array, rate: float, limit: float) -> Array:
    """Take out of samples (n,) what a series of ``rate`` [1/s] cannot hold; unchanged where nothing need be.

    Each stretch without a gap is brought to its median period, filtered with odd reflection at its ends,
    and read at its own stamps again.
    """
    if len(time) < 3:
        return values
    period = float(np.median(np.diff(time)))
    if STOP * rate >= 0.5 / period:
        return values
    taps = _design(rate * period)
    filtered = values.copy()
    for part in parts(time, limit):
        if part.stop - part.start >= 3:
            filtered[part] = _filter(time[part], values[part], period, taps)
    return filtered


def parts(time: Array, limit: float) -> list[slice]:
    """Stretches of samples without a gap longer than ``limit`` [s]."""
    breaks = np.flatnonzero(np.diff(time) > limit) + 1
    edges = [0, *breaks.tolist(), len(time)]
    return [slice(first, last) for first, last in pairwise(edges) if last > first]


def _design(relative_rate: float) -> Array:
    """Taps of the low-pass for a new rate that is ``relative_rate`` times the old one."""
    count, beta = kaiserord(SUPPRESSION_DB, 2 * (STOP - PASS) * relative_rate)
    middle = (PASS + STOP) / 2 * relative_rate
    return np.asarray(firwin(count + 1 - count % 2, 2 * middle, window=("kaiser", beta)), dtype=np.float64)


def _filter(time: Array, values: Array, period: float, taps: Array) -> Array:
    count = round((time[-1] - time[0]) / period) + 1
    uniform = np.linspace(time[0], time[-1], max(count, 3))
    padded = np.pad(np.interp(uniform, time, values), len(taps) // 2, mode="reflect", reflect_type="odd")
    return np.asarray(np.interp(time, uniform, oaconvolve(padded, taps, mode="valid")))
