"""``steering_ratio_nonlinearity``: the road wheels turn more, or less, the further they are turned.

    δ -> δ (1 + q δ/δ_0 + c (δ/δ_0)²),      δ_0 = 0.5 rad

so that q and c are relative changes of the angle at δ_0, about the end of the travel of a truck's front
wheels: q of opposite sign left and right, c the same on both sides.
"""

from __future__ import annotations

import sympy
from sympy import Expr

from ident.dynamics.effects.effect import Effect, Known
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol

TRAVEL = 0.5  # [rad] δ_0
CUBIC = Parameter(
    "steering_ratio_nonlinearity.cubic", "1", -0.6, 0.6, 0.12, "relative change at 0.5 rad, both sides alike"
)
QUADRATIC = Parameter(
    "steering_ratio_nonlinearity.quadratic", "1", -0.4, 0.4, 0.05, "relative change at 0.5 rad to the left"
)


def mapped(angle: Expr, cubic: Expr, quadratic: Expr) -> Expr:
    """Angle of the road wheels [rad] from that without the effect."""
    share = angle / TRAVEL
    return angle * (1 + quadratic * share + cubic * share**2)


def _changed(angle: Expr, _: Known) -> Expr:
    return mapped(angle, symbol(CUBIC.name), symbol(QUADRATIC.name))


def _equation() -> sympy.Basic:
    wheel, angle, travel, cubic, quadratic = sympy.symbols("delta_wheel delta delta_0 c q")
    share = angle / travel
    return sympy.Eq(wheel, angle * (1 + quadratic * share + cubic * share**2), evaluate=False)


STEERING_RATIO_NONLINEARITY = Effect(
    "steering_ratio_nonlinearity",
    "G",
    (CUBIC, QUADRATIC),
    {"road_wheel_angle": _changed},
    needs=("yaw_rate",),
    equation=_equation(),
    meaning="The ratio of the steering changes with its angle: by c at 0.5 rad on both sides, by q to the "
    "left and -q to the right.",
)
