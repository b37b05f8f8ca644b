"""Where a steering wheel rests, and at what angle.

A wheel that comes to rest has a corner there. A polynomial over the corner swings beyond it by less than the
noise of a sample, but a play holds that for as long as the wheel rests, and seems wider by it. A mean over
the rest alone does not. The rest is where the angle does not move by more than noise does: over a fifth of a
second, which tells its ends, and over two seconds at least within these ends. In less time a slow motion
hides in the noise (measured: over half a second, slow driving at 50 Hz has an error 6 % larger than without).
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

SPANS, STILL = (0.2, 2.0, 4.0), 1e-3  # [s], and p-value of what moves in that time
ORDER = 4  # of the polynomial that shows what moves on the whole
ENDS = (1, 2, 4, 8)  # samples at either end, whose mean shows what moves there


def take_rests(values: Array, made: Array, reached: Index, answer: Array, period: float) -> None:
    """Put means over rests into smoothed angles.

    Parameters
    ----------
    values : (n, c) angles as measured, c of one stretch; period : of its grid [s]
    made, reached : (n, c) smoothed angles, and how many samples on either side each is of; changed
    answer : (k,) of the noise to one innovation
    """
    rest = np.ones(values.shape, dtype=bool)
    for span in SPANS:
        count = round(span / period)
        if max(ORDER, ENDS[0]) < count <= len(values):
            rest = _rests(values, count, answer, rest)
            if span > SPANS[0]:
                _take_means(values, made, reached, count, rest)


def _rests(values: Array, count: int, answer: Array, within: Flags) -> Flags:
    """(n, c) whether a sample is one of ``count`` in a row, all of them ``within``, that do not move."""
    inside = _sums(within.astype(np.float64), count) > count - 0.5
    begin = (_still(values, count, answer) & inside).astype(np.intp)
    change = np.zeros((len(values) + 1, values.shape[1]), np.intp)
    change[: len(begin)] += begin
    change[count:] -= begin
    return np.asarray(np.cumsum(change[:-1], axis=0) > 0)


def _take_means(values: Array, made: Array, reached: Index, count: int, rest: Flags) -> None:
    """Take means over ``count`` samples of a rest, where what is there is of fewer or reaches beyond it."""
    means = _sums(values, count) / count
    ends = np.zeros((1, values.shape[1]), dtype=bool)
    columns, edges = np.nonzero(np.diff(np.concatenate([ends, rest, ends]), axis=0).T)
    for column, (begin, end) in zip(columns[::2], edges.reshape(-1, 2), strict=True):
        place, reach = np.arange(begin, end), reached[begin:end, column]
        beyond = (place - reach < begin) | (place + reach >= end)
        taken = place[beyond | (2 * reach < count)]
        made[taken, column] = means[np.clip(taken - count // 2, begin, end - count), column]
        reached[taken, column] = count // 2


def _sums(values: Array, count: int) -> Array:
    """(n - count + 1, c) over successive samples."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values - values[0], axis=0)])
    return np.asarray(total[count:] - total[:-count] + count * values[0])


def _still(values: Array, count: int, answer: Array) -> Flags:
    """(n - count + 1, c) whether an angle does not move over ``count`` samples from each on, but for noise.

    Told by the coefficients of a polynomial, and by the mean of the first or last few samples against that
    of the others.
    """
    weights, lengths = _moves(answer.tobytes(), count)
    about = values - values[0]
    whole = sum(oaconvolve(about, row[::-1, None], mode="valid", axes=0) ** 2 for row in weights)
    still = np.asarray(whole < chi2.isf(STILL, ORDER))
    most, total, last = np.sqrt(chi2.isf(STILL, 1)), _sums(about, count), len(about) - count + 1
    for few, length in zip(ENDS, lengths, strict=True):
        part, least = _sums(about, few), most * length
        for some in (part[:last], part[count - few :]):
            still &= np.abs(some / few - (total - some) / max(count - few, 1)) < least
    return still


@lru_cache(maxsize=64)
def _moves(answer: bytes, count: int) -> tuple[Array, list[float]]:
    """(ORDER, count) weights that give the coefficients, in standard deviations of what noise makes of them.

    And the standard deviation of what it makes of the first few samples against the others.
    """
    noise, place = np.frombuffer(answer), np.arange(count)
    powers = np.vander(np.linspace(-1.0, 1.0, count), ORDER + 1, increasing=True)
    rows = np.linalg.qr(powers)[0][:, 1:].T
    against = [np.where(place < few, 1.0 / few, -1.0 / max(count - few, 1)) for few in ENDS]
    scaled = [row / np.linalg.norm(np.convolve(noise, row)) for row in rows]
    return np.array(scaled), [float(np.linalg.norm(np.convolve(noise, one))) for one in against]
