"""Whether a model is better than another on the same data; intervals from blocks of driving drawn anew."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ident.estimation.evaluation import BLOCK, BlockSums, bootstrap_weights, interval
from ident.estimation.layer import Likelihood
from ident.estimation.score_blocks import block_index, block_sums

Array = NDArray[np.float64]
Index = NDArray[np.intp]

LEAST_BLOCKS = 3


def gain_interval(
    before: Likelihood,
    after: Likelihood,
    *,
    samples: float | None = None,
    seed: int = 0,
    block: float = BLOCK,
) -> tuple[float, float, float]:
    """Log likelihood that a model gains over another, with its 95 % interval.

    Parameters
    ----------
    before, after : 2 log likelihood over the same bins, under one noise
    samples : that the gain is divided by; the number of bins where None
    seed : of the draws; block : length of what is drawn as one [s]

    Returns
    -------
    mean, low, high : infinite limits with fewer than three blocks

    Notes
    -----
    Drawn means are stretched about their centre by the quantile of Student's t over that of the normal, for
    few blocks draw too narrow an interval.
    """
    gain = (after.values - before.values) / 2
    number = float(gain.size if samples is None else samples)
    sums = block_sums(gain, block_index(before.run, before.time, block))
    mean, count = float(sums.sum()) / max(number, 1.0), sums.size
    if count < LEAST_BLOCKS:
        return mean, -np.inf, np.inf
    drawn = bootstrap_weights(count, seed) @ sums / number
    stretch = float(stats.t.isf(0.025, count - 1) / stats.norm.isf(0.025) * np.sqrt(count / (count - 1)))
    low, high = mean + stretch * (np.quantile(drawn, [0.025, 0.975]) - mean)
    # one block that gains far more than the others must not draw the limit below what was ever drawn
    return mean, float(max(low, drawn.min())), float(min(high, drawn.max()))


def rms_range(
    errors: Array, run: Index, time: Array, *, seed: int = 0, block: float = BLOCK
) -> tuple[float, float | None, float | None]:
    """Root mean square of errors (n,) with its 95 % interval; None with fewer than three blocks."""
    sums = _squares(errors, block_index(run, time, block))
    found = interval(sums, bootstrap_weights(sums.counts.size, seed))
    return (sums.rms, None, None) if found is None else (sums.rms, *found)


def _squares(errors: Array, numbers: Index) -> BlockSums:
    return BlockSums(block_sums(errors**2, numbers), block_sums(np.ones(errors.size), numbers))


def same_size(sizes: Array, stds: Array) -> float | None:
    """P-value of the hypothesis that an effect is as large in every run (Cochran 1954).

    Parameters
    ----------
    sizes, stds : (r,) size by each run alone and its standard error; infinite where a run is mute

    Returns
    -------
    None where fewer than two runs tell
    """
    told = np.isfinite(sizes) & np.isfinite(stds) & (stds > 0)
    if np.count_nonzero(told) < 2:
        return None
    weight = 1.0 / stds[told] ** 2
    mean = np.average(sizes[told], weights=weight)
    return float(stats.chi2.sf(np.sum(weight * (sizes[told] - mean) ** 2), np.count_nonzero(told) - 1))


def scatter_of_runs(sizes: Array, stds: Array) -> float:
    """How much more the sizes of the runs scatter than their standard errors say, at least one (Birge 1932).

    That of their common size is to be multiplied by it: what differs from run to run, and is not
    in the model, is in that scatter.

    Parameters
    ----------
    sizes, stds : as in :func:`same_size`
    """
    told = np.isfinite(sizes) & np.isfinite(stds) & (stds > 0)
    count = int(np.count_nonzero(told))
    if count < 2:
        return 1.0
    weight = 1.0 / stds[told] ** 2
    mean = np.average(sizes[told], weights=weight)
    return float(np.sqrt(max(1.0, np.sum(weight * (sizes[told] - mean) ** 2) / (count - 1))))
