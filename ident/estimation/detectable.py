"""The smallest size of each effect that the gate would find, and how alike two effects look in these data."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import brentq

from ident.estimation.layer import Group, LayerScores, Shape
from ident.estimation.residual_tests import LayerScreen, Screen, needed

Array = NDArray[np.float64]

POWER = 0.85


def detectable_sizes(
    screened: Screen, held: Mapping[str, str] | None = None, *, power: float = POWER
) -> dict[tuple[str, str], float]:
    """Size of every effect at which the joint test rejects with this power.

    Parameters
    ----------
    held : key -> name of the parameter that is the size of an effect. Where shapes hold it (the width of a
        play),
        the size is where the strength of the shapes, which grows with it in its own way, reaches what is
        needed; elsewhere the effect grows with its size, and of several shapes the middle one is told

    Returns
    -------
    (layer, key) -> size in the unit of the effect; infinite where these data cannot show it
    """
    found = {}
    for layer in screened.layers:
        for number, group in enumerate(layer.scores.groups):
            if group.effect is not None:
                name = (held or {}).get(group.key)
                found[layer.scores.layer, group.key] = _of_group(screened, layer, number, name, power)
    return found


def _of_group(screened: Screen, layer: LayerScreen, number: int, held: str | None, power: float) -> float:
    alone = needed(needed(screened.level, screened.worth), float(layer.worth[number]))
    own = np.flatnonzero(layer.group == number)
    sizes, margin = [], []
    for place in own:
        shape = layer.shapes[place]
        count = int(layer.parts.count[place])
        if not count:
            continue
        parts = slice(int(layer.parts.first[place]), int(layer.parts.first[place]) + count)
        freedom = float(count / np.sum(1.0 / layer.spread.freedom[parts]))
        unit = np.sqrt(_strength(layer, shape, parts))
        if unit > 0:
            wanted = np.sqrt(_noncentrality(alone, count, freedom, power))
            own_size = None if held is None else shape.at.get(held)
            sizes.append(abs(shape.size) * wanted / unit if own_size is None else own_size)
            margin.append(np.nan if own_size is None else unit * abs(own_size / shape.size) / wanted)
    if not sizes:
        return float("inf")
    if np.isfinite(margin).all():
        return _reached(np.array(sizes), np.array(margin))
    return float(np.median(sizes))


def _strength(layer: LayerScreen, shape: Shape, parts: slice) -> float:
    """Sum of squared studentised scores that one unit of the first column would give."""
    mixing = layer.parts.mixing[:, parts]
    scores = mixing.T @ layer.scores.gram[:, shape.columns[0]]
    return float(np.sum(scores**2 / layer.spread.factor[parts]))


def _noncentrality(p_value: float, count: int, freedom: float, power: float) -> float:
    """Of a score of ``count`` directions that passes ``p_value`` with this power."""
    threshold = float(stats.f.isf(p_value, count, freedom))

    def missing(root: float) -> float:
        return float(stats.ncf.sf(threshold, count, freedom, root**2)) - power

    high = np.sqrt(threshold * count) + 3.0
    while missing(high) < 0 and high < 1e4:
        high *= 1.5
    return float(brentq(missing, 0.1, high) ** 2) if missing(high) > 0 else float("inf")


def _reached(sizes: Array, margin: Array) -> float:
    """Size at which ``margin``, strength over what is needed, is one."""
    order = np.argsort(sizes)
    x, y = np.log(sizes[order]), np.log(np.maximum(margin[order], 1e-300))
    if (y < 0).all():
        return float("inf")
    growing = y[-1] >= y[0]
    if not growing:
        x, y = x[::-1], y[::-1]
    first = int(np.argmax(y >= 0))
    if first == 0:  # the smallest that was tried is seen: below it strength goes as size
        return float(np.exp(x[0] - y[0])) if growing else float(np.exp(x[0]))
    share = -y[first - 1] / (y[first] - y[first - 1])
    return float(np.exp(x[first - 1] + share * (x[first] - x[first - 1])))


def _group(scores: LayerScores, key: str) -> Group:
    for group in scores.groups:
        if group.key == key:
            return group
    raise KeyError(key)


def _best(scores: LayerScores, group: Group) -> tuple[list[int], Array] | None:
    """Columns and one-step coefficients of the shape that gains most."""
    total = scores.scores.sum(axis=0)
    found, most = None, 0.0
    for shape in group.shapes:
        columns = list(shape.columns)
        inner = scores.gram[np.ix_(columns, columns)]
        weights = np.linalg.pinv(inner, rcond=1e-8, hermitian=True) @ total[columns]
        gain = float(weights @ total[columns])
        if gain > most:
            found, most = (columns, weights), gain
    return found
