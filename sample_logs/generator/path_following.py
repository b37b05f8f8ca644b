"""A truck that follows a path: pure pursuit on the logged odometry, a driver before, between and after.

The controller runs whenever a request is due: it takes the newest odometry message that has reached it,
finds the nearest point of the path, and asks for the steering that leads the rear axle along a circle to a
point ahead. While it is engaged, the steering actuator acts on the requests; otherwise the driver's hands
do, and the topic carries requests that nobody acts on. The wheel passes from one to the other as it stands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from .actuator import WheelState, held_response
from .driving import Speed, smooth_step
from .motion import HEADING, MARGIN, ODOMETRY, X, Y
from .recorder import Plan, Recorder
from .sensors import Stamps, generator, quantise, schedule, seconds
from .steering import REQUEST
from .truth import Actuator, Truth
from .vehicle import STEP, Motion, simulate

Array = NDArray[np.float64]
Pose = tuple[float, float, float]

SPACING = 0.1  # [m] between the points of a path
SEARCH = 100  # points either side of the last nearest one
HANDS = Actuator(gain=1.0, dead_time=0.0, time_constant_1=0.2, time_constant_2=0.12)
DRIVERS_LOOK = 22.0  # [m] ahead
DRIVERS_WANDER = 0.02  # [rad] at the steering wheel per metre looked ahead


@dataclass(frozen=True)
class Task:
    """What is to be followed, and who steers.

    offset : lateral offset of the path [m] along a straight line [m]
    speeds : [m/s], evenly spaced over the run
    look : how far ahead the controller looks [m]
    engaged : spans of time in which the actuator acts on the requests [s]
    idle : what the topic carries otherwise: zeros, or the last request
    duration : [s]
    """

    offset: Callable[[Array], Array]
    speeds: tuple[float, ...]
    look: float
    engaged: tuple[tuple[float, float], ...]
    idle: Literal["zero", "held"]
    duration: float

    def is_engaged(self, time: float) -> bool:
        """Whether the actuator acts on what is requested at this time [s]."""
        return any(begin <= time < end for begin, end in self.engaged)


@dataclass(frozen=True)
class Followed:
    """What happened.

    wheel : (2 n + 1,) steering-wheel angle at every half step [rad]
    stamps : (m,) when the controller ran [ns]
    request, engaged, speed : (m,) [rad], [-], [m/s]
    reference : (m, 3) nearest point of the path, x, y [m] and heading [rad]
    """

    motion: Motion
    wheel: Array
    stamps: Stamps
    request: Array
    engaged: NDArray[np.bool_]
    speed: Array
    reference: Array


def lane_changes(along: Array) -> Array:
    """To the left lane and back, twice [m]."""
    there = smooth_step((along - 100.0) / 36.0) + smooth_step((along - 330.0) / 36.0)
    back = smooth_step((along - 170.0) / 36.0) + smooth_step((along - 400.0) / 36.0)
    return 3.5 * (there - back)


def waves(along: Array) -> Array:
    """A sine of growing amplitude [m]."""
    return 1.8 * smooth_step(along / 90.0) * np.sin(2.0 * np.pi * along / 70.0)


TASKS = {
    "path_a": Task(lane_changes, (8.5, 9.5, 10.0, 9.6, 8.8), 18.0, ((9.0, 46.0),), "zero", 58.0),
    "path_b": Task(waves, (7.5, 8.0, 8.6, 8.2, 7.6), 13.0, ((8.0, 27.0), (36.0, 55.0)), "held", 62.0),
}


def follow(task: Task, truth: Truth, recorder: Recorder, pose: Array) -> Followed:
    """Drive a task from a pose (x, y [m] and heading [rad]) of the path's beginning."""
    speed = Speed(PchipInterpolator(np.linspace(0.0, task.duration + 1.0, len(task.speeds)), task.speeds))
    path = _path(task, pose, 1.1 * max(task.speeds) * task.duration + 50.0)
    stamps = schedule(
        truth.steering.request, 0.0, task.duration, generator(recorder.seed, recorder.name, REQUEST)
    )
    truck = _SteeredTruck(truth, speed, path[0], task.duration + MARGIN)
    eyes = _Eyes(truth, recorder.plan(ODOMETRY, truth.odometry), truck)
    nearest, rows, last = 0, [], 0.0
    for time in seconds(stamps).tolist():
        truck.advance(time)
        seen = eyes.pose(time)
        nearest = _nearest(path, nearest, seen)
        engaged = task.is_engaged(time)
        if engaged:
            last = _pursue(truth, path, nearest, seen, task.look)
            truck.steer(truth.steering.actuator, time, last)
        else:
            wander = DRIVERS_WANDER * DRIVERS_LOOK * np.sin(0.4 * time) / 4.0
            truck.steer(HANDS, time, _pursue(truth, path, nearest, seen, DRIVERS_LOOK) + wander)
        request = last if engaged or task.idle == "held" else 0.0
        rows.append((request, engaged, *path[nearest]))
    truck.advance(task.duration + MARGIN)
    table = np.array(rows)
    return Followed(
        motion=Motion(STEP * np.arange(len(truck.states)), truck.states, truck.rates),
        wheel=truck.wheel_angle,
        stamps=stamps,
        request=table[:, 0],
        engaged=table[:, 1].astype(bool),
        speed=speed(seconds(stamps)),
        reference=table[:, 2:],
    )


