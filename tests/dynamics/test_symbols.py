"""The functions with a kink, their values and their derivatives."""

from __future__ import annotations

import pytest
import sympy

from ident.dynamics.symbols import absolute, clip, guarded, sign, soft_sign, symbol

X = symbol("x")


def at(expression: sympy.Expr, x: float) -> float:
    return float(expression.subs(X, x))


CASES = {
    "sign": (sign(X), {-2: -1, 0: 0, 3: 1}, {-2: 0, 0: 0, 3: 0}),
    "absolute": (absolute(X), {-2: 2, 0: 0, 3: 3}, {-2: -1, 0: 1, 3: 1}),
    "clip": (clip(X, -1, 2), {-2: -1, 0.5: 0.5, 3: 2}, {-2: 0, 0.5: 1, 3: 0}),
    "soft_sign": (soft_sign(X, 0.5), {-2: -1, 0.25: 0.5, 3: 1}, {-2: 0, 0.25: 2, 3: 0}),
    "guarded": (guarded(X, 2), {-5: 5, 0: 1, 1: 1.25, 5: 5}, {-5: -1, 0: 0, 1: 0.5, 5: 1}),
}


@pytest.mark.parametrize("name", CASES)
def test_values_and_derivatives_are_those_of_the_branches(name: str) -> None:
    expression, values, slopes = CASES[name]
    assert {x: at(expression, x) for x in values} == pytest.approx(values)
    assert {x: at(sympy.diff(expression, X), x) for x in slopes} == pytest.approx(slopes)


@pytest.mark.parametrize("edge", [-2.0, 2.0])
def test_the_guard_is_smooth_at_its_edges(edge: float) -> None:
    expression = guarded(X, 2)
    near = 1e-9
    for function in (expression, sympy.diff(expression, X)):
        assert at(function, edge - near) == pytest.approx(at(function, edge + near), abs=1e-8)
