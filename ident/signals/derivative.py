"""The rate of change of a sampled signal.

At each sample a parabola in time is fitted by least squares to the samples around it (Savitzky and Golay
1964, here on the true stamps), and its slope at that sample is the derivative. The window is centred, so
there is no delay; it holds an odd number of samples, at least 5, that span about ``WINDOW``. Up to
0.2 / WINDOW [Hz] the slope is within 3 % (1.4 Hz); noise above 0.7 / WINDOW is suppressed.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]
WINDOW = 0.15
MIN_SAMPLES = 5
GAP_PERIODS = 3.0


def slope(time: Array, values: Array, window: float = WINDOW) -> tuple[Array, Array]:
    """Return times and derivative at the samples that have a full window without a gap.

    Parameters
    ----------
    time : (n,) rising [s]
    values : (n,)
    window : length of the window [s]

    Returns
    -------
    time, slope : (m,), m <= n
    """
    if len(time) < MIN_SAMPLES:
        return np.empty(0), np.empty(0)
    period = float(np.median(np.diff(time)))
    half = max(MIN_SAMPLES // 2, round(window / period / 2))
    count = min(2 * half + 1, len(time) - (len(time) + 1) % 2)
    half = count // 2
    middle = time[half : len(time) - half]
    t = sliding_window_view(time, count) - middle[:, None]
    y = sliding_window_view(values, count)
    whole = np.diff(t, axis=1).max(axis=1) <= GAP_PERIODS * period
    return middle[whole], _parabola_slope(t[whole], y[whole])


def _parabola_slope(t: Array, y: Array) -> Array:
    """Slope at t = 0 of the least-squares parabola of each row, by orthogonalising t against 1 and t²."""
    y = y - y.mean(axis=1, keepdims=True)
    square = t * t - np.mean(t * t, axis=1, keepdims=True)
    linear = t - t.mean(axis=1, keepdims=True)
    linear = linear - square * (_dot(linear, square) / _dot(square, square))[:, None]
    return _dot(linear, y) / _dot(linear, linear)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))
