"""Many noises at one fit: the scores are those of a fit itself, and what is no noise makes the gate fire."""

from dataclasses import replace

import numpy as np
import pytest
from generator.motion_sets import channel_of
from improve_null import (
    cells,
    coloured,
    limits,
    measured_point,
    same_instants,
    summary,
    wrong_start,
)
from improve_runs import drive_campaign, measured, motion_data, motion_layer, typical, tyre_starts

from ident.estimation.motion_fit import MotionFit
from ident.estimation.motion_layer import KIND
from ident.estimation.residual_tests import screen

RUNS = ["sweep_fast", "weave", "steps"]
SEED = 4


@pytest.fixture(scope="module")
def drive():
    return drive_campaign([], SEED, runs=RUNS)


def layer_of(drive, noise, start=None):
    return motion_layer(motion_data(measured(drive, noise), drive.truth), start)


@pytest.fixture(scope="module")
def fit(drive):
    data = motion_data(measured(drive, SEED), drive.truth)
    return motion_layer(data, wrong_start(data, SEED)).fitted()


@pytest.fixture(scope="module")
def directions(fit):
    return fit.directions()


def studentised(scores):
    length = np.sqrt(np.diag(scores.gram))
    return np.divide(scores.scores.sum(axis=0), length, out=np.zeros_like(length), where=length > 0)


def test_the_measurements_of_the_fit_have_the_scores_of_the_fit(fit, directions):
    own, again = fit.scores(), directions.scores(fit.point)
    np.testing.assert_allclose(again.scores, own.scores, atol=1e-9 * np.abs(own.scores).max())
    # the fit holds to its priors, its directions know of none
    np.testing.assert_allclose(again.power.sum(axis=0), own.power.sum(axis=0), rtol=2e-3)


def test_a_noise_at_the_parameters_of_another_scores_as_in_a_fit_of_its_own(drive, fit):
    layer = layer_of(drive, 11, fit.parameters)
    point = measured_point(fit, layer)
    near = studentised(MotionFit(layer, (), point).directions().scores(point))
    own = studentised(layer.fitted().scores())
    assert np.median(np.abs(own)) > 0.4
    assert np.median(np.abs(near - own)) < 0.1
    assert np.quantile(np.abs(near - own), 0.9) < 0.4


def test_a_shared_direction_tells_nearly_what_its_own_would(drive, fit, directions):
    point = measured_point(fit, layer_of(drive, 11, fit.parameters))
    assert same_instants(fit.point.problem, point.problem)
    shared = studentised(directions.scores(point))
    own = studentised(MotionFit(layer_of(drive, 11), (), point).directions().scores(point))
    assert np.median(np.abs(shared - own)) < 0.15


def test_the_gate_fires_on_a_small_bias_of_the_gyro_and_not_without_it(drive, fit, directions):
    biased = replace(drive, runs=drive_campaign([typical("sensor_bias", 0.5)], SEED, runs=RUNS).runs)
    sound = measured_point(fit, layer_of(drive, 11, fit.parameters))
    wrong = measured_point(fit, layer_of(biased, 11, fit.parameters))
    assert not screen([directions.scores(sound)], seed=1).rejected
    fired = screen([directions.scores(wrong)], seed=1)
    assert fired.rejected
    assert fired.of("sensor_bias yaw_rate").statistic > 50.0


def test_other_colours_leave_the_size_of_the_noise(drive):
    other = coloured(drive.truth, 3)
    for signal in ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading"):
        was, now = channel_of(drive.truth, signal), channel_of(other, signal)
        assert np.hypot(now.white_std, now.noise_std) == pytest.approx(np.hypot(was.white_std, was.noise_std))
        assert 0.6 <= now.noise_ar[0] <= 0.95


def test_every_parameter_of_the_start_is_wrong(drive):
    data = motion_data(measured(drive, SEED), drive.truth)
    begin, wrong = tyre_starts(KIND, data.records, data.body)[0], wrong_start(data, 2)
    factor = np.abs(np.log([wrong[name] / value for name, value in begin.items() if value]))
    assert factor.min() > np.log(1.2)
    assert factor.max() < np.log(1.5)


def test_every_kind_has_its_share_of_the_cells():
    made = list(cells(["planar", "another", "colour", "gusts"], 100))
    assert len({tuple(cell) for cell in made}) == len(made)
    assert sum(end - begin for kind, _, begin, end in made if kind != "gusts") == 2000
    assert {end - begin for kind, _, begin, end in made if kind == "gusts"} == {1}


def test_limits_are_those_of_clopper_and_pearson():
    assert limits(0, 20) == (0.0, pytest.approx(0.16843, abs=1e-5))
    assert limits(5, 50) == pytest.approx((0.03328, 0.21814), abs=1e-5)
    assert limits(3, 3)[1] == 1.0


def test_the_summary_counts_rejections():
    rows = [
        {"cell": ["planar", 1, 1, 5], "set": k, "p": p, "first": "drift", "worth": 60.0, "block": 2.0}
        for k, p in enumerate((0.5, 0.04, 0.9, 0.2))
    ]
    told = summary([*rows, {"cell": ["planar", 1, 1, 5], "set": 9, "unlike": True}])
    assert "planar           n =     4: fires    1 = 0.250" in told
    assert "planar 1: 1 of 4  drift 1" in told
    assert "1 sets at other instants" in told
