"""Signal blocks: parts of a model that are no differential equation, each with its own derivative.

The derivative is that of the block itself where it exists; at the instants of a jump (a held command, a
quantised value) and at a corner it is that of the branch on one side.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def delayed(times: Array, values: Array, delay: float, at: Array) -> tuple[Array, Array]:
    """A sampled signal that runs linearly between samples, later by ``delay``: y(t) = u(t - L).

    Parameters
    ----------
    times : (m,) strictly increasing [s]; values : (m,), held before the first and after the last
    delay : L [s]
    at : (n,) times of the output [s]

    Returns
    -------
    value : (n,)
    derivative : (n,) dy/dL = -u'(t - L), that of the stretch after a sample at the sample itself
    """
    then = np.asarray(at, dtype=np.float64) - delay
    slopes = np.concatenate([[0.0], np.diff(values) / np.diff(times), [0.0]])
    place = np.searchsorted(times, then, side="right")
    return np.interp(then, times, values), -slopes[place]


def held(times: Array, values: Array, delay: float, at: Array) -> Array:
    """A held command, later by ``delay``: the last value sent at least ``delay`` ago.

    Its derivative to the delay is zero but for impulses where the value changes; what follows a held command
    smoothly has dy/dL = -ẏ(t - L) (see ``cascade``).

    times : (m,) increasing [s]; values : (m,), the first also before its time; at : (n,) [s] -> (n,)
    """
    place = np.searchsorted(times + delay, at, side="right") - 1
    return np.asarray(values, dtype=np.float64)[np.maximum(place, 0)]


def ratio_map(table: Array, angle: Array) -> tuple[Array, Array]:
    """Road-wheel angle from the steering-wheel angle, linear between the rows of a table and beyond its ends.

    Parameters
    ----------
    table : (k, 2) steering-wheel angle, strictly rising, and road-wheel angle [rad]; k at least 2
    angle : (n,) of the steering wheel [rad]

    Returns
    -------
    value : (n,) of the road wheels [rad]
    slope : (n,) [-]
    """
    wheel, road = np.asarray(table, dtype=np.float64).T
    slopes = np.diff(road) / np.diff(wheel)
    place = np.clip(np.searchsorted(wheel, angle, side="right") - 1, 0, slopes.size - 1)
    return road[place] + slopes[place] * (angle - wheel[place]), slopes[place]


def quantised(values: Array, step: float) -> tuple[Array, Array]:
    """The nearest multiple of ``step``, and its derivative to the step (that to the value is zero).

    values : (n,); step : positive, in the unit of the values -> (n,), (n,)
    """
    count = np.round(np.asarray(values, dtype=np.float64) / step)
    return step * count, count


def play(
    values: Array, width: float, *, start: float | None = None, derivatives: Array | None = None
) -> tuple[Array, Array]:
    """Backlash: the output follows only where the input has used up the play, |u - y| <= w/2.

    Parameters
    ----------
    values : (n,) input
    width : w of the whole play, not negative, in the unit of the values
    start : output before the first sample; in the middle of the play where None
    derivatives : (n, k) of the input to parameters upstream

    Returns
    -------
    output : (n,)
    derivative : (n, 1 + k) to the width, then to the parameters upstream
    """
    values = np.ascontiguousarray(values, dtype=np.float64)
    given = np.zeros((values.size, 0)) if derivatives is None else derivatives
    out = np.empty(values.size)
    derivative = np.zeros((values.size, 1 + given.shape[1]))
    first = values[0] if start is None and values.size else start or 0.0
    free = start is None
    _play(values, width, first, free, np.ascontiguousarray(given, dtype=np.float64), out, derivative)
    return out, derivative


@numba.njit(
    "void(float64[::1], float64, float64, boolean, float64[:, ::1], float64[::1], float64[:, ::1])",
    cache=True,
    error_model="numpy",
)
def _play(
    values: Array, width: float, first: float, free: bool, given: Array, out: Array, derivative: Array
) -> None:
    """Fill ``out`` and ``derivative``; ``free`` says that the first output stands at the first input."""
    y = first
    for i in range(values.size):
        moved = True
        side = 0.0
        if values[i] - y > 0.5 * width:
            side = -0.5
        elif y - values[i] > 0.5 * width:
            side = 0.5
        else:
            moved = free and i == 0
        if moved:
            y = values[i] + side * width
            derivative[i, 0] = side
            for k in range(given.shape[1]):
                derivative[i, 1 + k] = given[i, k]
        elif i > 0:
            for k in range(derivative.shape[1]):
                derivative[i, k] = derivative[i - 1, k]
        out[i] = y


def start_matters(values: Array, width: float) -> NDArray[np.bool_]:
    """Whether what a play gives still depends on where in the play it began: until the input has moved by w.

    values : (n,) input; width : w, in its unit -> (n,)
    """
    moved = np.maximum.accumulate(values) - np.minimum.accumulate(values)
    return np.asarray(moved < width)


def lagged(values: Array, rate: Array, steps: Array, offsets: NDArray[np.int64]) -> Array:
    """First-order lag with a rate that changes, ẏ = k (u - y), from rest at the start of each segment.

    Within a step u runs linearly and k is its mean: exact where k is constant.

    Parameters
    ----------
    values : (n,) u; rate : (n,) k, positive [1/s]; steps : (n,) to the next value [s]
    offsets : (s + 1,) first value of each segment, and n
    """
    out = np.empty(values.size)
    bounds = np.asarray(offsets, dtype=np.int64)
    _lagged(_contiguous(values), _contiguous(rate), _contiguous(steps), bounds, out)
    return out


def oscillating(
    values: Array, frequency: float, damping: float, steps: Array, offsets: NDArray[np.int64]
) -> Array:
    """ÿ + 2 ζ ω ẏ + ω² y = ω² u, from rest at y = u at the start of each segment; u runs linearly in a step.

    Parameters
    ----------
    values : (n,) u; frequency : ω [rad/s]; damping : ζ
    steps : (n,) to the next value [s], short beside 1/ω; offsets : (s + 1,)
    """
    out = np.empty(values.size)
    bounds = np.asarray(offsets, dtype=np.int64)
    _oscillating(_contiguous(values), _contiguous(steps), bounds, frequency, damping, out)
    return out


def _contiguous(values: Array) -> Array:
    return np.ascontiguousarray(values, dtype=np.float64)


@numba.njit(
    "void(float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])",
    cache=True,
    error_model="numpy",
)
def _lagged(u: Array, rate: Array, steps: Array, offsets: NDArray[np.int64], out: Array) -> None:
    """With x = k h: what lags behind a ramp is its slope over k, and the rest decays by exp(-x)."""
    for segment in range(offsets.size - 1):
        first, last = offsets[segment], offsets[segment + 1]
        y = u[first] if last > first else 0.0
        for i in range(first, last):
            out[i] = y
            if i + 1 < last:
                x = 0.5 * (rate[i] + rate[i + 1]) * steps[i]
                behind = (u[i + 1] - u[i]) / x
                y = u[i + 1] - behind + (y - u[i] + behind) * math.exp(-x)


@numba.njit(
    "void(float64[::1], float64[::1], int64[::1], float64, float64, float64[::1])",
    cache=True,
    error_model="numpy",
)
def _oscillating(
    u: Array, steps: Array, offsets: NDArray[np.int64], frequency: float, damping: float, out: Array
) -> None:
    """Runge-Kutta steps of order 4."""
    square, friction = frequency * frequency, 2.0 * damping * frequency
    for segment in range(offsets.size - 1):
        first, last = offsets[segment], offsets[segment + 1]
        y, v = (u[first], 0.0) if last > first else (0.0, 0.0)
        for i in range(first, last):
            out[i] = y
            if i + 1 < last:
                h, half = steps[i], 0.5 * (u[i] + u[i + 1])
                k1 = square * (u[i] - y) - friction * v
                v2 = v + 0.5 * h * k1
                k2 = square * (half - y - 0.5 * h * v) - friction * v2
                v3 = v + 0.5 * h * k2
                k3 = square * (half - y - 0.5 * h * v2) - friction * v3
                v4 = v + h * k3
                k4 = square * (u[i + 1] - y - h * v3) - friction * v4
                y += h / 6.0 * (v + 2.0 * (v2 + v3) + v4)
                v += h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
