"""``load_transfer``: in a turn an axle loses stiffness: its outer tyre gains less than its inner one loses.

With the stiffness of one tyre C(F_z) = c_1 F_z - c_2 F_z² and the loads F_z ± ΔF_z of its two sides, that of
an axle is

    C = C_0 (1 - s (ΔF_z/F_z)²),      s = c_2 F_z/(c_1 - c_2 F_z)
    ΔF_z,i = χ_i m a_y h/b,           χ_f + χ_r = 1

with F_z the load of one side at rest, h the height of the centre of gravity and b the track. So the
sensitivity s is the share of its stiffness that an axle would lose with all its load on one side, one number
for both axles. Friction is left as it is: the force is that of the axle's curve at the slip angle
α (1 - s (ΔF_z/F_z)²). Beyond the lift of the inner wheels, ΔF_z = F_z, nothing is lost any more.

Only s (h/b)² can be told from the motion: where h or b is not known, the model stands on the typical h/b, and
s is that of such a vehicle. That of a high one may so exceed one.

The a_y that shifts the load comes from the forces that are left after the shift. With F_i0 the forces before
it, m a_0 their sum and a = a_0 - q a², q = Σ s k_i F_i0/m, k_i = (ΔF_z,i/(F_z,i a))²,

    a = 2 a_0/(1 + √(1 + 4 q a_0))

which takes the curves as straight: at 0.3 g what the shift does comes out about 1 % too small. Two wheels of
different load on a bent curve lose 1 to 2 % of the effect more than one curve of the axle says.

With ``tyre_relaxation`` the forces of the moment are states, and a_y is their sum.
"""

from __future__ import annotations

import sympy
from sympy import Expr

from ident.dynamics.constants import GRAVITY
from ident.dynamics.effects.effect import Change, Effect, Known
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import choose, symbol

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
PORT = "load_shifting_acceleration"
LEAST_SQUARE = 0.05  # keeps the root real where the forces of the two axles oppose each other


def shift_per_acceleration(known: Known, axle: str, front_share: Expr) -> Expr:
    """ΔF_z/F_z of an axle per lateral acceleration [s²/m]."""
    l_f, l_r = known["cg_to_front_axle"], known["cg_to_rear_axle"]
    own, other = (front_share, l_r) if axle == "front" else (1 - front_share, l_f)
    return 2 * own * symbol(HEIGHT.name) * (l_f + l_r) / (GRAVITY * other)


def shifting_acceleration(before: Expr, known: Known) -> Expr:
    """Lateral acceleration [m/s²] after the loads have shifted, from that of the force curves."""
    if "front_relaxed_force" in known:
        return _across(known, known["front_relaxed_force"], known["rear_relaxed_force"]) / known["mass"]
    share, size = symbol(FRONT_SHARE.name), symbol(SENSITIVITY.name)
    lost = [
        shift_per_acceleration(known, axle, share) ** 2 * known[f"{axle}_curve_force"]
        for axle in ("front", "rear")
    ]
    square = 1 + 4 * size * _across(known, *lost) / known["mass"] * before
    root = sympy.sqrt(choose((square, square > LEAST_SQUARE), otherwise=LEAST_SQUARE))
    return 2 * before / (1 + root)


def _across(known: Known, front: Expr, rear: Expr) -> Expr:
    return front * sympy.cos(known["road_wheel_angle"]) + rear


def _scaled(axle: str) -> Change:
    def changed(slip: Expr, known: Known) -> Expr:
        shift = shift_per_acceleration(known, axle, symbol(FRONT_SHARE.name))
        shift *= known[PORT]
        square = shift**2
        return slip * (1 - symbol(SENSITIVITY.name) * choose((square, square < 1), otherwise=1))

    return changed


def _equation() -> sympy.Basic:
    stiffness, rest, size, shift, load = sympy.symbols("C C_0 s ΔF_z F_z")
    return sympy.Eq(stiffness, rest * (1 - size * (shift / load) ** 2), evaluate=False)


LOAD_TRANSFER = Effect(
    "load_transfer",
    "T",
    (SENSITIVITY, FRONT_SHARE),
    {
        PORT: shifting_acceleration,
        "front_working_slip": _scaled("front"),
        "rear_working_slip": _scaled("rear"),
    },
    needs=("yaw_rate",),
    given=(HEIGHT,),
    equation=_equation(),
    meaning="In a turn load moves to the outer tyres and the axle loses the share s (ΔF_z/F_z)² of its "
    "stiffness; chi_f of the overturning moment acts at the front.",
)
