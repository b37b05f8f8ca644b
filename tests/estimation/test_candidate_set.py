"""The class of candidates that data cannot tell apart holds the right one."""

from __future__ import annotations

import numpy as np
import pytest

from ident.estimation.before_after import gain_interval, rms_range, same_size, scatter_of_runs
from ident.estimation.candidate_set import candidate_set
from ident.estimation.layer import Likelihood

BINS, RUNS = 160, 8


def likelihood(values: np.ndarray) -> Likelihood:
    run = np.repeat(np.arange(RUNS), BINS // RUNS * 8).astype(np.intp)
    return Likelihood(run, np.tile(np.arange(BINS // RUNS * 8) * 0.25, RUNS), values)


def fitted(rows: np.ndarray, columns: np.ndarray) -> Likelihood:
    """2 log likelihood by bins of ten rows of unit noise after a least-squares fit."""
    rest = rows - columns @ np.linalg.lstsq(columns, rows, rcond=None)[0] if columns.size else rows
    return likelihood(-(rest.reshape(-1, 10) ** 2).sum(axis=1))


def rivals(random: np.random.Generator, alike: float) -> tuple[np.ndarray, np.ndarray]:
    """Two directions whose cosine is ``alike``."""
    one, other = random.standard_normal((2, BINS * 80))
    other -= one * (one @ other) / (one @ one)
    return one, alike * one + np.sqrt(1 - alike**2) * other


def draws(alike: float, strength: float, count: int) -> tuple[float, float, float]:
    """How often the right one is in the class, its mean size, and how often another is named alone."""
    random = np.random.default_rng(7)
    inside, size, alone = [], [], []
    for _ in range(count):
        true, other = rivals(random, alike)
        rows = random.standard_normal(true.size) + strength * true / np.linalg.norm(true)
        base = fitted(rows, np.zeros((rows.size, 0)))
        both = {"true": fitted(rows, true[:, None]), "other": fitted(rows, other[:, None])}
        found = candidate_set(both, {"true": 1, "other": 1}, base=base)
        inside.append("true" in found.members)
        size.append(len(found.members))
        alone.append(found.members == ("other",))
    return float(np.mean(inside)), float(np.mean(size)), float(np.mean(alone))


def test_of_two_that_differ_only_the_right_one_is_left() -> None:
    inside, size, alone = draws(alike=0.3, strength=10.0, count=100)
    assert inside == 1.0
    assert size < 1.05
    assert alone == 0.0


def test_two_that_look_the_same_stay_together() -> None:
    inside, size, alone = draws(alike=0.99, strength=6.0, count=100)
    assert inside >= 0.95
    assert size > 1.9
    assert alone <= 0.05


def test_the_right_one_is_inside_where_they_are_half_alike() -> None:
    inside, _, alone = draws(alike=0.8, strength=5.0, count=200)
    assert inside >= 0.95
    assert alone <= 0.05


def test_a_parameter_more_must_pay_for_itself() -> None:
    random = np.random.default_rng(3)
    kept = []
    for _ in range(60):
        columns = random.standard_normal((BINS * 80, 2))
        rows = random.standard_normal(len(columns)) + 0.08 * columns[:, 0]
        found = candidate_set(
            {"small": fitted(rows, columns[:, :1]), "large": fitted(rows, columns)}, {"small": 1, "large": 2}
        )
        kept.append(found.best == "small")
    assert np.mean(kept) > 0.9


def test_one_candidate_is_a_class_of_its_own_and_none_is_an_error() -> None:
    one = likelihood(np.zeros(BINS * 8))
    assert candidate_set({"a": one}, {"a": 1}).members == ("a",)
    with pytest.raises(ValueError, match="no candidate"):
        candidate_set({}, {})
    with pytest.raises(ValueError, match="different bins"):
        candidate_set(
            {"a": one, "b": Likelihood(one.run[:5], one.time[:5], one.values[:5])}, {"a": 1, "b": 1}
        )


def test_the_interval_of_a_gain_holds() -> None:
    random = np.random.default_rng(5)
    held = []
    for _ in range(200):
        slow = np.repeat(random.standard_normal(BINS), 8)  # the same for 2 s
        gain = 0.3 + slow + random.standard_normal(slow.size)
        before, after = likelihood(np.zeros(gain.size)), likelihood(2 * gain)
        mean, low, high = gain_interval(before, after)
        assert low < mean < high
        held.append(low <= 0.3 <= high)
    assert 0.90 <= np.mean(held) <= 0.99


def test_a_gain_is_told_for_each_sample_where_their_number_is_given() -> None:
    before, after = likelihood(np.zeros(BINS * 8)), likelihood(np.ones(BINS * 8))
    assert gain_interval(before, after)[0] == pytest.approx(0.5)
    assert gain_interval(before, after, samples=BINS * 80)[0] == pytest.approx(0.05)


def test_root_mean_squares_have_intervals() -> None:
    random = np.random.default_rng(6)
    run, time = np.repeat(np.arange(4), 4000).astype(np.intp), np.tile(np.arange(4000) * 0.01, 4)
    before = 2.0 * random.standard_normal(16000)
    value, low, high = rms_range(before, run, time)
    assert low is not None
    assert high is not None
    assert low < 2.0 < high
    assert value == pytest.approx(2.0, abs=0.05)
    assert rms_range(before[:10], run[:10], time[:10])[1:] == (None, None)


def test_sizes_that_differ_between_runs_are_seen_and_mute_runs_do_not_count() -> None:
    stds = np.array([0.1, 0.1, 0.1, np.inf])
    same = same_size(np.array([1.0, 1.1, 0.95, 50.0]), stds)
    differ = same_size(np.array([1.0, 2.0, 0.2, 50.0]), stds)
    assert same is not None
    assert differ is not None
    assert same > 0.3
    assert differ < 1e-6
    assert same_size(np.array([1.0, 2.0]), np.array([0.1, np.inf])) is None


def test_sizes_that_scatter_as_their_errors_say_widen_nothing_and_others_do() -> None:
    stds = np.array([0.1, 0.1, np.inf, 0.2])
    assert scatter_of_runs(np.array([1.0, 1.0, 9.0, 1.0]), stds) == 1.0
    # About the weighted mean of 1, 1.6 and 1.3, which is 1.3: (3² + 3² + 0) / 2.
    assert scatter_of_runs(np.array([1.0, 1.6, 9.0, 1.3]), stds) == pytest.approx(3.0)
    assert scatter_of_runs(np.array([1.0]), np.array([0.1])) == 1.0
