"""Which fitted candidates the data cannot tell from the best.

A candidate stays in the class of the best

* where its log likelihood is so near that of the best that a right candidate would fall behind as far by
chance:
  2 (LL_best - LL_k) <= c chi2_d(1 - alpha / (M - 1)), c the spread of scores over that of white noise; or
* where it keeps most of what the best gains over the base model, and sums of the difference over blocks of
driving
  do not show that the best is nearer to the truth (Vuong 1989, doi:10.2307/1912557). Where an effect is huge
  every candidate is a little wrong, and the first rule alone would throw out the right one.

Likelihoods are compared less log(n) for each parameter, n the number of blocks (the correction of Schwarz,
which Vuong proposes too): blocks, not samples, are the independent pieces of data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ident.estimation.layer import Likelihood
from ident.estimation.score_blocks import block_index, block_sums

Array = NDArray[np.float64]

BLOCK = 8.0  # [s]
KEPT = 0.8  # of the gain of the best: a candidate that explains less is another one, however few the blocks
LEAST_BLOCKS = 3


@dataclass(frozen=True)
class Classes:
    """The candidates that these data cannot tell apart.

    best : by its likelihood less what its parameters cost
    members : the best first, then the others that may be right, nearest first
    behind : key -> 2 log likelihood by which each is behind the best (without the cost of parameters)
    p_values : key -> of the hypothesis that it is as near to the truth as the best; one for the best
    """

    best: str
    members: tuple[str, ...]
    behind: dict[str, float]
    p_values: dict[str, float]


def candidate_set(
    likelihoods: Mapping[str, Likelihood],
    freedom: Mapping[str, int],
    *,
    base: Likelihood | None = None,
    level: float = 0.05,
    spread: float = 1.0,
    block: float = BLOCK,
) -> Classes:
    """Compare candidates that were fitted to the same data under one noise.

    Parameters
    ----------
    likelihoods : key -> of each candidate, all over the same bins
    freedom : key -> number of parameters that it adds
    base : of the model without any; None where it is not known: then no candidate is too far behind to be
        tested
    level : of leaving out the right one
    spread : variance of scores over that of white noise
    block : length of what counts as independent [s]

    Raises
    ------
    ValueError
        If there is no candidate, or likelihoods are over different bins.
    """
    if not likelihoods:
        raise ValueError("no candidate to compare")
    first = next(iter(likelihoods.values()))
    sums = {key: _blocks(one, first, block) for key, one in likelihoods.items()}
    cost = float(np.log(len(next(iter(sums.values())))))
    worth = {key: float(one.sum()) - cost * freedom[key] for key, one in sums.items()}
    order = sorted(worth, key=lambda key: (-worth[key], key))
    best = order[0]
    against = level / max(1, len(order) - 1)
    gain = np.inf if base is None else float(sums[best].sum() - _blocks(base, first, block).sum())
    behind = {key: float(sums[best].sum() - sums[key].sum()) for key in order}
    p_values = {key: 1.0 if key == best else _vuong(sums[best] - sums[key]) for key in order}
    members = [best]
    for key in order[1:]:
        near = behind[key] <= spread * stats.chi2.isf(against, max(1, freedom[key]))
        alike = behind[key] <= (1 - KEPT) * gain and p_values[key] > against
        if near or alike:
            members.append(key)
    return Classes(best, tuple(members), behind, p_values)


def _blocks(one: Likelihood, like: Likelihood, seconds: float) -> Array:
    """(B,) sums over blocks."""
    if one.values.size != like.values.size or not np.array_equal(one.run, like.run):
        raise ValueError("likelihoods over different bins cannot be compared")
    return block_sums(one.values, block_index(one.run, one.time, seconds))


def _vuong(difference: Array) -> float:
    """P-value of differences (B,) of mean zero against a mean above it."""
    count = difference.size
    if count < LEAST_BLOCKS:
        return 1.0
    error = float(np.std(difference, ddof=1) * np.sqrt(count))
    if error == 0.0:
        return 1.0 if difference.sum() <= 0 else 0.0
    return float(stats.t.sf(difference.sum() / error, count - 1))
