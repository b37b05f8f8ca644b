"""``load_transfer``: in a turn an axle loses stiffness: its outer tyre gains less than its inner one loses.

With the stiffness of one tyre C(F_z) = c_1 F_z - c_2 F_z² and its friction in proportion to its load, a wheel
that bears z times its load at rest has the force z/2 F_axle((1 + s - s z) α) of the curve of its axle, and
the axle that of its two wheels, z = 1 ± ΔF_z/F_z:

    F = Σ± (1 ± k)/2 F_axle((1 ∓ s k) α),      k = ΔF_z/F_z,      s = c_2 F_z/(c_1 - c_2 F_z)
    ΔF_z,i = χ_i m a_y h/b,                    χ_f + χ_r = 1

with F_z the load of one side at rest, h the height of the centre of gravity and b the track. The stiffness of
the axle is C_0 (1 - s k²): the sensitivity s is the share that it would lose with all its load on one side,
one number for both axles. Friction is left as it is. Beyond the lift of the inner wheels, k = 1, nothing is
lost any more. The two tracks of :mod:`ident.dynamics.wheels` do the same up to the load at which C is
largest.

Only s (h/b)² can be told from the motion: where h or b is not known, the model stands on the typical h/b, and
s is that of such a vehicle. That of a high one may so exceed one.

The a_y that shifts the load comes from the forces that are left after the shift. With F_i0 the forces before
it, m a_0 their sum and a = a_0 - q a², q = Σ s (k_i/a)² F_i0/m, straight curves have

    a_1 = 2 a_0/(1 + w),      w = √(1 + 4 q a_0)

and one step of Newton's method from there, whose slope is that of the straight curves, goes to bent ones:

    a = a_1 + (Σ F_i(a_1)/m - a_1)/w

With ``tyre_relaxation`` the forces of the moment are states, and a_y is their sum.
"""

from __future__ import annotations

from dataclasses import replace

import sympy
from sympy import Expr

from ident.dynamics.constants import GRAVITY
from ident.dynamics.effects.effect import Change, Effect, Known, on_curve
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import choose, clip, symbol
from ident.glossary import AXLES

SENSITIVITY = Parameter(
    "load_transfer.sensitivity", "1", -2.0, 2.0, 0.4, "share of stiffness lost with all load on one side"
)
FRONT_SHARE = Parameter(
    "load_transfer.front_share",
    "1",
    0.02,
    0.98,
    0.4,
    "share of the overturning moment that the front axle carries",
)
HEIGHT = Parameter(
    "load_transfer.height_over_track", "1", 0.1, 1.5, 0.55, "height of the centre of gravity over the track"
)
STRAIGHT, BENT = "load_shifting_acceleration", "settled_acceleration"
LEAST_SQUARE = 0.05  # keeps the root real where the forces of the two axles oppose each other


def shift_per_acceleration(known: Known, axle: str, front_share: Expr) -> Expr:
    """ΔF_z/F_z of an axle per lateral acceleration [s²/m]."""
    l_f, l_r = known["cg_to_front_axle"], known["cg_to_rear_axle"]
    own, other = (front_share, l_r) if axle == "front" else (1 - front_share, l_f)
    return 2 * own * symbol(HEIGHT.name) * (l_f + l_r) / (GRAVITY * other)


def _straight(before: Expr, known: Known) -> Expr:
    """Lateral acceleration [m/s²] after the shift from that before it, as if the curves were straight."""
    if _relaxes(known):
        return _across(known, known["front_relaxed_force"], known["rear_relaxed_force"]) / known["mass"]
    return 2 * before / (1 + _root(before, known))


def _bent(straight: Expr, known: Known) -> Expr:
    """The same for the curves as they are, from that for straight ones."""
    if _relaxes(known):
        return straight
    felt = _across(known, known["front_shifted_force"], known["rear_shifted_force"]) / known["mass"]
    before = _across(known, known["front_curve_force"], known["rear_curve_force"]) / known["mass"]
    return straight + (felt - straight) / _root(before, known)


def _relaxes(known: Known) -> bool:
    return "front_relaxed_force" in known


def _root(before: Expr, known: Known) -> Expr:
    share, size = symbol(FRONT_SHARE.name), symbol(SENSITIVITY.name)
    lost = [shift_per_acceleration(known, axle, share) ** 2 * known[f"{axle}_curve_force"] for axle in AXLES]
    square = 1 + 4 * size * _across(known, *lost) / known["mass"] * before
    return sympy.sqrt(choose((square, square > LEAST_SQUARE), otherwise=LEAST_SQUARE))


def _across(known: Known, front: Expr, rear: Expr) -> Expr:
    return front * sympy.cos(known["road_wheel_angle"]) + rear


def _shift(known: Known, axle: str, acceleration: Expr) -> Expr:
    """ΔF_z/F_z of an axle, no more than the inner wheels bear."""
    return clip(shift_per_acceleration(known, axle, symbol(FRONT_SHARE.name)) * acceleration, -1, 1)


def _both_wheels(axle: str, slip: str, acceleration: str) -> Change:
    def changed(force: Expr, known: Known) -> Expr:
        if acceleration == STRAIGHT and _relaxes(known):
            return force
        shift, size = _shift(known, axle, known[acceleration]), symbol(SENSITIVITY.name)
        first, second = (
            (1 + side * shift) / 2 * on_curve(known, axle, _no_less(1 - side * size * shift) * known[slip])
            for side in (1, -1)
        )
        return first + second

    return changed


def _no_less(stiffness: Expr) -> Expr:
    """A wheel has no negative stiffness, however much it bears."""
    return choose((stiffness, stiffness > 0), otherwise=0)


def _scaled(axle: str) -> Change:
    def changed(slip: Expr, known: Known) -> Expr:
        return slip * (1 - symbol(SENSITIVITY.name) * _shift(known, axle, known[BENT]) ** 2)

    return changed


def _equation() -> sympy.Basic:
    stiffness, rest, size, shift, load = sympy.symbols("C C_0 s ΔF_z F_z")
    return sympy.Eq(stiffness, rest * (1 - size * (shift / load) ** 2), evaluate=False)


LOAD_TRANSFER = Effect(
    "load_transfer",
    "T",
    (SENSITIVITY, FRONT_SHARE),
    {STRAIGHT: _straight, BENT: _bent}
    | {f"{axle}_shifted_force": _both_wheels(axle, f"{axle}_slip_angle", STRAIGHT) for axle in AXLES}
    | {f"{axle}_axle_force": _both_wheels(axle, f"{axle}_working_slip", BENT) for axle in AXLES},
    needs=("yaw_rate",),
    given=(HEIGHT,),
    equation=_equation(),
    meaning="In a turn load moves to the outer tyres and the axle loses the share s (ΔF_z/F_z)² of its "
    "stiffness; chi_f of the overturning moment acts at the front.",
)

SLIGHT = replace(LOAD_TRANSFER, changes={f"{axle}_working_slip": _scaled(axle) for axle in AXLES})
"""The same to first order in its size."""
