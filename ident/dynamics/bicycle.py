"""Dynamic bicycle (2.3-2.6) on a plane, with the longitudinal velocity taken from the log. ISO 8855 axes.

    m (v̇_y + v_x r) = F_f cos δ + F_r + effects,      I_z ṙ = l_f F_f cos δ - l_r F_r + effects

    α_f = δ - atan((v_y + l_f r)/v_x),      α_r = -atan((v_y - l_r r)/v_x)

States are those of the centre of gravity (CG). Slip angles have the source's sign: a positive one gives a
positive force. Axle forces are totals of both wheels (see ``tyres.tyre``).

Each slip angle is computed in the wheel's own frame, α = -atan(v_across/|v_along|), which is the equation
above for a truck that rolls forward, and holds in reverse as well. Where the velocity along the wheel is
below ``CRAWL`` it is replaced by (v² + v_s²)/(2 v_s), so that a truck at standstill neither blows up nor
creeps on level ground: a tyre then resists sliding like a damper.

What effects may change, in the order in which it is passed: longitudinal_velocity, road_wheel_angle,
front_slip_angle, rear_slip_angle, load_shifting_acceleration (from the axles' force curves),
front_shifted_force and rear_shifted_force (with it), settled_acceleration (from these), then for each axle
front_working_slip (where its curve is read), front_axle_force (from the curve of both its wheels),
front_lateral_force (its static force) and front_tyre_force (that of the moment), felt_force (of tyres and
air), lateral_force (with gravity), yaw_moment, measured_<signal>.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr

from ident.dynamics.constants import GRAVITY
from ident.dynamics.effects import ROAD_BANK, STEERING_OFFSET, Effect, Ports
from ident.dynamics.effects.effect import ON_CURVE, known_symbols
from ident.dynamics.reference_point import (
    CG,
    ReferencePoint,
    moved_acceleration,
    moved_position,
    moved_velocity,
)
from ident.dynamics.symbols import guarded, symbol
from ident.dynamics.system import System
from ident.dynamics.tyres import Tyre, tyre_of
from ident.glossary import AXLES

Array = NDArray[np.float64]

CRAWL = 1.0  # [m/s] velocity along the wheel below which the slip angle is no longer exact
STABLE_STEP = 1.0  # largest product of a substep and the fastest eigenvalue; RK4 is stable up to 2.78

STATES = ("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")
INPUTS = ("road_wheel_angle", "longitudinal_velocity")
BODY = ("mass", "yaw_inertia", "cg_to_front_axle", "cg_to_rear_axle")
MOUNTING = ("reference_x", "imu_x", "imu_y")


@dataclass(frozen=True)
class Lateral:
    """Forces and accelerations of a bicycle at one state, after all effects.

    angle : of the front wheels [rad]
    slip_angles : front, rear [rad]
    axle_forces : front, rear, each across its own wheels [N]
    felt_force : of tyres and air across the vehicle [N]: mass times what an accelerometer at the CG feels
    lateral_force : with gravity, which no accelerometer feels [N]
    turning : yaw acceleration [rad/s²]
    """

    angle: Expr
    slip_angles: tuple[Expr, Expr]
    axle_forces: tuple[Expr, Expr]
    felt_force: Expr
    lateral_force: Expr
    turning: Expr


def tyre_parameters(front: str | Tyre, rear: str | Tyre) -> tuple[str, ...]:
    """Such as "front.cornering_stiffness", front axle first."""
    kinds = {"front": front, "rear": rear}
    return tuple(f"{axle}.{name}" for axle, kind in kinds.items() for name in tyre_of(kind).names)


@cache
def bicycle(
    front: str | Tyre, rear: str | Tyre, effects: tuple[Effect, ...] = (STEERING_OFFSET, ROAD_BANK)
) -> System:
    """Planar bicycle with one kind of tyres on each axle.

    Parameters
    ----------
    front, rear : kinds of tyres, names in ``TYRES``, or tyres made from a file (``tyres.pac2002_axle``)
    effects : what enters at its ports; every parameter of theirs is one of the system; their states, inputs
        and outputs follow those of the bicycle

    Returns
    -------
    System with, besides those of tyres and effects, the parameters mass [kg], yaw_inertia [kg m²],
    cg_to_front_axle, cg_to_rear_axle, reference_x (the point that logged pose and velocity refer to, forward
    of the CG), imu_x, imu_y (the IMU, from the CG) [m]
    """
    tyres = tyre_parameters(front, rear)
    ports = Ports(known_symbols(STATES, INPUTS, BODY, MOUNTING, tyres), effects)
    ports.through("longitudinal_velocity", ports.known["longitudinal_velocity"])
    lateral = lateral_dynamics(ports, front, rear)
    measured = measurements(ports, lateral)
    states = planar_motion(ports.known, lateral) | ports.states()
    inputs = (*INPUTS, *ports.inputs)
    parameters = (*BODY, *tyres, *MOUNTING, *ports.parameter_names())
    outputs = measured | ports.outputs()
    name = f"bicycle_{tyre_of(front).kind}_{tyre_of(rear).kind}"
    return System(name, states, inputs, parameters, outputs, ports.intermediates)


def lateral_dynamics(ports: Ports, front: str | Tyre, rear: str | Tyre) -> Lateral:
    """Forces and yaw acceleration at the state and inputs that the ports know.

    front, rear : kinds of tyres
    """
    known = ports.known
    l_f, l_r = known["cg_to_front_axle"], known["cg_to_rear_axle"]
    angle = ports.through("road_wheel_angle", known["road_wheel_angle"])
    front_wheel = wheel_velocity(*_velocity_at(known, l_f), angle)
    rear_wheel = wheel_velocity(*_velocity_at(known, -l_r), sympy.Integer(0))
    slip_f = ports.through("front_slip_angle", slip_angle(*_as_named(ports, "front", front_wheel)))
    slip_r = ports.through("rear_slip_angle", slip_angle(*_as_named(ports, "rear", rear_wheel)))
    force_f, force_r = _axle_forces(ports, (front, rear), (slip_f, slip_r), angle)
    across = force_f * sympy.cos(angle)
    felt = ports.through("felt_force", across + force_r)
    ports.named("felt_acceleration", felt / known["mass"])
    lateral_force = ports.through("lateral_force", felt)
    moment = ports.through("yaw_moment", l_f * across - l_r * force_r)
    turning = ports.named("yaw_acceleration", moment / known["yaw_inertia"])
    return Lateral(angle, (slip_f, slip_r), (force_f, force_r), felt, lateral_force, turning)


def _axle_forces(
    ports: Ports, kinds: tuple[str | Tyre, str | Tyre], slips: tuple[Expr, Expr], angle: Expr
) -> tuple[Expr, Expr]:
    """Forces front and rear after the effects.

    The curves, and the forces at the slip angles themselves, are there for effects that need them; no code
    comes of them in a model without such an effect.
    """
    axles = list(zip(AXLES, kinds, slips, strict=True))
    for axle, kind, _ in axles:
        ports.known[f"{axle}_curve"] = _curve(ports, axle, kind, symbol(ON_CURVE))
    front, rear = (
        ports.named(f"{axle}_curve_force", _curve(ports, axle, kind, s)) for axle, kind, s in axles
    )
    ports.through("load_shifting_acceleration", (front * sympy.cos(angle) + rear) / ports.known["mass"])
    for axle in AXLES:
        ports.through(f"{axle}_shifted_force", ports.known[f"{axle}_curve_force"])
    ports.through("settled_acceleration", ports.known["load_shifting_acceleration"])
    working = [(axle, kind, ports.through(f"{axle}_working_slip", s)) for axle, kind, s in axles]
    static = [
        (axle, ports.through(f"{axle}_axle_force", _curve(ports, axle, kind, slip)))
        for axle, kind, slip in working
    ]
    static = [(axle, ports.through(f"{axle}_lateral_force", force)) for axle, force in static]
    front, rear = (ports.through(f"{axle}_tyre_force", force) for axle, force in static)
    return front, rear


def _curve(ports: Ports, axle: str, kind: str | Tyre, slip: Expr) -> Expr:
    """Force of an axle at a slip angle, its load that at rest."""
    known = ports.known
    l_f, l_r = known["cg_to_front_axle"], known["cg_to_rear_axle"]
    load = known["mass"] * GRAVITY / (l_f + l_r) * (l_r if axle == "front" else l_f)
    tyre = tyre_of(kind)
    return tyre.force_at(axle, slip, ports.named(f"{axle}_load", load) if tyre.by_load else load)


def wheel_velocity(along: Expr, across: Expr, angle: Expr) -> tuple[Expr, Expr]:
    """Velocity along and across a wheel from that along and across the vehicle [m/s].

    angle : of the wheel to the vehicle [rad]
    """
    cosine, sine = sympy.cos(angle), sympy.sin(angle)
    return along * cosine + across * sine, across * cosine - along * sine


def slip_angle(along: Expr, across: Expr) -> Expr:
    """Slip angle [rad], with the source's sign, of a wheel with this velocity along and across it [m/s]."""
    return -sympy.atan(across / guarded(along, CRAWL))


