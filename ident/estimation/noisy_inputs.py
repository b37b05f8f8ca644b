"""Noise of the inputs, its colour read off their calm parts, and what it does to an estimate.

Where a driver holds the wheel still, a polynomial follows the angle and the rest is the sensor's noise: its
autoregression by restricted likelihood (:mod:`ident.estimation.noise_fit`), the polynomials being the fitted
columns. Of that noise smoothing leaves a part, which moves the model.

It scatters the estimate: noise is drawn and driven through the model, and the scores that the draws make have
the covariance that the scores of the data have more than white residuals would give them. A smooth model is
followed to first order.

It shifts the estimate, too, where something before the model has corners. The output of a play follows the
largest input so far, and holds what was largest for as long as the truck drives straight; noise makes that
larger, and a play comes out too wide. Both, how much and how differently each time, is seen by simulation:
inputs smoothed over so long that next to no noise is left in them are taken for the true ones, noise is drawn
and added, in pairs of opposite signs so that all that is linear cancels in the mean, and what changes in the
outputs is what the fit took for a change of its parameters (bias correction by a parametric bootstrap, Efron
and Tibshirani 1993, chapter 10).
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.estimation.input_noise import INPUTS, NAMES, Smoothing
from ident.estimation.motion_scores import Projection
from ident.estimation.noise import AutoRegression, Linearised
from ident.estimation.noise_fit import fit_autoregression
from ident.estimation.vehicle_covariance import InputScores
from ident.estimation.vehicle_fit import LONGEST_NOISE, innovation_std, shortened
from ident.estimation.vehicle_inputs import Probe
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_records import MotionRecord, Windows

Array = NDArray[np.float64]

CALM = {"road_wheel_angle": Smoothing(0.6, 5), "speed": Smoothing(4.0, 3)}
"""Pieces that a polynomial follows: their span [s] and its order."""
CALMEST, FEWEST = 0.15, 20  # of all pieces, those in which the input moves least
AS_CALM = 2.0  # times their median range: others count, too, lest those are chosen in which noise is small
HIGHEST_ORDER = 10  # what is read more seldom than the grid asks for many coefficients
DRAWS, SEED = 48, 2
CLEAN = Smoothing(1.5, 5)  # leaves a sixth of the noise's power; that it bends the motion is of second order
BEFORE = 5.0  # [s] of noise before that which is used, so that it is stationary


@dataclass(frozen=True)
class OwnNoise:
    """Noise of one input of the model, before it is smoothed; ``std`` : of its innovations."""

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
        if shape.correlation_samples() * period > LONGEST_NOISE:
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


@dataclass(frozen=True)
class Disturbance:
    """What drawn noise of the inputs does at a point.

    scores : what it adds to those of the shared coordinates
    rows : signal -> (n, DRAWS) of its whitened residual, freed of what the fit takes up
    """

    scores: InputScores
    rows: dict[str, Array]


def disturbance(point: VehiclePoint, noises: Sequence[OwnNoise]) -> Disturbance:
    """Drive draws of all noises together through the model at a point."""
    projection, windows = Projection(point), point.problem.windows
    if any(block.hysteresis for block in point.problem.around.blocks):
        white = _changes(point, {one.name: one.drawn(windows, DRAWS // 2, SEED) for one in noises})
        scores = projection.shared_scores(white)
        mean = scores.mean(axis=2, keepdims=True)
    else:
        white = _linear_changes(projection, {one.name: one.drawn(windows, DRAWS, SEED) for one in noises})
        scores = projection.shared_scores(white)
        mean = np.zeros((*scores.shape[:2], 1))
    scatter = np.einsum("rsk,rtk->rst", scores - mean, scores - mean) / DRAWS
    rows = projection.by_signal(projection.freed(white))
    return Disturbance(InputScores(mean[:, :, 0], scatter), rows)


def _linear_changes(projection: Projection, drawn: Mapping[str, Array]) -> dict[str, Array]:
    """(n, k) to first order of each whitened output, by noise (N, k) of the inputs."""
    count = next(iter(drawn.values())).shape[1]
    probes = [Probe(inputs={name: values[:, k] for name, values in drawn.items()}) for k in range(count)]
    return projection.whitened(probes)


def _changes(point: VehiclePoint, drawn: Mapping[str, Array]) -> dict[str, Array]:
    """(n, 2 k) changes of each whitened output, by noise (N, k) of clean inputs and its opposite."""
    inputs, names = _clean(point.problem.windows), point.problem.engine.inputs
    added = np.zeros((*inputs.shape, next(iter(drawn.values())).shape[1]))
    for name, values in drawn.items():
        added[:, names.index(name)] = values
    before = modelled(point, inputs)
    after = [modelled(point, inputs + sign * one) for sign in (1.0, -1.0) for one in np.moveaxis(added, 2, 0)]
    return {name: np.column_stack([one[name] - of for one in after]) for name, of in before.items()}


def _clean(windows: Windows) -> Array:
    """(N, 2) inputs of the windows, smoothed over each stretch so that next to no noise is left."""
    made = windows.inputs.copy()
    for stretch in windows.stretches:
        period = float(windows.steps[stretch.rows[0]])
        made[stretch.rows] = CLEAN.of(stretch.whole(made), period)[stretch.place]
    return made


def modelled(point: VehiclePoint, inputs: Array) -> dict[str, Array]:
    """(n,) whitened output of every compared signal, but for a constant, under other inputs (N, 2)."""
    windows, problem = copy.copy(point.problem.windows), copy.copy(point.problem)
    windows.inputs = inputs
    problem.windows = windows
    return {name: -white for name, white in replace(point, problem=problem).white_errors.items()}
