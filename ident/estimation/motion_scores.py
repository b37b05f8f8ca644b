"""Scores of what a fitted vehicle model may lack, in bins of time.

With r the whitened residual and J the derivatives to all that was fitted (initial states of the windows,
terms of the runs, shared parameters), a candidate whose first-order effect on the whitened signals is p has
the direction p̃ = p - J (JᵀJ)⁺ Jᵀ p and the score p̃ᵀ r. Terms of the runs count with their priors; shared
parameters without, so that no candidate gains by bringing a parameter nearer to what is usual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.driver_text import UPSTREAM
from ident.estimation.elimination import eliminate, inverse_of
from ident.estimation.input_noise import DrawnNoise, InputNoise
from ident.estimation.layer import BIN, Likelihood
from ident.estimation.noise import Linearised
from ident.estimation.vehicle_inputs import Probe
from ident.estimation.vehicle_point import VehiclePoint

Array = NDArray[np.float64]
Index = NDArray[np.intp]

TAKEN_UP = 1e-6  # of its squared length: a direction of which less is left is one of the fit itself
OF_A_KIND, OF_ALL, SEED = 16, 48, 0  # draws of the noise of the inputs
FAINT = 1e-8  # of the largest: a direction of the shared parameters that the data do not hold


@dataclass(frozen=True)
class Bins:
    """Where the samples of all windows fall: bins of about ``BIN`` seconds within windows.

    run, time : (b,) of each bin; window : (b,); first : (w + 1,) first bin of each window
    """

    run: Index
    time: Array
    window: Index
    first: Index

    def of(self, window: int, times: Array) -> Index:
        """(n,) bin of instants in a window."""
        own = slice(int(self.first[window]), int(self.first[window + 1]))
        place = np.searchsorted(self.time[own] + BIN / 2, times)
        return np.clip(place, 0, own.stop - own.start - 1) + own.start


def add_to_bins(total: Array, where: Index, rows: Array) -> None:
    """Add rows (n, c) to those (b, c) that ``where`` (n,) names."""
    order = np.argsort(where, kind="stable")
    found, first = np.unique(where[order], return_index=True)
    total[found] += np.add.reduceat(rows[order], first, axis=0)


def bins_of(point: VehiclePoint) -> Bins:
    """Bins of all windows, in their order."""
    windows = point.problem.windows
    middles = []
    for number, record in enumerate(windows.records):
        begins = [
            s.times[s.begins[number]]
            for s in windows.signals.values()
            if s.begins[number + 1] > s.begins[number]
        ]
        begin = min(begins, default=record.times[0])
        count = max(1, int(np.ceil((record.times[-1] - begin) / BIN - 1e-9)))
        middles.append(begin + BIN * (np.arange(count) + 0.5))
    counts = [one.size for one in middles]
    return Bins(
        run=np.repeat(windows.run, counts).astype(np.intp),
        time=np.concatenate(middles),
        window=np.repeat(np.arange(len(counts)), counts).astype(np.intp),
        first=np.cumsum([0, *counts]).astype(np.intp),
    )


@dataclass(frozen=True)
class _RunParts:
    """One run, its own terms eliminated.

    windows : numbers of its windows
    to_shared (b, s), to_rows (b, c) : how the terms follow the shared parameters and the rows
    inner (s, s), target (s, c) : products of the shared columns with themselves and with the rows
    """

    windows: list[int]
    to_shared: Array
    to_rows: Array
    inner: Array
    target: Array


class Projection:
    """What is left of directions once the fit has taken up all that it can."""

    def __init__(self, point: VehiclePoint) -> None:
        """Take a point at its minimum."""
        self.point = point
        self.bins = bins_of(point)
        self._places = {name: one.samples.begins for name, one in point.residuals.items()}
        self._windows = [self._window(number) for number in range(len(point.problem.windows.records))]

    def _rows(self, of_signal: dict[str, Array], number: int) -> Array:
        return np.vstack([of_signal[n][b[number] : b[number + 1]] for n, b in self._places.items()])

    def _window(self, number: int) -> tuple[Array, Array]:
        """Orthonormal directions of the initial state; [run terms | shared | residual] free of them."""
        point = self.point
        rows = self._rows(point.white, number)
        own = eliminate(rows, point.problem.local)
        left = own.rows.copy()
        terms = len(point.problem.run_terms)
        left[:, :terms] *= point.problem.std_by_run[point.problem.windows.run[number]]
        left[:, terms:-1] = left[:, terms:-1] @ self._scale
        return own.basis, left

    @cached_property
    def _scale(self) -> Array:
        """(s, s) makes the shared columns about orthonormal."""
        return inverse_of(self.point.triangle()[: self.point.shared.size, :-1])

    def directions(self, probes: Sequence[Probe], combined: Array) -> Directions:
        """Free directions, each a combination of probes, of what the fit takes up.

        combined : (p, c) of the probes
        """
        columns = {name: one @ combined for name, one in self.whitened(probes).items()}
        before = sum(np.sum(one**2, axis=0) for one in columns.values())
        rows = self.freed(columns)
        size = combined.shape[1]
        energy, gram = np.zeros((self.bins.run.size, size)), np.zeros((size, size))
        for number, own in enumerate(rows):
            add_to_bins(energy, self.bins_of_rows(number), own**2)
            gram += own.T @ own
        gone = np.diag(gram) < TAKEN_UP * np.maximum(before, 1e-300)
        energy[:, gone], gram[gone], gram[:, gone] = 0.0, 0.0, 0.0
        for own in rows:
            own[:, gone] = 0.0
        return Directions(self, rows, gram, energy)

    def of_input_noise(self, noises: Sequence[InputNoise]) -> DrawnNoise:
        """What each kind of noise of the inputs does by itself, freed of what the fit takes up."""
        windows = self.point.problem.windows
        probes = [
            Probe(inputs={one.name: values})
            for one in noises
            for values in one.drawn(windows, OF_A_KIND, SEED).T
        ]
        kind = np.repeat(np.arange(1, len(noises) + 1), OF_A_KIND)
        return DrawnNoise(kind, self.freed(self.whitened(probes)), [one.most for one in noises])

    def of_all_input_noise(self, noises: Sequence[InputNoise], variances: Array) -> DrawnNoise:
        """What all kinds do together, each with its variance in units of its draws; freed likewise."""
        windows = self.point.problem.windows
        total = {one.name: np.zeros((windows.times.size, OF_ALL)) for one in noises}
        for one, variance in zip(noises, variances, strict=True):
            if variance > 0:
                total[one.name] += np.sqrt(variance) * one.drawn(windows, OF_ALL, SEED + 1)
        probes = [Probe(inputs={name: v[:, number] for name, v in total.items()}) for number in range(OF_ALL)]
        return DrawnNoise(np.ones(OF_ALL, dtype=np.intp), self.freed(self.whitened(probes)))

    def residuals(self, point: VehiclePoint | None = None) -> list[Array]:
        """(n,) of each window: whitened residual, freed of what the fit takes up.

        point : other measurements at the same instants, at the parameters of the fit: what is left of their
            residual is to first order that of a fit to them; the fit itself unless given
        """
        other = point or self.point
        return [own[:, 0] for own in self.freed({name: one[:, -1:] for name, one in other.white.items()})]

    def freed(self, of_signal: dict[str, Array]) -> list[Array]:
        """(n, c) of each window, freed of initial states, terms of the runs and shared parameters."""
        rows = [
            self._without_start(self._rows(of_signal, number), number) for number in range(len(self._windows))
        ]
        self._project(rows)
        return rows

    def whitened(self, probes: Sequence[Probe]) -> dict[str, Array]:
        """(n, c) of every compared signal; as many at once as the engine carries."""
        point, parts = self.point, []
        for begin in range(0, len(probes), UPSTREAM):
            some = probes[begin : begin + UPSTREAM]
            parts.append(point.problem.probed(point.shared, point.of_runs, point.local, some))
        made = {}
        for name, one in point.residuals.items():
            columns = np.hstack([part[name] for part in parts])
            none = np.zeros(0)
            rows = np.zeros((len(columns), 0))
            record = Linearised(one.samples.times, one.residual, rows, rows, one.samples.starts, none, none)
            noise = point.noise[name]
            made[name] = noise.shape.whiten(columns, record) / noise.std
        return made

    def _without_start(self, rows: Array, number: int) -> Array:
        basis, _ = self._windows[number]
        return rows - basis @ (basis.T @ rows)

    def _project(self, everything: list[Array]) -> None:
        """Free rows, in place, of the terms of the runs and of the shared parameters."""
        runs = [self._run(run, everything) for run in range(self.point.problem.windows.runs)]
        inner = np.sum([run.inner for run in runs], axis=0)
        target = np.sum([run.target for run in runs], axis=0)
        of_shared = np.linalg.pinv(inner, rcond=FAINT, hermitian=True) @ target
        for run in runs:
            of_terms = run.to_rows - run.to_shared @ of_shared
            terms = len(of_terms)
            for number in run.windows:
                known = self._windows[number][1][:, :-1]
                everything[number] -= known[:, :terms] @ of_terms + known[:, terms:] @ of_shared

    def _run(self, run: int, everything: Sequence[Array]) -> _RunParts:
        """Eliminate the terms of a run from its rows (n, c), free of initial states."""
        terms, of = len(self.point.problem.run_terms), self.point.problem.windows.run
        own = np.flatnonzero(of == run).tolist()
        known = np.vstack([self._windows[number][1][:, :-1] for number in own])
        rows = np.vstack([everything[number] for number in own])
        t, s = known[:, :terms], known[:, terms:]
        within = np.linalg.inv(t.T @ t + np.eye(terms))
        to_shared, to_rows = within @ (t.T @ s), within @ (t.T @ rows)
        return _RunParts(own, to_shared, to_rows, s.T @ (s - t @ to_shared), s.T @ (rows - t @ to_rows))

    def shared_scores(self, of_signal: dict[str, Array]) -> Array:
        """(runs, s, c) scores of the shared coordinates in each run, for rows (n, c) of every signal.

        What is local to windows and runs is eliminated.
        """
        free = [
            self._without_start(self._rows(of_signal, number), number) for number in range(len(self._windows))
        ]
        runs = [self._run(run, free).target for run in range(self.point.problem.windows.runs)]
        return np.asarray(np.linalg.solve(self._scale.T, np.array(runs)))

    def by_signal(self, rows: Sequence[Array]) -> dict[str, Array]:
        """(n, c) of every signal, from the rows of each window."""
        made: dict[str, list[Array]] = {name: [] for name in self._places}
        for number, own in enumerate(rows):
            ends = np.cumsum([int(b[number + 1] - b[number]) for b in self._places.values()])
            for name, part in zip(made, np.split(own, ends[:-1]), strict=True):
                made[name].append(part)
        return {name: np.vstack(parts) for name, parts in made.items()}

    def bins_of_rows(self, number: int) -> Index:
        """(n,) bin of every row of a window."""
        times = [
            self.point.residuals[name].samples.times[b[number] : b[number + 1]]
            for name, b in self._places.items()
        ]
        return self.bins.of(number, np.concatenate(times))

    def power(self, residuals: Sequence[Array] | None = None) -> tuple[Array, Array]:
        """(b, s) sum of squared whitened residuals and number of samples, of every compared signal.

        residuals : (n,) of each window, as :meth:`residuals` gives them; those of the fit unless given
        """
        power, count = (np.zeros((self.bins.run.size, len(self._places))) for _ in range(2))
        for number in range(len(self._windows)):
            left = self._rows(self._residual, number)[:, 0] if residuals is None else residuals[number]
            where, signal = self.bins_of_rows(number), self._signal_of_rows(number)
            np.add.at(power, (where, signal), left**2)
            np.add.at(count, (where, signal), 1.0)
        return power, count

    @property
    def _residual(self) -> dict[str, Array]:
        return {name: one[:, -1:] for name, one in self.point.white.items()}

    def _signal_of_rows(self, number: int) -> Index:
        sizes = [int(b[number + 1] - b[number]) for b in self._places.values()]
        return np.repeat(np.arange(len(sizes)), sizes).astype(np.intp)

    def likelihood(self, residuals: Sequence[Array] | None = None) -> Likelihood:
        """Minus the sum of squared whitened residuals: 2 log likelihood but for a constant.

        residuals : as in :meth:`power`
        """
        power, _ = self.power(residuals)
        return Likelihood(self.bins.run, self.bins.time, -power.sum(axis=1))

    def mean(self, values: Array) -> Array:
        """(b,) mean over each bin of values (N,) on the grid of all windows."""
        windows, total = self.point.problem.windows, np.zeros(self.bins.run.size)
        count = np.zeros(self.bins.run.size)
        for number in range(len(self._windows)):
            part = slice(int(windows.offsets[number]), int(windows.offsets[number + 1]))
            where = self.bins.of(number, windows.times[part])
            np.add.at(total, where, values[part])
            np.add.at(count, where, 1.0)
        return np.asarray(total / np.maximum(count, 1.0))


@dataclass(frozen=True)
class Directions:
    """Directions freed of all that a fit takes up; they may meet residuals of other measurements as well.

    rows : (n, c) of each window; all zero where the fit takes up a direction
    gram : (c, c) inner products over all bins; energy : (b, c) squared lengths within each bin
    """

    projection: Projection
    rows: Sequence[Array]
    gram: Array
    energy: Array

    def colour(self, noises: Sequence[InputNoise]) -> Array:
        """(c,) variance of scores over that under white residuals, by the noise of the inputs."""
        if not noises:
            return np.ones(len(self.gram))
        known = self.projection.of_input_noise(noises).variances(self.projection.residuals())
        drawn = self.projection.of_all_input_noise(noises, known[1:])
        return drawn.colour(self.rows, np.ones(2))  # what is left beside is white, or no noise

    def scores(self, residuals: Sequence[Array]) -> Array:
        """(b, c) sum over each bin of direction times residual, which is (n,) in each window."""
        made = np.zeros_like(self.energy)
        for number, (own, left) in enumerate(zip(self.rows, residuals, strict=True)):
            add_to_bins(made, self.projection.bins_of_rows(number), own * left[:, None])
        return made
