"""PAC2002: forces and aligning moment of one tyre under pure slip, with camber, load and pressure.

H.B. Pacejka, Tyre and Vehicle Dynamics (2002), 4.3, as written down in the Adams/Tire manual "Using the
PAC2002 Tire Model" for the property files that carry this name; combined slip is in ``pac2002_combined``.

Signs and slips are those of the property files, not the source's: ISO 8855 axes at the contact point (y
left, z up), tan α = V_sy/|V_x| (a positive slip angle means sliding to the left and gives a negative
force), κ = -V_sx/|V_x|, camber γ positive about x. ``pac2002_axle`` turns them into the source's.

Every curve is written as a force per load,

    F/F_z = μ sin(C atan(B x - E (B x - atan(B x)))) + S_V/F_z,     x = slip + S_H,     B = (K/F_z)/(C μ),

so that nothing is divided by a load that may be zero: sin(2 atan u) = 2 u/(1 + u²) gives K_y/F_z in a
closed form. The load inside a curve is as given; a lifted tyre, whose load is below zero, has no force.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import sympy
from sympy import Expr

from ident.dynamics.symbols import absolute, choose

Coefficients = Mapping[str, Expr]
ZERO = sympy.Integer(0)
NEGLIGIBLE = sympy.Float(1e-16)  # square of the size below which a denominator counts as zero


@dataclass(frozen=True)
class Contact:
    """State of a tyre in the signs of the property file.

    load : vertical force [N]; slip_angle, camber : [rad]; slip_ratio : [-]
    """

    load: Expr
    slip_angle: Expr
    slip_ratio: Expr = ZERO
    camber: Expr = ZERO

    @property
    def pressing(self) -> Expr:
        """Load [N], zero where the tyre is lifted."""
        return choose((self.load, self.load > 0), otherwise=0)


@dataclass(frozen=True)
class Curve:
    """One Magic Formula curve, its forces divided by the load.

    friction : μ, the peak; shape : C; curvature : E, for the slip at hand
    stiffness : K/F_z, the slope where the shifted slip is zero [1/rad, or 1 for the slip ratio]
    stretch : B; shift_slip : S_H; shift_force : S_V/F_z; slip : x, the shifted slip
    """

    friction: Expr
    shape: Expr
    curvature: Expr
    stiffness: Expr
    stretch: Expr
    shift_slip: Expr
    shift_force: Expr
    slip: Expr

    @property
    def force_per_load(self) -> Expr:
        """F/F_z."""
        angle = self.shape * sympy.atan(bent(self.stretch * self.slip, self.curvature))
        return self.friction * sympy.sin(angle) + self.shift_force


@dataclass(frozen=True)
class Moment:
    """Parts of the aligning moment.

    trail : pneumatic trail at α_t [m], residual : at α_r [Nm], as functions of the stretched slip angles
    """

    trail_peak: Expr
    trail_shape: Expr
    trail_stretch: Expr
    trail_curvature: Expr
    trail_slip: Expr
    residual_peak: Expr
    residual_stretch: Expr
    residual_slip: Expr
    cosine: Expr

    def trail(self, slip: Expr) -> Expr:
        """Pneumatic trail [m]."""
        curve = bent(self.trail_stretch * slip, self.trail_curvature)
        return self.trail_peak * sympy.cos(self.trail_shape * sympy.atan(curve)) * self.cosine

    def residual(self, slip: Expr) -> Expr:
        """Residual moment [Nm]."""
        return self.residual_peak * sympy.cos(sympy.atan(self.residual_stretch * slip)) * self.cosine


def longitudinal_force(c: Coefficients, contact: Contact) -> Expr:
    """F_x0, the longitudinal force under pure slip [N]."""
    return contact.pressing * longitudinal_curve(c, contact).force_per_load


def lateral_force(c: Coefficients, contact: Contact) -> Expr:
    """F_y0, the lateral force under pure slip [N]."""
    return contact.pressing * lateral_curve(c, contact).force_per_load


def aligning_moment(c: Coefficients, contact: Contact) -> Expr:
    """M_z0 = -t F_y0 + M_zr, the aligning moment under pure slip [Nm]."""
    moment = moment_parts(c, contact, lateral_curve(c, contact))
    trail = moment.trail(moment.trail_slip)
    return -trail * lateral_force(c, contact) + moment.residual(moment.residual_slip)


def cornering_stiffness(c: Coefficients, contact: Contact) -> Expr:
    """K_y, the slope of the lateral force where the shifted slip angle is zero [N/rad], negative."""
    return contact.pressing * lateral_curve(c, contact).stiffness


def slip_stiffness(c: Coefficients, contact: Contact) -> Expr:
    """K_x, the slope of the longitudinal force where the shifted slip is zero [N]."""
    return contact.pressing * longitudinal_curve(c, contact).stiffness


def longitudinal_curve(c: Coefficients, contact: Contact) -> Curve:
    """Curve of the longitudinal force against the slip ratio."""
    more, pressure = load_change(c, contact), c["PRESSURE"]
    camber = contact.camber * c["LGAX"]
    shift_slip = (c["PHX1"] + c["PHX2"] * more) * c["LHX"]
    slip = contact.slip_ratio + shift_slip
    load_friction = c["PDX1"] + c["PDX2"] * more
    pressure_friction = 1 + c["PPX3"] * pressure + c["PPX4"] * pressure**2
    friction = load_friction * pressure_friction * (1 - c["PDX3"] * camber**2) * c["LMUX"]
    shape = c["PCX1"] * c["LCX"]
    load_curvature = c["PEX1"] + c["PEX2"] * more + c["PEX3"] * more**2
    curvature = two_sided(load_curvature * c["LEX"], c["PEX4"], slip)
    load_stiffness = (c["PKX1"] + c["PKX2"] * more) * sympy.exp(c["PKX3"] * more)
    stiffness = load_stiffness * (1 + c["PPX1"] * pressure + c["PPX2"] * pressure**2) * c["LKX"]
    shift_force = (c["PVX1"] + c["PVX2"] * more) * c["LVX"] * c["LMUX"]
    stretch = stiffness * reciprocal(shape * friction)
    return Curve(friction, shape, curvature, stiffness, stretch, shift_slip, shift_force, slip)


def lateral_curve(c: Coefficients, contact: Contact) -> Curve:
    """Curve of the lateral force against the slip angle."""
    more, pressure = load_change(c, contact), c["PRESSURE"]
    camber = contact.camber * c["LGAY"]
    shift_slip = (c["PHY1"] + c["PHY2"] * more) * c["LHY"] + c["PHY3"] * camber * c["LKG"]
    slip = contact.slip_angle + shift_slip
    load_friction = c["PDY1"] + c["PDY2"] * more
    pressure_friction = 1 + c["PPY3"] * pressure + c["PPY4"] * pressure**2
    friction = load_friction * pressure_friction * (1 - c["PDY3"] * camber**2) * c["LMUY"]
    shape = c["PCY1"] * c["LCY"]
    load_curvature = (c["PEY1"] + c["PEY2"] * more) * c["LEY"]
    curvature = two_sided(load_curvature, c["PEY3"] + c["PEY4"] * camber, slip)
    stiffness = lateral_stiffness_per_load(c, contact) * (1 - c["PKY3"] * absolute(camber))
    steady = (c["PVY1"] + c["PVY2"] * more) * c["LVY"]
    thrust = (c["PVY3"] + c["PVY4"] * more) * camber * c["LKG"]
    shift_force = (steady + thrust) * c["LMUY"]
    stretch = stiffness * reciprocal(shape * friction)
    return Curve(friction, shape, curvature, stiffness, stretch, shift_slip, shift_force, slip)


def lateral_stiffness_per_load(c: Coefficients, contact: Contact) -> Expr:
    """K_y0/F_z [1/rad]: K_y0 = p_Ky1 F_z0' sin(2 atan u), u = F_z/(p_Ky2 F_z0'), without camber."""
    pressure = c["PRESSURE"]
    rise = c["PKY2"] * (1 + c["PPY2"] * pressure)
    u = contact.load / (nominal_load(c) * rise)
    return c["PKY1"] * (1 + c["PPY1"] * pressure) * c["LKY"] * 2 / (rise * (1 + u**2))


def moment_parts(c: Coefficients, contact: Contact, lateral: Curve) -> Moment:
    """Pneumatic trail and residual moment as functions of their slip angles."""
    more, camber = load_change(c, contact), contact.camber * c["LGAZ"]
    trail_slip = contact.slip_angle + (c["QHZ1"] + c["QHZ2"] * more + (c["QHZ3"] + c["QHZ4"] * more) * camber)
    scaling = c["LKY"] * reciprocal(c["LMUY"])
    load_stretch = c["QBZ1"] + c["QBZ2"] * more + c["QBZ3"] * more**2
    stretch = load_stretch * (1 + c["QBZ4"] * camber + c["QBZ5"] * absolute(camber)) * scaling
    bend = (c["QEZ4"] + c["QEZ5"] * camber) * (2 / math.pi) * sympy.atan(stretch * c["QCZ1"] * trail_slip)
    load_curvature = c["QEZ1"] + c["QEZ2"] * more + c["QEZ3"] * more**2
    residual_slip = contact.slip_angle + lateral.shift_slip
    residual_slip += lateral.shift_force * reciprocal(lateral.stiffness)
    return Moment(
        trail_peak=_trail_peak(c, contact),
        trail_shape=c["QCZ1"],
        trail_stretch=stretch,
        trail_curvature=at_most_one(load_curvature * (1 + bend)),
        trail_slip=trail_slip,
        residual_peak=_residual_peak(c, contact),
        residual_stretch=c["QBZ9"] * scaling + c["QBZ10"] * lateral.stretch * lateral.shape,
        residual_slip=residual_slip,
        cosine=sympy.cos(contact.slip_angle),
    )


def _trail_peak(c: Coefficients, contact: Contact) -> Expr:
    """D_t [m]."""
    more, camber = load_change(c, contact), contact.camber * c["LGAZ"]
    load_trail = (c["QDZ1"] + c["QDZ2"] * more) * (1 - c["QPZ1"] * c["PRESSURE"])
    leaning = 1 + c["QDZ3"] * camber + c["QDZ4"] * camber**2
    return contact.pressing * load_trail * leaning * c["UNLOADED_RADIUS"] / nominal_load(c) * c["LTR"]


def _residual_peak(c: Coefficients, contact: Contact) -> Expr:
    """D_r [Nm]."""
    more, camber = load_change(c, contact), contact.camber * c["LGAZ"]
    upright = (c["QDZ6"] + c["QDZ7"] * more) * c["LRES"]
    leaning = (c["QDZ8"] + c["QDZ9"] * more) * (1 + c["QPZ2"] * c["PRESSURE"]) * camber
    return contact.pressing * (upright + leaning) * c["UNLOADED_RADIUS"] * c["LMUY"]


def nominal_load(c: Coefficients) -> Expr:
    """F_z0', the scaled nominal load [N]."""
    return c["FNOMIN"] * c["LFZO"]


