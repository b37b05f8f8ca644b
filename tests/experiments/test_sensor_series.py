"""Signals on one grid and the kernel: what is slow passes unchanged, nothing reaches across a gap or jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_runs import with_signals
from sensed_motion import NOISE, Drive, sensed

from ident.experiments.sensor_series import RATE, on_grid, rate_of, sensor_series, smoothed
from ident.signals.signal import Signal

GRID = np.arange(1000) / RATE


def signal(time: np.ndarray, values: np.ndarray) -> Signal:
    return Signal("yaw_rate", time, values, "rad/s")


@pytest.mark.parametrize("rate", [20.0, 47.0, 100.0])
def test_a_slow_motion_is_the_same_between_samples(rate: float) -> None:
    time = np.arange(0.013, 20.0, 1 / rate)
    found = on_grid(signal(time, np.sin(2 * np.pi * time)), GRID)
    known = np.isfinite(found)
    assert np.count_nonzero(~known) <= 4
    assert np.max(np.abs(found - np.sin(2 * np.pi * GRID))[known]) < 0.01
    gain = np.linalg.norm(found[known]) / np.linalg.norm(np.sin(2 * np.pi * GRID)[known])
    assert gain == pytest.approx(1.0, abs=5e-4)


def test_samples_close_together_do_not_swing_out() -> None:
    time = np.sort(np.concatenate([np.arange(0, 20, 0.02), np.arange(0, 20, 0.02) + 2e-4]))
    noise = np.random.default_rng(1).standard_normal(time.size)
    found = on_grid(signal(time, noise), GRID + 0.007)
    assert np.nanmax(np.abs(found)) < 1.2 * np.max(np.abs(noise))


def test_both_sides_of_a_comparison_have_the_same_gain() -> None:
    for frequency in (0.1, 0.4, 0.8):
        omega = 2 * np.pi * frequency
        rate, place = np.cos(omega * GRID), np.sin(omega * GRID) / omega
        expected, found = smoothed(rate, 1.0), rate_of(place, 1.0)
        assert np.nanmax(np.abs(found - expected)) < 1e-3 * np.nanmax(np.abs(expected))


def test_a_ramp_has_its_slope_and_a_constant_none() -> None:
    assert np.nanmax(np.abs(rate_of(500.0 + 3.0 * GRID, 1.0) - 3.0)) < 1e-9
    assert np.nanmax(np.abs(rate_of(np.full(GRID.size, 1e4), 1.0))) < 1e-9
    assert np.nanmax(np.abs(smoothed(np.full(GRID.size, 7.0), 1.0) - 7.0)) < 1e-9


def test_the_kernel_does_not_reach_into_the_unknown() -> None:
    values = np.sin(GRID)
    values[400:410] = np.nan
    unknown = np.flatnonzero(np.isnan(smoothed(values, 1.0)))
    inside = unknown[(unknown > 100) & (unknown < 900)]
    assert (inside[0], inside[-1]) == (375, 434)


def test_a_jump_of_the_heading_is_not_a_turn() -> None:
    run = sensed(Drive(), 1)
    heading = run.signals["heading"]
    jumped = replace(heading, values=heading.values + 0.3 * (heading.time > 50.0))
    series = sensor_series(with_signals(run, heading=jumped))
    turning = rate_of(series.values["heading"], 1.0)
    assert np.count_nonzero(np.isnan(turning[2400:2600])) > 20
    assert np.nanmax(np.abs(turning)) < 0.3


def test_a_log_without_speed_or_vehicle_still_has_its_signals() -> None:
    series = sensor_series(sensed(Drive(signals=("yaw_rate", "heading"), vehicle=None), 2))
    assert sorted(series.values) == ["heading", "yaw_rate"]
    assert series.speed_source is None
    assert np.isnan(series.speed).all()
    assert series.arm is None


def test_the_place_of_the_imu_is_counted_from_the_point_of_the_velocity() -> None:
    series = sensor_series(sensed(Drive(), 3))
    assert series.arm == pytest.approx(2.5)
    assert series.imu_y == pytest.approx(0.1)
    assert series.speed_source == "longitudinal_velocity"


def test_the_truth_has_no_noise_where_none_is_asked_for() -> None:
    quiet = {name: {"noise": 0.0, "step": 0.0} for name in NOISE}
    series = sensor_series(sensed(Drive(jitter=0.0), 4, quiet))
    off = rate_of(series.values["heading"], 1.0) - smoothed(series.values["yaw_rate"], 1.0)
    assert np.nanmax(np.abs(off)) < 2e-5
