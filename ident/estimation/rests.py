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
    within = np.ones(values.shape, dtype=bool)
    for span in SPANS:
        count = round(span / period)
        if ORDER < count <= len(values):
            inside = _sums(within.astype(np.float64), count) > count - 0.5
            still = _still(values, count, answer) & inside
            within = _covered(still, count)
            if span > SPANS[0]:
                _take_means(values, made, reached, count, still)


def _covered(begins: Flags, count: int) -> Flags:
    """(n, c) whether a sample is one of so many from a begin on; ``begins`` : where they may be."""
    change = np.zeros((len(begins) + count, begins.shape[1]), np.intp)
    change[: len(begins)] += begins
    change[count:] -= begins
    return np.asarray(np.cumsum(change[:-1], axis=0) > 0)


def _take_means(values: Array, made: Array, reached: Index, count: int, still: Flags) -> None:
    """Take means over ``count`` samples of a rest, where what is there is of fewer or reaches beyond it.

    still : (n - count + 1, c) whether so many samples from each on rest. Two samples belong to one rest if
        they rest together: where an angle jumps, two rests touch.
    """
    means, rest = _sums(values, count) / count, _covered(still, count)
    apart = np.ones((1, values.shape[1]), dtype=bool)
    joined = _covered(still, count - 1)[: len(values) - 1]
    begins = rest & np.concatenate([apart, ~joined])
    ends = rest & np.concatenate([~joined, apart])
    columns, firsts = np.nonzero(begins.T)
    for column, begin, end in zip(columns, firsts, np.nonzero(ends.T)[1] + 1, strict=True):
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
    most, total = np.sqrt(chi2.isf(STILL, 1)), _sums(about, count)
    for few, length in lengths.items():
        part = _sums(about, few)
        for some in (part[: len(total)], part[count - few :]):
            still &= np.abs(some / few - (total - some) / (count - few)) < most * length
    return still


@lru_cache(maxsize=64)
def _moves(answer: bytes, count: int) -> tuple[Array, dict[int, float]]:
    """(ORDER, count) weights that give the coefficients, in standard deviations of what noise makes of them.

    And the standard deviation of what it makes of so many samples against the others.
    """
    noise, place = np.frombuffer(answer), np.arange(count)
    powers = np.vander(np.linspace(-1.0, 1.0, count), ORDER + 1, increasing=True)
    rows = np.linalg.qr(powers)[0][:, 1:].T
    scaled = [row / np.linalg.norm(np.convolve(noise, row)) for row in rows]
    against = {few: np.where(place < few, 1.0 / few, -1.0 / (count - few)) for few in ENDS if few < count}
    return np.array(scaled), {few: float(np.linalg.norm(np.convolve(noise, a))) for few, a in against.items()}
