"""Scores of what the actuator may lack, gathered in bins, and likelihoods in the same bins.

A direction is whitened by the noise of the fit and freed of all that the fitted parameters could take up:
first of the local parameters of its record, then of the shared ones. Prior terms of local parameters are rows
too; they count in the first bin of their record.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ident.estimation.actuator_directions import Direction
from ident.estimation.actuator_effects import EffectsProblem
from ident.estimation.actuator_likelihood import ActuatorRecord
from ident.estimation.elimination import Eliminated, eliminate, with_priors
from ident.estimation.layer import BIN, Group, LayerScores, Likelihood, Shape
from ident.estimation.noise import Linearised, NoiseModel

Array = NDArray[np.float64]
Index = NDArray[np.intp]

TAKEN_UP = 1e-6  # of the squared length of a direction: less than that left is none
ACTIVITIES = ("request_rate", "request_deviation", "request_size")


class Bins:
    """Bins of about ``BIN`` seconds within each record.

    run, time : (b,) index of the run, middle [s since the start of the run]
    of : one (n,) array a record, the bin of each sample
    """

    def __init__(self, records: Sequence[ActuatorRecord]) -> None:
        self.of: list[Index] = []
        runs: list[Index] = []
        middles: list[Array] = []
        first = 0
        for record in records:
            begin, duration = record.times[0], record.times[-1] - record.times[0]
            count = max(1, round(float(duration) / BIN))
            width = max(float(duration) / count, 1e-9)
            place = np.minimum(((record.times - begin) / width).astype(np.intp), count - 1)
            self.of.append((first + place).astype(np.intp))
            runs.append(np.full(count, record.run, dtype=np.intp))
            middles.append(begin + width * (np.arange(count) + 0.5))
            first += count
        self.run = np.concatenate(runs)
        self.time = np.concatenate(middles)

    def summed(self, place: Index, values: Array) -> Array:
        """(b, c) sums of values (n, c) over bins."""
        columns = [np.bincount(place, weights=column, minlength=self.run.size) for column in values.T]
        return np.column_stack(columns) if columns else np.zeros((self.run.size, 0))


def white_rows(part: Linearised, noise: NoiseModel, extra: Array) -> tuple[Array, Eliminated]:
    """Whitened rows [local | shared | extra | residual] with those of the priors, and free of the local ones.

    extra : (n, e) further columns
    """
    columns = np.column_stack([part.local, part.shared, extra, part.residual])
    white = noise.shape.whiten(columns, part) / noise.std
    rows = with_priors(white, part.prior, part.prior_residual)
    return rows, eliminate(rows, part.local.shape[1])


def record_likelihood(bins: Bins, parts: Sequence[Linearised], noise: NoiseModel) -> Likelihood:
    """2 log likelihood of the residuals bin by bin; constants that no fit changes are left out."""
    values = np.zeros(bins.run.size)
    for part, place in zip(parts, bins.of, strict=True):
        white = noise.shape.whiten(part.residual[:, None], part)[:, 0] / noise.std
        values -= np.bincount(place, weights=white**2 + 2 * np.log(noise.std), minlength=values.size)
        known = np.isfinite(part.prior)
        values[place[0]] -= float(np.sum((part.prior_residual[known] / part.prior[known]) ** 2))
    return Likelihood(bins.run, bins.time, values)


def scores_of(
    problem: EffectsProblem,
    parts: Sequence[Linearised],
    noise: NoiseModel,
    directions: Sequence[Direction],
    signal: str,
) -> LayerScores:
    """Scores of all directions at a fit, of which ``parts`` are the records."""
    bins = Bins(problem.records)
    freed, place, whole = [], [], np.zeros(len(directions))
    residuals = []
    for number, part in enumerate(parts):
        extra = np.column_stack([one.values[number] for one in directions])
        rows, left = white_rows(part, noise, extra)
        samples = part.residual.size
        added = np.full(len(rows) - samples, bins.of[number][0], dtype=np.intp)
        freed.append(left.rows)
        residuals.append(rows[:, -1])
        place.append(np.concatenate([bins.of[number], added]))
        whole += np.sum(rows[:, -1 - len(directions) : -1] ** 2, axis=0)
    rows = eliminate(np.vstack(freed), parts[0].shared.shape[1]).rows[:, :-1]
    rows[:, np.sum(rows**2, axis=0) <= TAKEN_UP * whole] = 0.0
    residual, where = np.concatenate(residuals), np.concatenate(place)
    samples_of = np.concatenate(bins.of)
    power = np.concatenate([r[: p.residual.size] ** 2 for r, p in zip(residuals, parts, strict=True)])
    return LayerScores(
        layer="actuator",
        run=bins.run,
        time=bins.time,
        scores=bins.summed(where, rows * residual[:, None]),
        gram=rows.T @ rows,
        energy=bins.summed(where, rows**2),
        power=bins.summed(samples_of, power[:, None]),
        count=np.bincount(samples_of, minlength=bins.run.size)[:, None].astype(np.float64),
        activity=_activity(bins, problem.records),
        signals=(signal,),
        activities=ACTIVITIES,
        groups=_groups(directions),
    )


def _groups(directions: Sequence[Direction]) -> tuple[Group, ...]:
    """Candidates in the order in which they come first, each with all of its shapes."""
    shapes: dict[str, list[Shape]] = {}
    effects: dict[str, str | None] = {}
    for column, one in enumerate(directions):
        shapes.setdefault(one.key, []).append(Shape((column,), one.at, one.size))
        effects[one.key] = one.effect
    return tuple(Group(key, tuple(own), effects[key]) for key, own in shapes.items())


def _activity(bins: Bins, records: Sequence[ActuatorRecord]) -> Array:
    """(b, 3) mean squares of the request's rate, its deviation from the mean of its run, and its size."""
    means = {
        run: float(np.mean(np.concatenate([r.command_values for r in records if r.run == run])))
        for run in {record.run for record in records}
    }
    total = np.zeros((bins.run.size, len(ACTIVITIES)))
    for record, place in zip(records, bins.of, strict=True):
        request = np.interp(record.times, record.command_times, record.command_values)
        rate = np.gradient(request, record.times)
        squares = np.column_stack([rate, request - means[record.run], request]) ** 2
        total += bins.summed(place, squares)
    return np.asarray(total / np.bincount(np.concatenate(bins.of), minlength=bins.run.size)[:, None])
