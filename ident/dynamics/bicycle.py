"""Dynamic bicycle (2.3-2.6) on a plane, with the longitudinal velocity taken from the log. ISO 8855 axes.

    m (v̇_y + v_x r) = F_f cos δ + F_r + effects,      I_z ṙ = l_f F_f cos δ - l_r F_r + effects

    α_f = δ - atan((v_y + l_f r)/v_x),      α_r = -atan((v_y - l_r r)/v_x)

States are those of the centre of gravity (CG). Slip angles have the source's sign: a positive one gives a
positive force. Axle forces are totals of both wheels (see ``tyres.tyre``).

Each slip angle is computed in the wheel's own frame, α = -atan(v_lateral/|v_along|), which is the equation
above for a truck that rolls forward, and holds in reverse as well. Below ``CRAWL`` the velocity along the
wheel is replaced by (v² + v_s²)/(2 v_s), so that a truck at standstill neither blows up nor creeps: a tyre
then resists sliding like a damper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr

from ident.dynamics.effects import ROAD_BANK, STEERING_OFFSET, Effect, Ports
from ident.dynamics.effects.effect import known_symbols
from ident.dynamics.symbols import guarded
from ident.dynamics.system import System
from ident.dynamics.tyres import TYRES

Array = NDArray[np.float64]

CRAWL = 1.0  # [m/s] velocity along the wheel below which the slip angle is no longer exact
STABLE_STEP = 1.0  # largest product of a substep and the fastest eigenvalue; RK4 is stable up to 2.78

STATES = ("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")
INPUTS = ("road_wheel_angle", "longitudinal_velocity")
BODY = ("mass", "yaw_inertia", "cg_to_front_axle", "cg_to_rear_axle")
MOUNTING = ("reference_x", "imu_x", "imu_y")


@dataclass(frozen=True)
class AxleForces:
    """Slip angles [rad] and lateral forces [N], each across its own wheels."""

    front_slip_angle: Expr
    rear_slip_angle: Expr
    front: Expr
    rear: Expr


def slip_angle(along: Expr, across: Expr, angle: Expr) -> Expr:
    """Slip angle of a wheel [rad], with the source's sign.

    along, across : velocity of the wheel's centre in the vehicle's frame [m/s]
    angle : of the wheel to the vehicle [rad]
    """
    if angle == 0:
        return -sympy.atan(across / guarded(along, CRAWL))
    cosine, sine = sympy.cos(angle), sympy.sin(angle)
    return -sympy.atan((across * cosine - along * sine) / guarded(along * cosine + across * sine, CRAWL))


def axle_forces(front: str, rear: str, ports: Ports, angle: Expr) -> AxleForces:
    """Forces of both axles at the velocities that the ports know.

    front, rear : kinds of tyres; angle : of the front wheels [rad]
    """
    known = ports.known
    along, across, turning = (known[n] for n in ("longitudinal_velocity", "lateral_velocity", "yaw_rate"))
    l_f, l_r = known["cg_to_front_axle"], known["cg_to_rear_axle"]
    slip_f = ports.through("front_slip_angle", slip_angle(along, across + l_f * turning, angle))
    slip_r = ports.through("rear_slip_angle", slip_angle(along, across - l_r * turning, sympy.Integer(0)))
    load = known["mass"] * 9.81 / (l_f + l_r)
    force_f = TYRES[front].force_at("front", slip_f, load * l_r)
    force_r = TYRES[rear].force_at("rear", slip_r, load * l_f)
    return AxleForces(
        slip_f,
        slip_r,
        ports.through("front_lateral_force", force_f),
        ports.through("rear_lateral_force", force_r),
    )


def tyre_parameters(front: str, rear: str) -> tuple[str, ...]:
    """Such as "front.cornering_stiffness", front axle first."""
    kinds = {"front": front, "rear": rear}
    return tuple(f"{axle}.{name}" for axle, kind in kinds.items() for name in TYRES[kind].names)


@cache
def bicycle(front: str, rear: str, effects: tuple[Effect, ...] = (STEERING_OFFSET, ROAD_BANK)) -> System:
    """Planar bicycle with one kind of tyres on each axle.

    Parameters
    ----------
    front, rear : kinds of tyres, names in ``TYRES``
    effects : what enters at its ports; every parameter of theirs is one of the system

    Returns
    -------
    System with, besides those of tyres and effects, the parameters mass [kg], yaw_inertia [kg m²],
    cg_to_front_axle, cg_to_rear_axle, reference_x (the point that logged pose and velocity refer to, forward
    of the CG), imu_x, imu_y (the IMU, from the CG) [m]
    """
    tyres = tyre_parameters(front, rear)
    ports = Ports(known_symbols(STATES, INPUTS, BODY, MOUNTING, tyres), effects)
    known = ports.known
    angle = ports.through("road_wheel_angle", known["road_wheel_angle"])
    forces = axle_forces(front, rear, ports, angle)
    across = forces.front * sympy.cos(angle)
    tyre_force = across + forces.rear
    tyre_moment = known["cg_to_front_axle"] * across - known["cg_to_rear_axle"] * forces.rear
    lateral_force = ports.through("lateral_force", tyre_force)
    turning = ports.through("yaw_moment", tyre_moment) / known["yaw_inertia"]
    states = planar_motion(known, lateral_force / known["mass"], turning)
    measured = measurements(ports, tyre_force / known["mass"], turning, forces)
    return System(
        f"bicycle_{front}_{rear}",
        states,
        INPUTS,
        (*BODY, *tyres, *MOUNTING, *ports.parameter_names()),
        measured,
    )


def planar_motion(known: Mapping[str, Expr], across: Expr, turning: Expr) -> dict[str, Expr]:
    """Derivatives of the states of the CG from its acceleration across [m/s²] and its yaw acceleration."""
    v_x, v_y, r, heading = (
        known[n] for n in ("longitudinal_velocity", "lateral_velocity", "yaw_rate", "heading")
    )
    return {
        "lateral_velocity": across - v_x * r,
        "yaw_rate": turning,
        "heading": r,
        "position_x": v_x * sympy.cos(heading) - v_y * sympy.sin(heading),
        "position_y": v_x * sympy.sin(heading) + v_y * sympy.cos(heading),
    }


def measurements(ports: Ports, specific_force: Expr, turning: Expr, forces: AxleForces) -> dict[str, Expr]:
    """What the sensors read: the IMU at its place, velocity and pose at the reference point.

    specific_force : force per mass that is not gravity, across at the CG [m/s²]
    """
    known = ports.known
    r, heading, reach = known["yaw_rate"], known["heading"], known["reference_x"]
    read = {
        "yaw_rate": r,
        "lateral_acceleration": specific_force + known["imu_x"] * turning - known["imu_y"] * r**2,
        "lateral_velocity": known["lateral_velocity"] + reach * r,
        "heading": heading,
        "position_x": known["position_x"] + reach * sympy.cos(heading),
        "position_y": known["position_y"] + reach * sympy.sin(heading),
    }
    measured = {name: ports.through(f"measured_{name}", value) for name, value in read.items()}
    return {
        **measured,
        "front_slip_angle": forces.front_slip_angle,
        "rear_slip_angle": forces.rear_slip_angle,
        "front_lateral_force": forces.front,
        "rear_lateral_force": forces.rear,
    }


def substeps_for(parameters: Mapping[str, float], speed: Array, steps: Array) -> NDArray[np.int64]:
    """How many RK4 steps each step of the grid needs to stay stable and accurate.

    At low speed a tyre is a stiff damper: the fastest eigenvalue of the bicycle goes with 1/v.

    Parameters
    ----------
    parameters : name -> value, with mass, yaw inertia, distances and both cornering stiffnesses
    speed : (n,) [m/s], any sign
    steps : (n,) [s]

    Returns
    -------
    (n,) at least 1
    """
    mass, inertia, l_f, l_r = (parameters[name] for name in BODY)
    c_f, c_r = (parameters[f"{axle}.cornering_stiffness"] for axle in ("front", "rear"))
    sliding, coupling = (c_f + c_r) / mass, (l_f * c_f - l_r * c_r) / np.sqrt(mass * inertia)
    spinning = (l_f**2 * c_f + l_r**2 * c_r) / inertia
    fastest = (sliding + spinning) / 2 + np.hypot((sliding - spinning) / 2, coupling)
    slow = np.abs(np.asarray(speed, dtype=np.float64))
    along = np.where(slow > CRAWL, slow, (slow**2 + CRAWL**2) / (2 * CRAWL))
    needed = np.ceil(np.abs(steps) * fastest / along / STABLE_STEP)
    return np.maximum(1, np.where(np.isfinite(needed), needed, 1)).astype(np.int64)
