r"""The second-order lag with dead time in closed form, and its exact response to a held command.

Equation, with ``sum_of_lags`` a1 = T1 + T2 and ``product_of_lags`` a2 = T1 T2 (2.25):

.. math:: a_2 \ddot y + a_1 \dot y + y = u(t - L)

The pair (a1, a2) is used and not (T1, T2), because the response is a smooth function of it through
critical damping (T1 = T2), where (T1, T2) is singular, and into underdamped responses, which have no
real T1 and T2 at all.

Between two changes of a held command the deviation e = (y - u, y') obeys e' = A e, and
exp(A t) = c(t) I + s(t) A by the theorem of Cayley and Hamilton, with

    sigma = a1 / (2 a2),   delta = sigma² - 1 / a2
    s(t) = exp(-sigma t) sinh(sqrt(delta) t) / sqrt(delta)
    c(t) = exp(-sigma t) cosh(sqrt(delta) t) + sigma s(t)

which are analytic in delta: the hyperbolic functions turn into circular ones below zero. Nothing is
integrated numerically, so the only error is rounding.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SERIES_BELOW = 1e-4  # |delta t²| under which the series replaces the quotient (relative error < 1e-12)


@numba.njit("UniTuple(float64, 3)(float64, float64, float64)", cache=True, error_model="numpy")
def _hyperbolic(sigma: float, delta: float, t: float) -> tuple[float, float, float]:
    """exp(-sigma t) times cosh(x), sinh(x)/x t and the derivative of the latter to delta; x² = delta t²."""
    square = delta * t * t
    if square > SERIES_BELOW:
        root = math.sqrt(delta)
        slow = math.exp(-t * (sigma * sigma - delta) / (sigma + root))
        fast = math.exp(-t * (sigma + root))
        cosine = 0.5 * (slow + fast)
        sine = 0.5 * (slow - fast) / root
    elif square < -SERIES_BELOW:
        root = math.sqrt(-delta)
        decay = math.exp(-sigma * t)
        cosine = decay * math.cos(root * t)
        sine = decay * math.sin(root * t) / root
    else:
        decay = math.exp(-sigma * t)
        cosine = decay * (1 + square / 2 * (1 + square / 12))
        sine = decay * t * (1 + square / 6 * (1 + square / 20))
        return cosine, sine, decay * t**3 / 6 * (1 + square / 10 * (1 + square / 28))
    return cosine, sine, (t * cosine - sine) / (2 * delta)


@numba.njit(
    "void(float64, float64, float64, float64[::1], float64[::1], float64[::1],"
    " float64, float64, float64[:, ::1])",
    cache=True,
    error_model="numpy",
)
def _propagate(
    dead_time: float,
    a1: float,
    a2: float,
    command_times: Array,
    command_values: Array,
    times: Array,
    angle: float,
    rate: float,
    out: Array,
) -> None:
    """Fill ``out`` rows with y, y', dy/da1, dy/da2 at ``times``; the command is that of index 0 at first."""
    sigma = a1 / (2 * a2)
    delta = sigma * sigma - 1 / a2
    # Derivatives of (sigma, delta), of the two nonzero rows of A = [[0, 1], [-1/a2, -a1/a2]].
    sigma_1, sigma_2 = 1 / (2 * a2), -sigma / a2
    delta_1, delta_2 = sigma / a2, (1 / a2 - 2 * sigma * sigma) / a2
    k, f = 1 / a2, a1 / a2
    k_2, f_1, f_2 = -1 / (a2 * a2), 1 / a2, -a1 / (a2 * a2)
    angle_1 = rate_1 = angle_2 = rate_2 = 0.0
    now = times[0]
    j = 0
    while j + 1 < command_times.size and command_times[j + 1] + dead_time <= now:
        j += 1
    for i in range(times.size):
        while True:
            change = command_times[j + 1] + dead_time if j + 1 < command_times.size else math.inf
            until = min(change, times[i])
            t = until - now
            if t > 0:
                u = command_values[j]
                cosine, s, s_delta = _hyperbolic(sigma, delta, t)
                c = cosine + sigma * s
                # c and s are functions of (sigma, delta) alone.
                c_sigma = -t * cosine + s - sigma * t * s
                c_delta = 0.5 * t * s + sigma * s_delta
                s_1 = -t * s * sigma_1 + s_delta * delta_1
                s_2 = -t * s * sigma_2 + s_delta * delta_2
                c_1 = c_sigma * sigma_1 + c_delta * delta_1
                c_2 = c_sigma * sigma_2 + c_delta * delta_2
                e = angle - u
                push = -k * e - f * rate
                push_1 = -f_1 * rate
                push_2 = -k_2 * e - f_2 * rate
                new_1 = c_1 * e + s_1 * rate + c * angle_1 + s * rate_1
                new_2 = c_2 * e + s_2 * rate + c * angle_2 + s * rate_2
                slope_1 = c_1 * rate + s_1 * push + s * push_1 + c * rate_1 + s * (-k * angle_1 - f * rate_1)
                slope_2 = c_2 * rate + s_2 * push + s * push_2 + c * rate_2 + s * (-k * angle_2 - f * rate_2)
                angle, rate = u + c * e + s * rate, c * rate + s * push
                angle_1, angle_2, rate_1, rate_2 = new_1, new_2, slope_1, slope_2
                now = until
            if change > times[i]:
                break
            j += 1
        out[i, 0] = angle
        out[i, 1] = rate
        out[i, 2] = angle_1
        out[i, 3] = angle_2


