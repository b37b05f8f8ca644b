"""The motion of a simulated truck: its ``Truck`` as a compiled model, each effect where it belongs.

Effects of tyres, linkage and road are part of the compiled model; what effects of sensors do is handed to
``sensors``. Effects that cannot be simulated forward are refused by name.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ident.control.integration import march
from ident.control.sensors import Sensors, seen
from ident.control.truck import Truck
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

SHARE_OF_RELAXATION = 0.5  # longest step over the time in which 63 % of a tyre's force is there
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
KINEMATIC = "kinematic"
ALWAYS = {False: (STEERING_OFFSET, ROAD_BANK), True: (STEERING_OFFSET,)}  # as compiled for the fits, at zero
LINKAGE_PLAY = "steering_linkage_play"
OF_SENSORS = ("sensor_bias", "sensor_latency", "gyro_scale", "wheel_speed_scale")
UNSEEN = ("body_roll",)  # changes what an accelerometer reads, which no controller of the bench sees
OF_STEERING = ("steering_rate_limit", "steering_column_play", "steering_dead_zone")
RELAXATION_ROUNDS = 20  # of the static forces, which depend on each other through the shifted loads


class SimulatedMotion:
    """The compiled motion of a truck, by the names of its states, inputs (road wheels, speed) and outputs."""

    def __init__(self, truck: Truck) -> None:
        effects = effects_of(truck)
        self._effects = tuple(dict.fromkeys((*ALWAYS[truck.model == KINEMATIC], *effects)))
        self.engine = engine_of(truck.model, self._effects)
        values = {name: float(truck.parameters[name]) for name in parameter_names(truck.model)}
        absent = [name for one in self._effects for name in one.names]
        values |= dict.fromkeys((*MOUNTING, *absent), 0.0)
        for own in effects.values():
            values |= own
        self._values = values
        self._parameters = self.engine.vector(values)
        self._is_bicycle = truck.model in TYRES

    def start(self, values: Mapping[str, float], inputs: Array) -> Array:
        """State vector (nx,); what effects add begins where they say, given the rest.

        values : of the states, zero where there is none; inputs : (nu,)
        """
        names = self.engine.states
        state = np.array([values.get(name, 0.0) for name in names])
        begins = {name: output for one in self._effects for name, output in one.begins.items()}
        for _ in range(RELAXATION_ROUNDS if begins else 0):
            outputs = self.engine.outputs_of(state, inputs, self._parameters)
            for name, output in begins.items():
                state[names.index(name)] = outputs[self.engine.outputs.index(output)]
        return state

    def march(self, state: Array, inputs: Array, steps: Array) -> tuple[Array, dict[str, Array]]:
        """State at the end (nx,), and the outputs by name (n + 1,); see ``integration.march``."""
        states, outputs = march(self.engine, state, inputs, steps, self._parameters)
        return states[-1], dict(zip(self.engine.outputs, outputs.T, strict=True))

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
    if model != KINEMATIC and model not in TYRES:
        raise BadRecipe(f"no simulation model {model}: need kinematic or one of {', '.join(TYRES)}")
    try:
        system = kinematic(effects=effects) if model == KINEMATIC else bicycle(model, model, effects)
    except ValueError as error:
        raise BadRecipe(f"the {model} model cannot be simulated: {error}; use a bicycle") from error
    return compiled(system)


def parameter_names(model: str) -> tuple[str, ...]:
    """What ``Truck.parameters`` holds for a model, without what it does not use."""
    return DISTANCES if model == KINEMATIC else (*BODY, *tyre_parameters(model, model))


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
                f"the effect {key} cannot be simulated: take it out of the model, need one of {can}"
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


def sensed(key: str, given: Mapping[str, float]) -> Sensors | None:
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


def latency_of_steering(truck: Truck) -> float:
    """By how much the sensor of the steering reads late [s]."""
    found = (sensed(key, own) for key, own in truck.effects.items())
    return sum(one.latency.get("steering_angle", 0.0) for one in found if one is not None)


def _only(key: str, given: Mapping[str, float], name: str) -> float:
    if set(map(_last_part, given)) != {name}:
        raise BadRecipe(f"{key}: has {sorted(given)}, need {name} alone")
    return float(next(iter(given.values())))


def _last_part(name: str) -> str:
    return name.rpartition(".")[2]


def refuse_unphysical(truck: Truck) -> None:
    """Refuse a truck that cannot be.

    Raises
    ------
    BadRecipe
        If a parameter is missing, not finite, or not positive where it has to be.
    """
    names = parameter_names(truck.model) if truck.model in (*TYRES, KINEMATIC) else ()
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
