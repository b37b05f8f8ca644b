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
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ident.control.actuation import LOWEST_SPEED, DriveMotion, SteeringMotion
from ident.control.controllers.controller import Command, Measured
from ident.control.integration import march
from ident.control.sensors import Reading, Sensors, joined, seen
from ident.control.truck import SteeringActuator, Truck
from ident.dynamics.bicycle import BODY, MOUNTING, bicycle, substeps_for, tyre_parameters
from ident.dynamics.effects import (
    LOAD_TRANSFER,
    ROAD_BANK,
    STEERING_OFFSET,
    STEERING_RATIO_NONLINEARITY,
    TYRE_RELAXATION,
    Effect,
)
from ident.dynamics.effects.tyre_relaxation import LENGTH, rolling_rate
from ident.dynamics.engine import Engine, compiled
from ident.dynamics.kinematic import DISTANCES, kinematic
from ident.dynamics.tyres import TYRES
from ident.errors import BadRecipe

Array = NDArray[np.float64]

STEP = 0.005  # [s] longest of the integration
SHARE_OF_RELAXATION = 0.5  # longest step over the time in which 63 % of a tyre's force is there
COLUMNS = (
    *("position_x", "position_y", "heading", "longitudinal_velocity", "lateral_velocity", "yaw_rate"),
    *("longitudinal_acceleration", "lateral_acceleration"),
    *("steering_angle", "steering_rate", "road_wheel_angle"),
)
IN_MODEL = {
    effect.name: effect
    for effect in (
        STEERING_OFFSET,
        STEERING_RATIO_NONLINEARITY,
        TYRE_RELAXATION,
        LOAD_TRANSFER,
        ROAD_BANK,
    )
}
LINKAGE_PLAY = "steering_linkage_play"
OF_SENSORS = ("sensor_bias", "sensor_latency", "gyro_scale", "wheel_speed_scale")
UNSEEN = ("body_roll",)  # changes what an accelerometer reads, which no controller of the bench sees
OF_STEERING = ("steering_rate_limit", "steering_column_play", "steering_dead_zone")
RELAXATION_ROUNDS = 20  # of the static forces, which depend on each other through the shifted loads


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
        self.all_sensors()

    def all_sensors(self) -> Sensors:
        """The sensors with what the effects of the truck do to them."""
        found = (_sensed(key, values) for key, values in self.truck.effects.items())
        return joined(self.sensors, [one for one in found if one is not None])

    def begin(self, start: Start, seed: int = 0) -> Ride:
        """Put the truck at a start; ``seed`` is that of the noise of its sensors."""
        return Ride(self, start, seed)


class Ride:
    """One run of a plant: commands in, motion and readings out."""

    def __init__(self, plant: Plant, start: Start, seed: int) -> None:
        truck = plant.truck
        self._step = plant.step
        self._model = _Model(truck)
        self._reading = Reading(plant.all_sensors(), seed)
        wheel = steering_angle_for(truck.steering, start.road_wheel_angle)
        play = truck.effects.get(LINKAGE_PLAY, {}).get("width", 0.0)
        self._steering = SteeringMotion(truck.steering, truck.highest_angle, play, wheel)
        speed = max(start.longitudinal_velocity, LOWEST_SPEED)
        self._drive = DriveMotion(truck.drive, speed, start.acceleration)
        self._state = self._model.start(start, np.array([start.road_wheel_angle, speed]))
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
        events = self._steering.pending.arrivals(now, until) + self._drive.pending.arrivals(now, until)
        points = np.unique(np.concatenate([even, events]))
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


