r"""The Bode bandwidth check: where the gain has fallen to 1/sqrt 2 of the DC gain, seen three ways.

* ``bode_bandwidth``: of the identified K exp(-L s) / (a2 s² + a1 s + 1), found by python-control. The dead
  time turns the phase alone. Its interval is that of the covariance of a1 and rho = a2 / a1² by the delta
  method for ln w: with x = w², a2² x² + (a1² - 2 a2) x = 1, and ln w = f(rho) - ln a1 is smooth through
  critical damping and down to a single lag.
* ``measured_bandwidth``: of the measured gains. Made falling over frequency (isotonic regression of ln gain,
  weighted by the standard errors) they tell between which two the crossing lies; there a line in ln w is
  fitted to ln(measured / model) of the points within a factor of 1.8, or of the two where there are no more,
  and the model times that line is solved for the crossing. A straight line between neighbours on the log-log
  plot lies below the curve and would give 3 % too little between sines at 3 and 5 rad/s. So the model lends
  the curvature, the levels are measured. Where the points scatter about the line by more than their errors,
  these are enlarged by the square root of chi squared over its degrees of freedom.
* ``sine_cutoff``: the highest frequency of the sine runs that still changes the output significantly.

On the last one the source says only that sines of 0.1 to 10 rad/s gave "the maximum input frequency after
which no significant change in the output was observed", and that it overlaps with the Bode bandwidth; not
what is significant. Statistically the output changes at any frequency, if one averages for long enough: at
10 rad/s the angle of a truck still moves by a third of the request, hundreds of standard errors. So that the
two can be compared, a change is significant here if it differs from zero (z > 3, Bonferroni for the number of
sines) *and* its gain is not below 1/sqrt 2 of the DC gain by more than its own and the DC gain's 95 %
interval: half of the power of what slow requests do.

The DC gain is the identified K, which the steps know best; its error is in all intervals. The three share
data, so that overlapping intervals are a check of consistency and not a test with a stated level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, isotonic_regression
from scipy.stats import norm

from ident.estimation.actuator_fit import estimate
from ident.estimation.actuator_likelihood import DEAD_TIME, GAIN, RATIO, SUM
from ident.estimation.frequency_response import Plant
from ident.estimation.output_error import Fit
from ident.results import Bandwidth, Cutoff, Estimate, FrequencyCurve, FrequencyPoint

Array = NDArray[np.float64]

HALF_POWER = 2**-0.5
NORMAL_95 = float(norm.ppf(0.975))
SIGNIFICANT = 3.0  # standard errors, for one sine
SAME_FREQUENCY = 0.02  # relative
NEIGHBOURS = 1.8  # largest ratio of frequencies to the middle of the crossing
ROOM = 0.2  # of ln w beyond the points used, in which the crossing may still lie
MANY = 10**6  # degrees of freedom: the normal distribution
BEYOND = 1.5  # times the bandwidth, up to which sines should be driven
NO_END = 20.0  # of ln w: an end of the interval further away is none
UNIT = "rad/s"


@dataclass(frozen=True)
class Levels:
    """Measured gains at rising frequencies, equal ones pooled.

    frequency : (n,) [rad/s]; gain, std : (n,) [-]
    """

    frequency: Array
    gain: Array
    std: Array


def check_bandwidth(points: Sequence[FrequencyPoint], fit: Fit, plant: Plant) -> Bandwidth:
    """Compare the bandwidth of the model with what sines and chirps have shown.

    Parameters
    ----------
    points : the measured response, in any order
    fit : of the model, for its covariance; plant : the same model
    """
    dc_std = float(np.sqrt(fit.covariance[GAIN, GAIN]))
    bode = bode_bandwidth(fit)
    measured = measured_bandwidth(pooled(points), plant, dc_std)
    cutoff = sine_cutoff(pooled([one for one in points if one.method == "sine"]), plant, dc_std)
    overlap, reason = compare(bode, measured, cutoff, _highest_above(pooled(points), plant, dc_std))
    return Bandwidth(bode, measured, cutoff, overlap, reason)


def bode_bandwidth(fit: Fit) -> Estimate:
    """-3 dB frequency of the identified transfer function [rad/s], relative to its DC gain."""
    total, ratio = fit.shared[[SUM, RATIO]]
    value = half_power_frequency(total, ratio * total**2)
    covariance = fit.covariance[np.ix_([SUM, RATIO], [SUM, RATIO])]
    slope = np.array([-1 / total, _slope_to_ratio(value * total, ratio)])
    relative = float(np.sqrt(slope @ covariance @ slope))
    return _from_logarithm(value, relative, fit.freedom)


def half_power_frequency(sum_of_lags: float, product_of_lags: float) -> float:
    """Where 1 / (a2 s² + a1 s + 1) has fallen to 1/sqrt 2 [rad/s]."""
    import control  # noqa: PLC0415 -- 2 s with its plotting; only the bandwidth needs it

    lags = control.tf([1.0], [product_of_lags, sum_of_lags, 1.0])
    return float(control.bandwidth(lags, dbdrop=20 * np.log10(HALF_POWER)))


def _slope_to_ratio(scaled: float, ratio: float) -> float:
    """Derivative of ln w to rho, from rho² z² + (1 - 2 rho) z = 1 with z = (w a1)²."""
    z = scaled**2
    return float((z - ratio * z**2) / (2 * ratio**2 * z + 1 - 2 * ratio) / z)


def _from_logarithm(value: float, relative: float, freedom: int) -> Estimate:
    """Estimate whose logarithm is normal; its status by the relative error."""
    one = estimate(0.0, relative, UNIT, freedom, scale=1.0)
    low, high = (
        None if end is None or abs(end) > NO_END else float(value * np.exp(end))
        for end in (one.low, one.high)
    )
    return Estimate(float(value), float(value * relative), low, high, UNIT, one.status, one.reason)


def model_response(fit: Fit, frequency: Array) -> FrequencyCurve:
    """G(jw) of the fit with standard errors, by the delta method for ln G = ln K - j w L - ln D.

    frequency : (n,) rising [rad/s]
    """
    gain, dead_time, total, ratio = (float(fit.shared[i]) for i in (GAIN, DEAD_TIME, SUM, RATIO))
    plant = Plant(gain, dead_time, total, ratio * total**2)
    s = 1j * frequency
    lags = 1 + s * total + ratio * (s * total) ** 2
    slopes = np.array(
        [
            np.full(s.size, 1 / gain, dtype=np.complex128),
            -s,
            -(s + 2 * ratio * total * s**2) / lags,
            -((s * total) ** 2) / lags,
        ]
    )
    order = [GAIN, DEAD_TIME, SUM, RATIO]
    covariance = fit.covariance[np.ix_(order, order)]
    relative, phase_std = (
        np.sqrt(np.einsum("in,ij,jn->n", part, covariance, part)) for part in (slopes.real, slopes.imag)
    )
    size = np.abs(plant.response(frequency))
    return FrequencyCurve(
        frequency=frequency.tolist(),
        gain=size.tolist(),
        gain_std=(size * relative).tolist(),
        phase=plant.phase(frequency).tolist(),
        phase_std=phase_std.tolist(),
    )


def pooled(points: Sequence[FrequencyPoint]) -> Levels:
    """Measured gains in the order of frequency, those within SAME_FREQUENCY of each other averaged."""
    ordered = sorted(points, key=lambda one: one.frequency)
    groups: list[list[FrequencyPoint]] = []
    for one in ordered:
        if groups and one.frequency <= (1 + SAME_FREQUENCY) * groups[-1][0].frequency:
            groups[-1].append(one)
        else:
            groups.append([one])
    means = [_mean(group) for group in groups]
    columns = np.array(means, dtype=np.float64).reshape(-1, 3).T
    return Levels(columns[0], columns[1], columns[2])


def _mean(group: Sequence[FrequencyPoint]) -> tuple[float, float, float]:
    """Frequency, gain and its standard error, weighted by the inverse variances."""
    weight = np.array([1 / max(one.gain_std, 1e-12) ** 2 for one in group])
    weight_sum = float(weight.sum())
    frequency = float(weight @ np.array([one.frequency for one in group])) / weight_sum
    gain = float(weight @ np.array([one.gain for one in group])) / weight_sum
    return frequency, gain, weight_sum**-0.5


def measured_bandwidth(levels: Levels, plant: Plant, dc_std: float) -> Estimate:
    """Where the measured gain crosses 1/sqrt 2 of the DC gain [rad/s].

    Parameters
    ----------
    plant : the identified model: its K is the DC gain, its shape the curvature between neighbours
    dc_std : standard error of K [-]
    """
    limit = plant.gain * HALF_POWER
    positive = levels.gain > 0
    frequency, gain, std = levels.frequency[positive], levels.gain[positive], levels.std[positive]
    if frequency.size == 0:
        return _none("no gain was measured: drive sines or a chirp")
    falling = isotonic_regression(np.log(gain), weights=(gain / std) ** 2, increasing=False).x
    below = np.flatnonzero(falling < np.log(limit))
    if below.size == 0:
        return _none(
            f"the gain is still {gain[-1] / plant.gain:.2f} of the DC gain at {frequency[-1]:.3g} rad/s, the "
            f"highest measured, below {HALF_POWER:.2f} needed: drive faster sines or a chirp"
        )
    after = int(below[0])
    if after == 0:
        return _none(
            f"the gain is already {gain[0] / plant.gain:.2f} of the DC gain at {frequency[0]:.3g} rad/s, the "
            f"lowest measured, above {HALF_POWER:.2f} needed: drive slower sines"
        )
    middle = float(np.log(frequency[after - 1 : after + 1]).mean())
    near = np.abs(np.log(frequency) - middle) < np.log(NEIGHBOURS)
    near[after - 1 : after + 1] = True
    return _crossing(Levels(frequency[near], gain[near], std[near]), plant, dc_std)


def _none(reason: str) -> Estimate:
    return Estimate(None, None, None, None, UNIT, "not_identifiable", reason)


def _crossing(near: Levels, plant: Plant, dc_std: float) -> Estimate:
    """Crossing of the model times a line in ln w through ln(measured / model) of the points near it."""
    log_w = np.log(near.frequency)
    excess = np.log(near.gain) - np.log(np.abs(plant.response(near.frequency)))
    relative = near.std / near.gain
    middle = float(log_w.mean())
    columns = np.column_stack([np.ones_like(log_w), log_w - middle])
    line, covariance = _weighted_line(columns, excess, relative)

    def above(x: float) -> float:
        model = np.log(np.abs(plant.response(np.exp(x))) / plant.gain)
        return float(model + line[0] + line[1] * (x - middle) - np.log(HALF_POWER))

    low, high = float(log_w[0]) - ROOM, float(log_w[-1]) + ROOM
    if not above(low) > 0 > above(high):
        return _none("the measured gains scatter too much about the limit: drive larger sines")
    at = float(brentq(above, low, high, xtol=1e-12))
    slope = (above(at + ROOM / 100) - above(at - ROOM / 100)) / (ROOM / 50)
    row = np.array([1.0, at - middle])
    error = float(row @ covariance @ row) + (dc_std / plant.gain) ** 2
    return _from_logarithm(float(np.exp(at)), float(np.sqrt(error)) / abs(slope), MANY)


def _weighted_line(columns: Array, values: Array, std: Array) -> tuple[Array, Array]:
    """Weighted least squares; the covariance is enlarged where the values scatter by more than ``std``."""
    weighted = columns / std[:, None]
    solution = np.linalg.lstsq(weighted, values / std, rcond=None)[0]
    rest = (values - columns @ solution) / std
    freedom = values.size - columns.shape[1]
    scatter = max(1.0, float(rest @ rest) / freedom) if freedom > 0 else 1.0
    return np.asarray(solution), np.asarray(scatter * np.linalg.inv(weighted.T @ weighted))


def sine_cutoff(levels: Levels, plant: Plant, dc_std: float) -> Cutoff | None:
    """Highest driven frequency that still changes the output significantly, and the next one driven.

    ``low`` is zero where already the slowest sine does not; None without sines. For the criterion see the
    head of this module.
    """
    if levels.frequency.size == 0:
        return None
    last = _last_above(levels, plant, dc_std)
    low = float(levels.frequency[last]) if last >= 0 else 0.0
    high = float(levels.frequency[last + 1]) if last + 1 < levels.frequency.size else None
    return Cutoff(low, high, UNIT)


def _last_above(levels: Levels, plant: Plant, dc_std: float) -> int:
    """Index of the highest frequency with a significant change, -1 where there is none."""
    tests = max(levels.gain.size, 1)
    critical = float(norm.isf(norm.sf(SIGNIFICANT) / tests))
    slack = NORMAL_95 * np.hypot(levels.std, HALF_POWER * dc_std)
    changes = (levels.gain > critical * levels.std) & (levels.gain + slack >= HALF_POWER * plant.gain)
    return int(np.flatnonzero(changes)[-1]) if changes.any() else -1


def _highest_above(levels: Levels, plant: Plant, dc_std: float) -> float | None:
    """Highest frequency at which the gain is not below the limit, of any method [rad/s]."""
    last = _last_above(levels, plant, dc_std)
    return float(levels.frequency[last]) if last >= 0 else None


def compare(
    bode: Estimate, measured: Estimate, cutoff: Cutoff | None, reached: float | None
) -> tuple[bool | None, str]:
    """Say whether the intervals overlap, and why.

    Parameters
    ----------
    reached : highest frequency measured whose gain is not below the limit, by any method [rad/s]
    """
    bode_low, bode_high = _ends(bode)
    parts: list[tuple[str, float, float]] = []
    if measured.value is not None:
        parts.append(("the measured crossing", *_ends(measured)))
    if cutoff is not None:
        parts.append(("the sine cut-off", cutoff.low, np.inf if cutoff.high is None else cutoff.high))
    if measured.value is None and reached is not None:
        parts.append(("the measured gain", reached, np.inf))
    apart = [name for name, low, high in parts if low > bode_high or high < bode_low]
    shown = f"Bode bandwidth {bode_low:.4g} to {bode_high:.4g} rad/s"
    told = "; ".join(f"{name} {_range(low, high)}" for name, low, high in parts)
    if apart:
        return False, f"{shown} does not overlap with {' and '.join(apart)}: {told}"
    if measured.value is None:
        return None, f"{shown} was not reached by the measurement: {measured.reason}"
    if cutoff is not None and cutoff.high is None:
        return None, f"{shown} overlaps with {told}; the sines end before: drive them to {_goal(bode)}"
    if len(parts) > 1 and not _share(parts):
        return False, f"the measurements do not overlap with each other: {told}"
    if cutoff is None:
        return True, f"{shown} overlaps with {told}; there are no sines: drive some up to {_goal(bode)}"
    return True, f"{shown} overlaps with {told}"


def _share(parts: Sequence[tuple[str, float, float]]) -> bool:
    return max(low for _, low, _ in parts) <= min(high for _, _, high in parts)


def _ends(one: Estimate) -> tuple[float, float]:
    value = one.value or 0.0
    return (value if one.low is None else one.low), (value if one.high is None else one.high)


def _range(low: float, high: float) -> str:
    return f"beyond {low:.4g} rad/s" if np.isinf(high) else f"{low:.4g} to {high:.4g} rad/s"


def _goal(bode: Estimate) -> str:
    return f"{BEYOND * (bode.value or 0.0):.2g} rad/s"
