"""PAC2002 under combined slip: weights on the pure forces, a side force from longitudinal slip, lever arms.

Same source, signs and slips as ``pac2002``. The weights G are 1 where the other slip is zero, so that the
forces are the pure ones there; the induced side force S_Vyκ is zero there too. The aligning moment differs
from the pure one at κ = 0 by s F_x, the moment of the longitudinal force about the contact point, which is
that of the shifts only.
"""

from __future__ import annotations

import sympy
from sympy import Expr

from ident.dynamics.tyres.pac2002 import (
    Coefficients,
    Contact,
    at_most_one,
    bent,
    lateral_curve,
    lateral_force,
    load_change,
    longitudinal_curve,
    longitudinal_force,
    moment_parts,
    nominal_load,
    reciprocal,
)

FLAT = sympy.Float(1e-24)  # keeps the derivative of a square root at zero; 1e-12 rad in the angle itself


def combined_longitudinal_force(c: Coefficients, contact: Contact) -> Expr:
    """F_x = G_xα F_x0 [N]."""
    stretch = c["RBX1"] * sympy.cos(sympy.atan(c["RBX2"] * contact.slip_ratio)) * c["LXAL"]
    curvature = at_most_one(c["REX1"] + c["REX2"] * load_change(c, contact))
    weight = _weight(contact.slip_angle, c["RHX1"], stretch, c["RCX1"], curvature)
    return weight * longitudinal_force(c, contact)


def combined_lateral_force(c: Coefficients, contact: Contact) -> Expr:
    """F_y = G_yκ F_y0 + S_Vyκ [N]."""
    more = load_change(c, contact)
    angle = contact.slip_angle - c["RBY3"]
    stretch = c["RBY1"] * sympy.cos(sympy.atan(c["RBY2"] * angle)) * c["LYKA"]
    curvature = at_most_one(c["REY1"] + c["REY2"] * more)
    weight = _weight(contact.slip_ratio, c["RHY1"] + c["RHY2"] * more, stretch, c["RCY1"], curvature)
    return weight * lateral_force(c, contact) + induced_lateral_force(c, contact)


def induced_lateral_force(c: Coefficients, contact: Contact) -> Expr:
    """S_Vyκ [N], the side force that longitudinal slip brings about."""
    friction = lateral_curve(c, contact).friction
    size = c["RVY1"] + c["RVY2"] * load_change(c, contact) + c["RVY3"] * contact.camber
    peak = friction * contact.pressing * size * sympy.cos(sympy.atan(c["RVY4"] * contact.slip_angle))
    return peak * sympy.sin(c["RVY5"] * sympy.atan(c["RVY6"] * contact.slip_ratio)) * c["LVYKA"]


def combined_aligning_moment(c: Coefficients, contact: Contact) -> Expr:
    """M_z = -t (F_y - S_Vyκ) + M_zr + s F_x [Nm]."""
    lateral, longitudinal = lateral_curve(c, contact), longitudinal_curve(c, contact)
    parts = moment_parts(c, contact, lateral)
    along = longitudinal.stiffness * reciprocal(lateral.stiffness) * contact.slip_ratio
    trail = parts.trail(_equivalent(parts.trail_slip, along))
    residual = parts.residual(_equivalent(parts.residual_slip, along))
    force = combined_lateral_force(c, contact)
    arm = lever_arm(c, contact, force)
    sideways = force - induced_lateral_force(c, contact)
    return -trail * sideways + residual + arm * combined_longitudinal_force(c, contact)


def lever_arm(c: Coefficients, contact: Contact, lateral: Expr) -> Expr:
    """Arm s [m] at which the longitudinal force turns the wheel, from the lateral force [N]."""
    upright = c["SSZ1"] + c["SSZ2"] * lateral / nominal_load(c)
    leaning = (c["SSZ3"] + c["SSZ4"] * load_change(c, contact)) * contact.camber
    return (upright + leaning) * c["UNLOADED_RADIUS"] * c["LS"]


def _weight(slip: Expr, shift: Expr, stretch: Expr, shape: Expr, curvature: Expr) -> Expr:
    """G = cos(C atan(...(slip + S_H))) / cos(C atan(...(S_H))), 1 at zero slip."""

    def cosine(x: Expr) -> Expr:
        return sympy.cos(shape * sympy.atan(bent(stretch * x, curvature)))

    return cosine(slip + shift) * (1 if shift == 0 else reciprocal(cosine(shift)))


def _equivalent(angle: Expr, along: Expr) -> Expr:
    """α_eq = atan(√(tan²α + (K_x/K_y)² κ²)), its size only.

    The manual gives it the sign of α. Trail and residual moment are even functions of it, so that the sign
    changes nothing, but would put a jump into the derivatives.
    """
    return sympy.atan(sympy.sqrt(sympy.tan(angle) ** 2 + along**2 + FLAT))