def planar_motion(known: Mapping[str, Expr], lateral: Lateral) -> dict[str, Expr]:
    """Derivatives of the states of the CG."""
    along, across, turn, heading = _motion(known)
    cosine, sine = sympy.cos(heading), sympy.sin(heading)
    return {
        "lateral_velocity": lateral.lateral_force / known["mass"] - along * turn,
        "yaw_rate": lateral.turning,
        "heading": turn,
        "position_x": along * cosine - across * sine,
        "position_y": along * sine + across * cosine,
    }


def measurements(ports: Ports, lateral: Lateral) -> dict[str, Expr]:
    """What the sensors read: the IMU at its place, velocity and pose at the reference point.

    An accelerometer reads the forces that act on the vehicle's parts, not gravity: on a bank it falls
    down the slope with the vehicle, so that what it reads is the force of the tyres and of the wind.
    """
    known = ports.known
    along, across, turn, heading = _motion(known)
    point, imu = reference_and_imu(known)
    _, felt = moved_acceleration(0, known["felt_acceleration"], turn, lateral.turning, CG, imu)
    _, drift = moved_velocity(along, across, turn, CG, point)
    cosine, sine = sympy.cos(heading), sympy.sin(heading)
    x, y = moved_position((known["position_x"], known["position_y"]), cosine, sine, CG, point)
    names = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")
    read = dict(zip(names, (turn, felt, drift, heading, x, y), strict=True))
    return {
        **{name: ports.through(f"measured_{name}", value) for name, value in read.items()},
        "front_slip_angle": lateral.slip_angles[0],
        "rear_slip_angle": lateral.slip_angles[1],
        "front_lateral_force": lateral.axle_forces[0],
        "rear_lateral_force": lateral.axle_forces[1],
    }


