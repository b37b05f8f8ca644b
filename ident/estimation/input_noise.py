"""The inputs of the motion, smoothed, and the noise that smoothing leaves in them.

Speed and steering angle are measured, too. No truck's change faster than the local polynomials (Savitzky
and Golay 1964) that are laid through them; what is faster is noise and is taken away. What is as slow as the
truck stays, moves the model, and so stands in the residuals of all signals at once: noise that no colour of
single signals describes. It scatters the scores of those directions that the inputs move.

How much is left cannot be read off an input, where the truck's own motion hides it. The residuals tell: noise
of a kind is drawn and driven through the model; with p_k what draw k does to the whitened residuals of a
window, and r these residuals themselves, both freed of what the fit takes up,

    (p_k'r)^2 / p_k'p_k  has the mean  v_0 + sum over kinds i of v_i mean_l (p_il'p_k)^2 / p_k'p_k,

where v_0 is the variance of what is left beside and v_i that of the noise of kind i in units of the draws; so
has the mean square of r, without draws. This is linear in the variances, none of which is negative: they are
found by weighted least squares (variance components from quadratic forms, Rao 1971,
doi:10.1016/0047-259X(71)90001-7).

What a model lacks stands in all residuals at once, too, and must not be taken for noise of its inputs. Noise
has no edge where the motion ends: no kind may be larger than it would show in the band just above, which the
input itself tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.optimize import lsq_linear
from scipy.signal import lfilter, savgol_coeffs, savgol_filter

from ident.estimation.vehicle_records import MotionRecord, Windows

Array = NDArray[np.float64]

SLOW = 0.4  # [s] time constant of the slower kind of noise
ROUNDS = 6  # of weights and variances in turn
LARGEST = 12.0  # times its mean: more is the work of something that is no noise
BAND = 3.0  # times shorter a span, whose smoothing ends the band above
PART = 2.0  # [s] of which the band above has one power; the median of these counts


@dataclass(frozen=True)
class Smoothing:
    """Local polynomials of an order over a span [s]."""

    span: float
    order: int

    def weights(self, period: float) -> Array:
        """(k,) of the samples around the one that is smoothed; of that alone where nothing is."""
        count = 2 * round(self.span / period / 2) + 1
        return _weights(count, self.order) if count > self.order else np.ones(1)

    def of(self, values: Array, period: float) -> Array:
        """(n,) or (n, c) smoothed along the first axis; what is shorter than the span stays as it is."""
        count = 2 * round(self.span / period / 2) + 1
        if not self.order < count <= len(values):
            return values
        return np.asarray(savgol_filter(values, count, self.order, axis=0))


@cache
def _weights(count: int, order: int) -> Array:
    return np.asarray(savgol_coeffs(count, order))


INPUTS = {"road_wheel_angle": Smoothing(0.3, 5), "speed": Smoothing(0.5, 3)}
"""Of a steering angle of 2 Hz 99.9 % pass, and a third of the noise."""
UNSMOOTHED = Smoothing(0.0, 0)
NAMES = {"road_wheel_angle": "road_wheel_angle", "speed": "longitudinal_velocity"}


@dataclass(frozen=True)
class InputNoise:
    """One kind of noise of one input of the model, before it is smoothed.

    std : of the draws [unit of the input]; time_constant : [s], zero for white noise
    most : largest variance that it may have, in units of its draws
    """

    name: str
    std: float
    time_constant: float
    smoothing: Smoothing
    most: float = np.inf

    def correlation(self, count: int, period: float) -> Array:
        """(count,) of samples at distances of 0, 1, ... periods."""
        if self.time_constant == 0.0:
            return np.asarray(np.eye(1, count)[0])
        return np.asarray(np.exp(-np.arange(count) * period / self.time_constant))

    def drawn(self, windows: Windows, count: int, seed: int) -> Array:
        """(N, count) of what smoothing leaves, each window on its own, on the grid of all windows.

        What a window is given depends on the seed and on how the window was driven, not on its number: the
        order of the runs changes nothing.
        """
        made, kind = (
            np.zeros((windows.times.size, count)),
            crc32(f"{self.name} {self.time_constant}".encode()),
        )
        for (begin, end), record in zip(pairwise(windows.offsets.tolist()), windows.records, strict=True):
            driven = (record.times[0] * 1e3, np.mean(record.speed) * 1e4)
            random = np.random.default_rng([seed, kind, *(abs(round(float(one))) for one in driven)])
            period = float(windows.steps[begin])
            pole = np.exp(-period / self.time_constant) if self.time_constant else 0.0
            noise = random.standard_normal((end - begin, count))
            noise[1:] *= np.sqrt(1.0 - pole**2)
            noise = lfilter([self.std], [1.0, -pole], noise, axis=0)
            made[begin:end] = self.smoothing.of(noise, period)
        return made


def with_smooth_inputs(record: MotionRecord) -> MotionRecord:
    """The record with its speed and its road-wheel angle smoothed."""
    angle = INPUTS["road_wheel_angle"].of(record.road_wheel_angle, record.period)
    return replace(with_smooth_speed(record), road_wheel_angle=angle)


def with_smooth_speed(record: MotionRecord) -> MotionRecord:
    """The record with its speed smoothed, the angle as it was measured."""
    return replace(record, speed=INPUTS["speed"].of(record.speed, record.period))


def input_noise(records: Sequence[MotionRecord]) -> list[InputNoise]:
    """Kinds of noise of the inputs of records as measured; draws are as large as what was taken away."""
    made = []
    for name, smoothing in INPUTS.items():
        taken = [getattr(one, name) - smoothing.of(getattr(one, name), one.period) for one in records]
        std = float(np.sqrt(np.mean(np.concatenate(taken) ** 2)))
        if std > 0.0:
            kinds = [InputNoise(NAMES[name], std, time, smoothing) for time in (0.0, SLOW)]
            made += [
                replace(one, most=_most(one, [(getattr(r, name), r.period) for r in records]))
                for one in kinds
            ]
    return made


def _most(noise: InputNoise, measured: Sequence[tuple[Array, float]]) -> float:
    """Variance, in units of its draws, with which noise would have all the power in the band above."""
    wide = replace(noise.smoothing, span=noise.smoothing.span / BAND)
    powers, own = [], 0.0
    for values, period in measured:
        whole, inner = noise.smoothing.weights(period), wide.weights(period)
        band = np.pad(inner, (whole.size - inner.size) // 2) - whole
        own = noise.std**2 * float(band @ toeplitz(noise.correlation(band.size, period)) @ band)
        if values.size >= band.size:
            squares = np.convolve(values, band, "valid") ** 2
            parts = np.array_split(squares, max(1, round(squares.size * period / PART)))
            powers += [float(part.mean()) for part in parts]
    return float(np.median(powers)) / own if powers and own > 0.0 else np.inf


@dataclass(frozen=True)
class DrawnNoise:
    """What noise of the inputs does to the residuals.

    kind : (d,) of each draw, counted from one; rows : (n, d) of each window, whitened
    most : of each kind, the largest variance in units of its draws
    """

    kind: NDArray[np.intp]
    rows: Sequence[Array]
    most: Sequence[float] | None = None

    def variances(self, residuals: Sequence[Array]) -> Array:
        """(1 + kinds,) of what is left beside, in the residuals' unit, and of each kind in that of its draws.

        residuals : (n,) of each window, whitened
        """
        windows = [self._seen(*one) for one in zip(self.rows, residuals, strict=True)]
        seen, moments, count = (np.concatenate(parts) for parts in zip(*windows, strict=True))
        variances = np.zeros(moments.shape[1])
        variances[0] = 1.0
        bounds = (0.0, np.array([np.inf, *(self.most or [np.inf] * (variances.size - 1))]))
        for _ in range(ROUNDS):
            mean = np.maximum(moments @ variances, 1e-3)
            weight = np.sqrt(count) / mean
            target = np.minimum(seen, LARGEST * mean) * weight
            variances = lsq_linear(moments * weight[:, None], target, bounds).x
        return variances

    def _seen(self, drawn: Array, residual: Array) -> tuple[Array, Array, Array]:
        """Mean squares of a residual (1 + d,), over all samples and along each draw.

        Returns
        -------
        the mean squares; (1 + d, 1 + kinds) their means by variance; (1 + d,) squares that each is a mean of
        """
        inner = drawn.T @ drawn
        length = np.diag(inner)
        alive = np.flatnonzero(length > 1e-9 * length.max(initial=1e-300))
        beside = np.square(inner)
        np.fill_diagonal(beside, 0.0)
        others = np.maximum(self._kinds.sum(axis=1)[:, None] - self._kinds, 1)
        along = ((self._kinds @ beside / others)[:, alive] / length[alive]).T
        whole = self._kinds @ length / self._kinds.sum(axis=1) / residual.size
        moments = np.column_stack([np.ones(1 + alive.size), np.vstack([whole, along])])
        squares = np.square(drawn.T @ residual)[alive] / length[alive]
        count = np.concatenate([[residual.size], np.ones(alive.size)])
        return np.concatenate([[np.mean(residual**2)], squares]), moments, count

    @property
    def _kinds(self) -> Array:
        """(kinds, d) one where a draw is of a kind."""
        return np.asarray(np.arange(1, self.kind.max() + 1)[:, None] == self.kind, dtype=np.float64)

    def colour(self, directions: Sequence[Array], variances: Array) -> Array:
        """(c,) variance of scores along directions (n, c) of each window, over that under white residuals."""
        each_window = zip(directions, self.rows, strict=True)
        total: Array = np.sum([own.T @ drawn for own, drawn in each_window], axis=0)
        length: Array = np.sum([np.square(own).sum(axis=0) for own in directions], axis=0)
        each: Array = np.square(total) @ (self._kinds / self._kinds.sum(axis=1)[:, None]).T
        each /= np.maximum(length, 1e-300)[:, None]
        return np.asarray(np.where(length > 0, variances[0] + each @ variances[1:], 1.0))
