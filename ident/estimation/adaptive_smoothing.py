"""An input smoothed over as long a time as it allows, where the model before it has corners.

The output of a play holds the largest input so far, noise and all, for as long as the truck drives straight:
little noise there is worth more than a motion that is followed to the last hertz. At each sample local
polynomials (Savitzky and Golay 1964) over longer and longer spans are compared. Their errors by noise are
known, and the longest is taken whose estimate still agrees with all shorter ones (intersection of confidence
intervals, Goldenshluger and Nemirovski 1997; Katkovnik 1999): long where the wheel is held, short where it
turns.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.estimation.input_noise import Smoothing
from ident.estimation.own_noise import OwnNoise
from ident.estimation.vehicle_records import COLUMNS, Windows

Array = NDArray[np.float64]

SPANS, ORDER = (0.5, 0.8, 1.2, 2.0, 3.0), 5  # [s]
AGREE = 1.25  # standard deviations on either side, within which two estimates agree
ANGLES = ("road_wheel_angle",)
REMEMBERED = 4.0  # [s] after which an autoregression has forgotten an innovation


@dataclass(frozen=True)
class AdaptiveSpans:
    """Over how long each sample of an input is smoothed.

    column : of the inputs; chosen : of each stretch, (k,) how many of the spans are agreed on
    """

    column: int
    chosen: Sequence[NDArray[np.intp]]

    def of(self, windows: Windows, values: Array) -> Array:
        """(N, ...) values of the column, smoothed already as the input is, smoothed on over these spans."""
        made = values.copy()
        for stretch, chosen in zip(windows.stretches, self.chosen, strict=True):
            whole, period = stretch.whole(values), float(windows.steps[stretch.rows[0]])
            smooth = whole.copy()
            for number, span in enumerate(SPANS[: int(chosen.max(initial=0))]):
                here = chosen == number + 1
                smooth[here] = Smoothing(span, ORDER).of(whole, period)[here]
            made[stretch.rows] = smooth[stretch.place]
        return made


def with_adaptively_smoothed(windows: Windows, noises: Sequence[OwnNoise]) -> Windows:
    """The same windows with such inputs; what belongs to their records carries over."""
    made = copy.copy(windows)
    made.inputs, made.adaptive = windows.inputs.copy(), {}
    for noise in (one for one in noises if one.name in ANGLES):
        spans = adaptive_spans(windows, noise)
        made.adaptive[noise.name] = spans
        made.inputs[:, spans.column] = spans.of(windows, windows.inputs[:, spans.column])
    return made


def adaptive_spans(windows: Windows, noise: OwnNoise) -> AdaptiveSpans:
    """The spans for an input with this noise, smoothed already as that says."""
    column, chosen = COLUMNS.index(noise.name), []
    for stretch in windows.stretches:
        whole, period = stretch.whole(windows.inputs[:, column]), float(windows.steps[stretch.rows[0]])
        chosen.append(_chosen(whole, noise, period))
    return AdaptiveSpans(column, chosen)


def _chosen(values: Array, noise: OwnNoise, period: float) -> NDArray[np.intp]:
    """(n,) how many of the spans agree at each sample of one stretch."""
    answer = _answer(noise, period)
    reach = AGREE * float(np.linalg.norm(answer))
    low, high = values - reach, values + reach
    made, alive = np.zeros(values.size, dtype=np.intp), np.ones(values.size, dtype=bool)
    for span in SPANS:
        smoothing = Smoothing(span, ORDER)
        weights = smoothing.weights(period)
        if values.size < weights.size:
            break
        estimate = smoothing.of(values, period)
        reach = AGREE * float(np.linalg.norm(np.convolve(answer, weights)))
        low, high = np.maximum(low, estimate - reach), np.minimum(high, estimate + reach)
        alive &= low <= high
        made[alive] += 1
    return made


def _answer(noise: OwnNoise, period: float) -> Array:
    """(k,) of smoothed noise to one innovation; its norm is the standard deviation of the noise."""
    impulse = np.zeros(round(REMEMBERED / period))
    impulse[0] = noise.std
    own = lfilter([1.0], [1.0, *-noise.shape.coefficients], impulse)
    return np.convolve(own, noise.smoothing.weights(period))
