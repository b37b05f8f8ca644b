"""The exact response of two lags with dead time to commands that are held between their send times.

With y the angle, K the gain, T1 and T2 the lags and u the command in force,

    T1 T2 ÿ + (T1 + T2) ẏ + y = K u(t - L).

Between two arrivals u is constant, so the deviation x = (y - K u, ẏ) obeys ẋ = A x and
x(t) = Φ(t) x(0) with Φ = e^(A t) in closed form: nothing is integrated step by step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .truth import Actuator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WheelState:
    """The steering wheel at one time: time [s], angle [rad], rate [rad/s], command in force [rad]."""

    time: float
    angle: float
    rate: float
    command: float


def held_response(
    actuator: Actuator, sent_time: Array, sent: Array, times: Array, initial: WheelState
) -> tuple[Array, Array]:
    """Angle and rate of the steering wheel at any times, for commands held from their send times.

    Parameters
    ----------
    actuator : gain, dead time and lags
    sent_time : (m,) send times, rising [s]; each command acts a dead time later
    sent : (m,) commands [rad]
    times : (n,) where the response is wanted, not before ``initial.time`` [s]
    initial : the wheel before the first arrival

    Returns
    -------
    angle, rate : (n,) [rad], [rad/s]

    Raises
    ------
    ValueError
        If a command arrives, or a time is asked for, before the initial state.
    """
    knots = np.concatenate([[initial.time], np.asarray(sent_time) + actuator.dead_time])
    targets = actuator.gain * np.concatenate([[initial.command], sent])
    if np.any(np.diff(knots) < 0.0) or np.any(np.asarray(times) < initial.time):
        raise ValueError("times must rise and must not lie before the initial state")
    states = _states_at(knots, targets, actuator, (initial.angle, initial.rate))
    interval = np.searchsorted(knots, times, side="right") - 1
    a11, a12, a21, a22 = transition(actuator, times - knots[interval])
    deviation = states[interval, 0] - targets[interval]
    rate = states[interval, 1]
    return targets[interval] + a11 * deviation + a12 * rate, a21 * deviation + a22 * rate


def _states_at(knots: Array, targets: Array, actuator: Actuator, start: tuple[float, float]) -> Array:
    """(m, 2) angle and rate at the knots, each carried to the next one exactly."""
    states = np.empty((len(knots), 2))
    angle, rate = start
    states[0] = start
    steps = zip(
        *(a.tolist() for a in transition(actuator, np.diff(knots))), targets[:-1].tolist(), strict=True
    )
    for k, (a11, a12, a21, a22, target) in enumerate(steps, start=1):
        deviation = angle - target
        angle, rate = target + a11 * deviation + a12 * rate, a21 * deviation + a22 * rate
        states[k] = angle, rate
    return states


def transition(actuator: Actuator, duration: Array) -> tuple[Array, Array, Array, Array]:
    """The entries of Φ(t) = e^(A t), row by row, for the deviation (angle, rate).

    With p1 = 1/T1, p2 = 1/T2, σ = (p1 + p2)/2 and d = (p2 - p1)/2, s = e^(-σt) sinh(dt)/d and
    c = e^(-σt) cosh(dt): Φ = [[c + σ s, s], [-p1 p2 s, c - σ s]]. Both are written with e^(-p1 t), so
    that neither overflows nor cancels; d may be imaginary. With T2 = 0 the rate follows the angle.
    """
    p1 = 1.0 / actuator.time_constant_1
    slow = np.exp(-p1 * duration)
    if actuator.time_constant_2 == 0:
        zero = np.zeros_like(duration)
        return slow.real, zero, (-p1 * slow).real, zero
    p2 = 1.0 / actuator.time_constant_2
    decay, half_distance = (p1 + p2) / 2.0, (p2 - p1) / 2.0
    cosine = slow * (1.0 + np.exp(-2.0 * half_distance * duration)) / 2.0
    if abs(half_distance) * np.max(duration, initial=0.0) < 1e-12:
        sine = slow * duration
    else:
        sine = -slow * np.expm1(-2.0 * half_distance * duration) / (2.0 * half_distance)
    return (
        (cosine + decay * sine).real,
        sine.real,
        (-p1 * p2 * sine).real,
        (cosine - decay * sine).real,
    )
