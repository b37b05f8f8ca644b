"""PAC2002 from a file to an axle: what is refused, signs, sides, dual tyres, the bicycle on such axles."""

from __future__ import annotations

from math import atan, cos

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from pac2002_published import published
from tyre_files import OTHERS, SCALING, tyre_text

from ident.dynamics.bicycle import bicycle
from ident.dynamics.derivation import derive
from ident.dynamics.symbols import symbol
from ident.dynamics.tyres import Tyre, evaluate, tyre_of
from ident.dynamics.tyres.pac2002_axle import (
    FITTED,
    pac2002_axle,
    scaling_of,
    slip_ratio_of_file,
    wheel_forces,
)
from ident.dynamics.tyres.pac2002_coefficients import NEEDED, Pac2002, pac2002_from_file, with_scaling
from ident.dynamics.tyres.property_file import parse_property_file, read_property_file
from ident.errors import BadRecipe

SLIP = np.linspace(-0.4, 0.4, 81)
LOAD = 55e3
PURE = "longitudinal lateral aligning"


def tyre_of_text(text: str) -> Pac2002:
    return pac2002_from_file(parse_property_file(text.encode(), "some.tir"))


TRUCK = tyre_of_text(tyre_text())
VALUES = dict(TRUCK.coefficients)


def axle_published(slip: float, load: float, tyres: int) -> float:
    """Axle force from the published formula, half of the tyres mirrored, with the source's slip angle."""
    one = load / tyres
    return tyres / 2 * (published(VALUES, one, -slip).fy0 - published(VALUES, one, slip).fy0)


def test_the_axle_has_the_force_of_all_its_tyres() -> None:
    for tyres in (2, 4):
        force, _, _ = evaluate(pac2002_axle(TRUCK, tyres), SLIP, scaling_of(TRUCK), LOAD)
        expected = [axle_published(slip, LOAD, tyres) for slip in SLIP.tolist()]
        assert force == pytest.approx(expected, rel=1e-9, abs=1e-7 * LOAD)


def test_a_positive_slip_angle_gives_a_positive_force_and_the_slope_is_the_stiffness_of_all_tyres() -> None:
    plain = tyre_of_text(tyre_text(model={"TYRESIDE": "SYMMETRIC"}))
    force, slope, gradient = evaluate(pac2002_axle(plain), SLIP, scaling_of(plain), LOAD)
    stiffness = -2 * published(dict(plain.coefficients), LOAD / 2, 0.0).ky
    assert np.all(force[SLIP > 0] > 0)
    assert stiffness > 3e5
    assert slope[40] == pytest.approx(stiffness, rel=1e-12)
    assert gradient[40] == pytest.approx(0.0, abs=1e-6)


def test_an_axle_pulls_nowhere_and_left_is_the_mirror_of_right() -> None:
    force, _, _ = evaluate(pac2002_axle(TRUCK), SLIP, scaling_of(TRUCK), LOAD)
    assert force[40] == 0.0
    assert force == pytest.approx(-force[::-1], rel=1e-12, abs=1e-9 * LOAD)


def test_the_gradient_to_the_scaling_factors_is_that_of_the_force() -> None:
    axle, values = pac2002_axle(TRUCK), scaling_of(TRUCK)
    _, slope, gradient = evaluate(axle, SLIP, values, LOAD)
    for column, name in enumerate(FITTED):
        above, below = (
            evaluate(axle, SLIP, values | {name: values[name] + step}, LOAD)[0] for step in (1e-5, -1e-5)
        )
        numeric = (above - below) / 2e-5
        assert gradient[:, column] == pytest.approx(numeric, rel=1e-5, abs=1e-6 * LOAD)
    ahead, behind = (evaluate(axle, SLIP + step, values, LOAD)[0] for step in (1e-6, -1e-6))
    smooth = np.abs(np.abs(SLIP) - abs(published(VALUES, LOAD / 2, 0.0).shy)) > 1e-5
    assert slope[smooth] == pytest.approx(((ahead - behind) / 2e-6)[smooth], rel=1e-4, abs=1e-5 * LOAD)


def test_scaling_factors_that_are_not_free_keep_the_value_of_the_file() -> None:
    force, _, gradient = evaluate(pac2002_axle(TRUCK, free=("LKY",)), SLIP, {"LKY": SCALING["LKY"]}, LOAD)
    expected, _, _ = evaluate(pac2002_axle(TRUCK), SLIP, scaling_of(TRUCK), LOAD)
    assert force == pytest.approx(expected, rel=1e-12)
    assert gradient.shape == (SLIP.size, 1)


