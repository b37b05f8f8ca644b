r"""The steering actuator with a limited rate and play in its column: exact response and exact sensitivities.

Equations, with u the command in force in units of the angle, a1 = T1 + T2 and a2 = T1 T2 (2.25):

.. math::
    T_1 \dot x = u(t - L) - x, \qquad \dot y = \mathrm{clip}(v, \pm\rho), \quad v = (x - y) / T_2,
    \qquad |y - z| \le w / 2

z is what the angle sensor sees: it follows y only where y has used up the play w. The state is (y, v, z):
where nothing is clipped, y' = v and a2 v' = u - y - a1 v hold for complex poles too, so that without a limit
the model is that of ``second_order`` for every damping; a limit needs real T1 (before it) and T2 (within it).

Nothing is integrated numerically. Between two events the solution is a sum of exponentials (free) or a
straight line chased by one exponential (clipped). The events are: a command takes effect, a sample is taken,
the rate reaches its limit or leaves it, y turns (where play holds its extreme). The sensitivities are carried
along; only where a command takes effect is the field discontinuous, and there a shift of its time by d\tau
makes v jump by (u_before - u_after) / a2 d\tau.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from ident.dynamics.second_order import _hyperbolic

Array = NDArray[np.float64]

ROLES = 6  # columns with a meaning of their own, before those of the caller
FIRST, SECOND, DEAD_TIME, LIMIT, WIDTH, SHIFT = range(ROLES)
BISECTIONS = 60
NEWTON_STEPS = 40
EPSILON = 1e-13  # relative, of a rate at its limit

_A1, _A2, _T1, _T2, _RHO, _W = range(6)


@numba.njit("UniTuple(float64, 2)(float64, float64, float64, float64[::1])", cache=True, error_model="numpy")
def _free(deviation: float, v: float, t: float, lag: Array) -> tuple[float, float]:
    """Deviation y - u and v after the time t without a limit."""
    a1, a2 = lag[_A1], lag[_A2]
    sigma = a1 / (2 * a2)
    cosine, s, _ = _hyperbolic(sigma, sigma * sigma - 1 / a2, t)
    c = cosine + sigma * s
    return c * deviation + s * v, c * v - s * (deviation + a1 * v) / a2


@numba.njit(
    "void(float64, float64, float64[::1], float64[:, ::1], float64[::1], float64[:, ::1])",
    cache=True,
    error_model="numpy",
)
def _free_step(u: float, t: float, lag: Array, chain: Array, state: Array, sens: Array) -> None:
    """Move state (y, v, z) and the sensitivities of y and v by the time t, without a limit.

    ``sens`` has a fourth row, the sensitivities of u.
    """
    a1, a2 = lag[_A1], lag[_A2]
    sigma = a1 / (2 * a2)
    delta = sigma * sigma - 1 / a2
    cosine, s, s_delta = _hyperbolic(sigma, delta, t)
    c = cosine + sigma * s
    c_sigma = -t * cosine + s - sigma * t * s
    c_delta = 0.5 * t * s + sigma * s_delta
    e, v = state[0] - u, state[1]
    pull = -(e + a1 * v) / a2
    for k in range(sens.shape[1]):
        de = sens[0, k] - sens[3, k]
        dv = sens[1, k]
        sens[0, k] = sens[3, k] + c * de + s * dv
        sens[1, k] = c * dv - s * (de + a1 * dv) / a2
    for k in range(min(2, sens.shape[1])):
        d1, d2 = chain[k, _A1], chain[k, _A2]
        d_sigma = d1 / (2 * a2) - sigma / a2 * d2
        d_delta = 2 * sigma * d_sigma + d2 / (a2 * a2)
        dc = c_sigma * d_sigma + c_delta * d_delta
        ds = -t * s * d_sigma + s_delta * d_delta
        sens[0, k] += dc * e + ds * v
        sens[1, k] += dc * v + ds * pull + s * (-(d1 * v) - pull * d2) / a2
    state[0] = u + c * e + s * v
    state[1] = c * v + s * pull


@numba.njit(
    "void(float64, float64, float64, float64[::1], float64[:, ::1], float64[::1], float64[:, ::1])",
    cache=True,
    error_model="numpy",
)
def _clipped_step(
    u: float, t: float, sign: float, lag: Array, chain: Array, state: Array, sens: Array
) -> None:
    """Move state and sensitivities by the time t while the rate is ``sign`` times its limit."""
    first, second, rho = lag[_T1], lag[_T2], lag[_RHO]
    decay = math.exp(-t / first)
    y, v = state[0], state[1]
    x = y + second * v
    after = u + (x - u) * decay
    state[0] = y + sign * rho * t
    state[1] = (after - state[0]) / second
    for k in range(sens.shape[1]):
        d_first = chain[k, _T1] if k < 2 else 0.0
        d_second = chain[k, _T2] if k < 2 else 0.0
        dx = sens[0, k] + d_second * v + second * sens[1, k]
        dx = sens[3, k] * (1 - decay) + dx * decay + (x - u) * decay * t / (first * first) * d_first
        sens[0, k] += sign * t if k == LIMIT else 0.0
        sens[1, k] = (dx - sens[0, k] - d_second * state[1]) / second


@numba.njit("float64(float64, float64, float64[::1], float64)", cache=True, error_model="numpy")
def _leaves(ahead: float, left: float, lag: Array, at: float) -> float:
    """|x - y| - rho T2 after the time ``at``, from |u - y| and what x has left to go beyond u now."""
    return float(ahead - lag[_RHO] * (lag[_T2] + at) + left * math.exp(-at / lag[_T1]))


@numba.njit("float64(float64, float64, float64, float64[::1], float64[::1])", cache=True, error_model="numpy")
def _exit_time(u: float, t: float, sign: float, lag: Array, state: Array) -> float:
    """When within t the rate leaves its limit, t where it does not.

    What is asked to vanish is a falling convex or a concave function that begins above zero: it has one root,
    where it ends below zero, and Newton's method goes to it monotonically, from the side that is not curved
    away.
    """
    ahead = sign * (u - state[0])
    left = sign * (state[0] + lag[_T2] * state[1] - u)
    if _leaves(ahead, left, lag, t) >= 0:
        return t
    at = 0.0 if left > 0 else t
    for _ in range(NEWTON_STEPS):
        value = _leaves(ahead, left, lag, at)
        slope = -lag[_RHO] - left / lag[_T1] * math.exp(-at / lag[_T1])
        step = value / slope
        at -= step
        if abs(step) <= 1e-15 * t:
            break
    return min(max(at, 0.0), t)


@numba.njit(
    "float64(int64, float64, float64, float64, float64, float64, float64, float64[::1])",
    cache=True,
    error_model="numpy",
)
def _crossing(
    what: int, level: float, sign: float, low: float, high: float, e: float, v: float, lag: Array
) -> float:
    """Where between low and high ``sign`` times v (what = 0) or v' (what = 1) passes a level, from below."""
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        ee, vv = _free(e, v, middle, lag)
        value = vv if what == 0 else -(ee + lag[_A1] * vv) / lag[_A2]
        if sign * value < level:
            low = middle
        else:
            high = middle
        if high - low <= 1e-16 * high:
            break
    return high


