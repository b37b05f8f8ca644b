"""When messages are stamped, when they reach the log, and how wrong their values are.

Times are whole nanoseconds since the start of the recording, as in the log itself, so that what the
log says and what happened are the same number. A stamp is the true time of the measurement.
"""

from __future__ import annotations

from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from .truth import Channel, Recording, Sensor

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

NANOSECONDS = 1_000_000_000
SETTLING = 2000  # samples before a coloured noise is stationary
LARGEST_JITTER = 0.4  # of a period, so that stamps stay in order


def generator(seed: int, *names: str) -> np.random.Generator:
    """A stream of random numbers of its own for each run and each topic."""
    return np.random.default_rng([seed, *(crc32(name.encode()) for name in names)])


def schedule(sensor: Sensor, start: float, end: float, random: np.random.Generator) -> Stamps:
    """Stamps of a sensor from start to end [s], with a phase and a jitter of its own [ns]."""
    period = 1.0 / sensor.rate
    nominal = np.arange(start + random.uniform(0.0, period), end, period)
    jitter = np.clip(
        random.normal(0.0, 1.0, len(nominal)) * sensor.jitter / period, -LARGEST_JITTER, LARGEST_JITTER
    )
    return np.round((nominal + jitter * period) * NANOSECONDS).astype(np.int64)


def seconds(stamps: Stamps) -> Array:
    """Stamps [ns] as times [s]."""
    return stamps / NANOSECONDS


def arrivals(stamps: Stamps, recording: Recording, random: np.random.Generator) -> Stamps:
    """When the messages of one topic reach the log [ns]: late, some very late, in order."""
    count = len(stamps)
    waits = recording.latency_shortest + random.exponential(recording.latency_excess, count)
    waits += (random.random(count) < recording.tail_share) * random.exponential(recording.tail_excess, count)
    queue = np.arange(count) * round(recording.spacing * NANOSECONDS)
    arrived = stamps + np.round(waits * NANOSECONDS).astype(np.int64)
    return np.maximum.accumulate(arrived - queue) + queue


def measure(channel: Channel, true: Array, random: np.random.Generator) -> Array:
    """What a sensor says of the true values: bias, white and coloured noise, then quantisation."""
    return quantise(channel, true + errors(channel, len(true), random))


def errors(channel: Channel, count: int, random: np.random.Generator) -> Array:
    """What a sensor adds to the true values before it quantises."""
    white = channel.white_std * random.standard_normal(count)
    return channel.bias + white + coloured_noise(channel, count, random)


def quantise(channel: Channel, value: Array) -> Array:
    """Round to the resolution of the sensor."""
    return np.round(value / channel.resolution) * channel.resolution if channel.resolution else value


def coloured_noise(channel: Channel, count: int, random: np.random.Generator) -> Array:
    """Stationary AR noise of standard deviation ``channel.noise_std``."""
    innovations = random.standard_normal(SETTLING + count)
    denominator = np.concatenate([[1.0], -np.asarray(channel.noise_ar, dtype=np.float64)])
    impulse = np.zeros(SETTLING)
    impulse[0] = 1.0
    gain = np.sqrt(np.sum(lfilter([1.0], denominator, impulse) ** 2))
    return channel.noise_std / gain * lfilter([1.0], denominator, innovations)[SETTLING:]
