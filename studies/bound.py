"""The Cramér-Rao bound of the steering parameters, from the simulated truck alone.

Derivatives are central differences of the generator's own response to everything that was *sent*, and the
noise is what the generator adds, with its exact autocovariance. Nothing of `ident` takes part.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from generator.actuator import WheelState, held_response
from generator.steering import SteeringSignals
from generator.truth import Actuator, Channel, Steering
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz, solve_triangular, toeplitz
from scipy.signal import lfilter

Array = NDArray[np.float64]

PARAMETERS = ("gain", "dead_time", "time_constant_1", "time_constant_2")
STEP = 1e-5  # relative
ORDER = 60  # of the autoregression that stands for the exact noise
SETTLING = 4096


def autocovariance(channel: Channel, lags: int) -> Array:
    """(lags + 1,) of the coloured, white and rounding errors together [rad²]."""
    impulse = np.zeros(SETTLING)
    impulse[0] = 1.0
    response = lfilter([1.0], np.concatenate([[1.0], -np.asarray(channel.noise_ar)]), impulse)
    coloured = np.array([response[: SETTLING - k] @ response[k:] for k in range(lags + 1)])
    total = channel.noise_std**2 * coloured / coloured[0]
    total[0] += channel.white_std**2 + channel.resolution**2 / 12
    return total


def whitened(columns: Array, channel: Channel) -> Array:
    """Columns filtered so that the channel's noise is white with variance one."""
    covariance = autocovariance(channel, ORDER)
    coefficients = solve_toeplitz(covariance[:-1], covariance[1:])
    variance = covariance[0] - coefficients @ covariance[1:]
    taps = np.concatenate([[1.0], -coefficients])
    white = lfilter(taps, [1.0], columns, axis=0) / np.sqrt(variance)
    start = np.linalg.cholesky(toeplitz(covariance[:ORDER]))
    white[:ORDER] = solve_triangular(start, columns[:ORDER], lower=True)
    return white


def derivatives(signals: SteeringSignals, actuator: Actuator) -> Array:
    """(n, 4) derivative of the true angle to each of PARAMETERS."""
    columns = []
    for name in PARAMETERS:
        value = getattr(actuator, name)
        ends = [response(signals, replace(actuator, **{name: value * (1 + sign * STEP)})) for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * STEP * value))
    return np.column_stack(columns)


def response(signals: SteeringSignals, actuator: Actuator) -> Array:
    """(n,) angle of the wheel at the stamps of the log, from rest before the first command [rad]."""
    at_rest = WheelState(time=float(signals.sent_time[0]) - 1.0, angle=0.0, rate=0.0, command=0.0)
    return held_response(actuator, signals.sent_time, signals.sent, signals.angle_time, at_rest)[0]


def bound(runs: list[SteeringSignals], truth: Steering) -> Array:
    """(4, 4) smallest covariance of PARAMETERS from all runs, each with an unknown bias."""
    channel = truth.angle.channels["angle"]
    information = np.zeros((4 + len(runs), 4 + len(runs)))
    for number, signals in enumerate(runs):
        columns = np.zeros((signals.angle_time.size, 4 + len(runs)))
        columns[:, :4] = derivatives(signals, truth.actuator)
        columns[:, 4 + number] = 1.0
        white = whitened(columns, channel)
        information += white.T @ white
    return np.linalg.inv(information)[:4, :4]