def load_change(c: Coefficients, contact: Contact) -> Expr:
    """df_z, the load above the nominal one, relative to it."""
    return contact.load / nominal_load(c) - 1


def bent(stretched: Expr, curvature: Expr) -> Expr:
    """B x - E (B x - atan(B x))."""
    return stretched - curvature * (stretched - sympy.atan(stretched))


def two_sided(curvature: Expr, difference: Expr, slip: Expr) -> Expr:
    """E (1 - d sgn x), at most 1, with the two signs apart, so that no condition holds another.

    At x = 0 either will do: the curve passes through zero there with the same slope for every E.
    """
    if difference == 0:
        return at_most_one(curvature)
    above, below = (at_most_one(curvature * (1 - side * difference)) for side in (1, -1))
    return choose((above, slip > 0), otherwise=below)


def at_most_one(x: Expr) -> Expr:
    """The smaller of x and 1, which every curvature E must not exceed; the derivative beyond 1 is zero."""
    return choose((sympy.Integer(1), x > 1), otherwise=x)


def reciprocal(x: Expr) -> Expr:
    """1/x with its sign, smooth and 0 at x = 0; elsewhere 1/x but for 1e-16/x², relatively."""
    if x.is_number:
        return 1 / x if x != 0 else ZERO
    return x / (x**2 + NEGLIGIBLE)
