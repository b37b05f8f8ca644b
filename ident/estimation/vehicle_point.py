"""A vehicle problem at present parameters: what is minimised, and how its parameters are eliminated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ident.estimation.elimination import Eliminated, eliminate, stacked, triangle_of, with_priors
from ident.estimation.noise import AutoRegression, Linearised, NoiseModel
from ident.estimation.vehicle_inputs import moved_begins
from ident.estimation.vehicle_problem import Residuals, VehicleProblem

Array = NDArray[np.float64]

SIMULATED = ("outputs", "residuals", "errors")
PARTS = {1.0: (0.25, 0.05, 0.0), 0.25: (1.0, 0.25), 0.05: (1.0, 0.25), 0.0: (1.0, 0.25, 0.0)}
"""Where the whole of a step is too much: parts of that of a run's terms, and of its windows' with each."""
WITH_WHOLE_TERMS = ((1.0, PARTS[1.0]),)  # of which all but where a play begins are linear


@dataclass(frozen=True)
class VehiclePoint:
    """The problem at present parameters, weighed by the noise of each signal.

    shared : (s,) coordinates; of_runs : (runs, b) terms of the runs
    local : (w, local) initial states, then how later parts of the path are moved and turned
    noise : of every compared signal
    """

    problem: VehicleProblem
    shared: Array
    of_runs: Array
    local: Array
    noise: Mapping[str, NoiseModel]
    std: float = 1.0

    @cached_property
    def residuals(self) -> dict[str, Residuals]:
        """Of every compared signal."""
        with np.errstate(all="ignore"):  # a model that blows up is found by its value
            return self.problem.residuals(self.shared, self.of_runs, self.local)

    @cached_property
    def white(self) -> dict[str, Array]:
        """Columns and residual of every signal, whitened, in units of the innovations."""
        with np.errstate(all="ignore"):
            return {name: whitened(one, self.noise[name]) for name, one in self.residuals.items()}

    @cached_property
    def outputs(self) -> Array:
        """(N, y) of the model on the grid of all windows."""
        with np.errstate(all="ignore"):
            return self.problem.simulate(self.shared, self.of_runs, self.local)[1]

    @cached_property
    def errors(self) -> dict[str, Residuals]:
        """Residuals of every compared signal alone, for which no derivative is needed."""
        with np.errstate(all="ignore"):
            return self.problem.errors(self.outputs, self.shared, self.of_runs, self.local)

    @cached_property
    def _white_errors(self) -> list[tuple[NDArray[np.intp], Array]]:
        """(n,) window and whitened residual of every compared signal."""
        with np.errstate(all="ignore"):
            return [
                (one.samples.window, whitened(one, self.noise[name])[:, 0])
                for name, one in self.errors.items()
            ]

    @property
    def white_errors(self) -> dict[str, Array]:
        """(n,) whitened residual of every compared signal; found without derivatives."""
        return {name: white for name, (_, white) in zip(self.errors, self._white_errors, strict=True)}

    def with_noise(self, noise: Mapping[str, NoiseModel]) -> VehiclePoint:
        """The same weighed by another noise; nothing is simulated again."""
        made = replace(self, noise=noise)
        made.__dict__.update({name: self.__dict__[name] for name in SIMULATED if name in self.__dict__})
        return made

    @property
    def smooth(self) -> bool:
        """See :class:`~ident.estimation.gauss_newton.Point`."""
        with np.errstate(all="ignore"):
            return all(bool(np.isfinite(white.sum())) for white in self.white.values())

    @cached_property
    def value(self) -> float:
        """Whitened sum of squares and of the prior terms; infinite where the model has blown up."""
        with np.errstate(all="ignore"):
            total = sum(float(white @ white) for _, white in self._white_errors)
        total += float(np.square(self.of_runs / self.problem.std_by_run).sum())
        total += float(np.square(self._from_prior / self.problem.prior_std).sum())
        total += float(np.square(self._from_start / self.problem.initial_std).sum())
        return total if np.isfinite(total) else np.inf

    @property
    def _from_start(self) -> Array:
        return self.problem.initial_local - self.local

    @property
    def _from_prior(self) -> Array:
        return self.problem.prior_mean - self.shared

    @cached_property
    def windows(self) -> list[Eliminated]:
        """Each window, its initial state eliminated."""
        parts = {name: one.samples.begins for name, one in self.residuals.items()}
        made = []
        for number in range(len(self.problem.windows.records)):
            own = [self.white[name][begins[number] : begins[number + 1]] for name, begins in parts.items()]
            rows = triangle_of(np.vstack(own))
            rows = with_priors(rows, self.problem.initial_std[number], self._from_start[number])
            made.append(eliminate(rows, self.problem.local))
        return made

    @cached_property
    def by_run(self) -> list[Eliminated]:
        """Each run, its terms eliminated."""
        made = []
        for run in range(self.problem.windows.runs):
            own = [part for part, of in zip(self.windows, self.problem.windows.run, strict=True) if of == run]
            rows = with_priors(stacked(own), self.problem.std_by_run[run], -self.of_runs[run])
            made.append(eliminate(rows, len(self.problem.run_terms)))
        return made

    @cached_property
    def _triangle(self) -> Array:
        rows = with_priors(stacked(self.by_run), self.problem.prior_std, self._from_prior)
        return triangle_of(rows)

    def triangle(self) -> Array:
        """See :class:`~ident.estimation.gauss_newton.Point`."""
        return self._triangle

    def moved(self, step: Array) -> VehiclePoint:
        """See :class:`~ident.estimation.gauss_newton.Point`.

        Near the peak of a tyre a whole step of an initial state leads far past its best value, and so does
        one of where a play begins near an end of it. Where the whole makes things worse, each run with a play
        takes that part of the step of its terms, and each window that of its initial state, that serves it
        best.
        """
        whole = self.wholly_moved(step)
        if whole.value <= self.value:
            return whole
        asked, best = self._term_steps(step), whole
        for part, parts in PARTS.items() if self.problem.begins.size else WITH_WHOLE_TERMS:
            tried = self._with_terms(whole, part, asked, parts, step)
            best = tried if part == 1.0 else best.with_better_runs(tried)
            if np.all(best.run_sums <= self.run_sums):
                break
        return best

    def _with_terms(
        self, whole: VehiclePoint, part: float, asked: Array, parts: Sequence[float], step: Array
    ) -> VehiclePoint:
        """The point of a whole step, but with a part of the steps asked of the runs' terms (runs, b).

        The initial states follow, each by that of these parts of its own step that serves its window best.
        """
        follows = self._local_steps(part * asked, step)
        moved = replace(whole, of_runs=self.with_term_steps(part * asked))
        tried = [replace(moved, local=self.local + one * follows) for one in parts]
        if part == 1.0:
            tried.insert(0, whole)
        best = np.argmin([point.window_sums for point in tried], axis=0)
        return replace(moved, local=np.array([tried[k].local[n] for n, k in enumerate(best)]))

    def with_better_runs(self, other: VehiclePoint) -> VehiclePoint:
        """The same with the terms and initial states of those runs that another point serves better."""
        better = other.run_sums < self.run_sums
        return replace(
            self,
            of_runs=np.where(better[:, None], other.of_runs, self.of_runs),
            local=np.where(better[self.problem.windows.run][:, None], other.local, self.local),
        )

    @cached_property
    def run_sums(self) -> Array:
        """(runs,) whitened sum of squares of each run, and of the prior of its terms."""
        of_windows = np.zeros(self.problem.windows.runs)
        np.add.at(of_windows, self.problem.windows.run, self.window_sums)
        return np.asarray(of_windows + np.square(self.of_runs / self.problem.std_by_run).sum(axis=1))

    @cached_property
    def window_sums(self) -> Array:
        """(w,) whitened sum of squares of each window; infinite where the model has blown up."""
        made = np.square(self._from_start / self.problem.initial_std).sum(axis=1)
        with np.errstate(all="ignore"):
            for window, white in self._white_errors:
                made = made + np.bincount(window, weights=white**2, minlength=made.size)
        return np.asarray(np.nan_to_num(made, nan=np.inf))

    def wholly_moved(self, step: Array) -> VehiclePoint:
        """Where a step leads with all that was eliminated following it as if it were linear.

        The tyres' part is taken in the forces, which is what the rest follows.
        """
        terms = self._term_steps(step)
        return replace(
            self,
            shared=self.shared + self.problem.carried(self.shared, step, self.outputs),
            of_runs=self.with_term_steps(terms),
            local=self.local + self._local_steps(terms, step),
        )

    def _term_steps(self, step: Array) -> Array:
        """(runs, b) steps of the terms of the runs that go with one of the shared parameters."""
        return np.array([run.step(step) for run in self.by_run]).reshape(self.of_runs.shape)

    def with_term_steps(self, steps: Array) -> Array:
        """(runs, b) terms of the runs after steps that were found to first order."""
        made, begins = self.of_runs + steps, self.problem.begins
        made[:, begins] = moved_begins(self.of_runs[:, begins], steps[:, begins])
        return made

    def _local_steps(self, terms: Array, step: Array) -> Array:
        """(w, local) steps of what belongs to single windows, those of the runs' terms (runs, b) given."""
        each = zip(self.windows, self.problem.windows.run, strict=True)
        return np.array([window.step(np.concatenate([terms[run], step])) for window, run in each])

    def inside(self, shared: Array) -> Array:
        """See :class:`~ident.estimation.gauss_newton.Point`."""
        return self.problem.inside(shared)

    def linearised(self, name: str) -> list[Linearised]:
        """One signal window by window, for the identification of its noise."""
        one = self.residuals[name]
        own = self.problem.local + len(self.problem.run_terms)
        samples, made = one.samples, []
        for begin, end in zip(samples.begins[:-1].tolist(), samples.begins[1:].tolist(), strict=True):
            if end - begin < 2:
                continue
            columns = one.columns[begin:end]
            starts = samples.starts[(samples.starts >= begin) & (samples.starts < end)] - begin
            prior = np.full(own, np.inf)
            made.append(
                Linearised(
                    samples.times[begin:end],
                    columns[:, -1],
                    columns[:, own:-1],
                    columns[:, :own],
                    starts,
                    prior,
                    np.zeros(own),
                )
            )
        return made


def whitened(one: Residuals, noise: NoiseModel) -> Array:
    """Columns and residual of a signal, white and of unit size."""
    nothing = np.zeros((len(one.columns), 0))
    none = np.zeros(0)
    record = Linearised(one.samples.times, one.residual, nothing, nothing, one.samples.starts, none, none)
    return noise.shape.whiten(one.columns, record) / noise.std


def white_noise(std: float) -> NoiseModel:
    """Noise without colour."""
    return NoiseModel(AutoRegression(np.zeros(0)), std)
