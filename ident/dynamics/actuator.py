"""The steering actuator as a differential equation: two lags after the dead time (2.25).

    T1 T2 ÿ + (T1 + T2) ẏ + y = K u

It is for simulation together with other differential equations. For a held request with its own time stamps
the exact response in closed form is in ``second_order``; dead time is a signal block (``blocks``).
"""

from __future__ import annotations

from functools import cache

from ident.dynamics.effects.effect import known_symbols
from ident.dynamics.system import System

STATES = ("steering_wheel_angle", "steering_wheel_rate")
PARAMETERS = ("gain", "time_constant_1", "time_constant_2")


@cache
def actuator() -> System:
    """Two lags with the states angle [rad] and rate [rad/s] and the input steering_wheel_request [rad].

    Both time constants must be positive; RK4 needs steps below 2.78 times the shorter.
    """
    known = known_symbols(STATES, ("steering_wheel_request",), PARAMETERS)
    angle, rate = (known[name] for name in STATES)
    gain, first, second = (known[name] for name in PARAMETERS)
    towards = gain * known["steering_wheel_request"] - angle - (first + second) * rate
    states = {"steering_wheel_angle": rate, "steering_wheel_rate": towards / (first * second)}
    outputs = {"steering_wheel_angle": angle, "steering_wheel_rate": rate}
    return System("actuator", states, ("steering_wheel_request",), PARAMETERS, outputs)
