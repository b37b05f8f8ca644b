"""Maximum likelihood of a vehicle model on windows of measured motion, with the noise identified.

The noise of each signal is AR(p) by restricted likelihood (:mod:`ident.estimation.noise_fit`), its
correlation time held below ``signal_noise.LONGEST_NOISE``: what is correlated for longer is no noise of a
sensor but what the model lacks, and a noise model that took it up would make the fit follow the fast part of
the signals alone.

The covariance is that of the Cramér-Rao bound where the whitened residuals are white over long times too,
wider by one factor where the scores scatter more than that. Where they are not, the model is wrong, and a
likelihood that takes its errors for noise follows the fast part of the signals, which says little. Then the
fit is least squares, each signal weighed by the size of what is left of it: the best simulation over windows
that the model can give. Its covariance is the sandwich of Newey and West (1987, doi:10.2307/1913610): the
scores of the shared parameters, gathered in bins of time over all signals, with Bartlett weights over several
seconds (:mod:`ident.estimation.vehicle_covariance`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ident.estimation.coordinates import Coordinate
from ident.estimation.elimination import eliminate, inverse_of, triangle_of
from ident.estimation.gauss_newton import minimise
from ident.estimation.noise import AutoRegression, Linearised, NoiseModel, correlation_length
from ident.estimation.signal_noise import QUIET, TINY, identify_noise
from ident.estimation.vehicle_covariance import InputScores, sandwich, told_directions, widened
from ident.estimation.vehicle_point import VehiclePoint, white_noise
from ident.estimation.vehicle_problem import (
    ALONG,
    STEERING_RATIO,
    Residuals,
    VehicleProblem,
)
from ident.estimation.vehicle_records import SignalSamples

Array = NDArray[np.float64]

NOISE_ROUNDS = 5
FREE_ROUNDS = 2  # rounds in which the order of the noise may still change
FIRST_LOOK = 3  # iterations from each start before the best is followed
BLOCK = 1.0  # [s] over which whitened residuals are summed to see slow colour
CERTAIN = 1e-4  # p-value of that sum below which the colour is there
LEAST_SHARE = 1e-3  # of the information on a direction, that a run must have for it to be compared
INFORMATIVE = 0.05
SETTLED = 1e-3
SAME_WEIGHTS = 0.02
NEGLIGIBLE = 1e-2  # gain of 2 log likelihood that is no gain: a tenth of a standard deviation

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class VehicleFit:
    """The estimate.

    point : the last linearisation, with parameters, residuals and noise
    covariance : (s, s) of the coordinates
    information : (s, s) inverse of the Cramér-Rao bound of the coordinates
    coloured : compared signal -> p-value of the hypothesis that its whitened residual is white over BLOCK
    capped : signals whose noise would have been correlated for longer than LONGEST_NOISE
    log_likelihood : of the residuals of the maximum likelihood, the noise as identified
    converged : whether the last iterations met their tolerance
    by_inputs : what noise of the inputs adds to the scores, where that is known
    """

    point: VehiclePoint
    covariance: Array
    information: Array
    coloured: Mapping[str, float]
    capped: frozenset[str]
    log_likelihood: float
    converged: bool
    by_inputs: InputScores | None = None

    @property
    def shared(self) -> Array:
        """(s,) coordinates."""
        return self.point.shared

    @property
    def slow(self) -> list[str]:
        """Signals in which something slower than noise is left."""
        return sorted({*self.capped, *(name for name, p in self.coloured.items() if p < CERTAIN)})

    @property
    def is_coloured(self) -> bool:
        """Whether something is left that the model lacks.

        The position along the path does not count: the noise of the speed, an input, adds up in it.
        """
        return any(name != ALONG for name in self.slow)

    def rms(self) -> dict[str, float]:
        """Root mean square of what is left of each compared signal."""
        residuals = self.point.residuals
        return {name: float(np.sqrt(np.mean(one.residual**2))) for name, one in residuals.items()}

    def independent_samples(self) -> dict[str, float]:
        """How many correlation times of its residual each compared signal holds."""
        made = {}
        for name, one in self.point.residuals.items():
            samples = one.samples
            lengths = [
                correlation_length(one.residual[begin:end])
                for begin, end in pairwise(samples.begins.tolist())
                if end - begin > 1
            ]
            made[name] = one.residual.size / max(1.0, 2 * float(np.mean(lengths)))
        return made


@np.errstate(over="ignore", invalid="ignore")
def fit_vehicle(
    problem: VehicleProblem,
    starts: Sequence[Array],
    *,
    floor: Mapping[str, float] | None = None,
    noise: Mapping[str, NoiseModel] | None = None,
) -> VehicleFit:
    """Fit a vehicle model.

    Parameters
    ----------
    problem : the model and the windows
    starts : (s,) coordinates to begin with; the best after a few iterations is followed
    floor : compared signal -> least standard deviation of its noise, such as resolution / sqrt 12
    noise : of every compared signal, where it is given and not identified

    Raises
    ------
    ValueError
        If the model blows up from every start.
    """
    point = _best(problem, starts, noise)
    capped: frozenset[str] = frozenset()
    converged = False
    for number in range(NOISE_ROUNDS):
        point, _, converged = minimise(point, negligible=NEGLIGIBLE)
        if noise is not None:
            break
        renewed, capped = identify_noise(point, floor or {}, keep_order=number >= FREE_ROUNDS)
        settled = all(_alike(renewed[name], point.noise[name]) for name in renewed)
        point = point.with_noise(renewed)
        if settled:
            break
    fit = fit_at(point, capped, converged=converged)
    return least_squares(fit, floor or {}) if fit.is_coloured and noise is None else fit


def least_squares(fit: VehicleFit, floor: Mapping[str, float]) -> VehicleFit:
    """Go on from the maximum likelihood to the least squares, weighed by the size of what is left.

    floor : compared signal -> least standard deviation of its noise

    Samples within a correlation time of the residual count as one, so that priors keep their weight.
    """
    point, converged = fit.point, False
    counted = fit.independent_samples()
    for _ in range(NOISE_ROUNDS):
        noise = {
            name: white_noise(_size(one, floor.get(name, 0.0)) * np.sqrt(one.residual.size / counted[name]))
            for name, one in point.residuals.items()
        }
        settled = all(abs(noise[name].std / point.noise[name].std - 1) < SAME_WEIGHTS for name in noise)
        if settled and converged:
            break
        point, _, converged = minimise(point.with_noise(noise), negligible=NEGLIGIBLE)
    made = fit_at(point, fit.capped, converged=converged)
    return replace(
        made,
        covariance=sandwich(point, made.information),
        coloured=fit.coloured,
        log_likelihood=fit.log_likelihood,
    )


def _size(one: Residuals, least: float) -> float:
    """Root mean square of a residual, kept from zero."""
    nothing = QUIET * float(np.abs(one.samples.values).max(initial=0.0))
    return max(float(np.sqrt(np.mean(one.residual**2))), least, nothing, TINY)


def _best(
    problem: VehicleProblem, starts: Sequence[Array], noise: Mapping[str, NoiseModel] | None
) -> VehiclePoint:
    """Follow every start for a few iterations and return the best."""
    points = [rough_point(problem, start, noise) for start in starts]
    points = [point for point in points if np.isfinite(point.value) and point.smooth]
    if not points:
        raise ValueError("the model blows up from every start")
    if len(points) == 1:
        return points[0]
    common = {name: points[0].noise[name] for name in points[0].noise}
    looked = [minimise(point.with_noise(common), FIRST_LOOK)[0] for point in points]
    best = min(looked, key=lambda point: point.value)
    return best if noise is not None else best.with_noise(_rough_noise(best))


def rough_point(
    problem: VehicleProblem, start: Array, noise: Mapping[str, NoiseModel] | None = None
) -> VehiclePoint:
    """The problem at given coordinates (s,), weighed by the size of what is left there unless by a noise."""
    of_runs = np.zeros((problem.windows.runs, len(problem.run_terms)))
    point = VehiclePoint(problem, problem.inside(start), of_runs, problem.initial_local, {})
    return point.with_noise(noise or _rough_noise(point))


def _rough_noise(point: VehiclePoint) -> dict[str, NoiseModel]:
    """White noise of the size of the residual, each window's initial state apart."""
    made = {}
    for name, one in point.residuals.items():
        left = [eliminate(_rows(part), part.local.shape[1]).rows[:, -1] for part in point.linearised(name)]
        size = float(np.sqrt(np.mean(np.concatenate(left) ** 2)))
        made[name] = white_noise(max(size, QUIET * float(np.abs(one.samples.values).max()), TINY))
    return made


