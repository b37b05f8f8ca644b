"""The model of a predictive controller with its last requests as states, its weights, and its terminal cost.

    ξ = (x, u_before),  Δu = u - u_before:   ξ⁺ = [[A, B], [0, I]] ξ + [[B], [I]] Δu + [c, 0]

so that what a change of a request costs and how fast it may change are a weight and a limit of the input, and
how far a request may go is a limit of a state.

Weights are those of ``weights``: each quantity counts by the square of its acceptable deviation, integrated
over time. The steering is priced by how its request changes, and not by how far it is from that of steady
cornering, which no manoeuvre holds. The terminal cost is that of the infinite horizon on a straight road at
the speed of the horizon's end, from the discrete algebraic Riccati equation (ARE).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.weights import ACCEPTABLE, weight
from ident.control.linear import Schedule, regulator
from ident.control.prediction import CONTROLS, Prediction

Array = NDArray[np.float64]

SPEEDS = np.arange(1.0, 36.0, 2.0)  # [m/s] for which the terminal cost is made
REQUESTS = 2
ALWAYS = ("steering_request_rate", "acceleration_request_rate")  # weighed as in ``weights`` where not told


@dataclass(frozen=True)
class Augmented:
    """Dynamics of ξ over N steps: A (N, n, n), B (N, n, 2), c (N, n)."""

    A: Array
    B: Array
    c: Array


def augmented(A: Array, B: Array, c: Array) -> Augmented:
    """Dynamics of ξ from those of x: A (N, nx, nx), B (N, nx, 2), c (N, nx)."""
    count, size = c.shape
    joint = np.zeros((count, size + REQUESTS, size + REQUESTS))
    joint[:, :size, :size], joint[:, :size, size:] = A, B
    joint[:, size:, size:] = np.eye(REQUESTS)
    steered = np.zeros((count, size + REQUESTS, REQUESTS))
    steered[:, :size], steered[:, size:] = B, np.eye(REQUESTS)
    return Augmented(joint, steered, np.hstack([c, np.zeros((count, REQUESTS))]))


class Weights:
    """The rule of ``weights`` for one model.

    acceptable : deviations by name, as ``weights.ACCEPTABLE``; what is not named has no weight
    """

    def __init__(self, prediction: Prediction, acceptable: Mapping[str, float]) -> None:
        self._prediction = prediction
        self._acceptable = {name: ACCEPTABLE[name] for name in ALWAYS} | dict(acceptable)
        self._slope = abs(prediction.mean_ratio)

    def of_states(self, speed: float, duration: float) -> Array:
        """(n,) diagonal of Q of a step of this duration [s] at this speed [m/s]."""
        names = (*self._prediction.states, "", "acceleration_request")
        return np.array([duration * self._weight(name, speed) for name in names])

    def of_changes(self, duration: float) -> Array:
        """(2,) diagonal of R of the change of the requests from one step to the next."""
        return np.array([self._weight(f"{name}_rate", 1.0) / duration for name in CONTROLS])

    def _weight(self, name: str, speed: float) -> float:
        if name == "arc_length":
            return weight(self._acceptable, "time") / speed**2
        unit = self._slope if name.startswith("steering") else 1.0
        return weight(self._acceptable, name) * unit**2


@dataclass(frozen=True)
class Terminal:
    """Of driving straight on, against speed.

    cost : P (n, n); gain : K (2, n) of Δu = -K ξ, in deviations from the goals
    closed : A - B K (n, n)
    """

    cost: Schedule
    gain: Schedule
    closed: Schedule


def terminal(prediction: Prediction, weights: Weights, duration: float, tracked_x: float) -> Terminal:
    """The regulator of the infinite horizon with steps of this duration [s].

    tracked_x : of the tracked point, forward of the centre of gravity [m]
    """
    found = []
    for speed in SPEEDS:
        A, B = straight_on(prediction, float(speed), duration, tracked_x)
        Q = np.diag(weights.of_states(float(speed), duration))
        R = np.diag(weights.of_changes(duration))
        K, P = regulator(A, B, Q, R)
        found.append((P, K, A - B @ K))
    cost, gain, closed = (Schedule(SPEEDS, np.array(part)) for part in zip(*found, strict=True))
    return Terminal(cost, gain, closed)


def straight_on(
    prediction: Prediction, speed: float, duration: float, tracked_x: float
) -> tuple[Array, Array]:
    """A (n, n) and B (n, 2) of ξ over one step of driving straight on at a speed [m/s]."""
    state = np.zeros((1, len(prediction.states)))
    state[0, prediction.index["longitudinal_velocity"]] = speed
    nothing = np.zeros(len(prediction.disturbances))
    inputs = prediction.inputs(np.zeros((1, REQUESTS)), np.zeros(1), np.zeros(1), nothing)
    step = np.array([duration * speed if "time" in prediction.index else duration])
    stages = prediction.linearised(state, inputs, step, tracked_x)
    joint = augmented(stages.A, stages.B, stages.c)
    return joint.A[0], joint.B[0]
