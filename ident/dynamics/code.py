"""The text of the Python module that is generated for a model.

It holds the functions of the model for one point (``rates``, ``rates_and_jacobian``, ``outputs``,
``outputs_and_jacobian``), the two drivers that call them (see ``driver_text``), and the same functions for
arrays (``array_*``). Everything is in one module: a driver that took the model as an argument would miss
Numba's disk cache in every process. The drivers have explicit signatures, so they are compiled, or loaded,
when the module is imported; the compiled code of a driver holds that of the functions which it calls.
"""

from __future__ import annotations

from collections.abc import Sequence

from sympy import Symbol

from ident.dynamics import driver_text
from ident.dynamics.derivation import Block, Derived
from ident.dynamics.printing import ArrayPrinter, ScalarPrinter, assignments
from ident.dynamics.system import System, symbols

HEADER = '''"""{name}: generated from its equations; never edited, written again when they change."""

import math

import numpy as np
from numba import njit

OPTIONS = {{"cache": True, "error_model": "numpy", "nogil": True, "fastmath": {{"contract"}}}}
'''


def module_text(system: System, derived: Derived) -> str:
    """Text of the module of a model."""
    names = _names(system)
    parts = [
        HEADER.format(name=system.name),
        _point_function("rates", system, derived.rates, names),
        _point_function("rates_and_jacobian", system, derived.rates_with_jacobian, names),
        _point_function("outputs", system, derived.outputs, names),
        _point_function("outputs_and_jacobian", system, derived.outputs_with_jacobian, names),
        driver_text.simulate(system),
        driver_text.sensitivities(system, derived),
        _array_function("array_rates", system, derived.rates, names),
        _array_function("array_rates_and_jacobian", system, derived.rates_with_jacobian, names),
        _array_function("array_outputs", system, derived.outputs, names),
        _array_function("array_outputs_and_jacobian", system, derived.outputs_with_jacobian, names),
        _entries("RATE_ENTRIES", derived.rates_with_jacobian),
        _entries("OUTPUT_ENTRIES", derived.outputs_with_jacobian),
    ]
    return "\n\n".join(parts) + "\n"


def _groups(system: System) -> dict[str, Sequence[str]]:
    return {"x": tuple(system.states), "u": system.inputs, "p": system.parameters}


def _names(system: System) -> dict[Symbol, str]:
    """Identifiers of the symbols: x_yaw_rate, u_road_wheel_angle, p_front_shape, v_front_slip_angle."""
    groups = {**_groups(system), "v": tuple(system.intermediates)}
    named = {
        symbol: f"{kind}_{symbol.name.replace('.', '_')}"
        for kind, names in groups.items()
        for symbol in symbols(names)
    }
    if len(set(named.values())) != len(named):
        raise ValueError(f"{system.name}: two names differ in a dot only")
    return named


def _reads(system: System, block: Block, names: dict[Symbol, str], index: str) -> list[str]:
    """Assignments of the states, inputs and parameters that a block uses."""
    expressions = [*(value for _, value in block.assignments), *block.values, *block.jacobian]
    used = set().union(*(expression.free_symbols for expression in expressions))
    return [
        f"    {names[symbol]} = {kind}[{index}{place}]"
        for kind, group in _groups(system).items()
        for place, symbol in enumerate(symbols(group))
        if symbol in used
    ]


def _point_function(name: str, system: System, block: Block, names: dict[Symbol, str]) -> str:
    printer = ScalarPrinter(names)
    with_jacobian = name.endswith("jacobian")
    lines = [
        "@njit(**OPTIONS)",
        f"def {name}(x, u, p, out{', jacobian' if with_jacobian else ''}):",
        *_reads(system, block, names, ""),
        *assignments(printer, block.assignments),
        *(f"    out[{i}] = {printer.doprint(value)}" for i, value in enumerate(block.values)),
        *(f"    jacobian[{i}] = {printer.doprint(value)}" for i, value in enumerate(block.jacobian)),
    ]
    return "\n".join(lines)


def _array_function(name: str, system: System, block: Block, names: dict[Symbol, str]) -> str:
    printer = ArrayPrinter(names)
    returned = [*block.values, *block.jacobian]
    lines = [
        f"def {name}(x, u, p):",
        *_reads(system, block, names, "..., "),
        *assignments(printer, block.assignments),
        "    return [",
        *(f"        {printer.doprint(value)}," for value in returned),
        "    ]",
    ]
    return "\n".join(lines)


def _entries(name: str, block: Block) -> str:
    """Where each entry of the flat Jacobian belongs: [(row, column), ...] of each kind, in order."""
    return f"{name} = " + repr({kind: list(entries) for kind, entries in block.entries.items()})
