"""Windows of runs: nothing is lost or counted twice at the cuts; stamps are met between grid points."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.estimation.vehicle_records import MotionRecord, Samples, Windows, cut


def record(seconds=35.0, *, begin=100.0, step=0.01, run=0, rate=50.0, signal="yaw_rate"):
    """Grid and samples that hold cubics of time, so that interpolation is exact."""
    times = begin + step * np.arange(round(seconds / step) + 1)
    stamps = np.arange(begin + 0.003, times[-1], 1 / rate)
    return MotionRecord(
        run,
        times,
        cubic(times),
        10.0 + 0 * times,
        {signal: Samples(stamps, cubic(stamps))},
        reference_x=-2.1,
        imu=(0.6, 0.1),
    )


def cubic(times):
    t = (times - 110.0) / 10
    return 0.2 + t - 0.5 * t**2 + 0.3 * t**3


@settings(max_examples=30, deadline=None)
@given(st.floats(0.5, 80.0), st.floats(1.0, 60.0))
def test_windows_share_an_instant_and_every_sample_belongs_to_one(seconds, length):
    whole = record(seconds)
    windows = cut(whole, length)
    ends = [(one.times[0], one.times[-1]) for one in windows]
    assert ends[0][0] == whole.times[0]
    assert ends[-1][1] == whole.times[-1]
    assert all(before[1] == after[0] for before, after in pairwise(ends))
    stamps = np.concatenate([one.measured["yaw_rate"].times for one in windows])
    assert np.array_equal(stamps, whole.measured["yaw_rate"].times)
    for one in windows:
        own = one.measured["yaw_rate"].times
        assert ((own >= one.times[0]) & (own <= one.times[-1])).all()
        assert one.times.size >= 4
        assert (one.reference_x, one.imu, one.run) == (-2.1, (0.6, 0.1), 0)
    lengths = np.diff(np.array(ends), axis=1)
    assert np.ptp(lengths) < 0.011


def test_a_sample_at_the_instant_at_which_windows_meet_is_of_the_later_one():
    whole = replace(record(20.0), measured={"heading": Samples(np.array([109.99, 110.0, 120.0]), np.ones(3))})
    first, second = cut(whole, 10.0)
    assert first.measured["heading"].times.tolist() == [109.99]
    assert second.measured["heading"].times.tolist() == [110.0, 120.0]


@pytest.mark.parametrize("points", [4, 5, 8, 9])
def test_a_record_of_a_few_points_is_never_cut_below_what_interpolation_needs(points):
    whole = record(0.01 * (points - 1), rate=300.0)
    windows = cut(whole, 0.02)
    assert all(one.times.size >= 4 for one in windows)
    assert np.isfinite(Windows(windows).signals["yaw_rate"].weights).all()


def test_values_between_grid_points_are_those_of_the_cubic_through_four():
    windows = Windows([*cut(record(), 10.0), *cut(record(17.0, run=1, rate=83.0), 10.0)])
    samples = windows.signals["yaw_rate"]
    grid = np.column_stack([cubic(windows.times), np.cos(windows.times)])
    at = samples.at(grid)
    assert at[:, 0] == pytest.approx(samples.values, abs=1e-12)
    assert at[:, 1] == pytest.approx(np.cos(samples.times), abs=1e-9)


def test_samples_know_their_window_and_where_the_noise_restarts():
    whole = record(30.0)
    stamps = whole.measured["yaw_rate"].times
    keep = (stamps < 104.0) | (stamps > 105.0)
    holed = replace(whole, measured={"yaw_rate": Samples(stamps[keep], cubic(stamps[keep]))})
    windows = Windows(cut(holed, 10.0))
    samples = windows.signals["yaw_rate"]
    assert samples.period == pytest.approx(0.02)
    first = np.flatnonzero(samples.times > 105.0)[0]
    assert samples.starts.tolist() == sorted([*samples.begins[:-1].tolist(), first])
    for number, one in enumerate(windows.records):
        own = samples.times[samples.begins[number] : samples.begins[number + 1]]
        assert np.array_equal(own, one.measured["yaw_rate"].times)
        assert (samples.window[samples.begins[number] : samples.begins[number + 1]] == number).all()


def test_a_signal_that_only_some_windows_have_is_placed_in_those():
    both = record(20.0)
    other = replace(record(20.0, run=1, signal="heading"))
    windows = Windows([*cut(both, 10.0), *cut(other, 10.0)])
    assert sorted(windows.signals) == ["heading", "yaw_rate"]
    assert set(windows.signals["yaw_rate"].window) == {0, 1}
    heading = windows.signals["heading"]
    assert set(heading.window) == {2, 3}
    assert heading.begins.tolist()[:3] == [0, 0, 0]
    assert heading.starts.tolist() == [0, int(heading.begins[3])]
    assert heading.at(cubic(windows.times)[:, None])[:, 0] == pytest.approx(heading.values, abs=1e-12)
    assert windows.seconds == pytest.approx(40.0)
    assert windows.runs == 2


@settings(max_examples=20, deadline=None)
@given(st.floats(1.0, 60.0), st.floats(1.0, 30.0))
def test_windows_that_begin_early_lose_the_first_samples_alone(seconds, length):
    whole, lead = record(seconds), 0.2
    windows = cut(whole, length, lead)
    stamps = np.concatenate([one.measured["yaw_rate"].times for one in windows])
    own = whole.measured["yaw_rate"].times
    assert np.array_equal(stamps, own[own >= whole.times[20]])
    assert windows[0].times[0] == whole.times[0]
    assert windows[-1].times[-1] == whole.times[-1]
    for before, after in pairwise(windows):
        assert before.times[-1] - after.times[0] == pytest.approx(lead, abs=1e-9)
    for one in windows:
        assert one.measured["yaw_rate"].times[0] >= one.times[0] + lead - 1e-9
        assert one.road_wheel_angle == pytest.approx(cubic(one.times), abs=1e-12)


def test_a_record_shorter_than_the_lead_is_used_from_its_start():
    (window,) = cut(record(0.2), 10.0, 0.2)
    assert window.measured["yaw_rate"].times.size == 10
    assert window.times.size == 21


def test_slopes_between_grid_points_are_those_of_the_cubic():
    windows = Windows([*cut(record(), 10.0, 0.2), *cut(record(17.0, run=1, rate=83.0), 10.0)])
    samples = windows.signals["yaw_rate"]
    grid = np.column_stack([cubic(windows.times), np.cos(windows.times)])
    slopes = samples.slopes(grid)
    t = (samples.times - 110.0) / 10
    assert slopes[:, 0] == pytest.approx((1 - t + 0.9 * t**2) / 10, abs=1e-10)
    assert slopes[:, 1] == pytest.approx(-np.sin(samples.times), abs=1e-6)


@pytest.mark.parametrize("delay", [0.0, 0.0137, 0.15, 0.2])
def test_a_late_sensor_reads_what_was_before_its_stamp(delay):
    windows = Windows(cut(record(), 10.0, 0.2))
    late = windows.later("yaw_rate", delay)
    grid = cubic(windows.times)[:, None]
    assert late.at(grid)[:, 0] == pytest.approx(cubic(late.times - delay), abs=1e-12)
    now = windows.signals["yaw_rate"]
    assert np.array_equal(late.values, now.values)
    assert np.array_equal(late.times, now.times)
    assert np.array_equal(late.window, now.window)


@pytest.mark.parametrize("lead", [0.0, 0.2])
def test_stretches_are_the_uninterrupted_parts_of_the_runs(lead):
    first, rest = record(20.0), record(15.0, begin=130.0)
    other = record(12.0, begin=142.0, run=1)  # begins where the run before it is already over
    windows = Windows([part for one in (first, rest, other) for part in cut(one, 5.0, lead)])
    stretches = windows.stretches
    assert [one.times[0] for one in stretches] == [100.0, 130.0, 142.0]
    assert [one.times[-1] for one in stretches] == pytest.approx([120.0, 145.0, 154.0])
    rows = np.concatenate([one.rows for one in stretches])
    assert np.array_equal(rows, np.arange(windows.times.size))
    for one in stretches:
        assert one.times[one.place] == pytest.approx(windows.times[one.rows], abs=1e-9)
        assert set(one.place) == set(range(one.times.size))
        assert one.whole(windows.times) == pytest.approx(one.times, abs=1e-9)
        both = np.column_stack([windows.times, windows.steps])
        assert one.whole(both)[:, 0] == pytest.approx(one.times, abs=1e-9)