def test_two_axles_of_one_file_are_the_same_kind_of_tyre() -> None:
    one, other = pac2002_axle(TRUCK), pac2002_axle(tyre_of_text(tyre_text()))
    assert one == other
    assert hash(one) == hash(other)
    assert one != pac2002_axle(TRUCK, 4)
    assert one.kind == "pac2002"
    assert tyre_of(one) is one


@pytest.mark.parametrize("tyres", [0, 1, 3, -2])
def test_refuses_an_axle_with_more_tyres_on_one_side(tyres: int) -> None:
    with pytest.raises(ValueError, match="need 2, 4"):
        pac2002_axle(TRUCK, tyres)


def test_refuses_a_scaling_factor_that_there_is_not() -> None:
    with pytest.raises(ValueError, match="no scaling factors: LKZ"):
        pac2002_axle(TRUCK, free=("LKY", "LKZ"))


def numbers(tyre: Pac2002, place: str, **state: float | None) -> tuple[float, float, float]:
    given = {name: None if value is None else sympy.Float(value) for name, value in state.items()}
    found = wheel_forces(tyre, place, **given)  # type: ignore[arg-type]
    return float(found.longitudinal), float(found.lateral), float(found.aligning)


@given(st.floats(-0.4, 0.4), st.floats(-0.8, 0.6), st.floats(-0.1, 0.1), st.floats(5e3, 6e4))
@settings(max_examples=10, deadline=None)
def test_a_wheel_on_the_other_side_is_the_mirror_image(
    slip: float, ratio: float, camber: float, load: float
) -> None:
    left = numbers(TRUCK, "left", slip_angle=slip, load=load, slip_ratio=ratio, camber=camber)
    right = numbers(TRUCK, "right", slip_angle=-slip, load=load, slip_ratio=ratio, camber=-camber)
    assert right == pytest.approx((left[0], -left[1], -left[2]), rel=1e-12)
    kappa = ratio if ratio <= 0 else ratio / (1 - ratio)
    own = published(VALUES, load, -slip, kappa, camber)
    assert left == pytest.approx((own.fx, own.fy, own.mz), rel=1e-9, abs=1e-8 * load)


def test_a_wheel_without_slip_ratio_rolls_freely() -> None:
    own = published(VALUES, 2e4, -0.1, 0.0, 0.02)
    found = numbers(TRUCK, "left", slip_angle=0.1, load=2e4, slip_ratio=None, camber=0.02)
    assert found == pytest.approx((0.0, own.fy0, own.mz0), rel=1e-10)


def test_the_aligning_moment_turns_the_wheel_back() -> None:
    _, force, moment = numbers(TRUCK, "left", slip_angle=0.05, load=3e4, slip_ratio=None)
    assert force > 1e3
    assert moment < -50.0


def test_the_slip_ratio_of_the_file_is_that_of_the_source_when_braking() -> None:
    speed, turning = 20.0, np.array([0.0, 5.0, 20.0, 22.0, 40.0])
    source = (turning - speed) / np.maximum(turning, speed)
    of_file = [float(slip_ratio_of_file(sympy.Float(value))) for value in source]
    assert of_file == pytest.approx((turning - speed) / speed)


@pytest.mark.parametrize(
    ("side", "expected"),
    [("LEFT", "left"), ("right", "right"), ("SYMMETRIC", "symmetric"), ("UNKNOWN", "left")],
)
def test_the_side_of_the_tyre_is_read(side: str, expected: str) -> None:
    assert tyre_of_text(tyre_text(model={"TYRESIDE": side})).side == expected


def test_a_tyre_of_the_right_side_is_itself_on_the_right() -> None:
    right = tyre_of_text(tyre_text(model={"TYRESIDE": "RIGHT"}))
    state = {"slip_angle": 0.07, "load": 3e4, "slip_ratio": None, "camber": 0.02}
    assert numbers(right, "right", **state) == numbers(TRUCK, "left", **state)
    assert numbers(right, "left", **state) == numbers(TRUCK, "right", **state)


def test_a_negative_use_mode_mirrors_the_tyre() -> None:
    assert tyre_of_text(tyre_text(model={"USE_MODE": -14.0})).side == "right"
    assert tyre_of_text(tyre_text(model={"USE_MODE": 14.0})).side == "left"


def test_the_pressure_is_taken_relative_to_the_nominal_one() -> None:
    assert VALUES["PRESSURE"] == pytest.approx((850e3 * 1.02 - 800e3) / 800e3)
    assert dict(tyre_of_text(tyre_text().replace("IP_NOM", "$")).coefficients)["PRESSURE"] == 0.0


