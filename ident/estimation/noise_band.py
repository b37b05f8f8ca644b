"""The noise of a sensor from the band just above what a truck does: 4 to 8 Hz.

A truck turns and sways below about 2 Hz, steering included, so that what a sensor reads in the band above is
noise or vibration, whatever the vehicle model. Its density there is taken as the one below as well: the noise
of a filter that works down there is the white noise of that density. (What is left of a fit is no such
measure: where the model lacks something, it holds that.) Noise that is itself slower than the band is missed:
where a fit leaves nothing but noise, what it found is the better measure.

The density is that of Welch's method (1967), the mean over the band, windows of ``WINDOW`` seconds with their
line taken out. Of sensors slower than 18 Hz the band is the upper half of what they can tell.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from scipy.signal import detrend, welch

from ident.estimation.noise import AutoRegression, NoiseModel
from ident.estimation.vehicle_records import GAP, MotionRecord, Samples

BAND = (4.0, 8.0)  # [Hz]
SHARES = (0.225, 0.45)  # of the sampling rate, which the band does not pass
WINDOW = 4.0  # [s]
FEWEST = 32  # samples


def noise_above_the_motion(records: Sequence[MotionRecord], names: Iterable[str]) -> dict[str, NoiseModel]:
    """White noise of each signal of which any record holds an uninterrupted stretch of ``FEWEST`` samples."""
    found = {}
    for name in names:
        parts = [part for one in records if name in one.measured for part in _even(one.measured[name])]
        if parts:
            variance = np.average([_variance(part) for part in parts], weights=[p.times.size for p in parts])
            found[name] = NoiseModel(AutoRegression(np.zeros(0)), float(np.sqrt(variance)))
    return found


def _even(samples: Samples) -> list[Samples]:
    """Stretches without a gap that are long enough."""
    if samples.times.size < FEWEST:
        return []
    steps = np.diff(samples.times)
    edges = [0, *(np.flatnonzero(steps > GAP * np.median(steps)) + 1).tolist(), samples.times.size]
    slices = [slice(first, last) for first, last in pairwise(edges)]
    return [
        Samples(samples.times[own], samples.values[own]) for own in slices if own.stop - own.start >= FEWEST
    ]


def _variance(samples: Samples) -> float:
    """Variance per sample of the white noise that has the density of the band."""
    rate = 1.0 / float(np.median(np.diff(samples.times)))
    window = min(samples.times.size, max(FEWEST, round(WINDOW * rate)))
    frequency, density = welch(samples.values, rate, nperseg=window, detrend=detrend)
    low, high = (min(end, share * rate) for end, share in zip(BAND, SHARES, strict=True))
    return float(np.mean(density[(frequency >= low) & (frequency <= high)]) * rate / 2)
