"""Signal blocks: what they do, and that their derivatives are those of what they do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ident.dynamics.blocks import delayed, held, play, quantised, ratio_map, start_matters

TIME = np.linspace(0.0, 6.0, 601)
WAVE = np.sin(2.0 * TIME) * (1 + 0.2 * TIME)


def test_a_delayed_signal_is_the_signal_of_before() -> None:
    at = np.linspace(1.0, 7.0, 77)
    value, derivative = delayed(TIME, WAVE, 0.25, at)
    assert value == pytest.approx(np.interp(at - 0.25, TIME, WAVE), abs=1e-15)
    small = 1e-7
    later, sooner = (delayed(TIME, WAVE, 0.25 + s * small, at)[0] for s in (1, -1))
    kink = np.abs((at - 0.25) / 0.01 % 1 - 0.5) > 0.49
    assert derivative[~kink] == pytest.approx((later - sooner)[~kink] / (2 * small), abs=1e-6)
    assert np.count_nonzero(~kink) > 50


def test_before_and_after_its_samples_a_signal_is_held_and_has_no_slope() -> None:
    value, derivative = delayed(TIME, WAVE, 0.5, np.array([0.0, 9.0]))
    assert value == pytest.approx([WAVE[0], WAVE[-1]])
    assert derivative == pytest.approx([0.0, 0.0])


def test_a_held_command_changes_when_its_dead_time_is_over() -> None:
    times, values = np.array([0.0, 1.0, 2.0]), np.array([5.0, 7.0, 6.0])
    at = np.array([-1.0, 0.3, 1.29, 1.31, 2.29, 2.31, 9.0])
    assert held(times, values, 0.3, at).tolist() == [5, 5, 5, 7, 7, 6, 6]


TABLE = np.array([[-6.0, -0.35], [-1.0, -0.05], [1.0, 0.05], [6.0, 0.35]])


def test_the_ratio_map_passes_its_rows_and_goes_on_straight_beyond_them() -> None:
    assert ratio_map(TABLE, TABLE[:, 0])[0] == pytest.approx(TABLE[:, 1])
    value, slope = ratio_map(TABLE, np.array([-7.0, 0.5, 3.5, 8.0]))
    assert value == pytest.approx([-0.41, 0.025, 0.2, 0.47])
    assert slope == pytest.approx([0.06, 0.05, 0.06, 0.06])


def test_quantised_values_are_multiples_of_the_step() -> None:
    value, derivative = quantised(WAVE, 0.1)
    assert np.max(np.abs(value - WAVE)) <= 0.05 + 1e-12
    assert value / 0.1 == pytest.approx(np.round(value / 0.1), abs=1e-9)
    above, below = (quantised(WAVE, 0.1 + s * 1e-9)[0] for s in (1, -1))
    smooth = np.abs(WAVE / 0.1 % 1 - 0.5) > 1e-3
    assert derivative[smooth] == pytest.approx((above - below)[smooth] / 2e-9, abs=1e-4)


def test_play_lags_by_half_its_width_and_holds_at_reversal() -> None:
    out, _ = play(WAVE, 0.3)
    moving = np.concatenate([[False], np.abs(np.diff(out)) > 1e-12])
    assert np.all(np.abs(WAVE - out) <= 0.15 + 1e-12)
    assert np.abs(WAVE - out)[moving] == pytest.approx(0.15)
    assert 0.05 < np.mean(~moving) < 0.5


def test_play_of_no_width_changes_nothing() -> None:
    out, derivative = play(WAVE, 0.0, derivatives=np.ones((601, 1)))
    assert np.array_equal(out, WAVE)
    assert np.all(derivative[:, 1] == 1.0)


@pytest.mark.parametrize("start", [None, 0.02])
def test_the_derivatives_of_play_are_those_of_its_output(start: float | None) -> None:
    upstream = np.cos(3 * TIME)[:, None]
    _, derivative = play(WAVE, 0.3, start=start, derivatives=upstream)
    small = 1e-7
    for column, (width, shift) in enumerate([(small, 0.0), (0.0, small)]):
        above, below = (
            play(WAVE + s * shift * upstream[:, 0], 0.3 + s * width, start=start)[0] for s in (1, -1)
        )
        assert derivative[:, column] == pytest.approx((above - below) / (2 * small), abs=1e-6)


@given(
    st.lists(st.floats(-1, 1), min_size=1, max_size=40),
    st.floats(0, 1),
)
def test_play_of_the_mirrored_input_is_the_mirror(values: list[float], width: float) -> None:
    out, derivative = play(np.array(values), width)
    mirrored, of_mirrored = play(-np.array(values), width)
    assert np.array_equal(mirrored, -out)
    assert np.array_equal(of_mirrored, -derivative)


@given(
    st.lists(st.floats(-1, 1), min_size=1, max_size=40),
    st.floats(0.01, 1),
    st.floats(-1, 1),
    st.floats(-1, 1),
)
def test_where_a_play_began_no_longer_matters_once_its_input_has_moved_by_its_width(
    values: list[float], width: float, one: float, other: float
) -> None:
    given_values = np.array(values)
    outputs = [
        play(given_values, width, start=values[0] + side * width / 2)[0] for side in (one, other, -1.0, 1.0)
    ]
    matters = start_matters(given_values, width)
    assert np.ptp([out[~matters] for out in outputs], axis=0) == pytest.approx(0.0, abs=1e-12)
    assert np.all((outputs[3] - outputs[2])[start_matters(given_values, width - 1e-9)] > 0)


def test_play_of_nothing_is_nothing() -> None:
    out, derivative = play(np.empty(0), 0.1)
    assert (out.shape, derivative.shape) == ((0,), (0, 1))
