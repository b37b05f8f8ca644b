"""Two trucks, integrated with the classical Runge-Kutta method at 1 kHz (ISO 8855 axes).

State (v_x, v_y, r, x, y, ψ) of the centre of gravity: velocities in the vehicle's frame [m/s], yaw rate
[rad/s], position [m], heading [rad]. Inputs: road-wheel angle δ [rad], speed to be driven [m/s] and its
derivative [m/s²].

Planar: v̇_x is imposed, and with α_f = δ - atan((v_y + l_f r)/v_x), α_r = -atan((v_y - l_r r)/v_x)

    v̇_y = (F_f cos δ + F_r)/m - v_x r,    I_z ṙ = l_f F_f cos δ - l_r F_r.

Two tracks: both front wheels turn by δ; each wheel has its own slip angle and load. The load moves at once
with the acceleration (roll is quasi-static): m a_y h/t in all, shared between the axles, and m a_x h/L to
the rear. Wheel forces act along the wheel's lateral axis, so that cornering slows the truck; the drive
force m (v̇_ref + k (v_ref - v_x)) acts at the rear axle and does not weaken the lateral forces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .truth import Body, Planar, TwoTrack, WheelTyre

Array = NDArray[np.float64]

STEP = 1e-3  # [s]
GRAVITY = 9.81  # [m/s²]
LOAD_ROUNDS = 100  # at most; each brings loads and forces about three times closer
LOAD_TOLERANCE = 1e-11  # [m/s²] change of the acceleration between rounds


@dataclass(frozen=True)
class Motion:
    """The truck at every step; rates are the derivatives of the states.

    time : (n,) [s]
    states, rates : (n, 6) v_x, v_y, r, x, y, ψ and their derivatives
    """

    time: Array
    states: Array
    rates: Array


def simulate(vehicle: Planar | TwoTrack, start: Array, time: float, inputs: Array) -> Motion:
    """Drive from one state on.

    Parameters
    ----------
    vehicle : the planar truck or that on two tracks
    start : (6,) state at ``time``
    time : [s]
    inputs : (2 n + 1, 3) steering-wheel angle [rad], speed [m/s] and acceleration [m/s²] to be
        driven, at every half step

    Returns
    -------
    Motion at the n + 1 whole steps
    """
    planar = isinstance(vehicle, Planar)
    road = inputs.copy()
    road[:, 0] /= vehicle.steering_ratio
    states, rates = _integrate(planar, np.asarray(start, dtype=np.float64), road, _numbers(vehicle), STEP)
    return Motion(time + STEP * np.arange(len(states)), states, rates)


def _numbers(vehicle: Planar | TwoTrack) -> Array:
    body = _body_numbers(vehicle.body)
    if isinstance(vehicle, Planar):
        front, rear = ((a.stiffness, a.shape, a.peak, a.curvature) for a in (vehicle.front, vehicle.rear))
        return np.array([*body, *front, *rear])
    wheels = (*_wheel_numbers(vehicle.front), *_wheel_numbers(vehicle.rear))
    return np.array([*body, vehicle.front_roll_share, vehicle.speed_gain, *wheels])


def _body_numbers(body: Body) -> tuple[float, ...]:
    return (
        body.mass,
        body.yaw_inertia,
        body.cg_to_front_axle,
        body.cg_to_rear_axle,
        body.track,
        body.cg_height,
    )


def _wheel_numbers(tyre: WheelTyre) -> tuple[float, ...]:
    return (
        tyre.stiffness_max,
        tyre.load_at_max,
        tyre.friction,
        tyre.friction_slope,
        tyre.nominal_load,
        tyre.shape,
        tyre.curvature,
    )


@njit(cache=True)
def magic_formula(slip: float, stiffness: float, shape: float, peak: float, curvature: float) -> float:
    """D sin(C atan(B α - E (B α - atan(B α)))) [N]."""
    stretched = stiffness * slip
    return peak * np.sin(shape * np.arctan(stretched - curvature * (stretched - np.arctan(stretched))))


@njit(cache=True)
def wheel_force(slip: float, load: float, tyre: Array) -> float:
    """Lateral force of one wheel [N] at its slip angle [rad] and load [N]."""
    stiffness_max, load_at_max, friction, slope, nominal, shape, curvature = tyre
    if load <= 0.0:
        return 0.0
    peak = friction * (1.0 - slope * (load - nominal) / nominal) * load
    cornering = stiffness_max * np.sin(2.0 * np.arctan(load / load_at_max))
    return magic_formula(slip, cornering / (shape * peak), shape, peak, curvature)


@njit(cache=True)
def _planar_forces(state: Array, steer: float, p: Array) -> tuple[float, float]:
    """Acceleration across [m/s²] and yaw acceleration [rad/s²]."""
    mass, inertia, l_f, l_r = p[0], p[1], p[2], p[3]
    v_x, v_y, r = state[0], state[1], state[2]
    front = magic_formula(steer - np.arctan((v_y + l_f * r) / v_x), p[6], p[7], p[8], p[9])
    rear = magic_formula(-np.arctan((v_y - l_r * r) / v_x), p[10], p[11], p[12], p[13])
    across = front * np.cos(steer)
    return (across + rear) / mass, (l_f * across - l_r * rear) / inertia


@njit(cache=True)
def _wheel_loads(p: Array, along: float, across: float) -> tuple[float, float, float, float]:
    """Loads [N] front left, front right, rear left, rear right at an acceleration [m/s²]."""
    mass, l_f, l_r, track, height, share = p[0], p[2], p[3], p[4], p[5], p[6]
    wheelbase = l_f + l_r
    front = mass * (GRAVITY * l_r - along * height) / wheelbase / 2.0
    rear = mass * (GRAVITY * l_f + along * height) / wheelbase / 2.0
    moved = mass * across * height / track
    return (
        front - share * moved,
        front + share * moved,
        rear - (1.0 - share) * moved,
        rear + (1.0 - share) * moved,
    )


@njit(cache=True)
def _two_track_forces(state: Array, steer: float, drive: float, p: Array) -> tuple[float, float, float]:
    """Accelerations along and across [m/s²] and yaw acceleration [rad/s²]."""
    mass, inertia, l_f, l_r, half = p[0], p[1], p[2], p[3], p[4] / 2.0
    v_x, v_y, r = state[0], state[1], state[2]
    slip_fl = steer - np.arctan((v_y + l_f * r) / (v_x - half * r))
    slip_fr = steer - np.arctan((v_y + l_f * r) / (v_x + half * r))
    slip_rl = -np.arctan((v_y - l_r * r) / (v_x - half * r))
    slip_rr = -np.arctan((v_y - l_r * r) / (v_x + half * r))
    sine, cosine = np.sin(steer), np.cos(steer)
    along, across, turning = drive, v_x * r, 0.0
    for _ in range(LOAD_ROUNDS):
        loads = _wheel_loads(p, along, across)
        front_left = wheel_force(slip_fl, loads[0], p[8:15])
        front_right = wheel_force(slip_fr, loads[1], p[8:15])
        rear = wheel_force(slip_rl, loads[2], p[15:22]) + wheel_force(slip_rr, loads[3], p[15:22])
        front = front_left + front_right
        before, along = across, drive - front * sine / mass
        across = (front * cosine + rear) / mass
        twist = half * (front_left - front_right) * sine
        turning = (l_f * front * cosine - l_r * rear + twist) / inertia
        if abs(across - before) < LOAD_TOLERANCE:
            break
    return along, across, turning


@njit(cache=True)
def _rates(planar: bool, state: Array, inputs: Array, p: Array) -> Array:
    v_x, v_y, r, heading = state[0], state[1], state[2], state[5]
    rates = np.empty(6)
    if planar:
        across, turning = _planar_forces(state, inputs[0], p)
        rates[0] = inputs[2]
    else:
        drive = inputs[2] + p[7] * (inputs[1] - v_x)
        along, across, turning = _two_track_forces(state, inputs[0], drive, p)
        rates[0] = along + v_y * r
    rates[1] = across - v_x * r
    rates[2] = turning
    rates[3] = v_x * np.cos(heading) - v_y * np.sin(heading)
    rates[4] = v_x * np.sin(heading) + v_y * np.cos(heading)
    rates[5] = r
    return rates


@njit(cache=True)
def _integrate(planar: bool, start: Array, inputs: Array, p: Array, step: float) -> tuple[Array, Array]:
    count = (len(inputs) - 1) // 2
    states = np.empty((count + 1, 6))
    rates = np.empty((count + 1, 6))
    states[0] = start
    for k in range(count):
        at, half, after = inputs[2 * k], inputs[2 * k + 1], inputs[2 * k + 2]
        first = _rates(planar, states[k], at, p)
        second = _rates(planar, states[k] + step / 2.0 * first, half, p)
        third = _rates(planar, states[k] + step / 2.0 * second, half, p)
        fourth = _rates(planar, states[k] + step * third, after, p)
        rates[k] = first
        states[k + 1] = states[k] + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    rates[count] = _rates(planar, states[count], inputs[2 * count], p)
    return states, rates
