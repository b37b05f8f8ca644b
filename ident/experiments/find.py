"""All experiments of a stretch: steps and pulses first, sines in what is left, the rest as "other"."""

from __future__ import annotations

import numpy as np

from ident.experiments.found import Found
from ident.experiments.sines import find_sines
from ident.experiments.steps import find_steps
from ident.experiments.stretches import Stretch

SHORTEST_OTHER = 0.5  # [s]


def find_experiments(stretch: Stretch) -> list[Found]:
    """Steps, pulses, sines and other excitation of a stretch, in the order of time."""
    found = find_steps(stretch)
    for begin, end in _left(found, stretch.command_values.size):
        found.extend(find_sines(stretch, begin, end))
    for begin, end in _left(found, stretch.command_values.size):
        other = _other(stretch, begin, end)
        if other is not None:
            found.append(other)
    return sorted(found, key=lambda one: one.begin)


def _left(found: list[Found], size: int) -> list[tuple[int, int]]:
    """Index ranges of the commands that no experiment has taken."""
    taken = np.zeros(size + 2, dtype=bool)
    taken[[0, -1]] = True
    for one in found:
        taken[1 + one.begin : 1 + one.end] = True
    edges = np.flatnonzero(np.diff(taken.astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _other(stretch: Stretch, begin: int, end: int) -> Found | None:
    """Excitation that is neither step nor sine, without the constant request at its ends."""
    values = stretch.command_values[begin:end]
    moving = np.flatnonzero(np.diff(values))
    if moving.size == 0:
        return None
    low, high = begin + int(moving[0]), begin + int(moving[-1]) + 2
    times = stretch.command_times[low:high]
    if times[-1] - times[0] < SHORTEST_OTHER:
        return None
    size = float(np.ptp(stretch.command_values[low:high])) / 2
    return Found("other", low, high, float(times[0]), float(times[-1]), size)
