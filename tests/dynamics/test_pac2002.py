"""PAC2002 forces: the published equations written again, the limits of the theory, mirror and scaling."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import pi, sin

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pac2002_published import Published, published
from sympy import Expr
from tyre_files import OTHERS, SCALING, tyre_text

from ident.dynamics.derivation import FORBIDDEN
from ident.dynamics.printing import ArrayPrinter
from ident.dynamics.symbols import symbol
from ident.dynamics.tyres.pac2002 import (
    Contact,
    aligning_moment,
    cornering_stiffness,
    lateral_force,
    longitudinal_force,
    slip_stiffness,
)
from ident.dynamics.tyres.pac2002_coefficients import ONE_SIDED, pac2002_from_file
from ident.dynamics.tyres.pac2002_combined import (
    combined_aligning_moment,
    combined_lateral_force,
    combined_longitudinal_force,
    induced_lateral_force,
)
from ident.dynamics.tyres.property_file import parse_property_file, read_property_file

Array = NDArray[np.float64]
STATE = ("load", "slip_angle", "slip_ratio", "camber")
WANTED: dict[str, Callable[..., Expr]] = {
    "fx0": longitudinal_force,
    "fy0": lateral_force,
    "mz0": aligning_moment,
    "fx": combined_longitudinal_force,
    "fy": combined_lateral_force,
    "mz": combined_aligning_moment,
    "kx": slip_stiffness,
    "ky": cornering_stiffness,
    "svyk": induced_lateral_force,
}
TRUCK = pac2002_from_file(parse_property_file(tyre_text().encode(), "made-up.tir"))
VALUES = dict(TRUCK.coefficients)
SYMMETRIC = VALUES | dict.fromkeys(ONE_SIDED.split(), 0.0)
FILES = ("CityBus_Pac02Tire.tir", "HMMWV_Pac02Tire.tir", "mf_185_80R14.tir")
LOADS = st.floats(0.1, 2.5)
ANGLES = st.floats(-0.6, 0.6)
RATIOS = st.floats(-0.9, 1.5)
CAMBERS = st.floats(-0.15, 0.15)


def _compiled(c: Mapping[str, Expr], own: tuple[str, ...]) -> Callable[..., list[Array]]:
    contact = Contact(*(symbol(name) for name in STATE))
    found = [one(c, contact) for one in WANTED.values()]
    names = [symbol(name) for name in (*STATE, *own)]
    function: Callable[..., list[Array]] = sympy.lambdify(
        names, found, [{"np": np}], printer=ArrayPrinter({}), cse=True
    )
    return function


class Model:
    """The expressions of the package as numbers, with every coefficient free."""

    def __init__(self) -> None:
        self._function = _compiled({name: symbol(name) for name in VALUES}, tuple(VALUES))

    def __call__(
        self, p: Mapping[str, float], fz: float, alpha: float, kappa: float = 0.0, gamma: float = 0.0
    ) -> dict[str, float]:
        found = self._function(*map(np.float64, (fz, alpha, kappa, gamma, *(p[name] for name in VALUES))))
        return dict(zip(WANTED, map(float, found), strict=True))


@pytest.fixture(scope="module")
def model() -> Model:
    return Model()


def agree(found: Mapping[str, float], expected: Published, load: float) -> None:
    size = {"m": 0.05, "k": 10.0, "f": 1.0, "s": 1.0}
    for name, value in found.items():
        tolerance = 1e-11 * load * size[name[0]]
        assert value == pytest.approx(getattr(expected, name), rel=1e-9, abs=tolerance), name


@given(LOADS, ANGLES, RATIOS, CAMBERS, st.sampled_from([1.0, -1.0]), st.floats(0.5, 1.5))
@settings(max_examples=150, deadline=None)
def test_forces_are_those_of_the_published_equations(
    model: Model, load: float, alpha: float, kappa: float, gamma: float, side: float, factor: float
) -> None:
    p = {name: value * (factor if name in SCALING else 1.0) for name, value in VALUES.items()}
    p |= {name: side * p[name] for name in ("PEY3", "QEZ4", "PEX4", "PDY1", "PDY2")}
    fz = load * p["FNOMIN"]
    agree(model(p, fz, alpha, kappa, gamma), published(p, fz, alpha, kappa, gamma), fz)


@pytest.mark.parametrize("name", FILES)
def test_forces_of_a_file_of_others_are_those_of_the_published_equations(model: Model, name: str) -> None:
    path = OTHERS / name
    if not path.is_file():
        pytest.skip("no property files of others: set IDENT_TYRE_FILES to a folder of .tir")
    p = dict(pac2002_from_file(read_property_file(path)).coefficients)
    for fz in (0.2 * p["FNOMIN"], p["FNOMIN"], 2.2 * p["FNOMIN"]):
        for alpha in np.linspace(-1.2, 1.2, 13).tolist():
            for kappa, gamma in ((0.0, 0.0), (-0.3, 0.05), (0.1, -0.1)):
                agree(model(p, fz, alpha, kappa, gamma), published(p, fz, alpha, kappa, gamma), fz)


def test_numbers_in_place_of_symbols_change_nothing(model: Model) -> None:
    function = _compiled(TRUCK.symbols("lateral"), ())
    for state in ((9e3, 0.05, -0.1, 0.02), (5e4, -0.2, 0.3, -0.04)):
        expected = model(VALUES, *state)
        assert dict(zip(WANTED, function(*map(np.float64, state)), strict=True)) == pytest.approx(expected)


def test_every_coefficient_and_scaling_factor_is_in_the_equations() -> None:
    contact = Contact(*(symbol(name) for name in STATE))
    c = {name: symbol(name) for name in VALUES}
    used = set().union(*(one(c, contact).free_symbols for one in WANTED.values()))
    # the scale of the inflation pressure acts where the file is read
    assert set(VALUES) - {name.name for name in used} == {"LIP"}


@given(LOADS, CAMBERS)
@settings(max_examples=30, deadline=None)
def test_at_zero_shifted_slip_the_force_is_the_vertical_shift(
    model: Model, load: float, gamma: float
) -> None:
    fz = load * VALUES["FNOMIN"]
    at = published(VALUES, fz, 0.0, 0.0, gamma)
    assert model(VALUES, fz, -at.shy, 0.0, gamma)["fy0"] == pytest.approx(at.svy, abs=1e-10 * fz)
    assert model(VALUES, fz, 0.0, -at.shx, gamma)["fx0"] == pytest.approx(at.svx, abs=1e-10 * fz)


def test_a_symmetric_tyre_without_slip_has_neither_side_force_nor_moment(model: Model) -> None:
    found = model(SYMMETRIC, 30e3, 0.0)
    assert (found["fy0"], found["mz0"], found["fy"], found["mz"]) == (0.0, 0.0, 0.0, 0.0)


@given(LOADS, CAMBERS)
@settings(max_examples=30, deadline=None)
def test_the_stiffness_is_the_slope_where_the_shifted_slip_is_zero(
    model: Model, load: float, gamma: float
) -> None:
    fz, step = load * VALUES["FNOMIN"], 1e-5
    at = published(VALUES, fz, 0.0, 0.0, gamma)
    lateral = [model(VALUES, fz, -at.shy + side * step, 0.0, gamma)["fy0"] for side in (1, -1)]
    along = [model(VALUES, fz, 0.0, -at.shx + side * step, gamma)["fx0"] for side in (1, -1)]
    found = model(VALUES, fz, 0.0, 0.0, gamma)
    assert (lateral[0] - lateral[1]) / (2 * step) == pytest.approx(found["ky"], rel=1e-5)
    assert (along[0] - along[1]) / (2 * step) == pytest.approx(found["kx"], rel=1e-5)


def test_the_cornering_stiffness_is_greatest_at_the_load_that_the_file_says(model: Model) -> None:
    p = VALUES | {"PRESSURE": 0.0}
    nominal = p["FNOMIN"] * p["LFZO"]
    loads = nominal * np.linspace(0.5, 6.0, 2201)
    stiffness = np.array([abs(model(p, fz, 0.0)["ky"]) for fz in loads])
    assert loads[np.argmax(stiffness)] == pytest.approx(p["PKY2"] * nominal, rel=2e-3)
    assert stiffness.max() == pytest.approx(abs(p["PKY1"]) * nominal * p["LKY"], rel=1e-5)


def test_the_peak_is_friction_times_load(model: Model) -> None:
    fz = 40e3
    at = published(VALUES, fz, 0.0)
    lateral = np.array([model(VALUES, fz, alpha)["fy0"] for alpha in np.linspace(-1.5, 0.0, 3001)])
    along = np.array([model(VALUES, fz, 0.0, kappa)["fx0"] for kappa in np.linspace(0.0, 1.5, 3001)])
    assert np.max(lateral) - at.svy == pytest.approx(at.dy, rel=1e-6)
    assert np.max(along) - at.svx == pytest.approx(at.dx, rel=1e-6)


def test_a_sliding_tyre_keeps_the_force_of_its_shape(model: Model) -> None:
    fz = 20e3
    at = published(VALUES, fz, 0.0)
    assert model(VALUES, fz, 1e9)["fy0"] == pytest.approx(at.svy - at.dy * sin(at.cy * pi / 2), rel=1e-6)
    assert model(VALUES, fz, 0.0, 1e9)["fx0"] == pytest.approx(at.svx + at.dx * sin(at.cx * pi / 2), rel=1e-6)


@given(LOADS, ANGLES, RATIOS, CAMBERS)
@settings(max_examples=50, deadline=None)
def test_combined_slip_reduces_to_pure_slip(
    model: Model, load: float, alpha: float, kappa: float, gamma: float
) -> None:
    fz, no_arm = load * VALUES["FNOMIN"], VALUES | {"LS": 0.0}
    sideways, along = model(no_arm, fz, alpha, 0.0, gamma), model(no_arm, fz, 0.0, kappa, gamma)
    assert sideways["svyk"] == 0.0
    assert sideways["fy"] == pytest.approx(sideways["fy0"], rel=1e-12)
    assert sideways["mz"] == pytest.approx(sideways["mz0"], rel=1e-9, abs=1e-9 * fz)
    assert along["fx"] == pytest.approx(along["fx0"], rel=1e-12)


def test_the_other_slip_takes_from_a_force(model: Model) -> None:
    fz = 30e3
    lateral = [abs(model(SYMMETRIC, fz, -0.1, kappa)["fy"]) for kappa in (0.0, -0.05, -0.2, -0.8)]
    along = [abs(model(SYMMETRIC, fz, alpha, -0.1)["fx"]) for alpha in (0.0, 0.05, 0.2, 0.6)]
    assert lateral == sorted(lateral, reverse=True)
    assert along == sorted(along, reverse=True)
    assert lateral[-1] < 0.5 * lateral[0]
    assert along[-1] < 0.7 * along[0]


@given(LOADS, ANGLES, RATIOS, CAMBERS)
@settings(max_examples=60, deadline=None)
def test_a_symmetric_tyre_is_its_own_mirror_image(
    model: Model, load: float, alpha: float, kappa: float, gamma: float
) -> None:
    fz = load * SYMMETRIC["FNOMIN"]
    one, other = model(SYMMETRIC, fz, alpha, kappa, gamma), model(SYMMETRIC, fz, -alpha, kappa, -gamma)
    for name, sign in {"fx0": 1, "fx": 1, "fy0": -1, "fy": -1, "mz0": -1, "mz": -1}.items():
        assert other[name] == pytest.approx(sign * one[name], rel=1e-9, abs=1e-9 * fz), name


@pytest.mark.parametrize("name", ONE_SIDED.split())
def test_each_one_sided_coefficient_breaks_the_mirror(model: Model, name: str) -> None:
    p = SYMMETRIC | {name: VALUES[name]}
    one, other = model(p, 25e3, 0.06, -0.05, 0.03), model(p, 25e3, -0.06, -0.05, -0.03)
    signs = {"fx": 1, "fy": -1, "mz": -1}
    assert any(abs(other[force] - sign * one[force]) > 0.01 for force, sign in signs.items())


@given(LOADS, ANGLES, RATIOS, st.floats(0.5, 2.0))
@settings(max_examples=40, deadline=None)
def test_a_greater_nominal_load_scales_loads_and_forces_alike(
    model: Model, load: float, alpha: float, kappa: float, factor: float
) -> None:
    fz, scaled = load * VALUES["FNOMIN"], VALUES | {"LFZO": factor * VALUES["LFZO"]}
    one, other = model(VALUES, fz, alpha, kappa), model(scaled, factor * fz, alpha, kappa)
    for name in ("fx0", "fy0", "mz0", "fx", "fy", "mz", "kx", "ky"):
        assert other[name] == pytest.approx(factor * one[name], rel=1e-9, abs=1e-9 * fz), name


def test_scaling_factors_do_what_they_are_named_for(model: Model) -> None:
    fz, before = 30e3, published(VALUES, 30e3, 0.0)
    for name, what in {
        "LKY": "ky",
        "LKX": "kx",
        "LMUY": "dy",
        "LMUX": "dx",
        "LCY": "cy",
        "LCX": "cx",
    }.items():
        scaled = VALUES | {name: 1.25 * VALUES[name]}
        assert getattr(published(scaled, fz, 0.0), what) == pytest.approx(1.25 * getattr(before, what))
    stiff = model(VALUES | {"LKY": 2 * VALUES["LKY"]}, fz, 0.0)
    assert stiff["ky"] == pytest.approx(2 * before.ky, rel=1e-12)
    assert stiff["kx"] == pytest.approx(before.kx, rel=1e-12)


@pytest.mark.parametrize("load", [0.0, -5e3])
def test_a_tyre_without_load_has_no_force_and_no_infinity(model: Model, load: float) -> None:
    found = model(VALUES, load, 0.2, -0.3, 0.05)
    assert {abs(value) for value in found.values()} == {0.0}


def test_the_curvature_never_passes_one(model: Model) -> None:
    p = VALUES | {"PEY1": 6.0, "PEX1": 6.0, "QEZ1": 6.0}
    at = VALUES | {"PEY1": 60.0, "PEX1": 60.0, "QEZ1": 60.0}
    for alpha in (-0.1, 0.1):
        assert model(p, 30e3, alpha, 0.1) == pytest.approx(model(at, 30e3, alpha, 0.1), rel=1e-12)
        agree(model(p, 30e3, alpha, 0.1), published(p, 30e3, alpha, 0.1), 30e3)


def test_the_derivatives_exist_everywhere() -> None:
    contact = Contact(*(symbol(name) for name in STATE))
    free = {name: symbol(name) for name in ("LKY", "LMUY", "LFZO", "LEY")}
    c = TRUCK.symbols("lateral", free=free)
    slopes = [
        sympy.diff(force(c, contact), to)
        for force in (lateral_force, longitudinal_force, combined_lateral_force, aligning_moment)
        for to in (contact.slip_angle, contact.slip_ratio, contact.load, contact.camber, free["LKY"])
    ]
    assert not any(slope.has(*FORBIDDEN) for slope in slopes)
    names = [symbol(name) for name in STATE] + list(free.values())
    numbers = sympy.lambdify(names, slopes, [{"np": np}], printer=ArrayPrinter({}), cse=True)
    shift = published(VALUES, 3e4, 0.0)
    for state in ((3e4, 0.0, 0.0, 0.0), (3e4, -shift.shy, -shift.shx, 0.0), (0.0, 0.0, 0.0, 0.0)):
        values = np.array(numbers(*map(np.float64, (*state, 1.0, 1.0, 1.0, 1.0))), dtype=float)
        assert np.isfinite(values).all(), state
