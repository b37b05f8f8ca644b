"""The motion of the vehicle as a layer of the loop: steering angle and speed to what the motion sensors read.

The base model is the planar bicycle with Magic Formula axles, without offset, bias or bank: those are effects
like the others, so that the loop says which of them the data call for. What stays in the base is the heading
of the pose, which is a matter of mounting and of maps, and the reference point where nobody states it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.bicycle import bicycle
from ident.dynamics.effects import ROAD_BANK, STEERING_OFFSET
from ident.dynamics.effects.catalogue import CATALOGUE
from ident.dynamics.effects.load_transfer import HEIGHT
from ident.dynamics.effects.probes import PROBES
from ident.dynamics.effects.tyre_relaxation import LENGTH, shortest_length
from ident.dynamics.engine import Engine, compiled
from ident.estimation.gauss_newton import minimise
from ident.estimation.layer import SIZE, EffectCard, HeldOut, LayerScores, Likelihood
from ident.estimation.motion_effects import LEAD, MotionEffect, motion_effects, testable
from ident.estimation.motion_scores import Projection
from ident.estimation.motion_screen import MotionDirections, motion_directions
from ident.estimation.tyre_fit import BANK, SENSOR_BIAS, WINDOW, Body, coordinates_of
from ident.estimation.vehicle_fit import (
    NEGLIGIBLE,
    VehicleFit,
    fit_vehicle,
    identify_noise,
    inflation,
    rough_point,
)
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_problem import Around, Coordinate, RunTerm, VehicleProblem
from ident.estimation.vehicle_records import MotionRecord, Windows, cut
from ident.results import EffectEstimate, Estimate, Refusal

Array = NDArray[np.float64]
Index = NDArray[np.intp]

KIND = "magic_formula"
HEADING = RunTerm("heading", SENSOR_BIAS["heading"])
PARTS_ORDER = (
    "wheel_speed_scale",
    "steering_ratio_nonlinearity",
    "tyre_relaxation",
    "load_transfer",
    "body_roll",
)
NOISE_ROUNDS = 3
ITERATIONS = 10
SETTLING = 4  # steps of initial states alone
MOST_STARTS = 6
Z = 1.959964
EITHER_SIGN = {
    *("steering_offset", "sensor_bias", "road_bank", "antenna_offset"),
    *("steering_ratio_nonlinearity", "wheel_speed_scale"),
}
TOLD_AS = {
    ("steering_offset", "steering_offset"): "angle",
    ("road_bank", "bank_cos"): "bank_cos",
    ("road_bank", "bank_sin"): "bank_sin",
}


def told_as(effect: MotionEffect, name: str) -> str:
    """Name of a parameter of an effect in the JSON."""
    if effect.name == "sensor_bias":
        return "bias"
    return TOLD_AS.get((effect.name, name), name.rpartition(".")[2])


def engine_of(effects: Sequence[MotionEffect], kind: str = KIND) -> Engine:
    """The compiled bicycle with these effects; probes stand last."""
    parts = sorted((part for one in effects for part in one.parts), key=lambda p: PARTS_ORDER.index(p.name))
    return compiled(bicycle(kind, kind, (STEERING_OFFSET, ROAD_BANK, *parts, PROBES)))


@dataclass(frozen=True)
class MotionLayer:
    """See :class:`~ident.estimation.layer.Layer`.

    records : whole stretches of the runs; runs : their names, in the order of the records' indices
    body : mass and distances; start : parameters of the axles and yaw inertia to begin with
    floor : signal -> least standard deviation of its noise
    height_over_track : where the vehicle file says both
    base_terms : terms of the runs that the base holds
    """

    records: Sequence[MotionRecord]
    runs: list[str]
    body: Body
    start: Mapping[str, float]
    floor: Mapping[str, float]
    height_over_track: float | None = None
    base_terms: tuple[RunTerm, ...] = (HEADING,)
    name: str = "motion"

    @cached_property
    def windows(self) -> Windows:
        """Windows of the fit, each with room for late sensors."""
        return Windows([part for record in self.records for part in cut(record, WINDOW, LEAD)])

    @cached_property
    def effects(self) -> dict[str, MotionEffect]:
        """The effects that these data can test, by key."""
        signals = list(self.windows.signals)
        return {key: one for key, one in motion_effects().items() if testable(one, signals) is None}

    @property
    def not_testable(self) -> list[Refusal]:
        """Effects that these data cannot test."""
        signals = list(self.windows.signals)
        told = {key: testable(one, signals) for key, one in motion_effects().items()}
        return [Refusal(key, why) for key, why in told.items() if why is not None]

    def problem(self, keys: Sequence[str]) -> VehicleProblem:
        """The base model with these effects."""
        effects = [self.effects[key] for key in keys]
        engine = engine_of(effects)
        coordinates = [
            one
            for one in coordinates_of(KIND, self.body, reference=self._reference_open)
            if one.name != "steering_offset"
        ]
        coordinates += [self._bounded(one) for effect in effects for one in effect.coordinates]
        own = {one.name for one in coordinates}
        given = {"mass": self.body.mass, "steering_offset": 0.0, **dict.fromkeys(BANK, 0.0)}
        given |= {n: float(getattr(self.body, n)) for n in ("cg_to_front_axle", "cg_to_rear_axle")}
        given[HEIGHT.name] = self.height_over_track or HEIGHT.typical
        fixed = {
            name: value for name, value in given.items() if name in engine.parameters and name not in own
        }
        terms = [*self.base_terms, *(term for effect in effects for term in effect.run_terms)]
        around = Around(
            tuple(block for effect in effects for block in effect.blocks),
            {signal: name for effect in effects for signal, name in (effect.late or {}).items()},
        )
        return VehicleProblem(engine, self.windows, coordinates, fixed, terms, around)

    @property
    def _reference_open(self) -> bool:
        used = any(n in r.measured for r in self.records for n in ("lateral_velocity", "position_x"))
        return used and not any(record.reference_known for record in self.records)

    def _bounded(self, one: Coordinate) -> Coordinate:
        """No shorter relaxation length than the grid carries."""
        if one.name != LENGTH.name:
            return one
        shortest = max(shortest_length(r.speed, r.period) for r in self.records)
        return replace(one, low=max(one.low, float(np.log(shortest))))

    def fitted(
        self,
        keys: Sequence[str] = (),
        *,
        start: MotionFit | None = None,
        shapes: Mapping[str, Sequence[Mapping[str, float]]] | None = None,
    ) -> MotionFit:
        """See :class:`~ident.estimation.layer.Layer`."""
        problem = self.problem(keys)
        points = [self._point(problem, keys, start, one) for one in self._starts(keys, shapes or {})]
        noise = start.point.noise if start else None
        if noise is None:
            first = rough_point(problem, points[0].shared)
            return MotionFit(self, tuple(keys), first).renoised()
        tried = [_minimised(point) for point in points if np.isfinite(point.value)]
        if not tried:
            raise ValueError(f"the model blows up with {', '.join(keys)}")
        return MotionFit(self, tuple(keys), min(tried, key=lambda point: point.value))

    def _starts(
        self, keys: Sequence[str], shapes: Mapping[str, Sequence[Mapping[str, float]]]
    ) -> list[dict[str, float]]:
        """Values of the effects' coordinates to begin with, one for each combination of shapes."""
        own = [[self._named(key, one) for one in shapes.get(key) or [{}]] for key in keys]
        made = [{k: v for part in parts for k, v in part.items()} for parts in product(*own)]
        return made[:MOST_STARTS]

    def _named(self, key: str, given: Mapping[str, float]) -> dict[str, float]:
        """Values to begin with by the names of coordinates; "size" stands for the first of the effect."""
        effect = self.effects[key]
        made = {name: value for name, value in given.items() if name != SIZE}
        if effect.coordinates and SIZE in given and effect.coordinates[0].name not in made:
            made[effect.coordinates[0].name] = given[SIZE]
        return made

    def _point(
        self,
        problem: VehicleProblem,
        keys: Sequence[str],
        start: MotionFit | None,
        given: Mapping[str, float],
    ) -> VehiclePoint:
        """Where a fit begins: at a fit with fewer effects, or at the start of the layer."""
        known = dict(self.start) if start is None else dict(start.parameters)
        typical = {
            one.name: size.typical if one.logarithmic or one is not effect.coordinates[0] else 0.0
            for effect in (self.effects[key] for key in keys)
            for one, size in zip(effect.coordinates, effect.sizes.values(), strict=True)
        }
        possible = {
            name: value
            for name, value in given.items()
            if value > 0 or name not in typical or not typical[name]
        }
        values = {**typical, **known, **possible}
        shared = np.array([one.coordinate(values.get(one.name, 0.0)) for one in problem.coordinates])
        of_runs = np.zeros((problem.windows.runs, len(problem.run_terms)))
        local = problem.initial_local
        if start is not None:
            before = start.point
            if before.problem.windows is problem.windows:
                of_runs = _terms_of(problem, before)
            begun = _begun(problem, [self.effects[key] for key in keys], before)
            problem.initial_local[:, : problem.states] += begun
            local = _local_of(problem, before, problem.initial_local)
        noise = {} if start is None else start.point.noise
        return VehiclePoint(problem, problem.inside(shared), of_runs, local, noise)

    def without(self, runs: Sequence[str]) -> MotionLayer:
        """See :class:`~ident.estimation.layer.Layer`."""
        kept = [name for name in self.runs if name not in runs]
        return self.of_runs(kept)

    def of_runs(self, kept: Sequence[str]) -> MotionLayer:
        """The layer of some of its runs."""
        place = {self.runs.index(name): number for number, name in enumerate(kept)}
        records = [replace(r, run=place[r.run]) for r in self.records if r.run in place]
        return replace(self, records=records, runs=list(kept))

    def effect(self, key: str) -> EffectCard:
        """See :class:`~ident.estimation.layer.Layer`."""
        effect = motion_effects()[key]
        entry, size = CATALOGUE[effect.name], next(iter(effect.sizes.values()))
        return EffectCard(
            name=effect.name,
            enters=entry.enters,
            of=effect.of,
            size=entry.parameters[0].name,
            unit=size.unit,
            typical=abs(size.typical),
            equation=entry.equation,
            meaning=entry.meaning,
            shown_by=entry.shown_by,
            positive=effect.name not in EITHER_SIGN,
            meanings={told_as(effect, one.name): one.meaning for one in effect.sizes.values()},
        )

    def held_out(self, fit: MotionFit, runs: Sequence[str]) -> HeldOut:
        """See :class:`~ident.estimation.layer.Layer`."""
        layer = self.of_runs(runs)
        problem = layer.problem(fit.keys)
        mean = fit.point.of_runs.mean(axis=0) if fit.point.of_runs.size else np.zeros(0)
        names = [term.name for term in fit.point.problem.run_terms]
        of_runs = np.array(
            [[mean[names.index(t.name)] if t.name in names else 0.0 for t in problem.run_terms]] * len(runs)
        ).reshape(len(runs), len(problem.run_terms))
        point = VehiclePoint(problem, fit.point.shared, of_runs, problem.initial_local, fit.point.noise)
        return _errors(_settled(point))


