"""Samples that repeat the one before because nothing new was measured.

A recorder that writes faster than its sensor measures repeats the last value; such a row is no information,
and its stamp is wrong. A quantised signal repeats itself, too, and that is information. The two are told
apart by how often: a signal whose steps have a median of s quanta repeats by chance about 0.27/s of the time
(0.27 = 0.6745/sqrt(2 pi): differences spread like a normal distribution); clearly more is held. The median is
that of steps nearby, on the calmer side: a wheel that is turned and held has large steps and small ones.
Where it is a single quantum, how often the signal repeats by chance cannot be told, and nothing is judged.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ident.signals.health import resolution
from ident.signals.signal import Signal

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BY_CHANCE = 0.27
CLEARLY_MORE, NEGLIGIBLE = 3.0, 0.02
FEWEST_CHANGES = 30
NEARBY = 7  # changes on either side whose median counts
LEAST_STEP = 1.5  # quanta: where the median is smaller, repeats tell nothing
LONGEST_HOLD = 0.15  # [s] of an input: what is constant for longer stands still


def without_held(
    signal: Signal, moving: Mask | None = None, *, rest_counts: bool
) -> tuple[Signal, str | None]:
    """Leave out held samples.

    Parameters
    ----------
    moving : (n,) where the vehicle moves and the signal must change; None: everywhere
    rest_counts : whether a value that lasts longer than ``LONGEST_HOLD`` is a rest and stays (a steering
        angle may rest, the yaw rate of a moving vehicle does not)

    Returns
    -------
    the signal, and what was left out in one line, None where nothing was
    """
    where = np.ones(len(signal.values), dtype=np.bool_) if moving is None else moving
    if rest_counts:
        where = where & ~_rests(signal.time, signal.values)
    drop = held(signal.values, where)
    count = int(np.count_nonzero(drop))
    if not count:
        return signal, None
    arrival = None if signal.arrival is None else signal.arrival[~drop]
    kept = replace(signal, time=signal.time[~drop], values=signal.values[~drop], arrival=arrival)
    return kept, f"{signal.name}: {count} samples of {len(drop)} repeat the one before and were left out"


def held(values: Array, where: Mask) -> Mask:
    """Which samples (n,) repeat the one before because nothing new was measured; only ``where`` it counts."""
    steps = np.concatenate([[0.0], np.abs(np.diff(values))])
    same, nothing = (steps == 0) & where, np.zeros(len(values), dtype=np.bool_)
    same[:1] = False
    changes = np.flatnonzero((steps > 0) & where)
    if len(changes) < FEWEST_CHANGES:
        return nothing
    typical = _nearby_median(steps, changes) / (resolution(values) or float(steps[changes].min()))
    told = where & (typical > LEAST_STEP)
    expected = float(np.sum(BY_CHANCE / typical[told]))
    most = CLEARLY_MORE * expected + NEGLIGIBLE * np.count_nonzero(told)
    return same if np.count_nonzero(same & told) > most else nothing


def _nearby_median(steps: Array, changes: NDArray[np.intp]) -> Array:
    """(n,) median of the steps at the changes before or after each sample, of which the smaller counts."""
    padded = np.pad(steps[changes], NEARBY, mode="edge")
    medians = np.median(np.lib.stride_tricks.sliding_window_view(padded, NEARBY), axis=1)
    done = np.searchsorted(changes, np.arange(len(steps)), side="right")
    return np.minimum(medians[done], medians[done + NEARBY])


def _rests(time: Array, values: Array) -> Mask:
    """Which samples belong to a value that lasts longer than ``LONGEST_HOLD``."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0]))
    ends = np.append(starts[1:], len(values)) - 1
    lasts = time[ends] - time[starts] > LONGEST_HOLD
    return np.repeat(lasts, ends - starts + 1)
