"""What noise of the inputs does to an estimate: it scatters it, and may shift it.

It scatters it: noise is drawn and driven through the model, and the scores that the draws make have the
covariance that the scores of the data have more than white residuals would give them. A smooth model is
followed to first order.

It shifts it, too, where something before the model has corners. The output of a play follows the largest
input so far, and holds what was largest for as long as the truck drives straight; noise makes that larger,
and a play comes out too wide. Both, how much and how differently each time, is seen by simulation: the
inputs as smoothed are taken for the true ones, noise is drawn, added in pairs of opposite signs so that all
that is linear cancels in the mean, and smoothed likewise; what changes in the outputs is what the fit took
for a change of its parameters (parametric bootstrap, Efron and Tibshirani 1993, chapter 10). The inputs that
are taken for the true ones still hold a part of their noise, so that the shift comes out too small, and may
have the wrong sign where it is small. It is not taken back: its square counts in the covariance.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ident.estimation.adaptive_smoothing import adaptively_smoothed
from ident.estimation.motion_scores import Projection
from ident.estimation.own_noise import OwnNoise
from ident.estimation.vehicle_covariance import InputScores
from ident.estimation.vehicle_inputs import Probe
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_records import COLUMNS

Array = NDArray[np.float64]

DRAWS, SEED = 48, 2


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
    projection = Projection(point)
    if point.problem.around.has_corners:
        white = _changes(point, noises)
        scores = projection.shared_scores(white)
        mean = scores.mean(axis=2, keepdims=True)
    else:
        white = _linear_changes(projection, noises)
        scores = projection.shared_scores(white)
        mean = np.zeros((*scores.shape[:2], 1))
    scatter = np.einsum("rsk,rtk->rst", scores - mean, scores - mean) / DRAWS
    rows = projection.by_signal(projection.freed(white))
    return Disturbance(InputScores(mean[:, :, 0], scatter), rows)


def _linear_changes(projection: Projection, noises: Sequence[OwnNoise]) -> dict[str, Array]:
    """(n, DRAWS) to first order of each whitened output."""
    drawn = {one.name: one.drawn(projection.point.problem.windows, DRAWS, SEED) for one in noises}
    probes = [Probe(inputs={name: values[:, k] for name, values in drawn.items()}) for k in range(DRAWS)]
    return projection.whitened(probes)


def _changes(point: VehiclePoint, noises: Sequence[OwnNoise]) -> dict[str, Array]:
    """(n, DRAWS) changes of each whitened output by draws and their opposites, smoothed as the inputs are."""
    windows, half = point.problem.windows, DRAWS // 2
    drawn = np.zeros((*windows.inputs.shape, half))
    for one in noises:
        drawn[:, COLUMNS.index(one.name)] = one.drawn(windows, half, SEED)
    noisy = windows.inputs[:, :, None] + np.concatenate([drawn, -drawn], axis=2)
    smooth = np.moveaxis(adaptively_smoothed(windows, noisy, noises), 2, 0)
    before = modelled(point, windows.inputs)
    after = [modelled(point, np.ascontiguousarray(inputs)) for inputs in smooth]
    return {name: np.column_stack([one[name] - of for one in after]) for name, of in before.items()}


def modelled(point: VehiclePoint, inputs: Array) -> dict[str, Array]:
    """(n,) whitened output of every compared signal, but for a constant, under other inputs (N, 2)."""
    windows, problem = copy.copy(point.problem.windows), copy.copy(point.problem)
    windows.inputs = inputs
    problem.windows = windows
    return {name: -white for name, white in replace(point, problem=problem).white_errors.items()}
