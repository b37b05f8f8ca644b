"""How much more a score scatters than its length says, by the colour that whitening left in the residuals.

Gusts, a wavy road or a noise of higher order than the whitening leave a slow correlation, within signals and
between them. Residuals are gathered in bins; their covariances over lags of some seconds are those of all
runs together, and give each direction d, gathered likewise,

    colour = (what of d'd lies within bins + sum over lags of D' C(lag) D) / d'd.

An effect that is there is no noise: as long as one direction stands out, it is taken off the residuals first.
Noise alike in all runs is assumed; the spread of the scores themselves is held against it
(:mod:`ident.estimation.score_blocks`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from ident.estimation.layer import BIN

Array = NDArray[np.float64]
Index = NDArray[np.intp]

LONGEST = 8.0  # [s] of the lags; from half of it on they count less and less
LEAST = 0.3  # no direction scatters less than this
STANDS_OUT = 16.0  # squared score over its variance, of a direction that is taken off
MOST_TAKEN = 3  # of those


def colour(directions: Array, residual: Array, run: Index, time: Array, length: Array) -> Array:
    """Variance of scores over that under white residuals.

    Parameters
    ----------
    directions : (b, s, c) sums over the samples of each bin and signal, over the root of their number
    residual : (b, s) of the whitened residual, likewise
    run, time : (b,) of the bins, the middles [s]
    length : (c,) squared length of each direction, over all samples

    Returns
    -------
    (c,) one where nothing is left of a direction
    """
    found = _colour(directions, residual, run, time, length)
    left = residual
    for _ in range(MOST_TAKEN):
        total = np.einsum("bsc,bs->c", directions, left)
        slow = (directions**2).sum(axis=(0, 1))
        statistic = total**2 / np.maximum(slow * found, 1e-300)
        best = int(np.argmax(statistic)) if statistic.size else 0
        if not statistic.size or statistic[best] < STANDS_OUT:
            break
        left = left - total[best] / slow[best] * directions[:, :, best]
        found = _colour(directions, left, run, time, length)
    return found


def _colour(directions: Array, residual: Array, run: Index, time: Array, length: Array) -> Array:
    """See :func:`colour`; nothing is taken off."""
    places = [_places(time[run == each]) for each in np.unique(run)]
    size = next_fast_len(int(max(place.max(initial=0) for place in places) + 1 + LONGEST / BIN), real=True)
    left = [_on_grid(residual[run == each], p, size) for each, p in zip(np.unique(run), places, strict=True)]
    seen = [_on_grid(np.ones((p.size, 1)), p, size) for p in places]
    density = _density(left, seen, size)
    total = np.maximum(length - (directions**2).sum(axis=(0, 1)), 0.0)
    for each, place in zip(np.unique(run), places, strict=True):
        waves = rfft(_on_grid(directions[run == each], place, size), axis=0)
        power = np.einsum("fsc,fst,ftc->fc", waves.conj(), density, waves, optimize=True).real
        total = total + (2 * power.sum(axis=0) - power[0] - (0 if size % 2 else power[-1])) / size
    return np.where(length > 0, np.maximum(total / np.where(length > 0, length, 1.0), LEAST), 1.0)


def _places(time: Array) -> Index:
    return np.asarray(np.rint((time - time.min(initial=np.inf)) / BIN), dtype=np.intp)


def _on_grid(values: Array, place: Index, size: int) -> Array:
    """(size, ...) sums of what falls on each place; zero elsewhere."""
    out = np.zeros((size, *values.shape[1:]))
    np.add.at(out, place, values)
    return out


def _density(left: list[Array], seen: list[Array], size: int) -> NDArray[np.complex128]:
    """(frequencies, s, s) spectral density of residuals, from covariances whose far lags count less."""
    waves = [rfft(one, axis=0) for one in left]
    product = np.sum([np.einsum("fs,ft->fst", one, one.conj()) for one in waves], axis=0)
    pairs = np.sum([np.abs(rfft(one[:, 0])) ** 2 for one in seen], axis=0)
    covariance = irfft(product, size, axis=0)
    count = np.rint(irfft(pairs, size))[:, None, None]
    lag = np.minimum(np.arange(size), size - np.arange(size)) * BIN
    weight = np.clip(2 - 2 * lag / LONGEST, 0.0, 1.0)[:, None, None]
    # over the pairs at no lag: far lags, of few pairs, count less for that too
    usual = np.maximum(count[0], 1.0)
    return np.asarray(rfft(weight * covariance / usual, axis=0))
