"""Where a steering wheel rests, and at what angle.

A wheel that comes to rest has a corner there. A polynomial over the corner swings beyond it by less than the
noise of a sample, but a play holds that for as long as the wheel rests, and seems wider by it. A mean over
the rest alone does not. The rest is where the angle does not move by more than noise does: over a fifth of a
second, which tells its ends; then over half a second at least within these ends, and for a better mean over
longer and longer times.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve
from scipy.stats import chi2

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Flags = NDArray[np.bool_]

SPANS, STILL = (0.2, 0.5, 1.0, 2.0, 4.0), 1e-3  # [s], and p-value of what moves in that time
ORDER = 4  # of the polynomial that shows what moves on the whole
ENDS = (1, 2, 4, 8)  # samples at either end, whose mean shows what moves there


def take_rests(values: Array, made: Array, reached: Index, answer: Array, period: float) -> None:
    """Put means over rests into a smoothed angle.

    Parameters
    ----------
    values : (n,) angle as measured, of one stretch; period : of its grid [s]
    made, reached : (n,) smoothed angle, and how many samples on either side each is of; changed
    answer : (k,) of the noise to one innovation
    """
    rest = np.ones(values.size, dtype=bool)
    for span in SPANS:
        count = round(span / period)
        if max(ORDER, ENDS[0]) < count <= values.size:
            rest = _rests(values, count, answer, rest)
            if span > SPANS[0]:
                _take_means(values, made, reached, count, rest)


def _rests(values: Array, count: int, answer: Array, within: Flags) -> Flags:
    """(n,) whether a sample is one of ``count`` in a row, all of them ``within``, that do not move."""
    inside = _sums(within.astype(np.float64), count) > count - 0.5
    begins = np.flatnonzero(_still(values, count, answer) & inside)
    change = np.bincount(begins, minlength=values.size + 1) - np.bincount(
        begins + count, minlength=values.size + 1
    )
    return np.asarray(np.cumsum(change)[:-1] > 0)


def _take_means(values: Array, made: Array, reached: Index, count: int, rest: Flags) -> None:
    """Take means over ``count`` samples of a rest, where what is there is of fewer or reaches beyond it."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rest, [False]])))
    means = _sums(values, count) / count
    for begin, end in edges.reshape(-1, 2):
        place = np.arange(begin, end)
        beyond = (place - reached[place] < begin) | (place + reached[place] >= end)
        taken = place[beyond | (2 * reached[place] < count)]
        made[taken] = means[np.clip(taken - count // 2, begin, end - count)]
        reached[taken] = count // 2


def _sums(values: Array, count: int) -> Array:
    """(n - count + 1,) over successive samples."""
    total = np.concatenate([[0.0], np.cumsum(values - values[0])])
    return np.asarray(total[count:] - total[:-count] + count * values[0])


def _still(values: Array, count: int, answer: Array) -> Flags:
    """(n - count + 1,) whether the angle does not move over ``count`` samples from each on, but for noise."""
    weights = _weights(answer.tobytes(), count)
    told = oaconvolve((values - values[0])[None, :], weights[:, ::-1], mode="valid", axes=1) ** 2
    whole, ends = told[:ORDER].sum(axis=0), told[ORDER:].max(axis=0)
    return np.asarray((whole < chi2.isf(STILL, ORDER)) & (ends < chi2.isf(STILL, 1)))


@lru_cache(maxsize=64)
def _weights(answer: bytes, count: int) -> Array:
    """(ORDER + 2 len(ENDS), count) what shows a motion, in standard deviations of what noise makes of it.

    Coefficients of a polynomial, then the mean of the first or last few samples against that of the others.
    """
    powers = np.vander(np.linspace(-1.0, 1.0, count), ORDER + 1, increasing=True)
    rows = list(np.linalg.qr(powers)[0][:, 1:].T)
    place = np.arange(count)
    for few in ENDS:
        contrast = np.where(place < few, 1.0 / few, -1.0 / max(count - few, 1))
        rows += [contrast, contrast[::-1]]
    noise = np.frombuffer(answer)
    return np.array([row / np.linalg.norm(np.convolve(noise, row)) for row in rows])
