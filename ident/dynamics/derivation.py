"""From a model's expressions to its exact Jacobians, with common subexpressions removed.

Of every Jacobian only the entries that are not identically zero are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy
from sympy import Expr, Symbol

from ident.dynamics.system import System, symbols

FORBIDDEN = (
    sympy.Derivative,
    sympy.Heaviside,
    sympy.DiracDelta,
    sympy.Abs,
    sympy.sign,
    sympy.Min,
    sympy.Max,
    sympy.Subs,
)

Entry = tuple[int, int]


@dataclass(frozen=True)
class Block:
    """Assignments to run in order, and what they lead to.

    assignments : (temporary, expression)
    values : the functions themselves
    entries : (row, column) -> place in ``jacobian``, of each kind ("x", "u", "p")
    jacobian : the nonzero entries, those to the states first, then inputs, then parameters
    """

    assignments: list[tuple[Symbol, Expr]]
    values: list[Expr]
    entries: dict[str, dict[Entry, int]]
    jacobian: list[Expr]


@dataclass(frozen=True)
class Derived:
    """The derivatives of the states and the outputs, each with and without Jacobian."""

    rates: Block
    rates_with_jacobian: Block
    outputs: Block
    outputs_with_jacobian: Block


def derive(system: System) -> Derived:
    """Differentiate exactly.

    Raises
    ------
    ValueError
        If a derivative does not exist as a plain expression: a function with a kink was used that is not
        one of ``ident.dynamics.symbols``.
    """
    columns = {
        "x": symbols(system.states),
        "u": symbols(system.inputs),
        "p": symbols(system.parameters),
    }
    expressions = system.expressions
    rates, outputs = expressions[: len(system.states)], expressions[len(system.states) :]
    return Derived(
        rates=_block(system.name, rates, {}),
        rates_with_jacobian=_block(system.name, rates, columns),
        outputs=_block(system.name, outputs, {}),
        outputs_with_jacobian=_block(system.name, outputs, columns),
    )


def _block(name: str, functions: Sequence[Expr], columns: dict[str, list[Expr]]) -> Block:
    entries: dict[str, dict[Entry, int]] = {kind: {} for kind in ("x", "u", "p")}
    jacobian: list[Expr] = []
    for kind, wanted in columns.items():
        for i, function in enumerate(functions):
            present = function.free_symbols
            for j, column in enumerate(wanted):
                if column not in present:
                    continue
                entry = sympy.diff(function, column)
                if entry != 0:
                    entries[kind][i, j] = len(jacobian)
                    jacobian.append(entry)
    everything = [*functions, *jacobian]
    for expression in everything:
        if expression.has(*FORBIDDEN):
            raise ValueError(f"{name}: no plain derivative of {expression}: use ident.dynamics.symbols")
    assignments, reduced = sympy.cse(everything, symbols=sympy.numbered_symbols("t", real=True))
    return Block(assignments, reduced[: len(functions)], entries, reduced[len(functions) :])
