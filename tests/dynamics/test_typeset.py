import xml.etree.ElementTree as ET

import pytest
import sympy
from sympy import Abs, Derivative, Eq, Function, Max, Rational, exp, sign, sqrt, symbols

from ident.dynamics.typeset import mathml

t, u, v, F_static, DeltaF_z, delta_0 = symbols("t u v F_static DeltaF_z delta_0")
sigma, omega = symbols("sigma omega", positive=True)
F, phi_b = Function("F")(t), Function("phi_b")(t)


def inside(expression):
    text = mathml(expression)
    ET.fromstring(text)
    return text.removeprefix('<math display="block">').removesuffix("</math>")


def read(expression):
    """The letters of an equation in their order."""
    return "".join(ET.fromstring(mathml(expression)).itertext())


def test_a_relaxation_has_a_dot_and_no_argument():
    equation = Eq(sigma / v * Derivative(F, t) + F, F_static, evaluate=False)
    assert inside(equation) == (
        "<mrow><mrow><mrow><mfrac><mrow><mi>σ</mi></mrow><mi>v</mi></mfrac>"
        '<mspace width="0.17em"></mspace><mover><mi>F</mi><mo>˙</mo></mover></mrow>'
        "<mo>+</mo><mi>F</mi></mrow>"
        "<mo>=</mo><msub><mi>F</mi><mi>static</mi></msub></mrow>"
    )


def test_the_highest_derivative_stands_first():
    mode = phi_b.diff(t, 2) + 2 * omega * phi_b.diff(t) + omega**2 * phi_b
    assert read(mode) == "φ¨b+2ωφ˙b+ω2φb"


def test_what_is_taken_off_stands_behind():
    assert read(1 - u**2 / delta_0**2) == "1−u2δ02"
    assert "<msubsup><mi>δ</mi><mn>0</mn>" not in inside(delta_0)
    assert inside(delta_0**2) == "<msubsup><mi>δ</mi><mi>0</mi><mn>2</mn></msubsup>"
    assert inside(DeltaF_z) == (
        '<msub><mrow><mi mathvariant="normal">Δ</mi><mi>F</mi></mrow><mi>z</mi></msub>'
    )


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        (sign(u) * Max(Abs(u) - v, 0), "sgn(u)max(|u|−v,0)"),
        (-u, "−u"),
        (u - v, "u−v"),
        (-(u + v) * sigma, "σ(−u−v)"),
        (1 / u, "1u"),
        (Rational(-1, 2) * u, "−u2"),
        (sqrt(u) / 2, "u2"),
        (exp(u) * sympy.Float(0.25), "0.25exp(u)"),
        (Eq(u, Function("clip")(v, -sigma, sigma)), "u=clip(v,−σ,σ)"),
        (Abs(u - v) <= sigma / 2, "|u−v|≤σ2"),
    ],
)
def test_expressions_are_read_from_left_to_right(expression, text):
    assert read(expression) == text


def test_a_sum_in_a_product_is_fenced_and_alone_in_a_fraction_is_not():
    assert read(u * (1 + v)) == "u(1+v)"
    assert read(u / (1 + v)) == "u1+v"
    assert read((1 + v) / u) == "1+vu"
    assert read((1 + v) ** 2) == "(1+v)2"


def test_what_has_no_form_is_refused_not_guessed():
    with pytest.raises(ValueError, match="atan has no form"):
        mathml(sympy.atan(u))
    with pytest.raises(ValueError, match="Integral has no form"):
        mathml(sympy.Integral(F, t))
    with pytest.raises(ValueError, match="derivative of order 3"):
        mathml(F.diff(t, 3))