class _Model:
    """The compiled motion of a truck, by the names of its parameters."""

    def __init__(self, truck: Truck) -> None:
        effects = effects_of(truck)
        self._effects = tuple(effects)
        self.engine = engine_of(truck.model, self._effects)
        values = {name: float(truck.parameters[name]) for name in parameter_names(truck.model)}
        values |= dict.fromkeys(MOUNTING, 0.0)
        for own in effects.values():
            values |= own
        self._values = values
        self._parameters = self.engine.vector(values)
        self._is_bicycle = truck.model in TYRES

    def start(self, start: Start, inputs: Array) -> Array:
        """State vector; what effects add begins where they say, given the rest."""
        names = self.engine.states
        state = np.array([getattr(start, name, 0.0) for name in names])
        begins = {name: output for one in self._effects for name, output in one.begins.items()}
        for _ in range(RELAXATION_ROUNDS if begins else 0):
            outputs = self.engine.outputs_of(state, inputs, self._parameters)
            for name, output in begins.items():
                state[names.index(name)] = outputs[self.engine.outputs.index(output)]
        return state

    def march(self, state: Array, inputs: Array, steps: Array) -> tuple[Array, dict[str, Array]]:
        """State at the end, and the columns that the model knows."""
        states, outputs = march(self.engine, state, inputs, steps, self._parameters)
        told = self.engine.outputs
        return states[-1], {name: outputs[:, told.index(name)] for name in COLUMNS if name in told}

    def substeps(self, slowest: float, fastest: float, step: float) -> int:
        """Into how many parts a step is to be divided between two speeds [m/s]."""
        if not self._is_bicycle:
            return 1
        parts = int(substeps_for(self._values, np.array([slowest]), np.array([step]))[0])
        if LENGTH.name in self._values:
            rolling = float(rolling_rate(fastest, self._values[LENGTH.name]))
            parts = max(parts, int(np.ceil(rolling * step / SHARE_OF_RELAXATION)))
        return parts


def engine_of(model: str, effects: tuple[Effect, ...]) -> Engine:
    """The compiled kinematic model or bicycle.

    Raises
    ------
    BadRecipe
        If there is no such model, or an effect does not enter it.
    """
    if model != "kinematic" and model not in TYRES:
        raise BadRecipe(f"no simulation model {model}: need kinematic or one of {', '.join(TYRES)}")
    try:
        system = kinematic(effects=effects) if model == "kinematic" else bicycle(model, model, effects)
    except ValueError as error:
        raise BadRecipe(f"the {model} model cannot be simulated: {error}; use a bicycle") from error
    return compiled(system)


def parameter_names(model: str) -> tuple[str, ...]:
    """What ``Truck.parameters`` holds for a model, without what it does not use."""
    return DISTANCES if model == "kinematic" else (*BODY, *tyre_parameters(model, model))


def effects_of(truck: Truck) -> dict[Effect, dict[str, float]]:
    """Effects that are part of the compiled model, with all their parameters by the model's names.

    Raises
    ------
    BadRecipe
        If the truck has an effect that cannot be simulated forward, or a parameter is missing or unknown.
    """
    found = {}
    for key, given in truck.effects.items():
        name = key.partition(" ")[0]
        if name in IN_MODEL:
            found[IN_MODEL[name]] = _full_names(IN_MODEL[name], given)
        elif name in OF_STEERING:
            raise BadRecipe(f"{name} is an effect of the actuator: give it in the truck's steering")
        elif name not in (LINKAGE_PLAY, *OF_SENSORS, *UNSEEN):
            can = ", ".join((*IN_MODEL, LINKAGE_PLAY, *OF_SENSORS, *UNSEEN))
            raise BadRecipe(
                f"the effect {name} cannot be simulated: take it out of the model, need one of {can}"
            )
    return found


def _full_names(effect: Effect, given: Mapping[str, float]) -> dict[str, float]:
    """Parameters of an effect by its own names, from those or from the short names of a model file."""
    short = {name.rpartition(".")[2]: name for name in effect.names}
    if effect is STEERING_OFFSET:
        short["angle"] = effect.names[0]
    unknown = sorted(name for name in given if name not in effect.names and name not in short)
    values = {short.get(name, name): float(value) for name, value in given.items()}
    missing = sorted(set(effect.parameter_names) - set(values))
    if unknown or missing:
        raise BadRecipe(f"{effect.name}: missing {missing}, unknown {unknown}, need {sorted(short)}")
    return {parameter.name: parameter.typical for parameter in effect.given} | values