def _rows(part: Linearised) -> Array:
    return np.column_stack([part.local, part.residual])


def _alike(one: NoiseModel, other: NoiseModel) -> bool:
    return one.shape.close_to(other.shape) and abs(one.std - other.std) < SETTLED * other.std


def fit_at(point: VehiclePoint, capped: frozenset[str], *, converged: bool) -> VehicleFit:
    """A point as a fit, with its covariance; ``capped`` as :func:`identify_noise` gives it."""
    triangle = point.triangle()[: point.shared.size, :-1]
    inverse = inverse_of(triangle)
    bread = inverse @ inverse.T
    coloured = {name: _slow_colour(point, name) for name in point.residuals}
    fit = VehicleFit(
        point=point,
        covariance=bread,
        information=triangle.T @ triangle,
        coloured=coloured,
        capped=capped,
        log_likelihood=_log_likelihood(point),
        converged=converged,
    )
    if fit.is_coloured:
        return replace(fit, covariance=sandwich(point, fit.information))
    return replace(fit, covariance=widened(point, fit.information))


def least_white(point: VehiclePoint) -> float:
    """Least p-value of the sums of whitened residuals over blocks of time, of any signal.

    But for the position along the path, in which the noise of the speed adds up.
    """
    return min((_slow_colour(point, name) for name in point.residuals if name != ALONG), default=1.0)


