"""Output error by Gauss-Newton, with parameters that belong to one record eliminated record by record.

Problem: y_i = f_i(theta, lambda_i) + AR noise, theta shared by all records, lambda_i (initial state, what was
unknown before the record began, lost commands) local to one. Minimised is the whitened sum of squares,
plus the Gaussian priors of local parameters where they have one. Each record's [local | shared | residual]
is whitened and reduced by a QR factorisation, not by normal equations, which would square the condition
number: T2 and the dead time are nearly collinear, and that is exactly where accuracy is wanted. The rows
left over after the local columns carry all that the record knows of theta.

The covariance is that of the Cramér-Rao bound at the estimate: sigma² (R' R)^-1 with R the triangle of the
shared columns. It assumes that the model is right and the noise is AR(p); the noise model itself is
identified by restricted likelihood, see ``noise_fit``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ident.estimation.elimination import (
    Eliminated,
    damped_solution,
    eliminate,
    inverse_of,
    stacked,
    triangle_of,
    with_priors,
)
from ident.estimation.gauss_newton import minimise
from ident.estimation.noise import (
    AutoRegression,
    Linearised,
    NoiseModel,
    NoiseShape,
    correlation_length,
)

Array = NDArray[np.float64]

CORRELATION_LENGTHS = 5
NOISE_ROUNDS = 6
TINY = 1e-300
LOCAL_PARTS = (1.0, 0.25, 0.0)  # of a step of local parameters
FREE_ROUNDS = 2  # rounds in which the order of the noise may still change

WHITE = AutoRegression(np.zeros(0))

IdentifyNoise = Callable[[Sequence[Linearised], NoiseShape | None], NoiseShape]


class Problem(Protocol):
    """What is fitted: records that can be linearised, and the region in which theta may lie."""

    def linearise(self, shared: Array, local: Sequence[Array]) -> list[Linearised]:
        """Residuals and exact derivatives at the present parameters."""
        ...

    def inside(self, shared: Array) -> Array:
        """The nearest parameters that the model allows."""
        ...


@runtime_checkable
class LocallyCurved(Protocol):
    """A problem whose local parameters have a region of their own, and are not nearly linear in it."""

    def inside_local(self, local: Array) -> Array:
        """The nearest local parameters of a record that the model allows."""
        ...

    def linearise_at(self, number: int, shared: Array, local: Array) -> Linearised:
        """Residual and exact derivatives of one record."""
        ...


@dataclass(frozen=True)
class Fit:
    """The estimate of an output-error problem.

    shared : (s,) estimate; covariance : (s, s) of it
    local : one (l_i,) array a record
    noise : the identified noise
    residuals : one (n_i,) array a record, measured minus modelled
    white_sum : whitened sum of squares, in the unit of the residual squared
    freedom : rows less parameters
    converged : whether the last step was below CONVERGED standard deviations
    """

    shared: Array
    covariance: Array
    local: list[Array]
    noise: NoiseModel
    residuals: list[Array]
    white_sum: float
    freedom: int
    converged: bool


def _reduce(record: Linearised, shape: NoiseShape, std: float) -> Eliminated:
    """QR of the whitened record; what is left is [shared | residual] free of local parameters."""
    white = shape.whiten(record.columns(), record)
    white = with_priors(white, record.prior / max(std, TINY), record.prior_residual)
    return eliminate(triangle_of(white), record.local.shape[1])


def _white_sum(records: Sequence[Linearised], shape: NoiseShape, std: float) -> float:
    """Whitened sum of squares and of the prior terms."""
    total = 0.0
    for record in records:
        white = shape.whiten(record.residual[:, None], record)[:, 0]
        known = np.isfinite(record.prior)
        prior = std / record.prior[known] * record.prior_residual[known]
        total += float(white @ white) + float(prior @ prior)
    return total


def _freedom(records: Sequence[Linearised], reduced: Sequence[Eliminated], shared: int) -> int:
    rows = sum(len(r.residual) + int(np.isfinite(r.prior).sum()) for r in records)
    return max(1, rows - shared - sum(r.rank for r in reduced))


@dataclass(frozen=True)
class _State:
    """Present parameters, what they leave over, and the noise that it is weighed by."""

    problem: Problem
    shared: Array
    local: list[Array]
    records: list[Linearised]
    shape: NoiseShape
    std: float

    @cached_property
    def value(self) -> float:
        return _white_sum(self.records, self.shape, self.std)

    @property
    def smooth(self) -> bool:
        """See :class:`~ident.estimation.gauss_newton.Point`."""
        return all(bool(np.isfinite(record.columns()).all()) for record in self.records)

    @cached_property
    def reduced(self) -> list[Eliminated]:
        return [_reduce(record, self.shape, self.std) for record in self.records]

    def triangle(self) -> Array:
        """See :class:`~ident.estimation.gauss_newton.Point`."""
        return stacked(self.reduced)

    def moved(self, step: Array) -> _State:
        """See :class:`~ident.estimation.gauss_newton.Point`."""
        local = [now + part.step(step) for now, part in zip(self.local, self.reduced, strict=True)]
        shared = self.shared + step
        if isinstance(self.problem, LocallyCurved):
            return self._carefully_moved(self.problem, shared, local)
        records = self.problem.linearise(shared, local)
        return _State(self.problem, shared, local, records, self.shape, self.std)

    def _carefully_moved(self, problem: LocallyCurved, shared: Array, asked: Sequence[Array]) -> _State:
        """As ``moved``, with a part of the local step where the whole makes a record worse."""
        local, records = [], []
        for number, (now, whole) in enumerate(zip(self.local, asked, strict=True)):
            before = _white_sum([self.records[number]], self.shape, self.std)
            tried = []
            for part in LOCAL_PARTS:
                own = problem.inside_local(now + part * (whole - now))
                record = problem.linearise_at(number, shared, own)
                tried.append((_white_sum([record], self.shape, self.std), own, record))
                if tried[-1][0] <= before:
                    break
            _, own, record = min(tried, key=lambda one: one[0])
            local.append(own)
            records.append(record)
        return _State(self.problem, shared, local, records, self.shape, self.std)

    def inside(self, shared: Array) -> Array:
        """See :class:`~ident.estimation.gauss_newton.Point`."""
        return self.problem.inside(shared)


def _first(problem: Problem, shared: Array, local: Sequence[Array], shape: NoiseShape) -> _State:
    """State to begin with."""
    start = np.asarray(shared, dtype=np.float64)
    locals_now = [np.asarray(x, dtype=np.float64) for x in local]
    state = _State(problem, start, locals_now, problem.linearise(start, locals_now), shape, 1.0)
    return replace(state, std=_innovation_std(state))


def linear_score(records: Sequence[Linearised], columns: Sequence[int]) -> tuple[float, Array]:
    """Least squares of some shared parameters and of all local ones, white noise assumed.

    Parameters
    ----------
    records : linearised where the parameters in question enter linearly
    columns : (c,) which shared parameters

    Returns
    -------
    sum of squares that is left, (c,) change of the parameters
    """
    kept = [replace(record, shared=record.shared[:, list(columns)]) for record in records]
    rows = np.vstack([_reduce(record, WHITE, 1.0).rows for record in kept])
    solution = damped_solution(rows[:, :-1], rows[:, -1], 0.0)
    left = rows[:, -1] - rows[:, :-1] @ solution
    return float(left @ left), solution


def first_look(
    problem: Problem,
    shared: Array,
    local: Sequence[Array],
    *,
    noise: NoiseModel,
    iterations: int,
) -> tuple[float, Array, list[Array]]:
    """Some iterations under a noise that is given, to choose among starts.

    Returns
    -------
    whitened sum of squares over the variance of the noise, shared and local parameters
    """
    start = replace(_first(problem, shared, local, noise.shape), std=noise.std)
    state, _, _ = minimise(start, iterations)
    return state.value / noise.std**2, state.shared, state.local


def fit_output_error(
    problem: Problem,
    shared: Array,
    local: Sequence[Array],
    *,
    identify_noise: IdentifyNoise,
    shape: NoiseShape = WHITE,
) -> Fit:
    """Maximum likelihood of the shared and local parameters and of the noise.

    Parameters
    ----------
    problem : what is fitted
    shared : (s,) start
    local : one (l_i,) start a record
    identify_noise : gives the colour of the noise from the linearised problem, with the structure of a
        given one where it is not None, such as :func:`~ident.estimation.noise_fit.fit_autoregression`
    shape : colour to begin with

    Returns
    -------
    Fit : with ``converged`` False where the iterations ended without meeting the tolerance
    """
    state = _first(problem, shared, local, shape)
    for number in range(NOISE_ROUNDS):
        state, triangle, converged = minimise(state)
        renewed = identify_noise(state.records, state.shape if number >= FREE_ROUNDS else None)
        settled = renewed.close_to(state.shape)
        reduced = state.reduced
        std = _innovation_std(replace(state, shape=renewed), reduced)
        settled = settled and abs(std - state.std) < 1e-3 * std
        state = replace(state, shape=renewed, std=std)
        if settled:
            break
    inverse = inverse_of(triangle)
    return _fit(state, reduced, state.std**2 * inverse @ inverse.T, converged=converged)


def fit_least_squares(problem: Problem, shared: Array, local: Sequence[Array]) -> Fit:
    """Least squares, for a model that is known to be wrong: the best free-running simulation there is.

    What is left is then model error, which has no likelihood. The covariance is the sandwich of Newey and
    West (1987, doi:10.2307/1913610) with Bartlett weights over five correlation times of the residual, which
    holds under correlated residuals but not for what the model cannot do.

    Parameters are those of :func:`fit_output_error`.
    """
    state, triangle, converged = minimise(_first(problem, shared, local, WHITE))
    reduced = state.reduced
    state = replace(state, std=_innovation_std(state, reduced))
    inverse = inverse_of(triangle)
    bread = inverse @ inverse.T
    return _fit(state, reduced, bread @ _meat(state.records) @ bread, converged=converged)


def _fit(state: _State, reduced: Sequence[Eliminated], covariance: Array, *, converged: bool) -> Fit:
    return Fit(
        shared=state.shared,
        covariance=covariance,
        local=state.local,
        noise=NoiseModel(state.shape, state.std),
        residuals=[r.residual for r in state.records],
        white_sum=_white_sum(state.records, state.shape, state.std),
        freedom=_freedom(state.records, reduced, state.shared.size),
        converged=converged,
    )


def _meat(records: Sequence[Linearised]) -> Array:
    """Long-run covariance of the scores: sum over lags of J_t e_t e_(t+k) J_(t+k), local columns removed."""
    width = records[0].shared.shape[1]
    total = np.zeros((width, width))
    for record in records:
        q, _ = np.linalg.qr(record.local)
        score = (record.shared - q @ (q.T @ record.shared)) * record.residual[:, None]
        total += score.T @ score
        longest = min(correlation_length(record.residual) * CORRELATION_LENGTHS, len(score) - 1)
        for lag in range(1, longest + 1):
            product = score[lag:].T @ score[:-lag]
            total += (1 - lag / (longest + 1)) * (product + product.T)
    return total


def _innovation_std(state: _State, reduced: Sequence[Eliminated] | None = None) -> float:
    """Standard deviation of the innovations, freed of the parameters fitted; all locals where not reduced."""
    shape, records = state.shape, state.records
    total = sum(float(np.square(shape.whiten(r.residual[:, None], r)).sum()) for r in records)
    rows = sum(len(r.residual) for r in records)
    ranks = [len(r.prior) for r in records] if reduced is None else [one.rank for one in reduced]
    known = sum(int(np.isfinite(r.prior).sum()) for r in records)
    return float(np.sqrt(total / max(1, rows - sum(ranks) + known - state.shared.size)))
