"""``steering_column_play``: the angle sensor follows the column only where that has used up a play of w.

    |y - z| <= w / 2,  z follows y at the ends

Largest where the wheel turns back: z stays while y runs through w, so the lag grows as w / amplitude.
"""

from __future__ import annotations

import sympy

from ident.dynamics.effects.actuator_effect import ActuatorEffect, Excitation, geometric
from ident.dynamics.parameter import Parameter

COUNT = 8
SMALLEST = 1.0  # of the noise
LARGEST = 1.0  # of the amplitude
WIDTH = Parameter("width", "rad", 1e-9, 0.1, 5e-3, "whole play before the angle sensor")


def _sizes(seen: Excitation) -> list[float]:
    return geometric(min(SMALLEST * seen.noise, 0.1 * seen.amplitude), LARGEST * seen.amplitude, COUNT)


def _impossible(width: float, seen: Excitation) -> str | None:
    if width > 2 * seen.amplitude:
        return f"a play of {width:.3g} is wider than all that the angle moves ({2 * seen.amplitude:.3g})"
    return None


def _equation() -> sympy.Expr:
    y, z, w = sympy.symbols("y z w")
    return sympy.LessThan(sympy.Abs(y - z), w / 2)


STEERING_COLUMN_PLAY = ActuatorEffect(
    "steering_column_play",
    WIDTH,
    "width",
    _sizes,
    _impossible,
    _equation(),
    "The measured angle z follows the column y only where y has used up a play of width w: after each "
    "reversal it stands still until the column has turned back by w.",
    "small and large sines of the steering, 0.1 to 0.3 Hz",
)
