import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ident.report.condense import Line, break_limit, broken, contiguous, evenly, spread_out, thinned


def test_cuts_at_a_long_pause_and_at_another_part():
    time = np.array([0.0, 0.1, 0.2, 5.0, 5.1, 5.2, 5.3])
    part = np.array([0, 0, 0, 1, 1, 2, 2])
    assert contiguous(time, part) == [slice(0, 3), slice(3, 5), slice(5, 7)]


def test_a_pause_of_five_periods_of_a_slow_signal_does_not_break_it():
    time = np.array([0.0, 1.0, 2.0, 6.9, 7.9])
    assert break_limit(time) == pytest.approx(5.0)
    assert contiguous(time) == [slice(0, 5)]


def test_nothing_is_cut_out_of_no_samples():
    assert contiguous(np.empty(0)) == []
    assert broken(np.empty(0), np.empty(0), []).time.size == 0


def test_lifts_the_pen_once_at_each_gap():
    time = np.array([0.0, 0.1, 5.0, 5.1])
    line = broken(time, np.arange(4.0), [slice(0, 2), slice(2, 4)])
    assert line.time.tolist() == [0.0, 0.1, 0.1, 5.0, 5.1]
    np.testing.assert_array_equal(line.value, [0.0, 1.0, np.nan, 2.0, 3.0])


@given(st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_thinning_keeps_the_extremes_the_ends_and_the_order(bins, seed):
    rng = np.random.default_rng(seed)
    line = Line(np.sort(rng.uniform(0, 10, 2000)), rng.normal(size=2000))
    drawn = thinned(line, bins)
    assert drawn.time.size <= 4 * bins
    assert drawn.value.min() == line.value.min()
    assert drawn.value.max() == line.value.max()
    assert (drawn.time[0], drawn.time[-1]) == (line.time[0], line.time[-1])
    assert np.all(np.diff(drawn.time) >= 0)
    assert np.isin(drawn.value, line.value).all()


def test_thinning_keeps_one_spike_of_a_single_sample():
    value = np.zeros(100_000)
    value[43_210] = 7.0
    drawn = thinned(Line(np.arange(100_000) * 0.01, value), 500)
    assert drawn.time[np.argmax(drawn.value)] == pytest.approx(432.1)
    assert drawn.time.size <= 2000


def test_thinning_keeps_the_gaps():
    value = np.ones(10_000)
    value[5000] = np.nan
    drawn = thinned(Line(np.arange(10_000) * 0.01, value), 100)
    assert np.isnan(drawn.value).sum() == 1


def test_however_often_the_pen_is_lifted_few_samples_remain():
    value = np.where(np.arange(50_000) % 3 == 0, np.nan, np.sin(np.arange(50_000.0)))
    drawn = thinned(Line(np.arange(50_000) * 0.01, value), 100)
    assert drawn.time.size <= 500
    assert np.nanmax(drawn.value) == np.nanmax(value)
    assert np.isnan(drawn.value).sum() >= 100


def test_a_short_line_is_left_alone():
    line = Line(np.arange(400.0), np.arange(400.0))
    assert thinned(line, 100) is line


def test_a_line_without_length_is_left_alone():
    line = Line(np.zeros(100), np.arange(100.0))
    assert thinned(line, 3) is line


def test_chooses_evenly_with_both_ends():
    assert evenly(3, 5) == [0, 1, 2]
    assert evenly(10, 4) == [0, 3, 6, 9]
    assert evenly(100, 2) == [0, 99]


def test_a_cloud_keeps_its_shape_and_its_ends():
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=(2, 50_000))
    kept = spread_out(x, y, (40, 30))
    assert kept.size <= 40 * 30 + 4
    assert np.all(np.diff(kept) > 0)
    for values in (x, y):
        assert (values[kept].min(), values[kept].max()) == (values.min(), values.max())
    cells = {(round(a), round(b)) for a, b in zip(x * 2, y * 2, strict=True)}
    assert {(round(a), round(b)) for a, b in zip(x[kept] * 2, y[kept] * 2, strict=True)} >= {
        cell for cell in cells if abs(cell[0]) < 4 and abs(cell[1]) < 4
    }


def test_points_on_one_spot_become_one():
    assert spread_out(np.ones(5), np.ones(5), (10, 10)).tolist() == [0]
    assert spread_out(np.empty(0), np.empty(0), (10, 10)).size == 0
