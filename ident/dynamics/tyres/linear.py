"""Linear axle: F = C α."""

from __future__ import annotations

from sympy import Expr

from ident.dynamics.parameter import Parameter
from ident.dynamics.tyres.tyre import Tyre

CORNERING_STIFFNESS = Parameter(
    "cornering_stiffness", "N/rad", 1e3, 1e8, 3e5, "slope of the axle force at small slip angles"
)


def lateral_force(slip_angle: Expr, vertical_load: Expr, *, cornering_stiffness: Expr) -> Expr:  # noqa: ARG001
    """Force of the axle [N]."""
    return cornering_stiffness * slip_angle


LINEAR = Tyre("linear", (CORNERING_STIFFNESS,), lateral_force)
