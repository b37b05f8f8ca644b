"""Coloured measurement noise: its models, and the filter that turns each of them into white noise.

Two shapes:

* AR(p) on the sample index, e_k = a_1 e_{k-1} + ... + a_p e_{k-p} + w_k, for evenly spaced samples; it
  restarts at every interruption of the samples ("start"), because the index does not tell how long that was;
* the continuous-time AR(1), correlation exp(-|t| / tau), for stamps that jitter; it needs no restart.

Whitening is exact: the first samples after a start are weighted by their stationary covariance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGEST_POLE = 0.999


@dataclass(frozen=True)
class Linearised:
    """One record of an output-error problem at the present parameters.

    times : (n,) [s]
    residual : (n,) measured minus modelled
    shared : (n, s) derivative of the model to the parameters that all records share
    local : (n, l) derivative to the parameters of this record alone
    starts : (b,) indices at which the noise restarts, the first is 0
    prior : (l,) standard deviation of the prior of each local parameter, infinite where there is none
    prior_residual : (l,) prior mean minus present value
    """

    times: Array
    residual: Array
    shared: Array
    local: Array
    starts: NDArray[np.intp]
    prior: Array
    prior_residual: Array

    def columns(self) -> Array:
        """(n, l + s + 1) local, shared and residual side by side."""
        return np.column_stack([self.local, self.shared, self.residual])

    def blocks(self) -> list[tuple[int, int]]:
        """(begin, end) of each uninterrupted stretch of samples."""
        return list(zip(self.starts.tolist(), [*self.starts[1:].tolist(), len(self.residual)], strict=True))


class NoiseShape(Protocol):
    """The colour of the noise, without its size."""

    def whiten(self, columns: Array, record: Linearised) -> Array:
        """(n, m) columns, filtered so that the noise in their rows is white, of the innovations' size."""
        ...

    def total_over_innovations(self) -> float:
        """Standard deviation of the noise over that of its innovations, at least one [-]."""
        ...

    def lasts(self, period: float) -> float:
        """Time [s] after which the noise of samples so far apart has decayed to 1/e, zero if it is white."""
        ...

    def close_to(self, other: NoiseShape) -> bool:
        """Whether the two differ by less than matters to a fit."""
        ...


@numba.njit(
    "void(float64[:, ::1], int64[::1], float64[::1], float64[:, ::1], float64[:, ::1])",
    cache=True,
    error_model="numpy",
)
def _filter(
    columns: Array, starts: NDArray[np.int64], coefficients: Array, initial: Array, white: Array
) -> None:
    """AR filter that restarts; the first samples are whitened by ``initial``, the inverse of their factor."""
    order = coefficients.size
    rows, width = columns.shape
    block = 0
    begin = 0
    for k in range(rows):
        if block + 1 < starts.size and k == starts[block + 1]:
            block += 1
            begin = k
        head = k - begin
        for j in range(width):
            value = 0.0
            if head < order:
                for i in range(head + 1):
                    value += initial[head, i] * columns[begin + i, j]
            else:
                value = columns[k, j]
                for i in range(order):
                    value -= coefficients[i] * columns[k - 1 - i, j]
            white[k, j] = value


