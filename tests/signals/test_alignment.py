"""One time base, against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.results import RunHealth
from ident.signals.alignment import align, hold, interpolate, low_pass, sample
from ident.signals.signal import Run, Signal


def run_of(*signals, duration=10.0):
    health = RunHealth("r", "mcap", "", duration, "", "", [], {}, [])
    return Run("r", 0, duration, {signal.name: signal for signal in signals}, None, health)


def test_a_held_step_is_exact_and_never_early():
    time = np.arange(0, 4, 0.02)
    request = Signal("steering_wheel_request", time, np.where(time >= 1.0, 0.7, 0.0), "rad")
    aligned = align(run_of(request, duration=3.98), rate=1000, max_gap=0.2)
    column = aligned.columns["steering_wheel_request"]
    assert np.all(column[aligned.time < 1.0 - 1e-9] == 0.0)
    assert np.all(column[aligned.time >= 1.0] == 0.7)


@settings(deadline=None)
@given(st.lists(st.floats(0.001, 1.0), min_size=2, max_size=30), st.integers(1, 400))
def test_a_held_value_is_always_one_that_was_sent_before(steps, rate):
    time = np.cumsum(steps)
    grid = np.arange(0, time[-1] + 0.5, 1 / rate)
    held = hold(time, np.arange(len(time), dtype=float), grid, np.inf)
    for at, value in zip(grid, held, strict=True):
        if np.isfinite(value):
            assert time[int(value)] <= at
            assert int(value) == len(time) - 1 or time[int(value) + 1] > at
        else:
            assert at < time[0] or at > time[-1]


def test_a_held_value_ends_one_period_after_the_last_sample():
    held = hold(np.array([0.0, 0.1, 0.2]), np.array([1.0, 2.0, 3.0]), np.array([0.25, 0.3, 0.35]), 1.0)
    assert held[:2].tolist() == [3.0, 3.0]
    assert np.isnan(held[2])


def test_a_sine_is_interpolated_within_its_bound():
    time = np.arange(0, 10, 0.02)
    omega = 2 * np.pi * 1.5
    grid = np.arange(0, 9.9, 0.0033)
    error = interpolate(time, np.sin(omega * time), grid, 0.2) - np.sin(omega * grid)
    assert np.abs(error).max() <= (omega * 0.02) ** 2 / 8
    assert np.abs(error).max() > (omega * 0.02) ** 2 / 80


def test_a_heading_takes_the_shorter_arc():
    time = np.arange(5.0)
    heading = np.array([3.0, 3.1, -3.1, -3.0, -2.9])
    column = align(run_of(Signal("heading", time, heading, "rad"), duration=4.0), rate=2, max_gap=2.0).columns
    between = column["heading"][3]
    assert np.cos(between - np.pi) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("jitter", [0.0, 0.03])
@pytest.mark.parametrize("frequency", [26.0, 33.0, 49.0, 60.0, 110.0, 170.0])
def test_what_would_fold_is_suppressed_by_40_db(frequency, jitter):
    rng = np.random.default_rng(2)
    time = np.cumsum(np.full(6000, 0.002) * (1 + jitter * rng.standard_normal(6000)))
    signal = Signal("yaw_rate", time, np.sin(2 * np.pi * frequency * time), "rad/s")
    grid = np.arange(1, 11, 0.02)
    assert np.nanstd(sample(signal, grid, 50, 0.2)) < 0.01 / np.sqrt(2)


@pytest.mark.parametrize("frequency", [0.5, 5.0, 10.0, 15.0])
def test_what_can_be_held_passes_without_delay(frequency):
    time = np.arange(0, 12, 0.002)
    signal = Signal("yaw_rate", time, np.sin(2 * np.pi * frequency * time), "rad/s")
    grid = np.arange(1, 11, 0.02)
    column = sample(signal, grid, 50, 0.2)
    assert 2 * np.mean(column * np.sin(2 * np.pi * frequency * grid)) == pytest.approx(1.0, abs=0.005)
    assert 2 * np.mean(column * np.cos(2 * np.pi * frequency * grid)) == pytest.approx(0.0, abs=1e-3)


def test_a_command_is_not_filtered():
    time = np.arange(0, 2, 0.002)
    request = Signal("road_wheel_request", time, np.where(time >= 1, 1.0, 0.0), "rad")
    column = align(run_of(request, duration=1.9), rate=20, max_gap=0.2).columns["road_wheel_request"]
    assert set(column.tolist()) == {0.0, 1.0}


def test_a_constant_and_a_ramp_pass_the_filter_unchanged_to_the_ends():
    time = np.arange(0, 3, 0.002)
    assert low_pass(time, np.full(len(time), 3.0), 50, 0.2) == pytest.approx(np.full(len(time), 3.0))
    assert low_pass(time, 2 * time, 50, 0.2) == pytest.approx(2 * time, abs=1e-9)


@pytest.mark.parametrize("name", ["yaw_rate", "steering_wheel_request", "heading"])
@pytest.mark.parametrize("source_rate", [20, 500])
def test_nothing_is_invented_across_a_gap(name, source_rate):
    step = 1 / source_rate
    time = np.concatenate([np.arange(0, 3, step), np.arange(5, 8, step)])
    before = time[time < 4][-1]
    aligned = align(run_of(Signal(name, time, np.ones(len(time)), "x"), duration=7.9), rate=50, max_gap=0.2)
    column, valid = aligned.columns[name], aligned.valid[name]
    inside = (aligned.time > before + 1e-9) & (aligned.time < 5 - 1e-9)
    assert not valid[inside].any()
    assert np.isnan(column[inside]).all()
    assert valid[(aligned.time > step) & ~inside & (aligned.time < 7.9)].all()


def test_values_before_a_gap_do_not_know_what_comes_after():
    time = np.concatenate([np.arange(0, 3, 0.002), np.arange(5, 8, 0.002)])
    signal = Signal("yaw_rate", time, np.where(time < 4, 0.0, 100.0), "rad/s")
    column = sample(signal, np.arange(0, 8, 0.02), 50, 0.2)
    assert set(np.round(column[np.isfinite(column)], 9)) == {0.0, 100.0}


def test_a_slow_signal_has_no_gap_at_its_own_period():
    time = np.arange(0.0, 10.0)
    aligned = align(run_of(Signal("speed", time, time, "m/s"), duration=9.0), rate=10, max_gap=0.2)
    assert aligned.columns["speed"] == pytest.approx(aligned.time)


def test_a_flag_that_is_sent_on_change_is_held_until_it_does():
    flag = Signal("engaged", np.array([0.0, 3.0, 3.5, 9.0]), np.array([0.0, 1.0, 0.0, 1.0]), "1")
    column = align(run_of(flag, duration=9.0), rate=10, max_gap=0.2).columns["engaged"]
    assert column[[0, 29, 30, 34, 35, 89]].tolist() == [0, 0, 1, 1, 0, 0]


def test_nothing_is_said_outside_the_samples():
    speed = Signal("speed", np.arange(2, 5, 0.1), np.ones(30), "m/s")
    aligned = align(run_of(speed, duration=8.0), rate=10, max_gap=0.2)
    assert not aligned.valid["speed"][aligned.time < 1.95].any()
    assert not aligned.valid["speed"][aligned.time > 4.95].any()


def test_one_sample_gives_one_value():
    speed = Signal("speed", np.array([1.0]), np.array([7.0]), "m/s")
    column = align(run_of(speed, duration=2.0), rate=2, max_gap=0.2).columns["speed"]
    assert np.isnan(column).tolist() == [True, True, False, True, True]
