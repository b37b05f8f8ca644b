"""PAC2002 tyres on an axle, in the source's signs: the one place where those of the file are turned round.

The file's slip angle is that of ISO 8855 and gives a negative force; the source's is α = -α_file, so that
a positive one gives a positive force. Forces and moments keep their axes (y left, z up), and so does the
camber.

A file holds the tyre of one side, with what makes it pull to that side (conicity, ply steer). The tyre of
the other side is its mirror image: F_y(-α, -γ) and M_z(-α, -γ) change sign, F_x does not. An axle
therefore carries equally many of both, and where its two sides bear the same load it pulls nowhere: its
force is an odd function of the slip angle. Dual tyres count here, and here only: ``tyres`` is the number
on the whole axle (2, or 4 for dual tyres), each bears its share of the axle's load, and the force is that
of all of them.

The parameters of the axle are scaling factors of the file, by default those which the lateral force of an
axle can tell: LKY (cornering stiffness), LMUY (friction), LCY (shape) and LEY (curvature). 1 leaves a
curve as it is; the file's own value is where a fit starts. The other coefficients are numbers in the
equations, so that a model with these tyres is compiled once for each file, and its Jacobian has no column
for them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from sympy import Expr

from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import choose
from ident.dynamics.tyres.pac2002 import (
    ZERO,
    Coefficients,
    Contact,
    aligning_moment,
    lateral_force,
)
from ident.dynamics.tyres.pac2002_coefficients import SCALING, Pac2002, Part
from ident.dynamics.tyres.pac2002_combined import (
    combined_aligning_moment,
    combined_lateral_force,
    combined_longitudinal_force,
)
from ident.dynamics.tyres.tyre import Tyre

KIND = "pac2002"
FITTED = ("LKY", "LMUY", "LCY", "LEY")
LEAST, LARGEST = 0.1, 10.0  # bounds of a scaling factor


@dataclass(frozen=True)
class Forces:
    """Of one tyre, at its contact point: longitudinal, lateral [N], aligning (about z) [Nm]."""

    longitudinal: Expr
    lateral: Expr
    aligning: Expr


@dataclass(frozen=True)
class AxleForce:
    """Lateral force of an axle of PAC2002 tyres, called as every axle tyre is.

    tyre : from the file; tyres : number on the axle, 2 or 4; free : scaling factors that are parameters
    """

    tyre: Pac2002
    tyres: int
    free: tuple[str, ...]

    def __call__(self, slip_angle: Expr, vertical_load: Expr, **scaling: Expr) -> Expr:
        """Force of the axle [N] at a slip angle [rad] and the load of the whole axle [N]."""
        c = self.tyre.symbols("lateral", free=scaling)
        one = vertical_load / self.tyres
        own = lateral_force(c, Contact(one, -slip_angle))
        if self.tyre.side == "symmetric":
            return self.tyres * own
        mirrored = -lateral_force(c, Contact(one, slip_angle))
        return (own + mirrored) * self.tyres / 2


def pac2002_axle(tyre: Pac2002, tyres: int = 2, free: tuple[str, ...] = FITTED) -> Tyre:
    """Axle of PAC2002 tyres as one more kind of axle tyre.

    Parameters
    ----------
    tyre : from a property file
    tyres : on the axle, an even number: 4 are dual tyres
    free : scaling factors that are parameters of the axle; the others keep the file's value

    Raises
    ------
    BadRecipe
        If the file cannot tell the lateral force.
    ValueError
        If the number is not even and positive, or a scaling factor is not known.
    """
    if tyres < 2 or tyres % 2:
        raise ValueError(f"{tyres} tyres on an axle, need 2, 4, ...: as many left as right")
    unknown = set(free) - set(SCALING)
    if unknown:
        raise ValueError(f"no scaling factors: {', '.join(sorted(unknown))}; there are {', '.join(SCALING)}")
    tyre.symbols("lateral")
    parameters = tuple(
        Parameter(name, "1", LEAST, LARGEST, 1.0, f"scaling factor: {SCALING[name]}") for name in free
    )
    return Tyre(KIND, parameters, AxleForce(tyre, tyres, free), by_load=True)


def scaling_of(tyre: Pac2002, free: tuple[str, ...] = FITTED) -> dict[str, float]:
    """Return the file's own values of scaling factors, with which its curve is its own."""
    return {name: tyre.value(name) for name in free}


def combined_forces(c: Coefficients, contact: Contact) -> Forces:
    """Forces of one tyre under combined slip, in the file's signs."""
    return Forces(
        combined_longitudinal_force(c, contact),
        combined_lateral_force(c, contact),
        combined_aligning_moment(c, contact),
    )


def wheel_forces(
    tyre: Pac2002,
    place: Literal["left", "right"],
    *,
    slip_angle: Expr,
    load: Expr,
    slip_ratio: Expr | None = None,
    camber: Expr = ZERO,
    free: dict[str, Expr] | None = None,
) -> Forces:
    """Forces of one tyre on one side of the vehicle, in the source's signs.

    Parameters
    ----------
    place : side of the vehicle that the tyre stands on
    slip_angle : [rad], positive for a positive force
    load : of this tyre [N]
    slip_ratio : the source's [-]; None: pure lateral slip, without a longitudinal force
    camber : positive about the x axis on either side [rad]
    free : scaling factor -> expression, in place of the file's value

    Raises
    ------
    BadRecipe
        If the file cannot tell these forces.
    """
    turned = -1 if tyre.side not in {"symmetric", place} else 1
    own = Contact(load, -turned * slip_angle, slip_ratio_of_file(slip_ratio or ZERO), turned * camber)
    if slip_ratio is None:
        c = tyre.symbols("lateral", "aligning", free=free)
        found = Forces(ZERO, lateral_force(c, own), aligning_moment(c, own))
    else:
        found = combined_forces(tyre.symbols(*get_args(Part), free=free), own)
    return Forces(found.longitudinal, turned * found.lateral, turned * found.aligning)


def slip_ratio_of_file(slip_ratio: Expr) -> Expr:
    """(ω R - v)/|v| from the source's (ω R - v)/max(ω R, v): the same in braking, κ/(1 - κ) in driving."""
    if slip_ratio.is_number and slip_ratio <= 0:
        return slip_ratio
    return choose((slip_ratio, slip_ratio <= 0), otherwise=slip_ratio / (1 - slip_ratio))
