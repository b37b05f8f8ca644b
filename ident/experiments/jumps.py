"""Jumps of a localization that no vehicle can do, and samples that stand alone.

Between two samples the heading must turn by the integral of the yaw rate and the position must move by that
of the velocity. What is left over of a step, less its running median (a late or wrongly scaled rate leaves
something over everywhere), is compared with that of all steps (8 robust standard deviations) and a floor. A
jump and its way back within a few samples is an outlier: those samples go. A jump that stays is a correction
of the estimator: nothing is continuous across it, a window ends there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ident.signals.signal import Signal

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROBUST = 1.4826
SIGMAS = 8.0
HEADING_FLOOR, POSITION_FLOOR = 0.01, 0.1  # [rad], [m]
SPIKE_SAMPLES = 5
MEDIAN_SAMPLES = 9
AROUND_SAMPLES = 25


@dataclass(frozen=True)
class Jumps:
    """What is wrong with the samples (n,) of a signal.

    outlier : (n,) which samples stand alone
    cuts : (m, 2) from the last sample before a jump to the first after it [s]
    largest : size of the largest jump, in the unit of the signal; at : when [s]
    """

    outlier: Mask
    cuts: Array
    largest: float = 0.0
    at: float = 0.0

    def times(self, samples: Array) -> Array:
        """When something is wrong (k,) [s], rising; ``samples`` (n,) are the stamps of the signal."""
        return np.sort(np.concatenate([self.cuts.ravel(), samples[self.outlier]]))


def heading_jumps(heading: Signal, moving: Mask, yaw_rate: Array | None) -> Jumps:
    """Find jumps of a heading.

    Parameters
    ----------
    moving : (n,) whether the vehicle moves, at the samples
    yaw_rate : (n,) at the samples [rad/s], NaN where unknown; None: the median of the heading's own rate
    """
    step = np.diff(heading.values)
    expected = _expected(heading.time, step, yaw_rate)
    return _jumps(heading.time, (step - expected)[:, None], moving, HEADING_FLOOR)


def position_jumps(x: Signal, y: Array, moving: Mask, velocity: tuple[Array, Array] | None) -> Jumps:
    """Find jumps of a position.

    Parameters
    ----------
    x, y : (n,) samples with the same stamps [m]
    moving : (n,) whether the vehicle moves, at the samples
    velocity : (n,) along x and y at the samples [m/s], NaN where unknown; None: the median of its own
    """
    steps = [np.diff(x.values), np.diff(y)]
    known = (None, None) if velocity is None else velocity
    rest = [step - _expected(x.time, step, rate) for step, rate in zip(steps, known, strict=True)]
    return _jumps(x.time, np.column_stack(rest), moving, POSITION_FLOOR)


def _expected(time: Array, step: Array, rate: Array | None) -> Array:
    """Step (n - 1,) between the samples that the rate of change explains."""
    own = median_filter(step / np.diff(time), MEDIAN_SAMPLES, mode="nearest") if len(step) else step
    between = own if rate is None else (rate[1:] + rate[:-1]) / 2
    return np.asarray(np.where(np.isfinite(between), between, own) * np.diff(time))


def _jumps(time: Array, rest: Array, moving: Mask, floor: float) -> Jumps:
    """Jumps among the unexplained steps ``rest`` (n - 1, d)."""
    outlier = np.zeros(len(time), dtype=np.bool_)
    considered = moving[1:] & moving[:-1]
    if not considered.any():
        return Jumps(outlier, np.empty((0, 2)))
    centred = rest - median_filter(rest, (AROUND_SAMPLES, 1), mode="nearest")
    size = np.linalg.norm(centred, axis=1)
    limit = max(SIGMAS * ROBUST * float(np.median(size[considered])), floor)
    found = np.flatnonzero((size > limit) & considered)
    stays = _without_spikes(found, centred, limit, outlier)
    cuts = np.column_stack([time[stays], time[stays + 1]]) if len(stays) else np.empty((0, 2))
    if not len(stays):
        return Jumps(outlier, cuts)
    worst = stays[int(np.argmax(size[stays]))]
    return Jumps(outlier, cuts, float(size[worst]), float(time[worst]))


def _without_spikes(found: NDArray[np.intp], rest: Array, limit: float, outlier: Mask) -> NDArray[np.intp]:
    """Take pairs of jumps that go there and back out of ``found``; mark the samples between as outliers."""
    stays, i = [], 0
    while i < len(found):
        back = _way_back(found, i, rest, limit)
        if back is None:
            stays.append(found[i])
            i += 1
        else:
            outlier[found[i] + 1 : found[back] + 1] = True
            i = back + 1
    return np.asarray(stays, dtype=np.intp)


def _way_back(found: NDArray[np.intp], i: int, rest: Array, limit: float) -> int | None:
    for k in range(i + 1, len(found)):
        if found[k] - found[i] > SPIKE_SAMPLES:
            return None
        if np.linalg.norm(rest[found[i : k + 1]].sum(axis=0)) < limit:
            return k
    return None
