"""The noise of the compared signals under a fit: an autoregression, its correlation time held short."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ident.estimation.elimination import eliminate, triangle_of
from ident.estimation.noise import AutoRegression, Linearised, NoiseModel
from ident.estimation.noise_fit import fit_autoregression
from ident.estimation.vehicle_point import VehiclePoint

LONGEST_NOISE = 0.25  # [s] correlation time of a sensor's noise
AT_CAP = 0.99  # of it
TINY = 1e-300
QUIET = 1e-9  # least size of a noise over the size of its signal


def identify_noise(
    point: VehiclePoint, floor: Mapping[str, float], *, keep_order: bool
) -> tuple[dict[str, NoiseModel], frozenset[str]]:
    """Noise of each compared signal, and the signals for which the cap of the correlation time held."""
    made, capped = {}, set()
    for name, one in point.residuals.items():
        parts = point.linearised(name)
        like = point.noise[name].shape if keep_order else None
        shape = fit_autoregression(parts, like)
        if shape.lasts(one.samples.period) > LONGEST_NOISE:
            shape = shortened(shape, one.samples.period)
            capped.add(name)
        least = max(floor.get(name, 0.0), QUIET * float(np.abs(one.samples.values).max()), TINY)
        std = max(innovation_std(parts, shape), least / shape.total_over_innovations())
        made[name] = NoiseModel(shape, std)
    return made, frozenset(capped)


def capped_noise(point: VehiclePoint) -> list[str]:
    """Signals whose noise is as slow as :func:`identify_noise` lets it be."""
    return [
        name
        for name, one in point.noise.items()
        if one.shape.lasts(point.residuals[name].samples.period) > AT_CAP * LONGEST_NOISE
    ]


def noise_of_residuals(point: VehiclePoint, floor: Mapping[str, float]) -> dict[str, NoiseModel]:
    """What is left of each compared signal as an autoregression of whatever colour.

    Of a fit with something left that is no noise, the innovations still are that of the sensor: what the
    model lacks changes little from sample to sample, and stands in the slow poles.
    """
    made = {}
    for name in point.residuals:
        parts = point.linearised(name)
        shape = fit_autoregression(parts)
        std = max(innovation_std(parts, shape), floor.get(name, 0.0) / shape.total_over_innovations(), TINY)
        made[name] = NoiseModel(shape, std)
    return made


def shortened(shape: AutoRegression, period: float) -> AutoRegression:
    """Draw the poles in until the slowest decays in LONGEST_NOISE."""
    factor = np.exp(-period / LONGEST_NOISE) / shape.largest_pole()
    return AutoRegression(shape.coefficients * factor ** np.arange(1, shape.coefficients.size + 1))


def innovation_std(parts: Sequence[Linearised], shape: AutoRegression) -> float:
    """Standard deviation of the innovations, of what no fitted column of this signal can reach."""
    left = [eliminate(shape.whiten(part.columns(), part), part.local.shape[1]) for part in parts]
    rows = np.vstack([one.rows for one in left])
    rest = eliminate(triangle_of(rows), rows.shape[1] - 1)
    freedom = len(rows) - sum(one.rank for one in left) - rest.rank
    return float(np.sqrt(np.sum(rest.rows[:, -1] ** 2) / max(1, freedom)))
