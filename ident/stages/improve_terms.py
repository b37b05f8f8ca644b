"""Generic terms as they are told: the unit of their coefficient, and the equation that they join, typeset.

In the motion u is the steering angle, r the yaw rate, a the lateral acceleration; in the actuator, whose
equations :mod:`ident.estimation.actuator_terms` states, u is the request where the term joins that, and else
the angle θ. v is the speed.
"""

from __future__ import annotations

import sympy

_TIME, _C = sympy.symbols("t c")
_U, _R, _A, _V, _PSI = sympy.symbols("u r a v psi")
_ANGLE = sympy.Function("theta")(_TIME)
_RATE = sympy.Derivative(_ANGLE, _TIME)

UNITS = {
    "lateral_force": "m/s^2",
    "front_tyre": "m/s^2",
    "yaw_moment": "rad/s^2",
    **dict.fromkeys(("request", "lags", "angle"), "rad"),
}
"""Of the equations, as what a term adds to them is counted."""
ACTUATOR = ("request", "lags", "angle")
TERMS = {
    "1": sympy.Integer(1),
    "t": _TIME,
    "u": _U,
    "|u|": sympy.Abs(_U),
    "u|u|": _U * sympy.Abs(_U),
    "u^3": _U**3,
    "v": _V,
    "v u": _V * _U,
    "cos(heading)": sympy.cos(_PSI),
    "sin(heading)": sympy.sin(_PSI),
    "sgn(du/dt)": sympy.sign(sympy.Derivative(sympy.Function("u")(_TIME), _TIME)),
    "r|r|": _R * sympy.Abs(_R),
    "a|a|": _A * sympy.Abs(_A),
    "x": sympy.Symbol("x"),
    "y": sympy.Symbol("y"),
    "sgn u'": sympy.sign(_RATE),
    "|u'| u": sympy.Abs(_RATE) * _U,
    "u'|u'|": _RATE * sympy.Abs(_RATE),
    "v u'": _V * _RATE,
}
TERM_UNITS = {
    **dict.fromkeys(("u", "|u|"), "rad"),
    "u|u|": "rad^2",
    "u^3": "rad^3",
    "v": "m/s",
    "v u": "rad m/s",
    "r|r|": "rad^2/s^2",
    "a|a|": "m^2/s^4",
    **dict.fromkeys(("x", "y"), "m"),
    "|u'| u": "rad^2/s",
    "u'|u'|": "rad^2/s^2",
    "v u'": "rad m/s^2",
}
TIME_UNIT = "s"  # of t in the actuator; in the motion t is a part of the run


def unit_of_term(equation: str, term: str) -> str:
    """Unit of the coefficient of a term in an equation."""
    per = TIME_UNIT if term == "t" and equation in ACTUATOR else TERM_UNITS.get(term)
    unit = UNITS.get(equation, "1")
    return f"{unit} per {per}" if per else unit


def equation_with_term(equation: str, term: str) -> sympy.Basic:
    """The equation with the term, such as dr/dt = M / I_z + c r|r|."""
    written = TERMS.get(term, sympy.Symbol("f"))
    if equation in ACTUATOR:
        return _actuator(equation, written)
    if equation == "yaw_moment":
        rate = sympy.Derivative(sympy.Function("r")(_TIME), _TIME)
        return sympy.Eq(rate, sympy.Symbol("M") / sympy.Symbol("I_z") + _C * written, evaluate=False)
    side = sympy.Symbol("a_y") if equation == "lateral_force" else sympy.Symbol("F_f") / sympy.Symbol("m")
    force = sympy.Symbol("Y") if equation == "lateral_force" else sympy.Symbol("F_tyre")
    return sympy.Eq(side, force / sympy.Symbol("m") + _C * written, evaluate=False)


def _actuator(equation: str, written: sympy.Expr) -> sympy.Basic:
    """The lags with the request (of the time before, by the dead time), or what the sensor reads."""
    if equation == "angle":
        read = sympy.Symbol("theta_measured")
        return sympy.Eq(read, _ANGLE + _C * written.subs(_U, _ANGLE), evaluate=False)
    first, second, gain = sympy.symbols("T_1 T_2 K")
    moved = first * second * sympy.Derivative(_ANGLE, (_TIME, 2)) + (first + second) * _RATE + _ANGLE
    added = written.subs(_U, _ANGLE) if equation == "lags" else written
    return sympy.Eq(moved, gain * (_U + _C * added), evaluate=False)
