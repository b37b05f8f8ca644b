"""What header stamps say against log times."""

import numpy as np
import pytest

from ident.signals.clocks import clock_notes
from ident.signals.stamps import TopicTimes


def notes(stamps, delay):
    stamps = np.round(np.asarray(stamps) * 1e9).astype(np.int64)
    arrival = stamps + np.round(np.asarray(delay) * 1e9).astype(np.int64)
    return clock_notes({"/a": TopicTimes(stamps, np.ones(len(stamps), dtype=bool), arrival, "header")}, 0)


TIME = np.arange(0, 120, 0.02)


def delays(seed=0):
    """Transport delays with a tail, as queues make them."""
    rng = np.random.default_rng(seed)
    return 0.002 + rng.exponential(0.001, len(TIME)) + 0.05 * (rng.random(len(TIME)) < 0.01)


def test_a_sound_clock_is_one_line():
    assert notes(TIME, np.full(len(TIME), 0.004)) == [
        "header stamps are 4.0 ms before the log times (medians of 1 topic)"
    ]
    assert len(notes(TIME, delays())) == 1


def test_copied_stamps_are_noticed():
    assert notes(TIME, np.zeros(len(TIME))) == [
        "header stamps equal the log times: transport delays cannot be seen"
    ]


def test_stamps_in_the_future_are_noticed():
    assert "sender and recorder are on two clocks" in notes(TIME, np.full(len(TIME), -0.046))[1]


@pytest.mark.parametrize("ppm", [-80, 40])
def test_drift_is_measured_through_the_jitter_of_the_transport(ppm):
    drift = notes(TIME, delays() + 1e-6 * ppm * TIME)[-1]
    value = float(drift.split("drifts by ")[1].split(" ppm")[0])
    assert value == pytest.approx(ppm, abs=5)


@pytest.mark.parametrize("seed", range(5))
def test_no_drift_is_seen_where_there_is_none(seed):
    assert not any("drifts" in note for note in notes(TIME, delays(seed)))


def test_a_jump_is_found_with_its_time_and_size():
    (_, jump) = notes(TIME, delays() + np.where(TIME > 70, 0.2, 0.0))
    assert jump.startswith("/a: the delay jumps by +200 ms at 70.")


def test_a_stall_of_the_recorder_is_no_jump():
    delay = delays()
    stalled = (TIME > 50) & (TIME < 50.5)
    delay[stalled] += 50.5 - TIME[stalled]
    assert not any("jumps" in note for note in notes(TIME, delay))


def test_topics_without_stamps_say_nothing():
    stamps = np.arange(10)
    assert clock_notes({"/a": TopicTimes(stamps, np.ones(10, dtype=bool), stamps, "log")}, 0) == []
