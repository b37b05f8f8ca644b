"""``steering_offset``: the road wheels stand a constant angle beside where they are measured, δ + δ0."""

from __future__ import annotations

import sympy

from ident.dynamics.effects.effect import Effect
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol

OFFSET = Parameter("steering_offset", "rad", -0.1, 0.1, 3e-3, "added to the road-wheel angle")


def _equation() -> sympy.Basic:
    wheel, measured, offset = sympy.symbols("delta delta_measured delta_0")
    return sympy.Eq(wheel, measured + offset, evaluate=False)


STEERING_OFFSET = Effect(
    "steering_offset",
    "G",
    (OFFSET,),
    {"road_wheel_angle": lambda angle, _: angle + symbol(OFFSET.name)},
    needs=("yaw_rate",),
    equation=_equation(),
    meaning="The road wheels stand the constant angle delta_0 further to the left than is measured.",
)
