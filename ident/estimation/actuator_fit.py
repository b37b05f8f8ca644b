"""Fit of the steering actuator (2.25): a start from the data, the likelihood, what it says of K, L, T1, T2.

The start needs no guess: for given dead time and lags the model is linear in everything else, so a coarse
grid of (L, T1 + T2, damping) is scored by linear least squares on thinned samples, and the best corner of
each damping is refined.

T1 and T2 follow from a1 = T1 + T2 and rho = T1 T2 / a1² by T1,2 = a1 (1 +- sqrt(1 - 4 rho)) / 2, which is
strongly curved near critical damping. Their intervals are therefore the percentiles of that function over
the (normal) distribution of (a1, rho), not its linearisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, t

from ident.errors import NotIdentifiable
from ident.estimation.actuator_likelihood import (
    BIAS,
    DEAD_TIME,
    GAIN,
    RATIO,
    SHORTEST_LAG_SHARE,
    SUM,
    ActuatorProblem,
    ActuatorRecord,
)
from ident.estimation.noise import AutoRegression, Linearised, NoiseShape
from ident.estimation.noise_fit import fit_autoregression, fit_continuous_ar1
from ident.estimation.output_error import WHITE, Fit, fit_least_squares, fit_output_error, linear_score
from ident.estimation.small_lag import settled_order
from ident.results import Classification, Estimate, Status, SteeringModel

Array = NDArray[np.float64]

THINNED_SAMPLES = 3000
THINNED_RECORDS = 24
DEAD_TIMES = (-0.12, 0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.27, 0.35, 0.45, 0.57, 0.75, 1.0)
SUMS = tuple(np.geomspace(0.02, 3.0, 10).tolist())
RATIOS = (0.02, 0.2, 0.8)
OPPOSITE = 0.5  # sum of squares with a negative gain over that with a positive one: a wrong sign
JITTER_LIMIT = 0.2  # of the period, beyond which noise is modelled in continuous time
MISFIT_VAF = 0.02  # lost to least squares
MISFIT_RMS = 1.1  # over that of least squares
MISFIT_REASON = "the model is wrong here: the value changes with the excitation"
DRAWS = 20_000
LEVEL = 0.95
WEAK_RELATIVE_ERROR = 0.2
LARGEST_RELATIVE_ERROR = 0.5


@dataclass(frozen=True)
class ActuatorFit:
    """The likelihood fit of one or more runs.

    fit : the estimate with its covariance; its parameters are (K, L, a1, rho, biases)
    records : what it was fitted to
    vaf : variance accounted for over all records [-]
    rms : root mean square of the residual [rad]
    misfit : whether the residual is model error and not noise; the fit is then the least-squares one
    """

    fit: Fit
    records: list[ActuatorRecord]
    vaf: float
    rms: float
    misfit: bool = False

    @property
    def samples(self) -> int:
        """Measured samples used."""
        return sum(record.times.size for record in self.records)


def thinned(records: Sequence[ActuatorRecord], samples: int = THINNED_SAMPLES) -> list[ActuatorRecord]:
    """Return at most THINNED_RECORDS of the records, evenly spread, with about ``samples`` samples in all."""
    some = [records[i] for i in np.unique(np.linspace(0, len(records) - 1, THINNED_RECORDS).astype(int))]
    step = max(1, sum(record.times.size for record in some) // samples)
    return [
        replace(r, times=r.times[::step], measured=r.measured[::step], starts=np.zeros(1, dtype=np.intp))
        for r in some
    ]


def search_start(records: Sequence[ActuatorRecord]) -> Array:
    """Parameters (K, L, a1, rho, biases) near the best fit, from the data alone.

    Raises
    ------
    NotIdentifiable
        If the output follows the request in no grid point.
    """
    problem = ActuatorProblem(thinned(records), runs=1 + max(record.run for record in records))
    scored = []
    for dead_time, total, ratio in product(DEAD_TIMES, SUMS, RATIOS):
        shared = np.zeros(BIAS + problem.runs)
        shared[:BIAS] = 1.0, dead_time, total, ratio
        local = [np.zeros(4 + record.lost.size) for record in problem.records]
        linear = [GAIN, *range(BIAS, shared.size)]
        score, solution = linear_score(problem.linearise(shared, local), linear)
        shared[linear] = solution
        shared[GAIN] += 1.0
        scored.append((score, shared))
    scored.sort(key=lambda pair: pair[0])
    following = [shared for _, shared in scored if shared[GAIN] > 0]
    shapes = [[shared for shared in following if shared[RATIO] == ratio] for ratio in RATIOS]
    corners = [ordered[0] for ordered in shapes if ordered]  # one a shape: they lie in different valleys
    best_score, best = scored[0]
    rest = min(_spread(problem.records), *(score for score, shared in scored if shared[GAIN] > 0), np.inf)
    if best[GAIN] < 0 and best_score < OPPOSITE * rest and _stays_opposite(problem, best, corners):
        raise NotIdentifiable(
            f"the measured angle turns against its request (gain {best[GAIN]:.3g}): one of the two has the "
            "wrong sign; check both against a turn to the left, which is positive"
        )
    if not corners:
        raise NotIdentifiable(
            f"the measured angle does not follow the request: the best gain is {best[GAIN]:.3g}, need one "
            "above zero: check that the request was acted on"
        )
    fits = [fit_output_error(problem, c, problem.start(c), identify_noise=_white) for c in corners]
    return min(fits, key=lambda fit: fit.white_sum).shared


def _stays_opposite(problem: ActuatorProblem, best: Array, corners: Sequence[Array]) -> bool:
    """Whether a negative gain is still the better fit once both are refined, off the grid.

    The answer to a fast square wave looks like its opposite half a period later: only the exact dead time and
    lags tell which it is.
    """
    fits = [fit_output_error(problem, c, problem.start(c), identify_noise=_white) for c in (best, *corners)]
    opposite = min((fit.white_sum for fit in fits if fit.shared[GAIN] < 0), default=np.inf)
    following = min((fit.white_sum for fit in fits if fit.shared[GAIN] >= 0), default=np.inf)
    return bool(opposite < OPPOSITE * following)


def _white(records: Sequence[Linearised], like: NoiseShape | None) -> AutoRegression:
    """Take the noise as white, which is good enough for a start."""
    del records, like
    return WHITE


def fit_actuator(
    records: Sequence[ActuatorRecord],
    *,
    start: Array | None = None,
    jitter: float = 0.0,
    shape: NoiseShape | None = None,
) -> ActuatorFit:
    """Maximum likelihood of the actuator over all records, with its noise.

    Where the model is wrong, the likelihood takes the model error for coloured noise and, to whiten it, fits
    what is fast and small at the expense of what is slow and large. That shows as a simulation far worse than
    least squares reaches with the same model, and then the least-squares fit is returned.

    Parameters
    ----------
    records : at least one, with some excitation
    start : parameters to begin with; found from the data where None
    jitter : spread of the sampling period in parts of it; beyond JITTER_LIMIT the noise is modelled in
        continuous time
    shape : colour of the noise to begin with, from a fit of data alike

    Raises
    ------
    NotIdentifiable
        If nothing in the output follows the request.
    """
    plain = fit_roughly(records, start=start)
    identify = fit_continuous_ar1 if jitter > JITTER_LIMIT else fit_autoregression
    fit = fit_output_error(
        ActuatorProblem(records),
        plain.fit.shared,
        plain.fit.local,
        identify_noise=identify,
        shape=WHITE if shape is None else shape,
    )
    likely = _scored(settled_order(fit, records), records)
    lost = plain.vaf - likely.vaf
    if lost > MISFIT_VAF and likely.rms > MISFIT_RMS * plain.rms:
        return plain
    return likely


def fit_roughly(records: Sequence[ActuatorRecord], *, start: Array | None = None) -> ActuatorFit:
    """Least squares, without a model of the noise; see :func:`fit_actuator` for the parameters."""
    problem = ActuatorProblem(records)
    shared = search_start(records) if start is None else start
    return _scored(fit_least_squares(problem, shared, problem.start(shared)), records, misfit=True)


def _scored(fit: Fit, records: Sequence[ActuatorRecord], *, misfit: bool = False) -> ActuatorFit:
    residual = np.concatenate(fit.residuals)
    spread = _spread(records)
    vaf = 1.0 - float(residual @ residual) / spread if spread > 0 else 0.0
    return ActuatorFit(fit, list(records), vaf, float(np.sqrt(np.mean(residual**2))), misfit)


def _spread(records: Sequence[ActuatorRecord]) -> float:
    """Sum of squares of the measured angles about the mean of each record."""
    return sum(float(np.square(r.measured - r.measured.mean()).sum()) for r in records)


def steering_model(fit: Fit) -> SteeringModel:
    """K, L, T1, T2 and what follows from them, with standard errors and 95 % intervals.

    T2 alone is refused where its relative error passes LARGEST_RELATIVE_ERROR; L + T1 + T2 is known far
    better than its parts and is given always.
    """
    gain, dead_time, total = fit.shared[:RATIO]
    covariance = fit.covariance[:BIAS, :BIAS]
    std = np.sqrt(np.diag(covariance))
    lag_std = float(
        np.sqrt(covariance[DEAD_TIME, DEAD_TIME] + 2 * covariance[DEAD_TIME, SUM] + covariance[SUM, SUM])
    )
    lag = estimate(dead_time + total, lag_std, "s", fit.freedom)
    delay = estimate(dead_time, float(std[DEAD_TIME]), "s", fit.freedom, scale=dead_time + total)
    draws = _draws(fit)
    if underdamped(fit):
        none = "underdamped: complex poles have no real time constants"
        constants = [_refused("s", none), _refused("s", none)]
    else:
        constants = _time_constant_estimates(fit, draws)
    frequency, damping = _resonance(fit, draws)
    return SteeringModel(
        gain=estimate(gain, float(std[GAIN]), "1", fit.freedom),
        dead_time=delay,
        time_constant_1=constants[0],
        time_constant_2=constants[1],
        total_lag=lag,
        natural_frequency=frequency,
        damping_ratio=damping,
    )


def doubted(model: SteeringModel) -> SteeringModel:
    """Return the same with no parameter better than weak, where the model does not describe the data."""
    estimates = {name: getattr(model, name) for name in SteeringModel.__dataclass_fields__}
    return SteeringModel(
        **{
            name: replace(one, status="weak", reason=MISFIT_REASON) if one.status == "identified" else one
            for name, one in estimates.items()
        }
    )


def estimate(value: float, std: float, unit: str, freedom: int, *, scale: float | None = None) -> Estimate:
    """Estimate with Student's 95 % interval; its status by the standard error relative to ``scale``."""
    half = float(t.ppf(0.5 + LEVEL / 2, freedom)) * std
    status, reason = _status(std, abs(value if scale is None else scale))
    return Estimate(float(value), std, float(value) - half, float(value) + half, unit, status, reason)


