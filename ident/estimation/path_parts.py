"""A measured path: where it leads, and its parts, each of which may be moved and turned as a whole.

The errors of the inputs of a simulation add up in position and heading. Over ``ANCHOR`` seconds the shape of
the path still tells something of the vehicle; where a part of it lies as a whole tells of those errors only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ident.estimation.vehicle_records import SignalSamples, Windows

Array = NDArray[np.float64]

ANCHOR = 10.0  # [s] over which the shape of the path is compared
FREEDOMS = 3  # of a part of the path: moved along x and y, turned
FAST = 0.5  # [m/s] below which the path has no direction
AROUND = 0.25  # [s] before and after a sample, between which its direction is taken


def direction_of_travel(x: SignalSamples, y: SignalSamples) -> Array:
    """(n,) direction in which the position moves [rad], at its samples, window by window."""
    direction = np.zeros(x.times.size)
    for begin, end in zip(x.begins[:-1], x.begins[1:], strict=True):
        part = slice(int(begin), int(end))
        direction[part] = _direction(x.times[part], x.values[part], y.values[part])
    return direction


def travelled(windows: Windows, x: SignalSamples, y: SignalSamples) -> Array:
    """(n,) distance along the measured path from where its run begins [m], from one sample to the next."""
    run, course = windows.run[x.window], direction_of_travel(x, y)
    middle = course[:-1] + 0.5 * np.diff(np.unwrap(course))
    step = np.cos(middle) * np.diff(x.values) + np.sin(middle) * np.diff(y.values)
    total = np.concatenate([[0.0], np.cumsum(step)])
    _, first, number = np.unique(run, return_index=True, return_inverse=True)
    return np.asarray(total - total[first[number]])


def _direction(times: Array, x: Array, y: Array) -> Array:
    """Direction of travel from positions around each; kept where hardly anything moves."""
    if times.size < 2:
        return np.zeros(times.size)
    before, after = np.maximum(times - AROUND, times[0]), np.minimum(times + AROUND, times[-1])
    along = np.interp(after, times, x) - np.interp(before, times, x)
    across = np.interp(after, times, y) - np.interp(before, times, y)
    moved = np.hypot(along, across) > FAST * (after - before)
    angle = np.arctan2(across, along)
    if not moved.any():
        return np.zeros(times.size)
    return np.asarray(np.interp(times, times[moved], np.unwrap(angle[moved])))


def moved_and_turned(
    windows: Windows, x: SignalSamples, y: SignalSamples, course: Array
) -> tuple[Array, Array]:
    """Derivatives of the position along and across the course to what moves and turns parts of a window.

    Parameters
    ----------
    x, y : measured position, at the same stamps
    course : (n,) direction of travel at them [rad]

    Returns
    -------
    along, across : (n, FREEDOMS k), k one less than the most parts of a window: moved along x, along y [m],
        turned about the first sample of the part [rad]
    """
    part, count = _parts(windows, x)
    along = np.zeros((x.times.size, FREEDOMS * (count - 1)))
    across = np.zeros_like(along)
    cosine, sine = np.cos(course)[:, None], np.sin(course)[:, None]
    for window, number in {(w, p) for w, p in zip(x.window.tolist(), part.tolist(), strict=True) if p}:
        own = np.flatnonzero((x.window == window) & (part == number))
        dx, dy = x.values[own] - x.values[own[0]], y.values[own] - y.values[own[0]]
        to_x = np.column_stack([np.ones(own.size), np.zeros(own.size), -dy])
        to_y = np.column_stack([np.zeros(own.size), np.ones(own.size), dx])
        freedoms = slice(FREEDOMS * (number - 1), FREEDOMS * number)
        along[own, freedoms] = cosine[own] * to_x + sine[own] * to_y
        across[own, freedoms] = cosine[own] * to_y - sine[own] * to_x
    return along, across


def _parts(windows: Windows, x: SignalSamples) -> tuple[NDArray[np.intp], int]:
    """(n,) part of its window in which each sample lies, and the most parts of a window."""
    begin = np.array([record.times[0] for record in windows.records])[x.window]
    length = np.array([record.times[-1] - record.times[0] for record in windows.records])
    parts = np.maximum(np.rint(length / ANCHOR).astype(np.intp), 1)
    reached = ((x.times - begin) / (length / parts)[x.window]).astype(np.intp)
    return np.minimum(reached, parts[x.window] - 1), int(parts.max())
