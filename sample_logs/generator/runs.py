"""The sample runs: which there are, what each records, and how they are made.

``generate`` writes them, ``make_topics`` makes one in memory. Every run has its own random numbers, by its
name, so that a run is the same whether it is made alone or with the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .messages import Storage, Topic, write_run
from .recorder import Recorder, Signal
from .sensors import NANOSECONDS, Stamps
from .steering import ANGLE, REQUEST, STEERING_TESTS, steering_signals
from .truth import Truth

Array = NDArray[np.float64]
Make = Callable[[Truth, int, str], list[Topic]]

VELOCITY = "/vehicle/velocity"
DEFAULT_SEED = 1
CRAWL = 5.0  # [m/s]


@dataclass(frozen=True)
class SampleRun:
    """One run of the set.

    storage : "mcap" or "sqlite3"
    start : of the recording [ns since 1970]
    make : from the truth, the seed and the run's name to its topics
    """

    storage: Storage
    start: int
    make: Make


def generate(
    out: Path, truth: Truth, seed: int = DEFAULT_SEED, only: Sequence[str] | None = None
) -> list[Path]:
    """Write sample runs as rosbag2 folders below ``out``, in place of those of the same names.

    Parameters
    ----------
    out : folder of the set
    truth : what the simulated truck is given
    seed : of everything random
    only : names of ``RUNS``, all of them where None

    Raises
    ------
    KeyError
        If a name is not one of ``RUNS``.
    """
    folders = []
    for name in RUNS if only is None else only:
        run = RUNS[name]
        write_run(out / name, run.storage, run.start, run.make(truth, seed, name))
        folders.append(out / name)
    return folders


def make_topics(name: str, truth: Truth, seed: int = DEFAULT_SEED) -> dict[str, Topic]:
    """Make one run in memory: what its log would hold, by topic."""
    return {topic.name: topic for topic in RUNS[name].make(truth, seed, name)}


def steering_topics(truth: Truth, seed: int, name: str) -> list[Topic]:
    """Record a steering test: request, angle and speed."""
    test = STEERING_TESTS[name]
    signals = steering_signals(name, truth.steering, seed)
    recorder = Recorder(truth.recording, seed, name, test.duration, test.losses)
    speed = 0.0 if "pulses" in name else CRAWL
    return [
        recorder.logged(REQUEST, "request", _stamps(signals.request_time), signals.request),
        recorder.logged(ANGLE, "angle", _stamps(signals.angle_time), signals.angle),
        velocity_topic(recorder, truth, lambda time: np.full_like(time, speed)),
    ]


def velocity_topic(recorder: Recorder, truth: Truth, speed: Signal) -> Topic:
    """Record the speed of the wheels: without a turning wheel there is no pulse and the speed is zero."""
    topic = recorder.sensed(VELOCITY, "speed", truth.velocity, {"speed": speed})
    turning = speed(topic.stamps / NANOSECONDS) > 0.0
    return Topic(
        topic.name, topic.kind, topic.stamps, topic.arrivals, (np.where(turning, topic.columns[0], 0.0),)
    )


def _stamps(time: Array) -> Stamps:
    return np.round(time * NANOSECONDS).astype(np.int64)


RUNS: dict[str, SampleRun] = {
    "steering_pulses_a": SampleRun("mcap", 1_760_000_412_306_118_541, steering_topics),
    "steering_pulses_b": SampleRun("sqlite3", 1_760_000_731_920_447_083, steering_topics),
    "steering_sines_a": SampleRun("mcap", 1_760_001_196_053_771_902, steering_topics),
    "steering_sines_b": SampleRun("sqlite3", 1_760_001_840_518_236_377, steering_topics),
}