@numba.njit(
    "Tuple((float64, float64))(float64, float64, float64[::1], float64[::1])", cache=True, error_model="numpy"
)
def _entry(u: float, t: float, lag: Array, state: Array) -> tuple[float, float]:
    """When within t the rate reaches its limit, and on which side; (t, 0) where it does not."""
    e, v, rho = state[0] - u, state[1], lag[_RHO]
    ee, vv = _free(e, v, t, lag)
    if abs(vv) > rho * (1 + EPSILON):
        sign = 1.0 if vv > 0 else -1.0
        return _crossing(0, rho, sign, 0.0, t, e, v, lag), sign
    before = -(e + lag[_A1] * v) / lag[_A2]
    after = -(ee + lag[_A1] * vv) / lag[_A2]
    if before * after >= 0 or max(abs(v), abs(vv)) + 2 * t * max(abs(before), abs(after)) < rho:
        return t, 0.0
    sign = 1.0 if before > 0 else -1.0
    top = _crossing(1, 0.0, -sign, 0.0, t, e, v, lag)
    _, highest = _free(e, v, top, lag)
    if sign * highest <= rho * (1 + EPSILON):
        return t, 0.0
    return _crossing(0, rho, sign, 0.0, top, e, v, lag), sign


@numba.njit("void(float64, float64[::1], float64[:, ::1])", cache=True, error_model="numpy")
def _follow(width: float, state: Array, sens: Array) -> None:
    """Let z follow y through the play."""
    side = 0.0
    if width > 0 and abs(state[0] - state[2]) <= 0.5 * width:
        return
    if width > 0:
        side = -0.5 if state[0] > state[2] else 0.5
    state[2] = state[0] + side * width
    for k in range(sens.shape[1]):
        sens[2, k] = sens[0, k]
    if sens.shape[1]:
        sens[2, WIDTH] += side


