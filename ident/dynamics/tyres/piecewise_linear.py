"""Piecewise linear axle (2.24): F = C α up to the slip angle x_max, then ±C x_max.

Continuous by construction: the source's F_max is C x_max.
"""

from __future__ import annotations

from sympy import Expr

from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import clip
from ident.dynamics.tyres.linear import CORNERING_STIFFNESS
from ident.dynamics.tyres.tyre import Tyre

SATURATION_SLIP = Parameter(
    "saturation_slip", "rad", 1e-3, 1.0, 0.2, "slip angle beyond which the force no longer grows"
)


def lateral_force(
    slip_angle: Expr,
    vertical_load: Expr,  # noqa: ARG001
    *,
    cornering_stiffness: Expr,
    saturation_slip: Expr,
) -> Expr:
    """Force of the axle [N]."""
    return cornering_stiffness * clip(slip_angle, -saturation_slip, saturation_slip)


PIECEWISE_LINEAR = Tyre("piecewise_linear", (CORNERING_STIFFNESS, SATURATION_SLIP), lateral_force)
