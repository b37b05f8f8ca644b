"""Values, intervals and verdicts that are told of a tyre fit; on two tracks against pseudo-true values."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from generator.motion_sets import measured_again, motion_set, noise_free
from generator.runs import Trip, driver_run
from generator.truth import load_truth
from plane_truck import BODY, INERTIA, PlaneTruck, brush, inputs, linear, magic, piecewise
from scipy.stats import norm
from tyre_coverage import data_of

from ident.dynamics.tyres import axle_force
from ident.estimation.tyre_estimates import Z, tyre_fit, uncertainty
from ident.estimation.tyre_fit import Body, KindFit, fit_tyres

C_F, C_R = 330e3, 417e3
START = {
    "front.cornering_stiffness": C_F,
    "rear.cornering_stiffness": C_R,
    "yaw_inertia": INERTIA,
    **{
        f"{axle}.{name}": value
        for axle in ("front", "rear")
        for name, value in (("shape", 1.3), ("curvature", -0.5))
    },
    "front.peak_force": 40e3,
    "rear.peak_force": 45e3,
    "front.saturation_slip": 0.08,
    "rear.saturation_slip": 0.08,
}
TRUCKS = {
    "linear": PlaneTruck(linear(C_F), linear(C_R)),
    "piecewise_linear": PlaneTruck(piecewise(C_F, 0.055), piecewise(C_R, 0.05)),
    "magic_formula": PlaneTruck(magic(C_F, 36e3, 1.4, -0.8), magic(C_R, 40e3, 1.35, -0.5)),
    "brush": PlaneTruck(brush(C_F, 44e3), brush(C_R, 50e3)),
}


@cache
def found(kind: str = "linear", most: float = 0.06, mass_std: float = 0.0) -> KindFit:
    body = replace(BODY, std={"mass": mass_std * BODY.mass} if mass_std else {})
    records = [
        TRUCKS[kind].drive(*inputs(16.0, seed=run, most=most), run=run, seed=40 + run) for run in range(2)
    ]
    return fit_tyres(records, kind, body, [START], bank=False)


def told(one: KindFit, ratio_std: float = 0.0):
    return tyre_fit(one, uncertainty(one, ratio_std), 0.0)


def relative(one):
    return one.std / one.value


# --- intervals ---------------------------------------------------------------------------------------


def test_intervals_are_those_of_the_logarithm():
    stiffness = told(found()).front["cornering_stiffness"]
    std = np.sqrt(found().fit.covariance[0, 0])
    assert (stiffness.low, stiffness.high) == pytest.approx(
        (stiffness.value * np.exp(-Z * std), stiffness.value * np.exp(Z * std))
    )
    assert stiffness.std == pytest.approx(std * stiffness.value)
    assert stiffness.unit == "N/rad"
    assert pytest.approx(norm.ppf(0.975)) == Z


def test_an_error_of_the_mass_that_is_stated_is_in_the_interval():
    plain, known = told(found()), told(found(mass_std=0.03))
    for axle in ("front", "rear"):
        before, after = (getattr(one, axle)["cornering_stiffness"] for one in (plain, known))
        assert after.value == pytest.approx(before.value, rel=1e-9)
        assert relative(after) == pytest.approx(np.hypot(relative(before), 0.03), rel=1e-2)
        assert relative(after) > 0.03
    assert relative(known.yaw_inertia) > 0.03


def test_an_error_of_the_mass_leaves_the_understeer_gradient_as_known_as_it_was():
    """It holds the mass over the stiffness, m/L (l_r/C_f - l_f/C_r), which motion tells."""
    plain, known = (told(found(mass_std=std)).understeer_gradient for std in (0.0, 0.03))
    assert known.value == pytest.approx(plain.value, rel=1e-9)
    assert known.std == pytest.approx(plain.std, rel=1e-2)


@pytest.mark.parametrize("name", ["cg_to_front_axle", "cg_to_rear_axle"])
def test_an_error_of_a_fixed_length_moves_the_understeer_gradient_as_a_refit_does(name):
    one = found()
    longer = replace(one.body, **{name: 1.01 * getattr(one.body, name)})
    records = [
        TRUCKS["linear"].drive(*inputs(16.0, seed=run, most=0.06), run=run, seed=40 + run) for run in (0, 1)
    ]
    again = fit_tyres(records, "linear", longer, [one.parameters], noise=one.fit.point.noise, bank=False)
    moved = told(again).understeer_gradient.value - told(one).understeer_gradient.value
    stated = replace(one, body=replace(one.body, std={name: 0.01 * getattr(one.body, name)}))
    wider = np.sqrt(told(stated).understeer_gradient.std ** 2 - told(one).understeer_gradient.std ** 2)
    assert wider == pytest.approx(abs(moved), rel=0.1, abs=0.1 * told(one).understeer_gradient.std)


def test_an_error_of_the_ratio_that_is_stated_is_in_the_interval_of_the_front_axle():
    plain, known = told(found()), told(found(), ratio_std=0.01)
    assert relative(known.front["cornering_stiffness"]) > 0.012  # 1.7 times the error of the ratio
    assert relative(known.rear["cornering_stiffness"]) < 1.3 * relative(plain.rear["cornering_stiffness"])


def test_how_far_each_parameter_would_move_is_said():
    moves = told(found()).to_fixed
    assert moves["front.cornering_stiffness"]["mass"] == pytest.approx(1.0, abs=1e-3)
    assert moves["yaw_inertia"]["mass"] == pytest.approx(1.0, abs=1e-3)
    assert set(moves["yaw_inertia"]) == {"mass", "cg_to_front_axle", "cg_to_rear_axle", "steering_ratio"}


def drawn(one: KindFit, count: int = 20000, share: float = 1.0):
    """Parameters drawn from what the fit says of them, or from a small part of its spread."""
    random = np.random.default_rng(1)
    shared = random.multivariate_normal(one.fit.shared, share**2 * one.fit.covariance, count, method="svd")
    return {
        each.name: np.exp(shared[:, k]) if each.logarithmic else shared[:, k]
        for k, each in enumerate(one.problem.coordinates)
    }


def test_understeer_gradient_and_characteristic_speed_have_the_errors_of_both_axles_together():
    fit, values = told(found()), drawn(found())
    c_f, c_r = (values[f"{axle}.cornering_stiffness"] for axle in ("front", "rear"))
    gradient = BODY.mass / BODY.wheelbase * (BODY.cg_to_rear_axle / c_f - BODY.cg_to_front_axle / c_r)
    speed = np.sqrt(BODY.wheelbase / gradient)
    for one, draws in ((fit.understeer_gradient, gradient), (fit.characteristic_speed, speed)):
        assert one.value == pytest.approx(np.median(draws), abs=0.05 * np.std(draws))
        assert one.std == pytest.approx(np.std(draws), rel=0.03)
        low, high = np.quantile(draws, [0.025, 0.975])
        assert (one.low, one.high) == pytest.approx((low, high), abs=0.15 * np.std(draws))
    true = BODY.mass / BODY.wheelbase * (2.12 / C_F - 2.38 / C_R)
    assert abs(fit.understeer_gradient.value - true) < 3.3 * fit.understeer_gradient.std


def test_the_band_around_a_curve_is_that_of_its_parameters_together():
    one = found("magic_formula", 0.2)
    curve, values = told(one).curves["front"], drawn(one, 4000, 1e-3)
    at = 60  # of the points, in the excited range
    names = ("cornering_stiffness", "peak_force", "shape", "curvature")
    slip = np.array([curve.slip_angle[at]])
    forces = [
        axle_force("magic_formula", slip, {n: float(values[f"front.{n}"][k]) for n in names})[0][0]
        for k in range(0, 4000, 8)
    ]
    # to first order: D, C and E are known only jointly, along a bent line that draws at full size leave
    assert curve.force[at] == pytest.approx(np.median(forces), rel=1e-5)
    assert curve.force_std[at] == pytest.approx(1e3 * np.std(forces), rel=0.1)


def test_an_oversteering_vehicle_has_no_characteristic_speed():
    truck = PlaneTruck(linear(1.5 * C_F), linear(0.9 * C_R))
    records = [truck.drive(*inputs(16.0, most=0.05), seed=3)]
    fit = told(fit_tyres(records, "linear", BODY, [START], bank=False))
    assert fit.understeer_gradient.high < 0
    assert fit.characteristic_speed.value is None
    assert "oversteers" in fit.characteristic_speed.reason


# --- verdicts ----------------------------------------------------------------------------------------


def test_a_kink_that_was_driven_is_identified_and_one_beyond_is_not():
    driven = told(found("piecewise_linear", 0.12)).front["saturation_slip"]
    assert driven.status == "identified"
    assert driven.low < 0.055 < driven.high
    beyond = told(found("piecewise_linear", 0.04)).front["saturation_slip"]
    assert (beyond.status, beyond.low, beyond.high) == ("not_identifiable", None, None)
    assert "drive harder" in beyond.reason


def test_peak_and_shape_are_identified_where_the_peak_was_driven_alone():
    peak = told(found("magic_formula", 0.35)).front
    assert peak["peak_force"].status == "identified"
    assert peak["peak_force"].low < 36e3 < peak["peak_force"].high
    assert peak["shape"].status != "not_identifiable"
    assert abs(peak["shape"].value - 1.4) < 2.6 * peak["shape"].std
    gentle = told(found("magic_formula", 0.05)).front
    assert gentle["cornering_stiffness"].status == "identified"
    for name in ("shape", "stiffness_factor"):
        assert gentle[name].status == "not_identifiable"
    assert gentle["peak_force"].status != "identified"


def test_a_peak_far_beyond_what_was_driven_is_weak_however_narrow_its_interval():
    """A brush has no free shape: its peak comes out narrow, and rests on the brush being right."""
    gentle = told(found("brush", 0.05)).front
    peak = gentle["peak_force"]
    assert peak.std < 0.1 * peak.value
    assert peak.status == "weak"
    assert "rests on the shape of the curve beyond what was driven" in peak.reason
    assert gentle["cornering_stiffness"].status == "identified"


def test_a_yaw_inertia_that_was_stated_and_is_not_driven_is_not_claimed_from_the_data():
    body = Body(BODY.mass, 2.38, 2.12, yaw_inertia=52000.0, std={"yaw_inertia": 520.0})
    times = 0.01 * np.arange(1601)
    slow = 0.04 * (1 - np.cos(2 * np.pi * 0.06 * times))
    records = [TRUCKS["linear"].drive(slow, 12.0 + np.sin(0.3 * times), seed=1)]
    one = told(fit_tyres(records, "linear", body, [START], bank=False)).yaw_inertia
    assert one.value == pytest.approx(52000.0, rel=0.02)
    assert one.std < 1.001 * 520.0 * one.value / 52000.0


def test_correlations_are_of_unit_size_and_symmetric():
    correlation = np.array(told(found()).correlation)
    assert np.diag(correlation) == pytest.approx(np.ones(len(correlation)))
    assert correlation == pytest.approx(correlation.T)
    assert np.abs(correlation).max() < 1 + 1e-9


# --- a truck that the model is not ------------------------------------------------------------------


def test_on_two_tracks_the_intervals_hold_the_pseudo_true_values():
    """These are what the same fit, noise model held, makes of the same runs without noise."""
    truth = load_truth()
    names = ("two_a", "two_b")
    clean = {n: motion_set(driver_run(Trip("truck", 4.6, 20.0)), noise_free(truth), 1, n) for n in names}
    free = data_of(clean, truth)
    noisy = data_of({n: measured_again(one, truth, 5, n) for n, one in clean.items()}, truth)
    start = [START | {"front.peak_force": 45e3, "rear.peak_force": 52e3}]
    one = fit_tyres(noisy.records, "magic_formula", noisy.body, start, floor=noisy.floor, bank=False)
    pseudo = fit_tyres(
        free.records,
        "magic_formula",
        free.body,
        [one.parameters],
        noise=one.fit.point.noise,
        window=one.window,
        bank=False,
    )
    fit, true = told(one), told(pseudo)
    for axle in ("front", "rear"):
        stiffness, expected = (getattr(each, axle)["cornering_stiffness"] for each in (fit, true))
        assert abs(stiffness.value - expected.value) < 3.0 * stiffness.std
        assert relative(stiffness) < 0.03
    assert abs(fit.yaw_inertia.value - true.yaw_inertia.value) < 3.0 * fit.yaw_inertia.std
    gradients = fit.understeer_gradient, true.understeer_gradient
    assert abs(gradients[0].value - gradients[1].value) < 3.0 * gradients[0].std
