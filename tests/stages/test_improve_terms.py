"""Generic terms as they are told: every term that can be fitted has its unit and its equation."""

from __future__ import annotations

import re

import pytest

from ident.dynamics.typeset import mathml
from ident.estimation.actuator_terms import PLACES
from ident.estimation.motion_basis import EQUATIONS, OF_FORCES
from ident.stages.improve_terms import ACTUATOR, TERMS, UNITS, equation_with_term, unit_of_term


def plain(equation: str, term: str) -> str:
    """The typeset equation without its marks."""
    return re.sub("<[^>]*>", "", mathml(equation_with_term(equation, term)))


@pytest.mark.parametrize("place", PLACES)
def test_every_term_of_the_actuator_has_an_equation_and_a_unit(place: str) -> None:
    assert place in ACTUATOR
    for term in PLACES[place]:
        assert term in TERMS
        assert "c" in plain(place, term)
        assert unit_of_term(place, term).startswith("rad")


def test_every_equation_of_the_motion_has_a_unit() -> None:
    assert set(EQUATIONS) <= set(UNITS)
    assert set(OF_FORCES) <= set(TERMS)
    assert plain("yaw_moment", "sgn(du/dt)") == "r˙=csgn(u˙)+MIz"
    assert unit_of_term("yaw_moment", "r|r|") == "rad/s^2 per rad^2/s^2"
    assert unit_of_term("lateral_force", "cos(heading)") == "m/s^2"


@pytest.mark.parametrize(
    ("key", "unit", "equation"),
    [
        ("lags: v u'", "rad per rad m/s^2", "T1T2θ¨+(T1+T2)θ˙+θ=K(cvθ˙+u)"),
        ("lags: sgn u'", "rad", "T1T2θ¨+(T1+T2)θ˙+θ=K(csgn(θ˙)+u)"),
        ("request: |u|", "rad per rad", "T1T2θ¨+(T1+T2)θ˙+θ=K(u+c|u|)"),
        ("request: v u", "rad per rad m/s", "T1T2θ¨+(T1+T2)θ˙+θ=K(u+cuv)"),
        ("angle: t", "rad per s", "θmeasured=ct+θ"),
        ("angle: step", "rad", "θmeasured=cf+θ"),
    ],
)
def test_a_term_stands_where_it_acts(key: str, unit: str, equation: str) -> None:
    place, _, term = key.partition(": ")
    assert unit_of_term(place, term) == unit
    assert plain(place, term) == equation
