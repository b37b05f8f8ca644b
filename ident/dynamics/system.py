"""A model as SymPy expressions: x' = f(x, u, p), y = h(x, u, p)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
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
    outputs : name -> expression in states, inputs and parameters

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

    def __post_init__(self) -> None:
        known = [*self.states, *self.inputs, *self.parameters]
        if len(set(known)) != len(known):
            raise ValueError(f"{self.name}: a name stands for two things among {known}")
        used = {s.name for expression in self.expressions for s in expression.free_symbols}
        if unknown := sorted(used - set(known)):
            raise ValueError(f"{self.name}: {', '.join(unknown)}: no state, input or parameter")

    @property
    def expressions(self) -> tuple[Expr, ...]:
        """Derivatives of the states, then the outputs."""
        return (*map(sympy.sympify, self.states.values()), *map(sympy.sympify, self.outputs.values()))

    @property
    def fingerprint(self) -> str:
        """Hash of all that the generated code depends on: the same in every process."""
        names = (self.name, tuple(self.states), self.inputs, self.parameters, tuple(self.outputs))
        text = repr(names) + "".join(map(sympy.srepr, self.expressions))
        return sha256(text.encode()).hexdigest()


def symbols(names: Iterable[str]) -> list[Expr]:
    """Real symbols of these names."""
    return [symbol(name) for name in names]
