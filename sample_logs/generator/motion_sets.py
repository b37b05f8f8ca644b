"""Runs of a truck in memory: what each sensor of the motion says, beside what is true at the same stamps.

Fast enough for hundreds of sets. The same drive can be measured again with other noise, so that a study
changes nothing but the noise; and any run but one along a path, where the controller sees the noise, is had
without noise by giving its maker sensors that make no error (``noise_free``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .messages import Topic
from .motion import IMU, ODOMETRY, VELOCITY
from .runs import RUNS, Make
from .sensors import generator, measure, seconds
from .steering import ANGLE
from .truth import Channel, Sensor, Truth

Array = NDArray[np.float64]

# signal: topic, channel
SOURCES = {
    "steering_wheel_angle": (ANGLE, "angle"),
    "speed": (VELOCITY, "speed"),
    "yaw_rate": (IMU, "yaw_rate"),
    "longitudinal_acceleration": (IMU, "longitudinal_acceleration"),
    "lateral_acceleration": (IMU, "lateral_acceleration"),
    "position_x": (ODOMETRY, "x"),
    "position_y": (ODOMETRY, "y"),
    "heading": (ODOMETRY, "heading"),
    "longitudinal_velocity": (ODOMETRY, "longitudinal_velocity"),
    "lateral_velocity": (ODOMETRY, "lateral_velocity"),
}


@dataclass(frozen=True)
class Samples:
    """One signal: times since the start of the run (n,) [s], values (n,) in SI units."""

    time: Array
    values: Array


MotionSet = dict[str, Samples]


def sensors_of(truth: Truth) -> dict[str, Sensor]:
    """Return the sensor behind each topic."""
    return {
        ANGLE: truth.steering.angle,
        VELOCITY: truth.velocity,
        IMU: truth.imu,
        ODOMETRY: truth.odometry,
    }


def channel_of(truth: Truth, signal: str) -> Channel:
    """Return the errors that the sensor of a signal makes."""
    topic, channel = SOURCES[signal]
    return sensors_of(truth)[topic].channels[channel]


def noise_free(truth: Truth) -> Truth:
    """Return the same truck and the same stamps, with sensors that make no error."""

    def perfect(sensor: Sensor) -> Sensor:
        return replace(sensor, channels={name: Channel() for name in sensor.channels})

    return replace(
        truth,
        steering=replace(truth.steering, angle=perfect(truth.steering.angle)),
        velocity=perfect(truth.velocity),
        imu=perfect(truth.imu),
        odometry=perfect(truth.odometry),
    )


def motion_set(run: str | Make, truth: Truth, seed: int, name: str | None = None) -> MotionSet:
    """Make one run in memory.

    Parameters
    ----------
    run : name of one of ``RUNS``, or how to make another
    truth : what the simulated truck is given
    seed : of the drive, the stamps and the noise, the same as in the sample logs
    name : that gives another run its random numbers

    Returns
    -------
    what the log would hold of each signal of ``SOURCES``; headings are not wrapped
    """
    make = RUNS[run].make if isinstance(run, str) else run
    label = run if isinstance(run, str) else str(name)
    topics = {topic.name: topic for topic in make(truth, seed, label)}
    return {signal: _samples(topics, truth, signal) for signal in SOURCES}


def _samples(topics: Mapping[str, Topic], truth: Truth, signal: str) -> Samples:
    name, channel = SOURCES[signal]
    column = list(sensors_of(truth)[name].channels).index(channel)
    return Samples(seconds(topics[name].stamps), topics[name].columns[column])


def measured_again(true: MotionSet, truth: Truth, seed: int, name: str) -> MotionSet:
    """Measure a noise-free set with the errors of the sensors: for each seed and name other noise."""
    return {
        signal: Samples(
            samples.time,
            measure(channel_of(truth, signal), samples.values, generator(seed, name, signal)),
        )
        for signal, samples in true.items()
    }
