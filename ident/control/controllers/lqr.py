"""Linear quadratic regulator on the errors from the road, with feed-forward, the steering's lags included.

    u = u_ref(s) - K (x - x_ref(s)),      x = [v_y, r, e_y, e_ψ, steering angle, steering rate]

(without v_y and r on the kinematic model). K solves the algebraic Riccati equation of the model at the speed
of the moment, discretised exactly, at the place where the truck will be when the request takes effect. The
reference is the steady cornering at that place with the estimated disturbances, so that no offset is left
where it is constant, and on top what the truck's lags make of it where it changes (``feed_forward``).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.base import Base
from ident.control.controllers.controller import Command, Diagnostics, Measured
from ident.control.controllers.feed_forward import Course, Regulator, Scheduled, course_along, regulator_at
from ident.control.controllers.targets import Targets
from ident.control.controllers.weights import ACCEPTABLE, weight
from ident.control.estimator import SPEEDS
from ident.control.prediction import Prediction
from ident.control.reference import Reference
from ident.control.truck import Truck

Array = NDArray[np.float64]

LATERAL = (
    "lateral_velocity",
    "yaw_rate",
    "lateral_error",
    "heading_error",
    "steering_angle",
    "steering_rate",
)
CHEAP = 10.0  # times the acceptable deviations of the steering, for the feed-forward


class LQR:
    """One steering request from the gains at the speed of the moment; the speed is held beside it.

    truck : as it is believed to be; period : [s]; weights : acceptable deviations, see ``weights``
    """

    name = "lqr"

    def __init__(self, truck: Truck, period: float, weights: Mapping[str, float] | None = None) -> None:
        self.period = period
        self.weights = dict(ACCEPTABLE if weights is None else weights)
        self.base = Base(truck, period)
        self._places = [self.base.index[name] for name in LATERAL if name in self.base.index]
        self._laws: dict[tuple[float, float], Scheduled] = {}
        self._followed: tuple[Targets, Course] | None = None

    def reset(self) -> None:
        """Forget all runs before."""
        self.base.reset()

    def step(self, measured: Measured, reference: Reference) -> tuple[Command, Diagnostics]:
        """Return the command for the period that begins now."""
        situation = self.base.begin(measured, reference)
        targets, course = self._along(reference)
        state = situation.state
        speed = float(state[self.base.index["longitudinal_velocity"]])
        goals = targets.at(state[:1], situation.disturbance)
        deviation, feed_forward = course.at(float(state[0]))
        wanted = goals.states[0, self._places] + deviation
        gain = self.law(reference.tracked_x).gain(speed)
        steering = goals.controls[0, 0] + feed_forward - gain @ (state[self._places] - wanted)
        return self.base.command(situation, float(steering), self.base.acceleration(situation, reference))

    def _along(self, reference: Reference) -> tuple[Targets, Course]:
        """Goals and course of a reference, computed when it is first seen."""
        if self._followed is None or self._followed[0].reference is not reference:
            targets = Targets(self.base.prediction, reference)
            cheap = self.law(reference.tracked_x, CHEAP)
            count = len(self.base.prediction.disturbances)
            self._followed = targets, course_along(targets, self._places, count, cheap, self.period)
        return self._followed

    def law(self, tracked_x: float, cheapness: float = 1.0) -> Scheduled:
        """Regulators for a tracked point this far forward of the centre of gravity [m], made once.

        cheapness : factor of the acceptable deviations of the steering
        """
        key = tracked_x, cheapness
        if key not in self._laws:
            made = [self._designed(float(speed), tracked_x, cheapness) for speed in SPEEDS]
            self._laws[key] = Scheduled(SPEEDS, made)
        return self._laws[key]

    def _designed(self, speed: float, tracked_x: float, cheapness: float) -> Regulator:
        prediction = self.base.prediction
        A, B = lateral_model(prediction, self._places, speed, tracked_x)
        names = [prediction.states[place] for place in self._places]
        wheels = prediction.mean_ratio / cheapness
        Q = np.diag([weight(self.weights, n) * (wheels**2 if "steering" in n else 1.0) for n in names])
        R = weight(self.weights, "steering_request") * wheels**2
        return regulator_at(A, B, Q, R, self.period)


def lateral_model(
    prediction: Prediction, places: list[int], speed: float, tracked_x: float
) -> tuple[Array, Array]:
    """A (n, n) and B (n, 1) to the steering request, of some states while driving straight on.

    speed : [m/s]; tracked_x : [m]
    """
    state = np.zeros(len(prediction.states))
    state[prediction.index["longitudinal_velocity"]] = speed
    nothing = np.zeros(len(prediction.disturbances))
    inputs = prediction.inputs(np.zeros(2), 0.0, np.zeros(()), nothing)
    _, A, B = prediction.jacobians(state, inputs, tracked_x)
    return np.ascontiguousarray(A[np.ix_(places, places)]), np.ascontiguousarray(B[places, :1])
