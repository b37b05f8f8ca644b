"""A steering actuator that may fall short: from the requests that are sent to the steering-wheel angle.

    request -> quantised -> dead zone -> gain -> dead time -> lag T1 -> lag T2, whose rate is limited and
    which may stick, or a resonance in its place -> play -> steering wheel

Each lag is carried exactly from one change of its input to the next, on a grid of half a millisecond and at
the arrivals of commands between its points; what is limited, stuck or resonant follows the grid.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .driving import Speed
from .injected import Injected, parameters_of
from .truth import Actuator

Array = NDArray[np.float64]

FULL_SPEED = 12.0  # [m/s] from which the actuator no longer depends on the speed
KINETIC = 0.25  # friction while moving over friction at rest
ARREST = 0.5  # pull at which a moving wheel comes to rest, over friction at rest


def wheel_angle(
    actuator: Actuator,
    injected: Sequence[Injected],
    sent_time: Array,
    sent: Array,
    grid: Array,
    speed: Speed,
    random: np.random.Generator,
) -> Array:
    """Angle of the steering wheel, at rest before the first command.

    Parameters
    ----------
    actuator : with two real lags, T2 not zero
    sent_time, sent : (m,) commands [s], [rad]
    grid : (n,) uniform times, from before the first arrival on [s]
    speed : of the truck
    random : for commands that are not heard

    Returns
    -------
    (n,) [rad]
    """
    acted = _acted_on(injected, sent, random)
    targets = actuator.gain * _gain_factor(injected, acted, sent_time, speed) * acted
    slow = actuator.time_constant_1 * _lag_factor(injected, speed(grid))
    limit = (parameters_of(injected, "steering_rate_limit") or {}).get("rate", np.inf)
    band = (parameters_of(injected, "steering_friction") or {}).get("band", 0.0)
    mode = parameters_of(injected, "steering_resonance") or {"frequency": 0.0, "damping": 0.0}
    angle = _two_lags(
        sent_time + actuator.dead_time,
        targets,
        grid,
        slow,
        float(actuator.time_constant_2),
        limit,
        band,
        mode["frequency"],
        mode["damping"],
    )
    return play(angle, (parameters_of(injected, "steering_column_play") or {}).get("width", 0.0))


def _acted_on(injected: Sequence[Injected], sent: Array, random: np.random.Generator) -> Array:
    """Commands after all that happens to them before the gain."""
    acted = sent.copy()
    if hold := parameters_of(injected, "command_hold"):
        deaf = random.random(len(sent)) < hold["probability"]
        deaf[0] = False
        heard = np.maximum.accumulate(np.where(deaf, 0, np.arange(len(sent))))
        acted = acted[heard]
    if (steps := parameters_of(injected, "command_quantisation")) and steps["step"] > 0.0:
        acted = steps["step"] * np.round(acted / steps["step"])
    if zone := parameters_of(injected, "steering_dead_zone"):
        acted = np.sign(acted) * np.maximum(np.abs(acted) - zone["width"], 0.0)
    if ceiling := parameters_of(injected, "request_saturation"):
        acted = ceiling["level"] * np.tanh(acted / ceiling["level"])
    return acted


def _gain_factor(injected: Sequence[Injected], acted: Array, time: Array, speed: Speed) -> Array:
    factor = np.ones_like(acted)
    if sides := parameters_of(injected, "steering_asymmetry"):
        factor += sides["gain_difference"] / 2.0 * np.sign(acted)
    if slopes := parameters_of(injected, "speed_dependent_steering"):
        factor += slopes["gain_slope"] * _slowness(speed(time))
    return factor


def _lag_factor(injected: Sequence[Injected], speed: Array) -> Array:
    slopes = parameters_of(injected, "speed_dependent_steering")
    return 1.0 + (slopes["lag_slope"] if slopes else 0.0) * _slowness(speed)


def _slowness(speed: Array) -> Array:
    """One at standstill, zero from ``FULL_SPEED`` on."""
    return np.maximum(0.0, 1.0 - speed / FULL_SPEED)


@njit(cache=True)
def play(driving: Array, width: float) -> Array:
    """What follows a part with play: it rests until the driving part has crossed the gap (n,)."""
    driven = np.empty_like(driving)
    at = driving[0]
    for k in range(len(driving)):
        at = min(max(at, driving[k] - width / 2.0), driving[k] + width / 2.0)
        driven[k] = at
    return driven


@njit(cache=True)
def _two_lags(
    arrival: Array,
    targets: Array,
    grid: Array,
    slow: Array,
    fast: float,
    limit: float,
    band: float,
    frequency: float,
    damping: float,
) -> Array:
    angles = np.zeros(len(grid))
    first, angle, rate, target, heard, stuck = 0.0, 0.0, 0.0, 0.0, 0, band > 0.0
    for k in range(len(grid) - 1):
        now = grid[k]
        while now < grid[k + 1]:
            while heard < len(arrival) and arrival[heard] <= now:
                target = targets[heard]
                heard += 1
            until = min(grid[k + 1], arrival[heard]) if heard < len(arrival) else grid[k + 1]
            step = until - now
            if frequency > 0.0:
                angle, rate = _resonant(first, angle, rate, step, frequency, damping)
            elif band > 0.0:
                angle, stuck = _sticking(first, angle, step, fast, band, stuck)
            else:
                angle = _limited(first, target, angle, step, slow[k], fast, limit)
            first = target + (first - target) * np.exp(-step / slow[k])
            now = until
        angles[k + 1] = angle
    return angles


@njit(cache=True)
def _limited(
    first: float, target: float, angle: float, step: float, slow: float, fast: float, limit: float
) -> float:
    """Second lag over a step in which the first one goes from ``first`` towards ``target``."""
    if abs(first - angle) / fast > limit:
        return angle + np.sign(first - angle) * limit * step
    distance = first - target
    if abs(slow - fast) < 1e-9:
        forced = distance * (1.0 + step / fast) * np.exp(-step / fast)
        free = target + forced + (angle - first) * np.exp(-step / fast)
    else:
        share = slow / (slow - fast) * distance
        decay_slow, decay_fast = np.exp(-step / slow), np.exp(-step / fast)
        free = target + share * decay_slow + (angle - target - share) * decay_fast
    return angle + min(max(free - angle, -limit * step), limit * step)


@njit(cache=True)
def _sticking(
    first: float, angle: float, step: float, fast: float, band: float, stuck: bool
) -> tuple[float, bool]:
    """Second lag with Coulomb friction: it breaks loose at ``band`` and rests again at less."""
    pull = first - angle
    if abs(pull) <= (band if stuck else ARREST * band):
        return angle, True
    goal = first - np.sign(pull) * KINETIC * band
    return goal + (angle - goal) * np.exp(-step / fast), False


@njit(cache=True)
def _resonant(
    first: float, angle: float, rate: float, step: float, frequency: float, damping: float
) -> tuple[float, float]:
    """One classical Runge-Kutta step of a mass on a spring that is pulled by the first lag."""
    square, damp = frequency**2, 2.0 * damping * frequency
    a1, r1 = rate, square * (first - angle) - damp * rate
    a2 = rate + step / 2.0 * r1
    r2 = square * (first - angle - step / 2.0 * a1) - damp * a2
    a3 = rate + step / 2.0 * r2
    r3 = square * (first - angle - step / 2.0 * a2) - damp * a3
    a4 = rate + step * r3
    r4 = square * (first - angle - step * a3) - damp * a4
    return (
        angle + step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
        rate + step / 6.0 * (r1 + 2.0 * r2 + 2.0 * r3 + r4),
    )
