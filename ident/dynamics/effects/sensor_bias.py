"""``sensor_bias``: a sensor reads a constant too much, y + b."""

from __future__ import annotations

from functools import cache

import sympy

from ident.dynamics.effects.effect import Effect
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol

SIZES = {
    "yaw_rate": ("rad/s", 0.1, 3e-3),
    "lateral_acceleration": ("m/s^2", 3.0, 0.1),
    "lateral_velocity": ("m/s", 2.0, 0.1),
}
MEANING = "The sensor reads the constant b too much."


def _equation() -> sympy.Basic:
    measured, true, bias = sympy.symbols("y_measured y b")
    return sympy.Eq(measured, true + bias, evaluate=False)


EQUATION = _equation()


@cache
def sensor_bias(signal: str) -> Effect:
    """Bias of the sensor of one signal; its parameter is named such as "yaw_rate_bias".

    signal : one of ``SIZES``
    """
    unit, bound, typical = SIZES[signal]
    bias = Parameter(f"{signal}_bias", unit, -bound, bound, typical, f"added to the measured {signal}")
    changes = {f"measured_{signal}": lambda value, _: value + symbol(bias.name)}
    return Effect("sensor_bias", "M", (bias,), changes, needs=(signal,), equation=EQUATION, meaning=MEANING)
