"""Brush axle with parabolic pressure: stiff bristles that slide where the pressure no longer holds them.

With t = tan α and z = C t/(3 D):

    F = C t (1 - |z| + z²/3)   for |z| < 1, that is F = D (1 - (1 - |z|)³) sgn z,   and ±D beyond,

with C the cornering stiffness and D = μ F_z the peak force of the axle. It has two parameters only, reaches
its peak with a slope of zero and stays there (Pacejka, Tire and Vehicle Dynamics, 3rd ed., 3.2).
"""

from __future__ import annotations

import sympy
from sympy import Expr

from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import choose
from ident.dynamics.tyres.linear import CORNERING_STIFFNESS
from ident.dynamics.tyres.tyre import Tyre

PEAK_FORCE = Parameter("peak_force", "N", 1e2, 1e7, 5e4, "friction times load, the largest force of the axle")


def lateral_force(
    slip_angle: Expr,
    vertical_load: Expr,  # noqa: ARG001
    *,
    cornering_stiffness: Expr,
    peak_force: Expr,
) -> Expr:
    """Force of the axle [N]."""
    z = cornering_stiffness * sympy.tan(slip_angle) / (3 * peak_force)
    return choose(
        (-peak_force, z < -1),
        (3 * peak_force * z * (1 + z + z**2 / 3), z < 0),
        (3 * peak_force * z * (1 - z + z**2 / 3), z < 1),
        otherwise=peak_force,
    )


BRUSH = Tyre("brush", (CORNERING_STIFFNESS, PEAK_FORCE), lateral_force)
