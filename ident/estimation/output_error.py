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
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from ident.estimation.noise import AutoRegression, Linearised, NoiseModel, NoiseShape

Array = NDArray[np.float64]

MAX_ITERATIONS = 30
MAX_DAMPINGS = 12
MILD = 1e-2  # damping below which a small step means the end and not a short leash
CORRELATION_LENGTHS = 5
IDLE = 4  # small steps in a row that mean the end however short the leash
NEGLIGIBLE = 1e-5  # gain of 2 log likelihood that is no gain
CRAWL = 0.05  # gain of 2 log likelihood in half of the iterations: along a kink, and near enough its end
NOISE_ROUNDS = 6
CONVERGED = 1e-4  # step in standard deviations
RANK_TOLERANCE = 1e-10
UNKNOWN = 1e-6  # of the largest singular value: below, a direction is not known at all
BLOCK_ROWS = 256
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


@dataclass(frozen=True)
class _Reduced:
    """One record after its local columns are eliminated."""

    rows: Array
    local_triangle: Array
    local_rest: Array
    order: NDArray[np.intp]
    scale: Array
    rank: int


def _reduce(record: Linearised, shape: NoiseShape, std: float) -> _Reduced:
    """QR of the whitened record; ``rows`` are [shared | residual] free of local parameters."""
    local = record.local.shape[1]
    white = shape.whiten(record.columns(), record)
    known = np.isfinite(record.prior)
    if known.any():
        prior = np.zeros((int(known.sum()), white.shape[1]))
        weight = std / record.prior[known]
        prior[np.arange(weight.size), np.flatnonzero(known)] = weight
        prior[:, -1] = weight * record.prior_residual[known]
        white = np.vstack([white, prior])
    white = _triangle(white)
    scale = np.linalg.norm(white[:, :local], axis=0)
    scale[scale == 0] = 1.0
    q, triangle, order = qr(white[:, :local] / scale, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    rank = int((size > RANK_TOLERANCE * size.max(initial=0.0)).sum())
    basis = q[:, :rank]
    on_local = basis.T @ white[:, local:]
    rows = white[:, local:] - basis @ on_local
    return _Reduced(rows, triangle[:rank, :rank], on_local, order, scale, rank)


def _triangle(rows: Array) -> Array:
    """Upper triangle of the QR factorisation of the rows, by blocks that stay in the cache."""
    blocks = len(rows) // BLOCK_ROWS
    if blocks > 1:
        whole = blocks * BLOCK_ROWS
        heads = np.asarray(np.linalg.qr(rows[:whole].reshape(blocks, BLOCK_ROWS, -1), mode="r"))
        rows = np.vstack([heads.reshape(-1, rows.shape[1]), rows[whole:]])
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def _local_step(reduced: _Reduced, shared_step: Array) -> Array:
    """Change of the local parameters that goes with a change of the shared ones."""
    target = reduced.local_rest[:, -1] - reduced.local_rest[:, :-1] @ shared_step
    step = np.zeros(reduced.order.size)
    if reduced.rank:
        step[reduced.order[: reduced.rank]] = solve_triangular(reduced.local_triangle, target)
    return np.asarray(step / reduced.scale)


def _white_sum(records: Sequence[Linearised], shape: NoiseShape, std: float) -> float:
    """Whitened sum of squares and of the prior terms."""
    total = 0.0
    for record in records:
        white = shape.whiten(record.residual[:, None], record)[:, 0]
        known = np.isfinite(record.prior)
        prior = std / record.prior[known] * record.prior_residual[known]
        total += float(white @ white) + float(prior @ prior)
    return total


def _freedom(records: Sequence[Linearised], reduced: Sequence[_Reduced], shared: int) -> int:
    rows = sum(len(r.residual) + int(np.isfinite(r.prior).sum()) for r in records)
    return max(1, rows - shared - sum(r.rank for r in reduced))


@dataclass
class _State:
    shared: Array
    local: list[Array]
    records: list[Linearised]
    shape: NoiseShape
    std: float


def _gauss_newton(problem: Problem, state: _State) -> tuple[_State, Array, list[_Reduced], bool]:
    """Damped Gauss-Newton at a fixed noise model; the damping is Levenberg's, on the shared parameters."""
    damping, idle = 0.0, 0
    value = _white_sum(state.records, state.shape, state.std)
    halfway = value
    for number in range(MAX_ITERATIONS):
        halfway = value if number == MAX_ITERATIONS // 2 else halfway
        reduced = [_reduce(r, state.shape, state.std) for r in state.records]
        stacked = _triangle(np.vstack([r.rows for r in reduced]))
        triangle, target = stacked[: state.shared.size, :-1], stacked[: state.shared.size, -1]
        tried = None
        for _ in range(MAX_DAMPINGS):
            tried = _moved(
                problem, state, reduced, _bounded_step(problem, state.shared, triangle, target, damping)
            )
            trial = _white_sum(tried.records, state.shape, state.std)
            if trial <= value * (1 + 1e-12):
                break
            tried, damping = None, max(damping * 8, 1e-4)
        if tried is None:
            return state, triangle, reduced, damping > 1
        size = float(np.linalg.norm(triangle @ (tried.shared - state.shared)))
        gained, value, state = value - trial, trial, tried
        done = size < CONVERGED * state.std or gained < NEGLIGIBLE * state.std**2
        idle = idle + 1 if done else 0
        if done and (damping <= MILD or idle >= IDLE):
            return state, triangle, reduced, True
        damping = 0.0 if damping < 1e-6 else damping / 8
    return state, triangle, reduced, halfway - value < CRAWL * state.std**2


def _moved(problem: Problem, state: _State, reduced: Sequence[_Reduced], step: Array) -> _State:
    """Take a step of the shared parameters, and that of the local ones that goes with it."""
    local = [now + _local_step(r, step) for now, r in zip(state.local, reduced, strict=True)]
    shared = state.shared + step
    return _State(shared, local, problem.linearise(shared, local), state.shape, state.std)


def _bounded_step(problem: Problem, shared: Array, triangle: Array, target: Array, damping: float) -> Array:
    """Damped step; parameters that it would take out of the region stop at its border, the rest adapt."""
    step = _damped_solution(triangle, target, damping)
    stopped = problem.inside(shared + step) - shared
    held = stopped != step
    if held.any() and not held.all():
        rest = target - triangle[:, held] @ stopped[held]
        step[held] = stopped[held]
        step[~held] = _damped_solution(triangle[:, ~held], rest, damping)
    return problem.inside(shared + step) - shared


def _damped_solution(triangle: Array, target: Array, damping: float) -> Array:
    scale = np.linalg.norm(triangle, axis=0)
    scale[scale == 0] = 1.0
    if damping == 0.0:
        solution, *_ = np.linalg.lstsq(triangle / scale, target, rcond=RANK_TOLERANCE)
    else:
        padded = np.vstack([triangle / scale, np.sqrt(damping) * np.eye(scale.size)])
        solution, *_ = np.linalg.lstsq(padded, np.append(target, np.zeros(scale.size)), rcond=None)
    return np.asarray(solution / scale)


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
    reduced = [_reduce(record, WHITE, 1.0) for record in kept]
    rows = np.vstack([r.rows for r in reduced])
    solution = _damped_solution(rows[:, :-1], rows[:, -1], 0.0)
    left = rows[:, -1] - rows[:, :-1] @ solution
    return float(left @ left), solution


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
    start = np.asarray(shared, dtype=np.float64)
    locals_now = [np.asarray(x, dtype=np.float64) for x in local]
    state = _State(start, locals_now, problem.linearise(start, locals_now), shape, 1.0)
    state.std = _innovation_std(state, start.size)
    converged = False
    triangle = np.eye(start.size)
    reduced: list[_Reduced] = []
    for number in range(NOISE_ROUNDS):
        state, triangle, reduced, converged = _gauss_newton(problem, state)
        renewed = identify_noise(state.records, state.shape if number >= FREE_ROUNDS else None)
        settled = renewed.close_to(state.shape)
        state.shape = renewed
        std = _innovation_std(state, start.size, reduced)
        settled = settled and abs(std - state.std) < 1e-3 * std
        state.std = std
        if settled:
            break
    inverse = _inverse(triangle)
    return _fit(state, reduced, state.std**2 * inverse @ inverse.T, converged=converged)


def fit_least_squares(problem: Problem, shared: Array, local: Sequence[Array]) -> Fit:
    """Least squares, for a model that is known to be wrong: the best free-running simulation there is.

    What is left is then model error, which has no likelihood. The covariance is the sandwich of Newey and
    West (1987, doi:10.2307/1913610) with Bartlett weights over five correlation times of the residual, which
    holds under correlated residuals but not for what the model cannot do.

    Parameters are those of :func:`fit_output_error`.
    """
    start = np.asarray(shared, dtype=np.float64)
    locals_now = [np.asarray(x, dtype=np.float64) for x in local]
    state = _State(start, locals_now, problem.linearise(start, locals_now), WHITE, 1.0)
    state.std = _innovation_std(state, start.size)
    state, triangle, reduced, converged = _gauss_newton(problem, state)
    state.std = _innovation_std(state, start.size, reduced)
    inverse = _inverse(triangle)
    bread = inverse @ inverse.T
    return _fit(state, reduced, bread @ _meat(state.records) @ bread, converged=converged)


def _inverse(triangle: Array) -> Array:
    """Inverse of the triangle; a direction that it does not hold gets a huge value, and not none."""
    scale = np.linalg.norm(triangle, axis=0)
    scale[scale == 0] = 1.0
    square = np.zeros((scale.size, scale.size))
    square[: len(triangle)] = triangle / scale
    left, size, right = np.linalg.svd(square)
    size = np.maximum(size, UNKNOWN * size.max(initial=1e-300))
    return np.asarray((right.T / size) @ left.T / scale[:, None])


def _fit(state: _State, reduced: Sequence[_Reduced], covariance: Array, *, converged: bool) -> Fit:
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
        longest = min(_correlation_length(record.residual) * CORRELATION_LENGTHS, len(score) - 1)
        for lag in range(1, longest + 1):
            product = score[lag:].T @ score[:-lag]
            total += (1 - lag / (longest + 1)) * (product + product.T)
    return total


def _correlation_length(residual: Array) -> int:
    """Samples after which the autocorrelation has first fallen below 1/e."""
    centred = residual - residual.mean()
    power = np.abs(np.fft.rfft(centred, 2 * centred.size)) ** 2
    correlation = np.fft.irfft(power)[: centred.size]
    below = np.flatnonzero(correlation < correlation[0] / np.e)
    return int(below[0]) if below.size else centred.size


def _innovation_std(state: _State, shared: int, reduced: Sequence[_Reduced] | None = None) -> float:
    """Standard deviation of the innovations, freed of the parameters fitted; all locals where not reduced."""
    total = sum(float(np.square(state.shape.whiten(r.residual[:, None], r)).sum()) for r in state.records)
    rows = sum(len(r.residual) for r in state.records)
    ranks = [len(r.prior) for r in state.records] if reduced is None else [one.rank for one in reduced]
    known = sum(int(np.isfinite(r.prior).sum()) for r in state.records)
    return float(np.sqrt(total / max(1, rows - sum(ranks) + known - shared)))
