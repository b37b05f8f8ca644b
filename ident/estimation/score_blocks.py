"""Scores of directions against an estimate of their own spread, which holds whatever the colour of the noise.

The score of a direction d is T = d'e, e the whitened residual. Were e white with variance one, the variance
of T would be g = d'd. Where the whitening is imperfect (gusts, a noise of higher order) it is lambda g, and
lambda differs from direction to direction. It is estimated from sums over blocks of driving that are longer
than what is left of the correlation:

    u_B = (T_B - h_B T) / sqrt(1 - h_B),   lambda = sum u_B^2 / g,   h_B = g_B / g.

Each block is freed of what the direction itself explains (an effect that is there must not hide itself behind
its own size: plain sums of n blocks never reach T^2 > n times their variance) and corrected for that (CR2 of
Bell and McCaffrey 2002, with their degrees of freedom). A direction that lives in few blocks tells little of
its own lambda; it borrows from the others (empirical Bayes, Smyth 2004, doi:10.2202/1544-6115.1027): where
they agree, whitening is trusted and lambda is known; where they do not, each direction is on its own. lambda
is never taken below one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from ident.estimation.layer import BIN, LayerScores, Shape

Array = NDArray[np.float64]
Index = NDArray[np.intp]

BLOCKS = (4.0, 8.0)  # [s] tried in turn
CORRELATED = -0.1  # of neighbouring blocks, beyond chance: from here on a longer block is taken
MOST_FREEDOM = 50.0  # of what directions tell of each other
LEAST_FREEDOM = 1.5  # of a direction that tells anything of its own
TAKEN_UP = 1.3  # slow residuals were larger before the fit took its part of them (measured on synthetic sets)
STANDS_OUT = 16.0  # squared studentised score of a component that is no noise of the others
MOST_TAKEN = 3  # of those
DOUBT = 0.3  # part of the scatter by chance that may be no chance: directions are alike, not independent
DEPENDENT = 1e-8  # part of a shape's directions that counts as none


@dataclass(frozen=True)
class Components:
    """Directions of a layer, those of one shape made orthogonal to each other and of length one.

    scores, energy : (b, m) of each bin; ``energy`` sums to one over the bins
    mixing : (c, m) components are directions times this
    first, count : (shapes,) where the components of each shape begin, and how many there are (may be none)
    colour : (m,) variance over that of white noise that the colour of the residuals gives each score
    """

    scores: Array
    energy: Array
    mixing: Array
    first: Index
    count: Index
    colour: Array

    @property
    def total(self) -> Array:
        """(m,) scores."""
        return np.asarray(self.scores.sum(axis=0))


def components(scores: LayerScores, shapes: Sequence[Shape]) -> Components:
    """Symmetric orthogonalisation of each shape: what is orthogonal already stays as it is."""
    length = np.sqrt(np.maximum(np.diag(scores.gram), 0.0))
    mixed = [_mixing(scores.gram, length, shape) for shape in shapes]
    count = np.array([part.shape[1] for part in mixed], dtype=np.intp)
    mixing = np.zeros((length.size, int(count.sum())))
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.intp)
    energy = np.zeros((scores.scores.shape[0], mixing.shape[1]))
    for shape, part, at in zip(shapes, mixed, first, strict=True):
        here = slice(int(at), int(at) + part.shape[1])
        mixing[list(shape.columns), here] = part
        energy[:, here] = _energy(scores, length, list(shape.columns), part)
    energy /= np.maximum(energy.sum(axis=0), 1e-300)
    return Components(scores.scores @ mixing, energy, mixing, first, count, _colour(scores, length, mixing))


def _colour(scores: LayerScores, length: Array, mixing: Array) -> Array:
    """(m,) mean over the directions of each component, by what they are of it."""
    if scores.colour is None:
        return np.ones(mixing.shape[1])
    part = (mixing * length[:, None]) ** 2
    return np.asarray(scores.colour @ part / np.maximum(part.sum(axis=0), 1e-300))


def _mixing(gram: Array, length: Array, shape: Shape) -> Array:
    """(k, m) from the columns of a shape to its components; m is less than k where they depend."""
    chosen = list(shape.columns)
    alive = np.flatnonzero(np.isfinite(length[chosen]) & (length[chosen] > 0))
    out = np.zeros((len(chosen), 0))
    if not alive.size:
        return out
    columns = np.array(chosen)[alive]
    scale = 1.0 / length[columns]
    if alive.size == 1:
        out = np.zeros((len(chosen), 1))
        out[alive, 0] = scale
        return out
    values, vectors = np.linalg.eigh(gram[np.ix_(columns, columns)] * np.outer(scale, scale))
    kept = values > DEPENDENT * columns.size
    root = vectors[:, kept] / np.sqrt(values[kept])
    whitening = root @ vectors[:, kept].T if kept.all() else root
    out = np.zeros((len(chosen), whitening.shape[1]))
    out[alive] = scale[:, None] * whitening
    return out


def _energy(scores: LayerScores, length: Array, columns: list[int], mixing: Array) -> Array:
    """(b, m) squared length within bins, taking directions to be as alike there as on the whole."""
    size = np.sqrt(np.maximum(scores.energy[:, columns], 0.0))
    if len(columns) == 1:
        return np.asarray((size * mixing[0]) ** 2)
    scale = np.maximum(length[columns], 1e-300)
    alike = scores.gram[np.ix_(columns, columns)] / np.outer(scale, scale)
    within = size[:, :, None] * mixing
    return np.asarray(np.maximum(np.einsum("bjm,jk,bkm->bm", within, alike, within, optimize=True), 0.0))


@dataclass(frozen=True)
class Spread:
    """How far the scores of components scatter.

    factor : (m,) variance of each score over that of white noise, at least one
    freedom : (m,) degrees of freedom of that estimate
    block : [s] length of what is taken as independent
    """

    factor: Array
    freedom: Array
    block: float


@dataclass(frozen=True)
class BlockScores:
    """Scores of components in blocks of driving.

    values, share : (B, m) score and part of the energy; run : (B,)
    """

    values: Array
    share: Array
    run: Index

    def without(self, one: int, alike: Array) -> BlockScores:
        """Free of what component ``one`` explains; alike : (m,) inner products of the others with it.

        Within blocks, components are taken to be as alike as on the whole.
        """
        common = np.sqrt(self.share * self.share[:, [one]])
        total = np.maximum(common.sum(axis=0), 1e-300)
        taken = self.values[:, one].sum() * alike * common / total
        return BlockScores(self.values - taken, self.share, self.run)

    @cached_property
    def own(self) -> Array:
        """(B, m) freed of what each component itself explains, corrected for that."""
        kept = np.sqrt(np.maximum(1.0 - self.share, 1e-6))
        return np.asarray((self.values - self.share * self.values.sum(axis=0)) / kept)

    @property
    def freedom(self) -> Array:
        """(m,) degrees of freedom of the variance that ``own`` gives (Bell and McCaffrey)."""
        h = self.share
        q = h**2 / np.maximum(1.0 - h, 1e-6)
        spread = (h**2).sum(axis=0) + q.sum(axis=0) ** 2 - (q**2).sum(axis=0)
        return np.asarray(1.0 / np.maximum(spread, 1e-12))

    @property
    def neighbours(self) -> float:
        """Correlation of neighbouring blocks beyond chance, of those components that show most of it."""
        same = self.run[1:] == self.run[:-1]
        if same.sum() < 4:
            return 0.0
        own = self.own
        power = np.maximum((own**2).sum(axis=0), 1e-300)
        correlation = (own[1:] * own[:-1])[same].sum(axis=0) / power
        chance = np.sqrt((self.share[1:] * self.share[:-1])[same].sum(axis=0))
        return float(np.quantile(correlation - 1.28 * chance, 0.9))


def block_index(run: Index, time: Array, seconds: float) -> Index:
    """(b,) number of the block of each bin: every run in equal parts of about ``seconds``."""
    out = np.zeros(run.size, dtype=np.intp)
    begin = 0
    for each in np.unique(run):
        here = run == each
        since = time[here] - time[here].min()
        span = since.max() + BIN
        parts = max(1, round(span / seconds))
        out[here] = begin + np.minimum((since / span * parts).astype(np.intp), parts - 1)
        begin += parts
    return np.asarray(np.unique(out, return_inverse=True)[1], dtype=np.intp)


def block_sums(values: Array, block: Index) -> Array:
    """(B, ...) sums over the bins of each block."""
    out = np.zeros((int(block.max(initial=-1)) + 1, *values.shape[1:]))
    np.add.at(out, block, values)
    return out


def in_blocks(parts: Components, scores: LayerScores, seconds: float) -> BlockScores:
    """Sums over blocks of about ``seconds``."""
    block = block_index(scores.run, scores.time, seconds)
    run = scores.run[np.unique(block, return_index=True)[1]]
    return BlockScores(block_sums(parts.scores, block), block_sums(parts.energy, block), run)


def spread(parts: Components, scores: LayerScores) -> Spread:
    """The factor of each component, from the shortest blocks whose neighbours are not correlated.

    As long as one component stands out, the others are freed of what it explains: it is no noise of theirs.
    """
    for seconds in BLOCKS:
        blocks = in_blocks(parts, scores, seconds)
        if blocks.neighbours < CORRELATED:
            break
    factor, freedom = _factors(blocks, parts.colour)
    for _ in range(MOST_TAKEN):
        statistic = blocks.values.sum(axis=0) ** 2 / factor
        best = int(np.argmax(statistic)) if statistic.size else 0
        if not statistic.size or statistic[best] < STANDS_OUT:
            break
        blocks = blocks.without(best, parts.mixing.T @ (scores.gram @ parts.mixing[:, best]))
        factor, freedom = _factors(blocks, parts.colour)
    return Spread(factor, freedom, seconds)


def _factors(blocks: BlockScores, colour: Array) -> tuple[Array, Array]:
    """(m,), (m,) factors and their degrees of freedom."""
    raw = (blocks.own**2).sum(axis=0)
    factor, freedom = _moderated(raw / colour, blocks.freedom)
    return np.asarray(1.0 + TAKEN_UP * np.maximum(factor * colour - 1.0, 0.0)), freedom


def _moderated(raw: Array, freedom: Array) -> tuple[Array, Array]:
    """Draw each factor towards what the others say, as far as they agree (Smyth 2004, section 6).

    Those that know their own better say more of how far they agree.
    """
    told = freedom > LEAST_FREEDOM
    if np.count_nonzero(told) < 3:
        return raw, np.maximum(freedom, 1e-3)
    half = freedom[told] / 2
    logs = np.log(np.maximum(raw[told], 1e-300)) - digamma(half) + np.log(half)
    chance = polygamma(1, half)
    weight = 1.0 / (chance + 0.1) ** 2
    mean = float(np.average(logs, weights=weight))
    beyond = float(np.average((logs - mean) ** 2 - (1 - DOUBT) * chance, weights=weight))
    prior = min(MOST_FREEDOM, 2 * _inverse_trigamma(beyond)) if beyond > 0 else MOST_FREEDOM
    centre = float(np.exp(mean + digamma(prior / 2) - np.log(prior / 2)))
    own = np.where(told, freedom, 0.0)
    factor = (prior * centre + own * raw) / (prior + own)
    return factor, own + prior


def _inverse_trigamma(value: float) -> float:
    """X with trigamma(x) = value > 0, by Newton's method on 1/trigamma, which is nearly straight."""
    x = 0.5 + 1.0 / value
    for _ in range(30):
        trigamma = float(polygamma(1, x))
        step = trigamma * (1 - trigamma / value) / float(polygamma(2, x))
        x += step
        if abs(step) < 1e-8 * x:
            break
    return x
