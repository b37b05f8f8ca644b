"""The planar truck with whatever may be added to it, integrated by Runge-Kutta at 1 kHz (ISO 8855 axes).

The speed v is imposed. With the axle forces F_f, F_r across the wheels, δ_f and δ_r the road-wheel angles,

    m (v̇_y + v r) = F_f cos δ_f + F_r cos δ_r + Y,      I_z ṙ = l_f F_f cos δ_f - l_r F_r cos δ_r + N

and α = -atan(velocity across the wheel over that along it). What may be added, each absent at zero:

* angles: δ_f = δ - c_lag + ε φ, where T ċ_lag + c_lag = c F_f; δ_r = κ δ;
* tyres: Ḟ = (v/σ)(F_static - F); each of the two wheels of an axle carries half of the Magic Formula at its
  load share 1 ± q, with q = a_y m h χ/(t F_z) of the axle's static wheel load F_z, D in proportion to the
  load and B C D in proportion to F_z (1 - e F_z/F_z,static), so that the stiffness of an axle falls by s q²,
  where s = e/(1 - e) is its sensitivity;
  a factor on the friction and one on the stiffness over time; less force at the driven rear axle;
* forces and moments: wind, gusts, bank, scrub, damping, what sloshes, and a trailer on a hitch;
* the body rolls: φ̈ + 2 ζ ω φ̇ + ω² φ = ω² g_φ a_y, out of the turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .injected import Injected, parameters_of
from .truth import Planar
from .vehicle import GRAVITY, STEP, magic_formula

Array = NDArray[np.float64]

CRAWL = 0.1  # [m/s] least velocity along a wheel in its slip angle
ROUNDS = 30  # of loads and forces, at most
HITCH = 1.2  # [m] behind the rear axle
TRAILER_CG = 0.55  # of the trailer's length, behind the hitch
TRAILER_GYRATION = 1.9  # [m]

(
    MASS, INERTIA, L_F, L_R,
    B_F, C_F, D_F, E_F, B_R, C_R, D_R, E_R,
    COMPLIANCE, COMPLIANCE_LAG, ROLL_STEER, REAR_STEER,
    RELAX_F, RELAX_R, UNLOAD, SHIFT_F, SHIFT_R, DRIVE,
    ROLL_GAIN, ROLL_FREQUENCY, ROLL_DAMPING,
    YAW_DAMPING, SIDESLIP, SPEED_MOMENT, STEER_RATE, SCRUB,
    WIND, WIND_HEADING, WIND_ARM, BANK, BANK_HEADING, PLACE_BANK, PLACE_NUMBER,
    TRAILER_MASS, TRAILER_LENGTH, TRAILER_STIFFNESS, SLOSH_MASS, SLOSH_FREQUENCY, SLOSH_DAMPING,
    NUMBERS,
) = range(44)  # fmt: skip

STEER, STEER_RATE_IN, SPEED, PULL, SIDE_FORCE, TURNING_MOMENT, GRIP, STIFFNESS, INPUTS = range(9)
(
    V_Y, TURN, X, Y, HEADING, FORCE_F, FORCE_R, ROLL, ROLL_RATE, GIVEN_WAY, BEND, TRAILER_TURN, SLOSHED,
    SLOSH_RATE, STATES,
) = range(15)  # fmt: skip
FELT, ACROSS_RATE, TURN_RATE, FELT_COUNT = range(4)


@dataclass(frozen=True)
class Driven:
    """The truck at every step of 1 ms.

    time : (n,) [s]
    states : (n, STATES), columns as named in this module
    felt : (n,) lateral acceleration at the centre of gravity less that of gravity [m/s²]
    across_rate, turn_rate : (n,) derivatives of lateral velocity [m/s²] and yaw rate [rad/s²]
    speed, pull : (n,) [m/s], [m/s²]
    """

    time: Array
    states: Array
    felt: Array
    across_rate: Array
    turn_rate: Array
    speed: Array
    pull: Array


def simulate_truck(
    truck: Planar, injected: Sequence[Injected], time: Array, inputs: Array, pose: Array
) -> Driven:
    """Drive straight on at first, from a pose of the centre of gravity (x, y [m], heading [rad]).

    Parameters
    ----------
    time : (2 n + 1,) half steps [s]
    inputs : (2 n + 1, INPUTS) road-wheel angle as the linkage turns it [rad] and its derivative, speed,
        acceleration, side force [N], yaw moment [N m], factors on friction and stiffness
    """
    start = np.zeros(STATES)
    start[X], start[Y], start[HEADING] = pose
    states, rates = _integrate(start, np.ascontiguousarray(inputs), numbers(truck, injected), STEP)
    return Driven(time[::2], states, *rates.T, inputs[::2, SPEED], inputs[::2, PULL])


def numbers(truck: Planar, injected: Sequence[Injected]) -> Array:
    """Everything that the equations hold, in the order named in this module."""
    p = np.zeros(NUMBERS)
    body = truck.body
    p[MASS], p[INERTIA] = body.mass, body.yaw_inertia
    p[L_F], p[L_R] = body.cg_to_front_axle, body.cg_to_rear_axle
    for first, tyre in ((B_F, truck.front), (B_R, truck.rear)):
        p[first : first + 4] = tyre.stiffness, tyre.shape, tyre.peak, tyre.curvature
    p[ROLL_FREQUENCY] = p[COMPLIANCE_LAG] = p[TRAILER_LENGTH] = p[SLOSH_FREQUENCY] = 1.0
    for name, places in _PLACES.items():
        if values := parameters_of(injected, name):
            p[list(places.values())] = [values[one] for one in places]
    if values := parameters_of(injected, "roll_steer"):
        p[ROLL_GAIN], p[ROLL_FREQUENCY], p[ROLL_DAMPING] = 0.011, values["frequency"], 0.25
    if values := parameters_of(injected, "local_bank"):
        p[PLACE_NUMBER] = 2.0 * np.pi / values["wavelength"]
    if values := parameters_of(injected, "tyre_relaxation"):
        p[RELAX_F] = values.get("length_front", values["length"])
        p[RELAX_R] = values.get("length_rear", values["length"])
    if values := parameters_of(injected, "load_transfer"):
        _transfer(p, truck, values["sensitivity"], values["front_share"])
    return p


_PLACES: dict[str, dict[str, int]] = {
    "compliance_lag": {"compliance": COMPLIANCE, "time_constant": COMPLIANCE_LAG},
    "roll_steer": {"coefficient": ROLL_STEER},
    "rear_axle_steer": {"ratio": REAR_STEER},
    "combined_slip": {"strength": DRIVE},
    "body_roll": {"gain": ROLL_GAIN, "frequency": ROLL_FREQUENCY, "damping": ROLL_DAMPING},
    "quadratic_yaw_damping": {"coefficient": YAW_DAMPING},
    "sideslip_moment": {"coefficient": SIDESLIP},
    "speed_moment": {"coefficient": SPEED_MOMENT},
    "steer_rate_moment": {"coefficient": STEER_RATE},
    "tandem_scrub": {"moment": SCRUB},
    "crosswind": {"force": WIND, "heading": WIND_HEADING, "arm": WIND_ARM},
    "road_bank": {"angle": BANK, "heading": BANK_HEADING},
    "local_bank": {"angle": PLACE_BANK},
    "trailer": {"mass": TRAILER_MASS, "length": TRAILER_LENGTH, "stiffness": TRAILER_STIFFNESS},
    "slosh": {"mass": SLOSH_MASS, "frequency": SLOSH_FREQUENCY, "damping": SLOSH_DAMPING},
}


def _transfer(p: Array, truck: Planar, sensitivity: float, front_share: float) -> None:
    """Fill in how the load of a wheel moves with the lateral acceleration."""
    body = truck.body
    wheelbase = body.cg_to_front_axle + body.cg_to_rear_axle
    moved = body.mass * body.cg_height / body.track
    wheel_f = body.mass * GRAVITY * body.cg_to_rear_axle / wheelbase / 2.0
    wheel_r = body.mass * GRAVITY * body.cg_to_front_axle / wheelbase / 2.0
    p[UNLOAD] = sensitivity / (1.0 + sensitivity)
    p[SHIFT_F], p[SHIFT_R] = front_share * moved / wheel_f, (1.0 - front_share) * moved / wheel_r


@njit(cache=True)
def axle_force(
    slip: float, stiffness: float, shape: float, peak: float, curvature: float, shift: float, unload: float
) -> float:
    """Both wheels of an axle [N], of which one carries 1 + shift and one 1 - shift times its static load."""
    if unload == 0.0:
        return magic_formula(slip, stiffness, shape, peak, curvature)
    force = 0.0
    for share in (1.0 + shift, 1.0 - shift):
        if share > 0.0:
            slope = stiffness * (1.0 - unload * share) / (1.0 - unload)
            force += magic_formula(slip, slope, shape, share * peak / 2.0, curvature)
    return force


@njit(cache=True)
def _slip(steer: float, speed: float, across: float) -> float:
    along = speed * np.cos(steer) + across * np.sin(steer)
    return -np.arctan((across * np.cos(steer) - speed * np.sin(steer)) / max(along, CRAWL))


@njit(cache=True)
def _static(s: Array, u: Array, p: Array, front: float, rear: float, felt: float) -> tuple[float, float]:
    """Forces of both axles at a lateral acceleration that moves their loads [N]."""
    grip, stiff = u[GRIP], u[STIFFNESS] / u[GRIP]
    slip_f = _slip(front, u[SPEED], s[V_Y] + p[L_F] * s[TURN])
    slip_r = _slip(rear, u[SPEED], s[V_Y] - p[L_R] * s[TURN])
    f = axle_force(slip_f, stiff * p[B_F], p[C_F], grip * p[D_F], p[E_F], p[SHIFT_F] * felt, p[UNLOAD])
    r = axle_force(slip_r, stiff * p[B_R], p[C_R], grip * p[D_R], p[E_R], p[SHIFT_R] * felt, p[UNLOAD])
    driven = u[PULL] * (p[L_F] + p[L_R]) / (GRAVITY * p[L_F])
    return f, r * np.sqrt(max(0.0, 1.0 - p[DRIVE] * driven**2))


@njit(cache=True)
def _tyres(s: Array, u: Array, p: Array, front: float, rear: float) -> tuple[float, float, float, float]:
    """Forces that the axles have, and those that they tend to, front and rear [N]."""
    cosine_f, cosine_r = np.cos(front), np.cos(rear)
    have_f, have_r = s[FORCE_F], s[FORCE_R]
    felt, goal_f, goal_r = 0.0, 0.0, 0.0
    for _ in range(ROUNDS):
        goal_f, goal_r = _static(s, u, p, front, rear, felt)
        have_f = s[FORCE_F] if p[RELAX_F] > 0.0 else goal_f
        have_r = s[FORCE_R] if p[RELAX_R] > 0.0 else goal_r
        before, felt = felt, (have_f * cosine_f + have_r * cosine_r) / p[MASS]
        if p[UNLOAD] == 0.0 or abs(felt - before) < 1e-10:
            break
    return have_f, have_r, goal_f, goal_r


@njit(cache=True)
def _added(s: Array, u: Array, p: Array) -> tuple[float, float, float]:
    """Side force without gravity [N], yaw moment [N m] and what gravity adds to the acceleration [m/s²]."""
    v, r = u[SPEED], s[TURN]
    wind = p[WIND] * np.cos(s[HEADING] - p[WIND_HEADING])
    slope = p[BANK] * np.cos(s[HEADING] - p[BANK_HEADING]) + p[PLACE_BANK] * np.sin(p[PLACE_NUMBER] * s[X])
    sideslip = np.arctan(s[V_Y] / max(v, CRAWL))
    moment = u[TURNING_MOMENT] + p[WIND_ARM] * wind - p[YAW_DAMPING] * r * abs(r)
    moment += p[SPEED_MOMENT] * v**2 + p[STEER_RATE] * u[STEER_RATE_IN] - p[SCRUB] * r / max(v, CRAWL)
    moment -= p[SIDESLIP] * np.sin(sideslip) * abs(sideslip)
    return u[SIDE_FORCE] + wind, moment, -GRAVITY * np.sin(slope)


@njit(cache=True)
def _hitch(s: Array, u: Array, p: Array, felt: float, turning: float) -> tuple[float, float]:
    """Force of the trailer on the truck [N] and yaw acceleration of the trailer [rad/s²].

    felt, turning : accelerations that the truck would have without it and without gravity

    With H the force, J = I + m a², a_h the lateral acceleration of the hitch and F the force of its axle:
    J ω̇ = m a a_h - d F, H = F - m (a_h - a ω̇), and a_h follows from H and the truck.
    """
    mass, length, behind = p[TRAILER_MASS], p[TRAILER_LENGTH], p[L_R] + HITCH
    arm = TRAILER_CG * length
    inertia = mass * (TRAILER_GYRATION**2 + arm**2)
    sideways = s[V_Y] - behind * s[TURN] + u[SPEED] * s[BEND] - length * s[TRAILER_TURN]
    axle = -p[TRAILER_STIFFNESS] * np.arctan(sideways / max(u[SPEED], CRAWL))
    carried = mass * (1.0 - mass * arm**2 / inertia)
    free = felt - behind * turning
    yields = 1.0 / p[MASS] + behind**2 / p[INERTIA]
    force = (axle * (1.0 - mass * arm * length / inertia) - carried * free) / (1.0 + carried * yields)
    hitch = free + force * yields
    return force, (mass * arm * hitch - length * axle) / inertia


@njit(cache=True)
def _rates(s: Array, u: Array, p: Array, d: Array, out: Array) -> None:
    """Write the derivatives of the states into ``d`` and what is felt into ``out``."""
    v, r = u[SPEED], s[TURN]
    front = u[STEER] - s[GIVEN_WAY] + p[ROLL_STEER] * s[ROLL]
    rear = p[REAR_STEER] * u[STEER]
    have_f, have_r, goal_f, goal_r = _tyres(s, u, p, front, rear)
    side, moment, falling = _added(s, u, p)
    across_f, across_r = have_f * np.cos(front), have_r * np.cos(rear)
    w_s = p[SLOSH_FREQUENCY]
    spring = w_s**2 * s[SLOSHED] + 2.0 * p[SLOSH_DAMPING] * w_s * s[SLOSH_RATE]
    felt = (across_f + across_r + side + p[SLOSH_MASS] * spring) / (p[MASS] - p[SLOSH_MASS])
    turning = (p[L_F] * across_f - p[L_R] * across_r + moment) / p[INERTIA]
    trailer_turning = 0.0
    if p[TRAILER_MASS] > 0.0:
        force, trailer_turning = _hitch(s, u, p, felt, turning)
        felt += force / p[MASS]
        turning -= (p[L_R] + HITCH) * force / p[INERTIA]
    out[FELT], out[ACROSS_RATE], out[TURN_RATE] = felt, felt + falling - v * r, turning
    d[V_Y], d[TURN], d[HEADING] = felt + falling - v * r, turning, r
    d[X] = v * np.cos(s[HEADING]) - s[V_Y] * np.sin(s[HEADING])
    d[Y] = v * np.sin(s[HEADING]) + s[V_Y] * np.cos(s[HEADING])
    d[FORCE_F] = v / p[RELAX_F] * (goal_f - have_f) if p[RELAX_F] > 0.0 else 0.0
    d[FORCE_R] = v / p[RELAX_R] * (goal_r - have_r) if p[RELAX_R] > 0.0 else 0.0
    w = p[ROLL_FREQUENCY]
    d[ROLL] = s[ROLL_RATE]
    d[ROLL_RATE] = w**2 * (p[ROLL_GAIN] * felt - s[ROLL]) - 2.0 * p[ROLL_DAMPING] * w * s[ROLL_RATE]
    d[GIVEN_WAY] = (p[COMPLIANCE] * have_f - s[GIVEN_WAY]) / p[COMPLIANCE_LAG]
    d[BEND], d[TRAILER_TURN] = r - s[TRAILER_TURN], trailer_turning
    d[SLOSHED], d[SLOSH_RATE] = s[SLOSH_RATE], -felt - spring


@njit(cache=True)
def _integrate(start: Array, inputs: Array, p: Array, step: float) -> tuple[Array, Array]:
    count = (len(inputs) - 1) // 2
    states, felt = np.empty((count + 1, STATES)), np.empty((count + 1, FELT_COUNT))
    k1, k2, k3, k4 = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    trial, unused = np.empty(STATES), np.empty(FELT_COUNT)
    states[0] = start
    for k in range(count):
        now = states[k]
        _rates(now, inputs[2 * k], p, k1, felt[k])
        for i in range(STATES):
            trial[i] = now[i] + step / 2.0 * k1[i]
        _rates(trial, inputs[2 * k + 1], p, k2, unused)
        for i in range(STATES):
            trial[i] = now[i] + step / 2.0 * k2[i]
        _rates(trial, inputs[2 * k + 1], p, k3, unused)
        for i in range(STATES):
            trial[i] = now[i] + step * k3[i]
        _rates(trial, inputs[2 * k + 2], p, k4, unused)
        for i in range(STATES):
            states[k + 1, i] = now[i] + step / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
    _rates(states[count], inputs[2 * count], p, k1, felt[count])
    return states, felt