def _begun(problem: VehicleProblem, effects: Sequence[MotionEffect], before: VehiclePoint) -> Array:
    """(w, x) where the states that effects bring begin: at what the model without them says, else at zero."""
    made = np.zeros((len(problem.windows.records), problem.states))
    begins = {s: o for effect in effects for part in effect.parts for s, o in part.begins.items()}
    if not begins or before.problem.windows is not problem.windows:
        return made
    _, outputs = before.problem.simulate(before.shared, before.of_runs, before.local)
    first = problem.windows.offsets[:-1]
    for state, output in begins.items():
        if state not in before.problem.engine.states:
            made[:, problem.engine.states.index(state)] = outputs[
                first, before.problem.engine.outputs.index(output)
            ]
    return made


def _minimised(point: VehiclePoint) -> VehiclePoint:
    """Maximum likelihood under the noise as it is; one that lacks much needs not be followed to the end."""
    return minimise(point, ITERATIONS, negligible=NEGLIGIBLE)[0]


def _terms_of(problem: VehicleProblem, before: VehiclePoint) -> Array:
    """(runs, b) terms of the runs of a fit, for a model that may have more or fewer of them."""
    made = np.zeros((problem.windows.runs, len(problem.run_terms)))
    names = [term.name for term in before.problem.run_terms]
    for number, term in enumerate(problem.run_terms):
        if term.name in names:
            made[:, number] = before.of_runs[:, names.index(term.name)]
    return made


