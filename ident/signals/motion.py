"""Signals of a run and their derivatives side by side, for comparing one with another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.signals.alignment import interpolate, longest_bridge, low_pass
from ident.signals.derivative import slope
from ident.signals.signal import Signal

Array = NDArray[np.float64]

HIGHEST_RATE = 25.0
MAX_GAP = 0.3
MIN_SAMPLES = 10


@dataclass(frozen=True)
class Motion:
    """The signals of a run that may be compared."""

    signals: Mapping[str, Signal]

    def has(self, *names: str) -> bool:
        """Whether all of these are there, with enough samples to be compared."""
        return all(name in self.signals and len(self.signals[name].time) > MIN_SAMPLES for name in names)

    def grid(self, *names: str) -> tuple[Array, float]:
        """Instants [s] common to these signals, at the rate [1/s] of the slowest, 25 at the most."""
        used = [self.signals[name] for name in names]
        rates = [1 / float(np.median(np.diff(signal.time))) for signal in used]
        rate = min(HIGHEST_RATE, *rates)
        first = max(signal.time[0] for signal in used)
        last = min(signal.time[-1] for signal in used)
        return np.arange(first, max(last, first), 1 / rate), rate

    def at(self, name: str, grid: Array, rate: float) -> Array:
        """A signal at the instants of a grid, NaN in its gaps."""
        signal = self.signals[name]
        return _sampled(signal.time, signal.values, grid, rate, longest_bridge(signal, MAX_GAP))

    def derivative(self, name: str, grid: Array, rate: float) -> Array:
        """The derivative of a signal at the instants of a grid, NaN in its gaps."""
        signal = self.signals[name]
        time, values = slope(signal.time, signal.values)
        return _sampled(time, values, grid, rate, longest_bridge(signal, MAX_GAP))


def _sampled(time: Array, values: Array, grid: Array, rate: float, limit: float) -> Array:
    return interpolate(time, low_pass(time, values, rate, limit), grid, limit)
