"""The simulated truck: a ``Truck`` that takes held commands and is read by sensors.

Steering and drive are solved exactly (``actuation``). With the road-wheel angle and the longitudinal velocity
that follow, the bicycle or the kinematic model of ``ident.dynamics`` is integrated by RK4 on a grid of its
own. A time at which a command takes effect is a point of that grid, so that nothing jumps within a step. The
drive holds v̇_x = a: what cornering takes of the speed is left to it.

Effects that ``ident improve`` finds act where they belong: those of tyres, linkage and road in the compiled
model, a play in the linkage before it, those of the sensors on what the controller reads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ident.control.actuation import LOWEST_SPEED, DriveMotion, SteeringMotion
from ident.control.controllers.controller import Command, Measured
from ident.control.sensors import Reading, Sensors, joined
from ident.control.simulated import (
    LINKAGE_PLAY,
    SimulatedMotion,
    effects_of,
    latency_of_steering,
    refuse_unphysical,
    sensed,
)
from ident.control.truck import SteeringActuator, Truck
from ident.errors import BadRecipe

Array = NDArray[np.float64]

STEP = 0.005  # [s] longest of the integration
SAME_TIME = 1e-9  # [s]
COLUMNS = (
    *("position_x", "position_y", "heading", "longitudinal_velocity", "lateral_velocity", "yaw_rate"),
    *("longitudinal_acceleration", "lateral_acceleration"),
    *("steering_angle", "steering_rate", "road_wheel_angle"),
)


@dataclass(frozen=True)
class Start:
    """State of the centre of gravity at time zero, the steering at rest at an angle of the road wheels.

    position_x, position_y : [m]; heading : [rad]
    longitudinal_velocity, lateral_velocity : [m/s]; yaw_rate : [rad/s] (of a bicycle)
    road_wheel_angle : [rad]; acceleration : longitudinal, held by the commands before [m/s²]
    """

    longitudinal_velocity: float
    position_x: float = 0.0
    position_y: float = 0.0
    heading: float = 0.0
    lateral_velocity: float = 0.0
    yaw_rate: float = 0.0
    road_wheel_angle: float = 0.0
    acceleration: float = 0.0


@dataclass(frozen=True)
class Stretch:
    """What the truck did between two commands, the point at which it begins included.

    times : (n,) [s]; values : column of ``COLUMNS`` -> (n,), those of the centre of gravity
    """

    times: Array
    values: Mapping[str, Array]


@dataclass(frozen=True)
class Plant:
    """A truck to be simulated; it holds no state, so one plant serves many runs.

    truck : as the simulation has it
    sensors : beside what the effects of the truck do to them
    step : longest of the integration [s]

    Raises
    ------
    BadRecipe
        If the truck has an effect that cannot be simulated, or a number that no truck has.
    """

    truck: Truck
    sensors: Sensors = field(default_factory=Sensors)
    step: float = STEP

    def __post_init__(self) -> None:
        if self.step <= 0:
            raise BadRecipe(f"step of the simulation is {self.step:g} s, need more than 0 s, such as 0.005 s")
        refuse_unphysical(self.truck)
        effects_of(self.truck)
        late, dead_time = latency_of_steering(self.truck), self.truck.steering.dead_time
        if late > dead_time:
            raise BadRecipe(
                f"the steering sensor reads {late:g} s late, need at most the dead time {dead_time:g} s: "
                "else the wheels would turn before they are asked to"
            )
        self.all_sensors()

    def all_sensors(self) -> Sensors:
        """The sensors with what the effects of the truck do to them."""
        found = (sensed(key, values) for key, values in self.truck.effects.items())
        return joined(self.sensors, [one for one in found if one is not None])

    def actuator(self) -> SteeringActuator:
        """The steering as it is: what its sensor reads late is no dead time of the wheels.

        The dead time of a truck is that of the measured angle.
        """
        late = latency_of_steering(self.truck)
        return replace(self.truck.steering, dead_time=self.truck.steering.dead_time - late)

    def begin(self, start: Start, seed: int = 0) -> Ride:
        """Put the truck at a start; ``seed`` is that of the noise of its sensors."""
        return Ride(self, start, seed)


class Ride:
    """One run of a plant: commands in, motion and readings out."""

    def __init__(self, plant: Plant, start: Start, seed: int) -> None:
        truck = plant.truck
        self._step = plant.step
        self._model = SimulatedMotion(truck)
        self._reading = Reading(plant.all_sensors(), seed)
        steering = plant.actuator()
        wheel = steering_angle_for(steering, start.road_wheel_angle)
        play = truck.effects.get(LINKAGE_PLAY, {}).get("width", 0.0)
        self._steering = SteeringMotion(steering, truck.highest_angle, play, wheel)
        speed = max(start.longitudinal_velocity, LOWEST_SPEED)
        self._drive = DriveMotion(truck.drive, speed, start.acceleration)
        self._state = self._model.start(vars(start), np.array([start.road_wheel_angle, speed]))
        self._last = self._moved(np.zeros(1))
        self._history = self._last

    @property
    def time(self) -> float:
        """Now [s]."""
        return self._steering.time

    @property
    def now(self) -> dict[str, float]:
        """The true state, by ``COLUMNS``."""
        return {name: float(column[-1]) for name, column in self._last.values.items()}

    def measured(self) -> Measured:
        """What the controller is told; to be asked for once a cycle."""
        return self._reading.of(self.time, self._history.times, self._history.values)

    def advance(self, command: Command | None, until: float) -> Stretch:
        """Send a command now and let the truck move on.

        command : None where it does not arrive: the last one holds
        until : [s], later than now
        """
        if command is not None:
            self._steering.send(self.time, command.steering_request)
            self._drive.send(self.time, command.acceleration_request)
        self._last = self._moved(self._grid(until))
        if self._reading.longest > 0:
            self._history = self._remembered(self._history, self._last, until - self._reading.longest)
        else:
            self._history = self._last
        return self._last

    def _grid(self, until: float) -> Array:
        """Points and middles of the grid up to a time: of a step that is short enough, and all events."""
        now = self.time
        slowest = max(self._drive.speed - abs(self._drive.drive.lowest) * (until - now), LOWEST_SPEED)
        parts = self._model.substeps(slowest, self._drive.speed, min(self._step, until - now))
        count = int(np.ceil((until - now) / self._step * (1 - 1e-9))) * parts
        even = now + (until - now) * np.arange(count + 1) / count
        even[-1] = until
        events = self._steering.events(now, until, self._step)
        events += self._drive.pending.arrivals(now, until)
        apart = [time for time in events if np.min(np.abs(even - time)) > SAME_TIME]
        points = np.unique(np.concatenate([even, apart]))
        grid = np.empty(2 * points.size - 1)
        grid[::2], grid[1::2] = points, (points[1:] + points[:-1]) / 2
        return grid

    def _moved(self, grid: Array) -> Stretch:
        angle, rate, road = self._steering.advance(grid)
        speed, acceleration = self._drive.advance(grid)
        inputs = np.stack([road, speed], axis=1)
        self._state, motion = self._model.march(self._state, inputs, np.diff(grid[::2]))
        rest = {
            "longitudinal_velocity": speed[::2],
            "longitudinal_acceleration": acceleration[::2],
            "steering_angle": angle[::2],
            "steering_rate": rate[::2],
            "road_wheel_angle": road[::2],
        }
        both = motion | rest
        return Stretch(grid[::2], {name: both[name] for name in COLUMNS})

    @staticmethod
    def _remembered(before: Stretch, after: Stretch, since: float) -> Stretch:
        """Two stretches joined, without what is so long ago that no sensor reads it any more."""
        first = max(int(np.searchsorted(before.times, since, side="right")) - 1, 0)
        kept = slice(first, before.times.size - 1)
        values = {name: np.concatenate([before.values[name][kept], after.values[name]]) for name in COLUMNS}
        return Stretch(np.concatenate([before.times[kept], after.times]), values)


def steering_angle_for(steering: SteeringActuator, road_wheel_angle: float) -> float:
    """Angle before the ratio map [rad] that gives an angle of the road wheels [rad]."""
    wheel, road = np.asarray(steering.ratio, dtype=np.float64).T
    slopes = np.diff(wheel) / np.diff(road)
    order = np.sign(road[-1] - road[0])
    place = int(np.clip(np.searchsorted(order * road, order * road_wheel_angle) - 1, 0, slopes.size - 1))
    return float(wheel[place] + slopes[place] * (road_wheel_angle - road[place]))
