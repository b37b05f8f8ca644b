"""Maximum likelihood with identified noise, least squares where the model is wrong, and what is fixed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plane_truck import BODY, INERTIA, NOISE, PlaneTruck, inputs, linear, magic
from scipy.stats import kstest

from ident.estimation.noise import AutoRegression, NoiseModel
from ident.estimation.signal_noise import LONGEST_NOISE, capped_noise, identify_noise, noise_of_residuals
from ident.estimation.tyre_fit import Body, KindFit, fit_tyres
from ident.estimation.vehicle_fit import run_agreement, to_fixed
from ident.estimation.vehicle_problem import STEERING_RATIO

C_F, C_R = 330e3, 417e3
TRUCK = PlaneTruck(linear(C_F), linear(C_R))
BENT = PlaneTruck(magic(C_F, 36e3, 1.4, -0.8), magic(C_R, 40e3, 1.35, -0.5))
TRUE = {"front.cornering_stiffness": C_F, "rear.cornering_stiffness": C_R, "yaw_inertia": INERTIA}
FIXED = ("mass", "cg_to_front_axle", "cg_to_rear_axle", STEERING_RATIO)
SENSORS = (*[name for name in NOISE if not name.startswith("position")], "position_along", "position_across")
SIZES = NOISE | dict.fromkeys(("position_along", "position_across"), NOISE["position_x"])


def runs(truck=TRUCK, *, seed=0, most=0.06, count=2, seconds=16.0, colour=0.0):
    return [
        truck.drive(*inputs(seconds, seed=run, most=most), run=run, seed=100 * seed + run, colour=colour)
        for run in range(count)
    ]


def known_noise():
    return {name: NoiseModel(AutoRegression(np.zeros(0)), SIZES[name]) for name in SENSORS}


def fit(records, body=BODY, start=TRUE, **how) -> KindFit:
    return fit_tyres(records, "linear", body, [start], bank=False, **how)


@cache
def plain() -> KindFit:
    return fit(runs())


@cache
def wrong() -> KindFit:
    """Linear tyres fitted to hard driving on tyres that bend."""
    return fit(runs(BENT, most=0.13))


def std_of(covariance):
    return np.sqrt(np.diag(covariance))


# --- noise -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("colour", [0.0, 0.7])
def test_noise_is_identified_as_it_was_made(colour):
    found = fit(runs(colour=colour))
    assert not found.fit.is_coloured
    assert set(found.fit.point.noise) == set(SENSORS)
    for name, noise in found.fit.point.noise.items():
        assert noise.total_std == pytest.approx(SIZES[name], rel=0.08), name
        coefficients = noise.shape.coefficients
        assert sum(coefficients) == pytest.approx(colour, abs=0.12), name
        assert coefficients.size <= 2, name


def test_colour_of_the_noise_widens_the_errors():
    """Slow noise of the same size tells less: the factor of AR(1) at low frequency is sqrt(1.7/0.3)."""
    ratio = std_of(fit(runs(colour=0.7)).fit.covariance) / std_of(plain().fit.covariance)
    assert (ratio > 1.5).all()
    assert (ratio < np.sqrt(1.7 / 0.3) * 1.1).all()


def test_noise_below_the_resolution_of_a_sensor_is_not_believed():
    floor = {"heading": 5 * NOISE["heading"]}
    found = fit(runs(), floor=floor)
    assert found.fit.point.noise["heading"].total_std == pytest.approx(floor["heading"], rel=1e-6)
    assert found.fit.point.noise["yaw_rate"].total_std == pytest.approx(NOISE["yaw_rate"], rel=0.05)
    assert std_of(found.fit.covariance)[0] > std_of(plain().fit.covariance)[0]


def test_what_is_correlated_for_a_second_is_not_taken_for_noise_of_a_sensor():
    found = fit(runs(colour=0.99))
    assert np.exp(-0.01 / LONGEST_NOISE) < 0.99
    assert found.fit.capped == set(SENSORS)
    assert found.fit.is_coloured
    error = (found.fit.shared[:3] - np.log(list(TRUE.values()))) / std_of(found.fit.covariance)[:3]
    assert np.abs(error).max() < 3.3
    assert (std_of(found.fit.covariance) > 3 * std_of(plain().fit.covariance)).all()


def test_only_slow_noise_is_told_as_a_lower_limit():
    slow, quick = fit(runs(colour=0.99)).fit, plain().fit
    unweighed = slow.point.with_noise(identify_noise(slow.point, {}, keep_order=False)[0])
    assert set(capped_noise(unweighed)) == set(SENSORS)
    assert not capped_noise(quick.point)
    for name in SENSORS:
        assert unweighed.noise[name].total_std < 0.8 * SIZES[name], name


def test_the_exact_model_is_hardly_ever_called_coloured():
    found = [fit(runs(seed=seed, count=1)) for seed in range(1, 7)]
    assert sum(one.fit.is_coloured for one in found) == 0
    p = [value for one in found for value in one.fit.coloured.values()]
    assert np.mean(np.array(p) < 0.01) < 0.1


# --- a model that is wrong ---------------------------------------------------------------------------


def test_what_a_wrong_model_leaves_does_not_hide_the_noise_of_the_sensors():
    found = wrong().fit
    noise = noise_of_residuals(found.point, {})
    assert max(found.point.noise[name].std / SIZES[name] for name in SENSORS) > 3.0  # weights of the fit
    for name in SENSORS:
        assert noise[name].std == pytest.approx(SIZES[name], rel=0.2), name


def test_a_wrong_model_is_fitted_by_least_squares_with_wider_errors():
    found = wrong()
    assert found.fit.is_coloured
    assert all(noise.shape.coefficients.size == 0 for noise in found.fit.point.noise.values())
    assert found.fit.converged
    cramer_rao = std_of(np.linalg.inv(found.fit.information))
    names = ("front.cornering_stiffness", "rear.cornering_stiffness", "yaw_inertia")
    index = [found.names.index(name) for name in names]
    assert (std_of(found.fit.covariance)[index] > 1.3 * cramer_rao[index]).all()


def test_bent_tyres_look_softer_to_a_linear_model_as_the_chord_is():
    """Between the slope at zero and the chord at the largest slip angle."""
    found = wrong()
    for axle, stiffness, peak in (("front", C_F, 36e3), ("rear", C_R, 40e3)):
        softer = found.parameters[f"{axle}.cornering_stiffness"] / stiffness
        assert peak / stiffness / 0.2 < softer < 0.99


# --- what is fixed -----------------------------------------------------------------------------------

CHANGES = {
    "mass": (Body(BODY.mass * 1.03, 2.38, 2.12), 0.03),
    "cg_to_front_axle": (Body(BODY.mass, 2.38 * 1.01, 2.12), 0.01),
    "cg_to_rear_axle": (Body(BODY.mass, 2.38, 2.12 * 1.01), 0.01),
}


@cache
def first_order():
    return to_fixed(plain().problem, plain().fit, FIXED)


@pytest.mark.parametrize("name", FIXED)
def test_a_wrong_fixed_value_moves_the_estimate_as_first_order_says(name):
    found = plain()
    body, change = CHANGES.get(name, (BODY, 0.01))
    records = runs()
    if name == STEERING_RATIO:
        records = [replace(one, road_wheel_angle=one.road_wheel_angle / (1 + change)) for one in records]
    again = fit(records, body, found.parameters, noise=found.fit.point.noise)
    moved = again.fit.shared - found.fit.shared
    told = change * first_order()[:, FIXED.index(name)]
    std = std_of(found.fit.covariance)
    assert moved == pytest.approx(told, rel=0.05, abs=0.15 * std.max())
    assert np.abs(told[:3]).max() > 2 * std[:3].max()  # it matters


def test_stiffness_and_yaw_inertia_go_with_the_mass_alone():
    by_mass = first_order()[:, 0]
    assert by_mass[:3] == pytest.approx(np.ones(3), abs=1e-3)
    assert by_mass[3] == pytest.approx(0.0, abs=1e-5)


# --- runs that disagree ------------------------------------------------------------------------------


def test_p_values_of_the_agreement_of_runs_are_uniform():
    p = []
    for seed in range(1, 11):
        found = fit(runs(seed=seed, count=3, seconds=8.0), noise=known_noise())
        p.append(run_agreement(found.fit)[seed % 3].p)  # those of one fit hang together
    assert min(p) > 1e-3
    assert kstest(p, "uniform").pvalue > 1e-3


def test_a_run_with_more_mass_is_told_and_how_much_it_would_move():
    heavy = runs(replace(TRUCK, mass=1.15 * BODY.mass), count=3)[2]
    found = fit([*runs(count=2), heavy])
    agreement = run_agreement(found.fit)
    assert min(range(3), key=lambda number: agreement[number].p) == 2
    assert agreement[2].p < 1e-4
    # seen with the mass of the others, the tyres of a heavier truck are softer: 1/1.15 of them, and the
    # common estimate lies between
    apart = agreement[2].shift[:3] - agreement[0].shift[:3]
    assert apart == pytest.approx(-np.log(1.15) * np.ones(3), abs=0.03)


def test_a_single_run_agrees_with_itself():
    (one,) = run_agreement(fit(runs(count=1)).fit)
    assert one.p == 1.0
    assert np.all(one.shift == 0)
