"""Trucks that the data allow as well: drawn from the covariance of a fit.

Parameters of which the model file holds the covariance are drawn together; those of which it holds a standard
error alone are drawn independently. A positive parameter is drawn in the logarithm, in which it was fitted:
cov(log a, log b) = C_ab/(a b); its median is the value of the truck that is given. What no truck can be
(outside the bounds of a tyre's parameters, T1 < T2) is drawn again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ident.control.simulated import effects_of, refuse_unphysical
from ident.control.truck import Truck
from ident.dynamics.tyres import TYRES
from ident.errors import BadRecipe, NotIdentifiable
from ident.model_file import Model, Value

Array = NDArray[np.float64]
Place = tuple[str, ...]  # ("parameters", name), ("steering", name) or ("effects", key, name)

TRIES = 200  # of one draw, before it is said that none is possible
ROUNDING = 1e-9  # largest negative eigenvalue of a correlation matrix that is rounding
EITHER_SIGN = ("curvature", "bias", "scale", "angle", "steering_offset", "bank_cos", "bank_sin")
ALSO_EITHER = ("sensitivity", "front_share", "cubic", "quadratic")
CALLED = {  # coordinates of a fit -> (key in Truck.effects, parameter)
    "linkage_play": ("steering_linkage_play", "width"),
    "bank_cos": ("road_bank", "bank_cos"),
    "bank_sin": ("road_bank", "bank_sin"),
}


@dataclass(frozen=True)
class Draws:
    """Trucks, with what was drawn.

    drawn : names in the model file of what differs between them
    left_out : names of what is uncertain as well and is no number of the truck, such as a term of one run
    """

    trucks: tuple[Truck, ...]
    drawn: tuple[str, ...]
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class _Spread:
    """What to draw: places in the truck, values, which of them in the logarithm, a factor A with A A' = C."""

    places: list[Place]
    values: Array
    in_log: NDArray[np.bool_]
    factor: Array


def draw(truck: Truck, model: Model, count: int, seed: int) -> Draws:
    """Trucks about one, as uncertain as a model file says; the first ones do not change with ``count``.

    Raises
    ------
    NotIdentifiable
        If the model file holds no standard error of any number of the truck.
    BadRecipe
        If there is to be none, the covariance is none, or nearly no draw is a possible truck.
    """
    if count < 1:
        raise BadRecipe(f"{count} draws of the truck, need 1 or more")
    names, covariance = uncertain(model)
    places = {name: _place(name, truck) for name in names}
    kept = [i for i, name in enumerate(names) if places[name] is not None]
    if not kept:
        raise NotIdentifiable(
            "the model holds no standard error of the truck's parameters: identify it with ident tyres and "
            "ident steering, or simulate a mismatch instead"
        )
    found = [place for place in places.values() if place is not None]
    spread = _spread(truck, found, covariance[np.ix_(kept, kept)])
    trucks = tuple(_one(truck, spread, np.random.default_rng([seed, number])) for number in range(count))
    left = tuple(name for name in names if places[name] is None)
    return Draws(trucks, tuple(names[i] for i in kept), left)


def uncertain(model: Model) -> tuple[list[str], Array]:
    """Names by their place in the model file, and their covariance: (k,), (k, k)."""
    alone = {name: std for name, std in _standard_errors(model).items() if name not in model.parameters}
    names = [*model.parameters, *alone]
    covariance = np.zeros((len(names), len(names)))
    joint = len(model.parameters)
    covariance[:joint, :joint] = np.array(model.covariance, dtype=np.float64).reshape(joint, joint)
    covariance[range(joint, len(names)), range(joint, len(names))] = np.square(list(alone.values()))
    return names, covariance


def _standard_errors(model: Model) -> dict[str, float]:
    """Of vehicle, steering and tyres, by place."""
    told: dict[str, Any] = {}
    if model.vehicle is not None:
        told |= {
            f"vehicle.{name}": getattr(model.vehicle, name) for name in model.vehicle.__dataclass_fields__
        }
    if model.steering is not None:
        names = ("gain", "dead_time", "time_constant_1", "time_constant_2")
        told |= {f"steering.{name}": getattr(model.steering, name) for name in names}
    if model.tyres is not None:
        axles: Mapping[str, Mapping[str, Value]] = {"front": model.tyres.front, "rear": model.tyres.rear}
        told |= {f"tyres.{axle}.{name}": one for axle, own in axles.items() for name, one in own.items()}
    return {name: one.std for name, one in told.items() if one is not None and one.std}