@numba.njit("float64(float64, float64[::1], float64[::1])", cache=True, error_model="numpy")
def _side(u: float, lag: Array, state: Array) -> float:
    """Sign of the limit at which the rate is held now, zero where it is free."""
    v = state[1]
    if not abs(v) >= lag[_RHO] * (1 - EPSILON):
        return 0.0
    sign = 1.0 if v > 0 else -1.0
    grows = sign * (u - state[0] - (lag[_T1] + lag[_T2]) * v)
    return sign if abs(v) > lag[_RHO] * (1 + EPSILON) or grows > 0 else 0.0


@numba.njit(
    "void(float64, float64, float64[::1], float64[:, ::1], float64[::1], float64[:, ::1])",
    cache=True,
    error_model="numpy",
)
def _advance(u: float, t: float, lag: Array, chain: Array, state: Array, sens: Array) -> None:
    """Move by the time t under one command."""
    side = _side(u, lag, state)
    limited = lag[_RHO] < math.inf
    for _ in range(8):  # a free and a clipped part in turn: at most four under one command
        if side != 0:
            part = _exit_time(u, t, side, lag, state)
            _clipped_step(u, part, side, lag, chain, state, sens)
            _follow(lag[_W], state, sens)
            next_side = 0.0
        else:
            part, next_side = t, 0.0
            if limited:
                part, next_side = _entry(u, t, lag, state)
            _, v = _free(state[0] - u, state[1], part, lag)
            if lag[_W] > 0 and v * state[1] < 0:
                sign = 1.0 if v > 0 else -1.0
                turn = _crossing(0, 0.0, sign, 0.0, part, state[0] - u, state[1], lag)
                _free_step(u, turn, lag, chain, state, sens)
                _follow(lag[_W], state, sens)
                _free_step(u, part - turn, lag, chain, state, sens)
            else:
                _free_step(u, part, lag, chain, state, sens)
            _follow(lag[_W], state, sens)
        t -= part
        side = next_side
        if t <= 0:
            break


@numba.njit(
    "void(float64[::1], float64[:, ::1], float64, float64[::1], float64[::1], float64[:, ::1], float64[::1],"
    " float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1])",
    cache=True,
    error_model="numpy",
)
def _respond(
    lag: Array,
    chain: Array,
    dead_time: float,
    command_times: Array,
    command_values: Array,
    by_command: Array,
    times: Array,
    state: Array,
    sens: Array,
    out: Array,
    sensitivities: Array,
) -> None:
    """Fill ``out`` with z, y, y' and ``sensitivities`` with those of z; the first command holds at first."""
    width = sens.shape[1]
    now = times[0]
    j = 0
    while j + 1 < command_times.size and command_times[j + 1] + dead_time <= now:
        j += 1
    for k in range(width):
        sens[3, k] = by_command[j, k]
    for i in range(times.size):
        while j + 1 < command_times.size and command_times[j + 1] + dead_time <= times[i]:
            change = command_times[j + 1] + dead_time
            if change > now:
                _advance(command_values[j], change - now, lag, chain, state, sens)
                now = change
            j += 1
            if width:
                jump = (command_values[j - 1] - command_values[j]) / lag[_A2]
                sens[1, DEAD_TIME] += jump
                sens[1, SHIFT] += jump if j == 1 else 0.0
            for k in range(width):
                sens[3, k] = by_command[j, k]
        if times[i] > now:
            _advance(command_values[j], times[i] - now, lag, chain, state, sens)
            now = times[i]
        out[i, 0] = state[2]
        out[i, 1] = state[0]
        out[i, 2] = min(max(state[1], -lag[_RHO]), lag[_RHO])
        for k in range(width):
            sensitivities[i, k] = sens[2, k]