def test_what_is_missing_later_is_zero_and_scaling_factors_are_one() -> None:
    tyre = tyre_of_text(tyre_text(without="PDX3 REX1 REY2 SSZ4 QBZ10 LKG LIP"))
    assert [tyre.value(name) for name in ("PDX3", "REX1", "REY2", "SSZ4", "QBZ10")] == [0.0] * 5
    assert (tyre.value("LKG"), tyre.value("LIP")) == (1.0, 1.0)
    assert tyre.missing == ()
    assert tyre.load_range == (2000.0, 70000.0)
    assert tyre_of_text(tyre_text().replace("LFZO ", "LFZ0 ")).value("LFZO") == SCALING["LFZO"]


def test_a_file_of_mf_tyre_5_is_read_by_its_fit_type() -> None:
    tyre = tyre_of_text(tyre_text(model={"PROPERTY_FILE_FORMAT": "", "FITTYP": 6}))
    assert tyre.coefficients == TRUCK.coefficients


def test_scaling_factors_of_a_fit_are_written_into_the_file() -> None:
    text = tyre_text(without="LKG").replace("LFZO ", "LFZ0 ")
    file = parse_property_file(text.encode(), "some.tir")
    fitted = with_scaling(file, {"LKY": 1.234, "LFZO": 0.9, "LKG": 1.1})
    changed = {"LKY": 1.234, "LFZO": 0.9, "LKG": 1.1}
    assert dict(pac2002_from_file(fitted).coefficients) == VALUES | changed
    assert len([line for line in fitted.lines if line not in file.lines]) == 3
    with pytest.raises(ValueError, match="no scaling factors: PKY1"):
        with_scaling(file, {"PKY1": 1.0})


def test_what_is_not_modelled_is_listed() -> None:
    text = (
        tyre_text() + "[ROLLING_COEFFICIENTS]\nQSY1 = 0.008\nQSY2 = 0\n[OVERTURNING]\nQSX1 = 0\nQSX3 = 0.1\n"
    )
    assert tyre_of_text(text).left_out == ("overturning moment (QSX3)", "rolling resistance moment (QSY1)")
    assert TRUCK.left_out == ()
    ellipse = tyre_of_text(tyre_text(model={"FE_METHOD": "YES"}))
    assert ellipse.left_out == ("friction ellipse for combined slip (FE_METHOD)",)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (tyre_text(model={"FITTYP": 61}), r"FITTYP = 61 is MF-Tyre/MF-Swift 6.1, need PAC2002 or MF_05"),
        (tyre_text(model={"FITTYP": 62}), r"is MF-Tyre/MF-Swift 6.2"),
        (tyre_text(model={"PROPERTY_FILE_FORMAT": "MF_05", "FITTYP": 52}), "FITTYP = 52 is not known"),
        (
            tyre_text(model={"PROPERTY_FILE_FORMAT": "FTIRE"}),
            "PROPERTY_FILE_FORMAT = 'FTIRE' is not modelled",
        ),
        (tyre_text(model={"PROPERTY_FILE_FORMAT": ""}), "no PROPERTY_FILE_FORMAT and no FITTYP"),
        (tyre_text(model={"TYRESIDE": "BOTH"}), "TYRESIDE = 'BOTH', need LEFT, RIGHT, SYMMETRIC or UNKNOWN"),
        (tyre_text(without="FNOMIN"), "FNOMIN is missing, need a positive number"),
        (tyre_text(FNOMIN=-1.0), "FNOMIN = -1, need a positive number"),
        (tyre_text(UNLOADED_RADIUS=0), "UNLOADED_RADIUS = 0, need a positive number"),
        (tyre_text(PKY1="much"), "PKY1 = 'much' .not a number."),
        (tyre_text(LFZO=0), "LFZO = 0, need a positive scaling factor"),
        (tyre_text(LMUY=-0.5), "LMUY = -0.5, need a positive scaling factor"),
        (tyre_text(LKY="1,1"), "LKY = '1,1' .not a number."),
        (tyre_text(without="PCX1 PCY1"), "no force can be computed: the file lacks PCY1: is the file whole"),
        (
            tyre_text().split("[LONGITUDINAL")[0],
            "lacks PCY1, PDY1, PDY2, PDY3 and 14 more: is the file whole",
        ),
        (tyre_text().replace("[UNITS]", "[NO_UNITS]"), "FNOMIN has a unit, but .* has no FORCE"),
    ],
)
def test_refuses_by_name_what_it_does_not_model(text: str, told: str) -> None:
    with pytest.raises(BadRecipe, match=told) as refused:
        tyre_of_text(text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "part", "told"),
    [
        (tyre_text(without="RBX1 RCX1"), "combined longitudinal", "the file lacks RBX1, RCX1"),
        (tyre_text(model={"FE_METHOD": "YES"}), "combined lateral", "no combined lateral force .*FE_METHOD"),
        (tyre_text(without="QDZ1"), "aligning", "no aligning moment of this tyre: the file lacks QDZ1"),
        (tyre_text(PDX1=0), "longitudinal", "no longitudinal force of this tyre: PDX1 is 0"),
        (tyre_text(without="PVY4"), "lateral", "no lateral force of this tyre: the file lacks PVY4"),
    ],
)
def test_a_part_that_the_file_cannot_tell_is_refused_when_it_is_asked_for(
    text: str, part: str, told: str
) -> None:
    tyre = tyre_of_text(text)
    others = [name for name in NEEDED if name not in dict(tyre.missing)]
    assert set(PURE.split()) - {part} <= set(others)
    tyre.symbols(*others)
    with pytest.raises(BadRecipe, match=told):
        tyre.symbols(part)  # type: ignore[arg-type]


