"""What PID, pure pursuit and Stanley share: deviations from steady cornering, and the steering that corrects.

Each is a law for how much sharper than the reference the truck is to turn. All take the reference's steady
cornering, made steady for the estimated disturbances, as feed-forward and as what they compare with, so that
none leaves an offset in a steady curve, on a bank or with a wrong steering offset. None knows the lags of the
steering; they decide instead on where the truck will be when those have passed, the last request held.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.base import Base, Situation
from ident.control.controllers.controller import Command, Diagnostics, Measured
from ident.control.controllers.targets import Goals, Targets
from ident.control.estimator import SPEEDS
from ident.control.linear import Schedule
from ident.control.prediction import Prediction
from ident.control.reference import Reference
from ident.control.truck import Truck
from ident.dynamics.blocks import ratio_map

Array = NDArray[np.float64]

SLOWEST = 2.0  # [m/s] below which a gain that goes with one over the speed does not grow any more


@dataclass(frozen=True)
class Deviation:
    """How the truck will be beside steady cornering when the steering's lags have passed.

    speed : [m/s]; lateral_error : left positive [m]; heading_error : beside that of the reference [rad]
    yaw_rate : beside that of the reference [rad/s]; road_wheel_angle : of the reference [rad]
    """

    situation: Situation
    reference: Reference
    targets: Targets
    speed: float
    lateral_error: float
    heading_error: float
    yaw_rate: float
    road_wheel_angle: float


class SteadyCornering:
    """The common part of the controllers without a model of the lags.

    truck : as it is believed to be; period : [s]
    lead : how much further than the steering's lags to look, for those of the tyres [s]
    """

    def __init__(self, truck: Truck, period: float, lead: float) -> None:
        steering = truck.steering
        further = steering.time_constant_1 + steering.time_constant_2 + lead
        self.base = Base(truck, period, further=further)
        self._targets: Targets | None = None
        self._angle_per_curvature: tuple[float, Schedule] | None = None

    def reset(self) -> None:
        """Forget all runs before."""
        self.base.reset()

    def begin(self, measured: Measured, reference: Reference) -> Deviation:
        """Estimate, predict, and compare with steady cornering."""
        situation = self.base.begin(measured, reference)
        if self._targets is None or self._targets.reference is not reference:
            self._targets = Targets(self.base.prediction, reference)
        goals = self._targets.at(situation.state[:1], situation.disturbance)
        index, state = self.base.index, situation.state
        speed = float(state[index["longitudinal_velocity"]])
        aside, heading = (float(state[index[n]]) for n in ("lateral_error", "heading_error"))
        turned = heading - float(goals.states[0, index["heading_error"]])
        turning = self._yaw_rate(state, goals) if "yaw_rate" in index else 0.0
        wheels, _ = ratio_map(self.base.truck.steering.ratio, goals.states[:, index["steering_angle"]])
        return Deviation(situation, reference, self._targets, speed, aside, turned, turning, float(wheels[0]))

    def command(self, deviation: Deviation, angle: float) -> tuple[Command, Diagnostics]:
        """Steer this much beside the reference [rad, at the road wheels], and hold the speed."""
        base = self.base
        steering = base.request_for(deviation.road_wheel_angle + angle)
        acceleration = base.acceleration(deviation.situation, deviation.reference)
        return base.command(deviation.situation, steering, acceleration)

    def angle_for(self, curvature: float, deviation: Deviation) -> float:
        """Road-wheel angle [rad] that in the end changes the curvature of the course by this much [1/m]."""
        tracked_x = deviation.reference.tracked_x
        if self._angle_per_curvature is None or self._angle_per_curvature[0] != tracked_x:
            values = [angle_per_curvature(self.base.prediction, float(v), tracked_x) for v in SPEEDS]
            self._angle_per_curvature = tracked_x, Schedule(SPEEDS, np.array(values))
        return curvature * float(self._angle_per_curvature[1].at(deviation.speed))

    def is_limited(self, deviation: Deviation, command: Command) -> bool:
        """Whether the request stands at a limit."""
        ends = self.base.lowest_request, self.base.highest_request
        rate = self.base.truck.steering.rate_limit
        moved = abs(command.steering_request - deviation.situation.previous[0])
        is_fast = (
            rate is not None and moved * abs(self.base.truck.steering.gain) >= 0.999 * rate * self.base.period
        )
        return is_fast or not ends[0] < command.steering_request < ends[1]

    def _yaw_rate(self, state: Array, goals: Goals) -> float:
        """Beside that of the reference at the speed of the moment [rad/s]."""
        index = self.base.index
        turn, speed = index["yaw_rate"], index["longitudinal_velocity"]
        wanted = goals.states[0, turn] * state[speed] / goals.states[0, speed]
        return float(state[turn] - wanted)


class SteeredBeside:
    """A controller that steers beside steady cornering by a law of its own; the speed is held beside it.

    truck : as it is believed to be; period : [s]
    weights : of the law, with ``lead``; those of ``gains`` where None
    """

    name: ClassVar[str]
    gains: ClassVar[Mapping[str, float]]

    def __init__(self, truck: Truck, period: float, weights: Mapping[str, float] | None = None) -> None:
        self.period = period
        self.weights = dict(self.gains if weights is None else weights)
        self.cornering = SteadyCornering(truck, period, self.weights["lead"])

    @property
    def base(self) -> Base:
        """What all controllers share."""
        return self.cornering.base

    def reset(self) -> None:
        """Forget all runs before."""
        self.cornering.reset()


def angle_per_curvature(prediction: Prediction, speed: float, tracked_x: float) -> float:
    """Road-wheel angle by curvature of steady cornering, for small ones [rad m]: L + K_us v² of the model.

    speed : [m/s]; tracked_x : [m]
    """
    index = prediction.index
    unknown = [n for n in ("lateral_velocity", "yaw_rate", "heading_error", "steering_angle") if n in index]
    equations = [n for n in ("lateral_velocity", "yaw_rate", "lateral_error", "heading_error") if n in index]
    rows = [index[name] for name in equations]
    state = np.zeros(len(prediction.states))
    state[index["longitudinal_velocity"]] = speed
    nothing = np.zeros(len(prediction.disturbances))
    inputs = prediction.inputs(np.zeros(2), 0.0, np.zeros(()), nothing)
    _, A, B = prediction.jacobians(state, inputs, tracked_x)
    matrix = A[np.ix_(rows, [index[name] for name in unknown])]
    found = np.linalg.solve(matrix, -B[rows, prediction.engine.inputs.index("curvature")])
    return float(found[-1] * inputs[prediction.engine.inputs.index("ratio_slope")])