@dataclass(frozen=True)
class Lags:
    """The lags and what limits them, with the derivatives to two coordinates of the caller's choice.

    sum_of_lags, product_of_lags : a1 [s], a2 [s²]
    first, second : T1 and T2 [s]; only used where the rate is limited
    chain : (2, 4) derivatives of (a1, a2, T1, T2) to the two coordinates
    rate : limit ρ, in the unit of the angle a second; infinite where there is none
    width : w of the play, in the unit of the angle; zero where there is none
    """

    sum_of_lags: float
    product_of_lags: float
    first: float
    second: float
    chain: Array
    rate: float = math.inf
    width: float = 0.0


def by_ratio(sum_of_lags: float, ratio: float) -> Lags:
    """Lags from a1 [s] and T1 T2 / a1²: real or complex poles, without a limit."""
    chain = np.array([[1.0, 2 * ratio * sum_of_lags, 0.0, 0.0], [0.0, sum_of_lags**2, 0.0, 0.0]])
    return Lags(sum_of_lags, ratio * sum_of_lags**2, 0.0, 0.0, chain)


def by_skew(sum_of_lags: float, skew: float) -> Lags:
    """Lags from a1 [s] and (T1 - T2) / a1, between -1 and 1: real poles."""
    half = 0.5 * sum_of_lags
    first, second = half * (1 + skew), half * (1 - skew)
    chain = np.array(
        [
            [1.0, half * (1 - skew**2), 0.5 * (1 + skew), 0.5 * (1 - skew)],
            [0.0, -half * sum_of_lags * skew, half, -half],
        ]
    )
    return Lags(sum_of_lags, first * second, first, second, chain)


def nonlinear_response(
    lags: Lags,
    dead_time: float,
    command: tuple[Array, Array, Array],
    times: Array,
    start: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Response to a held command, with the exact sensitivities of what the angle sensor sees.

    Parameters
    ----------
    lags : the dynamics
    dead_time : L [s]
    command : (m,) strictly increasing times from which each value is held [s], the first value also before;
        (m,) values in the unit of the angle; (m, k) their derivatives to the k columns
    times : (n,) increasing times of the output [s]
    start : (3,) y, y' (as if not limited) and z at ``times[0]``; (3, k) their derivatives to the columns

    Returns
    -------
    out : (n, 3) z, y, y'
    sensitivities : (n, k) of z; the first ``ROLES`` columns are those to the two coordinates of the lags, the
        dead time, the limit, the width and the time of command 1, each beside what the caller gives for it;
        none where k is zero
    """
    state, sens = np.array(start[0], dtype=np.float64), np.zeros((4, start[1].shape[1]))
    sens[:3] = start[1]
    values = (lags.sum_of_lags, lags.product_of_lags, lags.first, lags.second, lags.rate, lags.width)
    out = np.empty((times.size, 3))
    sensitivities = np.empty((times.size, sens.shape[1]))
    if times.size:
        _follow(lags.width, state, sens)
        sent, driven, by_command = (np.ascontiguousarray(part, dtype=np.float64) for part in command)
        _respond(
            np.array(values),
            np.ascontiguousarray(lags.chain),
            dead_time,
            sent,
            driven,
            by_command,
            np.ascontiguousarray(times, dtype=np.float64),
            state,
            sens,
            out,
            sensitivities,
        )
    return out, sensitivities
