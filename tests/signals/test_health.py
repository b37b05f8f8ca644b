"""What is said of topics and signals."""

import numpy as np
import pytest

from ident.signals.health import resolution, signal_health, topic_health
from ident.signals.stamps import TopicTimes


def times(stamps, arrival=None, kind="header"):
    stamps = np.round(np.asarray(stamps) * 1e9).astype(np.int64)
    arrival = stamps if arrival is None else np.round(np.asarray(arrival) * 1e9).astype(np.int64)
    return TopicTimes(stamps, np.ones(len(stamps), dtype=bool), arrival, kind)


def test_rate_gaps_and_lost_messages_of_a_steady_topic():
    stamps = np.arange(0, 10, 0.02)
    stamps = np.delete(stamps, [100, 200, 201, 202])
    health = topic_health("/a", "t", times(stamps), 0)
    assert health.rate == pytest.approx(50.0)
    assert health.jitter == pytest.approx(0.0, abs=1e-6)
    assert [(gap.start, round(gap.seconds, 6)) for gap in health.gaps] == [
        (pytest.approx(99 * 0.02), 0.04),
        (pytest.approx(199 * 0.02), 0.08),
    ]
    assert health.lost == 4


def test_jitter_is_half_of_the_16_to_84_percent_range_of_the_period():
    rng = np.random.default_rng(0)
    periods = 0.02 * (1 + 0.05 * rng.standard_normal(20_000))
    health = topic_health("/a", "t", times(np.cumsum(periods)), 0)
    assert health.jitter == pytest.approx(0.05, rel=0.03)


def test_a_topic_without_a_steady_rate_counts_no_lost_messages():
    rng = np.random.default_rng(0)
    health = topic_health("/a", "t", times(np.cumsum(rng.exponential(0.02, 2000))), 0)
    assert health.lost is None


def test_two_messages_tell_no_rate():
    health = topic_health("/a", "t", times([0.0, 1.0]), 0)
    assert (health.rate, health.jitter, health.gaps, health.lost) == (None, None, [], None)


def test_delay_and_disorder():
    stamps = [0.0, 0.1, 0.3, 0.2, 0.4, 0.4]
    health = topic_health("/a", "t", times(stamps, np.asarray(stamps) + 0.005), 0)
    assert (health.out_of_order, health.repeated_stamps) == (1, 1)
    assert health.arrival_delay == pytest.approx(0.005)
    assert health.arrival_delay_p95 == pytest.approx(0.005)
    assert topic_health("/a", "t", times(stamps, kind="log"), 0).arrival_delay is None


def test_the_longest_of_very_many_gaps_are_listed():
    stamps = np.cumsum(np.where(np.arange(3000) % 5, 0.01, 0.02 + 1e-5 * np.arange(3000)))
    health = topic_health(
        "/a", "t", times(np.concatenate([stamps, stamps[-1] + np.arange(1, 30_000) / 100])), 0
    )
    assert len(health.gaps) == 200
    assert min(gap.seconds for gap in health.gaps) > 0.03
    assert [gap.start for gap in health.gaps] == sorted(gap.start for gap in health.gaps)


@pytest.mark.parametrize("step", [0.1 * np.pi / 180, 1.0, 2 * np.pi / 4096, 1e-5])
def test_finds_the_step_of_a_quantised_signal(step):
    rng = np.random.default_rng(5)
    smooth = 20 * step * np.sin(np.arange(3000) / 40) + step * rng.standard_normal(3000)
    assert resolution(np.round(smooth / step) * step) == pytest.approx(step, rel=1e-6)


def test_finds_the_step_through_a_gain_and_an_offset():
    rng = np.random.default_rng(5)
    counts = np.round(rng.normal(0, 300, 4000))
    assert resolution(1.234 + 0.0017 * counts) == pytest.approx(0.0017, rel=1e-6)


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(1).standard_normal(2000),
        np.random.default_rng(1).standard_normal(2000).astype(np.float32).astype(float),
        np.repeat([0, np.pi / 4, np.pi / 3, np.pi / 2] * 10, 50),
        np.sin(np.arange(4000) / 50),
        np.zeros(1000),
        np.arange(3.0),
    ],
    ids=["white", "float32", "pulses", "sine", "zero", "short"],
)
def test_sees_no_step_where_there_is_none(values):
    assert resolution(values) is None


def test_range_and_repetitions_of_a_signal():
    health = signal_health("yaw_rate", "rad/s", "/a.b", np.array([1.0, 1.0, 2.0, 2.0, 0.0]), 3)
    assert (health.samples, health.low, health.high, health.repeated, health.not_finite) == (
        5,
        0.0,
        2.0,
        0.5,
        3,
    )