@dataclass(frozen=True)
class AutoRegression:
    """AR(p) noise on the sample index; ``coefficients`` (p,) a_1 ... a_p, none for white noise."""

    coefficients: Array

    def whiten(self, columns: Array, record: Linearised) -> Array:
        """See :class:`NoiseShape`."""
        order = self.coefficients.size
        if order == 0:
            return columns
        white = np.empty_like(columns, order="C")
        _filter(np.ascontiguousarray(columns), record.starts, self.coefficients, self._initial_inverse, white)
        return white

    @cached_property
    def _initial_inverse(self) -> Array:
        """Inverse factor of the covariance of the first samples, in the order of time.

        Row k predicts a sample from the k before it and divides what is left by its size. The predictors of
        lower order follow from the whole one by the recursion of Levinson and Durbin, taken backwards, which
        stays exact where poles crowd at the border and the covariance cannot be inverted.
        """
        order = self.coefficients.size
        made, own, variance = np.zeros((order, order)), self.coefficients, 1.0
        for k in range(order - 1, -1, -1):
            last = own[k]
            own = (own[:k] + last * own[:k][::-1]) / (1.0 - last**2)
            variance /= 1.0 - last**2
            made[k, :k] = -own[::-1] / np.sqrt(variance)
            made[k, k] = 1.0 / np.sqrt(variance)
        return made

    def total_over_innovations(self) -> float:
        """See :class:`NoiseShape`."""
        return float(1.0 / self._initial_inverse[0, 0]) if self.coefficients.size else 1.0

    def close_to(self, other: NoiseShape) -> bool:
        """See :class:`NoiseShape`."""
        if not isinstance(other, AutoRegression) or other.coefficients.size != self.coefficients.size:
            return False
        return bool(np.abs(other.coefficients - self.coefficients).max(initial=0.0) < 1e-3)

    def log_determinant(self) -> float:
        """Of the covariance of the first p samples, innovations of variance one."""
        return -2.0 * float(np.log(np.diag(self._initial_inverse)).sum())

    def largest_pole(self) -> float:
        """Radius of the outermost pole; the noise is stationary below one."""
        if self.coefficients.size == 0:
            return 0.0
        return float(np.abs(np.roots(np.concatenate([[1.0], -self.coefficients]))).max())

    def made_stationary(self) -> AutoRegression:
        """The same with its poles drawn inside LARGEST_POLE where they are not."""
        radius = self.largest_pole()
        if radius < LARGEST_POLE:
            return self
        factor = (LARGEST_POLE - 1e-3) / radius
        return AutoRegression(self.coefficients * factor ** np.arange(1, self.coefficients.size + 1))

    def correlation_samples(self) -> float:
        """Samples after which the slowest pole has decayed to 1/e; zero for white noise."""
        radius = self.largest_pole()
        return float(-1.0 / np.log(radius)) if radius > 0 else 0.0

    def lasts(self, period: float) -> float:
        """See :class:`NoiseShape`; that of the slowest pole."""
        return self.correlation_samples() * period


@dataclass(frozen=True)
class ContinuousAr1:
    """Noise with correlation exp(-|t| / tau); "innovations" are scaled to its own standard deviation.

    correlation_time : tau [s]
    """

    correlation_time: float

    def of_neighbours(self, record: Linearised) -> Array:
        """(n - 1,) correlation of successive samples."""
        return np.asarray(np.exp(-np.diff(record.times) / self.correlation_time))

    def whiten(self, columns: Array, record: Linearised) -> Array:
        """See :class:`NoiseShape`."""
        correlation = self.of_neighbours(record)
        white = columns.copy()
        white[1:] -= correlation[:, None] * columns[:-1]
        white[1:] /= np.sqrt(1 - correlation**2)[:, None]
        return white

    def total_over_innovations(self) -> float:
        """See :class:`NoiseShape`; one by the scaling of this class."""
        return 1.0

    def lasts(self, period: float) -> float:
        """See :class:`NoiseShape`."""
        del period
        return self.correlation_time

    def close_to(self, other: NoiseShape) -> bool:
        """See :class:`NoiseShape`."""
        if not isinstance(other, ContinuousAr1):
            return False
        return abs(other.correlation_time - self.correlation_time) < 1e-3 * self.correlation_time


@dataclass(frozen=True)
class NoiseModel:
    """A shape and ``std``, the standard deviation of the innovations in the unit of the residual."""

    shape: NoiseShape
    std: float

    @property
    def total_std(self) -> float:
        """Standard deviation of the noise itself, in the unit of the residual."""
        return self.std * self.shape.total_over_innovations()


def correlation_length(residual: Array) -> int:
    """Samples after which the autocorrelation has first fallen below 1/e."""
    centred = residual - residual.mean()
    power = np.abs(np.fft.rfft(centred, 2 * centred.size)) ** 2
    correlation = np.fft.irfft(power)[: centred.size]
    below = np.flatnonzero(correlation < correlation[0] / np.e)
    return int(below[0]) if below.size else centred.size