def _local_of(problem: VehicleProblem, before: VehiclePoint, local: Array) -> Array:
    """Initial states of a fit, for a model that may have more or fewer states."""
    made, old = local.copy(), before.problem.engine.states
    if before.problem.windows is not problem.windows:
        return made
    for number, name in enumerate(problem.engine.states):
        if name in old:
            made[:, number] = before.local[:, old.index(name)]
    if before.problem.anchors == problem.anchors:
        made[:, problem.states :] = before.local[:, before.problem.states :]
    return made


def _settled(point: VehiclePoint) -> VehiclePoint:
    """Initial states adapted, all else as it is."""
    known = point.noise
    point = replace(point, noise={name: known[name] for name in point.problem.compared if name in known})
    nothing = np.zeros(len(point.problem.run_terms) + point.shared.size)
    for _ in range(SETTLING):
        steps = np.array([window.step(nothing) for window in point.windows])
        tried = replace(point, local=point.local + steps)
        if not tried.value < point.value * (1 - 1e-9):
            break
        point = tried
    return point


def _errors(point: VehiclePoint) -> HeldOut:
    residuals = point.residuals
    windows = point.problem.windows
    bins = Projection(point)
    return HeldOut(
        errors={name: one.residual for name, one in residuals.items()},
        modelled={name: one.samples.values - one.residual for name, one in residuals.items()},
        run={name: windows.run[one.samples.window] for name, one in residuals.items()},
        time={name: one.samples.times for name, one in residuals.items()},
        likelihood=Likelihood(bins.bins.run, bins.bins.time, bins.likelihood()),
    )


