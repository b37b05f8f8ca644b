"""Models as expressions: what is refused, and that every model differentiates to plain expressions."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import sympy
from vehicle_values import KINDS

from ident.dynamics.actuator import actuator
from ident.dynamics.bicycle import bicycle
from ident.dynamics.code import module_text
from ident.dynamics.derivation import derive
from ident.dynamics.kinematic import kinematic
from ident.dynamics.longitudinal import driven_bicycle
from ident.dynamics.printing import ArrayPrinter, ScalarPrinter
from ident.dynamics.symbols import choose
from ident.dynamics.system import System, symbol

MODELS: dict[str, Callable[[], System]] = {
    **{kind: lambda kind=kind: bicycle(kind, kind) for kind in KINDS},
    "driven": lambda: driven_bicycle("brush", "piecewise_linear"),
    "kinematic": kinematic,
    "rear steer": lambda: kinematic(rear_steer=True),
    "actuator": actuator,
}
UNPRINTABLE = (
    "Derivative",
    "Heaviside",
    "DiracDelta",
    "Abs",
    "sign",
    "Min",
    "Max",
    "Subs",
    "Piecewise",
    "nan",
    "zoo",
)


@pytest.mark.parametrize("name", MODELS)
def test_every_model_becomes_plain_code(name: str) -> None:
    system = MODELS[name]()
    text = module_text(system, derive(system))
    compile(text, name, "exec")
    words = set(text.replace("(", " ").replace(")", " ").replace(".", " ").split())
    assert words & set(UNPRINTABLE) == set()


@pytest.mark.parametrize("kinked", [sympy.Abs, sympy.sign, lambda x: sympy.Max(x, 0), sympy.Heaviside])
def test_refuses_functions_whose_derivative_cannot_be_printed(kinked: Callable[..., sympy.Expr]) -> None:
    x = symbol("x")
    system = System("kinked", {"x": kinked(x)}, (), (), {"y": x})
    with pytest.raises(ValueError, match=r"use ident\.dynamics\.symbols"):
        derive(system)


def test_refuses_a_symbol_that_is_nothing() -> None:
    with pytest.raises(ValueError, match="stray"):
        System("model", {"x": symbol("stray")}, (), (), {"y": symbol("x")})


def test_refuses_a_symbol_that_is_not_real_even_where_its_name_is_known() -> None:
    with pytest.raises(ValueError, match="x"):
        System("model", {"x": sympy.Symbol("x")}, (), (), {"y": symbol("x")})


def test_refuses_one_name_for_two_things() -> None:
    with pytest.raises(ValueError, match="two things"):
        System("model", {"x": symbol("x")}, ("x",), (), {"y": symbol("x")})


def test_refuses_names_that_differ_in_a_dot_only() -> None:
    system = System("model", {"x": symbol("a.b") + symbol("a_b")}, (), ("a.b", "a_b"), {"y": symbol("x")})
    with pytest.raises(ValueError, match="differ in a dot"):
        module_text(system, derive(system))


def test_the_fingerprint_tells_models_apart_and_is_the_same_for_the_same() -> None:
    def model(value: float, name: str = "p") -> System:
        return System("model", {"x": value * symbol(name)}, (), (name,), {"y": symbol("x")})

    assert model(2).fingerprint == model(2).fingerprint
    assert len({model(2).fingerprint, model(3).fingerprint, model(2, "q").fingerprint}) == 3


def test_numbers_and_arrays_are_printed_alike() -> None:
    x = symbol("x")
    third, half = sympy.Rational(1, 3), sympy.Rational(1, 2)
    expression = (
        sympy.log(sympy.exp(x**2 * third)) + sympy.acos(x / 3) * sympy.asin(x / 3) - sympy.sqrt(x) ** 3
    )
    expression += (
        choose((x**-3, (x > 1) & (x < 2)), (x**7, sympy.Not(x < 0) | (x > 5)), otherwise=-2) * x**half
    )
    points = np.array([0.3, 1.5, 2.5])
    text = {printer: printer({x: "x"}).doprint(expression) for printer in (ScalarPrinter, ArrayPrinter)}
    numbers = [eval(text[ScalarPrinter], {"math": math, "x": float(point)}) for point in points]
    assert numbers == pytest.approx([float(expression.subs(x, point)) for point in points], rel=1e-13)
    assert eval(text[ArrayPrinter], {"np": np, "x": points}) == pytest.approx(numbers, rel=1e-13)
