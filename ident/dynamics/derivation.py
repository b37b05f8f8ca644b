"""From a model's expressions to its exact Jacobians, with common subexpressions removed.

Of every Jacobian only the entries that are not identically zero are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy
from sympy import Expr, Symbol

from ident.dynamics.system import System, symbol, symbols

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
    expressions = system.expressions
    rates, outputs = expressions[: len(system.states)], expressions[len(system.states) :]
    return Derived(
        rates=_block(system, rates, with_jacobian=False),
        rates_with_jacobian=_block(system, rates, with_jacobian=True),
        outputs=_block(system, outputs, with_jacobian=False),
        outputs_with_jacobian=_block(system, outputs, with_jacobian=True),
    )


def _block(system: System, functions: Sequence[Expr], *, with_jacobian: bool) -> Block:
    on_the_way = _needed(system, functions)
    entries: dict[str, dict[Entry, int]] = {kind: {} for kind in ("x", "u", "p")}
    jacobian: list[Expr] = []
    named = dict(on_the_way)
    if with_jacobian:
        columns = {"x": system.states, "u": system.inputs, "p": system.parameters}
        for kind, names in columns.items():
            for j, column in enumerate(symbols(names)):
                slopes = _slopes(on_the_way, column, f"{kind}{j}", named)
                for i, function in enumerate(functions):
                    entry = _total(function, column, slopes)
                    if entry != 0:
                        entries[kind][i, j] = len(jacobian)
                        jacobian.append(entry)
    everything = [*named.values(), *functions, *jacobian]
    for expression in everything:
        if expression.has(*FORBIDDEN):
            raise ValueError(
                f"{system.name}: no plain derivative of {expression}: use ident.dynamics.symbols"
            )
    temporaries, reduced = sympy.cse(everything, symbols=sympy.numbered_symbols("t", real=True))
    values = reduced[len(named) :]
    assignments = _ordered([*temporaries, *zip(named, reduced, strict=False)])
    return Block(assignments, values[: len(functions)], entries, values[len(functions) :])


def _needed(system: System, functions: Sequence[Expr]) -> dict[Symbol, Expr]:
    """The intermediates that functions use, in order."""
    used = set().union(*(function.free_symbols for function in functions))
    needed: dict[Symbol, Expr] = {}
    for name, value in reversed(list(system.intermediates.items())):
        if symbol(name) in used:
            needed[symbol(name)] = value
            used |= value.free_symbols
    return dict(reversed(list(needed.items())))


def _slopes(
    on_the_way: dict[Symbol, Expr], column: Symbol, tag: str, named: dict[Symbol, Expr]
) -> dict[Symbol, Expr]:
    """Total derivative of each intermediate to one column; each gets a name, which is added to ``named``."""
    slopes: dict[Symbol, Expr] = {}
    for place, (name, value) in enumerate(on_the_way.items()):
        slope = _total(value, column, slopes)
        if slope == 0:
            continue
        if not slope.is_Atom:
            named[symbol(f"d{place}_{tag}")] = slope
            slope = symbol(f"d{place}_{tag}")
        slopes[name] = slope
    return slopes


def _total(function: Expr, column: Symbol, slopes: dict[Symbol, Expr]) -> Expr:
    """Derivative to a column, directly and through the intermediates."""
    present = function.free_symbols
    parts = [sympy.diff(function, name) * slope for name, slope in slopes.items() if name in present]
    return sympy.Add(*parts, sympy.diff(function, column) if column in present else 0)


def _ordered(assignments: Sequence[tuple[Symbol, Expr]]) -> list[tuple[Symbol, Expr]]:
    """Assignments such that each uses only those before it."""
    left = dict(assignments)
    done: dict[Symbol, Expr] = {}

    def place(name: Symbol) -> None:
        value = left.pop(name)
        for other in sorted(value.free_symbols & set(left), key=str):
            if other in left:
                place(other)
        done[name] = value

    for name, _ in assignments:
        if name in left:
            place(name)
    return list(done.items())
