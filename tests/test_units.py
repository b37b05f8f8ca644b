"""Units are converted to SI once, and a wrong one is refused by name."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ident.errors import BadRecipe
from ident.glossary import SIGNALS
from ident.units import factor, is_raw, parse_quantity, to_si


@pytest.mark.parametrize(
    ("unit", "needed", "expected"),
    [
        ("deg", "rad", math.pi / 180),
        ("°", "rad", math.pi / 180),
        ("mrad", "rad", 1e-3),
        ("turn", "rad", 2 * math.pi),
        ("deg/s", "rad/s", math.pi / 180),
        ("rpm", "rad/s", 2 * math.pi / 60),
        ("Hz", "rad/s", 2 * math.pi),
        ("kHz", "rad/s", 2000 * math.pi),
        ("Hz", "Hz", 1.0),
        ("km/h", "m/s", 1 / 3.6),
        ("kph", "m/s", 1 / 3.6),
        ("mph", "m/s", 0.44704),
        ("m/s²", "m/s^2", 1.0),
        ("g", "m/s^2", 9.80665),
        ("g_0", "m/s^2", 9.80665),
        ("kN", "N", 1e3),
        ("Nm", "N m", 1.0),
        ("kNm", "N m", 1e3),
        ("N m", "N m", 1.0),
        ("t", "kg", 1e3),
        ("kg*m^2", "kg m^2", 1.0),
        ("kN/deg", "N/rad", 1e3 * 180 / math.pi),
        ("%", "1", 0.01),
        ("mm", "m", 1e-3),
        ("ms", "s", 1e-3),
    ],
)
def test_converts_to_si(unit, needed, expected):
    assert factor(unit, needed, "x") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "needed"),
    [
        ("rad", "rad/s"),
        ("%", "rad"),
        ("deg", "1"),
        ("1/s", "rad/s"),
        ("m", "m/s"),
        ("N", "N m"),
        ("parsec/fortnight", "m/s"),
        ("", "m"),
        ("m^9^9^9^9", "m"),
        ("m**(9**9**9)", "m"),
        ("m" * 500, "m"),
        ("__import__('os')", "m"),
    ],
)
def test_a_unit_that_does_not_fit_is_refused_by_name(unit, needed):
    with pytest.raises(BadRecipe) as caught:
        factor(unit, needed, "yaw_rate")
    message = str(caught.value)
    assert message.startswith("yaw_rate: unit ")
    assert repr(unit) in message
    assert repr(needed) in message
    assert "\n" not in message


@pytest.mark.parametrize("name", list(SIGNALS))
def test_every_unit_of_the_glossary_is_known_and_si(name):
    assert factor(SIGNALS[name].unit, SIGNALS[name].unit, name) == 1.0


def test_a_count_is_marked_and_not_converted():
    assert is_raw("raw", "N m")
    assert is_raw("1", "N m")
    assert not is_raw("1", "1")
    assert factor("raw", "N m", "x") == 1.0


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("12500 kg", "kg", 12500.0),
        ("12.5t", "kg", 12500.0),
        ("-1e3 mm", "m", -1.0),
        (".5 s", "s", 0.5),
        ("20.5", "1", 20.5),
        (20.5, "1", 20.5),
        (3, "1", 3.0),
        ("200 ms", "s", 0.2),
    ],
)
def test_reads_a_quantity(text, unit, expected):
    assert parse_quantity(text, unit=unit, quantity="x") == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    "text", [12500, "12500", "kg", "", None, True, "1 kg kg", "1 raw", "inf kg", "nan kg", "1e999 kg", [1]]
)
def test_a_quantity_without_a_number_or_a_unit_is_refused(text):
    with pytest.raises(BadRecipe, match=r"^mass: "):
        parse_quantity(text, unit="kg", quantity="mass")


@given(st.floats(-1e6, 1e6))
def test_there_and_back_is_the_same_angle(value):
    assert to_si(value, "deg", "rad", "x") * 180 / math.pi == pytest.approx(value, rel=1e-12, abs=1e-12)
