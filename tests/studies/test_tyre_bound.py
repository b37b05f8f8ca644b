"""The bound of the tyres: its derivatives, its noise, and what it says are held against simulated data."""

from dataclasses import replace

import numpy as np
import pytest
from bound import whitened
from generator.motion_sets import channel_of, measured_again, motion_set, noise_free
from generator.runs import Trip, driver_run
from generator.truth import load_truth
from scipy.stats import chi2
from tyre_bound import (
    COMMON,
    OUTPUTS,
    PARAMETERS,
    covariance,
    derived_std,
    driven,
    information,
    reduced,
    scaled_inverse,
    whitened_design,
    with_parameter,
)

TRIP = Trip("planar", 4.4, 16.0)
WINDOW = 8.0


@pytest.fixture(scope="module")
def truth():
    return load_truth()


@pytest.fixture(scope="module")
def trip(truth):
    return driven(TRIP, truth, 5, "bound")


@pytest.fixture(scope="module")
def design(trip, truth):
    return whitened_design(trip, truth, WINDOW)


@pytest.fixture(scope="module")
def full(design):
    return sum(white.T @ white for white in design.values())


def test_linear_estimates_from_simulated_noise_scatter_as_the_bound_says(truth, design, full):
    """The score of real sensor errors has the information as its covariance: tests noise and whitening."""
    true = motion_set(driver_run(TRIP), noise_free(truth), 5, "bound")
    free = PARAMETERS.index("front.shape"), PARAMETERS.index("front.curvature")
    kept = np.array([i for i in range(len(full)) if i not in free])
    total, sets = 0.0, 60
    for seed in range(sets):
        measured = measured_again(true, truth, seed, "bound")
        score = np.zeros(len(full))
        for output in OUTPUTS:
            channel = channel_of(truth, output)
            error = measured[output].values - true[output].values - channel.bias
            score += design[output].T @ whitened(error[:, None], channel)[:, 0]
        total += score[kept] @ scaled_inverse(full[np.ix_(kept, kept)]) @ score[kept]
    low, high = chi2.ppf([0.001, 0.999], sets * len(kept))
    assert low < total < high


def test_half_the_noise_halves_the_bound(trip, truth, full):
    def quieter(sensor):
        halved = {
            name: replace(
                one,
                white_std=one.white_std / 2,
                noise_std=one.noise_std / 2,
                resolution=one.resolution / 2,
            )
            for name, one in sensor.channels.items()
        }
        return replace(sensor, channels=halved)

    quiet = replace(truth, imu=quieter(truth.imu), odometry=quieter(truth.odometry))
    assert information([trip], quiet, WINDOW) == pytest.approx(4 * reduced(full), rel=1e-9)


def test_what_is_known_or_believed_narrows_the_bound_and_nothing_widens_it(full):
    info = reduced(full)
    everything, names = covariance(info)
    for known in (["rear.curvature"], ["front.shape", "rear.shape"]):
        some, left = covariance(info, known)
        rows = [names.index(name) for name in left]
        assert np.all(np.diag(some) <= np.diag(everything)[rows] * (1 + 1e-9))
    believed, _ = covariance(info, beliefs={"front.shape": 0.3})
    assert np.sqrt(believed[PARAMETERS.index("front.shape")][PARAMETERS.index("front.shape")]) < 0.3


def test_one_window_knows_at_least_as_much_as_two(trip, truth, full):
    whole, two = information([trip], truth, TRIP.duration), reduced(full)
    assert np.all(np.linalg.eigvalsh(_scaled(whole - two, whole)) > -1e-6)
    assert len(whole) == len(COMMON)


def _scaled(matrix, by):
    scale = 1 / np.sqrt(np.diag(by))
    return matrix * np.outer(scale, scale)


def test_the_cornering_stiffness_is_known_far_better_than_its_factors(truth, full):
    inverse, names = covariance(reduced(full))
    stiffness = derived_std(truth.planar, inverse, names)["front.cornering_stiffness"] / (5.4 * 1.35 * 45e3)
    factor = np.sqrt(inverse[0, 0]) / 5.4
    assert stiffness < 0.02
    assert factor > 1.0


def test_one_parameter_is_changed_and_no_other(truth):
    changed = with_parameter(truth.planar, "rear.curvature", -0.1)
    assert changed.rear == replace(truth.planar.rear, curvature=-0.1)
    assert replace(changed, rear=truth.planar.rear) == truth.planar