def test_an_axle_is_refused_where_the_file_has_no_lateral_force() -> None:
    with pytest.raises(BadRecipe, match="no lateral force"):
        pac2002_axle(tyre_of_text(tyre_text(without="PKY1")))


EXPECTED = {
    "CityBus_Pac02Tire.tir": (),
    "HMMWV_Pac02Tire.tir": (),
    "Sedan_Pac02Tire.tir": ("combined longitudinal", "combined lateral"),
    "335_65R22_5_G275MSA_95psi.tir": ("combined longitudinal", "combined lateral"),
    "mf_185_80R14.tir": (),
}


@pytest.mark.parametrize(("name", "missing"), EXPECTED.items(), ids=list(EXPECTED))
def test_files_of_others_hold_what_they_hold(name: str, missing: tuple[str, ...]) -> None:
    if not (OTHERS / name).is_file():
        pytest.skip("no property files of others: set IDENT_TYRE_FILES to a folder of .tir")
    tyre = pac2002_from_file(read_property_file(OTHERS / name))
    assert tuple(part for part, _ in tyre.missing) == missing
    nominal = tyre.value("FNOMIN")
    force, slope, _ = evaluate(
        pac2002_axle(tyre, free=("LKY",)), np.array([0.0, 0.05, 0.5]), {"LKY": 1.0}, 2 * nominal
    )
    assert 4 < slope[0] / (2 * nominal) < 25
    assert 0 < force[1] < force[2] < 1.3 * 2 * nominal


def test_a_file_of_a_later_magic_formula_is_refused() -> None:
    path = OTHERS / "obfuscated_mf61.tir"
    if not path.is_file():
        pytest.skip("no property files of others: set IDENT_TYRE_FILES to a folder of .tir")
    with pytest.raises(BadRecipe, match=r"FITTYP = 61 is MF-Tyre/MF-Swift 6\.1"):
        pac2002_from_file(read_property_file(path))


def test_the_bicycle_stands_on_such_axles() -> None:
    front, rear = pac2002_axle(TRUCK, 2), pac2002_axle(TRUCK, 4)
    system = bicycle(front, rear)
    derive(system)  # refuses what has no plain derivative
    given = {
        "mass": 12500.0, "yaw_inertia": 52000.0, "cg_to_front_axle": 2.4, "cg_to_rear_axle": 2.1,
        "reference_x": 0.0, "imu_x": 0.0, "imu_y": 0.0, "steering_offset": 0.0,
        "bank_cos": 0.0, "bank_sin": 0.0,
        "road_wheel_angle": 0.06, "longitudinal_velocity": 14.0, "lateral_velocity": -0.3, "yaw_rate": 0.2,
    }  # fmt: skip
    given |= {
        f"{axle}.{name}": value for axle in ("front", "rear") for name, value in scaling_of(TRUCK).items()
    }
    known = {symbol(name): sympy.Float(value) for name, value in given.items()}
    for name, value in system.intermediates.items():
        known[symbol(name)] = value.xreplace(known).evalf()
    alpha_f = 0.06 - atan((-0.3 + 2.4 * 0.2) / 14.0)
    alpha_r = -atan((-0.3 - 2.1 * 0.2) / 14.0)
    weight = 12500.0 * 9.81
    force_f = axle_published(alpha_f, weight * 2.1 / 4.5, 2) * cos(0.06)
    force_r = axle_published(alpha_r, weight * 2.4 / 4.5, 4)
    turning = float(system.states["yaw_rate"].xreplace(known))
    assert turning == pytest.approx((2.4 * force_f - 2.1 * force_r) / 52000.0, rel=1e-9)
    sliding = float(system.states["lateral_velocity"].xreplace(known))
    assert sliding == pytest.approx((force_f + force_r) / 12500.0 - 14.0 * 0.2, rel=1e-9)


def test_a_kind_by_name_is_still_one() -> None:
    assert isinstance(tyre_of("linear"), Tyre)
    assert tyre_of("linear").kind == "linear"
