"""The functions with a kink that models may use, written so that their derivative is defined everywhere.

SymPy's ``sign``, ``Abs``, ``Min`` and ``Max`` have derivatives that hold Derivative, Heaviside or DiracDelta,
which cannot be printed as code. These are written with Piecewise; at a kink the derivative is that of the
branch that the kink belongs to, and for ``sign`` and outside the limits of ``clip`` it is zero.
"""

from __future__ import annotations

from typing import TypeAlias

import sympy
from sympy import Expr, Piecewise

Number: TypeAlias = float | Expr


def symbol(name: str) -> Expr:
    """Real symbol of a state, an input or a parameter; the name may hold dots."""
    return sympy.Symbol(name, real=True)


def choose(*branches: tuple[Expr, sympy.Basic], otherwise: Number) -> Expr:
    """Value of the first branch (value, condition) whose condition holds."""
    return Piecewise(*branches, (sympy.sympify(otherwise), True))


def sign(x: Expr) -> Expr:
    """-1, 0 or 1; the derivative is zero."""
    return choose((sympy.Integer(1), x > 0), (sympy.Integer(-1), x < 0), otherwise=0)


def absolute(x: Expr) -> Expr:
    """|x|; the derivative at zero is 1."""
    return choose((-x, x < 0), otherwise=x)


def clip(x: Expr, low: Number, high: Number) -> Expr:
    """Keep x between two limits; the derivative beyond them is zero."""
    low, high = sympy.sympify(low), sympy.sympify(high)
    return choose((low, x < low), (high, x > high), otherwise=x)


def guarded(x: Expr, least: Number) -> Expr:
    """|x| where that is above ``least``, else (x² + least²)/(2 least): smooth, and never below least/2."""
    least = sympy.sympify(least)
    return choose(
        (x, x > least),
        (-x, x < -least),
        otherwise=(x * x + least * least) / (2 * least),
    )


def soft_sign(x: Expr, width: Number) -> Expr:
    """-1 or 1 beyond ``width``, a straight line between: a friction force that comes to rest."""
    return clip(x / width, -1, 1)
