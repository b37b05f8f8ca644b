"""Tubes of a predictive controller against speed, from a bound of what one period's prediction misses.

The error about the nominal truck obeys e⁺ = (A - B K) e + w with the regulator of the terminal cost; ``tube``
gives a set that it does not leave. What is kept of it for each speed is how far it reaches along each state,
each request among them, and along each change of a request, K e: that is by how much limits are tightened.

The set is that of driving straight on at one speed; bends and changes of speed are not in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.mpc_model import REQUESTS, SPEEDS, Terminal
from ident.control.estimator import design
from ident.control.linear import Schedule
from ident.control.prediction import Prediction
from ident.control.tube import bounds_of_corrections, invariant_tube
from ident.errors import NotIdentifiable

Array = NDArray[np.float64]

LEAST_LEFT = 0.2  # of the room within limits that a tube leaves to the nominal truck
USUAL_PERIOD = 0.05  # [s] of the bounds below
# What one period's prediction misses at most where no residuals are given; steering as of the road wheels.
USUAL: Mapping[str, float] = {
    "lateral_velocity": 0.01,  # [m/s]
    "yaw_rate": 0.002,  # [rad/s]
    "lateral_error": 0.004,  # [m]
    "heading_error": 0.0005,  # [rad]
    "steering_angle": 0.0003,  # [rad]
    "longitudinal_velocity": 0.01,  # [m/s]
}


Bounds = Callable[[float], Mapping[str, float]]


class Tubes:
    """How far the set reaches, against speed.

    prediction, terminal : of the controller
    bounds : of a speed [m/s] -> state -> bound of its disturbance in one period; see ``usual_bounds`` and
        ``corrected_bounds``
    """

    def __init__(self, prediction: Prediction, terminal: Terminal, bounds: Bounds) -> None:
        boxes, changes = [], []
        for speed in SPEEDS:
            known = bounds(float(speed))
            sizes = np.array([*(known.get(name, 0.0) for name in prediction.states), *[0.0] * REQUESTS])
            tube = invariant_tube(terminal.closed.at(float(speed)), sizes)
            boxes.append(tube.box)
            changes.append(tube.reach(terminal.gain.at(float(speed))))
        self._box, self._changes = Schedule(SPEEDS, np.array(boxes)), Schedule(SPEEDS, np.array(changes))

    def box(self, speed: float) -> Array:
        """(n,) half widths about the nominal ξ."""
        return self._box.at(speed)

    def holds(self, error: Array, speed: float) -> bool:
        """Whether an error (n,) is within the box about the tube."""
        return bool(np.all(np.abs(error) <= self.box(speed)))

    def tightened(self, low: Array, high: Array, speed: float) -> tuple[Array, Array]:
        """Limits (n,) of the nominal ξ; at least ``LEAST_LEFT`` of what was there remains."""
        room = 0.5 * (high - low)
        taken = np.minimum(self.box(speed), (1.0 - LEAST_LEFT) * room)
        return low + taken, high - taken

    def tightened_changes(self, changes: Array, speed: float) -> Array:
        """(N, 2) largest changes of the nominal requests."""
        found: Array = np.maximum(changes - self._changes.at(speed), LEAST_LEFT * changes)
        return found


def usual_bounds(prediction: Prediction, period: float) -> dict[str, float]:
    """``USUAL``, in the units of the model, for another period."""
    grown = sqrt(period / USUAL_PERIOD)
    unit = abs(prediction.mean_ratio)
    return {
        name: grown * size / (unit if name.startswith("steering") else 1.0) for name, size in USUAL.items()
    }


def corrected_bounds(prediction: Prediction, period: float, noise: Mapping[str, float]) -> Bounds:
    """What the estimator corrects in one period, from the residuals of the identified model.

    noise : signal of a log -> size of its residual, see ``tube.bounds_of_corrections``; a state of which it
        is not known is taken to be missed as usual
    """
    usual = usual_bounds(prediction, period)
    names = prediction.states[1:]
    gains, _ = design(prediction, period)

    def at(speed: float) -> Mapping[str, float]:
        own = np.ascontiguousarray(gains.at(speed)[: len(names)])
        return usual | bounds_of_corrections(noise, names, own)

    return at


def check_room(tubes: Tubes, prediction: Prediction, room: float, speed: float) -> None:
    """Refuse a tube that needs more of the steering than there is.

    room : largest steering request [rad]; speed : [m/s]

    Raises
    ------
    NotIdentifiable
        If it does.
    """
    needed = float(tubes.box(speed)[len(prediction.states)])
    if needed > (1.0 - LEAST_LEFT) * room:
        raise NotIdentifiable(
            f"at {speed:.1f} m/s the tube takes {needed:.3g} rad of the steering request, need at most "
            f"{(1.0 - LEAST_LEFT) * room:.3g} rad: the residuals are too large for a robust controller; "
            "record with less noise or improve the model first"
        )
