"""A model as SymPy expressions: x' = f(x, u, p), y = h(x, u, p).

Values on the way, such as a slip angle, may have a name of their own. Equations that use the name stay short,
and so do their derivatives, which follow by the chain rule.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256

import sympy
from sympy import Expr

from ident.dynamics.symbols import symbol

__all__ = ["System", "symbol"]


@dataclass(frozen=True)
class System:
    """One model, written once.

    states : name -> its derivative to time, in order
    inputs, parameters : names, in order
    outputs : name -> expression
    intermediates : name -> expression in states, inputs, parameters and intermediates before it; states and
        outputs may be written in terms of these names

    Raises
    ------
    ValueError
        If an expression holds a symbol that is no state, input or parameter, or a name stands twice.
    """

    name: str
    states: Mapping[str, Expr]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: Mapping[str, Expr]
    intermediates: Mapping[str, Expr] = field(default_factory=dict)

    def __post_init__(self) -> None:
        known = [*self.states, *self.inputs, *self.parameters]
        every = [*known, *self.intermediates]
        if len(set(every)) != len(every):
            raise ValueError(f"{self.name}: a name stands for two things among {every}")
        for name, expression in self.intermediates.items():
            self._check(expression, known)
            known.append(name)
        for expression in self.expressions:
            self._check(expression, known)

    def _check(self, expression: Expr, known: list[str]) -> None:
        unknown = sorted(map(str, expression.free_symbols - set(symbols(known))))
        if unknown:
            raise ValueError(f"{self.name}: {', '.join(unknown)}: no state, input or parameter")

    @property
    def expressions(self) -> tuple[Expr, ...]:
        """Derivatives of the states, then the outputs."""
        return (*map(sympy.sympify, self.states.values()), *map(sympy.sympify, self.outputs.values()))

    @property
    def fingerprint(self) -> str:
        """Hash of all that the generated code depends on: the same in every process."""
        names = (self.name, tuple(self.states), self.inputs, self.parameters, tuple(self.outputs))
        on_the_way = [(name, sympy.srepr(value)) for name, value in self.intermediates.items()]
        text = repr((names, on_the_way)) + "".join(map(sympy.srepr, self.expressions))
        return sha256(text.encode()).hexdigest()


def symbols(names: Iterable[str]) -> list[Expr]:
    """Real symbols of these names."""
    return [symbol(name) for name in names]
