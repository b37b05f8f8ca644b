"""``steering_rate_limit``: the actuator turns no faster than ρ; the rate inside the second lag is clipped.

    y' = clip((x - y) / T2, ±ρ)

Large steps are answered by straight lines, so the lag grows with the amplitude of what is asked.
"""

from __future__ import annotations

import sympy

from ident.dynamics.effects.actuator_effect import ActuatorEffect, Excitation, geometric
from ident.dynamics.parameter import Parameter

COUNT = 8
FASTEST, SLOWEST = 0.97, 0.12  # of the largest rate of the model without a limit
ROUNDING = 1e-9
RATE = Parameter("rate", "rad/s", 1e-3, 20.0, 0.25, "largest rate of the actuator")


def _sizes(seen: Excitation) -> list[float]:
    return geometric(SLOWEST * seen.rate, FASTEST * seen.rate, COUNT)[::-1]


def _impossible(rate: float, seen: Excitation) -> str | None:
    if rate > (1 + ROUNDING) * seen.rate:
        return f"a limit of {rate:.3g} is never reached: the rate is at most {seen.rate:.3g}"
    return None


def _equation() -> sympy.Expr:
    time = sympy.Symbol("t")
    x, y = sympy.Symbol("x"), sympy.Function("y")(time)
    clip, rho, second = sympy.Function("clip"), sympy.Symbol("rho"), sympy.Symbol("T_2")
    return sympy.Eq(sympy.Derivative(y, time), clip((x - y) / second, -rho, rho))


STEERING_RATE_LIMIT = ActuatorEffect(
    "steering_rate_limit",
    RATE,
    "rate",
    _sizes,
    _impossible,
    _equation(),
    "The steering turns no faster than the rate rho, whatever the request: large steps are answered by "
    "straight lines and lag more than small ones.",
    "steps of three sizes, the largest as large as the speed allows",
)
