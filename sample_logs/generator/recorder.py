"""What one recording holds: every topic stamped, measured, delayed and, where the log loses it, left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .messages import Topic
from .sensors import Stamps, arrivals, errors, generator, quantise, schedule, seconds
from .truth import Recording, Sensor

Array = NDArray[np.float64]
Signal = Callable[[Array], Array]


@dataclass(frozen=True)
class Losses:
    """What the log lacks of what happened.

    gap : (from, to) in which nothing is recorded [s]
    messages : (topic, time [s]): the first message of the topic at or after that time is lost
    """

    gap: tuple[float, float] | None = None
    messages: tuple[tuple[str, float], ...] = ()

    def kept(self, topic: str, stamps: Stamps) -> NDArray[np.bool_]:
        """Which messages of a topic the log keeps; what is stamped before time zero is before the log."""
        time = seconds(stamps)
        keep = time >= 0.0
        if self.gap:
            keep &= (time < self.gap[0]) | (time >= self.gap[1])
        for name, lost_at in self.messages:
            if name == topic:
                keep[np.searchsorted(time, lost_at)] = False
        return keep


@dataclass(frozen=True)
class Plan:
    """When a sensor measures and what it will add to the true values, known before anything moves.

    stamps, arrivals : (n,) [ns since the start of the recording]
    errors : (n,) for each channel
    """

    stamps: Stamps
    arrivals: Stamps
    errors: dict[str, Array]


@dataclass(frozen=True)
class Recorder:
    """One recording.

    name : of the run; with the seed it gives every topic its own random numbers
    duration : of the recording [s]
    """

    recording: Recording
    seed: int
    name: str
    duration: float
    losses: Losses = field(default_factory=Losses)

    def plan(self, topic: str, sensor: Sensor) -> Plan:
        """What a sensor will do in this recording, whatever it measures: the same at every call."""
        random = generator(self.seed, self.name, topic)
        stamps = schedule(sensor, 0.0, self.duration, random)
        added = {name: errors(channel, len(stamps), random) for name, channel in sensor.channels.items()}
        return Plan(stamps, self.arrivals(topic, stamps), added)

    def arrivals(self, topic: str, stamps: Stamps) -> Stamps:
        """When the messages of a topic reach the log, and whoever listens [ns]."""
        return arrivals(stamps, self.recording, generator(self.seed, self.name, topic, "latency"))

    def sensed(self, topic: str, kind: str, sensor: Sensor, signals: Mapping[str, Signal]) -> Topic:
        """Record a sensor: ``signals`` gives the true values of each channel at any times."""
        plan = self.plan(topic, sensor)
        time = seconds(plan.stamps)
        columns = [
            quantise(channel, signals[name](time) + plan.errors[name])
            for name, channel in sensor.channels.items()
        ]
        return self.logged(topic, kind, plan.stamps, *columns)

    def logged(self, topic: str, kind: str, stamps: Stamps, *columns: NDArray[np.generic]) -> Topic:
        """Record messages that were sent: those that the log keeps, with the time each reached it."""
        kept = self.losses.kept(topic, stamps)
        late = self.arrivals(topic, stamps)
        return Topic(topic, kind, stamps[kept], late[kept], tuple(column[kept] for column in columns))
