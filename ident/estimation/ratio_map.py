"""The map from steering-wheel angle to road-wheel angle, as a monotone table.

The road-wheel angle is a piecewise-linear function of the steering-wheel angle that never falls: an offset
and increments between knots that are at least zero (bounded least squares). Knots are evenly spaced over the
range that was driven; their number is the one of the smallest Bayesian information criterion, beginning with
two, a constant ratio, so that a straight map stays straight.

Where no road-wheel angle was measured it follows from the kinematics at low speed, where the tyres hardly
slip (2.2): delta = atan(L r / v) with L the wheelbase, r the yaw rate and v the speed. What they do slip is
in it: at 5 m/s a truck that understeers by 0.005 rad s²/m seems to have a ratio larger by 2 to 3 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from ident.errors import NotIdentifiable

Array = NDArray[np.float64]

KNOTS = (2, 3, 5, 7, 9, 13)
SMALLEST_RANGE = 0.2  # [rad] of the steering wheel
SLOWEST, FASTEST = 1.0, 6.0  # [m/s]
LARGEST_ACCELERATION = 1.0  # [m/s²]
FEWEST = 200
CORRELATED = 20  # samples that count as one: neighbours share their errors


def fit_ratio_map(wheel: Array, road: Array, weight: Array | None = None) -> list[tuple[float, float]]:
    """Fit the monotone table.

    Parameters
    ----------
    wheel : (n,) steering-wheel angle [rad]
    road : (n,) road-wheel angle at the same times [rad]
    weight : (n,) inverse standard deviations of ``road`` [1/rad]; equal where None

    Returns
    -------
    [(steering wheel, road wheel), ...] [rad], rising

    Raises
    ------
    NotIdentifiable
        If there are fewer than FEWEST samples or the wheel turns by less than SMALLEST_RANGE.
    """
    if wheel.size < FEWEST or np.ptp(wheel) < SMALLEST_RANGE:
        turned = float(np.ptp(wheel)) if wheel.size else 0.0
        raise NotIdentifiable(
            f"{wheel.size} samples over {turned:.2f} rad of the steering wheel, need {FEWEST} over "
            f"{SMALLEST_RANGE} rad: drive slow circles to both sides"
        )
    if float(np.sum((wheel - wheel.mean()) * (road - road.mean()))) < 0:
        raise NotIdentifiable("the road wheel turns against the steering wheel: one has the wrong sign")
    scale = np.ones_like(wheel) if weight is None else weight
    low, high = np.quantile(wheel, [0.002, 0.998])
    independent = wheel.size / CORRELATED
    tables = [_table(wheel, road, scale, np.linspace(low, high, count)) for count in KNOTS]
    criteria = [
        independent * np.log(max(left, 1e-300)) + len(table) * np.log(independent) for table, left in tables
    ]
    return tables[int(np.argmin(criteria))][0]


def _table(wheel: Array, road: Array, scale: Array, knots: Array) -> tuple[list[tuple[float, float]], float]:
    """Table on given knots, extended by its end slopes, and the weighted mean square that is left."""
    basis = np.column_stack([np.ones_like(wheel), *_ramps(wheel, knots)])
    lower = np.concatenate([[-np.inf], np.zeros(knots.size - 1)])
    solution = lsq_linear(basis * scale[:, None], road * scale, bounds=(lower, np.inf)).x
    left = float(np.mean(np.square((road - basis @ solution) * scale)))
    heights = np.cumsum(solution)
    return [(float(a), float(b)) for a, b in zip(knots, heights, strict=True)], left


def _ramps(wheel: Array, knots: Array) -> Sequence[Array]:
    """For each interval how far it is passed, from 0 to 1; the outer ones go on beyond their ends."""
    ramps = []
    for i, (low, high) in enumerate(pairwise(knots)):
        share = (wheel - low) / (high - low)
        floor = -np.inf if i == 0 else 0.0
        ceiling = np.inf if i == knots.size - 2 else 1.0
        ramps.append(np.clip(share, floor, ceiling))
    return ramps


def kinematic_road_angle(speed: Array, yaw_rate: Array, wheelbase: float) -> tuple[Array, Array]:
    """Road-wheel angle from the motion at low speed, and where it can be taken.

    Parameters
    ----------
    speed : (n,) at the rear axle [m/s]; yaw_rate : (n,) [rad/s]; wheelbase : L [m]

    Returns
    -------
    (n,) angle [rad], NaN where the vehicle is too slow, too fast or turns too hard; (n,) weight, proportional
    to the speed: an error of the yaw rate counts less the faster the vehicle is [m/s]
    """
    usable = (speed > SLOWEST) & (speed < FASTEST) & (np.abs(speed * yaw_rate) < LARGEST_ACCELERATION)
    safe = np.where(usable, speed, 1.0)
    angle = np.where(usable, np.arctan(wheelbase * yaw_rate / safe), np.nan)
    return angle, np.where(usable, speed, 0.0)
