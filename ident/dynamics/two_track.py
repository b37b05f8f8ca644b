"""Two-track model: the planar bicycle with four wheels or more, each with its own slip angle and load.

    m (v̇_y + v_x r) = Σ F_i cos δ_i + effects,      I_z ṙ = Σ (x_i cos δ_i + y_i sin δ_i) F_i + effects

for wheels at (x_i, y_i) from the centre of gravity (CG), with forces F_i across them (see ``wheels``), on
axles that may be groups (see ``axle_groups``). States, inputs, reference point, sensors, signs and the slip
angle at low speed are those of ``bicycle``, and so is all that is not said here.

The load moves with the lateral acceleration that presses on the springs. That is the steady one, v_x r: the
springs answer at about 1 Hz, slower than v̇_y. With the effect ``body_roll`` it is what its springs and
dampers hold, (φ + 2 ζ φ̇/ω)/k, the same when steady; a body that does not lean (k near zero) moves no load
then. The load that braking moves from the rear to the front is left out, as is the aligning moment of the
tyres.

The forces of a group together pass the ports of the bicycle (front_lateral_force, front_tyre_force, ...), so
that the effects that enter there compose with this model; what its wheels do beyond one wheel with all their
force in the middle of the group (a moment about that point, and the difference of their directions) does not.
Effects that change the slip angle of an axle do not fit, and are refused by ``Ports``; load transfer has its
parameters here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import sympy
from sympy import Expr

from ident.dynamics.axle_groups import AxleGroup, loads_at_rest, rated_load
from ident.dynamics.bicycle import (
    BODY,
    INPUTS,
    MOUNTING,
    STATES,
    Lateral,
    measurements,
    planar_motion,
    slip_angle,
    tyre_parameters,
    wheel_velocity,
)
from ident.dynamics.effects import ROAD_BANK, STEERING_OFFSET, Effect, Ports
from ident.dynamics.effects.body_roll import ANGLE, DAMPING, FREQUENCY, GAIN, RATE
from ident.dynamics.effects.effect import Known, known_symbols
from ident.dynamics.parameter import Parameter
from ident.dynamics.reference_point import CG, ReferencePoint, moved_velocity
from ident.dynamics.symbols import choose, symbol
from ident.dynamics.system import System
from ident.dynamics.tyres import Tyre, tyre_of
from ident.dynamics.wheels import Wheel, direction, load_shift, wheel_force, wheels_of

FRONT, REAR = AxleGroup("front"), AxleGroup("rear")
TANDEM = AxleGroup("rear", axles=2)
LEAST_LEAN = 1e-4  # [rad s²/m] below which a body does not lean

HEIGHT = Parameter("cg_height", "m", 0.3, 3.0, 1.2, "height of the centre of gravity")
FRONT_SHARE = Parameter(
    "front_roll_share", "1", 0.0, 1.0, 0.4, "share of the overturning moment that the front axle carries"
)
ACKERMANN = Parameter("ackermann_share", "1", -0.5, 1.5, 0.8, "0: wheels parallel, 1: Ackermann's geometry")
SENSITIVITY = Parameter(
    "load_sensitivity", "1", 0.0, 0.9, 0.3, "share of stiffness lost with all load on one side"
)


@dataclass(frozen=True)
class Group:
    """What the wheels of a group do together.

    force : sum of the forces, each across its wheel [N]
    beyond : what acts across the vehicle beyond that force on one wheel in the middle [N]
    couple : moment about the middle of the group [Nm]
    """

    force: Expr
    beyond: Expr
    couple: Expr


def two_track_parameters(
    front: str | Tyre, rear: str | Tyre, groups: tuple[AxleGroup, AxleGroup] = (FRONT, REAR)
) -> tuple[Parameter, ...]:
    """What the model needs beyond the bicycle with these tyres."""
    rated = not (tyre_of(front).by_load and tyre_of(rear).by_load)
    own = (HEIGHT, FRONT_SHARE, ACKERMANN, *((SENSITIVITY,) if rated else ()))
    return (*own, *(parameter for group in groups for parameter in group.parameters))


@cache
def two_track(
    front: str | Tyre,
    rear: str | Tyre,
    effects: tuple[Effect, ...] = (STEERING_OFFSET, ROAD_BANK),
    groups: tuple[AxleGroup, AxleGroup] = (FRONT, REAR),
) -> System:
    """Two-track model with one kind of tyres in each group.

    Parameters
    ----------
    front, rear : kinds of tyres as for the bicycle, of all wheels of the group together
    effects : what enters at its ports, as in the bicycle
    groups : axles in front and behind

    Returns
    -------
    System with the parameters of the bicycle, where cg_to_front_axle and cg_to_rear_axle reach to the middle
    of the groups, those of ``two_track_parameters``, and the outputs of the bicycle, then the load of each
    wheel as front_left_vertical_force, rear_2_right_vertical_force, ... [N]

    Raises
    ------
    ValueError
        If an effect enters at a port that this model does not have, or the groups are not front and rear.
    """
    if tuple(group.name for group in groups) != ("front", "rear"):
        raise ValueError(f"axle groups {[group.name for group in groups]}, need front and rear")
    own = tuple(parameter.name for parameter in two_track_parameters(front, rear, groups))
    tyres = tyre_parameters(front, rear)
    ports = Ports(known_symbols(STATES, INPUTS, BODY, MOUNTING, tyres, own), effects)
    ports.through("longitudinal_velocity", ports.known["longitudinal_velocity"])
    lateral, loads = _lateral_dynamics(ports, (tyre_of(front), tyre_of(rear)), groups)
    measured = measurements(ports, lateral)
    states = planar_motion(ports.known, lateral) | ports.states()
    parameters = (*BODY, *tyres, *own, *MOUNTING, *ports.parameter_names())
    axles = "_".join(f"{tyre_of(kind).kind}_{g.axles}" for kind, g in zip((front, rear), groups, strict=True))
    outputs = measured | loads | ports.outputs()
    return System(
        f"two_track_{axles}", states, (*INPUTS, *ports.inputs), parameters, outputs, ports.intermediates
    )


def _lateral_dynamics(
    ports: Ports, tyres: tuple[Tyre, Tyre], groups: tuple[AxleGroup, AxleGroup]
) -> tuple[Lateral, dict[str, Expr]]:
    """Forces and yaw acceleration, and the load of every wheel."""
    known = ports.known
    angle = ports.through("road_wheel_angle", known["road_wheel_angle"])
    pressing = ports.named("pressing_acceleration", _pressing_acceleration(known))
    loads = _wheel_loads(ports, groups, pressing)
    front, rear = (
        _group(ports, tyre, group, angle if group.name == "front" else None, loads)
        for tyre, group in zip(tyres, groups, strict=True)
    )
    force_f, force_r = (_through_ports(ports, g.name, f) for g, f in zip(groups, (front, rear), strict=True))
    slips = (
        _slip_in_the_middle(known, groups[0], angle),
        _slip_in_the_middle(known, groups[1], sympy.Integer(0)),
    )
    across = force_f * sympy.cos(angle) + front.beyond
    felt = ports.through("felt_force", across + force_r)
    ports.named("felt_acceleration", felt / known["mass"])
    lateral_force = ports.through("lateral_force", felt)
    l_f, l_r = known["cg_to_front_axle"], known["cg_to_rear_axle"]
    moment = ports.through("yaw_moment", l_f * across - l_r * force_r + front.couple + rear.couple)
    turning = ports.named("yaw_acceleration", moment / known["yaw_inertia"])
    lateral = Lateral(angle, slips, (force_f, force_r), felt, lateral_force, turning)
    return lateral, {f"{name}_vertical_force": load for name, load in loads.items()}


def _pressing_acceleration(known: Known) -> Expr:
    """Lateral acceleration that presses on the springs [m/s²]."""
    if ANGLE not in known:
        return known["longitudinal_velocity"] * known["yaw_rate"]
    gain, damping, frequency = (symbol(one.name) for one in (GAIN, DAMPING, FREQUENCY))
    held = known[ANGLE] + 2 * damping / frequency * known[RATE]
    square = gain**2
    return held * gain / choose((square, square > LEAST_LEAN**2), otherwise=LEAST_LEAN**2)


def _wheel_loads(ports: Ports, groups: tuple[AxleGroup, AxleGroup], pressing: Expr) -> dict[str, Expr]:
    """Load of each wheel [N] by its name."""
    known = ports.known
    overturning = known["mass"] * pressing * known["cg_height"]
    shares = (known["front_roll_share"], 1 - known["front_roll_share"])
    at_rest = loads_at_rest(*groups, known)
    loads = {}
    for group, share, load in zip(groups, shares, at_rest, strict=True):
        of_group = ports.named(f"{group.name}_load", load)
        for number, axle in enumerate(group.axle_names):
            own = group.share(number, known)
            wanted = share * own * overturning / known[f"{group.name}_track"]
            shift = ports.named(f"{axle}_load_shift", load_shift(own * of_group, wanted))
            loads[f"{axle}_left"] = ports.named(f"{axle}_left_load", own * of_group / 2 - shift)
            loads[f"{axle}_right"] = ports.named(f"{axle}_right_load", own * of_group / 2 + shift)
    return loads


def _group(ports: Ports, tyre: Tyre, group: AxleGroup, angle: Expr | None, loads: dict[str, Expr]) -> Group:
    """Forces of a group; ``angle`` at which it is steered [rad], None: not at all."""
    known = ports.known
    rated = ports.named(f"{group.name}_rated_load", rated_load(group, known) / 2)
    forces, beyond, couples = [], [], []
    for wheel in wheels_of(group, known):
        cosine, sine = (1, 0) if angle is None else _named_direction(ports, wheel, angle)
        slip = ports.named(f"{wheel.name}_slip_angle", _slip_of(known, wheel, cosine, sine))
        one = wheel_force(tyre, wheel, slip, loads[wheel.name], rated)
        force = ports.named(f"{wheel.name}_lateral_force", one)
        forces.append(force)
        beyond.append(0 if angle is None else force * (cosine - sympy.cos(angle)))
        couples.append(force * (group.offset(wheel.number, known) * cosine + wheel.y * sine))
    return Group(_sum(forces), _sum(beyond), _sum(couples))


def _sum(terms: Sequence[Expr]) -> Expr:
    return sympy.Add(*terms)


def _named_direction(ports: Ports, wheel: Wheel, angle: Expr) -> tuple[Expr, Expr]:
    cosine, sine = direction(wheel, angle, ports.known)
    return ports.named(f"{wheel.name}_cosine", cosine), ports.named(f"{wheel.name}_sine", sine)


def _through_ports(ports: Ports, name: str, group: Group) -> Expr:
    """Force of a group of the moment, after the effects on its tyres."""
    static = ports.through(f"{name}_lateral_force", group.force)
    return ports.through(f"{name}_tyre_force", static)


def _slip_of(known: Known, wheel: Wheel, cosine: Expr, sine: Expr) -> Expr:
    """Slip angle [rad] of a wheel that points along (cosine, sine)."""
    along, across = _velocity_at(known, wheel.x, wheel.y)
    return slip_angle(along * cosine + across * sine, across * cosine - along * sine)


def _slip_in_the_middle(known: Known, group: AxleGroup, angle: Expr) -> Expr:
    """Slip angle [rad] of a wheel in the middle of a group, as the bicycle has it."""
    velocity = _velocity_at(known, group.middle(known), sympy.Integer(0))
    return slip_angle(*wheel_velocity(*velocity, angle))


def _velocity_at(known: Known, x: Expr, y: Expr) -> tuple[Expr, Expr]:
    along, across, turn = (known[n] for n in ("longitudinal_velocity", "lateral_velocity", "yaw_rate"))
    return moved_velocity(along, across, turn, CG, ReferencePoint("cg", x, y))
