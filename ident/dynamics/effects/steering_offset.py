"""``steering_offset``: the road wheels stand a constant angle beside where they are measured, δ + δ0."""

from __future__ import annotations

from ident.dynamics.effects.effect import Effect
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol

OFFSET = Parameter("steering_offset", "rad", -0.1, 0.1, 3e-3, "added to the road-wheel angle")

STEERING_OFFSET = Effect(
    "steering_offset",
    "G",
    (OFFSET,),
    {"road_wheel_angle": lambda angle, _: angle + symbol(OFFSET.name)},
    needs=("yaw_rate",),
)
