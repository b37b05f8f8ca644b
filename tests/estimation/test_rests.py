"""Where a wheel rests is found, and the angle there told without what a corner or noise would add."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.estimation.rests import take_rests

Array = NDArray[np.float64]

PERIOD, STD = 0.01, 8e-5  # [s], [rad]
POLE = 0.6
MEMORY = np.asarray(lfilter([STD], [1.0, -POLE], np.eye(1, 400)[0]))  # of the noise
LEVELS = (0.0, 0.05, -0.03, 0.02)  # [rad]


def noise_of(count: int, seed: int) -> Array:
    drawn = np.random.default_rng(seed).standard_normal(count + 200)
    return np.asarray(lfilter([STD], [1.0, -POLE], drawn)[200:])


def held(turning: float, rest: float) -> Array:
    """Held at a level, turned to the next within ``turning`` seconds, held there for ``rest`` seconds."""
    parts = []
    for before, after in zip(LEVELS, (*LEVELS[1:], 0.0), strict=True):
        share = np.arange(round(turning / PERIOD)) * PERIOD / turning
        parts += [np.full(round(rest / PERIOD), before), before + (after - before) * share]
    return np.concatenate(parts)


def taken(values: Array) -> tuple[Array, Array]:
    """Estimates where rests are, and where that is; nothing is smoothed before."""
    made, reached = values[:, None].copy(), np.zeros((values.size, 1), dtype=np.intp)
    take_rests(values[:, None], made, reached, MEMORY, PERIOD)
    return made[:, 0], reached[:, 0] > 0


@pytest.mark.parametrize("rest", [2.2, 3.0, 5.0])
def test_a_rest_is_found_from_its_corner_on_and_told_by_its_mean(rest: float) -> None:
    for seed in range(5):
        true = held(0.4, rest)
        values = true + noise_of(true.size, seed)
        made, resting = taken(values)
        still = np.concatenate([[0.0], np.diff(true)]) == 0
        assert np.mean(resting == still) > 0.97
        # of a mean over two seconds, or over four; corners are found to one sample or two
        std = STD / (1 - POLE) * np.sqrt(PERIOD / (4.0 if rest > 4.0 else 2.0))
        inner = still & np.roll(still, 3) & np.roll(still, -3)
        assert np.std((made - true)[inner & resting]) < 1.5 * std
        assert np.std((values - true)[inner]) > 1.5 * std


def test_in_a_short_rest_nothing_is_taken() -> None:
    true = held(0.4, 1.5)
    values = true + noise_of(true.size, 6)
    made, resting = taken(values)
    np.testing.assert_array_equal(made, values)
    assert not resting.any()


def test_what_always_moves_rests_only_where_it_turns_back_and_is_not_moved_there() -> None:
    seconds = np.arange(4000) * PERIOD
    for frequency in (0.1, 0.5, 2.0):
        true = 0.05 * np.sin(2 * np.pi * frequency * seconds)
        made, resting = taken(true + noise_of(seconds.size, 3))
        assert np.mean(resting) < 0.1
        assert np.abs(np.cos(2 * np.pi * frequency * seconds[resting])).max(initial=0.0) < 0.2
        assert np.abs((made - true)[resting]).max(initial=0.0) < 2 * STD


def test_a_slow_drift_is_followed() -> None:
    true = 1e-4 * np.arange(3000) * PERIOD  # [rad], as a driver's hand sinks
    made, resting = taken(true + noise_of(true.size, 4))
    assert np.abs(made - true)[resting].max() < 1.5 * STD


def test_without_noise_only_what_is_exactly_still_rests() -> None:
    true = held(0.4, 2.0)[:, None]
    made, reached = true.copy(), np.zeros(true.shape, dtype=np.intp)
    take_rests(true, made, reached, 1e-6 * MEMORY, PERIOD)
    np.testing.assert_allclose(made, true, rtol=0, atol=1e-9)


@pytest.mark.parametrize("period", [0.002, 0.02, 0.03, 0.04, 0.05, 0.1, 0.3])
def test_rests_are_found_at_any_rate_and_end_where_the_angle_jumps(period: float) -> None:
    true = np.repeat(LEVELS, round(6.0 / period))
    values = true + STD * np.random.default_rng(8).standard_normal(true.size)
    made, reached = values[:, None].copy(), np.zeros((values.size, 1), dtype=np.intp)
    take_rests(values[:, None], made, reached, np.array([STD]), period)
    resting = reached[:, 0] > 0
    assert np.mean(resting) > 0.9
    assert np.std((made[:, 0] - true)[resting]) < 1.5 * STD * np.sqrt(period / 4.0)


def test_a_record_shorter_than_a_rest_stays_as_it_is() -> None:
    values = noise_of(12, 5)
    made, resting = taken(values)
    np.testing.assert_array_equal(made, values)
    assert not resting.any()


def test_several_angles_at_once_are_each_treated_as_alone() -> None:
    true = held(0.4, 2.0)
    values = np.column_stack([true + noise_of(true.size, seed) for seed in range(3)])
    made, reached = values.copy(), np.zeros(values.shape, dtype=np.intp)
    take_rests(values, made, reached, MEMORY, PERIOD)
    for column in range(3):
        alone, resting = taken(values[:, column])
        np.testing.assert_allclose(made[:, column], alone, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(reached[:, column] > 0, resting)
