"""Samples that repeat the one before because nothing new was measured.

A recorder that writes faster than its sensor measures repeats the last value; such a row is no information,
and its stamp is wrong. A quantised signal repeats itself, too, and that is information. The two are told
apart by how often: a signal whose steps have a median of s quanta repeats by chance about 0.27/s of the time
(0.27 = 0.6745/sqrt(2 pi): differences spread like a normal distribution); clearly more is held.
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
    drop = held(signal.values, moving)
    if rest_counts:
        drop &= ~_rests(signal.time, signal.values)
    count = int(np.count_nonzero(drop))
    if not count:
        return signal, None
    arrival = None if signal.arrival is None else signal.arrival[~drop]
    kept = replace(signal, time=signal.time[~drop], values=signal.values[~drop], arrival=arrival)
    return kept, f"{signal.name}: {count} samples of {len(drop)} repeat the one before and were left out"


def held(values: Array, moving: Mask | None = None) -> Mask:
    """Which samples (n,) repeat the one before because nothing new was measured."""
    where = np.ones(len(values), dtype=np.bool_) if moving is None else moving
    same = np.concatenate([[False], np.diff(values) == 0]) & where
    changes = np.abs(np.diff(values))[where[1:]]
    changes = changes[changes > 0]
    if len(changes) < FEWEST_CHANGES:
        return np.zeros(len(values), dtype=np.bool_)
    quantum = resolution(values) or 0.0
    expected = min(BY_CHANCE * quantum / float(np.median(changes)), 1.0)
    share = np.count_nonzero(same) / np.count_nonzero(where)
    return same if share > CLEARLY_MORE * expected + NEGLIGIBLE else np.zeros(len(values), dtype=np.bool_)


def _rests(time: Array, values: Array) -> Mask:
    """Which samples belong to a value that lasts longer than ``LONGEST_HOLD``."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0]))
    ends = np.append(starts[1:], len(values)) - 1
    lasts = time[ends] - time[starts] > LONGEST_HOLD
    return np.repeat(lasts, ends - starts + 1)