@dataclass(frozen=True)
class MotionFit:
    """See :class:`~ident.estimation.layer.LayerFit`; ``point``: the maximum likelihood, and its noise."""

    layer: MotionLayer
    keys: tuple[str, ...]
    point: VehiclePoint

    @property
    def freedom(self) -> int:
        """Parameters that the effects add."""
        return sum(self.layer.effects[key].freedom for key in self.keys)

    @property
    def parameters(self) -> dict[str, float]:
        """Of the model, by name."""
        return self.point.problem.values(self.point.shared)

    def renoised(self) -> MotionFit:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        point = self.point
        for number in range(NOISE_ROUNDS):
            point = _minimised(point)
            noise, _ = identify_noise(point, self.layer.floor, keep_order=number > 1)
            point = replace(point, noise=noise)
        return MotionFit(self.layer, self.keys, _minimised(point))

    @cached_property
    def projection(self) -> Projection:
        """What the fit takes up of any direction."""
        return Projection(self.point)

    @cached_property
    def final(self) -> VehicleFit:
        """The fit as it is reported: least squares where something is left that is no noise."""
        return fit_vehicle(self.point.problem, [self.point.shared], floor=self.layer.floor)

    def scores(self) -> LayerScores:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return self.directions().scores()

    def directions(self) -> MotionDirections:
        """What is looked for at this fit; of use for other measurements of the same runs, too."""
        candidates = [one for key, one in self.layer.effects.items() if key not in self.keys]
        return motion_directions(self.point, self.projection, candidates, self.layer.body)

    def likelihood(self, like: MotionFit | None = None) -> Likelihood:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        projection = self.projection
        if like is not None and like.point.noise is not self.point.noise:
            point = _minimised(replace(self.point, noise=like.point.noise))
            projection = Projection(point)
        return Likelihood(projection.bins.run, projection.bins.time, projection.likelihood())

    def rms(self) -> dict[str, float]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return {n: float(np.sqrt(np.mean(one.residual**2))) for n, one in self.point.residuals.items()}

    def noise(self) -> dict[str, float]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return {name: one.total_std for name, one in self.point.noise.items()}

    def estimates(self) -> dict[str, EffectEstimate]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return {key: self._estimate(self.layer.effects[key]) for key in self.keys}

    def _estimate(self, effect: MotionEffect) -> EffectEstimate:
        fit = self.final
        names = [one.name for one in fit.point.problem.coordinates]
        made = {}
        for name, parameter in effect.sizes.items():
            short = told_as(effect, parameter.name)
            if name in names:
                index = names.index(name)
                made[short] = _of_coordinate(
                    fit.point.problem.coordinates[index],
                    float(fit.shared[index]),
                    float(np.sqrt(fit.covariance[index, index])),
                    parameter.unit,
                )
            else:
                value, std = self._mean_of_runs(fit, name)
                made[short] = Estimate(value, std, value - Z * std, value + Z * std, parameter.unit)
        return EffectEstimate(effect.name, CATALOGUE[effect.name].enters, made, effect.of)

    def _mean_of_runs(self, fit: VehicleFit, term: str) -> tuple[float, float]:
        values, std = self._of_runs(fit, term)
        weight = 1 / std**2
        return float(values @ weight / weight.sum()), float(1 / np.sqrt(weight.sum()))

    def _of_runs(self, fit: VehicleFit, term: str) -> tuple[Array, Array]:
        number = [one.name for one in fit.point.problem.run_terms].index(term)
        spread = [run.own_covariance(fit.covariance)[number, number] for run in fit.point.by_run]
        return fit.point.of_runs[:, number], np.sqrt(np.array(spread) * inflation(fit))

    def sizes_by_run(self, key: str) -> tuple[Array, Array]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        effect, fit = self.layer.effects[key], self.final
        size = next(iter(effect.sizes))
        if effect.run_terms:
            return self._of_runs(fit, size)
        names = [one.name for one in fit.point.problem.coordinates]
        index, wider = names.index(size), inflation(fit)
        coordinate = fit.point.problem.coordinates[index]
        slope = coordinate.slope(float(fit.shared[index]))
        values, stds = [], []
        for run in fit.point.by_run:
            own, rest = run.rows[:, index], run.rows[:, -1]
            told = float(own @ own)
            values.append(
                coordinate.value(float(fit.shared[index])) + slope * float(own @ rest) / max(told, 1e-300)
            )
            stds.append(slope * np.sqrt(wider / told) if told > 0 else np.inf)
        return np.array(values), np.array(stds)

    def is_allowed(self) -> dict[str, str]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        coordinates = {
            one.name: (one, at)
            for one, at in zip(self.point.problem.coordinates, self.point.shared, strict=True)
        }
        told = {}
        for key in self.keys:
            for name in self.layer.effects[key].sizes:
                if name not in coordinates:
                    continue
                one, at = coordinates[name]
                if not one.low < at < one.high and name == next(iter(self.layer.effects[key].sizes)):
                    told[key] = (
                        f"{name.rpartition('.')[2]} runs to {one.value(at):.3g}, the end of what is possible"
                    )
        return told


def _of_coordinate(one: Coordinate, at: float, std: float, unit: str) -> Estimate:
    value = one.value(at)
    ends = [one.value(at - Z * std), one.value(at + Z * std)]
    return Estimate(value, std * one.slope(at), ends[0], ends[1], unit)