def _slow_colour(point: VehiclePoint, name: str) -> float:
    """p-value of the sums of a whitened residual over blocks of time, were it white."""
    total = block_sums(point.white[name][:, -1:], point.residuals[name].samples)
    return float(chi2.sf(np.sum(total**2), max(1, total.size))) if total.size else 1.0


def block_sums(white: Array, samples: SignalSamples) -> Array:
    """(m, c) sums of whitened columns (n, c) over blocks of time, of unit variance where they are white."""
    length, sums = max(2, round(BLOCK / samples.period)), []
    for begin, end in pairwise(samples.begins.tolist()):
        count = (end - begin) // length
        blocks = white[begin : begin + count * length].reshape(count, length, white.shape[1])
        sums.append(blocks.sum(axis=1) / np.sqrt(length))
    return np.concatenate(sums)


def _log_likelihood(point: VehiclePoint) -> float:
    total = 0.0
    for name, white in point.white.items():
        noise, samples = point.noise[name], point.residuals[name].samples
        residual = white[:, -1]
        total -= 0.5 * float(residual @ residual)
        total -= residual.size * float(np.log(noise.std) + 0.5 * np.log(2 * np.pi))
        if isinstance(noise.shape, AutoRegression):
            total -= 0.5 * samples.starts.size * noise.shape.log_determinant()
    return total


@dataclass(frozen=True)
class RunAgreement:
    """How a run agrees with the parameters of all runs together.

    p : p-value of the hypothesis that it has the same
    shift : (s,) by how much it alone would move the coordinates, in the directions that the data tell
    std : (s,) standard error of that
    """

    p: float
    shift: Array
    std: Array


def run_agreement(fit: VehicleFit) -> list[RunAgreement]:
    """Test each run's score at the common estimate, in the directions that data tell and not the prior."""
    parts = [(run.rows[:, :-1], run.rows[:, -1]) for run in fit.point.by_run]
    if len(parts) < 2:
        return [RunAgreement(1.0, np.zeros(fit.shared.size), np.zeros(fit.shared.size)) for _ in parts]
    told = np.sum([jacobian.T @ jacobian for jacobian, _ in parts], axis=0)
    spread = np.linalg.inv(fit.information)
    basis = told_directions(told, fit.information)
    wider = inflation(fit)
    made = []
    for jacobian, residual in parts:
        own = jacobian.T @ jacobian
        moved = own @ spread
        covariance = own - moved @ own - own @ moved.T + moved @ told @ moved.T
        score = basis.T @ jacobian.T @ residual
        p = _quadratic_p(score, basis.T @ covariance @ basis, wider)
        alone = basis @ np.linalg.pinv(basis.T @ own @ basis)
        std = np.sqrt(wider * np.einsum("ij,ij->i", alone, basis))
        made.append(RunAgreement(p, alone @ score, std))
    return made


