"""One wheel of a vehicle with two tracks: where it stands, where it points, its load and its force.

A wheel at (x, y) from the centre of gravity (x forward, y left) moves with v_x - y r along the vehicle and
v_y + x r across it. Its slip angle is that of ``bicycle.slip_angle``.

Steering: the angle δ is that of a wheel in the middle of the axle. With the share A of Ackermann's geometry,
from 0 (both wheels parallel) to 1 (both turn about one point on the line of the rear axle),

    tan δ_i = tan δ/(1 - A (y_i/L) tan δ)

so that the inner wheel turns more. The direction is kept as a pair (cos δ_i, sin δ_i), without a quotient.

Load: in a turn the axle j of a group moves ΔF_z,j = χ w_j m a_y h/b from its inner to its outer wheel, with χ
the share of the overturning moment m a_y h that the springs and stabilisers of the group carry and w_j the
share of the axle in it. It moves no more than the inner wheel bears: a lifted wheel has the load zero, never
less, and both wheels together keep the load of their axle. What of the moment is then left over goes to no
other axle.

Force: PAC2002 tyres take the load of their wheel. The other kinds have parameters of the whole group at the
load at rest. A wheel with z times the load that it was rated for has z times its share of the friction, and
the stiffness C(F_z) = c_1 F_z - c_2 F_z², which stays at its peak beyond it:

    F = z/(2 n) F_group(κ α),      κ = 1 + s - s z   up to   s z = (1 + s)/2

with s = c_2 F_z0/(c_1 - c_2 F_z0), the share of its stiffness that an axle would lose with all its load on
one side: the ``sensitivity`` of the effect ``load_transfer``, which is the sum of both wheels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import sympy
from sympy import Expr

from ident.dynamics.axle_groups import AxleGroup, Known
from ident.dynamics.symbols import choose, clip, symbol
from ident.dynamics.tyres import Tyre
from ident.dynamics.tyres.pac2002_axle import AxleForce, wheel_forces

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True)
class Wheel:
    """One wheel, or the dual wheels at one end of an axle.

    group : that it belongs to; number : of its axle in the group, 0 is the foremost
    x, y : from the CG, forward and left [m]
    """

    group: AxleGroup
    number: int
    side: Side
    x: Expr
    y: Expr

    @property
    def name(self) -> str:
        """Such as "front_left", "rear_2_right"."""
        return f"{self.group.axle_names[self.number]}_{self.side}"


def wheels_of(group: AxleGroup, known: Known) -> list[Wheel]:
    """Wheels of a group, left before right, the foremost axle first."""
    half = known[f"{group.name}_track"] / 2
    middle = group.middle(known)
    return [
        Wheel(group, number, side, middle + group.offset(number, known), half if side == "left" else -half)
        for number in range(group.axles)
        for side in SIDES
    ]


def direction(wheel: Wheel, angle: Expr, known: Known) -> tuple[Expr, Expr]:
    """Cosine and sine of the angle at which a steered wheel stands; ``angle`` is that of the axle [rad]."""
    wheelbase = known["cg_to_front_axle"] + known["cg_to_rear_axle"]
    inwards = known["ackermann_share"] * wheel.y / wheelbase
    along, across = sympy.cos(angle) - inwards * sympy.sin(angle), sympy.sin(angle)
    size = sympy.sqrt(along**2 + across**2)
    return along / size, across / size


def load_shift(axle_load: Expr, wanted: Expr) -> Expr:
    """Load that moves to the right wheel of an axle [N]: as wanted, until the other wheel bears none."""
    return clip(wanted, -axle_load / 2, axle_load / 2)


def wheel_force(tyre: Tyre, wheel: Wheel, slip: Expr, load: Expr, rated: Expr) -> Expr:
    """Force across one wheel [N].

    Parameters
    ----------
    tyre : of the whole group
    slip : [rad]; load : of this wheel [N]; rated : load of this wheel at rest, all axles down [N]

    Raises
    ------
    ValueError
        If the PAC2002 tyres of the group do not divide evenly among its wheels.
    """
    ends = 2 * wheel.group.axles
    if isinstance(tyre.lateral_force, AxleForce):
        return _from_file(tyre, tyre.lateral_force, wheel, slip, load)
    if tyre.by_load:
        return tyre.force_at(wheel.group.name, slip, ends * load) / ends
    relative = load / rated
    stiffer = stiffness_over_load(symbol("load_sensitivity"), relative)
    return relative / ends * tyre.force_at(wheel.group.name, stiffer * slip, ends * rated)


def stiffness_over_load(sensitivity: Expr, relative: Expr) -> Expr:
    """κ = C/C_0 over F_z/F_z0: 1 + s - s z, and past the peak of C what keeps C there."""
    reached, peak = sensitivity * relative, (1 + sensitivity) / 2
    beyond = choose((reached, reached > peak), otherwise=peak)
    return choose((1 + sensitivity - reached, reached < peak), otherwise=peak**2 / beyond)


def _from_file(tyre: Tyre, force: AxleForce, wheel: Wheel, slip: Expr, load: Expr) -> Expr:
    count, rest = divmod(force.tyres, 2 * wheel.group.axles)
    if rest or not count:
        raise ValueError(
            f"{force.tyres} tyres in the group {wheel.group.name} of {wheel.group.axles} axles, need as many "
            "at each end of each axle"
        )
    free = {name: symbol(f"{wheel.group.name}.{name}") for name in tyre.names}
    one = wheel_forces(force.tyre, wheel.side, slip_angle=slip, load=load / count, free=free)
    return count * one.lateral
