"""``road_bank``: the road is a plane that leans sideways; for the truck it turns over with the heading.

    sin φ_b = b_c cos ψ + b_s sin ψ,      Y = ... - m g sin φ_b

with φ_b positive where the left side is up, so that b_c is the bank of a truck that drives along x and b_s
that of one that drives along y. An accelerometer across does not see it: it measures the forces of the tyres
alone, since it falls down the slope with the truck.
"""

from __future__ import annotations

from collections.abc import Mapping

import sympy
from sympy import Expr

from ident.dynamics.constants import GRAVITY
from ident.dynamics.effects.effect import Effect
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol

BANK_COS = Parameter("bank_cos", "1", -0.3, 0.3, 0.02, "sine of the bank where the heading is zero")
BANK_SIN = Parameter("bank_sin", "1", -0.3, 0.3, 0.02, "sine of the bank where the heading is 90 degrees")


def _push(force: Expr, known: Mapping[str, Expr]) -> Expr:
    heading = known["heading"]
    sine_of_bank = symbol(BANK_COS.name) * sympy.cos(heading) + symbol(BANK_SIN.name) * sympy.sin(heading)
    return force - known["mass"] * GRAVITY * sine_of_bank


def _equation() -> sympy.Basic:
    force, before, mass, gravity, heading = sympy.symbols("Y Y_0 m g psi")
    cosine, sine = sympy.symbols("b_c b_s")
    sine_of_bank = cosine * sympy.cos(heading) + sine * sympy.sin(heading)
    return sympy.Eq(force, before - mass * gravity * sine_of_bank, evaluate=False)


ROAD_BANK = Effect(
    "road_bank",
    "Y",
    (BANK_COS, BANK_SIN),
    {"lateral_force": _push},
    needs=("heading",),
    equation=_equation(),
    meaning="The road leans, by the sine b_c of its bank for a truck that heads along x and by b_s for one "
    "that heads along y, and gravity pulls the truck down the slope.",
)
