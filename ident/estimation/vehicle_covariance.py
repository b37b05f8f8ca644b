"""Covariance of the shared parameters of a vehicle fit, from the scores as they scatter over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.estimation.elimination import eliminate
from ident.estimation.vehicle_point import VehiclePoint

Array = NDArray[np.float64]

BIN = 0.1  # [s] of the scores
LONGEST_LAG = 3.0  # [s] of the scores' correlation
LEAST = 1e-14  # of the largest information: rounding
TOLD = 0.99  # of the information on a direction: it comes from the data


@dataclass(frozen=True)
class InputScores:
    """What noise of the inputs adds to the scores of the shared parameters in each run.

    mean : (runs, s); scatter : (runs, s, s) covariance
    """

    mean: Array
    scatter: Array


def sandwich(point: VehiclePoint, information: Array) -> Array:
    """Covariance from the scores as they are; the prior counts as it is."""
    bread = np.linalg.inv(information)
    prior = np.diag(1 / point.problem.prior_std**2)
    return np.asarray(bread @ (scatter(point) + prior) @ bread)


def widened(point: VehiclePoint, information: Array, known: InputScores | None = None) -> Array:
    """Covariance of the bound, wider where the scores scatter more than the noise of the signals makes them.

    The noise of steering and speed, which are inputs, reaches all signals at once and is in no noise model.
    What is not known of it counts by one factor for all directions, because what the data hold on each alone
    is little.

    known : of the noise of the inputs, where it is
    """
    prior = np.diag(1 / point.problem.prior_std**2)
    basis = told_directions(information - prior, information)
    expected = information - prior
    expected = expected if known is None else expected + known.scatter.sum(axis=0)
    bread = np.linalg.inv(information)
    factor = 1.0
    if basis.shape[1]:
        seen, mean = (float(np.trace(basis.T @ one @ basis)) for one in (scatter(point), expected))
        factor = max(1.0, seen / mean)
    return np.asarray(bread @ (factor * expected + prior) @ bread)


def scatter(point: VehiclePoint) -> Array:
    """(s, s) long-run covariance of the scores of the shared parameters, what is local eliminated."""
    scores = [_binned_scores(point, number) for number in range(len(point.problem.windows.records))]
    scores = _without_run_terms(point, scores)
    size = point.shared.size
    total = np.zeros((size, size))
    for of_run in scores:
        lags = min(round(LONGEST_LAG / BIN), len(of_run) // 2)
        total += of_run.T @ of_run
        for lag in range(1, lags + 1):
            product = of_run[lag:].T @ of_run[:-lag]
            total += (1 - lag / (lags + 1)) * (product + product.T)
    return total


def _binned_scores(point: VehiclePoint, number: int) -> Array:
    """(bins, b + s) scores of run terms and shared parameters in one window, its initial state eliminated."""
    record = point.problem.windows.records[number]
    bins = max(1, int(np.ceil((record.times[-1] - record.times[0]) / BIN)))
    rows, where = [], []
    for name, one in point.residuals.items():
        part = slice(int(one.samples.begins[number]), int(one.samples.begins[number + 1]))
        rows.append(point.white[name][part])
        where.append(((one.samples.times[part] - record.times[0]) / BIN).astype(np.intp))
    left = eliminate(np.vstack(rows), point.problem.local).rows
    binned = np.zeros((bins, left.shape[1] - 1))
    np.add.at(binned, np.clip(np.concatenate(where), 0, bins - 1), left[:, :-1] * left[:, -1:])
    return binned


def _without_run_terms(point: VehiclePoint, windows: Sequence[Array]) -> list[Array]:
    """(bins, s) scores of each run, freed of those of its own terms."""
    terms, made = len(point.problem.run_terms), []
    for run, eliminated in enumerate(point.by_run):
        own = np.vstack([w for w, of in zip(windows, point.problem.windows.run, strict=True) if of == run])
        to_terms = np.zeros((terms, point.shared.size))
        for column in range(point.shared.size):
            unit = np.zeros(point.shared.size)
            unit[column] = 1.0
            to_terms[:, column] = eliminated.step(unit) - eliminated.step(np.zeros_like(unit))
        made.append(own[:, terms:] + own[:, :terms] @ to_terms)
    return made


def told_directions(told: Array, information: Array) -> Array:
    """(s, k) directions of unit information, nearly all of which comes from the data."""
    sizes, axes = np.linalg.eigh(information)
    factor = axes.T / np.sqrt(np.maximum(sizes, LEAST * sizes.max(initial=1e-300)))[:, None]
    share, vectors = np.linalg.eigh(factor @ told @ factor.T)
    return np.asarray(factor.T @ vectors[:, share > TOLD])