def reference_and_imu(known: Mapping[str, Expr]) -> tuple[ReferencePoint, ReferencePoint]:
    """The point that logged pose and velocity refer to, and the place of the IMU, as expressions."""
    return (
        ReferencePoint("rear_axle", known["reference_x"], sympy.Integer(0)),
        ReferencePoint("imu", known["imu_x"], known["imu_y"]),
    )


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


def _motion(known: Mapping[str, Expr]) -> tuple[Expr, Expr, Expr, Expr]:
    along, across, turn, heading = (
        known[n] for n in ("longitudinal_velocity", "lateral_velocity", "yaw_rate", "heading")
    )
    return along, across, turn, heading


def _as_named(ports: Ports, axle: str, velocity: tuple[Expr, Expr]) -> tuple[Expr, Expr]:
    along, across = velocity
    return ports.named(f"{axle}_wheel_along", along), ports.named(f"{axle}_wheel_across", across)


def _velocity_at(known: Mapping[str, Expr], forward: Expr) -> tuple[Expr, Expr]:
    """Velocity of the point on the middle line that lies ``forward`` of the CG."""
    along, across, turn, _ = _motion(known)
    there = ReferencePoint("front_axle", forward, sympy.Integer(0))
    return moved_velocity(along, across, turn, CG, there)
