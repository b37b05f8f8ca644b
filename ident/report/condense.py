"""Fewer points for the same picture: lines are broken at gaps and thinned so that no extreme is lost.

A line thinned to bins keeps the first, lowest, highest and last sample of each, so that at one bin a
pixel column the drawing is that of the whole line.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHORTEST_GAP = 0.2
"""A pause below this never breaks a line [s]."""
PERIODS_A_GAP = 5.0
"""A pause longer than so many median periods breaks a line."""


class Line(NamedTuple):
    """A line as it is drawn: (n,) time [s] and (n,) value, NaN where the pen is lifted."""

    time: Array
    value: Array


def break_limit(time: Array) -> float:
    """Say how long a pause breaks a line through these stamps [s].

    Parameters
    ----------
    time : (n,) stamps, not decreasing [s]
    """
    steps = np.diff(time)
    steps = steps[steps > 0]
    return max(SHORTEST_GAP, PERIODS_A_GAP * float(np.median(steps))) if steps.size else SHORTEST_GAP


def contiguous(time: Array, part: NDArray[np.int_] | None = None, limit: float | None = None) -> list[slice]:
    """Cut samples where the part changes or a pause is longer than ``limit``.

    Parameters
    ----------
    time : (n,) stamps, not decreasing [s]
    part : (n,) number of the part each sample belongs to
    limit : longest pause inside a stretch [s], by default ``break_limit``
    """
    if time.size == 0:
        return []
    cut = np.diff(time) > (break_limit(time) if limit is None else limit)
    if part is not None:
        cut |= np.diff(part) != 0
    edges = [0, *(np.flatnonzero(cut) + 1).tolist(), time.size]
    return [slice(begin, end) for begin, end in pairwise(edges)]


def broken(time: Array, values: Array, stretches: list[slice]) -> Line:
    """Join stretches into one line with a NaN between them.

    Parameters
    ----------
    time, values : (n,) samples
    stretches : as ``contiguous`` gives them
    """
    pieces_time, pieces_values = [], []
    for stretch in stretches:
        pieces_time += [time[stretch], time[stretch][-1:]]
        pieces_values += [values[stretch], np.array([np.nan])]
    if not pieces_time:
        return Line(np.empty(0), np.empty(0))
    return Line(np.concatenate(pieces_time)[:-1], np.concatenate(pieces_values)[:-1])


def thinned(line: Line, bins: int) -> Line:
    """Keep the first, lowest, highest and last sample of each of ``bins`` equal stretches of time.

    Of the samples that lift the pen, one is kept in each stretch that has any, so that never more than
    five samples a stretch remain. A line of at most four samples a stretch is given back as it is.

    Parameters
    ----------
    line : time not decreasing
    bins : number of stretches, about the width of the figure in pixels
    """
    count = line.time.size
    if count <= 4 * bins:
        return line
    span = line.time[-1] - line.time[0]
    if span <= 0:
        return line
    place = np.minimum(((line.time - line.time[0]) / span * bins).astype(np.int64), bins - 1)
    edges = np.flatnonzero(np.diff(place) != 0) + 1
    first = np.concatenate([[0], edges])
    last = np.concatenate([edges, [count]]) - 1
    keep = np.unique(np.concatenate([first, last, *_extremes(line.value, place, first, last)]))
    return Line(line.time[keep], line.value[keep])


def _extremes(
    values: Array, place: NDArray[np.int_], first: NDArray[np.int_], last: NDArray[np.int_]
) -> list[NDArray[np.int_]]:
    """Index of the lowest and the highest sample of each group first[i] … last[i], and of one NaN."""
    order = np.lexsort((values, place))
    finite = np.add.reduceat(np.isfinite(values).astype(np.int64), first)
    some, holed = finite > 0, finite < last - first + 1
    return [order[first[some]], order[(first + finite - 1)[some]], order[(first + finite)[holed]]]


def evenly(count: int, most: int) -> list[int]:
    """Choose at most ``most`` of ``count`` things, evenly spaced, the first and the last among them."""
    if count <= most:
        return list(range(count))
    return sorted({round(index) for index in np.linspace(0, count - 1, most)})


def spread_out(x: Array, y: Array, cells: tuple[int, int]) -> NDArray[np.int_]:
    """Choose points so that a cloud keeps its shape: one in each cell of a grid that has any.

    Parameters
    ----------
    x, y : (n,) finite
    cells : how many along x and y

    Returns
    -------
    index : (m,) rising; the leftmost, rightmost, lowest and highest points are among them
    """
    if x.size == 0:
        return np.empty(0, dtype=np.int64)
    places = [_cell(values, count) for values, count in ((x, cells[0]), (y, cells[1]))]
    _, first = np.unique(places[0] * cells[1] + places[1], return_index=True)
    ends = [values.argmin() for values in (x, y)] + [values.argmax() for values in (x, y)]
    return np.unique(np.concatenate([first, ends]))


def _cell(values: Array, count: int) -> NDArray[np.int_]:
    span = float(values.max() - values.min())
    if span <= 0:
        return np.zeros(values.size, dtype=np.int64)
    cell: NDArray[np.int_] = ((values - values.min()) / span * count).astype(np.int64)
    return np.minimum(cell, count - 1)