def _place(name: str, truck: Truck) -> Place | None:
    """Where a parameter of the model file is in the truck, None where it is not."""
    part, _, rest = name.partition(".")
    if part in ("tyres", "vehicle"):
        return ("parameters", rest) if rest in truck.parameters else None
    if part == "steering":
        return ("steering", rest) if rest in truck.steering.__dataclass_fields__ else None
    key, own = _effect(rest)
    values = truck.effects.get(key, {})
    matching = [full for full in values if full == rest or full.rpartition(".")[2] in own]
    return ("effects", key, matching[0]) if len(matching) == 1 else None


def _effect(rest: str) -> tuple[str, tuple[str, ...]]:
    """Key in ``Truck.effects`` and the short names that the parameter may have."""
    first, _, last = rest.partition(".")
    if first == "steering_offset":
        return first, (first, "angle")
    if first == "delay":
        return f"sensor_latency {'steering_angle' if last == 'road_wheel_angle' else last}", ("delay",)
    key, own = CALLED.get(rest, (first, last))
    return key, (own,)


def _value(truck: Truck, place: Place) -> float:
    part, name, *own = place
    if part == "effects":
        return float(truck.effects[name][own[0]])
    return float(truck.parameters[name] if part == "parameters" else getattr(truck.steering, name))


def _spread(truck: Truck, places: list[Place], covariance: Array) -> _Spread:
    values = np.array([_value(truck, place) for place in places])
    in_log = np.array(
        [value > 0 and _is_positive(place) for place, value in zip(places, values, strict=True)]
    )
    slope = np.where(in_log, 1 / np.where(in_log, values, 1.0), 1.0)
    scaled = covariance * slope * slope[:, None]
    size = np.sqrt(np.maximum(np.diag(scaled), 0.0))
    unit = np.where(size > 0, size, 1.0)
    sizes, axes = np.linalg.eigh(scaled / unit / unit[:, None])
    if not np.all(np.isfinite(sizes)) or sizes.min() < -ROUNDING * len(places):
        raise BadRecipe(
            f"the covariance of the model has a negative variance ({sizes.min():.2g} of a correlation), need "
            "none: fit the model again"
        )
    return _Spread(places, values, in_log, unit[:, None] * axes * np.sqrt(np.maximum(sizes, 0.0)))


def _is_positive(place: Place) -> bool:
    return place[-1].rpartition(".")[2] not in (*EITHER_SIGN, *ALSO_EITHER)


def _one(truck: Truck, spread: _Spread, random: np.random.Generator) -> Truck:
    for _ in range(TRIES):
        moved = spread.factor @ random.standard_normal(spread.factor.shape[1])
        with np.errstate(over="ignore"):  # no truck either
            factors = np.exp(np.where(spread.in_log, moved, 0.0))
        values = np.where(spread.in_log, spread.values * factors, spread.values + moved)
        made = _with(truck, dict(zip(spread.places, values.tolist(), strict=True)))
        if _is_possible(made):
            return made
    raise BadRecipe(
        f"none of {TRIES} draws from the covariance of the model is a possible truck: its standard errors "
        "are too large to say anything, record more or simulate a mismatch instead"
    )


def _with(truck: Truck, values: Mapping[Place, float]) -> Truck:
    """A truck with other numbers at some places."""
    parameters, effects = dict(truck.parameters), {key: dict(own) for key, own in truck.effects.items()}
    steering: dict[str, Any] = {}
    for (part, name, *own), value in values.items():
        if part == "parameters":
            parameters[name] = value
        elif part == "steering":
            steering[name] = value
        else:
            effects[name][own[0]] = value
    changed = replace(truck.steering, **steering)
    return replace(truck, parameters=parameters, steering=changed, effects=effects)


def _is_possible(truck: Truck) -> bool:
    try:
        refuse_unphysical(truck)
        effects_of(truck)
    except BadRecipe:
        return False
    if truck.steering.time_constant_2 > truck.steering.time_constant_1:
        return False
    tyres = TYRES[truck.model].parameters if truck.model in TYRES else ()
    return all(
        one.low <= truck.parameters[f"{axle}.{one.name}"] <= one.high
        for axle in ("front", "rear")
        for one in tyres
    )
