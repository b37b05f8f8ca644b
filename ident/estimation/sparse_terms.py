"""What is left, told by one or two terms of a small basis: where no effect of the catalogue explains it.

Terms are the directions of the generic basis (and products that a caller adds): each is a term in a named
equation. The best one is that of the smallest joint p-value; a second joins it where it is still significant
beside it and gains more than log(n) for n blocks. How sure the choice is: the share of random halves of the
blocks in which the same term comes first (stability selection, Meinshausen and Bühlmann 2010,
doi:10.1111/j.1467-9868.2010.00740.x).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ident.estimation.detectable import separating
from ident.estimation.layer import Group, LayerScores, Shape
from ident.estimation.residual_tests import LEVEL, Screen, Screened, screen
from ident.estimation.score_blocks import block_index, block_sums

Array = NDArray[np.float64]

HALVES = 100
ALIKE = 0.9  # cosine from which on two terms count as the same one


@dataclass(frozen=True)
class Term:
    """One term.

    key, layer : of its group; shape : of it
    coefficients, stds : (d,) of the columns of the shape; beside the term before it, where there is one
    statistic : 2 log likelihood that one step gains; p_value : corrected for all terms that were tried
    """

    key: str
    layer: str
    shape: Shape
    coefficients: Array
    stds: Array
    statistic: float
    p_value: float


@dataclass(frozen=True)
class Discovery:
    """The best sparse description: terms, the strongest first.

    stability : share of half-samples in which the first term comes first (or one that looks the same here)
    alike : other terms that look the same here
    """

    terms: tuple[Term, ...]
    stability: float
    alike: tuple[str, ...]


def discover(
    layers: Sequence[LayerScores],
    keys: Sequence[str] | None = None,
    *,
    level: float = LEVEL,
    draws: int = 1000,
    seed: int = 0,
) -> Discovery | None:
    """Find the best sparse term.

    Parameters
    ----------
    keys : of the groups that may be chosen; the generic basis where None
    level : of false alarms among them

    Returns
    -------
    None where none of them is significant
    """
    chosen = [_restricted(scores, keys) for scores in layers]
    found = screen(chosen, level=level, draws=draws, seed=seed)
    first = _first_term(found, level)
    if first is None:
        return None
    scores = next(one for one in chosen if one.layer == first.layer)
    looks = {g.key: separating(scores, first.key, g.key) for g in scores.groups if g.key != first.key}
    alike = tuple(sorted(key for key, cosine in looks.items() if cosine > ALIKE))
    terms = [_term(first)]
    rest = [one if one.layer != first.layer else _without(one, first, alike) for one in chosen]
    second = _first_term(screen(rest, level=level, draws=draws, seed=seed + 1), level)
    if second is not None and second.statistic > _cost(rest, second.layer) * second.freedom:
        terms.append(_term(second))
    return Discovery(tuple(terms), _stability(found, first, {first.key, *alike}, seed), alike)


def _restricted(scores: LayerScores, keys: Sequence[str] | None) -> LayerScores:
    """Scores with some groups only; without the powers, which are no term."""
    groups = tuple(g for g in scores.groups if (g.effect is None if keys is None else g.key in keys))
    return replace(scores, groups=groups, signals=(), power=scores.power[:, :0], count=scores.count[:, :0])


def _first_term(found: Screen, level: float) -> Screened | None:
    first = found.strongest
    return first if first is not None and first.shape is not None and first.p_value <= level else None


def _term(one: Screened) -> Term:
    assert one.shape is not None
    stds = np.sqrt(np.maximum(np.diag(one.covariance), 0.0))
    return Term(one.key, one.layer, one.shape, one.coefficients, stds, one.statistic, one.p_value)


def _cost(layers: Sequence[LayerScores], layer: str) -> float:
    scores = next(one for one in layers if one.layer == layer)
    return float(np.log(block_index(scores.run, scores.time, 8.0).max() + 1))


def _without(scores: LayerScores, taken: Screened, alike: tuple[str, ...]) -> LayerScores:
    """Scores of what is left of each direction, and of the residual, beside a term that was taken.

    The energy within bins takes directions to be as alike there as on the whole.
    """
    assert taken.shape is not None
    own = list(taken.shape.columns)
    inverse = np.linalg.pinv(scores.gram[np.ix_(own, own)], rcond=1e-8, hermitian=True)
    share = inverse @ scores.gram[own]  # (d, c)
    gram = scores.gram - scores.gram[:, own] @ share
    before = np.maximum(np.diag(scores.gram), 1e-300)
    left = np.clip(np.diag(gram) / before, 0.0, 1.0)
    gone = left < 1e-6
    gram[gone], gram[:, gone] = 0.0, 0.0
    values = np.where(gone, 0.0, scores.scores - scores.scores[:, own] @ share)
    groups = tuple(g for g in scores.groups if g.key != taken.key and g.key not in alike)
    energy = np.where(gone, 0.0, scores.energy * left)
    return replace(scores, scores=values, gram=gram, energy=energy, groups=groups)


def _stability(found: Screen, first: Screened, same: set[str], seed: int) -> float:
    """Share of halves of the blocks in which one of ``same`` gains most."""
    random = np.random.default_rng(seed)
    layer = next(one for one in found.layers if one.scores.layer == first.layer)
    block = block_index(layer.scores.run, layer.scores.time, layer.block)
    sums, energy = block_sums(layer.parts.scores, block), block_sums(layer.parts.energy, block)
    groups: tuple[Group, ...] = layer.scores.groups
    owner = np.repeat(layer.group, layer.parts.count)
    place = np.repeat(np.arange(layer.parts.count.size), layer.parts.count)
    hits = 0
    for _ in range(HALVES):
        half = random.permutation(len(sums))[: len(sums) // 2]
        gain = sums[half].sum(axis=0) ** 2 / np.maximum(energy[half].sum(axis=0), 1e-9) / layer.spread.factor
        by_shape = np.bincount(place, gain)
        best = int(owner[np.searchsorted(place, np.argmax(by_shape))])
        hits += groups[best].key in same
    return hits / HALVES
