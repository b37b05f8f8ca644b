"""The truck of a model file: as the controllers believe it to be, and as others that are simulated.

Both are made anew from the numbers of the file, so that no simulation shares an object with a controller.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ident.control.sensors import COLOUR, std_within
from ident.control.truck import SteeringActuator, Truck
from ident.dynamics.tyres import TYRES
from ident.errors import NotIdentifiable
from ident.glossary import AXLES, STEERING_PAIRS
from ident.model_file import EffectPart, Model, SignalNoise, SteeringPart, TyresPart, Value, VehiclePart
from ident.results import Pair, TyreFit

BODY = ("mass", "yaw_inertia", "cg_to_front_axle", "cg_to_rear_axle")
IDENTITY = ((-1.0, -1.0), (1.0, 1.0))
KINEMATIC, LINEAR = "kinematic", "linear"
OF_ACTUATOR = {
    "steering_rate_limit": ("rate", "rate_limit"),
    "steering_column_play": ("width", "play"),
    "steering_dead_zone": ("width", "dead_zone"),
}
"""Effect of the actuator -> its size, and the field of ``SteeringActuator`` that holds it."""
OFFSET = "steering_offset"
NUISANCE = (OFFSET, "road_bank")
LONG = 20.0  # [s]
SAME = 1.1


@dataclass(frozen=True)
class Believed:
    """What the model file says of the truck.

    truck : without the effects that were found
    effects : those that a simulated truck can have, with their sizes: those of the vehicle by their names
    actuator : field of ``SteeringActuator`` -> value, of the effects of the actuator
    pair : which angle the request is of
    tracked_x : the point of the logs, forward of the CG [m]
    offset : of the road wheels, that the zero error of the angle's sensor or of the linkage causes [rad]
    noise : signal -> standard deviation of its noise
    notes : what was taken otherwise than the file says
    """

    truck: Truck
    effects: Mapping[str, Mapping[str, float]]
    actuator: Mapping[str, float]
    pair: Pair
    tracked_x: float
    offset: float
    noise: Mapping[str, float]
    notes: list[str]

    @property
    def name(self) -> str:
        """What the controllers predict with."""
        return self.truck.model

    @property
    def angle_noise(self) -> float:
        """Standard deviation of the noise of the measured angle, at the road wheels [rad]."""
        table = self.truck.steering.ratio
        slope = float(np.ptp(table[:, 1]) / np.ptp(table[:, 0]))
        return self.noise.get(STEERING_PAIRS[self.pair][1], 0.0) * slope

    @property
    def found(self) -> list[str]:
        """Names of the effects that were found."""
        named = [name for name, (_, field) in OF_ACTUATOR.items() if field in self.actuator]
        return [*self.effects, *named]

    def without(self, effect: str) -> Believed:
        """The same without an effect that was found."""
        return replace(self, effects={name: own for name, own in self.effects.items() if name != effect})

    @property
    def improved(self) -> Truck:
        """The truck with the effects that were found."""
        of_actuator: dict[str, Any] = dict(self.actuator)
        steering = replace(self.truck.steering, **of_actuator)
        return replace(self.truck, effects=dict(self.effects), steering=steering)


def believed(model: Model, source: str, *, found: bool = False) -> Believed:
    """Make the truck of a model.

    Parameters
    ----------
    source : what the messages begin with
    found : whether its effects are such as the truck has; else they are nuisance of the logs

    Raises
    ------
    NotIdentifiable
        If a part is missing without which no truck can be simulated, naming what to run.
    """
    vehicle, tyres, steering = _parts(model, source)
    body = {name: _known(getattr(vehicle, name), f"vehicle.{name}", source) for name in BODY}
    parameters = body | tyre_parameters(tyres, source)
    notes: list[str] = []
    actuator = _actuator(steering, source, notes)
    effects, of_actuator = _effects(model.effects, notes) if found else ({}, {})
    tracked = -body["cg_to_rear_axle"] if model.reference_point == "rear_axle" else 0.0
    truck = Truck(tyres.kind, parameters, actuator)
    offset = next((one.parameters["angle"].value for one in model.effects if one.name == OFFSET), None)
    noise = {name: std_within(one, COLOUR) for name, one in model.noise.items()}
    return Believed(truck, effects, of_actuator, steering.pair, tracked, offset or 0.0, noise, notes)


def sensor_noise(noise: SignalNoise) -> SignalNoise:
    """What a sensor adds: a colour longer than ``COLOUR`` is none of it, but what the model lacks."""
    size = std_within(noise, COLOUR)
    if std_within(noise, LONG) <= SAME * size:
        return noise
    return SignalNoise(size, correlation_time=COLOUR)


def tyre_parameters(tyres: TyresPart, source: str) -> dict[str, float]:
    """Parameters of both axles by their names in the bicycle."""
    if tyres.kind not in TYRES:
        raise NotIdentifiable(
            f"{source}: its tyres are those of a property file ({tyres.kind}), need one of "
            f"{', '.join(TYRES)}: run `ident tyres` with such kinds"
        )
    axles = {"front": tyres.front, "rear": tyres.rear}
    return {
        f"{axle}.{name}": _known(axles[axle].get(name), f"tyres.{axle}.{name}", source)
        for axle in AXLES
        for name in TYRES[tyres.kind].names
    }


def other_models(truck: Truck, fits: Sequence[TyreFit]) -> dict[str, Truck]:
    """The same truck with other models of its tyres: those that were fitted, and what its own one implies.

    Tyres of a property file are left out: no truck is simulated with them. Without other fits there are the
    kinematic bicycle and the one with linear tyres of the same stiffness.
    """
    made = {KINEMATIC: replace(truck, model=KINEMATIC, effects={})}
    linear = {name: value for name, value in truck.parameters.items() if _of_linear(name)}
    made[LINEAR] = replace(truck, model=LINEAR, parameters=linear, effects={})
    for fit in fits:
        parameters = _fitted(fit) if fit.kind in TYRES else None
        if parameters is not None:
            body = {name: truck.parameters[name] for name in BODY}
            made[fit.kind] = replace(truck, model=fit.kind, parameters={**body, **parameters}, effects={})
    return {**made, truck.model: truck}


def _of_linear(name: str) -> bool:
    return name in BODY or name.partition(".")[2] in TYRES[LINEAR].names


def _fitted(fit: TyreFit) -> dict[str, float] | None:
    """Parameters of a fit with its own yaw inertia, None where one has no value."""
    axles = {"front": fit.front, "rear": fit.rear}
    made = {f"{axle}.{name}": axles[axle][name].value for axle in AXLES for name in TYRES[fit.kind].names} | {
        "yaw_inertia": fit.yaw_inertia.value
    }
    known = {name: value for name, value in made.items() if value is not None}
    return known if len(known) == len(made) else None


def _parts(model: Model, source: str) -> tuple[VehiclePart, TyresPart, SteeringPart]:
    if model.vehicle is None or model.tyres is None:
        raise NotIdentifiable(
            f"{source}: holds no tyres: run `ident tyres` on logs of curves and lane changes"
        )
    if model.steering is None:
        raise NotIdentifiable(
            f"{source}: holds no steering actuator: run `ident steering` on logs with steering_wheel_request "
            "and steering_wheel_angle"
        )
    return model.vehicle, model.tyres, model.steering


def _known(value: Value | None, name: str, source: str) -> float:
    if value is None or value.value is None:
        raise NotIdentifiable(f"{source}: {name} has no value, need one to simulate the truck")
    return value.value


def _actuator(part: SteeringPart, source: str, notes: list[str]) -> SteeringActuator:
    gain, dead_time = (_known(getattr(part, n), f"steering.{n}", source) for n in ("gain", "dead_time"))
    first, second = _time_constants(part, source, notes)
    return SteeringActuator(gain, max(dead_time, 0.0), first, second, _ratio(part, source))


def _time_constants(part: SteeringPart, source: str, notes: list[str]) -> tuple[float, float]:
    """T1 and T2; where the response swings, two equal ones with the same lag in all."""
    first, second = part.time_constant_1.value, part.time_constant_2.value
    if first is not None and second is not None:
        return max(first, second), min(first, second)
    frequency = _known(part.natural_frequency, "steering.time_constant_1", source)
    damping = _known(part.damping_ratio, "steering.damping_ratio", source)
    notes.append(
        f"the steering swings (damping ratio {damping:.2f}): simulated and believed with two equal lags of "
        f"{damping / frequency:.3f} s, the same lag in all"
    )
    return damping / frequency, damping / frequency


def _ratio(part: SteeringPart, source: str) -> NDArray[np.float64]:
    if part.pair == "road_wheel":
        return np.array(IDENTITY)
    if not part.ratio:
        raise NotIdentifiable(
            f"{source}: no steering.ratio: state steering_ratio in vehicle.yaml and run `ident steering`"
        )
    return np.array(part.ratio, dtype=np.float64)


def _effects(
    parts: Sequence[EffectPart], notes: list[str]
) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
    """Effects by their keys, such as "sensor_latency yaw_rate", and those of the actuator by its fields."""
    of_vehicle: dict[str, dict[str, float]] = {}
    of_actuator: dict[str, float] = {}
    for part in parts:
        sizes = {name: one.value for name, one in part.parameters.items()}
        known = {name: value for name, value in sizes.items() if value is not None}
        if part.run is not None or part.name in NUISANCE:
            continue
        if len(known) != len(sizes):
            notes.append(f"{part.name}: left out, it has no size")
        elif part.name in OF_ACTUATOR:
            size, field = OF_ACTUATOR[part.name]
            of_actuator[field] = known[size]
        else:
            of_vehicle[part.name if part.of is None else f"{part.name} {part.of}"] = known
    return of_vehicle, of_actuator
