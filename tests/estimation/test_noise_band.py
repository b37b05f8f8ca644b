"""The noise of a sensor above the motion, against noise that was made."""

from __future__ import annotations

import numpy as np
import pytest
from plane_truck import NOISE, PlaneTruck, inputs, linear
from scipy.signal import lfilter

from ident.estimation.noise_band import noise_above_the_motion
from ident.estimation.vehicle_records import MotionRecord, Samples

SIGNALS = ("yaw_rate", "lateral_acceleration", "lateral_velocity")


def record(times: np.ndarray, values: np.ndarray) -> MotionRecord:
    still = np.zeros(times.size)
    return MotionRecord(0, times, still, still, {"yaw_rate": Samples(times, values)})


def test_white_noise_on_a_drive_is_found_without_a_model_of_the_drive() -> None:
    truck = PlaneTruck(linear(3.3e5), linear(4e5))
    drives = [truck.drive(*inputs(40.0, most=0.08, seed=seed), seed=seed) for seed in (1, 2, 3)]
    found = noise_above_the_motion(drives, SIGNALS)
    for name in SIGNALS:
        assert found[name].total_std == pytest.approx(NOISE[name], rel=0.08)


def test_vibration_above_the_band_does_not_count() -> None:
    times = 0.01 * np.arange(12000)
    random = np.random.default_rng(2)
    shaken = 0.01 * random.standard_normal(times.size) + 0.5 * np.sin(2 * np.pi * 21.0 * times)
    found = noise_above_the_motion([record(times, shaken)], ["yaw_rate"])["yaw_rate"]
    assert found.total_std == pytest.approx(0.01, rel=0.08)


def test_fast_coloured_noise_counts_by_its_density_below() -> None:
    times = 0.01 * np.arange(40000)
    coloured = lfilter([1.0], [1.0, -0.3], np.random.default_rng(3).standard_normal(times.size))
    found = noise_above_the_motion([record(times, coloured)], ["yaw_rate"])["yaw_rate"]
    frequency = np.linspace(4, 8, 50)
    density = 1 / np.abs(1 - 0.3 * np.exp(-2j * np.pi * frequency * 0.01)) ** 2
    assert found.total_std**2 == pytest.approx(np.mean(density), rel=0.05)


def test_gaps_do_not_spoil_it_and_a_slow_sensor_has_a_band_of_its_own() -> None:
    random = np.random.default_rng(4)
    times = 0.1 * np.arange(4000)
    values = 0.02 * random.standard_normal(times.size) + np.where(times > 200.0, 5.0, 0.0)
    holed = record(np.where(times > 200.0, times + 7.0, times), values)
    assert noise_above_the_motion([holed], ["yaw_rate"])["yaw_rate"].total_std == pytest.approx(0.02, rel=0.1)


def test_too_few_samples_say_nothing() -> None:
    times = 0.01 * np.arange(20)
    assert noise_above_the_motion([record(times, times)], ["yaw_rate", "heading"]) == {}
