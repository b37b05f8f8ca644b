"""The tyre fit on simulated runs: its intervals hold the truth and are hardly wider than the bound.

The study of 500 sets is ``studies/tyre_coverage.py``; this is a small one of the same make, with its seeds.
"""

import numpy as np
import pytest
from generator.motion_sets import measured_again, motion_set, noise_free
from generator.runs import Trip, driver_run
from generator.truth import load_truth
from scipy.stats import chi2
from tyre_bound import driven, fit_bound, information
from tyre_coverage import data_of, fitted, told, true_values

TRIP, SEED, NAME = Trip("planar", 5.5, 40.0), 11, "small_study"
SETS = 6
TOLD = ("front.cornering_stiffness", "rear.cornering_stiffness", "yaw_inertia", "understeer_gradient")


@pytest.fixture(scope="module")
def truth():
    return load_truth()


@pytest.fixture(scope="module")
def estimates(truth):
    true = motion_set(driver_run(TRIP), noise_free(truth), SEED, NAME)
    made, start = [], None
    for seed in range(SETS):
        data = data_of({NAME: measured_again(true, truth, seed, NAME)}, truth)
        found = fitted(data, start)
        start = [found.parameters]  # the first finds its own start; the others go on from there
        made.append(told(found))
    return made


@pytest.fixture(scope="module")
def bound(truth):
    return fit_bound(information([driven(TRIP, truth, SEED, NAME)], truth, 10.0), truth.planar)


def errors(estimates, truth, name):
    true = true_values(truth.planar)[name]
    return np.array([(one[name].value - true) / one[name].std for one in estimates])


@pytest.mark.parametrize("name", TOLD)
def test_errors_are_as_large_as_the_standard_errors_say_and_have_no_bias(estimates, truth, name):
    z = errors(estimates, truth, name)
    low, high = chi2.ppf([0.0005, 0.9995], SETS)
    assert low < z @ z < high
    assert abs(z.mean()) < 3.3 / np.sqrt(SETS)


def test_every_99_percent_interval_of_what_is_identified_holds_the_truth(estimates, truth):
    outside = [
        (name, round(float(z), 1))
        for name in TOLD
        for z, one in zip(errors(estimates, truth, name), estimates, strict=True)
        if one[name].status == "identified" and abs(z) > 2.58
    ]
    assert len(outside) <= 1, outside  # of 24, of which one in a hundred may


@pytest.mark.parametrize("name", TOLD)
def test_standard_errors_are_near_the_bound_and_not_below_it(estimates, bound, name):
    stds = np.array([one[name].std for one in estimates])
    assert 0.9 * bound[name] < np.median(stds) < 1.15 * bound[name]


def test_shape_peak_and_curvature_are_not_claimed_to_be_known_from_driving_below_the_peak(estimates):
    for one in estimates:
        assert one["front.shape"].status == "not_identifiable"
        assert one["front.shape"].low is None
        assert "drive" in one["front.shape"].reason
