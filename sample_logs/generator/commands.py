"""Requests of the steering tests, as functions of time: rectangular pulses and sines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Command = Callable[[Array], Array]

PULSE_ON = 5.0  # [s]
PULSE_OFF = 2.0  # [s]


def pulses(start: float, amplitudes: Sequence[float]) -> Command:
    """Rectangular pulses, on for 5 s and off for 2 s, the first from ``start`` [s]; amplitudes [rad]."""
    levels = np.asarray(amplitudes, dtype=np.float64)

    def command(time: Array) -> Array:
        phase = (time - start) / (PULSE_ON + PULSE_OFF)
        index = np.floor(phase).astype(int)
        inside = (index >= 0) & (index < len(levels))
        on = inside & ((phase - index) * (PULSE_ON + PULSE_OFF) < PULSE_ON)
        return np.where(on, levels[np.clip(index, 0, len(levels) - 1)], 0.0)

    return command


def pulses_end(start: float, amplitudes: Sequence[float]) -> float:
    """When the last pause is over [s]."""
    return start + len(amplitudes) * (PULSE_ON + PULSE_OFF)


@dataclass(frozen=True)
class Sine:
    """A stretch of a sine: frequency [rad/s], amplitude [rad], cycles [-]."""

    frequency: float
    amplitude: float
    cycles: float

    @property
    def duration(self) -> float:
        """How long it lasts [s]."""
        return 2.0 * np.pi * self.cycles / self.frequency


def sines(start: float, segments: Sequence[Sine], pause: float) -> Command:
    """Sines one after the other from ``start`` [s], each from zero, with a pause [s] after each."""
    starts = start + np.cumsum([0.0, *(segment.duration + pause for segment in segments)])

    def command(time: Array) -> Array:
        value = np.zeros_like(time)
        for begin, segment in zip(starts, segments, strict=False):
            inside = (time >= begin) & (time < begin + segment.duration)
            wave = segment.amplitude * np.sin(segment.frequency * (time - begin))
            value = np.where(inside, wave, value)
        return value

    return command


def sines_end(start: float, segments: Sequence[Sine], pause: float) -> float:
    """When the last pause is over [s]."""
    return start + sum(segment.duration + pause for segment in segments)
