"""A fit of the motion as it is reported: its covariance, with what noise of the inputs does to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ident.estimation.noisy_inputs import Disturbance, disturbance
from ident.estimation.own_noise import OwnNoise
from ident.estimation.signal_noise import identify_noise
from ident.estimation.vehicle_covariance import widened
from ident.estimation.vehicle_fit import VehicleFit, block_sums, fit_at, least_squares
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
    _, capped = identify_noise(point, floor, keep_order=True)
    fit = fit_at(point, capped, converged=True)
    if not noises:
        return least_squares(fit, floor) if fit.is_coloured else fit
    known = disturbance(point, noises)
    fit = _with_known(fit, known)
    if fit.is_coloured:
        fit = least_squares(fit, floor)
        known = disturbance(fit.point, noises)
        fit = replace(fit, by_inputs=known.scores)
    return _with_shift(fit, known)


def _with_known(fit: VehicleFit, known: Disturbance) -> VehicleFit:
    """The fit with a noise of the inputs in its covariance and in the test of what is left."""
    coloured = {name: _slow_colour(fit.point, name, known) for name in fit.point.residuals}
    covariance = widened(fit.point, fit.information, known.scores)
    fit = replace(fit, coloured=coloured, capped=frozenset(), covariance=covariance)
    return replace(fit, by_inputs=known.scores)


def _with_shift(fit: VehicleFit, known: Disturbance) -> VehicleFit:
    """The fit with what noise of the inputs may have moved in it counted as an error."""
    shift = np.linalg.solve(fit.information, known.scores.mean.sum(axis=0))
    return replace(fit, covariance=fit.covariance + np.outer(shift, shift))


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