def shift_by_run(fit: VehicleFit, index: int) -> tuple[Array, Array]:
    """By how much each run alone would move one coordinate, the others adapted to all runs, and its error.

    Runs that hold less than ``INFORMATIVE`` of what the best one tells are mute: their error is infinite.

    Returns
    -------
    (r,) change of the coordinate, (r,) its standard error
    """
    rows = [run.rows for run in fit.point.by_run]
    together = np.vstack(rows)
    others = np.delete(np.arange(fit.shared.size), index)
    of_others, *_ = np.linalg.lstsq(together[:, others], together[:, index], rcond=None)
    direction = np.insert(-of_others, index, 1.0)
    own = [one[:, :-1] @ direction for one in rows]
    told = np.array([float(one @ one) for one in own])
    score = np.array([float(one @ part[:, -1]) for one, part in zip(own, rows, strict=True)])
    spread = told
    if fit.by_inputs is not None:
        spread = told + direction @ fit.by_inputs.scatter @ direction
    loud = told > INFORMATIVE * told.max(initial=0.0)
    safe = np.where(loud, told, 1.0)
    std = np.sqrt(_beside_inputs(fit) * spread) / safe
    return np.where(loud, score / safe, 0.0), np.where(loud, std, np.inf)


def _quadratic_p(score: Array, spread: Array, wider: float) -> float:
    values, vectors = np.linalg.eigh(spread)
    kept = values > LEAST_SHARE
    along = vectors[:, kept].T @ score
    return float(chi2.sf(float(np.sum(along**2 / values[kept])) / wider, max(1, int(kept.sum()))))


def inflation(fit: VehicleFit) -> float:
    """How many times larger the scores' covariance is than white residuals would make it, on average."""
    return _over(fit, _told(fit))


def _beside_inputs(fit: VehicleFit) -> float:
    """Likewise, than white residuals and the noise of the inputs that is known would make it."""
    return _over(fit, _told(fit) if fit.by_inputs is None else _told(fit) + fit.by_inputs.scatter.sum(axis=0))


def _told(fit: VehicleFit) -> Array:
    """(s, s) information that the data hold."""
    return np.asarray(fit.information - np.diag(1 / fit.point.problem.prior_std**2))


def _over(fit: VehicleFit, expected: Array) -> float:
    basis = told_directions(_told(fit), fit.information)
    scores = fit.information @ fit.covariance @ fit.information
    seen, mean = (float(np.trace(basis.T @ one @ basis)) for one in (scores, expected))
    return max(1.0, seen / mean) if basis.shape[1] else 1.0


def to_fixed(problem: VehicleProblem, fit: VehicleFit, others: Sequence[str]) -> Array:
    """(s, f) change of the coordinates per relative change of values that the fit takes as given.

    Gauss-Newton to first order: what the fit would answer if a fixed value were another.
    """
    if not others:
        return np.zeros((fit.shared.size, 0))
    extra = [Coordinate(name, logarithmic=False) for name in others]
    given = problem.fixed | {STEERING_RATIO: 1.0}
    wider = problem.with_changed(
        coordinates=[*problem.coordinates, *extra],
        fixed={name: value for name, value in problem.fixed.items() if name not in others},
    )
    values = np.array([given[name] for name in others])
    point = replace(fit.point, problem=wider, shared=np.concatenate([fit.shared, values]))
    rows = point.triangle()
    size = fit.shared.size
    own, other = rows[:, :size], rows[:, size:-1] * values
    inverse = inverse_of(triangle_of(own))
    return np.asarray(-inverse @ inverse.T @ own.T @ other)
