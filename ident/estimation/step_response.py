r"""Step-response methods for K exp(-L s) / ((T1 s + 1)(T2 s + 1)), one step at a time.

* 63.2 % (2.15-2.16): K = dy/du, tau = t_63 - L, one lag.
* Modified Harriott (2.20-2.23): t_72 is when 72 % of the change is reached;
  sum = (t_72 - L)/1.25; at t_z = L + 0.4 (t_72 - L) responses of different z = T1/(T1 + T2) differ most, and
  z is read from the curve y_z(z); T1 = z sum, T2 = (1 - z) sum. Where y_z lies below the lower end of the
  curve the dead time is raised, where it lies above the upper end it is lowered.

The curves are computed from the exact step response, never read from a figure. With the time scaled by
T1 + T2 the response is 1 - (z exp(-t/z) - (1-z) exp(-t/(1-z)))/(2z - 1).

Dead time: the source reads it off the plot. Here the early response of two lags, y ~ (t - L)²/(2 T1 T2),
is made a line by its square root and extrapolated to zero; a first-order start is steeper than that line
and gives an L that is late by a fraction of a sample.

These are hand methods, reported beside the likelihood. They assume that the step begins and ends at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from ident.dynamics.second_order import step_response
from ident.errors import NotIdentifiable
from ident.results import StepFit, StepMethod

Array = NDArray[np.float64]

HARRIOTT_LEVEL = 0.72
HARRIOTT_TIME = 1.25  # t_72 - L over T1 + T2, the source's mean over z
EARLY = 0.4  # t_z - L over t_72 - L
EARLY_BAND = (
    0.01,
    0.06,
)  # of the change: where the start is a parabola; from 4 to 12 sigma where that is more
AROUND = 0.08  # of the change: samples about a level through which a line gives its time
SETTLED = 0.02  # of the change: largest move over the last fifth of the hold
TAIL = 0.2
FEWEST = 3
ALMOST_FIRST = 1 - 1e-6
DEAD_TIME_STEPS = 60
NO_LAG = 1e-6  # T1 T2 / (T1 + T2)² that stands for a single lag


@dataclass(frozen=True)
class StepRecord:
    """The answer to one step of the request.

    times : (n,) time since the step [s], some before zero
    measured : (n,) [rad]
    request : size of the step, signed [rad]
    """

    times: Array
    measured: Array
    request: float


@dataclass(frozen=True)
class StepModel:
    """What a step method gives; ``time_constant_2`` is None for one lag.

    level : measured value before the step [rad]
    """

    gain: float
    dead_time: float
    time_constant_1: float
    time_constant_2: float | None
    level: float
    rms_error: float


def combined(method: StepMethod, records: Sequence[StepRecord], models: Sequence[StepModel]) -> StepFit:
    """Medians over steps, their spread, and how well the median model describes all of them.

    records, models : one each a step that the method could use
    """
    if not models:
        return StepFit(method, None, None, None, None, None, 0, reason="no step begins and ends at rest")
    names = ("gain", "dead_time", "time_constant_1", "time_constant_2")
    columns = {name: [getattr(m, name) for m in models] for name in names}
    middle = {name: _median(values) for name, values in columns.items()}
    spread = {
        name: float(np.std(values, ddof=1)) if len(models) > 1 and middle[name] is not None else None
        for name, values in columns.items()
    }
    errors = [_errors(record, model, middle) for record, model in zip(records, models, strict=True)]
    rms = float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))
    return StepFit(
        method=method,
        gain=middle["gain"],
        dead_time=middle["dead_time"],
        time_constant_1=middle["time_constant_1"],
        time_constant_2=middle["time_constant_2"],
        rms_error=rms,
        steps=len(models),
        spread=spread,
    )


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _errors(record: StepRecord, model: StepModel, middle: Mapping[str, float | None]) -> Array:
    """(n,) measured minus the median model, from the level at which the step began [rad]."""
    first, second = middle["time_constant_1"] or 0.0, middle["time_constant_2"] or 0.0
    change = (middle["gain"] or 0.0) * record.request
    shape = _two_lags(record.times - (middle["dead_time"] or 0.0), first, second)
    return record.measured - model.level - change * shape


def _two_lags(t: Array, first: float, second: float) -> Array:
    total = first + second
    return step_response(total, max(first * second, NO_LAG * total**2), t)


@dataclass(frozen=True)
class _Response:
    """A step response from zero to one.

    times : (n,) since the step [s]; y : (n,) share of the change reached
    level : value before [rad]; change : final change [rad]; noise : standard deviation of y
    """

    times: Array
    y: Array
    level: float
    change: float
    noise: float


def first_order_63(record: StepRecord) -> StepModel:
    """63.2 % method (2.15-2.16): one lag and a dead time.

    Raises
    ------
    NotIdentifiable
        If the step does not begin and end at rest, or is too small for its noise.
    """
    response = _normalised(record)
    dead_time = _dead_time(response)
    constant = _time_of(response, 1 - np.exp(-1.0)) - dead_time
    if constant <= 0:
        raise NotIdentifiable("63.2 % is reached before the dead time ends: sample faster")
    return _model(record, response, (dead_time, constant, None))


def modified_harriott(record: StepRecord) -> StepModel:
    """Two lags and a dead time by the modified Harriott method (2.20-2.23), with t_72/sum = 1.25.

    Raises
    ------
    NotIdentifiable
        If the step does not begin and end at rest, is too small for its noise, or no dead time brings the
        early response onto the curve of two real lags.
    """
    response = _normalised(record)
    t_72 = _time_of(response, HARRIOTT_LEVEL)
    dead_time = _onto_curve(response, t_72, _dead_time(response))
    total = (t_72 - dead_time) / HARRIOTT_TIME
    z = _share(_early_level(response, t_72, dead_time))
    return _model(record, response, (dead_time, z * total, (1 - z) * total))


def early_level(z: float) -> float:
    """y_z: share of the change at 0.4 t_72, of two lags with T1 = z (T1 + T2); 0.270 ... 0.399."""
    return float(_unit_response(EARLY * scaled_time_72(z), z))


def scaled_time_72(z: float) -> float:
    """tau_72: time to 72 % over T1 + T2, of two lags with T1 = z (T1 + T2); 1.246 ... 1.273."""
    return float(brentq(lambda x: _unit_response(x, z) - HARRIOTT_LEVEL, 0.5, 3.0, xtol=1e-13))


def _unit_response(t: float, z: float) -> float:
    inside = min(z, ALMOST_FIRST)
    return float(step_response(1.0, inside * (1 - inside), np.array([t]))[0])


def _share(level: float) -> float:
    """The z in [0.5, 1] at which y_z(z) has the level; an end of it outside the curve."""
    low, high = early_level(0.5), early_level(1.0)
    if level <= low:
        return 0.5
    if level >= high:
        return 1.0
    return float(brentq(lambda z: early_level(z) - level, 0.5, 1.0, xtol=1e-10))


def _normalised(record: StepRecord) -> _Response:
    """Levels before and after, by their means; refuses what does not rest there."""
    times, measured = record.times, record.measured
    before = measured[times <= 0]
    hold = float(times[-1])
    tail = times > (1 - TAIL) * hold
    ahead = (times > (1 - 2 * TAIL) * hold) & ~tail
    if before.size == 0 or tail.sum() < FEWEST or ahead.sum() < FEWEST:
        raise NotIdentifiable(f"{times.size} samples in a hold of {hold:.2f} s: too few to see it settle")
    level = float(before.mean())
    change = float(measured[tail].mean()) - level
    noise = float(np.sqrt((measured[tail].var() + measured[ahead].var()) / 2))
    drift = abs(float(measured[tail].mean() - measured[ahead].mean()))
    allowed = SETTLED * abs(change) + 3 * noise / np.sqrt(tail.sum())
    if drift > allowed:
        moved = 100 * drift / max(abs(change), 1e-300)
        raise NotIdentifiable(
            f"never settles: it still moves by {moved:.0f} % of its change in the last fifth of a hold of "
            f"{hold:.2f} s, at most 2 %: hold the step longer"
        )
    if abs(change) < 10 * noise:
        raise NotIdentifiable(f"the change of {change:.3g} rad is not 10 times its noise of {noise:.2g} rad")
    _refuse_moving_start(times, measured, level, change, noise)
    return _Response(times, (measured - level) / change, level, change, noise / abs(change))


def _refuse_moving_start(times: Array, measured: Array, level: float, change: float, noise: float) -> None:
    before = measured[times <= 0]
    moved = float(np.abs(before - level).max())
    if moved > SETTLED * abs(change) + 5 * noise:
        share = 100 * moved / abs(change)
        raise NotIdentifiable(
            f"not at rest before the step: off by {share:.0f} % of the change, at most 2 %: wait longer"
        )


def _time_of(response: _Response, level: float) -> float:
    """Time at which the response passes a level: a line through the samples about its first crossing."""
    above = np.flatnonzero((response.y >= level) & (response.times > 0))
    if above.size == 0:
        raise NotIdentifiable(f"the response never reaches {100 * level:.0f} % of its change")
    crossing = int(above[0])
    band = max(AROUND, 3 * response.noise)
    left = right = crossing
    while left > 0 and response.y[left - 1] > level - band and response.times[left - 1] > 0:
        left -= 1
    while right + 1 < response.y.size and response.y[right + 1] < level + band:
        right += 1
        if right - left > response.y.size // 4:
            break
    left = min(left, crossing - 1)
    part = slice(max(left, 0), right + 1)
    slope, offset = np.polyfit(response.y[part] - level, response.times[part], 1)
    del slope
    return float(offset)


def _dead_time(response: _Response) -> float:
    """Where the square root of the early response, extended as a line, meets zero; at least zero."""
    t_half = _time_of(response, 0.5)
    low = max(EARLY_BAND[0], 4 * response.noise)
    high = max(EARLY_BAND[1], 3 * low)
    early = (response.times > 0) & (response.times < t_half) & (response.y > low) & (response.y < high)
    if early.sum() < FEWEST:
        begin = np.flatnonzero((response.times > 0) & (response.y > low))[0]
        early = np.zeros_like(early)
        early[begin : begin + FEWEST] = True
    root = np.sqrt(np.maximum(response.y[early], 0.0))
    slope, offset = np.polyfit(response.times[early], root, 1)
    if slope <= 0:
        raise NotIdentifiable("the early response does not rise: sample faster or step further")
    return float(np.clip(-offset / slope, 0.0, response.times[early][0]))


def _early_level(response: _Response, t_72: float, dead_time: float) -> float:
    """Share of the change reached at t_z = L + 0.4 (t_72 - L)."""
    at = dead_time + EARLY * (t_72 - dead_time)
    return float(np.interp(at, response.times, response.y))


def _onto_curve(response: _Response, t_72: float, dead_time: float) -> float:
    """Raise or lower the dead time until y_z lies on the curve of two real lags."""
    low, high = early_level(0.5), early_level(1.0)
    step = t_72 / DEAD_TIME_STEPS
    for _ in range(2 * DEAD_TIME_STEPS):
        level = _early_level(response, t_72, dead_time)
        if low <= level <= high:
            return dead_time
        dead_time += step if level < low else -step
        if not 0 <= dead_time < t_72:
            break
        step *= 0.95
    reached = _early_level(response, t_72, float(np.clip(dead_time, 0.0, t_72)))
    raise NotIdentifiable(
        f"{100 * reached:.0f} % of the change at 0.4 t_72, two real lags give {100 * low:.0f} to "
        f"{100 * high:.0f} %: underdamped, rate-limited or not a step"
    )


def _model(
    record: StepRecord, response: _Response, constants: tuple[float, float, float | None]
) -> StepModel:
    dead_time, first, second = constants
    shape = _two_lags(record.times - dead_time, first, second or 0.0)
    error = record.measured - response.level - response.change * shape
    if second is not None and second > first:
        first, second = second, first
    return StepModel(
        gain=response.change / record.request,
        dead_time=dead_time,
        time_constant_1=first,
        time_constant_2=second,
        level=response.level,
        rms_error=float(np.sqrt(np.mean(error**2))),
    )