def _status(std: float, scale: float) -> tuple[Status, str | None]:
    relative = std / scale if scale > 0 else np.inf
    if relative <= WEAK_RELATIVE_ERROR:
        return "identified", None
    told = f"standard error {100 * relative:.0f} %"
    if relative <= LARGEST_RELATIVE_ERROR:
        return "weak", f"{told}, above {100 * WEAK_RELATIVE_ERROR:.0f} %: add steps and sines to 10 rad/s"
    needed = f"at most {100 * LARGEST_RELATIVE_ERROR:.0f} % needed: add steps and sines to 10 rad/s"
    return "not_identifiable", f"{told}, {needed}"


def _refused(unit: str, reason: str) -> Estimate:
    return Estimate(None, None, None, None, unit, "not_identifiable", reason)


def _draws(fit: Fit) -> Array:
    """(DRAWS, 4) K, L, a1 and rho from their normal distribution; the same numbers every time."""
    values, vectors = np.linalg.eigh(fit.covariance[:BIAS, :BIAS])
    factor = vectors * np.sqrt(np.maximum(values, 0.0))
    half = np.random.default_rng(0).standard_normal((DRAWS // 2, BIAS))
    unit = np.vstack([half, -half])
    # Exactly white draws: their covariance is that of the estimate to the last digit.
    unit = np.linalg.solve(np.linalg.cholesky(unit.T @ unit / DRAWS), unit.T).T
    drawn = unit @ factor.T + fit.shared[:BIAS]
    return np.asarray(np.maximum(drawn, [-np.inf, -np.inf, 1e-6, 0.0]), dtype=np.float64)


def joint_covariance(fit: Fit) -> tuple[list[str], Array]:
    """Names of the parameters of the steering part of a model, and their covariance.

    They are gain, dead_time and the two time constants; or natural frequency and damping ratio where the
    response is underdamped.
    """
    draws = _draws(fit)
    total, ratio = draws[:, SUM], draws[:, RATIO]
    if underdamped(fit):
        names = ["natural_frequency", "damping_ratio"]
        root = np.sqrt(np.maximum(ratio, SHORTEST_LAG_SHARE))
        shape = np.column_stack([1 / (total * root), 1 / (2 * root)])
    else:
        names = ["time_constant_1", "time_constant_2"]
        spread = np.sqrt(np.maximum(1 - 4 * ratio, 0.0))
        shape = np.column_stack([total * (1 + spread) / 2, total * (1 - spread) / 2])
    covariance = np.cov(np.column_stack([draws[:, :SUM], shape]).T, bias=True)
    return [f"steering.{name}" for name in ("gain", "dead_time", *names)], np.asarray(covariance)


def _time_constant_estimates(fit: Fit, draws: Array) -> list[Estimate]:
    total, ratio = fit.shared[[SUM, RATIO]]
    root = np.sqrt(max(1 - 4 * ratio, 0.0))
    spread = np.sqrt(np.maximum(1 - 4 * draws[:, RATIO], 0.0))
    pairs = (
        (total * (1 + root) / 2, draws[:, SUM] * (1 + spread) / 2),
        (total * (1 - root) / 2, draws[:, SUM] * (1 - spread) / 2),
    )
    found = []
    for value, sample in pairs:
        low, high = np.quantile(sample, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
        std = float(sample.std())
        status, reason = _status(std, value)
        if status == "not_identifiable":
            found.append(Estimate(None, std, float(low), float(high), "s", status, reason))
        else:
            found.append(Estimate(float(value), std, float(low), float(high), "s", status, reason))
    return found


def _resonance(fit: Fit, draws: Array) -> tuple[Estimate, Estimate]:
    """omega_n = 1 / (a1 sqrt(rho)) [rad/s] and zeta = 1 / (2 sqrt(rho)) (2.19); none for first order."""
    if first_order(fit):
        told = "first order within the error: no second pole to tell"
        return _refused("rad/s", told), _refused("1", told)
    total, ratio = fit.shared[[SUM, RATIO]]
    root = np.sqrt(np.maximum(draws[:, RATIO], SHORTEST_LAG_SHARE))
    return (
        _from_draws(1 / (total * np.sqrt(ratio)), 1 / (draws[:, SUM] * root), "rad/s"),
        _from_draws(1 / (2 * np.sqrt(ratio)), 1 / (2 * root), "1"),
    )


def _from_draws(value: float, sample: Array, unit: str) -> Estimate:
    low, high = np.quantile(sample, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    std = float((high - low) / (2 * t.ppf(0.5 + LEVEL / 2, 10**6)))
    status, reason = _status(std, abs(value))
    return Estimate(float(value), std, float(low), float(high), unit, status, reason)


def first_order(fit: Fit) -> bool:
    """Whether T2 = 0 lies within two standard errors."""
    return bool(fit.shared[RATIO] - 2 * np.sqrt(fit.covariance[RATIO, RATIO]) <= 2 * SHORTEST_LAG_SHARE)


def underdamped(fit: Fit) -> bool:
    """Whether the poles are complex, with critical damping excluded."""
    return bool(fit.shared[RATIO] > 0.25) and not critically_damped(fit)


def critically_damped(fit: Fit) -> bool:
    """Whether T1 = T2 (rho = 1/4) lies within two standard errors."""
    return bool(abs(fit.shared[RATIO] - 0.25) <= 2 * np.sqrt(fit.covariance[RATIO, RATIO]))


def classify(fit: Fit) -> tuple[Classification, str]:
    """Shape of the response by its damping (2.19), and why; a gain below one is not damping."""
    ratio, std = fit.shared[RATIO], float(np.sqrt(fit.covariance[RATIO, RATIO]))
    damping = 1 / (2 * np.sqrt(ratio))
    told = f"T1 T2/(T1 + T2)² is {ratio:.3f} ± {std:.3f}"
    if first_order(fit):
        also = ", and neither is critical damping: T2 is not known" if critically_damped(fit) else ""
        return "first_order", f"{told}: T2 = 0 cannot be excluded{also}"
    if critically_damped(fit):
        return "critically_damped", f"{told}: equal time constants (0.25) cannot be excluded"
    if ratio > 0.25:
        return "underdamped", f"{told}, above 0.25: damping ratio {damping:.2f}"
    return "overdamped", f"{told}, between 0 and 0.25: damping ratio {damping:.2f}, two real time constants"


def agreement(fits: Sequence[ActuatorFit], count: int = 3) -> float | None:
    """p-value of the hypothesis that all fits have the same K, L and T1 + T2 (Cochran's Q).

    Parameters
    ----------
    fits : fits of disjoint data
    count : how many of (K, L, a1) to compare

    Returns
    -------
    p-value, None below two fits
    """
    if len(fits) < 2:
        return None
    weights = [np.linalg.pinv(fit.fit.covariance[:count, :count]) for fit in fits]
    values = [fit.fit.shared[:count] for fit in fits]
    mean = np.linalg.solve(sum(weights), sum(w @ v for w, v in zip(weights, values, strict=True)))
    distance = sum(float((v - mean) @ w @ (v - mean)) for w, v in zip(weights, values, strict=True))
    return float(chi2.sf(distance, count * (len(fits) - 1)))
