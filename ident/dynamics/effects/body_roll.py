"""``body_roll``: the body leans out of the turn, and the accelerometer on it with it.

    φ̈ + 2 ζ ω φ̇ + ω² φ = ω² k a_y,      measured a_y = a_y + g sin φ

with a_y the force of tyres and air over the mass and φ positive with the left side up. The body's own inertia
across the road is left out: what the roll does to yaw rate and path is small beside what it does to a_y.
"""

from __future__ import annotations

import sympy
from sympy import Expr

from ident.dynamics.constants import GRAVITY
from ident.dynamics.effects.effect import Effect, Known
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol

GAIN = Parameter(
    "body_roll.gain", "rad s^2/m", -0.05, 0.05, 0.01, "steady roll angle per lateral acceleration"
)
FREQUENCY = Parameter(
    "body_roll.frequency", "rad/s", 1.5, 16.0, 5.0, "undamped natural frequency of the roll"
)
DAMPING = Parameter("body_roll.damping", "1", 0.05, 2.0, 0.3, "damping ratio of the roll")
ANGLE, RATE = "body_roll_angle", "body_roll_rate"


def _turning(known: Known) -> Expr:
    frequency = symbol(FREQUENCY.name)
    leaning = symbol(GAIN.name) * known["felt_acceleration"] - known[ANGLE]
    return frequency * (frequency * leaning - 2 * symbol(DAMPING.name) * known[RATE])


def _equation() -> sympy.Basic:
    damping, frequency, gain, acceleration = sympy.symbols("zeta omega k a_y")
    angle, first, second = sympy.symbols("phi φ̇ φ̈")
    left = second + 2 * damping * frequency * first + frequency**2 * angle
    return sympy.Eq(left, frequency**2 * gain * acceleration, evaluate=False)


BODY_ROLL = Effect(
    "body_roll",
    "M",
    (GAIN, FREQUENCY, DAMPING),
    {"measured_lateral_acceleration": lambda felt, known: felt + GRAVITY * sympy.sin(known[ANGLE])},
    needs=("lateral_acceleration",),
    states={ANGLE: lambda known: known[RATE], RATE: _turning},
    outputs={"roll_angle": lambda known: known[ANGLE], "roll_rate": lambda known: known[RATE]},
    equation=_equation(),
    meaning="The body leans out of the turn by k times the lateral acceleration, and gravity adds to what "
    "the accelerometer reads.",
)
