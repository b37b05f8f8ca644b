"""Runs in memory: what the log would hold, what is true at its stamps, and the same drive measured again."""

import numpy as np
import pytest
from generator.motion import ODOMETRY
from generator.motion_sets import SOURCES, channel_of, measured_again, motion_set, noise_free
from generator.runs import Trip, driver_run, make_topics
from numpy.testing import assert_allclose, assert_array_equal

SHORT = driver_run(Trip("planar", 4.4, 20.0))


@pytest.fixture(scope="module")
def true(truth):
    return motion_set(SHORT, noise_free(truth), 7, "short")


def test_a_set_holds_what_the_log_of_that_run_holds(truth):
    topics = make_topics("planar/planar_a", truth, 3)
    made = motion_set("planar/planar_a", truth, 3)
    assert_array_equal(made["position_y"].values, topics[ODOMETRY].columns[1])
    assert_array_equal(np.round(made["lateral_velocity"].time * 1e9), topics[ODOMETRY].stamps)
    assert set(made) == set(SOURCES)


@pytest.mark.parametrize("run", ["manual_a", "slow_slalom"])
def test_the_two_track_truck_moves_the_same_whether_or_not_its_sensors_err(truth, run):
    true, measured = motion_set(run, noise_free(truth), 1), motion_set(run, truth, 1)
    for signal, samples in true.items():
        channel = channel_of(truth, signal)
        assert_array_equal(measured[signal].time, samples.time)
        error = measured[signal].values - samples.values
        size = np.sqrt(channel.white_std**2 + channel.noise_std**2 + channel.resolution**2 / 12)
        # a coloured noise of 55 s has an uncertain mean and size
        assert np.mean(error) == pytest.approx(channel.bias, abs=0.6 * size), signal
        assert np.std(error) == pytest.approx(size, rel=0.2), signal


def test_what_is_true_obeys_the_kinematics_of_the_rear_axle(true):
    time, heading = true["heading"].time, true["heading"].values
    along, across = true["longitudinal_velocity"].values, true["lateral_velocity"].values
    moved = np.diff(true["position_x"].values) / np.diff(time)
    middle = along * np.cos(heading) - across * np.sin(heading)
    assert_allclose(moved, (middle[1:] + middle[:-1]) / 2, atol=2e-3)
    turned = np.diff(heading) / np.diff(time)
    rate = np.interp((time[1:] + time[:-1]) / 2, true["yaw_rate"].time, true["yaw_rate"].values)
    assert_allclose(turned, rate, atol=2e-3)


def test_measuring_again_changes_the_noise_and_nothing_else(truth, true):
    first, second = (measured_again(true, truth, seed, "again") for seed in (1, 2))
    assert_array_equal(first["yaw_rate"].values, measured_again(true, truth, 1, "again")["yaw_rate"].values)
    for signal, samples in true.items():
        assert_array_equal(first[signal].time, samples.time)
        assert np.any(first[signal].values != second[signal].values)
    bias = truth.imu.channels["lateral_acceleration"].bias
    error = first["lateral_acceleration"].values - true["lateral_acceleration"].values
    assert np.mean(error) == pytest.approx(bias, abs=0.012)


def test_another_seed_is_another_drive(truth, true):
    other = motion_set(SHORT, noise_free(truth), 8, "short")
    size = min(len(other["yaw_rate"].values), len(true["yaw_rate"].values))
    alike = np.corrcoef(other["yaw_rate"].values[:size], true["yaw_rate"].values[:size])[0, 1]
    assert abs(alike) < 0.8
