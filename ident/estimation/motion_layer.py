"""The motion of the vehicle as a layer of the loop: steering angle and speed to what the motion sensors read.

The base model is the planar bicycle with Magic Formula axles, without offset, bias or bank: those are effects
like the others, so that the loop says which of them the data call for. What stays in the base is the heading
of the pose, which is a matter of mounting and of maps, and the reference point where nobody states it.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.bicycle import bicycle
from ident.dynamics.effects import ROAD_BANK, STEERING_OFFSET
from ident.dynamics.effects.load_transfer import HEIGHT
from ident.dynamics.effects.probes import PROBES
from ident.dynamics.effects.tyre_relaxation import LENGTH, shortest_length
from ident.dynamics.engine import Engine, compiled
from ident.dynamics.tyres import tyre_of
from ident.estimation.adaptive_smoothing import ANGLES, adaptively_smoothed
from ident.estimation.coordinates import Coordinate, RunTerm
from ident.estimation.input_noise import (
    UNSMOOTHED,
    InputNoise,
    input_noise,
    with_smooth_inputs,
    with_smooth_speed,
)
from ident.estimation.layer import SIZE, DoesNotFit, EffectCard, HeldOut, LayerFit
from ident.estimation.motion_basis import pushed_by, trajectory_of
from ident.estimation.motion_effects import (
    LEAD,
    MotionEffect,
    card_of,
    motion_effects,
    testable,
)
from ident.estimation.motion_fit import MotionFit, motion_fit, motion_fit_or_none
from ident.estimation.motion_scores import Projection
from ident.estimation.motion_starts import (
    begun_states,
    initial_states,
    minimised,
    settled,
    terms_of_runs,
)
from ident.estimation.own_noise import OwnNoise, own_noise
from ident.estimation.path_parts import travelled
from ident.estimation.tyre_fit import BANK, SENSOR_BIAS, WINDOW, Body, coordinates_of
from ident.estimation.vehicle_fit import (
    rough_point,
)
from ident.estimation.vehicle_inputs import Around, begin_terms
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_problem import ACROSS, ALONG, POSITION, VehicleProblem
from ident.estimation.vehicle_records import MotionRecord, Windows, cut
from ident.glossary import AXLES
from ident.results import Refusal

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
MOST_STARTS = 6
SMALL = 0.25  # of a size at first order
FARTHEST = float(np.log(3.0))  # of the logarithm of the yaw inertia: beyond, it stands in for something else


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
    terms : generic term, such as "yaw_moment: r|r|" -> input of the model -> for each record, and each of its
        windows, what a unit of it adds there
    """

    records: Sequence[MotionRecord]
    runs: list[str]
    body: Body
    start: Mapping[str, float]
    floor: Mapping[str, float]
    height_over_track: float | None = None
    base_terms: tuple[RunTerm, ...] = (HEADING,)
    terms: Mapping[str, Mapping[str, tuple[tuple[Array, ...], ...]]] = field(default_factory=dict)
    name: str = "motion"

    @cached_property
    def windows(self) -> Windows:
        """Windows of the fit, each with room for late sensors."""
        records = [with_smooth_inputs(record) for record in self.records]
        return Windows([part for record in records for part in cut(record, WINDOW, LEAD)])

    @cached_property
    def calm_windows(self) -> Windows:
        """The same for a model with corners before it: their angle is smoothed for as long as it rests."""
        records = [with_smooth_speed(record) for record in self.records]
        measured = Windows([part for record in records for part in cut(record, WINDOW, LEAD)])
        made = copy.copy(self.windows)
        made.inputs = adaptively_smoothed(made, measured.inputs, self._measured_noise)
        return made

    @cached_property
    def input_noise(self) -> list[InputNoise]:
        """What is left in the inputs of the windows."""
        return input_noise(self.records)

    @cached_property
    def own_noise(self) -> list[OwnNoise]:
        """Of the inputs, as their calm parts show it."""
        return own_noise(self.records)

    @property
    def _measured_noise(self) -> list[OwnNoise]:
        """The same where the angle is as it was measured."""
        return [replace(one, smoothing=UNSMOOTHED) if one.name in ANGLES else one for one in self.own_noise]

    def noise_of(self, problem: VehicleProblem) -> list[OwnNoise]:
        """Of the inputs, as that model has them before they are smoothed."""
        return self._measured_noise if problem.around.has_corners else self.own_noise

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
        effects, generic = self._effects(keys), [key for key in keys if key in self.terms]
        engine = engine_of(effects)
        coordinates = [
            self._bounded(one)
            for one in coordinates_of(KIND, self.body, reference=self._reference_open)
            if one.name != "steering_offset"
        ]
        coordinates += [self._bounded(one) for effect in effects for one in effect.coordinates]
        coordinates += [Coordinate(key, logarithmic=False) for key in generic]
        own = {one.name for one in coordinates}
        given = {"mass": self.body.mass, "steering_offset": 0.0, **dict.fromkeys(BANK, 0.0)}
        given |= {n: float(getattr(self.body, n)) for n in ("cg_to_front_axle", "cg_to_rear_axle")}
        given[HEIGHT.name] = self.height_over_track or HEIGHT.typical
        fixed = {
            name: value for name, value in given.items() if name in engine.parameters and name not in own
        }
        blocks = tuple(block for effect in effects for block in effect.blocks)
        terms = [*self.base_terms, *(term for effect in effects for term in effect.run_terms)]
        around = Around(
            blocks,
            {signal: name for effect in effects for signal, name in (effect.late or {}).items()},
            {key: self._pushes(key) for key in generic},
        )
        windows = self.calm_windows if around.has_corners else self.windows
        terms += begin_terms(blocks, windows)
        tyres = {axle: (tyre_of(KIND), self.body.load(axle)) for axle in AXLES}
        return VehicleProblem(engine, windows, coordinates, fixed, terms, around, tyres)

    def _effects(self, keys: Sequence[str]) -> list[MotionEffect]:
        """Those of the keys that are no generic terms."""
        return [self.effects[key] for key in keys if key not in self.terms]

    def _pushes(self, key: str) -> dict[str, Array]:
        """(N,) what a unit of a generic term adds to each input, on the grid of all windows."""
        return {
            name: np.concatenate([part for record in parts for part in record])
            for name, parts in self.terms[key].items()
        }

    def with_term(self, key: str, at: Mapping[str, float], fit: LayerFit) -> MotionLayer | None:
        """See :class:`~ident.estimation.layer.Layer`; its function is that of the motion of the fit."""
        fit = motion_fit(fit)
        pushed = pushed_by(key, at, trajectory_of(fit.point), fit.parameters)
        if pushed is None:
            return None
        counts = [len(cut(record, WINDOW, LEAD)) for record in self.records]
        edges = np.cumsum([0, *counts])
        made = {}
        for name, values in pushed.items():
            parts = np.split(values, self.windows.offsets[1:-1])
            made[name] = tuple(tuple(parts[i:j]) for i, j in pairwise(edges.tolist()))
        layer = replace(self, terms={**self.terms, key: made})
        layer.__dict__["windows"] = self.windows  # the same, so that fits carry over
        return layer

    @property
    def _reference_open(self) -> bool:
        used = any(n in r.measured for r in self.records for n in ("lateral_velocity", "position_x"))
        return used and not any(record.reference_known for record in self.records)

    def _bounded(self, one: Coordinate) -> Coordinate:
        """A yaw inertia that a vehicle may have; no shorter relaxation length than the grid carries."""
        if one.name == "yaw_inertia":
            return replace(one, low=one.prior_mean - FARTHEST, high=one.prior_mean + FARTHEST)
        if one.name != LENGTH.name:
            return one
        shortest = max(shortest_length(r.speed, r.period) for r in self.records)
        return replace(one, low=max(one.low, float(np.log(shortest))))

    def fitted(
        self,
        keys: Sequence[str] = (),
        *,
        start: LayerFit | None = None,
        shapes: Mapping[str, Sequence[Mapping[str, float]]] | None = None,
    ) -> MotionFit:
        """See :class:`~ident.estimation.layer.Layer`."""
        problem, start = self.problem(keys), motion_fit_or_none(start)
        points = [self._point(problem, keys, start, one) for one in self._starts(keys, shapes or {})]
        noise = start.point.noise if start else None
        if noise is None:
            first = rough_point(problem, points[0].shared)
            return MotionFit(self, tuple(keys), first).renoised()
        tried = [minimised(point) for point in points if np.isfinite(point.value) and point.smooth]
        if not tried:
            raise DoesNotFit(f"the model blows up with {', '.join(keys)}")
        return MotionFit(self, tuple(keys), min(tried, key=lambda point: point.value))

    def _starts(
        self, keys: Sequence[str], shapes: Mapping[str, Sequence[Mapping[str, float]]]
    ) -> list[dict[str, float]]:
        """Values of the effects' coordinates to begin with, one for each combination of shapes."""
        own = [
            [self._named(key, one) for one in self._sizes(key, shapes.get(key) or [{}])]
            for key in keys
            if key in self.effects
        ]
        made = [{k: v for part in parts for k, v in part.items()} for parts in product(*own)]
        return made[:MOST_STARTS]

    def _sizes(self, key: str, given: Sequence[Mapping[str, float]]) -> list[Mapping[str, float]]:
        """The same; of an effect that bends curves also from a part of its size."""
        if not self.effects[key].bends:
            return list(given)
        return [*given, *({**one, SIZE: SMALL * one[SIZE]} for one in given if SIZE in one)]

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
            for effect in self._effects(keys)
            for one, size in zip(effect.coordinates, effect.sizes.values(), strict=False)
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
            if before.problem.windows.same_as(problem.windows):
                of_runs = terms_of_runs(problem, before)
            begun = begun_states(problem, self._effects(keys), before)
            problem.initial_local[:, : problem.states] += begun
            local = initial_states(problem, before, problem.initial_local)
        noise = {} if start is None else start.point.noise
        return VehiclePoint(problem, problem.inside(shared), of_runs, local, noise)

    def without(self, runs: Sequence[str]) -> MotionLayer:
        """See :class:`~ident.estimation.layer.Layer`."""
        kept = [name for name in self.runs if name not in runs]
        return self.of_runs(kept)

    def of_runs(self, kept: Sequence[str]) -> MotionLayer:
        """The layer of some of its runs."""
        place = {self.runs.index(name): number for number, name in enumerate(kept)}
        inside = [number for number, r in enumerate(self.records) if r.run in place]
        inside.sort(key=lambda number: place[self.records[number].run])
        records = [replace(self.records[n], run=place[self.records[n].run]) for n in inside]
        terms = {
            key: {name: tuple(parts[n] for n in inside) for name, parts in one.items()}
            for key, one in self.terms.items()
        }
        return replace(self, records=records, runs=list(kept), terms=terms)

    def effect(self, key: str) -> EffectCard:
        """See :class:`~ident.estimation.layer.Layer`."""
        return card_of(motion_effects()[key])

    def held_out(self, fit: LayerFit, runs: Sequence[str]) -> HeldOut:
        """See :class:`~ident.estimation.layer.Layer`."""
        layer, fit = self.of_runs(runs), motion_fit(fit)
        problem = layer.problem(fit.keys)
        mean = fit.point.of_runs.mean(axis=0) if fit.point.of_runs.size else np.zeros(0)
        known = {t.name: float(m) for t, m in zip(fit.point.problem.run_terms, mean, strict=True)}
        own = np.array([known.get(term.name, 0.0) for term in problem.run_terms])
        own[problem.begins] = 0.0
        of_runs = np.tile(own, (len(runs), 1))
        point = VehiclePoint(problem, fit.point.shared, of_runs, problem.initial_local, fit.point.noise)
        return _errors(settled(point))


def _errors(point: VehiclePoint) -> HeldOut:
    residuals = point.residuals
    windows = point.problem.windows
    measured = {name: one.samples.values for name, one in residuals.items()}
    if ALONG in residuals:
        along = travelled(windows, *(windows.signals[name] for name in POSITION))
        measured |= {ALONG: along, ACROSS: np.zeros_like(along)}
    return HeldOut(
        errors={name: one.residual for name, one in residuals.items()},
        modelled={name: measured[name] - one.residual for name, one in residuals.items()},
        run={name: windows.run[one.samples.window] for name, one in residuals.items()},
        time={name: one.samples.times for name, one in residuals.items()},
        likelihood=Projection(point).likelihood(),
    )
