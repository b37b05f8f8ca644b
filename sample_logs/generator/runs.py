"""The sample runs: which there are, what each records, and how they are made.

``generate`` writes them, ``make_topics`` makes one in memory. Every run has its own random numbers, by its
name, so that a run is the same whether it is made alone or with the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from .actuator import WheelState, held_response
from .commands import Command
from .driving import Speed, circle_request, drivers_wheel, slalom_request, varied_speed
from .messages import Storage, Topic, write_run
from .motion import drive, motion_topics, velocity_topic
from .path_following import TASKS, Task, follow
from .recorder import Recorder
from .sensors import NANOSECONDS, Stamps, generator, schedule, seconds
from .steering import ANGLE, LEAD, REQUEST, STEERING_TESTS, steering_signals
from .truth import Truth
from .vehicle import STEP

Array = NDArray[np.float64]
Make = Callable[[Truth, int, str], list[Topic]]

REFERENCE = "/control/reference"
REFERENCE_SPEED = "/control/reference_speed"
ENGAGED = "/control/engaged"
DEFAULT_SEED = 1
CRAWL = 5.0  # [m/s]
WITHOUT_SPEED = "steering_sines_b"


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
    runs = {name: RUNS[name] for name in (RUNS if only is None else only)}
    for name, run in runs.items():
        write_run(out / name, run.storage, run.start, run.make(truth, seed, name))
    return [out / name for name in runs]


def make_topics(name: str, truth: Truth, seed: int = DEFAULT_SEED) -> dict[str, Topic]:
    """Make one run in memory: what its log would hold, by topic."""
    return {topic.name: topic for topic in RUNS[name].make(truth, seed, name)}


def steering_topics(truth: Truth, seed: int, name: str) -> list[Topic]:
    """Record a steering test: request and angle, and the speed (standstill or crawl) unless left out."""
    test = STEERING_TESTS[name]
    signals = steering_signals(name, truth.steering, seed)
    recorder = Recorder(truth.recording, seed, name, test.duration)  # of what the signals have not lost
    speed = 0.0 if "pulses" in name else CRAWL
    topics = [
        recorder.logged(REQUEST, "request", _stamps(signals.request_time), signals.request),
        recorder.logged(ANGLE, "angle", _stamps(signals.angle_time), signals.angle),
    ]
    if name == WITHOUT_SPEED:
        return topics
    losing = replace(recorder, losses=test.losses)
    return [*topics, velocity_topic(losing, truth, lambda time: np.full_like(time, speed))]


def _stamps(time: Array) -> Stamps:
    return np.round(time * NANOSECONDS).astype(np.int64)


def slow_run(command: Command, duration: float) -> Make:
    """Prepare a slow manoeuvre of the truck on two tracks, whose actuator follows the request."""

    def make(truth: Truth, seed: int, name: str) -> list[Topic]:
        random = generator(seed, name)
        recorder = Recorder(truth.recording, seed, name, duration)
        stamps = schedule(truth.steering.request, -LEAD, duration, generator(seed, name, REQUEST))
        sent_time = seconds(stamps)
        sent = command(sent_time)
        at_rest = WheelState(float(sent_time[0]), 0.0, 0.0, 0.0)

        def wheel(time: Array) -> Array:
            return held_response(truth.steering.actuator, sent_time, sent, time, at_rest)[0]

        speed = varied_speed(CRAWL - 0.15, CRAWL + 0.15, duration, random)
        motion = drive(truth.truck, wheel, speed, duration, _somewhere(random))
        return [
            recorder.logged(REQUEST, "request", stamps, sent),
            recorder.sensed(ANGLE, "angle", truth.steering.angle, {"angle": wheel}),
            *motion_topics(recorder, truth, truth.truck, motion),
        ]

    return make


@dataclass(frozen=True)
class Trip:
    """A drive with a driver at the wheel.

    vehicle : which of the simulated trucks
    peak : largest lateral acceleration in the driver's mind [m/s²]
    duration : [s]
    """

    vehicle: Literal["truck", "planar"]
    peak: float
    duration: float = 60.0


TRIPS = {
    "manual_a": Trip("truck", 4.6),
    "manual_b": Trip("truck", 4.9),
    "manual_c": Trip("truck", 4.7),
    "planar/planar_a": Trip("planar", 4.4),
    "planar/planar_b": Trip("planar", 4.7),
    "planar/planar_c": Trip("planar", 4.4),
}


def drivers_inputs(trip: Trip, truth: Truth, random: np.random.Generator) -> tuple[CubicSpline, Speed, Array]:
    """Steering-wheel angle [rad] and speed [m/s] of a trip, and the pose at its start."""
    speed = varied_speed(10.2, 14.8, trip.duration, random)
    wheel = drivers_wheel(truth.planar, trip.peak, speed, trip.duration, random)
    return wheel, speed, _somewhere(random)


def driver_run(trip: Trip, *, silent: bool = False) -> Make:
    """Prepare a run with a driver at the wheel; ``silent``: the request topic is there, without a message."""

    def make(truth: Truth, seed: int, name: str) -> list[Topic]:
        wheel, speed, pose = drivers_inputs(trip, truth, generator(seed, name))
        recorder = Recorder(truth.recording, seed, name, trip.duration)
        truck = getattr(truth, trip.vehicle)
        motion = drive(truck, wheel, speed, trip.duration, pose)
        nothing = recorder.logged(REQUEST, "request", np.empty(0, np.int64), np.empty(0))
        return [
            *([nothing] if silent else []),
            recorder.sensed(ANGLE, "angle", truth.steering.angle, {"angle": wheel}),
            *motion_topics(recorder, truth, truck, motion),
        ]

    return make


def path_run(task: Task) -> Make:
    """Prepare a run of the truck on two tracks along a path, engaged part of the time."""

    def make(truth: Truth, seed: int, name: str) -> list[Topic]:
        recorder = Recorder(truth.recording, seed, name, task.duration)
        done = follow(task, truth, recorder, _somewhere(generator(seed, name)))
        half_steps = STEP / 2.0 * np.arange(len(done.wheel))

        def wheel(time: Array) -> Array:
            return np.interp(time, half_steps, done.wheel)

        return [
            recorder.logged(REQUEST, "request", done.stamps, done.request),
            recorder.logged(REFERENCE, "reference", done.stamps, *done.reference.T),
            recorder.logged(REFERENCE_SPEED, "speed", done.stamps, done.speed),
            recorder.logged(ENGAGED, "engaged", done.stamps, done.engaged),
            recorder.sensed(ANGLE, "angle", truth.steering.angle, {"angle": wheel}),
            *motion_topics(recorder, truth, truth.truck, done.motion),
        ]

    return make


def _somewhere(random: np.random.Generator) -> Array:
    """Position [m] and heading [rad] at the start, on a map whose origin lies elsewhere."""
    return np.array([*random.uniform(-400.0, 400.0, 2), random.uniform(-np.pi, np.pi)])


RUNS: dict[str, SampleRun] = {
    "steering_pulses_a": SampleRun("mcap", 1_760_000_412_306_118_541, steering_topics),
    "steering_pulses_b": SampleRun("sqlite3", 1_760_000_731_920_447_083, steering_topics),
    "steering_sines_a": SampleRun("mcap", 1_760_001_196_053_771_902, steering_topics),
    "steering_sines_b": SampleRun("sqlite3", 1_760_001_840_518_236_377, steering_topics),
    "slow_slalom": SampleRun("mcap", 1_760_003_015_774_902_618, slow_run(slalom_request, 55.0)),
    "slow_circle": SampleRun("mcap", 1_760_003_388_129_550_034, slow_run(circle_request, 80.0)),
    "manual_a": SampleRun("mcap", 1_760_004_902_661_038_295, driver_run(TRIPS["manual_a"])),
    "manual_b": SampleRun("mcap", 1_760_005_277_408_615_733, driver_run(TRIPS["manual_b"], silent=True)),
    "manual_c": SampleRun("mcap", 1_760_005_690_093_284_166, driver_run(TRIPS["manual_c"])),
    "path_a": SampleRun("mcap", 1_760_006_318_470_902_366, path_run(TASKS["path_a"])),
    "path_b": SampleRun("mcap", 1_760_006_702_945_331_890, path_run(TASKS["path_b"])),
    "planar/planar_a": SampleRun("mcap", 1_760_007_204_835_197_452, driver_run(TRIPS["planar/planar_a"])),
    "planar/planar_b": SampleRun("mcap", 1_760_007_551_250_742_809, driver_run(TRIPS["planar/planar_b"])),
    "planar/planar_c": SampleRun("mcap", 1_760_007_896_517_463_021, driver_run(TRIPS["planar/planar_c"])),
}
