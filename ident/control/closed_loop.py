"""One run of the closed loop: a controller drives a simulated truck along a reference, cycle by cycle.

Each cycle the controller is told what the sensors read and gives a command, which is sent at that moment and
held until the next; a command may be dropped on its way, then the last one holds. The controller is given
``Measured`` and ``Reference`` only. Nothing random is shared: noise and drops have seeds of their own.

A run ends where the tracked point has come to the end of the path, or where the path is lost: beyond the
lateral limit, at the centre of the path's curvature (1 - κ e_y <= 0), when the motion is no longer finite,
when the truck has taken much longer than stipulated, or when a command is no number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.controller import Command, Controller, Diagnostics, Measured
from ident.control.plant import COLUMNS, Plant, Ride, Start, Stretch
from ident.control.reference import Reference
from ident.control.tracking import project
from ident.errors import BadRecipe

Array = NDArray[np.float64]
Outcome = Literal["completed", "left_the_lane", "folded", "blew_up", "too_late", "no_command"]

DROPS = 1  # stream of random numbers; those of the sensors are told by the names of their signals
AT_START = (
    *("position_x", "position_y", "heading", "heading_error", "speed", "acceleration"),
    *("lateral_velocity", "yaw_rate", "road_wheel_angle"),
)
AT_THE_END = 1e-6  # [m] of the end of the path: rounding
FASTEST = 1e4  # [m/s] or [rad/s] beyond which a model has blown up


@dataclass(frozen=True)
class Disturbance:
    """Where a run begins beside the reference.

    lateral_error : of the tracked point, left positive [m]; heading_error : [rad]; speed : [m/s]
    """

    lateral_error: float = 0.0
    heading_error: float = 0.0
    speed: float = 0.0


@dataclass(frozen=True)
class Settings:
    """How a run is driven.

    lateral_limit : error at which the path is lost [m]
    patience : time that a run may take, in stipulated times; a further ``grace`` [s] on top
    dropped : probability that the command of a cycle does not arrive
    seed : of noise and drops
    """

    lateral_limit: float = 2.5
    patience: float = 1.5
    grace: float = 5.0
    dropped: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.dropped < 1:
            raise BadRecipe(f"dropped cycles are {self.dropped:g} of all, need 0 or more and less than 1")
        if self.lateral_limit <= 0 or self.patience <= 0:
            raise BadRecipe("the lateral limit and the patience of a run need to be more than 0")


@dataclass(frozen=True)
class ClosedLoop:
    """What happened in one run.

    times : (n,) on the grid of the integration, rising, not evenly [s]
    states : column of ``plant.COLUMNS`` -> (n,), the true state of the centre of gravity
    arc_length, lateral_error : (n,) of the tracked point [m]
    heading_error : (n,) heading less that of the path and the reference's own heading error [rad]
    cycles : (m,) when each cycle began [s]; measured, commands, diagnostics, dropped : of each cycle
    arrival_time : when the tracked point came to the end of the path [s], None where it did not
    """

    controller: str
    reference: Reference
    disturbance: Disturbance
    settings: Settings
    period: float
    outcome: Outcome
    arrival_time: float | None
    times: Array
    states: Mapping[str, Array]
    arc_length: Array
    lateral_error: Array
    heading_error: Array
    cycles: Array
    measured: tuple[Measured, ...]
    commands: tuple[Command, ...]
    diagnostics: tuple[Diagnostics, ...]
    dropped: NDArray[np.bool_]

    @property
    def completed(self) -> bool:
        """Whether the truck came to the end of the path within the lane."""
        return self.outcome == "completed"


def run(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    disturbance: Disturbance | None = None,
    settings: Settings | None = None,
) -> ClosedLoop:
    """Drive once along a reference; the controller is reset before.

    Raises
    ------
    BadRecipe
        If the controller's period is not positive.
    """
    if controller.period <= 0:
        raise BadRecipe(f"{controller.name} has a period of {controller.period:g} s, need more than 0 s")
    loop = _Loop(plant, controller, reference, disturbance or Disturbance(), settings or Settings())
    controller.reset()
    return loop.drive()


def start_on(reference: Reference, disturbance: Disturbance) -> Start:
    """Where a truck begins: in steady motion along the first point of the path, beside it by a disturbance.

    The tracked point stands across from the first point of the path.
    """
    first = {name: float(getattr(reference, name)[0]) for name in AT_START}
    heading = first["heading"] + first["heading_error"] + disturbance.heading_error
    across = first["heading"] + math.pi / 2
    x = first["position_x"] + disturbance.lateral_error * math.cos(across)
    y = first["position_y"] + disturbance.lateral_error * math.sin(across)
    return Start(
        longitudinal_velocity=first["speed"] + disturbance.speed,
        position_x=x - reference.tracked_x * math.cos(heading),
        position_y=y - reference.tracked_x * math.sin(heading),
        heading=heading,
        lateral_velocity=first["lateral_velocity"] - reference.tracked_x * first["yaw_rate"],
        yaw_rate=first["yaw_rate"],
        road_wheel_angle=first["road_wheel_angle"],
        acceleration=first["acceleration"],
    )


def tracked_point(values: Mapping[str, Array], tracked_x: float) -> tuple[Array, Array]:
    """Position of the point that lies ``tracked_x`` forward of the CG, (n,) and (n,) [m]."""
    heading = values["heading"]
    return (
        values["position_x"] + tracked_x * np.cos(heading),
        values["position_y"] + tracked_x * np.sin(heading),
    )


@dataclass
class _Loop:
    """A run while it goes on.

    places : arc length of the tracked point at the end of each cycle [m], and before at the start
    """

    plant: Plant
    controller: Controller
    reference: Reference
    disturbance: Disturbance
    settings: Settings
    ride: Ride = field(init=False)
    places: list[float] = field(init=False)
    stretches: list[Stretch] = field(default_factory=list)
    measured: list[Measured] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    diagnostics: list[Diagnostics] = field(default_factory=list)

    def drive(self) -> ClosedLoop:
        """Go on until the end of the path, or until the path is lost."""
        seed = self.settings.seed
        self.ride = self.plant.begin(start_on(self.reference, self.disturbance), seed)
        self.places = [float(self.reference.arc_length[0])]
        drops = np.random.default_rng([seed, DROPS])
        dropped: list[bool] = []
        outcome: Outcome | None = None
        while outcome is None:
            dropped.append(bool(drops.random() < self.settings.dropped))
            asked = self._cycle(self.controller.period * len(dropped), dropped=dropped[-1])
            outcome = self._outcome() if asked else "no_command"
        return self._told(outcome, np.array(dropped))

    def _cycle(self, until: float, *, dropped: bool) -> bool:
        """Go on by one cycle; whether the controller gave a command that is a number."""
        measured = self.ride.measured()
        command, diagnostics = self.controller.step(measured, self.reference)
        asked = math.isfinite(command.steering_request) and math.isfinite(command.acceleration_request)
        self.measured.append(measured)
        self.commands.append(command)
        self.diagnostics.append(diagnostics)
        self.stretches.append(self.ride.advance(command if asked and not dropped else None, until))
        return asked

    def _outcome(self) -> Outcome | None:
        """How the run has ended by now, None where it goes on."""
        end = {name: values[-1:] for name, values in self.stretches[-1].values.items()}
        if not all(abs(end[name][0]) < FASTEST for name in ("lateral_velocity", "yaw_rate")):
            return "blew_up"
        x, y = tracked_point(end, self.reference.tracked_x)
        near = np.array(self.places[-1:])
        s, left, _, curvature = (float(found[0]) for found in project(self.reference, x, y, near))
        self.places.append(s)
        if 1 - curvature * left <= 0:
            return "folded"
        if not abs(left) <= self.settings.lateral_limit:
            return "left_the_lane"
        if s >= self.reference.arc_length[-1] - AT_THE_END:
            return "completed"
        longest = self.settings.patience * float(self.reference.time[-1]) + self.settings.grace
        return "too_late" if self.ride.time >= longest else None

    def _told(self, outcome: Outcome, dropped: NDArray[np.bool_]) -> ClosedLoop:
        """The whole run; a stretch gives its first point only where none came before it."""
        times = np.concatenate([self.stretches[0].times, *(one.times[1:] for one in self.stretches[1:])])
        states = {
            name: np.concatenate(
                [self.stretches[0].values[name], *(one.values[name][1:] for one in self.stretches[1:])]
            )
            for name in COLUMNS
        }
        cycles = np.array([one.time for one in self.measured])
        s, left, turned = self._errors(times, states, cycles)
        end = self.reference.arc_length[-1]
        arrival = float(np.interp(end, s, times)) if outcome == "completed" else None
        return ClosedLoop(
            self.controller.name,
            self.reference,
            self.disturbance,
            self.settings,
            self.controller.period,
            outcome,
            arrival,
            times,
            states,
            s,
            left,
            turned,
            cycles,
            tuple(self.measured),
            tuple(self.commands),
            tuple(self.diagnostics),
            dropped,
        )

    def _errors(self, times: Array, states: Mapping[str, Array], cycles: Array) -> tuple[Array, Array, Array]:
        """Arc length, lateral error and heading error at all times; not a number after a model blew up."""
        known = np.append(cycles, self.ride.time)[: len(self.places)]
        near = np.interp(times, known, self.places)
        x, y = tracked_point(states, self.reference.tracked_x)
        s, left, heading, _ = project(self.reference, x, y, near)
        inwards = np.interp(s, self.reference.arc_length, self.reference.heading_error)
        return s, left, states["heading"] - heading - inwards
