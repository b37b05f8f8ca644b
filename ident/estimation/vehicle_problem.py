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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.engine import Engine
from ident.dynamics.tyres import Tyre
from ident.errors import NotIdentifiable
from ident.estimation.coordinates import Coordinate, RunTerm
from ident.estimation.path_parts import direction_of_travel, moved_and_turned
from ident.estimation.tyre_steps import FittedAxle
from ident.estimation.vehicle_inputs import (
    NOTHING_AROUND,
    Around,
    Probe,
    begin_terms,
    placed_blocks,
    places_in_runs,
    through_blocks,
)
from ident.estimation.vehicle_records import SignalSamples, Windows

Array = NDArray[np.float64]

POSITION = ("position_x", "position_y")
ALONG, ACROSS = "position_along", "position_across"
STEERING_RATIO = "steering_ratio"  # coordinate: relative change of the ratio behind the road-wheel angle
INITIAL_STD = {  # state -> of its prior around what the first samples say: measured, and not
    "lateral_velocity": (0.1, 3.0),  # [m/s]
    "yaw_rate": (0.05, 1.0),  # [rad/s]
    "front_relaxed_force": (1e4, 1e4),  # [N]
    "rear_relaxed_force": (1e4, 1e4),  # [N]
    "body_roll_angle": (0.05, 0.05),  # [rad]
    "body_roll_rate": (0.2, 0.2),  # [rad/s]
}
REACHED = 0.999  # quantile of the slip angles up to which the forces count
NOTHING = 1e-6  # of the prior of a term, in runs that do not have it
FEWEST = 20  # samples beyond what initial states follow, below which the noise of a signal cannot be told


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
        around: Around = NOTHING_AROUND,
        tyres: Mapping[str, tuple[Tyre, float]] | None = None,
    ) -> None:
        """Take the parts.

        ``fixed`` holds all parameters of the model that are neither a coordinate nor a term of the runs;
        imu_x, imu_y come from the windows, and reference_x where it is no coordinate. ``tyres`` holds axle ->
        tyre and static load [N]; steps of their parameters are taken in the forces.

        Raises
        ------
        NotIdentifiable
            If every signal has too few samples for its noise to be told from the initial states.
        """
        self.engine = engine
        self.windows = windows
        self.coordinates = list(coordinates)
        self.fixed = dict(fixed)
        self.around = around
        self.tyres = dict(tyres or {})
        self.states = len(engine.states)
        self.signals = [name for name, s in windows.signals.items() if s.beyond(self.states) >= FEWEST]
        if not self.signals:
            raise NotIdentifiable(_too_few(windows, self.states))
        self._stretch_places = places_in_runs(windows) if around.blocks else []
        self._begins = {term.name for term in begin_terms(around.blocks, windows)}
        inner = {*engine.parameters, *self._begins}
        there = {*self.signals, *inner}
        self.run_terms = [term for term in run_terms if (term.by_speed_to or term.name) in there]
        self._inner = [i for i, term in enumerate(self.run_terms) if term.name in inner]
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

    @cached_property
    def axles(self) -> dict[str, FittedAxle]:
        """Axles with parameters that can make up for one another, whose slip angles the model tells."""
        names, made = [one.name for one in self.coordinates], {}
        for axle, (tyre, load) in self.tyres.items():
            own = {name: f"{axle}.{name}" for name in tyre.names}
            places = {name: names.index(one) for name, one in own.items() if one in names}
            held = {name: self.fixed[one] for name, one in own.items() if one in self.fixed}
            if len(places) > 2 and f"{axle}_slip_angle" in self.engine.outputs:
                made[axle] = FittedAxle(tyre, load, held, places)
        return made

    def carried(self, shared: Array, step: Array, outputs: Array) -> Array:
        """A step of the coordinates, those of the tyres taken in the forces.

        outputs : (N, y) at ``shared``
        """
        made = step
        for axle, fitted in self.axles.items():
            slips = np.abs(outputs[:, self.engine.outputs.index(f"{axle}_slip_angle")])
            made = fitted.moved(self.coordinates, shared, made, float(np.quantile(slips, REACHED)))
        return self.inside(shared + made) - shared

    @cached_property
    def initial_std(self) -> Array:
        """(w, local) of the priors of the initial states around ``initial_local``, infinite where none.

        They are wider than what a moving vehicle tells; one that crawls forgets how it began, and data that
        say nothing of the beginning must not throw it far away.
        """
        made = np.full((len(self.windows.records), self.local), np.inf)
        for number, name in enumerate(self.engine.states):
            for window, record in enumerate(self.windows.records):
                if name in INITIAL_STD:
                    made[window, number] = INITIAL_STD[name][0 if name in record.measured else 1]
        return made

    @cached_property
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
        return np.array([state.get(name, 0.0) for name in self.engine.states])

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
        inputs, _ = self.driven(shared, of_runs)
        return self.engine.simulate(states, inputs, w.steps, w.offsets, self.parameters(shared, of_runs))

    def residuals(self, shared: Array, of_runs: Array, local: Array) -> dict[str, Residuals]:
        """Residuals and derivatives of every compared signal."""
        w = self.windows
        states = np.ascontiguousarray(local[:, : self.states])
        inputs, chain = self.driven(shared, of_runs)
        _, outputs, derivatives = self.engine.sensitivities(
            states,
            inputs,
            w.steps,
            w.offsets,
            self.parameters(shared, of_runs),
            active=self.active,
            input_derivatives=chain,
            wanted=self._wanted,
        )
        made = {name: self._of_signal(name, outputs, derivatives, shared, of_runs) for name in self._wanted}
        if ACROSS in self.compared:
            made |= self._turned(made.pop("position_x"), made.pop("position_y"), local)
        return {name: made[name] for name in self.compared}

    def errors(self, outputs: Array, shared: Array, of_runs: Array, local: Array) -> dict[str, Residuals]:
        """Residuals of every compared signal alone, without any derivative.

        outputs : (N, y) as :meth:`simulate` gives them
        """
        made = {}
        for name in self._wanted:
            samples, column = self.windows.signals[name], self.engine.outputs.index(name)
            model = self._placed(name, shared).at(outputs[:, column : column + 1])
            for number, times in self._terms_of(name):
                model = model + (times * of_runs[self.windows.run[samples.window], number])[:, None]
            made[name] = Residuals(samples, samples.values[:, None] - model)
        if ACROSS in self.compared:
            x, y = (made.pop(name) for name in POSITION)
            moved = local[x.samples.window, self.states :]
            for name, one in self._along_and_across(x.columns, y.columns).items():
                shift = np.sum(self._anchors[name] * moved, axis=1, keepdims=True)
                made[name] = Residuals(x.samples, one - shift)
        return {name: made[name] for name in self.compared}

    def probed(
        self, shared: Array, of_runs: Array, local: Array, probes: Sequence[Probe]
    ) -> dict[str, Array]:
        """(n, p) what each disturbance does to every compared signal, at first order; at most UPSTREAM."""
        w, names = self.windows, [f"probe {number}" for number in range(len(probes))]
        inputs, _ = self.driven(shared, of_runs)
        chain = np.zeros((*inputs.shape, len(probes)))
        for number, probe in enumerate(probes):
            for name, values in probe.inputs.items():
                chain[:, self.engine.inputs.index(name), number] = values
        _, _, derivatives = self.engine.sensitivities(
            np.ascontiguousarray(local[:, : self.states]),
            inputs,
            w.steps,
            w.offsets,
            self.parameters(shared, of_runs),
            active=names,
            input_derivatives=chain,
            wanted=self._wanted,
        )
        made = {}
        for row, name in enumerate(self._wanted):
            at = self._placed(name, shared).at(derivatives[row][:, self.states :])
            for number, probe in enumerate(probes):
                at[:, number] += probe.signals.get(name, 0.0)
            made[name] = at
        if ACROSS in self.compared:
            made |= self._along_and_across(made.pop("position_x"), made.pop("position_y"))
        return {name: made[name] for name in self.compared}

    def driven(self, shared: Array, of_runs: Array) -> tuple[Array, Array | None]:
        """(N, u) inputs of the model, and (N, u, active) their derivatives where any coordinate moves them.

        The road-wheel angle falls with the steering ratio, -angle/ratio; blocks stand behind that.

        of_runs : (runs, b) terms of the runs, among them where a play begins
        """
        inputs = np.zeros((len(self.windows.inputs), len(self.engine.inputs)))
        inputs[:, :2] = self.windows.inputs
        names = [one.name for one in self.coordinates]
        upstream = {STEERING_RATIO, *self.around.names} & set(names)
        if not upstream:
            return inputs, None
        chain = np.zeros((*inputs.shape, len(self.active)))
        if STEERING_RATIO in names:
            chain[:, 0, len(self._inner) + names.index(STEERING_RATIO)] = -inputs[:, 0]
        values = self.values(shared)
        for coordinate, push in self.around.pushes.items():
            for name, added in push.items():
                place = self.engine.inputs.index(name)
                inputs[:, place] += values[coordinate] * added
                chain[:, place, len(self._inner) + names.index(coordinate)] += added
        if self.around.blocks:
            terms = {term.name: of_runs[:, number] for number, term in enumerate(self.run_terms)}
            placed = placed_blocks(self.around.blocks, values, terms, self._stretch_places, self.active)
            stretches = self.windows.stretches
            inputs[:, 0], chain[:, 0] = through_blocks(placed, stretches, inputs[:, 0], chain[:, 0])
        return inputs, chain

    @property
    def begins(self) -> NDArray[np.intp]:
        """Places of those terms of the runs that say where a block begins: initial states, in a way."""
        return np.array([i for i, term in enumerate(self.run_terms) if term.name in self._begins], dtype=int)

    def _placed(self, name: str, shared: Array) -> SignalSamples:
        """The samples of a signal on the grid, of a late sensor where the vehicle was when it read."""
        if name not in self.around.late:
            return self.windows.signals[name]
        return self.windows.later(name, self.values(shared)[self.around.late[name]])

    def _of_signal(
        self, name: str, outputs: Array, derivatives: Array, shared: Array, of_runs: Array
    ) -> Residuals:
        samples, placed = self.windows.signals[name], self._placed(name, shared)
        column = self.engine.outputs.index(name)
        grid = np.column_stack([outputs[:, column], derivatives[self._wanted.index(name)]])
        at = placed.at(grid)
        model, by_state, by_parameter = at[:, 0], at[:, 1 : 1 + self.states], at[:, 1 + self.states :]
        if name in self.around.late:
            own_delay = self.active.index(self.around.late[name])
            by_parameter[:, own_delay] -= placed.slopes(grid[:, :1])[:, 0]
        own = np.zeros((len(at), len(self.run_terms)))
        own[:, self._inner] = by_parameter[:, : len(self._inner)]
        for number, times in self._terms_of(name):
            own[:, number] = times
            model = model + times * of_runs[self.windows.run[samples.window], number]
        anchors = np.zeros((len(at), self.anchors))
        slopes = np.array([one.slope(at) for one, at in zip(self.coordinates, shared, strict=True)])
        by_shared = by_parameter[:, len(self._inner) :] * slopes
        return Residuals(
            samples, np.column_stack([by_state, anchors, own, by_shared, samples.values - model])
        )

    def _terms_of(self, name: str) -> Iterator[tuple[int, Array]]:
        """Terms of the runs that are added to a signal: number and (n,) derivative."""
        samples = self.windows.signals[name]
        for number, term in enumerate(self.run_terms):
            if name in (term.name, term.by_speed_to):
                speed = term.by_speed_to is not None
                times = (
                    samples.at(self.windows.inputs[:, 1:2])[:, 0] if speed else np.ones(samples.times.size)
                )
                yield number, times

    def with_changed(self, **parts: Any) -> VehicleProblem:
        """The same windows with other ``coordinates``, ``fixed``, ``run_terms``, ``around`` or ``tyres``."""
        names = ("coordinates", "fixed", "run_terms", "around", "tyres")
        kept = {name: getattr(self, name) for name in names}
        return VehicleProblem(self.engine, self.windows, **(kept | parts))

    def _along_and_across(self, x: Array, y: Array) -> dict[str, Array]:
        cosine, sine = np.cos(self._course)[:, None], np.sin(self._course)[:, None]
        return {ALONG: cosine * x + sine * y, ACROSS: cosine * y - sine * x}

    def _turned(self, x: Residuals, y: Residuals, local: Array) -> dict[str, Residuals]:
        made = self._along_and_across(x.columns, y.columns)
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
