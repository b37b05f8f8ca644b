"""Reading a step response: where it rests, when it passes a level, when it begins to move.

A response is brought to the scale from zero (the level before the step) to one (where it settles).
Everything here is a hand method, made repeatable: means over what is flat, lines through what is steep.

Dead time: the source reads it off the plot. Here the early response is extrapolated to zero: that of one lag,
y ~ (t - L)/T1, as a line, that of two, y ~ (t - L)²/(2 T1 T2), as a line through its square root, whichever
lies closer to the samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.second_order import step_response
from ident.errors import NotIdentifiable

Array = NDArray[np.float64]

EARLY_BAND = (0.01, 0.06)  # of the change: where the start is a parabola; 4 to 12 sigma where that is more
AROUND = 0.08  # of the change: samples about a level through which a line gives its time
SETTLED = 0.02  # of the change: largest move over the last fifth of the hold
TAIL = 0.2
FEWEST = 3
TANGENTS = 81  # places at which the slope is tried
PEAK_SAMPLES = 3  # on each side of the highest
SMALLEST_OVERSHOOT = 0.01
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
    """What a step method gives: one lag, two lags, or natural frequency and damping ratio.

    gain [-]; dead_time, time_constant_1, time_constant_2 [s]; natural_frequency [rad/s]; damping_ratio [-]
    """

    gain: float
    dead_time: float
    time_constant_1: float | None = None
    time_constant_2: float | None = None
    natural_frequency: float | None = None
    damping_ratio: float | None = None

    def unit_response(self, t: Array) -> Array:
        """(n,) response to a unit step at t = 0 without the gain, t [s]."""
        if self.natural_frequency is not None and self.damping_ratio is not None:
            total, product = 2 * self.damping_ratio / self.natural_frequency, self.natural_frequency**-2
        else:
            first, second = self.time_constant_1 or 0.0, self.time_constant_2 or 0.0
            total = first + second
            product = max(first * second, NO_LAG * total**2)
        return step_response(total, product, t - self.dead_time)


@dataclass(frozen=True)
class Response:
    """A step response from zero to one.

    times : (n,) since the step [s]; y : (n,) share of the change reached
    level : value before [rad]; change : final change [rad]; noise : standard deviation of y
    """

    times: Array
    y: Array
    level: float
    change: float
    noise: float


def normalised(record: StepRecord) -> Response:
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
    return Response(times, (measured - level) / change, level, change, noise / abs(change))


def _refuse_moving_start(times: Array, measured: Array, level: float, change: float, noise: float) -> None:
    before = measured[times <= 0]
    moved = float(np.abs(before - level).max())
    if moved > SETTLED * abs(change) + 5 * noise:
        share = 100 * moved / abs(change)
        raise NotIdentifiable(
            f"not at rest before the step: off by {share:.0f} % of the change, at most 2 %: wait longer"
        )


def time_of(response: Response, level: float) -> float:
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


def dead_time(response: Response) -> float:
    """Where the early response, extended as a line or a parabola, meets zero; at least zero."""
    t_half = time_of(response, 0.5)
    low = max(EARLY_BAND[0], 4 * response.noise)
    high = max(EARLY_BAND[1], 3 * low)
    early = (response.times > 0) & (response.times < t_half) & (response.y > low) & (response.y < high)
    if early.sum() < FEWEST:
        begin = np.flatnonzero((response.times > 0) & (response.y > low))[0]
        early = np.zeros_like(early)
        early[begin : begin + FEWEST] = True
    t, y = response.times[early], response.y[early]
    root = np.sqrt(np.maximum(y, 0.0))
    parabola, line = np.polyfit(t, root, 1), np.polyfit(t, y, 1)
    off_parabola = float(np.square(y - np.square(np.polyval(parabola, t))).sum())
    off_line = float(np.square(y - np.polyval(line, t)).sum())
    slope, offset = line if off_line < off_parabola else parabola
    if slope <= 0:
        raise NotIdentifiable("the early response does not rise: sample faster or step further")
    return float(np.clip(-offset / slope, 0.0, t[0]))


def steepest(response: Response) -> tuple[float, float, float]:
    """Time [s], level [-] and slope [1/s] of the tangent at the point of inflection.

    The slope is that of a line through the samples within a quarter of the time from 10 to 90 %.
    """
    begin, end = time_of(response, 0.1), time_of(response, 0.9)
    half = max((end - begin) / 8, 1e-9)
    best = (0.0, 0.0, 0.0)
    for middle in np.linspace(begin, end, TANGENTS):
        near = np.abs(response.times - middle) <= half
        if near.sum() < FEWEST:
            nearest = np.argsort(np.abs(response.times - middle))[:FEWEST]
            near = np.zeros_like(near)
            near[nearest] = True
        slope, level = np.polyfit(response.times[near] - middle, response.y[near], 1)
        if slope > best[2]:
            best = (float(middle), float(level), float(slope))
    return best


def overshoot(response: Response) -> tuple[float, float]:
    """Time [s] of the first peak, by a parabola through its top, and by how much it passes one [-].

    Raises
    ------
    NotIdentifiable
        If the response does not pass its final value by more than its noise.
    """
    top = int(np.argmax(response.y))
    near = slice(max(top - PEAK_SAMPLES, 0), top + PEAK_SAMPLES + 1)
    t, y = response.times[near] - response.times[top], response.y[near]
    bend, slope, level = np.polyfit(t, y, 2)
    at = float(np.clip(-slope / (2 * bend), t[0], t[-1])) if bend < 0 else 0.0
    height = float(level + slope * at + bend * at**2) - 1.0
    needed = max(SMALLEST_OVERSHOOT, 4 * response.noise)
    if height < needed:
        raise NotIdentifiable(
            f"overshoot of {100 * height:.1f} %, need {100 * needed:.1f} %: the response is not underdamped"
        )
    return float(response.times[top]) + at, height