def held_response(
    dead_time: float,
    sum_of_lags: float,
    product_of_lags: float,
    command_times: Array,
    command_values: Array,
    times: Array,
    *,
    initial_angle: float,
    initial_rate: float,
) -> Array:
    """Response of unit gain to a held command, with its exact derivatives.

    Parameters
    ----------
    dead_time : L [s]; may be negative, the command is then known in advance
    sum_of_lags : a1 = T1 + T2 [s], positive
    product_of_lags : a2 = T1 T2 [s²], positive
    command_times : (m,) strictly increasing times from which each value is held [s]; the first value
        also holds before its time
    command_values : (m,) [rad]
    times : (n,) increasing times of the output [s]
    initial_angle, initial_rate : y and y' at ``times[0]`` [rad], [rad/s]

    Returns
    -------
    (n, 4) : y, dy/dt, dy/da1, dy/da2. The derivative to the dead time is not a column: at a fixed
        initial state it is minus the rate of what the commands after the first sample have caused.
    """
    out = np.empty((times.size, 4))
    if times.size:
        _propagate(
            dead_time,
            sum_of_lags,
            product_of_lags,
            np.ascontiguousarray(command_times, dtype=np.float64),
            np.ascontiguousarray(command_values, dtype=np.float64),
            np.ascontiguousarray(times, dtype=np.float64),
            initial_angle,
            initial_rate,
            out,
        )
    return out


@numba.njit("void(float64, float64, float64[::1], float64[:, ::1])", cache=True, error_model="numpy")
def _free(a1: float, a2: float, since: Array, out: Array) -> None:
    """Fill the rows of ``out`` with c(t) and s(t)."""
    sigma = a1 / (2 * a2)
    delta = sigma * sigma - 1 / a2
    for i in range(since.size):
        if since[i] < 0:
            out[0, i] = 0.0
            out[1, i] = 0.0
        else:
            cosine, sine, _ = _hyperbolic(sigma, delta, since[i])
            out[0, i] = cosine + sigma * sine
            out[1, i] = sine


def free_response(sum_of_lags: float, product_of_lags: float, t: Array) -> tuple[Array, Array]:
    """c(t) and s(t): the response to an initial angle of one and to an initial rate of one; zero for t < 0.

    t : (n,) time since the initial state [s]
    """
    out = np.empty((2, t.size))
    _free(sum_of_lags, product_of_lags, np.ascontiguousarray(t, dtype=np.float64), out)
    return out[0], out[1]


def step_response(sum_of_lags: float, product_of_lags: float, t: Array) -> Array:
    """Response of unit gain to a unit step at t = 0, without dead time; zero for t < 0.

    t : (n,) time since the step [s]
    """
    angle, _ = free_response(sum_of_lags, product_of_lags, t)
    return np.where(t < 0, 0.0, 1.0 - angle)


def impulse_response(sum_of_lags: float, product_of_lags: float, t: Array) -> Array:
    """Response of unit gain to a unit impulse at t = 0 [1/s], without dead time; zero for t < 0.

    t : (n,) time since the impulse [s]
    """
    _, rate = free_response(sum_of_lags, product_of_lags, t)
    return rate / product_of_lags


def lags_from_time_constants(time_constant_1: float, time_constant_2: float) -> tuple[float, float]:
    """a1 = T1 + T2 [s] and a2 = T1 T2 [s²]."""
    return time_constant_1 + time_constant_2, time_constant_1 * time_constant_2


def time_constants(sum_of_lags: float, product_of_lags: float) -> tuple[float, float] | None:
    """T1 >= T2 [s], or None where the response is underdamped."""
    discriminant = sum_of_lags**2 / 4 - product_of_lags
    if discriminant < 0:
        return None
    larger = sum_of_lags / 2 + math.sqrt(discriminant)
    return larger, product_of_lags / larger
