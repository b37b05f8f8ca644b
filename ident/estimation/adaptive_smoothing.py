"""An input smoothed over as long a time as it allows, where the model before it has corners.

The output of a play holds the largest input so far, noise and all, for as long as the truck drives straight:
little noise there is worth more than a motion that is followed to the last hertz. At each sample local
polynomials (Savitzky and Golay 1964) over longer and longer spans are compared. Their errors by noise are
known, and the longest is taken whose estimate still agrees with all shorter ones (intersection of confidence
intervals, Goldenshluger and Nemirovski 1997; Katkovnik 1999): long where the wheel is held, short where it
turns. Where a wheel stops within a few hundredths of a second, even the shortest span swings beyond by some
tenths of a milliradian, which a play would hold: what contradicts the sample itself is not taken.
Where the wheel rests, means over the rest replace what reaches beyond it (:mod:`ident.estimation.rests`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.estimation.input_noise import Smoothing
from ident.estimation.own_noise import OwnNoise
from ident.estimation.rests import take_rests
from ident.estimation.vehicle_records import COLUMNS, Windows

Array = NDArray[np.float64]
Index = NDArray[np.intp]

SPANS, ORDER = (0.3, 0.5, 0.8, 1.2, 2.0, 3.0), 5  # [s]
AGREE = 1.25  # standard deviations on either side, within which two estimates agree
CONTRADICTS = 4.5  # of a sample: that chance hardly ever holds one that a play would hold, too
ANGLES = ("road_wheel_angle",)
REMEMBERED = 4.0  # [s] after which an autoregression has forgotten an innovation


def adaptively_smoothed(windows: Windows, inputs: Array, noises: Sequence[OwnNoise]) -> Array:
    """Smooth the angle among inputs of windows.

    Parameters
    ----------
    inputs : (N, 2), or (N, 2, c) of as many draws
    noises : of these inputs as they are given
    """
    made = inputs.copy()
    for noise in (one for one in noises if one.name in ANGLES):
        column = COLUMNS.index(noise.name)
        for stretch in windows.stretches:
            whole, period = stretch.whole(inputs[:, column]), float(windows.steps[stretch.rows[0]])
            smooth = smoothed_stretch(whole.reshape(len(whole), -1), noise, period)[stretch.place]
            made[stretch.rows, column] = smooth.reshape(made[stretch.rows, column].shape)
    return made


def smoothed_stretch(values: Array, noise: OwnNoise, period: float) -> Array:
    """(n, c) one stretch, over the longest span that agrees at each sample; ``period`` of its grid [s]."""
    answer = _answer(noise, period)
    reach = CONTRADICTS * float(np.linalg.norm(answer))
    low, high = values - reach, values + reach
    made, alive, reached = values.copy(), np.ones(values.shape, dtype=bool), np.zeros(values.shape, np.intp)
    for span in SPANS:
        smoothing = Smoothing(span, ORDER)
        weights = smoothing.weights(period)
        if len(values) < weights.size:
            break
        estimate = smoothing.of(values, period)
        reach = AGREE * float(np.linalg.norm(np.convolve(answer, weights)))
        low, high = np.maximum(low, estimate - reach), np.minimum(high, estimate + reach)
        alive &= low <= high
        made[alive], reached[alive] = estimate[alive], weights.size // 2
    take_rests(values, made, reached, answer, period)
    return made


def _answer(noise: OwnNoise, period: float) -> Array:
    """(k,) of smoothed noise to one innovation; its norm is the standard deviation of the noise."""
    impulse = np.zeros(round(REMEMBERED / period))
    impulse[0] = noise.std
    own = lfilter([1.0], [1.0, *-noise.shape.coefficients], impulse)
    return np.convolve(own, noise.smoothing.weights(period))
