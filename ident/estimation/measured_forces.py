"""A tyre curve, and a scale, fitted to measured axle forces, with intervals valid for correlated residuals.

Forces of wheels are measured beside the motion, so they can be compared with it in two ways: through the
curve of the tyre, force = F(slip angle; parameters) + offset of the run, and directly, force = scale times
the force that the motion needs + offset of the run. Both are least squares. What is left is no white noise:
it holds what the sensors, the tyres and the model of the motion do slowly. Standard errors are therefore the
larger of two: those of the sandwich of Newey and West (1987, doi:10.2307/1913610), with Bartlett weights over
several correlation times of the residual, which are valid whatever its size does but come out too small in
few correlation times, and those of a residual of one size whose correlation decays exponentially. Intervals
are those of Student's t with as many degrees of freedom as the data hold correlation times beyond the fitted
parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import t as student

from ident.dynamics.tyres import evaluate
from ident.estimation.coordinates import Coordinate
from ident.estimation.tyre_fit import Axles, Body, axles_of, coordinates_of

Array = NDArray[np.float64]
Index = NDArray[np.intp]

LAGS = 4  # correlation times over which scores are taken as correlated
LONGEST_SHARE = 4  # of a run, at most a fourth of it
FEWEST_FREEDOM = 2.0


@dataclass(frozen=True)
class Fitted:
    """Parameters of a least squares fit.

    estimates : (k,); errors : (k,) standard errors
    freedom : correlation times in the data beyond the parameters
    offsets : (runs,) of each run; spread : standard deviation of what is left
    """

    estimates: Array
    errors: Array
    freedom: float
    offsets: Array
    spread: float

    def std(self, number: int) -> float:
        """Standard error of one parameter."""
        return float(self.errors[number])

    def half_width(self, number: int, level: float = 0.95) -> float:
        """Half the width of the interval of one parameter."""
        return self.std(number) * float(student.ppf(0.5 + level / 2, self.freedom))


def fit_scale(needed: Array, measured: Array, run: Index) -> Fitted:
    """Fit measured = scale * needed + offset of the run.

    Parameters
    ----------
    needed, measured : (n,) forces at instants of equal spacing [N]
    run : (n,) index of the run of each, those of a run one after another
    """
    design = np.column_stack([needed, _of_runs(run)])
    values: Array = np.linalg.lstsq(design, measured, rcond=None)[0].astype(np.float64)
    return _fitted(values, design, measured - design @ values, run, 1)


def fit_curve(
    kind: str | Axles,
    axle: str,
    body: Body,
    slip_angle: Array,
    measured: Array,
    run: Index,
    start: Sequence[float],
) -> Fitted:
    """Fit a kind of tyre to measured forces; the estimates are its coordinates (logarithms).

    What the forces do not tell is held by the priors of the fit to the motion.

    Parameters
    ----------
    kind : in ``TYRES``, or the tyres of both axles; axle : "front" or "rear"
    slip_angle, measured : (n,) [rad], [N], at instants of equal spacing
    run : (n,) index of the run of each
    start : one value of each parameter that is not held
    """
    axles = axles_of(kind)
    own = [one for one in coordinates_of(axles, body) if one.name.startswith(f"{axle}.")]
    offsets = _of_runs(run)
    first = np.array([one.coordinate(value) for one, value in zip(own, start, strict=True)])
    low, high = (np.array([getattr(one, end) for one in own]) for end in ("low", "high"))
    at = np.concatenate([np.clip(first, low + 1e-6, high - 1e-6), np.zeros(offsets.shape[1])])
    weight = 1.0 / float(np.std(measured))
    free = np.full(offsets.shape[1], np.inf)
    bounds = (np.concatenate([low, -free]), np.concatenate([high, free]))
    for _ in range(3):
        problem = _Curve(axles, axle, body.load(axle), own, slip_angle, measured, offsets, weight)
        at = least_squares(problem.rows, at, problem.jacobian, bounds=bounds, x_scale="jac", max_nfev=200).x
        left = measured - problem.model(at)
        weight = 1.0 / (float(np.std(left)) * np.sqrt(2 * correlation_length(left, run)))
    return _fitted(at, -problem.slopes(at), left, run, len(own), prior=problem.prior / weight)


@dataclass(frozen=True)
class _Curve:
    """Rows and derivatives of the fit of a curve; the residuals weigh ``weight`` against the priors."""

    axles: Axles
    axle: str
    load: float
    own: Sequence[Coordinate]
    slip_angle: Array
    measured: Array
    offsets: Array
    weight: float

    @property
    def prior(self) -> Array:
        """(k, k + runs) rows of the priors."""
        inverse = np.diag([1 / one.prior_std for one in self.own])
        return np.pad(inverse, ((0, 0), (0, self.offsets.shape[1])))

    def model(self, at: Array) -> Array:
        return self._force(at)[0] + self.offsets @ at[len(self.own) :]

    def rows(self, at: Array) -> Array:
        means = np.array([one.prior_mean for one in self.own])
        prior = np.diag(self.prior[:, : len(self.own)]) * (at[: len(self.own)] - means)
        return np.concatenate([(self.measured - self.model(at)) * self.weight, prior])

    def jacobian(self, at: Array) -> Array:
        return np.vstack([self.slopes(at) * self.weight, self.prior])

    def slopes(self, at: Array) -> Array:
        """(n, k + runs) derivative of the residual."""
        by_parameter = self._force(at)[1]
        slopes = np.array([one.slope(value) for one, value in zip(self.own, at, strict=False)])
        return -np.column_stack([by_parameter * slopes, self.offsets])

    def _force(self, at: Array) -> tuple[Array, Array]:
        tyre = self.axles.of(self.axle)
        named = {one.name: one.value(value) for one, value in zip(self.own, at, strict=False)}
        known = {**self.axles.held, **named}
        values = {name: known[f"{self.axle}.{name}"] for name in tyre.names}
        force, _, by_parameter = evaluate(tyre, self.slip_angle, values, self.load)
        free = [number for number, name in enumerate(tyre.names) if f"{self.axle}.{name}" in named]
        return force, by_parameter[:, free]


def correlation_length(residual: Array, run: Index) -> float:
    """Samples after which the autocorrelation has first fallen below 1/e, mean of all runs."""
    lengths, sizes = [], []
    for own in _parts(run):
        centred = residual[own] - residual[own].mean()
        power = np.abs(np.fft.rfft(centred, 2 * centred.size)) ** 2
        correlation = np.fft.irfft(power)[: centred.size]
        below = np.flatnonzero(correlation < correlation[0] / np.e)
        lengths.append(float(below[0]) if below.size else float(centred.size))
        sizes.append(centred.size)
    return max(0.5, float(np.average(lengths, weights=sizes)))


def _fitted(
    at: Array, design: Array, left: Array, run: Index, own: int, prior: Array | None = None
) -> Fitted:
    """Standard errors, the larger of both kinds; ``prior`` holds its rows in the unit of the residual."""
    length = correlation_length(left, run)
    square = design.T @ design
    held = np.zeros_like(square) if prior is None else prior.T @ prior
    bread = np.linalg.pinv(square + held)
    scale = float(np.var(left)) * 2 * length
    meats = (_long_run(design * left[:, None], run, length), _decaying(design, left, run, length))
    spreads = [np.sqrt(np.diag(bread @ (meat + scale * held) @ bread)) for meat in meats]
    freedom = max(FEWEST_FREEDOM, left.size / (2 * length) - at.size)
    errors = np.maximum(*spreads)
    return Fitted(at[:own], errors[:own], freedom, at[own:], float(np.std(left)))


def _decaying(design: Array, left: Array, run: Index, length: float) -> Array:
    """Covariance of the scores of a residual of one size whose correlation decays with ``length``."""
    decay = float(np.exp(-1 / length))
    total = np.zeros((design.shape[1], design.shape[1]))
    for part in _parts(run):
        own = design[part]
        before = lfilter([decay], [1.0, -decay], own, axis=0)  # sum over k >= 1 of decay^k of k samples ago
        product = own[1:].T @ before[:-1]
        total += own.T @ own + product + product.T
    return total * float(np.var(left))


def _long_run(scores: Array, run: Index, length: float) -> Array:
    total = np.zeros((scores.shape[1], scores.shape[1]))
    for part in _parts(run):
        own = scores[part]
        total += own.T @ own
        lags = min(int(np.ceil(LAGS * length)), len(own) // LONGEST_SHARE)
        for lag in range(1, lags + 1):
            product = own[lag:].T @ own[:-lag]
            total += (1 - lag / (lags + 1)) * (product + product.T)
    return total


def _of_runs(run: Index) -> Array:
    """(n, runs) one column for each run."""
    return np.asarray(run[:, None] == np.unique(run)[None, :], dtype=np.float64)


def _parts(run: Index) -> list[NDArray[np.bool_]]:
    return [run == one for one in np.unique(run)]