def _sensed(key: str, given: Mapping[str, float]) -> Sensors | None:
    """What an effect does to a sensor; the key is its name and, after a blank, the signal."""
    name, _, of = key.partition(" ")
    if name == "wheel_speed_scale":
        return Sensors(scale={"longitudinal_velocity": _only(key, given, "scale")})
    if name == "gyro_scale":
        return Sensors(scale={"yaw_rate": _only(key, given, "scale")})
    if name in ("sensor_bias", "sensor_latency") and not of:
        raise BadRecipe(f"{name}: of which signal? need its name after a blank, as in '{name} yaw_rate'")
    signal = seen("yaw_rate" if of == "inertial_unit" else of) if name in OF_SENSORS else None
    if signal is None:
        return None
    if name == "sensor_bias":
        return Sensors(bias={signal: _only(key, given, "bias")})
    return Sensors(latency={signal: _only(key, given, "delay")})


def _only(key: str, given: Mapping[str, float], name: str) -> float:
    if set(map(_last_part, given)) != {name}:
        raise BadRecipe(f"{key}: has {sorted(given)}, need {name} alone")
    return float(next(iter(given.values())))


def _last_part(name: str) -> str:
    return name.rpartition(".")[2]


def steering_angle_for(steering: SteeringActuator, road_wheel_angle: float) -> float:
    """Angle before the ratio map [rad] that gives an angle of the road wheels [rad]."""
    wheel, road = np.asarray(steering.ratio, dtype=np.float64).T
    slopes = np.diff(wheel) / np.diff(road)
    order = np.sign(road[-1] - road[0])
    place = int(np.clip(np.searchsorted(order * road, order * road_wheel_angle) - 1, 0, slopes.size - 1))
    return float(wheel[place] + slopes[place] * (road_wheel_angle - road[place]))


def refuse_unphysical(truck: Truck) -> None:
    """Refuse a truck that cannot be.

    Raises
    ------
    BadRecipe
        If a parameter is missing, not finite, or not positive where it has to be.
    """
    names = parameter_names(truck.model) if truck.model in (*TYRES, "kinematic") else ()
    if missing := sorted(set(names) - set(truck.parameters)):
        raise BadRecipe(f"a {truck.model} truck needs {', '.join(missing)}: none given")
    positive = {name: truck.parameters[name] for name in names if not name.endswith(".curvature")}
    steering = truck.steering
    positive |= {name: getattr(steering, name) for name in ("gain", "time_constant_1", "time_constant_2")}
    positive |= {"highest_angle": truck.highest_angle, "highest acceleration": truck.drive.highest}
    positive |= {"lowest acceleration, as braking,": -truck.drive.lowest}
    if steering.rate_limit is not None:
        positive["rate_limit"] = steering.rate_limit
    not_negative = {"dead_time": steering.dead_time, "play": steering.play, "dead_zone": steering.dead_zone}
    not_negative |= {"dead_time of the drive": truck.drive.dead_time, "lag of the drive": truck.drive.lag}
    finite = dict(truck.parameters)
    for name, value in (positive | not_negative | finite).items():
        low = name in positive and value <= 0
        if not np.isfinite(value) or low or (name in not_negative and value < 0):
            needed = "more than 0" if name in positive else "0 or more" if name in not_negative else "finite"
            raise BadRecipe(f"{name} of the simulated truck is {value:g}, need {needed}")
    table = np.asarray(steering.ratio, dtype=np.float64)
    if table.ndim != 2 or table.shape[0] < 2 or np.any(np.diff(table[:, 0]) <= 0):
        raise BadRecipe("the steering ratio needs two rows or more, with a rising steering angle")
    if np.any(np.diff(table[:, 1]) <= 0) and np.any(np.diff(table[:, 1]) >= 0):
        raise BadRecipe(
            "the road-wheel angle of the steering ratio turns back: it has to rise or fall throughout"
        )
