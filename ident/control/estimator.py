"""Where the truck is, what pushes it, and where it will be when a request that is sent now takes effect.

A stationary Kalman filter about the nonlinear prediction model: every cycle the model runs from the last
estimate over the commands in force, and what was measured corrects it. Beside its states it estimates
constant disturbances (``prediction.DISTURBANCES``), one for each measured motion, so that a controller that
takes them into account leaves no offset (Pannocchia and Rawlings, AIChE Journal 49, 2003: as many
disturbances as measurements). Its gains come from the algebraic Riccati equation on a grid of speeds.

Dead time is compensated by running the same model on, from the estimate over the commands that are on their
way. What the angle sensor reads is where prediction begins, so that a wrong dead time spoils no more than
the stretch from now to when the request takes effect.

Everything is in the plane: the road of the model is the x axis (curvature zero), so that its arc length,
lateral error and heading error are x, y and heading of the tracked point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.controller import Measured
from ident.control.linear import Schedule, held_step_once, observer, spectral_radius
from ident.control.prediction import Prediction
from ident.control.truck import Truck
from ident.dynamics.second_order import held_response

Array = NDArray[np.float64]

SPEEDS = np.arange(1.0, 36.0, 2.0)  # [m/s] for which gains are made
STABLE_STEP = 0.4  # largest product of a step of the integration and the fastest eigenvalue
LONGEST_STEP = 0.01  # [s]
FLAT = 1e-9  # [s] below which two instants are one

# What the sensors are taken to add, and how fast what the model does not know may change. Steering angles in
# units of the road wheels.
MEASUREMENT = {
    "lateral_velocity": 0.05,  # [m/s]
    "yaw_rate": 0.004,  # [rad/s]
    "lateral_error": 0.03,  # [m]
    "heading_error": 0.003,  # [rad]
    "steering_angle": 0.0005,  # [rad]
    "steering_rate": 0.01,  # [rad/s]
    "longitudinal_velocity": 0.05,  # [m/s]
    "longitudinal_acceleration": 0.1,  # [m/s²]
}
PROCESS = {
    "lateral_velocity": 0.1,  # [m/s/√s]
    "yaw_rate": 0.02,  # [rad/s/√s]
    "lateral_error": 0.05,  # [m/√s]
    "heading_error": 0.005,  # [rad/√s]
    "steering_angle": 0.005,  # [rad/√s]
    "steering_rate": 0.1,  # [rad/s/√s]
    "longitudinal_velocity": 0.05,  # [m/s/√s]
    "longitudinal_acceleration": 0.3,  # [m/s²/√s]
    "steering_disturbance": 0.001,  # [rad/√s]
    "drive_disturbance": 0.05,  # [m/s²/√s]
    "lateral_disturbance": 0.1,  # [m/s²/√s]
    "yaw_disturbance": 0.03,  # [rad/s²/√s]
    "drift": 0.02,  # [m/s/√s]
    "turn_drift": 0.001,  # [rad/s/√s]
}
# The kinematic model lacks the drift of cornering, which is no constant: what follows it fast feeds it back.
WITHOUT_TYRES = {"drift": 0.005, "turn_drift": 0.0003}
OF_THE_REQUEST = ("steering_angle", "steering_rate", "steering_disturbance")

_designs: dict[tuple[str, bytes, float, float], tuple[Schedule, Schedule]] = {}


class Sent:
    """The commands that were sent, and those among them that are still on their way."""

    def __init__(self, truck: Truck) -> None:
        self._delays = truck.steering.dead_time, truck.drive.dead_time
        self._kept = max(self._delays) + 1.0
        self._times: list[float] = []
        self._values: list[tuple[float, float]] = []

    def begin(self, time: float, values: tuple[float, float]) -> None:
        """Forget all, and take these requests as those in force so far."""
        self._times, self._values = [time - 2 * self._kept], [values]

    def add(self, time: float, values: tuple[float, float]) -> None:
        """Note the steering and the acceleration request sent at a time [s]."""
        self._times.append(time)
        self._values.append(values)
        while len(self._times) > 2 and self._times[1] < time - self._kept:
            del self._times[0], self._values[0]

    @property
    def last(self) -> tuple[float, float]:
        """The requests sent last."""
        return self._values[-1]

    def steering(self) -> tuple[Array, Array]:
        """Times at which steering requests were sent [s], and their values [rad]."""
        return np.array(self._times), np.array([values[0] for values in self._values])

    def between(self, start: float, end: float) -> tuple[Array, Array]:
        """Instants at which a request takes effect, and both requests in force from each.

        Returns
        -------
        times : (n,) [s], the first is ``start``, the last ``end``; requests : (n, 2)
        """
        changes = (time + delay for delay in self._delays for time in self._times)
        inner = sorted(at for at in changes if start + FLAT < at < end - FLAT)
        times = [start, *(at for k, at in enumerate(inner) if k == 0 or at > inner[k - 1] + FLAT), end]
        return np.array(times), np.array([self._in_force(at) for at in times])

    def _in_force(self, at: float) -> tuple[float, float]:
        found = [self._values[0][0], self._values[0][1]]
        for which, delay in enumerate(self._delays):
            for time, values in zip(self._times, self._values, strict=True):
                if time + delay <= at + FLAT:
                    found[which] = values[which]
        return found[0], found[1]


class Estimator:
    """State and disturbances of one truck, as its controller believes it to be.

    time : of the estimate [s]; state : (nx,) in the plane; disturbance : (nd,)
    """

    def __init__(self, prediction: Prediction, period: float) -> None:
        self.prediction = prediction
        self._gains, self._fastest = design(prediction, period)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.sent = Sent(self.prediction.truck)
        self.time = -math.inf
        self.state = np.zeros(len(self.prediction.states))
        self.disturbance = np.zeros(len(self.prediction.disturbances))

    def update(self, measured: Measured, tracked_x: float) -> None:
        """Take in what was measured; ``tracked_x`` is the tracked point, forward of the CG [m]."""
        seen = self._seen(measured, tracked_x)
        if math.isinf(self.time):
            gain = self.prediction.truck.steering.gain
            self.sent.begin(
                measured.time, (measured.steering_angle / gain, measured.longitudinal_acceleration)
            )
            self.state = seen
        else:
            expected = self.course(self.time, self.state, measured.time, tracked_x)[1][-1]
            self._correct(expected, seen)
        self.time = measured.time

    def ahead(self, until: float, tracked_x: float) -> Array:
        """(nx,) state in the plane at a later time [s], over the commands on their way."""
        _, states = self.course(self.time, self.state, until, tracked_x)
        last: Array = states[-1]
        return last

    def course(self, start: float, state: Array, end: float, tracked_x: float) -> tuple[Array, Array]:
        """The model from a state over the commands in force: times (n,) [s] and states (n, nx)."""
        if end - start < FLAT:
            return np.array([start]), state[None]
        times, requests = self.sent.between(start, end)
        steps = np.append(np.diff(times), 0.0)
        rows = self.prediction.inputs(requests, 0.0, self._angles(times, state), self.disturbance)
        longest = min(LONGEST_STEP, STABLE_STEP / float(self._fastest.at(self._speed(state))))
        substeps = np.maximum(np.ceil(steps / longest - FLAT), 1.0).astype(np.int64)
        values = self.prediction.parameters(tracked_x)
        engine = self.prediction.engine
        offsets = [0, times.size]
        states, _ = engine.simulate(
            state[None], rows, steps, offsets, values, held=engine.inputs, substeps=substeps
        )
        return times, states

    def _angles(self, times: Array, state: Array) -> Array:
        """(n,) steering angle at these times, exactly, by which a bent ratio map is read [rad]."""
        steering, place = self.prediction.truck.steering, self.prediction.index
        angle, rate = state[place["steering_angle"]], state[place["steering_rate"]]
        if not self.prediction.is_ratio_bent:
            return np.full(times.size, angle)
        sent, values = self.sent.steering()
        first, second = steering.time_constant_1, steering.time_constant_2
        driven = steering.gain * (values + self.disturbance[0])
        lags = steering.dead_time, first + second, first * second
        found = held_response(*lags, sent, driven, times, initial_angle=angle, initial_rate=rate)
        return np.ascontiguousarray(found[:, 0])

    def _speed(self, state: Array) -> float:
        return float(state[self.prediction.index["longitudinal_velocity"]])

    def _seen(self, measured: Measured, tracked_x: float) -> Array:
        """(nx,) what was measured, as a state."""
        heading = measured.heading
        known = {
            "arc_length": measured.position_x + tracked_x * math.cos(heading),
            "lateral_error": measured.position_y + tracked_x * math.sin(heading),
            "heading_error": heading,
        }
        return np.array([known.get(n, getattr(measured, n, 0.0)) for n in self.prediction.states])

    def _correct(self, expected: Array, seen: Array) -> None:
        """Correct the prediction; the position along the heading is taken as it was measured."""
        place = self.prediction.index["lateral_error"]
        heading = expected[self.prediction.index["heading_error"]]
        sine, cosine = math.sin(heading), math.cos(heading)
        missed = seen - expected
        across = cosine * missed[place] - sine * missed[0]
        innovation = missed[1:].copy()
        innovation[place - 1] = across
        correction = self._gains.at(self._speed(seen)) @ innovation
        count = expected.size - 1
        self.state = expected.copy()
        self.state[1:] += correction[:count]
        aside = correction[place - 1] - across
        self.state[0], self.state[place] = seen[0] - sine * aside, seen[place] + cosine * aside
        self.disturbance = self.disturbance + correction[count:]


def design(prediction: Prediction, period: float) -> tuple[Schedule, Schedule]:
    """Gains (nx - 1 + nd, nx - 1), and the fastest eigenvalue [1/s], against speed; made once a process."""
    key = (prediction.engine.name, prediction.parameters(0.0).tobytes(), prediction.mean_ratio, period)
    if key not in _designs:
        _designs[key] = _designed(prediction, period)
    return _designs[key]


def _designed(prediction: Prediction, period: float) -> tuple[Schedule, Schedule]:
    """Gains (nx - 1 + nd, nx - 1), and the largest magnitude of an eigenvalue [1/s], against speed."""
    names = prediction.states[1:]
    slope = prediction.mean_ratio
    measurement = _variances(MEASUREMENT, names, slope)
    sizes = PROCESS if "yaw_rate" in names else PROCESS | WITHOUT_TYRES
    process = _variances(sizes, (*names, *prediction.disturbances), slope) * period
    gains, fastest = [], []
    for speed in SPEEDS:
        A, E = straight(prediction, float(speed))
        size, extra = A.shape[0], E.shape[1]
        Ad, Ed = held_step_once(A, E, period)
        joint = np.block([[Ad, Ed], [np.zeros((extra, size)), np.eye(extra)]])
        seen = np.hstack([np.eye(size), np.zeros((size, extra))])
        gains.append(observer(joint, seen, process, measurement))
        fastest.append(spectral_radius(A))
    return Schedule(SPEEDS, np.array(gains)), Schedule(SPEEDS, np.array(fastest))


def straight(prediction: Prediction, speed: float) -> tuple[Array, Array]:
    """A (nx - 1, nx - 1) and the columns of the disturbances, of driving straight on at a speed [m/s]."""
    state = np.zeros(len(prediction.states))
    state[prediction.index["longitudinal_velocity"]] = speed
    inputs = prediction.inputs(np.zeros(2), 0.0, np.zeros(()), np.zeros(len(prediction.disturbances)))
    _, A, B = prediction.jacobians(state, inputs, 0.0)
    return np.ascontiguousarray(A[1:, 1:]), np.ascontiguousarray(B[1:, -len(prediction.disturbances) :])


def _variances(sizes: dict[str, float], names: Sequence[str], slope: float) -> Array:
    """Diagonal of squares; steering in the unit of the request."""
    return np.diag([(sizes[name] / (slope if name in OF_THE_REQUEST else 1.0)) ** 2 for name in names])
