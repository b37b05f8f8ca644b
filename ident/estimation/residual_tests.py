"""Whether anything is left in the residuals that noise does not explain, and where it points.

All directions of all layers are tested together (METHODS of the loop, the gate and the screen). Each shape of
a candidate has a studentised score (:mod:`ident.estimation.score_blocks`) and from it a p-value; a candidate
has the smallest of its shapes, the gate the smallest of all candidates. What the smallest of many alike
p-values is worth is found by drawing: under the hypothesis that nothing is left, scores are normal with the
inner products of the directions as their correlation. Candidates count alike whatever the number of their
shapes.

Drawing signs for blocks (the wild bootstrap) needs no such model, but it can never be surer than 2^-n of what
shows in n blocks only, and an effect that is there scatters the drawn scores by its own size: a limited rate
that shows in six steps could not be found however large. Here blocks give the spread of each score alone,
freed of its own effect.

Beside the scores, members of their own: whether residuals are larger where more is going on, compared within
stretches of ten seconds (between them the noise itself may differ). They see dynamics that no direction has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import chdtrc, erfc

from ident.estimation.layer import Group, LayerScores, Shape
from ident.estimation.score_blocks import (
    BlockScores,
    Components,
    Spread,
    block_index,
    block_sums,
    components,
    spread,
)

Array = NDArray[np.float64]

LEVEL = 0.05
DRAWS = 2000
TAIL = 0.02  # of the drawn p-values: how many tests a group of dependent ones is worth is read there
STRETCH = 10.0  # [s] within which residuals are compared with what is going on
TOGETHER = 2.0  # [s] within which the sizes of whitened residuals may depend on each other, as under gusts
LEAST_BINS = 20
LEAST_FREEDOM = 2.0
SMALLEST = 1e-300


@dataclass(frozen=True)
class Screened:
    """One candidate (or excess power of a signal) as its score shows it.

    key, effect, layer : as in the group
    statistic : of its best shape, 2 log likelihood that one step would gain; freedom : directions of that
        shape
    p_marginal : corrected for its own shapes alone; p_value : for all that was looked at
    shape : the best; None of excess power
    coefficients, covariance : (d,), (d, d) one-step estimate in units of the columns of that shape
    untestable : why nothing can be said, None where it can
    gain : 2 log likelihood that one step would gain if whitened residuals were white, in the shape of most
    """

    key: str
    effect: str | None
    layer: str
    statistic: float
    freedom: int
    p_marginal: float
    p_value: float
    shape: Shape | None
    coefficients: Array
    covariance: Array
    untestable: str | None = None
    gain: float = 0.0

    @property
    def size(self) -> tuple[float, float]:
        """One-step estimate of the size, and its standard error, in the unit of the effect."""
        if self.shape is None or not self.coefficients.size:
            return float("nan"), float("nan")
        unit = self.shape.size
        return float(self.coefficients[0] * unit), float(np.sqrt(self.covariance[0, 0]) * abs(unit))


@dataclass(frozen=True)
class LayerScreen:
    """What the joint test found out about one layer.

    shapes : of all groups, one after another; group : (shapes,) which group each belongs to
    parts, spread : components of the shapes and how their scores scatter
    worth : (groups,) how many independent tests the shapes of each group amount to
    """

    scores: LayerScores
    shapes: tuple[Shape, ...]
    group: NDArray[np.intp]
    parts: Components
    spread: Spread
    worth: Array

    @property
    def block(self) -> float:
        """Length of what is taken as independent [s]."""
        return self.spread.block


@dataclass(frozen=True)
class Screen:
    """The joint test of everything.

    groups : candidates and excess power, the smallest p-value first, those not testable last
    p_value : of the hypothesis that noise explains everything; rejected : at ``level``
    tests : directions that were looked at; worth : how many independent candidates these amount to
    draws : of the joint distribution
    """

    groups: tuple[Screened, ...]
    layers: tuple[LayerScreen, ...]
    p_value: float
    rejected: bool
    level: float
    tests: int
    worth: float
    draws: int

    @property
    def strongest(self) -> Screened | None:
        """What fired."""
        return self.groups[0] if self.groups and self.groups[0].untestable is None else None

    @property
    def block(self) -> float:
        """The longest of what is taken as independent [s]."""
        return max((layer.block for layer in self.layers), default=0.0)

    def of(self, key: str, layer: str | None = None) -> Screened:
        """A candidate by its key."""
        found = [one for one in self.groups if one.key == key and layer in {None, one.layer}]
        if not found:
            raise KeyError(key)
        return found[0]


def screen(
    layers: Sequence[LayerScores], *, level: float = LEVEL, draws: int = DRAWS, seed: int = 0
) -> Screen:
    """Test all candidates of all layers together.

    Parameters
    ----------
    layers : scores, of one or two layers
    level : of false alarms in all
    draws : of the joint distribution; seed : of the draws
    """
    random = np.random.default_rng(seed)
    found = [_of_layer(scores, draws, random) for scores in layers]
    powers = [_excess(scores, draws, random) for scores in layers]
    drawn = np.vstack([one.drawn for one in found] + [one.drawn for one in powers])
    worth = _worth(drawn.min(axis=0, initial=1.0), level) if drawn.size else 1.0
    everything = [each for one in found for each in one.screened] + [
        e for one in powers for e in one.screened
    ]
    joint = [_joined(one, worth) for one in everything]
    joint.sort(key=lambda one: (one.untestable is not None, one.p_value, one.p_marginal))
    p_value = joint[0].p_value if joint and joint[0].untestable is None else 1.0
    return Screen(
        groups=tuple(joint),
        layers=tuple(one.layer for one in found),
        p_value=p_value,
        rejected=p_value <= level,
        level=level,
        tests=sum(int(np.count_nonzero(one.layer.parts.count)) for one in found)
        + sum(len(one.screened) for one in powers),
        worth=worth,
        draws=draws,
    )


def corrected(p_value: float, worth: float) -> float:
    """Of the smallest of so many independent p-values."""
    return float(-np.expm1(worth * np.log1p(-min(p_value, 1 - 1e-12))))


def needed(p_value: float, worth: float) -> float:
    """What the smallest of so many p-values must be to be worth ``p_value``."""
    return float(-np.expm1(np.log1p(-p_value) / worth))


def _worth(smallest: Array, tail: float) -> float:
    """How many independent p-values have a smallest one that is distributed as the drawn (draws,)."""
    at = float(np.quantile(smallest, tail))
    return float(max(1.0, np.log1p(-tail) / np.log1p(-min(max(at, SMALLEST), 1 - 1e-12))))


def _joined(one: Screened, worth: float) -> Screened:
    p_value = 1.0 if one.untestable else corrected(one.p_marginal, worth)
    return Screened(**{**vars(one), "p_value": p_value})


@dataclass(frozen=True)
class _Tested:
    """Groups of one layer: screened but for the joint p-value; drawn (groups, draws) p-values of each."""

    layer: LayerScreen
    screened: list[Screened]
    drawn: Array


def _of_layer(scores: LayerScores, draws: int, random: np.random.Generator) -> _Tested:
    shapes = tuple(shape for group in scores.groups for shape in group.shapes)
    group = np.repeat(np.arange(len(scores.groups)), [len(one.shapes) for one in scores.groups])
    parts = components(scores, shapes)
    scatter = spread(parts, scores)
    tested = _TestedShapes(parts, scatter, shapes, *shape_tests(parts, scatter))
    drawn = _drawn(parts, scores.gram, draws, random)
    worth, by_group = np.ones(len(scores.groups)), np.ones((len(scores.groups), draws))
    screened = []
    for number, one in enumerate(scores.groups):
        own = np.flatnonzero((group == number) & (parts.count > 0))
        if own.size:
            smallest = drawn[own].min(axis=0)
            worth[number] = _worth(smallest, TAIL) if own.size > 1 else 1.0
            by_group[number] = -np.expm1(worth[number] * np.log1p(-np.minimum(smallest, 1 - 1e-12)))
        screened.append(_screened(one, scores.layer, tested, own, worth[number]))
    layer = LayerScreen(scores, shapes, group.astype(np.intp), parts, scatter, worth)
    return _Tested(layer, screened, by_group)


@dataclass(frozen=True)
class _TestedShapes:
    parts: Components
    spread: Spread
    shapes: tuple[Shape, ...]
    statistic: Array
    p_value: Array

    def gain(self, number: int) -> float:
        """Of one step of a shape, in 2 log likelihood of white innovations."""
        first, count = int(self.parts.first[number]), int(self.parts.count[number])
        return float(np.sum(self.parts.total[first : first + count] ** 2))

    def one_step(self, number: int) -> tuple[Array, Array]:
        """(d,), (d, d) estimate of the coefficients of a shape, and its covariance."""
        first, count = int(self.parts.first[number]), int(self.parts.count[number])
        own = slice(first, first + count)
        mixing = self.parts.mixing[list(self.shapes[number].columns), own]
        return mixing @ self.parts.total[own], (mixing * self.spread.factor[own]) @ mixing.T


def shape_tests(parts: Components, scatter: Spread) -> tuple[Array, Array]:
    """Statistic and p-value of every shape: sum of its squared studentised scores, of an F distribution."""
    squares = parts.total**2 / scatter.factor
    statistic, p_value = np.zeros(parts.first.size), np.ones(parts.first.size)
    for number, (first, count) in enumerate(zip(parts.first, parts.count, strict=True)):
        if count:
            own = slice(int(first), int(first + count))
            statistic[number] = squares[own].sum()
            freedom = count / np.sum(1.0 / scatter.freedom[own])
            p_value[number] = stats.f.sf(statistic[number] / count, count, freedom)
    return statistic, np.maximum(p_value, SMALLEST)


def _drawn(parts: Components, gram: Array, draws: int, random: np.random.Generator) -> Array:
    """(shapes, draws) p-values of shapes where scores are noise, correlated as their directions are."""
    alike = parts.mixing.T @ gram @ parts.mixing
    values, vectors = np.linalg.eigh(alike)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    normal = root @ random.standard_normal((values.size, draws))
    out = np.ones((parts.first.size, draws))
    for count in np.unique(parts.count[parts.count > 0]):
        own = np.flatnonzero(parts.count == count)
        if count == 1:
            out[own] = erfc(np.abs(normal[parts.first[own]]) / np.sqrt(2))
        else:
            total = sum(normal[parts.first[own] + k] ** 2 for k in range(int(count)))
            out[own] = chdtrc(float(count), total)
    return out


def _screened(
    group: Group, layer: str, tested: _TestedShapes, own: NDArray[np.intp], worth: float
) -> Screened:
    """Put down a group by the best of its shapes ``own``; its p-value is corrected for those only."""
    if not own.size:
        return _untestable(
            group.key, group.effect, layer, "the fitted parameters take up all that it does here"
        )
    best = int(own[np.lexsort((-tested.statistic[own], tested.p_value[own]))[0]])
    coefficients, covariance = tested.one_step(best)
    return Screened(
        key=group.key,
        effect=group.effect,
        layer=layer,
        statistic=float(tested.statistic[best]),
        freedom=int(tested.parts.count[best]),
        p_marginal=corrected(float(tested.p_value[best]), worth),
        p_value=1.0,
        shape=tested.shapes[best],
        coefficients=coefficients,
        covariance=covariance,
        gain=max(tested.gain(int(number)) for number in own),
    )


def _untestable(key: str, effect: str | None, layer: str, why: str) -> Screened:
    nothing = np.zeros(0)
    return Screened(key, effect, layer, 0.0, 0, 1.0, 1.0, None, nothing, np.zeros((0, 0)), why)


@dataclass(frozen=True)
class _Excess:
    """Whether residuals are larger where more is going on: each signal against each activity."""

    screened: list[Screened]
    drawn: Array


def _excess(scores: LayerScores, draws: int, random: np.random.Generator) -> _Excess:
    """Slope of the size of residuals over what is going on, both freed of their mean within each stretch."""
    stretch, moment = (block_index(scores.run, scores.time, length) for length in (STRETCH, TOGETHER))
    activity = np.sqrt(np.maximum(scores.activity, 0.0))
    screened, drawn = [], [np.zeros((0, draws))]
    for number, signal in enumerate(scores.signals):
        counted = scores.count[:, number] >= 2
        if np.count_nonzero(counted) < LEAST_BINS:
            continue
        # the cube root of a mean square is nearly normal (Wilson and Hilferty 1931)
        size = np.cbrt(scores.power[counted, number] / scores.count[counted, number])
        weight, block = scores.count[counted, number], stretch[counted]
        doing = _within(activity[counted], weight, block)
        alive = np.flatnonzero((weight[:, None] * doing**2).sum(axis=0) > 0)
        doing = doing[:, alive] / np.sqrt((weight[:, None] * doing[:, alive] ** 2).sum(axis=0))
        size = _within(size[:, None], weight, block)
        found = _slopes(weight[:, None] * doing, doing, size, moment[counted])
        names = [scores.activities[k] for k in alive]
        screened += [_larger(scores.layer, signal, n, *each) for n, each in zip(names, found, strict=True)]
        drawn.append(_drawn_slopes((weight[:, None] * doing).T @ doing, draws, random))
    return _Excess(screened, np.vstack(drawn))


def _within(values: Array, weight: Array, block: NDArray[np.intp]) -> Array:
    """(b, c) values without their weighted mean over each block."""
    total = np.maximum(block_sums(weight, block), 1e-300)
    mean = block_sums(weight[:, None] * values, block) / total[:, None]
    return np.asarray(values - mean[block])


def _slopes(
    weighted: Array, doing: Array, size: Array, moment: NDArray[np.intp]
) -> list[tuple[float, float]]:
    """Studentised slope of ``size`` (b, 1) over each column, and its degrees of freedom.

    moment : (b,) what is taken as independent
    """
    held = np.unique(moment, return_inverse=True)[1]
    blocks = BlockScores(
        block_sums(weighted * size, held),
        block_sums(weighted * doing, held),
        np.zeros(held.max() + 1, np.intp),
    )
    error = np.sqrt((blocks.own**2).sum(axis=0))
    slope = blocks.values.sum(axis=0) / np.maximum(error, 1e-300)
    return list(zip(slope.tolist(), blocks.freedom.tolist(), strict=True))


def _larger(layer: str, signal: str, activity: str, slope: float, freedom: float) -> Screened:
    """Put down a slope; only a growing one counts."""
    key = f"{signal}: larger residuals with {activity}"
    if freedom < LEAST_FREEDOM:
        return _untestable(key, None, layer, "too few stretches in which more and less is going on")
    p_value = max(float(stats.t.sf(slope, freedom)), SMALLEST)
    statistic = max(slope, 0.0) ** 2
    return Screened(key, None, layer, statistic, 1, p_value, 1.0, None, np.zeros(0), np.zeros((0, 0)))


def _drawn_slopes(alike: Array, draws: int, random: np.random.Generator) -> Array:
    """(columns, draws) one-sided p-values of slopes under noise."""
    values, vectors = np.linalg.eigh(alike)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(stats.norm.sf(root @ random.standard_normal((values.size, draws))))
