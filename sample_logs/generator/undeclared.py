"""Sets of runs of trucks that lack nothing, or have something that nobody declares beside the logs.

What each truck has stands in a file of the truth. Every set is a truck of its own, which its ``vehicle.yaml``
describes as an engineer would; names and order of its runs say nothing of what was driven.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from ruamel.yaml import YAML

from .effects import Driven, drive_run, truth_of
from .injected import Injected
from .injected_sensors import Reading, channel_with
from .manoeuvres import CAMPAIGN, Manoeuvre, part_of
from .messages import Topic, write_run
from .motion import IMU, ODOMETRY, velocity_topic
from .motion_sets import SOURCES
from .recorder import Recorder
from .sensors import NANOSECONDS, generator
from .steering import ANGLE, REQUEST
from .truth import DEFAULT_FOLDER, Planar, Sensor, Truth
from .vehicle import GRAVITY

SETS = ("set_b3", "set_f8", "set_k7", "set_m2", "set_r5", "set_w9")
FOLDER = "undeclared"
ANSWERS = "undeclared.yaml"
RATES = {"request": 50.0, ANGLE: 50.0, IMU: 50.0, ODOMETRY: 12.0, "velocity": 15.0}  # [1/s]
PARTS = {  # of the runs of the campaign: from, to [s]
    "there_and_back": (0.5, 43.0),
    "slow_circles": (12.0, 45.0),
    "sweep_slow": (3.0, 37.5),
    "sweep_fast": (3.0, 37.5),
    "ramp_steer": (5.0, 37.5),
    "weave": (10.0, 36.0),
    "steps": (10.0, 42.0),
    "free": (0.0, 27.0),
}
FIRST_START = 1_761_120_000 * NANOSECONDS  # of a recording, since 1970
BETWEEN = (70.0, 160.0)  # [s] between the starts of two runs


@dataclass(frozen=True)
class HiddenRun:
    """One run of a set.

    name : "run_01" ...; plan : name in the campaign
    number : place in the order of driving; start : of the recording [ns since 1970]
    """

    name: str
    plan: str
    number: int
    start: int


def generate_undeclared(
    out: Path, seed: int, names: Sequence[str], answers: Path = DEFAULT_FOLDER / ANSWERS
) -> list[Path]:
    """Write sets of runs below ``out``, in place of those of the same names; returns their folders."""
    made = []
    for name in names:
        truth, injected = hidden_truck(name, seed, answers)
        folder = out / FOLDER / name
        for run in hidden_runs(name, seed):
            write_run(folder / run.name, "mcap", run.start, topics_of(run, truth, injected, seed, name))
        (folder / "vehicle.yaml").write_text(vehicle_file(truth.planar), "utf-8")
        made.append(folder)
    return made


def injected_into(name: str, answers: Path = DEFAULT_FOLDER / ANSWERS) -> list[Injected]:
    """Return what the truck of a set has."""
    table: dict[str, list[dict[str, Any]]] = YAML(typ="safe", pure=True).load(answers)
    return [Injected(one["name"], one["parameters"], one.get("of")) for one in table[name]]


def hidden_truck(
    name: str, seed: int, answers: Path = DEFAULT_FOLDER / ANSWERS
) -> tuple[Truth, list[Injected]]:
    """Return the truck of a set with its sensors, and what is wrong with them."""
    injected = injected_into(name, answers)
    truth = truth_of("another", _seed(name, seed))
    steering = replace(
        truth.steering,
        request=replace(truth.steering.request, rate=RATES["request"]),
        angle=_sensor(truth.steering.angle, ANGLE, injected),
    )
    return replace(
        truth,
        steering=steering,
        velocity=_sensor(truth.velocity, "velocity", injected),
        imu=_sensor(truth.imu, IMU, injected),
        odometry=_sensor(truth.odometry, ODOMETRY, injected),
    ), injected


def _sensor(sensor: Sensor, topic: str, injected: Sequence[Injected]) -> Sensor:
    channels = {name: channel_with(one, name, injected) for name, one in sensor.channels.items()}
    return replace(sensor, rate=RATES[topic], channels=channels)


def hidden_runs(name: str, seed: int) -> list[HiddenRun]:
    """Return the runs of a set, in the order in which they were driven."""
    random = generator(_seed(name, seed), "order")
    plans = random.permutation(list(PARTS)).tolist()
    starts = FIRST_START + SETS.index(name) * 86_400 * NANOSECONDS
    starts += np.cumsum(np.round(random.uniform(*BETWEEN, len(plans)) * NANOSECONDS)).astype(np.int64)
    return [
        HiddenRun(f"run_{number + 1:02d}", plan, number, int(start))
        for number, (plan, start) in enumerate(zip(plans, starts, strict=True))
    ]


def plan_of(run: HiddenRun) -> Manoeuvre:
    """Return the part of a manoeuvre that a run is."""
    return part_of(CAMPAIGN[run.plan], *PARTS[run.plan])


def driven_run(run: HiddenRun, truth: Truth, injected: Sequence[Injected], seed: int, name: str) -> Driven:
    """Drive one run."""
    return drive_run(plan_of(run), run.name, run.number, truth, injected, _seed(name, seed))


def topics_of(
    run: HiddenRun, truth: Truth, injected: Sequence[Injected], seed: int, name: str
) -> list[Topic]:
    """Drive and record one run."""
    driven = driven_run(run, truth, injected, seed, name)
    recorder = Recorder(truth.recording, _seed(name, seed), run.name, plan_of(run).duration)
    stamps = np.round(driven.sent_time * NANOSECONDS).astype(np.int64)
    return [
        recorder.logged(REQUEST, "request", stamps, driven.sent),
        recorder.sensed(ANGLE, "angle", truth.steering.angle, _channels(driven.readings, ANGLE)),
        velocity_topic(recorder, truth, driven.readings["speed"]),
        recorder.sensed(IMU, "imu", truth.imu, _channels(driven.readings, IMU)),
        recorder.sensed(ODOMETRY, "odometry", truth.odometry, _channels(driven.readings, ODOMETRY)),
    ]


def _channels(readings: dict[str, Reading], topic: str) -> dict[str, Reading]:
    """What the channels of a device read, by their names."""
    own = {channel: readings[signal] for signal, (of, channel) in SOURCES.items() if of == topic}
    if topic == IMU:
        own |= {
            "roll_rate": readings["roll_rate"],
            "pitch_rate": np.zeros_like,
            "vertical_acceleration": lambda time: np.full_like(time, GRAVITY),
        }
    if topic == ODOMETRY:
        own["yaw_rate"] = readings["odometry_yaw_rate"]
    return own


def vehicle_file(truck: Planar) -> str:
    """What an engineer would know of a truck."""
    body = truck.body
    x, y, z = truck.imu_position
    return (
        f"mass: {body.mass:g} kg\n"
        f"cg_to_front_axle: {body.cg_to_front_axle:g} m\n"
        f"cg_to_rear_axle: {body.cg_to_rear_axle:g} m\n"
        f"track: {body.track:g} m\n"
        f"cg_height: {body.cg_height:g} m\n"
        f"steering_ratio: {truck.steering_ratio:g}\n"
        "reference_point: rear_axle\n"
        f"imu_position: [{x:g} m, {y:g} m, {z:g} m]\n"
    )


def _seed(name: str, seed: int) -> int:
    """A seed of its own for each set."""
    return crc32(f"{name} {seed}".encode())
