"""The screen of the motion: scores at a fit of every effect that is not in it, and of the generic basis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.constants import GRAVITY
from ident.dynamics.effects.first_order import Trajectory as AlongTrajectory
from ident.dynamics.effects.first_order import first_order, rate_of
from ident.estimation.input_noise import InputNoise
from ident.estimation.layer import Group, LayerScores, Shape
from ident.estimation.motion_basis import (
    EQUATIONS,
    OF_FORCES,
    OF_SIGNALS,
    READ,
    Trajectory,
    basis,
    push,
    scaled,
    steering_rate,
    steps,
    trajectory_of,
)
from ident.estimation.motion_effects import MotionEffect
from ident.estimation.motion_scores import Directions, Projection
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_inputs import Probe
from ident.estimation.vehicle_point import VehiclePoint

Array = NDArray[np.float64]

ACTIVITIES = ("steering", "steering rate", "lateral acceleration", "speed")
COEFFICIENT = 1.0  # what one unit of a direction of the basis stands for


@dataclass
class _Collected:
    """Probes, and the directions that are made of them.

    combined : one {probe: weight} a direction
    """

    probes: list[Probe] = field(default_factory=list)
    combined: list[dict[int, float]] = field(default_factory=list)
    groups: list[Group] = field(default_factory=list)

    def probe(self, probe: Probe) -> int:
        self.probes.append(probe)
        return len(self.probes) - 1

    def direction(self, parts: Mapping[int, float]) -> int:
        self.combined.append(dict(parts))
        return len(self.combined) - 1

    def alone(self, probe: Probe) -> int:
        """A direction that is a probe of its own."""
        return self.direction({self.probe(probe): 1.0})

    @property
    def matrix(self) -> Array:
        """(p, c) weights of the probes in the directions."""
        made = np.zeros((len(self.probes), len(self.combined)))
        for column, parts in enumerate(self.combined):
            for row, weight in parts.items():
                made[row, column] = weight
        return made


@dataclass(frozen=True)
class MotionDirections:
    """What is looked for at a fit: directions of effects and of the generic basis.

    activity : (b, a), colour : (c,) see :class:`~ident.estimation.layer.LayerScores`
    """

    directions: Directions
    groups: tuple[Group, ...]
    activity: Array
    colour: Array

    def scores(self, point: VehiclePoint | None = None) -> LayerScores:
        """Scores of the fit, or of other measurements (:meth:`Projection.residuals`) to first order."""
        projection = self.directions.projection
        residuals = projection.residuals(point)
        power, count = projection.power(None if point is None else residuals)
        return LayerScores(
            layer="motion",
            run=projection.bins.run,
            time=projection.bins.time,
            scores=self.directions.scores(residuals),
            gram=self.directions.gram,
            energy=self.directions.energy,
            power=power,
            count=count,
            activity=self.activity,
            signals=tuple(projection.point.residuals),
            activities=ACTIVITIES,
            groups=self.groups,
            colour=self.colour,
        )


def motion_directions(
    point: VehiclePoint,
    projection: Projection,
    candidates: Sequence[MotionEffect],
    body: Body,
    noises: Sequence[InputNoise] = (),
) -> MotionDirections:
    """Directions at a fit.

    Parameters
    ----------
    point, projection : the fit, and what it takes up
    candidates : effects that are not in it
    noises : of the inputs
    """
    path = trajectory_of(point)
    windows = point.problem.windows
    along = AlongTrajectory(path.values, windows.steps, windows.offsets, point.problem.values(point.shared))
    made = _Collected()
    for effect in candidates:
        _of_effect(made, effect, path, along, point)
    _of_basis(made, path, point, body)
    activity = [path["road_wheel_angle"], steering_rate(path), path["felt_acceleration"]]
    columns = [projection.mean(values**2) for values in activity]
    columns.append(projection.mean(np.abs(path["longitudinal_velocity"])))
    directions = projection.directions(made.probes, made.matrix)
    colour = directions.colour(noises)
    return MotionDirections(directions, tuple(made.groups), np.column_stack(columns), colour)


def _of_effect(
    made: _Collected, effect: MotionEffect, path: Trajectory, along: AlongTrajectory, point: VehiclePoint
) -> None:
    """Add the shapes of one effect."""
    if effect.run_terms:
        shapes = _of_run_terms(made, effect, point)
    elif effect.late:
        shapes = [_of_late(made, effect, path, point)]
    elif effect.name == "road_bank":
        shapes = [_of_bank(made, path, point)]
    elif effect.name == "sensor_latency":
        ahead = rate_of(along, "road_wheel_angle")
        shapes = [Shape((made.alone(Probe(inputs={"probe.road_wheel_angle": ahead})),))]
    else:
        shapes = _of_model(made, effect, along, point)
    made.groups.append(Group(effect.key, tuple(shapes), effect.name))


def _of_run_terms(made: _Collected, effect: MotionEffect, point: VehiclePoint) -> list[Shape]:
    """One shape of the same term in all runs, one of a term of each run."""
    windows, term = point.problem.windows, effect.run_terms[0]
    signal = term.by_speed_to or term.name
    samples = windows.signals[signal]
    times = np.ones(samples.times.size)
    if term.by_speed_to is not None:
        times = samples.at(windows.inputs[:, 1:2])[:, 0]
    run = windows.run[samples.window]
    own = [made.probe(Probe(signals={signal: times * (run == number)})) for number in range(windows.runs)]
    together = Shape((made.direction(dict.fromkeys(own, 1.0)),))
    alone = Shape(tuple(made.direction({probe: 1.0}) for probe in own))
    return [together, alone] if windows.runs > 1 else [together]


def _of_late(made: _Collected, effect: MotionEffect, path: Trajectory, point: VehiclePoint) -> Shape:
    """A late sensor reads -τ times the rate of its signal more."""
    signals = {}
    for signal in effect.late or {}:
        samples = point.problem.windows.signals[signal]
        signals[signal] = -samples.slopes(np.ascontiguousarray(path[signal][:, None]))[:, 0]
    return Shape((made.alone(Probe(signals=signals)),))


def _of_bank(made: _Collected, path: Trajectory, point: VehiclePoint) -> Shape:
    weight = point.problem.fixed["mass"] * GRAVITY
    heading = path["state.heading"]
    parts = (-weight * np.cos(heading), -weight * np.sin(heading))
    return Shape(tuple(made.alone(Probe(inputs={"probe.bank_force": one})) for one in parts))


def _of_model(
    made: _Collected, effect: MotionEffect, along: AlongTrajectory, point: VehiclePoint
) -> list[Shape]:
    """Forms of an effect of the compiled model, or of a block before it, at first order."""
    shapes = []
    for form in first_order(effect.name, along):
        columns = []
        for number in range(len(form.free)):
            inputs = {name: values[:, number] for name, values in form.inputs.items()}
            signals = {
                name: point.problem.windows.signals[name].at(values[:, number : number + 1])[:, 0]
                for name, values in form.signals.items()
                if name in point.residuals
            }
            columns.append(made.alone(Probe(inputs, signals)))
        at = {f"{effect.name}.{name}": value for name, value in form.at.items()}
        shapes.append(Shape(tuple(columns), at))
    return shapes


def _of_basis(made: _Collected, path: Trajectory, point: VehiclePoint, body: Body) -> None:
    """Add the generic directions."""
    functions = basis(path)
    sizes = {"mass": body.mass, "yaw_inertia": point.problem.values(point.shared)["yaw_inertia"]}
    arm = body.cg_to_front_axle * sizes["mass"] / sizes["yaw_inertia"]
    turned = float(np.ptp(path["state.heading"])) > 1.0
    for name in OF_FORCES:
        if "heading" in name and not turned:
            continue
        side = made.probe(push("lateral_force", functions[name], sizes))
        turn = made.probe(push("yaw_moment", functions[name], sizes))
        parts = {
            "lateral_force": {side: 1.0},
            "front_tyre": {side: 1.0, turn: arm},
            "yaw_moment": {turn: 1.0},
        }
        for equation in EQUATIONS:
            shape = Shape((made.direction(parts[equation]),), size=COEFFICIENT)
            made.groups.append(Group(f"{equation}: {name}", (shape,)))
    _of_steps(made, path, sizes)
    _of_signals(made, functions, point)


def _of_steps(made: _Collected, path: Trajectory, sizes: Mapping[str, float]) -> None:
    """A change at some time, of the force that is there and of the moment alone."""
    force, moment = [], []
    turning = scaled(path["felt_acceleration"])
    for since, after in steps(path):
        force.append(Shape((made.alone(push("front_tyre", after * turning, sizes)),), {"since": since}))
        moment.append(Shape((made.alone(push("yaw_moment", after, sizes)),), {"since": since}))
    made.groups.append(Group("front_tyre: change at a time", tuple(force)))
    made.groups.append(Group("yaw_moment: step at a time", tuple(moment)))


def _of_signals(made: _Collected, functions: Mapping[str, Array], point: VehiclePoint) -> None:
    """Errors of what is measured."""
    windows = point.problem.windows
    for signal in READ:
        if signal not in point.residuals:
            continue
        samples = windows.signals[signal]
        modelled = samples.values - point.residuals[signal].residual
        for name in OF_SIGNALS:
            if name in ("y", "y|y|"):
                values = scaled(modelled) * (np.abs(scaled(modelled)) if name == "y|y|" else 1.0)
            else:
                values = samples.at(np.ascontiguousarray(functions[name][:, None]))[:, 0]
            shape = Shape((made.alone(Probe(signals={signal: values})),))
            made.groups.append(Group(f"{signal}: {name}", (shape,)))
