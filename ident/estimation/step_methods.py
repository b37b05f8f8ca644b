r"""Step-response methods for the steering, one step at a time, each its own function.

* 63.2 % (2.15-2.16): K = dy/du, tau = t_63 - L, one lag.
* Tangent: the tangent at the point of inflection meets zero at L and one at L + tau, one lag.
* Sundaresan and Krishnaswamy (1978, doi:10.1002/cjce.5450560215): tau = 0.67 (t_85 - t_35),
  L = 1.3 t_35 - 0.29 t_85, with t_35 and t_85 at 35.3 % and 85.3 %: one lag, no dead time to be read.
* Underdamped (2.19): zeta from the overshoot M, zeta = -ln M / sqrt(pi² + ln² M), omega_n from its time,
  t_peak - L = pi / (omega_n sqrt(1 - zeta²)).
* Modified Harriott (2.20-2.23): t_72 is when 72 % of the change is reached; sum = (t_72 - L)/1.25; at
  t_z = L + 0.4 (t_72 - L) responses of different z = T1/(T1 + T2) differ most, and z is read from the curve
  y_z(z); T1 = z sum, T2 = (1 - z) sum. Where y_z lies below the lower end of the curve the dead time is
  raised, where it lies above the upper end it is lowered.
* Iterated: the sum from tau_72(z) of its curve and not from 1.25, until it no longer changes. The source
  leaves the dead time as it was read, and then one pass is all there is; here the dead time is improved too,
  from the time t_10 of 10 %, L = t_10 - tau_10(z) sum, which depends on no eye. What the iteration would
  converge to is found as the z for which all three agree.

The curves are computed from the exact step response, never read from a figure. With the time scaled by
T1 + T2 the response is 1 - (z exp(-t/z) - (1-z) exp(-t/(1-z)))/(2z - 1).

All assume that the step begins and ends at rest, and refuse a step that does not. They stand beside the
likelihood, which is what goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from ident.dynamics.second_order import step_response
from ident.errors import NotIdentifiable
from ident.estimation.step_response import (
    Response,
    StepModel,
    StepRecord,
    dead_time,
    normalised,
    overshoot,
    steepest,
    time_of,
)
from ident.results import StepFit, StepMethod

Array = NDArray[np.float64]

LEVEL = 0.72
MEAN_TIME = 1.25  # t_72 - L over T1 + T2, the source's mean over z
EARLY = 0.4  # t_z - L over t_72 - L
LOW_LEVEL = 0.1  # whose time gives the dead time of the iterated method
ALMOST_FIRST = 1 - 1e-6
DEAD_TIME_STEPS = 60
TRIALS = 41
ON_CURVE = 0.01
CURVE_POINTS = 201
PARAMETERS = ("gain", "dead_time", "time_constant_1", "time_constant_2", "natural_frequency", "damping_ratio")


def first_order_63(record: StepRecord) -> StepModel:
    """63.2 % method: one lag and a dead time.

    Raises
    ------
    NotIdentifiable
        If the step does not begin and end at rest, or is too small for its noise.
    """
    response = normalised(record)
    delay = dead_time(response)
    constant = time_of(response, 1 - np.exp(-1.0)) - delay
    if constant <= 0:
        raise NotIdentifiable("63.2 % is reached before the dead time ends: sample faster")
    return StepModel(response.change / record.request, delay, constant)


def tangent(record: StepRecord) -> StepModel:
    """Tangent at the point of inflection: one lag and a dead time.

    It takes the slow start of two lags for dead time: L comes out long.

    Raises
    ------
    NotIdentifiable
        If the step does not begin and end at rest, or is too small for its noise.
    """
    response = normalised(record)
    at, level, slope = steepest(response)
    if slope <= 0:
        raise NotIdentifiable("the response has no rising part: sample faster")
    return StepModel(response.change / record.request, max(at - level / slope, 0.0), 1 / slope)


def sundaresan_krishnaswamy(record: StepRecord) -> StepModel:
    """Two points, 35.3 and 85.3 %: one lag and a dead time.

    Raises
    ------
    NotIdentifiable
        If the step does not begin and end at rest, or is too small for its noise.
    """
    response = normalised(record)
    t_35, t_85 = time_of(response, 0.353), time_of(response, 0.853)
    return StepModel(response.change / record.request, 1.3 * t_35 - 0.29 * t_85, 0.67 * (t_85 - t_35))


def underdamped(record: StepRecord) -> StepModel:
    """Natural frequency and damping ratio from overshoot and peak time.

    Raises
    ------
    NotIdentifiable
        If the step does not begin and end at rest, or does not overshoot beyond its noise.
    """
    response = normalised(record)
    at, height = overshoot(response)
    if height >= 1:
        raise NotIdentifiable(f"overshoot of {100 * height:.0f} %, below 100 % needed: not a damped response")
    logarithm = np.log(height)
    damping = float(-logarithm / np.hypot(np.pi, logarithm))
    delay = dead_time(response)
    frequency = float(np.pi / ((at - delay) * np.sqrt(1 - damping**2)))
    gain = response.change / record.request
    return StepModel(gain, delay, natural_frequency=frequency, damping_ratio=damping)


def modified_harriott(record: StepRecord) -> StepModel:
    """Two lags and a dead time by the modified Harriott method, with t_72/sum = 1.25.

    Raises
    ------
    NotIdentifiable
        If the step does not begin and end at rest, is too small for its noise, or no dead time brings the
        early response onto the curve of two real lags.
    """
    response = normalised(record)
    t_72 = time_of(response, LEVEL)
    delay = _onto_curve(response, t_72, dead_time(response))
    total = (t_72 - delay) / MEAN_TIME
    z = _share(_early_level(response, t_72, delay))
    return _two_lags(record, response, delay, total, z)


def modified_harriott_iterated(record: StepRecord) -> StepModel:
    """Two lags and a dead time by the modified Harriott method, improved until nothing changes.

    Raises
    ------
    NotIdentifiable
        As :func:`modified_harriott`, or if no z makes the three agree.
    """
    response = normalised(record)
    t_low, t_72 = time_of(response, LOW_LEVEL), time_of(response, LEVEL)
    trials = np.linspace(0.5, 1.0, TRIALS)
    misses = np.array([_miss(response, t_low, t_72, z) for z in trials])
    crossings = np.flatnonzero(np.diff(np.sign(misses)) != 0)
    if crossings.size:
        low, high = trials[crossings[-1]], trials[crossings[-1] + 1]
        z = float(brentq(lambda x: _miss(response, t_low, t_72, x), low, high, xtol=1e-9))
    else:
        z = float(trials[np.argmin(np.abs(misses))])
        if abs(_miss(response, t_low, t_72, z)) > ON_CURVE + 3 * response.noise:
            raise NotIdentifiable("no two real lags pass through 72 %, y_z and 10 %: not two lags")
    delay, total = _timed(t_low, t_72, z)
    return _two_lags(record, response, delay, total, z)


def _timed(t_low: float, t_72: float, z: float) -> tuple[float, float]:
    """Dead time and sum of lags [s] that pass both levels on time."""
    total = (t_72 - t_low) / (_time_at(LEVEL, z) - _time_at(LOW_LEVEL, z))
    return max(t_72 - _time_at(LEVEL, z) * total, 0.0), total


def _miss(response: Response, t_low: float, t_72: float, z: float) -> float:
    """By how much the response at t_z is above the curve y_z(z) [-]."""
    delay, _ = _timed(t_low, t_72, z)
    return _early_level(response, t_72, delay) - float(np.interp(z, *_level_curve()))


STEP_METHODS: Mapping[StepMethod, Callable[[StepRecord], StepModel]] = {
    "first_order_63": first_order_63,
    "tangent": tangent,
    "sundaresan_krishnaswamy": sundaresan_krishnaswamy,
    "underdamped": underdamped,
    "modified_harriott": modified_harriott,
    "modified_harriott_iterated": modified_harriott_iterated,
}


def early_level(z: float) -> float:
    """y_z: share of the change at 0.4 t_72, of two lags with T1 = z (T1 + T2); 0.270 ... 0.399."""
    return float(_unit_response(EARLY * scaled_time_72(z), z))


def scaled_time_72(z: float) -> float:
    """tau_72: time to 72 % over T1 + T2, of two lags with T1 = z (T1 + T2); 1.246 ... 1.273."""
    return _scaled_time(LEVEL, z)


def _scaled_time(level: float, z: float) -> float:
    return float(brentq(lambda t: _unit_response(t, z) - level, 1e-6, 5.0, xtol=1e-13))


def _unit_response(t: float, z: float) -> float:
    inside = min(z, ALMOST_FIRST)
    return float(step_response(1.0, inside * (1 - inside), np.array([t]))[0])


@lru_cache(maxsize=4)
def _time_curve(level: float) -> CubicSpline:
    """Time to a level over T1 + T2, as a function of z; for speed, from CURVE_POINTS exact values."""
    z = np.linspace(0.5, 1.0, CURVE_POINTS)
    return CubicSpline(z, [_scaled_time(level, one) for one in z])


def _time_at(level: float, z: float) -> float:
    return float(_time_curve(level)(z))


@lru_cache(maxsize=1)
def _level_curve() -> tuple[Array, Array]:
    """Values of z, and y_z(z), which rises with them."""
    z = 0.5 + 0.5 * np.linspace(0.0, 1.0, CURVE_POINTS) ** 0.5
    z = np.unique(np.concatenate([z, np.linspace(0.5, 1.0, CURVE_POINTS)]))
    return z, np.array([early_level(one) for one in z])


def _share(level: float) -> float:
    """The z in [0.5, 1] at which y_z(z) has the level; an end of it outside the curve."""
    z, levels = _level_curve()
    return float(np.interp(level, levels, z))


def _early_level(response: Response, t_72: float, delay: float) -> float:
    """Share of the change reached at t_z = L + 0.4 (t_72 - L)."""
    return float(np.interp(delay + EARLY * (t_72 - delay), response.times, response.y))


def _onto_curve(response: Response, t_72: float, delay: float) -> float:
    """Raise or lower the dead time until y_z lies on the curve of two real lags."""
    low, high = early_level(0.5), early_level(1.0)
    step = t_72 / DEAD_TIME_STEPS
    for _ in range(2 * DEAD_TIME_STEPS):
        level = _early_level(response, t_72, delay)
        if low <= level <= high:
            return delay
        delay += step if level < low else -step
        if not 0 <= delay < t_72:
            break
        step *= 0.95
    reached = _early_level(response, t_72, float(np.clip(delay, 0.0, t_72)))
    raise NotIdentifiable(
        f"{100 * reached:.0f} % of the change at 0.4 t_72, two real lags give {100 * low:.0f} to "
        f"{100 * high:.0f} %: underdamped, rate-limited or not a step"
    )


def _two_lags(record: StepRecord, response: Response, delay: float, total: float, z: float) -> StepModel:
    return StepModel(response.change / record.request, delay, z * total, (1 - z) * total)


def combined(method: StepMethod, pairs: Sequence[tuple[StepRecord, StepModel]]) -> StepFit:
    """Medians over steps, their spread, and how well the median model describes all of them.

    pairs : the steps that the method could use, with what it gave
    """
    if not pairs:
        none = "no step overshoots" if method == "underdamped" else "no step begins and ends at rest"
        return StepFit(method, None, None, None, None, None, 0, reason=none)
    columns = {name: [getattr(model, name) for _, model in pairs] for name in PARAMETERS}
    middle = {name: _median(values) for name, values in columns.items()}
    spread = {
        name: float(np.std(values, ddof=1)) if len(pairs) > 1 and middle[name] is not None else None
        for name, values in columns.items()
    }
    common = StepModel(
        middle["gain"] or 0.0,
        middle["dead_time"] or 0.0,
        middle["time_constant_1"],
        middle["time_constant_2"],
        middle["natural_frequency"],
        middle["damping_ratio"],
    )
    errors = np.concatenate([_errors(record, common) for record, _ in pairs])
    return StepFit(
        method=method,
        gain=common.gain,
        dead_time=common.dead_time,
        time_constant_1=common.time_constant_1,
        time_constant_2=common.time_constant_2,
        rms_error=float(np.sqrt(np.mean(errors**2))),
        steps=len(pairs),
        spread=spread,
        natural_frequency=common.natural_frequency,
        damping_ratio=common.damping_ratio,
    )


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _errors(record: StepRecord, model: StepModel) -> Array:
    """(n,) measured minus modelled, from the level at which the step began [rad]."""
    change = model.gain * record.request * model.unit_response(record.times)
    return record.measured - normalised(record).level - change
