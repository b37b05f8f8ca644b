"""What a fit can say of the actuator where its smaller lag is so short that it may not exist.

At T2 = 0 the derivatives to T2 and to the dead time are equal: the Fisher information is singular, so that
standard errors from it are arbitrary (a dead time known to 3 ms gets anything from 2 to 200 ms), and rho over
its standard error says nothing. The likelihood itself does. With rho held at r and all else fitted,

    LR(r) = 2 (log L at the best rho - log L at r)

is the profile. Where LR(0) is below FIRST_ORDER the actuator is taken for one of first order: the estimate is
the fit with T2 = 0, and its covariance is the second moment about it of the profile, weighted by
exp(-LR/2), so that the error of the dead time holds what a small T2 would take from it. The threshold is the
99 % point of chi² with one degree of freedom: LR(0) is not distributed as at a regular point, and exceeds the
95 % point in about a tenth of all sets from an actuator of first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ident.estimation.actuator_likelihood import (
    DEAD_TIME,
    RATIO,
    SHORTEST_LAG_SHARE,
    SUM,
    ActuatorProblem,
    ActuatorRecord,
)
from ident.estimation.noise import Linearised, NoiseShape
from ident.estimation.output_error import Fit, fit_output_error

Array = NDArray[np.float64]

SMALL_RATIO = 0.1  # rho below which the order is asked: T2 below 0.13 T1
FIRST_ORDER = 6.63
OUTSIDE = 9.0  # LR beyond which the profile has no weight left
FIRST_OUTWARDS = 1e-3
OUTWARDS = 2.0
NODES = 6


def settled_order(fit: Fit, records: Sequence[ActuatorRecord]) -> Fit:
    """Return the fit of first order in place of ``fit`` where the data do not exclude it.

    fit : maximum likelihood of all parameters
    records : what it was fitted to
    """
    if fit.shared[RATIO] >= SMALL_RATIO or fit.noise.std == 0:
        return fit
    first = _held(fit, records, SHORTEST_LAG_SHARE, fit.shared)
    if _likelihood_ratio(first, fit) > FIRST_ORDER:
        return fit
    nodes = [first, *_profile(fit, records, first)]
    return replace(first, covariance=_second_moment(nodes, fit))


def _held(fit: Fit, records: Sequence[ActuatorRecord], ratio: float, start: Array) -> Fit:
    """Fit with rho held, under the noise already identified."""

    def same(_records: Sequence[Linearised], _like: NoiseShape | None) -> NoiseShape:
        return fit.noise.shape

    problem = ActuatorProblem(records, runs=fit.shared.size - RATIO - 1, ratio=ratio)
    return fit_output_error(
        problem, _moved(start, ratio), fit.local, identify_noise=same, shape=fit.noise.shape
    )


def _moved(shared: Array, ratio: float) -> Array:
    """Parameters with another rho at the same T1 and L + T2, to first order: nearly the same response."""
    moved = shared.copy()
    moved[RATIO] = ratio
    moved[SUM] = shared[SUM] * (1 - shared[RATIO]) / (1 - ratio)
    moved[DEAD_TIME] += shared[RATIO] * shared[SUM] - ratio * moved[SUM]
    return moved


def _likelihood_ratio(held: Fit, fit: Fit) -> float:
    return (held.white_sum - fit.white_sum) / fit.noise.std**2


def _profile(fit: Fit, records: Sequence[ActuatorRecord], first: Fit) -> list[Fit]:
    """Fits with rho held at evenly spaced values from zero to where the profile ends."""
    ratio = max(float(fit.shared[RATIO]), FIRST_OUTWARDS)
    outer = fit
    while ratio < 0.25:
        ratio *= OUTWARDS
        outer = _held(fit, records, ratio, outer.shared)
        if _likelihood_ratio(outer, fit) > OUTSIDE:
            break
    nodes, start = [], first.shared
    for inner in np.linspace(0.0, ratio, NODES + 1)[1:-1]:
        nodes.append(_held(fit, records, float(inner), start))
        start = nodes[-1].shared
    return [*nodes, outer]


def _second_moment(nodes: Sequence[Fit], fit: Fit) -> Array:
    """(s, s) second moment of the profile about its first node, trapezoidal in rho."""
    ratios = np.array([node.shared[RATIO] for node in nodes])
    width = np.gradient(ratios)
    width[[0, -1]] /= 2
    weights = width * np.exp(-0.5 * np.array([_likelihood_ratio(node, fit) for node in nodes]))
    weights /= weights.sum()
    total = np.zeros_like(fit.covariance)
    for weight, node in zip(weights, nodes, strict=True):
        distance = node.shared - nodes[0].shared
        total += weight * (_given_ratio(node.covariance) + np.outer(distance, distance))
    return total


def _given_ratio(covariance: Array) -> Array:
    """Covariance of the other parameters where rho is known."""
    along = covariance[:, RATIO]
    variance = covariance[RATIO, RATIO]
    return covariance - np.outer(along, along) / variance if variance > 0 else covariance
