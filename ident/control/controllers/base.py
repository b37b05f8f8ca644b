"""What all controllers share: where the truck will be when a request takes effect, and what it can be asked.

A cycle is ``begin`` (estimate, predict over the commands on their way, project on the path), then the
controller's own law at the ``Situation`` it is given, then ``command`` (limits, memory, diagnostics):

    situation = self.base.begin(measured, reference)
    request = self.base.request_for(wanted road-wheel angle)
    return self.base.command(situation, request, acceleration)

A ``Base`` is made from a ``Truck`` as it is believed to be and sees measurements; it knows nothing of a
simulation.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.controller import Command, Diagnostics, Measured
from ident.control.controllers.followed import Followed
from ident.control.controllers.speed_control import acceleration_for
from ident.control.estimator import Estimator
from ident.control.prediction import Prediction
from ident.control.reference import Reference
from ident.control.truck import Truck

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Situation:
    """What a controller decides on.

    started : reading of the process's clock, for the solve time [s]
    time : of the measurement [s]; effective : when a steering request that is sent now takes effect [s]
    arc_length, lateral_error, heading_error : of the tracked point at the time of the measurement [m], [rad]
    state : (nx,) in the order of ``Prediction.states`` in time, at ``effective``, with the road's errors
    pose : x, y and heading of the tracked point then [m], [rad]
    lateness : at ``effective``: time since the first cycle less the stipulated one [s]
    disturbance : (nd,) in the order of ``Prediction.disturbances``
    previous : the requests sent before, of steering [rad] and of acceleration [m/s²]
    """

    started: float
    time: float
    effective: float
    arc_length: float
    lateral_error: float
    heading_error: float
    state: Array
    pose: tuple[float, float, float]
    lateness: float
    disturbance: Array
    previous: tuple[float, float]


class Base:
    """Dead time, disturbances, projection and limits of one controller.

    truck : as the designer believes it to be; period : of the controller [s]
    further : how far beyond the dead time a situation lies, the last request held [s]; a law without a model
        of the steering's lags looks as far ahead as they last
    """

    def __init__(self, truck: Truck, period: float, *, further: float = 0.0) -> None:
        self.truck, self.period = truck, period
        self.prediction = Prediction(truck, "time")
        self.index = self.prediction.index
        self.estimator = Estimator(self.prediction, period)
        self._ahead = truck.steering.dead_time + further
        table = np.asarray(truck.steering.ratio, dtype=np.float64)
        self._road, self._wheel = table[:, 1], table[:, 0]
        ends = [self._before_ratio(side * truck.highest_angle) / truck.steering.gain for side in (-1.0, 1.0)]
        self.lowest_request, self.highest_request = min(ends), max(ends)
        self.reset()

    def reset(self) -> None:
        """Forget all runs before."""
        self.estimator.reset()
        self._followed: Followed | None = None
        self._clock: float | None = None

    def begin(self, measured: Measured, reference: Reference) -> Situation:
        """Estimate, predict and project."""
        started = time.perf_counter()
        estimator, tracked_x = self.estimator, reference.tracked_x
        road = self.road(reference)
        estimator.update(measured, tracked_x)
        now = road.project(*self.pose(estimator.state))
        effective = measured.time + self._ahead
        state = estimator.ahead(effective, tracked_x).copy()
        pose = self.pose(state)
        then = road.project(*pose, near=now.arc_length)
        for name in ("arc_length", "lateral_error", "heading_error"):
            state[self.index[name]] = getattr(then, name)
        return Situation(
            started,
            measured.time,
            effective,
            now.arc_length,
            now.lateral_error,
            now.heading_error,
            state,
            pose,
            self._lateness(road, measured.time, now.arc_length, effective, then.arc_length),
            estimator.disturbance,
            estimator.sent.last,
        )

    def road(self, reference: Reference) -> Followed:
        """The reference, ready to be projected on and read."""
        if self._followed is None or self._followed.reference is not reference:
            self._followed = Followed(reference)
        return self._followed

    def _lateness(self, road: Followed, now: float, here: float, effective: float, there: float) -> float:
        """How much later than stipulated a truck that began on time is at a place [s]."""
        if self._clock is None:
            self._clock = now - road.time(here)
        return effective - self._clock - road.time(there)

    def acceleration(self, situation: Situation, reference: Reference) -> float:
        """Acceleration request of a controller that steers only [m/s²]."""
        place, speed = (
            float(situation.state[self.index[n]]) for n in ("arc_length", "longitudinal_velocity")
        )
        row = self.road(reference).row(place)
        wanted = row["speed"], row["acceleration"]
        disturbance = float(situation.disturbance[1])
        return acceleration_for(self.truck.drive, wanted, speed, situation.lateness, disturbance)

    def pose(self, state: Array) -> tuple[float, float, float]:
        """x, y and heading of a state in the plane."""
        x, y, heading = (
            float(state[self.index[n]]) for n in ("arc_length", "lateral_error", "heading_error")
        )
        return x, y, heading

    def request_for(self, road_wheel_angle: float) -> float:
        """Steering request [rad] that in the end gives this road-wheel angle [rad], disturbance and all."""
        wanted = self._before_ratio(road_wheel_angle) / self.truck.steering.gain
        return wanted - float(self.estimator.disturbance[0])

    def limited(self, request: float) -> float:
        """The nearest steering request [rad] within the limits of angle and rate."""
        request = min(max(request, self.lowest_request), self.highest_request)
        rate = self.truck.steering.rate_limit
        if rate is None:
            return request
        reach = rate * self.period / abs(self.truck.steering.gain)
        before = self.estimator.sent.last[0]
        return min(max(request, before - reach), before + reach)

    def command(
        self, situation: Situation, steering: float, acceleration: float, **diagnostics: Any
    ) -> tuple[Command, Diagnostics]:
        """Send requests within the limits; ``diagnostics`` are further fields of ``Diagnostics``."""
        drive = self.truck.drive
        acceleration = min(max(acceleration, drive.lowest), drive.highest)
        steering = self.limited(steering)
        self.estimator.sent.add(situation.time, (steering, acceleration))
        spent = time.perf_counter() - situation.started
        errors = situation.lateral_error, situation.heading_error
        return Command(steering, acceleration), Diagnostics(spent, *errors, **diagnostics)

    def _before_ratio(self, road_wheel_angle: float) -> float:
        """Angle before the ratio map, linear between the rows of the table and beyond its ends [rad]."""
        road, wheel = self._road, self._wheel
        rises = road[-1] > road[0]
        place = int(
            np.searchsorted(road if rises else -road, road_wheel_angle if rises else -road_wheel_angle)
        )
        k = min(max(place - 1, 0), road.size - 2)
        slope = (wheel[k + 1] - wheel[k]) / (road[k + 1] - road[k])
        return float(wheel[k] + slope * (road_wheel_angle - road[k]))
