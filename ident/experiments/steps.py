"""Steps and pulses in a held command: a jump between two samples, constant before and after.

A pulse is a step whose hold ends in a return to the level before it (ISO-like rectangular pulses: on, off);
its return is a step of its own where it is held too. What is held for less than SHORTEST_HOLD is a
staircase. Nothing else is asked here: whether the answer settles is for the method to say that uses the step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ident.experiments.found import Found
from ident.experiments.stretches import Stretch

Array = NDArray[np.float64]

SMALLEST_SHARE = 0.02  # of the largest request: smaller jumps are resolution, not steps
FLAT_SHARE = 0.02  # of the jump: how much a hold may move
FEWEST_HELD = 3  # commands, where they come at a rate
ROUNDING = 1e-6  # [s]
SHORTEST_HOLD = 0.2  # [s]: what changes sooner is a staircase


def find_steps(stretch: Stretch) -> list[Found]:
    """All steps and pulses of a stretch, in the order of time."""
    known = np.delete(np.arange(stretch.command_values.size), stretch.lost)
    values = stretch.command_values[known]
    edges = _edges(stretch, known)
    found: list[Found] = []
    for number, (index, before, after) in enumerate(edges):
        ends_pulse = bool(found) and found[-1].kind == "pulse" and edges[number - 1][2] == index
        jump = values[index] - values[index - 1]
        returns = after < values.size and abs(values[after] - values[index - 1]) <= FLAT_SHARE * abs(jump)
        found.append(_found(stretch, known, (index, before, after), is_pulse=returns and not ends_pulse))
    first = _step_at_start(stretch)
    return found if first is None else [first, *found]


def _edges(stretch: Stretch, known: NDArray[np.intp]) -> list[tuple[int, int, int]]:
    """(index of the new level, begin of the hold before, end of the hold after) of each jump."""
    values = stretch.command_values[known]
    times = np.append(stretch.command_times[known], stretch.end)
    fewest = FEWEST_HELD if stretch.steady else 1
    smallest = SMALLEST_SHARE * float(np.abs(values).max(initial=0.0))

    def held(begin: int, end: int) -> bool:
        return end - begin >= fewest and times[end] - times[begin] > SHORTEST_HOLD - ROUNDING

    edges = []
    for i in np.flatnonzero(np.abs(np.diff(values)) > smallest) + 1:
        index = int(i)
        tolerance = FLAT_SHARE * abs(float(values[index] - values[index - 1]))
        after = _end_of_hold(values, index, tolerance)
        before = index - _end_of_hold(values[index - 1 :: -1], 0, tolerance)
        if held(index, after) and (held(before, index) or before == 0):
            edges.append((index, before, after))
    return edges


def _end_of_hold(values: Array, index: int, tolerance: float) -> int:
    """First index after ``index`` at which the value has left its level, or the length."""
    away = np.flatnonzero(np.abs(values[index:] - values[index]) > tolerance)
    return int(index + away[0]) if away.size else int(values.size)


def _found(stretch: Stretch, known: NDArray[np.intp], edge: tuple[int, int, int], *, is_pulse: bool) -> Found:
    """Describe an edge; ``known`` are the indices of the commands that the log has not lost."""
    times, values = stretch.command_times, stretch.command_values
    index, before, after = edge
    begin, last_old = int(known[index]), int(known[index - 1])
    end = int(known[after]) if after < known.size else times.size
    lost_between = begin - last_old > 1
    return Found(
        kind="pulse" if is_pulse else "step",
        begin=begin,
        end=end,
        start=float(times[begin]),
        end_time=_end_time(stretch, end),
        amplitude=float(values[begin] - values[last_old]),
        level_before=float(values[last_old]),
        level_after=float(values[begin]),
        hold_before=float(times[begin] - times[known[before]]),
        start_uncertainty=float(times[begin] - times[last_old]) - stretch.command_period
        if lost_between
        else 0.0,
    )


def _end_time(stretch: Stretch, end: int) -> float:
    """When command ``end`` is sent, or would be."""
    return float(stretch.command_times[end]) if end < stretch.command_times.size else stretch.end


def _step_at_start(stretch: Stretch) -> Found | None:
    """Find a step at the very first command, which only the answer tells.

    The answer is at rest, the request is held away from it, and then the answer moves towards the request
    by more than half of the way that is left.
    """
    times, values = stretch.command_times, stretch.command_values
    if not stretch.at_rest or values[0] == 0:
        return None
    level = float(values[0])
    after = _end_of_hold(values, 0, FLAT_SHARE * abs(level))
    end = _end_time(stretch, after)
    if (stretch.steady and after < FEWEST_HELD) or end - times[0] < SHORTEST_HOLD:
        return None
    within = stretch.measured[stretch.times < end]
    if within.size < FEWEST_HELD or abs(within[-1] - within[0]) < 0.1 * abs(level):
        return None
    return Found(
        kind="step",
        begin=0,
        end=after,
        start=float(times[0]),
        end_time=end,
        amplitude=level - float(within[0]),
        level_after=level,
        start_uncertainty=stretch.command_period,
    )
