"""A fit of the motion as it is reported: its covariance, and free of what noise of the inputs does to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ident.estimation.motion_scores import Projection
from ident.estimation.noisy_inputs import Disturbance, OwnNoise, disturbance, shift_by_noise
from ident.estimation.vehicle_covariance import widened
from ident.estimation.vehicle_fit import VehicleFit, block_sums, fit_at, identify_noise, least_squares
from ident.estimation.vehicle_point import VehiclePoint

Array = NDArray[np.float64]


def reported_fit(
    point: VehiclePoint, floor: Mapping[str, float], noises: Sequence[OwnNoise] = ()
) -> VehicleFit:
    """The fit at a point that is its maximum likelihood already, with its covariance.

    Least squares goes on from there where something is left that neither noise of the signals nor of the
    inputs explains.

    floor : compared signal -> least standard deviation of its noise
    noises : of the inputs
    """
    fit = _of_likelihood(point, floor, noises)
    fit = least_squares(fit, floor) if fit.is_coloured else fit
    shift = shift_by_noise(fit.point, fit.information, noises)
    return replace(fit, point=fit.point.wholly_moved(-shift)) if shift.any() else fit


def _of_likelihood(point: VehiclePoint, floor: Mapping[str, float], noises: Sequence[OwnNoise]) -> VehicleFit:
    _, capped = identify_noise(point, floor, keep_order=True)
    fit = fit_at(point, capped, converged=True)
    if not noises:
        return fit
    known = disturbance(Projection(point), noises)
    coloured = {name: _slow_colour(point, name, known) for name in point.residuals}
    covariance = widened(point, fit.information, known.scatter)
    return replace(fit, coloured=coloured, capped=frozenset(), covariance=covariance)


def _slow_colour(point: VehiclePoint, name: str, known: Disturbance) -> float:
    """p-value of the sums of a whitened residual over blocks of time, were it white but for that noise.

    Their sum of squares as a scaled χ² of the mean and the variance that the draws give it (Satterthwaite
    1946, doi:10.2307/3002019).
    """
    samples = point.residuals[name].samples
    sums = block_sums(point.white[name][:, -1:], samples)
    if not sums.size:
        return 1.0
    drawn = np.square(block_sums(known.rows[name], samples)).sum(axis=0)
    mean = sums.size + float(drawn.mean())
    variance = 2 * sums.size + 4 * float(drawn.mean()) + float(drawn.var(ddof=1))
    freedom = 2 * mean**2 / variance
    return float(chi2.sf(float(np.sum(sums**2)) * freedom / mean, freedom))