def _path(task: Task, pose: Array, length: float) -> Array:
    """(n, 3) points x, y [m] and heading [rad], every ``SPACING`` along the straight line."""
    along = np.arange(0.0, length, SPACING)
    across = task.offset(along)
    x, y, heading = pose
    turned_x = x + along * np.cos(heading) - across * np.sin(heading)
    turned_y = y + along * np.sin(heading) + across * np.cos(heading)
    return np.column_stack([turned_x, turned_y, heading + np.arctan(np.gradient(across, SPACING))])


def _nearest(path: Array, last: int, seen: Pose) -> int:
    begin = max(last - SEARCH, 0)
    part = path[begin : last + SEARCH]
    return begin + int(np.argmin((part[:, 0] - seen[0]) ** 2 + (part[:, 1] - seen[1]) ** 2))


def _pursue(truth: Truth, path: Array, nearest: int, seen: Pose, look: float) -> float:
    """Steering-wheel angle [rad] of the circle from the rear axle to the path's point ahead."""
    x, y, heading = seen
    target = path[min(nearest + round(look / SPACING), len(path) - 1)]
    ahead = np.cos(heading) * (target[0] - x) + np.sin(heading) * (target[1] - y)
    left = np.cos(heading) * (target[1] - y) - np.sin(heading) * (target[0] - x)
    curvature = 2.0 * left / (ahead**2 + left**2)
    body = truth.truck.body
    wheelbase = body.cg_to_front_axle + body.cg_to_rear_axle
    return float(truth.truck.steering_ratio * np.arctan(wheelbase * curvature))


class _SteeredTruck:
    """The truck on two tracks, advanced from one command to the next."""

    def __init__(self, truth: Truth, speed: Speed, start: Array, duration: float) -> None:
        steps = round(duration / STEP)
        behind = truth.truck.body.cg_to_rear_axle
        x, y, heading = start
        cg = x + behind * np.cos(heading), y + behind * np.sin(heading), heading
        self.truck, self.speed = truth.truck, speed
        self.at = 0
        self.states, self.rates = np.zeros((steps + 1, 6)), np.zeros((steps + 1, 6))
        self.states[0] = float(speed(np.zeros(1))[0]), 0.0, 0.0, *cg
        self.wheel_angle = np.zeros(2 * steps + 1)
        self.plant, self.wheel = HANDS, WheelState(0.0, 0.0, 0.0, 0.0)
        self.sent: list[tuple[float, float]] = []

    def steer(self, plant: Actuator, time: float, angle: float) -> None:
        """Send a command to the actuator or to the hands; whoever takes over finds the wheel as it is."""
        if plant is not self.plant:
            wheel = self.wheel
            self.plant, self.sent = plant, []
            self.wheel = WheelState(wheel.time, wheel.angle, wheel.rate, wheel.angle / plant.gain)
        self.sent.append((time, angle))

    def advance(self, time: float) -> None:
        """Move to the last whole step that is not after ``time`` [s]."""
        begin, end = self.at, min(int(time / STEP), len(self.states) - 1)
        if end <= begin:
            return
        half_steps = STEP / 2.0 * np.arange(2 * begin, 2 * end + 1)
        angle = self._turn_wheel(half_steps)
        inputs = np.column_stack([angle, self.speed(half_steps), self.speed.rate(half_steps)])
        motion = simulate(self.truck, self.states[begin], half_steps[0], inputs)
        self.states[begin : end + 1], self.rates[begin : end + 1] = motion.states, motion.rates
        self.wheel_angle[2 * begin : 2 * end + 1] = angle
        self.at = end

    def _turn_wheel(self, times: Array) -> Array:
        sent_time, sent = np.array(self.sent).reshape(-1, 2).T
        angle, rate = held_response(self.plant, sent_time, sent, times, self.wheel)
        arrived = [value for at, value in self.sent if at + self.plant.dead_time <= times[-1]]
        command = arrived[-1] if arrived else self.wheel.command
        self.wheel = WheelState(float(times[-1]), float(angle[-1]), float(rate[-1]), command)
        self.sent = self.sent[len(arrived) :]
        return angle


class _Eyes:
    """What the controller knows of the pose of the rear axle: the newest odometry that has reached it."""

    def __init__(self, truth: Truth, plan: Plan, truck: _SteeredTruck) -> None:
        self.channels = [(truth.odometry.channels[name], plan.errors[name]) for name in ("x", "y", "heading")]
        self.behind = truth.truck.body.cg_to_rear_axle
        self.stamps, self.arrivals = seconds(plan.stamps), seconds(plan.arrivals)
        self.truck = truck

    def pose(self, time: float) -> Pose:
        """Position [m] and heading [rad] as the log has them; the true ones before the first message."""
        reached = np.searchsorted(self.arrivals, time, side="right")
        simulated = np.searchsorted(self.stamps, STEP * self.truck.at, side="right")
        index = int(min(reached, simulated)) - 1
        if index < 0:
            return tuple(self._true(0.0).tolist())
        true = self._true(self.stamps[index])
        seen = (
            quantise(c, value + errors[index]) for (c, errors), value in zip(self.channels, true, strict=True)
        )
        return tuple(float(value) for value in seen)

    def _true(self, time: float) -> Array:
        before = int(time / STEP)
        part = time / STEP - before
        rows = self.truck.states[[before, before + (part > 0.0)]]
        heading = rows[:, HEADING]
        x = rows[:, X] - self.behind * np.cos(heading)
        y = rows[:, Y] - self.behind * np.sin(heading)
        return (1.0 - part) * np.array([x[0], y[0], heading[0]]) + part * np.array([x[1], y[1], heading[1]])
