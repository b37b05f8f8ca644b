"""``wheel_speed_scale``: the logged speed is (1 + e) times the true one, such as with worn tyres.

    v = v_logged/(1 + e)

everywhere in the model.
"""

from __future__ import annotations

import sympy

from ident.dynamics.effects.effect import Effect
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol

SCALE = Parameter("wheel_speed_scale.scale", "1", -0.2, 0.2, 0.02, "relative excess of the logged speed")


def _equation() -> sympy.Basic:
    true, logged, scale = sympy.symbols("v v_logged e")
    return sympy.Eq(true, logged / (1 + scale), evaluate=False)


WHEEL_SPEED_SCALE = Effect(
    "wheel_speed_scale",
    "M",
    (SCALE,),
    {"longitudinal_velocity": lambda speed, _: speed / (1 + symbol(SCALE.name))},
    needs=("yaw_rate",),
    equation=_equation(),
    meaning="The logged speed is larger than the true one by the share e.",
)
