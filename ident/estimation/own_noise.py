"""Noise of the inputs of the model, its colour read off their calm parts.

Where a driver holds the wheel still, a polynomial follows the angle and the rest is the sensor's noise: its
autoregression by restricted likelihood (:mod:`ident.estimation.noise_fit`), the polynomials being the fitted
columns. Of that noise smoothing leaves a part, which moves the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.estimation.input_noise import INPUTS, NAMES, Smoothing
from ident.estimation.noise import AutoRegression, Linearised
from ident.estimation.noise_fit import fit_autoregression
from ident.estimation.signal_noise import LONGEST_NOISE, innovation_std, shortened
from ident.estimation.vehicle_records import MotionRecord, Windows

Array = NDArray[np.float64]

CALM = {"road_wheel_angle": Smoothing(0.6, 5), "speed": Smoothing(4.0, 3)}
"""Pieces that a polynomial follows: their span [s] and its order."""
CALMEST, FEWEST = 0.15, 20  # of all pieces, those in which the input moves least
AS_CALM = 2.0  # times their median range: others count, too, lest those are chosen in which noise is small
HIGHEST_ORDER = 10  # what is read more seldom than the grid asks for many coefficients
BEFORE = 5.0  # [s] of noise before that which is used, so that it is stationary


@dataclass(frozen=True)
class OwnNoise:
    """Noise of one input of the model, before it is smoothed; ``std`` : of its innovations.

    smoothing : that the input is given
    """

    name: str
    shape: AutoRegression
    std: float
    smoothing: Smoothing

    def drawn(self, windows: Windows, count: int, seed: int) -> Array:
        """(N, count) of what smoothing leaves, each stretch on its own, on the grid of all windows.

        What a stretch is given depends on the seed and on how it was driven, not on its number.
        """
        made, kind = np.zeros((windows.times.size, count)), crc32(self.name.encode())
        for stretch in windows.stretches:
            speed = float(np.mean(windows.inputs[stretch.rows, 1]))
            driven = (abs(round(stretch.times[0] * 1e3)), abs(round(speed * 1e4)))
            random = np.random.default_rng([seed, kind, *driven])
            period = float(windows.steps[stretch.rows[0]])
            before = round(BEFORE / period)
            noise = random.standard_normal((before + stretch.times.size, count))
            noise = lfilter([self.std], [1.0, *-self.shape.coefficients], noise, axis=0)[before:]
            made[stretch.rows] = self.smoothing.of(noise, period)[stretch.place]
        return made


def own_noise(records: Sequence[MotionRecord]) -> list[OwnNoise]:
    """Noise of the inputs of records as measured; none of an input that shows none in its calm parts."""
    made = []
    for name, piece in CALM.items():
        parts = _calm_parts(records, name, piece)
        if not parts:
            continue
        shape = fit_autoregression(parts, highest_order=HIGHEST_ORDER)
        period = records[0].period
        if shape.lasts(period) > LONGEST_NOISE:
            shape = shortened(shape, period)
        std = innovation_std(parts, shape)
        if std > 0.0:
            made.append(OwnNoise(NAMES[name], shape, std, INPUTS[name]))
    return made


def _calm_parts(records: Sequence[MotionRecord], name: str, piece: Smoothing) -> list[Linearised]:
    """Pieces of an input in which it moves least, each with a polynomial of its own."""
    found: list[tuple[float, Array, Array]] = []
    for record in records:
        values, count = getattr(record, name), round(piece.span / record.period)
        smooth = INPUTS[name].of(values, record.period)
        for begin in range(0, values.size - count + 1, max(count, 1)):
            own = slice(begin, begin + count)
            found.append((float(np.ptp(smooth[own])), record.times[own], values[own]))
    found = sorted((one for one in found if one[1].size > piece.order + 1), key=lambda one: one[0])
    first = found[: max(FEWEST, int(CALMEST * len(found)))]
    limit = AS_CALM * float(np.median([one[0] for one in first])) if first else 0.0
    calm = [one for number, one in enumerate(found) if number < len(first) or one[0] <= limit]
    return [_with_polynomial(times, values, piece.order) for _, times, values in calm]


def _with_polynomial(times: Array, values: Array, order: int) -> Linearised:
    local = np.asarray(
        np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, times.size), order), dtype=float
    )
    nothing, first = np.zeros((times.size, 0)), np.zeros(1, dtype=np.intp)
    return Linearised(times, values, nothing, local, first, np.full(order + 1, np.inf), np.zeros(order + 1))
