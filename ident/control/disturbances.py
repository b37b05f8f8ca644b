"""What a controller has to stand: starts beside the reference, and trucks that are not as believed.

A mismatch changes a ``Truck`` into another one; the truck that it was is never changed. Sizes:

- ``mass`` (relative): the yaw inertia goes with it, so the radius of gyration stays; tyres stay as they are
- ``stiffness`` (relative): cornering stiffness of both axles
- ``friction`` (a factor, 1 is no change): the largest force of both axles, the stiffness unchanged: the
  peak force of a Magic Formula or brush axle, the slip angle of saturation of a piecewise linear one
- ``dead_time`` (added, s): of the steering; ``time_constant`` (relative): of both its lags
- ``ratio`` (relative): steering-wheel angle over road-wheel angle, so the road wheels turn by 1/(1 + size)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import radians

import numpy as np

from ident.control.closed_loop import Disturbance
from ident.control.simulated import refuse_unphysical
from ident.control.truck import Truck
from ident.dynamics.tyres import TYRES
from ident.errors import BadRecipe
from ident.glossary import AXLES

LATERAL_ERRORS = (-1.0, -0.5, -0.25, 0.25, 0.5, 1.0)  # [m]
HEADING_ERRORS = tuple(radians(angle) for angle in (-5.0, -3.0, -1.0, 1.0, 3.0, 5.0))  # [rad]
SPEEDS = (-2.0, -1.0, 1.0, 2.0)  # [m/s]

UNITS = {"mass": "1", "stiffness": "1", "friction": "1", "dead_time": "s", "time_constant": "1", "ratio": "1"}
UNCHANGED = {name: 1.0 if name == "friction" else 0.0 for name in UNITS}
SWEEPS: dict[str, tuple[float, ...]] = {
    "mass": (-0.4, -0.2, 0.0, 0.15, 0.3),
    "stiffness": (-0.3, -0.15, 0.0, 0.15, 0.3),
    "friction": (0.3, 0.5, 0.7, 1.0),
    "dead_time": (-0.2, -0.1, -0.05, 0.0, 0.05, 0.1, 0.2),
    "time_constant": (-0.5, -0.25, 0.0, 0.25, 0.5),
    "ratio": (-0.05, 0.0, 0.05),
}
LARGEST_FORCE = ("peak_force", "saturation_slip")  # tyre parameters that friction scales


def one_at_a_time() -> list[Disturbance]:
    """The undisturbed start, then each size of each disturbance alone: 17 starts."""
    return [
        Disturbance(),
        *(Disturbance(lateral_error=size) for size in LATERAL_ERRORS),
        *(Disturbance(heading_error=size) for size in HEADING_ERRORS),
        *(Disturbance(speed=size) for size in SPEEDS),
    ]


def monte_carlo(count: int, seed: int) -> list[Disturbance]:
    """Starts drawn evenly from the box that the grid spans; the first ones do not change with ``count``.

    Raises
    ------
    BadRecipe
        If there is to be none.
    """
    if count < 1:
        raise BadRecipe(f"{count} disturbed starts, need 1 or more")
    widest = np.array([max(LATERAL_ERRORS), max(HEADING_ERRORS), max(SPEEDS)])
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, widest.size)) * widest
    return [Disturbance(*map(float, row)) for row in drawn]


def changed(truck: Truck, mismatch: Mapping[str, float]) -> Truck:
    """A truck that differs from another one.

    mismatch : name in ``UNITS`` -> size

    Raises
    ------
    BadRecipe
        If there is no such mismatch, the model has nothing that it changes, or no truck is like that.
    """
    if unknown := sorted(set(mismatch) - set(UNITS)):
        raise BadRecipe(f"no mismatch {', '.join(unknown)}: need one of {', '.join(UNITS)}")
    for name, size in mismatch.items():
        if not np.isfinite(size):
            raise BadRecipe(f"mismatch of {name} is {size}, need a finite number")
        truck = _CHANGES[name](truck, float(size))
    refuse_unphysical(truck)
    return truck


def differences(before: Truck, after: Truck) -> dict[str, tuple[float, float]]:
    """What differs between two trucks of one model: number by its name -> before, after."""
    numbers = [_numbers(one) for one in (before, after)]
    names = dict.fromkeys([*numbers[0], *numbers[1]])
    pairs = {name: (numbers[0].get(name, 0.0), numbers[1].get(name, 0.0)) for name in names}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _numbers(truck: Truck) -> dict[str, float]:
    steering = truck.steering
    told = {
        f"steering.{name}": getattr(steering, name)
        for name in ("gain", "dead_time", "time_constant_1", "time_constant_2", "play", "dead_zone")
    }
    told["steering.rate_limit"] = np.inf if steering.rate_limit is None else steering.rate_limit
    (low, low_road), (high, high_road) = np.asarray(steering.ratio)[[0, -1]]
    told["steering.ratio"] = float((high - low) / (high_road - low_road))
    drive = {
        f"drive.{name}": getattr(truck.drive, name) for name in ("lag", "dead_time", "lowest", "highest")
    }
    effects = {f"{key}.{name}": value for key, own in truck.effects.items() for name, value in own.items()}
    return {**truck.parameters, **told, **drive, **effects, "highest_angle": truck.highest_angle}


def _scaled(truck: Truck, factors: Mapping[str, float]) -> Truck:
    values = {name: value * factors.get(name, 1.0) for name, value in truck.parameters.items()}
    return replace(truck, parameters=values)


def _refuse_kinematic(truck: Truck, name: str) -> None:
    if truck.model not in TYRES:
        raise BadRecipe(f"a {truck.model} truck has no {name}: take this mismatch out, or simulate a bicycle")


def _mass(truck: Truck, size: float) -> Truck:
    _refuse_kinematic(truck, "mass")
    return _scaled(truck, {"mass": 1 + size, "yaw_inertia": 1 + size})


def _stiffness(truck: Truck, size: float) -> Truck:
    _refuse_kinematic(truck, "cornering stiffness")
    return _scaled(truck, {f"{axle}.cornering_stiffness": 1 + size for axle in AXLES})


def _friction(truck: Truck, size: float) -> Truck:
    _refuse_kinematic(truck, "friction")
    limits = [name for name in LARGEST_FORCE if name in TYRES[truck.model].names]
    if not limits:
        raise BadRecipe(f"{truck.model} tyres have no largest force: friction needs one of another kind")
    return _scaled(truck, {f"{axle}.{name}": size for axle in AXLES for name in limits})


def _dead_time(truck: Truck, size: float) -> Truck:
    found = truck.steering.dead_time
    if found + size < 0:
        raise BadRecipe(
            f"dead time of {found:g} s and {size:+g} s on top is {found + size:g} s, need 0 s or more: "
            f"a mismatch of {-found:g} s or more"
        )
    return replace(truck, steering=replace(truck.steering, dead_time=found + size))


def _time_constant(truck: Truck, size: float) -> Truck:
    lags = {f"time_constant_{n}": getattr(truck.steering, f"time_constant_{n}") * (1 + size) for n in (1, 2)}
    return replace(truck, steering=replace(truck.steering, **lags))


def _ratio(truck: Truck, size: float) -> Truck:
    if size <= -1:
        raise BadRecipe(f"mismatch of the ratio is {size:g}, need more than -1")
    table = np.array(truck.steering.ratio, dtype=np.float64)
    table[:, 1] /= 1 + size
    return replace(truck, steering=replace(truck.steering, ratio=table))


_CHANGES: dict[str, Callable[[Truck, float], Truck]] = {
    "mass": _mass,
    "stiffness": _stiffness,
    "friction": _friction,
    "dead_time": _dead_time,
    "time_constant": _time_constant,
    "ratio": _ratio,
}
