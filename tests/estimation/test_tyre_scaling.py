"""Scaling factors of PAC2002 tyres, on a truck whose tyres are the published formulas in plain numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from pac2002_truck import TRUE, axle_force, measured, runs
from plane_truck import BODY, INERTIA
from scipy.stats import chi2
from tyre_files import SCALING, tyre_text

from ident.dynamics.tyres import Tyre
from ident.dynamics.tyres.pac2002_axle import pac2002_axle
from ident.dynamics.tyres.pac2002_coefficients import pac2002_from_file
from ident.dynamics.tyres.property_file import parse_property_file
from ident.estimation.tyre_estimates import tyre_fit, uncertainty
from ident.estimation.tyre_fit import Axles, Body, KindFit
from ident.estimation.tyre_scaling import ORDER, fit_scaling, scaling_starts
from ident.results import TyreFit

AXLES = ("front", "rear")
OWN = {f"{axle}.{name}": SCALING[name] for axle in AXLES for name in ("LKY", *ORDER)}
GENTLE, DRIVEN, HARD = 0.03, 0.09, 0.2  # [rad] of the road wheels
SETS = 6


@cache
def tyre() -> Tyre:
    text = tyre_text(model={"TYRESIDE": "SYMMETRIC"})
    return pac2002_axle(pac2002_from_file(parse_property_file(text.encode(), "truck.tir")))


@cache
def driven(most: float):
    return runs(most, 9.0)


def fitted(records, body: Body = BODY) -> KindFit:
    return fit_scaling(records, dict.fromkeys(AXLES, tyre()), OWN, body, bank=False)


@cache
def found(most: float, seed: int) -> KindFit:
    return fitted(measured(driven(most), seed))


def told(one: KindFit) -> TyreFit:
    return tyre_fit(one, uncertainty(one), 0.0)


def free(one: KindFit) -> set[str]:
    return {name for name in one.names if name in OWN}


def slope_of_truth(axle: str, factors: Mapping[str, float]) -> float:
    force = axle_force(axle, factors)
    return (force(1e-6) - force(-1e-6)) / 2e-6


def test_what_was_driven_without_noise_is_found() -> None:
    one = fitted(driven(DRIVEN))
    values = OWN | one.parameters
    within = {"LCY": 5e-3, "LEY": 5e-2}  # they make up for each other, so that steps of integration move both
    for name, true in (OWN | TRUE).items():
        assert values[name] == pytest.approx(true, rel=within.get(name.rpartition(".")[2], 2e-3)), name
    assert values["yaw_inertia"] == pytest.approx(INERTIA, rel=2e-3)
    for axle in AXLES:
        right, own = axle_force(axle, OWN | TRUE), axle_force(axle, values)
        slips = np.linspace(0.1, 1.0, 10) * DRIVEN
        forces = np.array([[force(slip) for slip in slips] for force in (right, own)])
        assert np.abs(forces[1] - forces[0]).max() < 1e-4 * forces[0].max()


def test_the_errors_are_as_large_as_the_standard_errors_say() -> None:
    names = (*TRUE, "yaw_inertia")
    true = TRUE | {"yaw_inertia": INERTIA}
    z = []
    for seed in range(SETS):
        one = found(DRIVEN, seed)
        assert free(one) == set(TRUE)
        std = dict(zip(one.names, np.sqrt(np.diag(one.fit.covariance)), strict=True))
        z.append([np.log(one.parameters[name] / true[name]) / std[name] for name in names])
    low, high = chi2.ppf([0.0005, 0.9995], SETS)
    squares = np.square(z).sum(axis=0)
    assert np.all((low < squares) & (squares < high)), squares
    assert np.all(np.abs(np.mean(z, axis=0)) < 3.3 / np.sqrt(SETS)), np.mean(z, axis=0)


@pytest.mark.parametrize(("most", "expected"), [(GENTLE, {"front.LKY", "rear.LKY"}), (DRIVEN, set(TRUE))])
def test_a_factor_is_free_only_where_the_data_tell_it(most: float, expected: set[str]) -> None:
    one = found(most, 1)
    assert free(one) == expected
    for name in set(OWN) - expected:
        axle, _, own = name.partition(".")
        estimate = getattr(told(one), axle)[own]
        assert (estimate.value, estimate.std, estimate.low) == (OWN[name], None, None)
        assert estimate.status == "not_identifiable"
        assert estimate.reason.startswith("keeps the value of the file: ")


@pytest.mark.parametrize("most", [GENTLE, DRIVEN, HARD])
def test_nothing_further_out_is_free_where_something_nearer_is_held(most: float) -> None:
    one = found(most, 1)
    for axle in AXLES:
        states = [f"{axle}.{name}" in free(one) for name in ("LKY", *ORDER)]
        assert states == sorted(states, reverse=True)
    covered = [name for name in free(one) if name.rpartition(".")[2] in ORDER]
    std = dict(zip(one.names, np.sqrt(np.diag(one.fit.covariance)), strict=True))
    assert all(std[name] < 0.3 for name in covered)


def test_friction_is_weak_at_best_where_the_force_has_not_come_near_its_peak() -> None:
    for estimate in (getattr(told(found(DRIVEN, 1)), axle)["LMUY"] for axle in AXLES):
        assert estimate.std / estimate.value < 0.1
        assert estimate.status == "weak"
        assert estimate.low is not None
        assert estimate.reason.startswith("rests on the shape of the curve beyond what was driven")


def test_hard_driving_tells_more_than_the_friction() -> None:
    one = found(HARD, 1)
    assert {"front.LCY"} <= free(one)
    true = OWN | TRUE
    std = dict(zip(one.names, np.sqrt(np.diag(one.fit.covariance)), strict=True))
    for name in free(one) - {"front.LEY", "rear.LEY"}:
        assert abs(np.log(one.parameters[name] / true[name])) < 3.5 * std[name], name


def test_the_stiffness_beside_the_factors_is_the_slope_at_zero_slip() -> None:
    one = found(DRIVEN, 2)
    for axle in AXLES:
        estimate = getattr(told(one), axle)["cornering_stiffness"]
        assert estimate.value == pytest.approx(slope_of_truth(axle, one.of_axle(axle)), rel=1e-6)
        factor = getattr(told(one), axle)["LKY"]
        assert estimate.std / estimate.value == pytest.approx(factor.std / factor.value, rel=1e-6)
        assert estimate.low == pytest.approx(estimate.value * factor.low / factor.value, rel=1e-6)


def test_the_curve_is_that_of_the_published_formulas_and_certain_at_zero_slip() -> None:
    one = found(DRIVEN, 2)
    for axle in AXLES:
        curve = told(one).curves[axle]
        force = axle_force(axle, one.of_axle(axle))
        assert curve.force == pytest.approx([force(slip) for slip in curve.slip_angle], rel=1e-9, abs=1e-6)
        middle = len(curve.slip_angle) // 2
        assert curve.force_std[middle] == pytest.approx(0.0, abs=1e-6)
        assert curve.force_std[-1] > curve.force_std[middle + 5] > 0


def test_an_error_of_the_mass_moves_the_understeer_gradient_as_a_fit_with_another_mass_does() -> None:
    """Through the load, too, on which the stiffness of such tyres depends."""
    records, share = measured(driven(DRIVEN), 3), 0.02
    plain, heavier = found(DRIVEN, 3), fitted(records, replace(BODY, mass=BODY.mass * (1 + share)))
    assert free(plain) == free(heavier)
    moved = told(heavier).understeer_gradient.value - told(plain).understeer_gradient.value
    stated = replace(plain, body=replace(BODY, std={"mass": share * BODY.mass}))
    gained = told(stated).understeer_gradient.std ** 2 - told(plain).understeer_gradient.std ** 2
    assert abs(moved) == pytest.approx(
        np.sqrt(max(gained, 0.0)), abs=0.1 * told(plain).understeer_gradient.std
    )


def test_starts_lie_at_the_stiffness_of_gentle_driving() -> None:
    axles = Axles(tyre(), tyre())
    first = scaling_starts(axles, OWN, measured(driven(DRIVEN), 1), BODY)[0]
    for axle in AXLES:
        values = {name: first[f"{axle}.{name}"] for name in tyre().names}
        true = {name: (OWN | TRUE)[f"{axle}.{name}"] for name in tyre().names}
        assert slope_of_truth(axle, values) == pytest.approx(slope_of_truth(axle, true), rel=0.15)
    assert {name.partition(".")[0] for name in first} == {*AXLES, "yaw_inertia", "steering_offset"}
