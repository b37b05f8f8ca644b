"""Many noises at one fit: the scores are those of a fit itself, and what is no noise makes the gate fire."""

from dataclasses import replace

import numpy as np
import pytest
from generator.motion_sets import channel_of
from improve_null import (
    TRUCKS,
    cells,
    coloured,
    limits,
    noise_seed,
    refitted,
    scores_of,
    summary,
    wrong_start,
)
from improve_runs import drive_campaign, measured, motion_data, motion_layer, typical, tyre_starts

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


def studentised(scores):
    length = np.sqrt(np.diag(scores.gram))
    return np.divide(scores.scores.sum(axis=0), length, out=np.zeros_like(length), where=length > 0)


def test_another_noise_from_a_fit_on_scores_as_in_a_fit_of_its_own(drive, fit):
    layer = layer_of(drive, 11, fit.parameters)
    near, own = (studentised(one.scores()) for one in (refitted(fit, layer), layer.fitted()))
    assert np.median(np.abs(own)) > 0.4
    assert np.median(np.abs(near - own)) < 0.05
    assert np.quantile(np.abs(near - own), 0.95) < 0.3


def test_the_noise_of_the_inputs_is_taken_from_another_noise_of_the_same_truck(drive, fit):
    known = fit.scores()
    own = refitted(fit, layer_of(drive, 11, fit.parameters))
    shared, whole = scores_of(own, known), own.scores()
    assert np.array_equal(shared.scores, whole.scores)
    assert shared.colour is known.colour
    assert np.median(known.colour) > 1.05, "the speed of this truck is noisy"
    assert np.median(np.abs(np.log(whole.colour / shared.colour))) < 0.35


def test_the_gate_fires_on_a_small_bias_of_the_gyro_and_not_without_it(drive, fit):
    biased = replace(drive, runs=drive_campaign([typical("sensor_bias", 0.5)], SEED, runs=RUNS).runs)
    sound, wrong = (refitted(fit, layer_of(one, 11, fit.parameters)) for one in (drive, biased))
    assert not screen([sound.scores()], seed=1).rejected
    fired = screen([wrong.scores()], seed=1)
    assert fired.rejected
    assert fired.of("sensor_bias yaw_rate").statistic > 50.0


def test_every_set_has_a_noise_of_its_own():
    seeds = [
        noise_seed(kind, number, noise) for kind in TRUCKS for number in range(1, 21) for noise in range(101)
    ]
    assert len(set(seeds)) == len(seeds)


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
    made = list(cells(list(TRUCKS), 100))
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
    told = summary([*rows[:3], {**rows[3], "again": 0.23}])
    assert "planar           n =     4: fires    1 = 0.250" in told
    assert "planar 1: 1 of 4  drift 1" in told
    assert "fitted from the start as well: 1, p-values differ by 0.030 at most" in told
