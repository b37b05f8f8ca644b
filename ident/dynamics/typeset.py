"""Equations of effects as presentation MathML, from the SymPy expressions that they are written in.

Names are read as in the text of a book: ``omega`` is ω, ``F_static`` is F with an index, ``DeltaF_z`` is ΔF
with an index. A function of time is written without its argument, and its derivatives with dots. Only
elements of MathML Core are used, which browsers draw by themselves.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence

import sympy
from sympy import Add, Basic, Derivative, Expr, Function, Mul, Number, Pow, Symbol
from sympy.core.function import AppliedUndef
from sympy.core.relational import Relational

_LETTERS = (
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda"),
    *("mu", "nu", "xi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega"),
    *("Gamma", "Delta", "Theta", "Lambda", "Sigma", "Phi", "Psi", "Omega"),
)
GREEK = dict(zip(_LETTERS, "αβγδεζηθκλμνξρστφχψωΓΔΘΛΣΦΨΩ", strict=True))
THIN_SPACE = '<mspace width="0.17em"></mspace>'
DOTS = {1: "˙", 2: "¨"}


def mathml(expression: Basic) -> str:
    """Write an expression or an equation as MathML on a line of its own.

    Raises
    ------
    ValueError
        If it holds something that has no form here.
    """
    return f'<math display="block">{_written(expression)}</math>'


def _written(found: Basic) -> str:
    for kind, write in _WRITERS:
        if isinstance(found, kind):
            return write(found)
    raise ValueError(f"{type(found).__name__} has no form in MathML: {found}")


def _row(*parts: str) -> str:
    return f"<mrow>{''.join(parts)}</mrow>"


def _operator(text: str) -> str:
    return f"<mo>{html.escape(text, quote=False)}</mo>"


def _fenced(inside: str, begin: str = "(", end: str = ")") -> str:
    return _row(_operator(begin), inside, _operator(end))


def _name(text: str) -> str:
    """Write one name, a Greek one by its letter, a difference with an upright Δ before it."""
    if text.startswith("Delta") and text != "Delta":
        return _row('<mi mathvariant="normal">Δ</mi>', _name(text.removeprefix("Delta")))
    return f"<mi>{html.escape(GREEK.get(text, text), quote=False)}</mi>"


def _indexed(name: str) -> str:
    base, _, index = name.partition("_")
    return f"<msub>{_name(base)}{_index(index)}</msub>" if index else _name(base)


def _index(text: str) -> str:
    return _name(text.replace("_", " "))


def _symbol(found: Symbol) -> str:
    return _indexed(found.name)


def _number(found: Number) -> str:
    if isinstance(found, sympy.Rational) and found.q != 1:
        sign = _operator("−") if found.p < 0 else ""
        return _row(sign, f"<mfrac><mn>{abs(found.p)}</mn><mn>{found.q}</mn></mfrac>")
    size = f"<mn>{float(abs(found)):g}</mn>"
    return _row(_operator("−"), size) if found < 0 else size


def _relation(found: Relational) -> str:
    sign = {"==": "=", "<=": "≤", ">=": "≥", "!=": "≠"}.get(found.rel_op, found.rel_op)
    return _row(_written(found.lhs), _operator(sign), _written(found.rhs))


def _sum(found: Add) -> str:
    """Write the terms: the highest derivatives first, then numbers, then the rest, what is taken off last."""
    terms = sorted(found.args, key=lambda term: (-_order(term), not term.is_number, _is_negative(term)))
    parts = []
    for number, term in enumerate(terms):
        negative = _is_negative(term)
        sign = _operator("−") if negative else _operator("+") if number else ""
        parts.append(sign + _written(-term if negative else term))
    return _row(*parts)


def _order(term: Basic) -> int:
    """Give the order of the highest derivative in a term."""
    return max((int(one.derivative_count) for one in term.atoms(Derivative)), default=0)


def _is_negative(term: Expr) -> bool:
    return bool(term.could_extract_minus_sign()) and not isinstance(term, Add)


def _product(found: Mul) -> str:
    if _is_negative(found):
        return _row(_operator("−"), _written(-found))
    above, below = sympy.fraction(found)
    factors = _factors(above)
    if below == 1:
        return _side_by_side([_factor(one) for one in factors])
    plain = [one for one in factors if isinstance(one, Symbol | Number | Pow)]
    behind = [_factor(one) for one in factors if one not in plain]
    top = _side_by_side([_factor(one) for one in plain]) if plain else "<mn>1</mn>"
    if len(behind) == len(factors) == 1:  # nothing else stands above
        top, behind = _written(factors[0]), []
    return _side_by_side([f"<mfrac>{top}{_written(below)}</mfrac>", *behind])


def _side_by_side(factors: Sequence[str]) -> str:
    return _row(THIN_SPACE.join(factors))


def _factors(found: Expr) -> list[Expr]:
    """Give the factors in order, sums and functions last."""
    factors = list(found.as_ordered_factors()) if isinstance(found, Mul) else [found]
    return [one for one in factors if one != 1] or [sympy.Integer(1)]


def _factor(found: Expr) -> str:
    return _fenced(_written(found)) if isinstance(found, Add) else _written(found)


def _power(found: Pow) -> str:
    base, exponent = found.base, found.exp
    if exponent == sympy.Rational(1, 2):
        return f"<msqrt>{_written(base)}</msqrt>"
    if exponent.could_extract_minus_sign():
        return f"<mfrac><mn>1</mn>{_written(base**-exponent)}</mfrac>"
    first, _, index = base.name.partition("_") if isinstance(base, Symbol) else ("", "", "")
    if index:
        return f"<msubsup>{_name(first)}{_index(index)}{_written(exponent)}</msubsup>"
    below = _written(base) if isinstance(base, Symbol | Number | AppliedUndef) else _fenced(_written(base))
    return f"<msup>{below}{_written(exponent)}</msup>"


def _applied(found: AppliedUndef) -> str:
    """Write a function of time by its name alone, any other with what it is of."""
    name = found.func.__name__
    return _indexed(name) if _is_of_time(found) else _call(name, found.args)


def _is_of_time(found: Basic) -> bool:
    return isinstance(found, AppliedUndef) and len(found.args) == 1 and str(found.args[0]) == "t"


def _derivative(found: Derivative) -> str:
    order = int(found.derivative_count)
    if order not in DOTS or not _is_of_time(found.expr):
        raise ValueError(f"a derivative of order {order} of {found.expr} has no form in MathML")
    base, _, index = found.expr.func.__name__.partition("_")
    dotted = f"<mover>{_name(base)}{_operator(DOTS[order])}</mover>"
    return f"<msub>{dotted}{_index(index)}</msub>" if index else dotted


def _call(name: str, arguments: Sequence[Basic]) -> str:
    inside = _operator(",").join(map(_written, arguments))
    return _row(f"<mi>{name}</mi>", _fenced(inside))


def _function(found: Function) -> str:
    names = {
        "sign": "sgn",
        "Max": "max",
        "Min": "min",
        "exp": "exp",
        "sin": "sin",
        "cos": "cos",
        "tan": "tan",
    }
    name = type(found).__name__
    if isinstance(found, sympy.Abs):
        return _fenced(_written(found.args[0]), "|", "|")
    if name not in names:
        raise ValueError(f"the function {name} has no form in MathML")
    return _call(names[name], sorted(found.args, key=lambda one: bool(one.is_number)))


_WRITERS: list[tuple[type[Basic], Callable[..., str]]] = [
    (Symbol, _symbol),
    (Number, _number),
    (Relational, _relation),
    (Derivative, _derivative),
    (AppliedUndef, _applied),
    (Add, _sum),
    (Mul, _product),
    (Pow, _power),
    (sympy.Max, _function),
    (sympy.Min, _function),
    (Function, _function),
]
