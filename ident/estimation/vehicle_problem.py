"""Output error of a vehicle model on windows of measured motion: residuals, exact derivatives, elimination.

Parameters stand on three levels. Shared by all runs: tyres, yaw inertia, offset of the steering. Of one run:
the biases of its sensors, the bank of its road. Of one window: the initial state, so that what integrates
(heading, position) does not carry an error from one window into the next. Windows are eliminated first, then
runs (:mod:`ident.estimation.elimination`).

The position is compared across and along the direction of travel: an error of the speed, which is an input,
makes the position wrong along the path and hardly across it, and each has noise of its own. The errors of
the inputs add up in it, so in a long window the position is compared in parts, each of which may be moved
and turned as a whole (:mod:`ident.estimation.path_parts`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.engine import Engine
from ident.errors import NotIdentifiable
from ident.estimation.elimination import Eliminated, eliminate, stacked, triangle_of, with_priors
from ident.estimation.noise import AutoRegression, Linearised, NoiseModel
from ident.estimation.path_parts import direction_of_travel, moved_and_turned
from ident.estimation.vehicle_records import SignalSamples, Windows

Array = NDArray[np.float64]

POSITION = ("position_x", "position_y")
ALONG, ACROSS = "position_along", "position_across"
STEERING_RATIO = "steering_ratio"  # coordinate: relative change of the ratio behind the road-wheel angle
NOTHING = 1e-6  # of the prior of a term, in runs that do not have it
FEWEST = 20  # samples beyond what initial states follow, below which the noise of a signal cannot be told


@dataclass(frozen=True)
class Coordinate:
    """One parameter as it is fitted.

    name : of the model's parameter
    logarithmic : whether its logarithm is fitted; the rest of the fields then are of the logarithm
    low, high : where it may lie
    prior_mean, prior_std : Gaussian prior; infinite std where there is none
    """

    name: str
    logarithmic: bool = True
    low: float = -np.inf
    high: float = np.inf
    prior_mean: float = 0.0
    prior_std: float = np.inf

    def value(self, coordinate: float) -> float:
        """Give the parameter at a coordinate."""
        return float(np.exp(coordinate)) if self.logarithmic else float(coordinate)

    def coordinate(self, value: float) -> float:
        """Give the coordinate of a value of the parameter."""
        return float(np.log(value)) if self.logarithmic else float(value)

    def slope(self, coordinate: float) -> float:
        """Derivative of the parameter to its coordinate."""
        return float(np.exp(coordinate)) if self.logarithmic else 1.0


@dataclass(frozen=True)
class RunTerm:
    """A parameter that each run has for itself, with the std of its prior around zero.

    name : of the measured signal to which it is added (a bias), or of a parameter of the model
    only : runs that have it, None: all; in the others it is zero
    by_speed_to : measured signal to which it is added times the speed, None: as ``name`` says
    """

    name: str
    prior_std: float
    only: frozenset[int] | None = None
    by_speed_to: str | None = None


@dataclass(frozen=True)
class Residuals:
    """One compared signal in all windows: (n, local + biases + shared + 1) derivatives and residual."""

    samples: SignalSamples
    columns: Array

    @property
    def residual(self) -> Array:
        """(n,) measured minus modelled."""
        return np.asarray(self.columns[:, -1])


class VehicleProblem:
    """A model, the windows that it is compared with, and what of it is fitted."""

    def __init__(
        self,
        engine: Engine,
        windows: Windows,
        coordinates: Sequence[Coordinate],
        fixed: Mapping[str, float],
        run_terms: Sequence[RunTerm],
    ) -> None:
        """Take the parts.

        ``fixed`` holds all parameters of the model that are neither a coordinate nor a term of the runs;
        imu_x, imu_y come from the windows, and reference_x where it is no coordinate.

        Raises
        ------
        NotIdentifiable
            If every signal has too few samples for its noise to be told from the initial states.
        """
        self.engine = engine
        self.windows = windows
        self.coordinates = list(coordinates)
        self.fixed = dict(fixed)
        self.states = len(engine.states)
        self.signals = [name for name, s in windows.signals.items() if s.beyond(self.states) >= FEWEST]
        if not self.signals:
            raise NotIdentifiable(_too_few(windows, self.states))
        there = {*self.signals, *engine.parameters}
        self.run_terms = [term for term in run_terms if (term.by_speed_to or term.name) in there]
        self._inner = [i for i, term in enumerate(self.run_terms) if term.name in engine.parameters]
        self.active = [
            *(self.run_terms[i].name for i in self._inner),
            *(one.name for one in self.coordinates),
        ]
        self._wanted = [name for name in self.signals if name in engine.outputs]
        self.compared = [name for name in self.signals if name not in POSITION]
        if all(name in self.signals for name in POSITION):
            self.compared += [ALONG, ACROSS]
        self._course = self._path_direction()
        self._anchors = self._anchor_columns()
        self.local = self.states + self.anchors

    @property
    def anchors(self) -> int:
        """How many parameters of a window move and turn the later parts of its path."""
        return next((columns.shape[1] for columns in self._anchors.values()), 0)

    @property
    def run_std(self) -> Array:
        """Standard deviation of the prior of each term of a run."""
        return np.array([term.prior_std for term in self.run_terms])

    def has(self, run: int, name: str) -> bool:
        """Whether a run has a term of this name."""
        return any(t.name == name and (t.only is None or run in t.only) for t in self.run_terms)

    @property
    def std_by_run(self) -> Array:
        """(runs, b) the same in each run, next to nothing where a run has no such term."""
        made = np.tile(self.run_std, (self.windows.runs, 1))
        for number, term in enumerate(self.run_terms):
            if term.only is not None:
                others = [run for run in range(self.windows.runs) if run not in term.only]
                made[others, number] *= NOTHING
        return made

    @property
    def prior_std(self) -> Array:
        """Standard deviation of the prior of each coordinate, infinite where there is none."""
        return np.array([one.prior_std for one in self.coordinates])

    @property
    def prior_mean(self) -> Array:
        """Prior mean of each coordinate."""
        return np.array([one.prior_mean for one in self.coordinates])

    def inside(self, shared: Array) -> Array:
        """Clip to where the coordinates may lie."""
        low = [one.low for one in self.coordinates]
        high = [one.high for one in self.coordinates]
        return np.asarray(np.clip(shared, low, high))

    def initial_local(self) -> Array:
        """(w, local) states from the first measured samples of each window; no part of the path moved."""
        states = np.array([self._initial_state(number) for number in range(len(self.windows.records))])
        return np.pad(states, ((0, 0), (0, self.anchors)))

    def _initial_state(self, number: int) -> Array:
        record = self.windows.records[number]
        first = {
            name: float(np.median(samples.values[:5]))
            for name, samples in record.measured.items()
            if samples.values.size
        }
        heading = first.get("heading", self._direction_at(number))
        yaw_rate = first.get("yaw_rate", 0.0)
        lateral = first.get("lateral_velocity", 0.0) - record.reference_x * yaw_rate
        x = first.get("position_x", 0.0) - record.reference_x * np.cos(heading)
        y = first.get("position_y", 0.0) - record.reference_x * np.sin(heading)
        state = {
            "lateral_velocity": lateral,
            "yaw_rate": yaw_rate,
            "heading": heading,
            "position_x": x,
            "position_y": y,
        }
        return np.array([state[name] for name in self.engine.states])

    def _direction_at(self, number: int) -> float:
        if ACROSS not in self.compared:
            return 0.0
        begin = int(self.windows.signals["position_x"].begins[number])
        return float(self._course[min(begin, self._course.size - 1)])

    def _path_direction(self) -> Array:
        """(n,) direction in which the measured position moves [rad], at its samples."""
        if ACROSS not in self.compared:
            return np.zeros(0)
        x, y = (self.windows.signals[name] for name in POSITION)
        if not (np.array_equal(x.times, y.times) and np.array_equal(x.window, y.window)):
            self.compared = [name for name in self.compared if name not in (ALONG, ACROSS)]
            return np.zeros(0)
        return direction_of_travel(x, y)

    def _anchor_columns(self) -> dict[str, Array]:
        """(n, anchors) derivative of the position along and across to the moves and turns of later parts."""
        if ACROSS not in self.compared:
            return {}
        x, y = (self.windows.signals[name] for name in POSITION)
        both = moved_and_turned(self.windows, x, y, self._course)
        return dict(zip((ALONG, ACROSS), both, strict=True))

    def values(self, shared: Array) -> dict[str, float]:
        """Parameters of the model that all runs share."""
        return self.fixed | {
            one.name: one.value(at) for one, at in zip(self.coordinates, shared, strict=True)
        }

    def parameters(self, shared: Array, of_runs: Array) -> Array:
        """(w, p) parameters of the model in each window; of_runs (runs, b) holds the terms of the runs."""
        values, rows = self.values(shared), []
        for record in self.windows.records:
            terms = {self.run_terms[i].name: float(of_runs[record.run, i]) for i in self._inner}
            mounting = {
                "reference_x": record.reference_x,
                "imu_x": record.imu[0],
                "imu_y": record.imu[1],
            }
            own = {**mounting, **values, **terms}
            rows.append([own[name] for name in self.engine.parameters])
        return np.array(rows)

    def simulate(self, shared: Array, of_runs: Array, local: Array) -> tuple[Array, Array]:
        """States (N, x) and outputs (N, y) on the grid of all windows."""
        w = self.windows
        states = np.ascontiguousarray(local[:, : self.states])
        return self.engine.simulate(states, w.inputs, w.steps, w.offsets, self.parameters(shared, of_runs))

    def residuals(self, shared: Array, of_runs: Array, local: Array) -> dict[str, Residuals]:
        """Residuals and derivatives of every compared signal."""
        w = self.windows
        states = np.ascontiguousarray(local[:, : self.states])
        _, outputs, derivatives = self.engine.sensitivities(
            states,
            w.inputs,
            w.steps,
            w.offsets,
            self.parameters(shared, of_runs),
            active=self.active,
            input_derivatives=self._input_derivatives(),
            wanted=self._wanted,
        )
        slopes = np.array([one.slope(at) for one, at in zip(self.coordinates, shared, strict=True)])
        made = {name: self._of_signal(name, outputs, derivatives, slopes, of_runs) for name in self._wanted}
        if ACROSS in self.compared:
            made |= self._turned(made.pop("position_x"), made.pop("position_y"), local)
        return {name: made[name] for name in self.compared}

    def _input_derivatives(self) -> Array | None:
        """(N, u, active) derivative of the inputs, where any depends on a coordinate.

        Only the ratio stands before the model: the road-wheel angle falls with it, -angle/ratio.
        """
        names = [one.name for one in self.coordinates]
        if STEERING_RATIO not in names:
            return None
        made = np.zeros((*self.windows.inputs.shape, len(self.active)))
        made[:, 0, len(self._inner) + names.index(STEERING_RATIO)] = -self.windows.inputs[:, 0]
        return made

    def _of_signal(
        self, name: str, outputs: Array, derivatives: Array, slopes: Array, of_runs: Array
    ) -> Residuals:
        samples = self.windows.signals[name]
        column = self.engine.outputs.index(name)
        at = samples.at(np.column_stack([outputs[:, column], derivatives[self._wanted.index(name)]]))
        model, by_state, by_parameter = at[:, 0], at[:, 1 : 1 + self.states], at[:, 1 + self.states :]
        own = np.zeros((len(at), len(self.run_terms)))
        own[:, self._inner] = by_parameter[:, : len(self._inner)]
        for number, term in enumerate(self.run_terms):
            if name in (term.name, term.by_speed_to):
                times = 1.0 if term.by_speed_to is None else samples.at(self.windows.inputs[:, 1:2])[:, 0]
                own[:, number] = times
                model = model + times * of_runs[self.windows.run[samples.window], number]
        anchors = np.zeros((len(at), self.anchors))
        by_shared = by_parameter[:, len(self._inner) :] * slopes
        return Residuals(
            samples, np.column_stack([by_state, anchors, own, by_shared, samples.values - model])
        )

    def _turned(self, x: Residuals, y: Residuals, local: Array) -> dict[str, Residuals]:
        cosine, sine = np.cos(self._course)[:, None], np.sin(self._course)[:, None]
        made = {ALONG: cosine * x.columns + sine * y.columns, ACROSS: cosine * y.columns - sine * x.columns}
        moved = local[x.samples.window, self.states :]
        for name, columns in made.items():
            columns[:, self.states : self.local] = self._anchors[name]
            columns[:, -1] -= np.sum(self._anchors[name] * moved, axis=1)
        return {name: Residuals(x.samples, columns) for name, columns in made.items()}


def _too_few(windows: Windows, states: int) -> str:
    counts = ", ".join(
        f"{name} {samples.beyond(states)} in {samples.times.size}"
        for name, samples in windows.signals.items()
    )
    return (
        f"samples beyond the first {states} of each window: {counts or 'none'}; need {FEWEST} of a signal: "
        "record faster or drive longer"
    )


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
    def value(self) -> float:
        """Whitened sum of squares and of the prior terms; infinite where the model has blown up."""
        with np.errstate(all="ignore"):
            total = sum(float(white[:, -1] @ white[:, -1]) for white in self.white.values())
        total += float(np.square(self.of_runs / self.problem.std_by_run).sum())
        total += float(np.square(self._from_prior / self.problem.prior_std).sum())
        return total if np.isfinite(total) else np.inf

    @property
    def _from_prior(self) -> Array:
        return self.problem.prior_mean - self.shared

    @cached_property
    def windows(self) -> list[Eliminated]:
        """Each window, its initial state eliminated."""
        parts = {name: one.samples.begins for name, one in self.residuals.items()}
        made = []
        for number in range(len(self.problem.windows.records)):
            rows = [self.white[name][begins[number] : begins[number + 1]] for name, begins in parts.items()]
            made.append(eliminate(triangle_of(np.vstack(rows)), self.problem.local))
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

    def triangle(self) -> Array:
        """See :class:`~ident.estimation.gauss_newton.Point`."""
        rows = with_priors(stacked(self.by_run), self.problem.prior_std, self._from_prior)
        return triangle_of(rows)

    def moved(self, step: Array) -> VehiclePoint:
        """See :class:`~ident.estimation.gauss_newton.Point`."""
        of_runs = np.array([run.step(step) for run in self.by_run]).reshape(self.of_runs.shape)
        of_windows = [
            window.step(np.concatenate([of_runs[run], step]))
            for window, run in zip(self.windows, self.problem.windows.run, strict=True)
        ]
        return replace(
            self,
            shared=self.shared + step,
            of_runs=self.of_runs + of_runs,
            local=self.local + np.array(of_windows),
        )

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
