"""The motion of a driven truck, and what its sensors are there to measure at any time of a recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .driving import Speed
from .messages import Topic
from .recorder import Recorder, Signal
from .sensors import seconds
from .truth import Planar, Truth, TwoTrack
from .vehicle import GRAVITY, STEP, Motion, simulate

Array = NDArray[np.float64]
Vehicle = Planar | TwoTrack

IMU = "/sensing/imu"
ODOMETRY = "/localization/odometry"
VELOCITY = "/vehicle/velocity"
MARGIN = 0.1  # [s] simulated beyond the end of a recording
V_X, V_Y, YAW_RATE, X, Y, HEADING = range(6)


def drive(vehicle: Vehicle, wheel: Signal, speed: Speed, duration: float, pose: Array) -> Motion:
    """Drive with a given steering-wheel angle [rad] from time zero, rolling straight on at first.

    ``pose`` is position [m] and heading [rad] of the centre of gravity at time zero.
    """
    time = STEP / 2.0 * np.arange(2 * round((duration + MARGIN) / STEP) + 1)
    inputs = np.column_stack([wheel(time), speed(time), speed.rate(time)])
    return simulate(vehicle, np.array([inputs[0, 1], 0.0, 0.0, *pose]), 0.0, inputs)


def motion_topics(recorder: Recorder, truth: Truth, vehicle: Vehicle, motion: Motion) -> list[Topic]:
    """Record the speed, the inertial unit and the odometry of the rear axle."""
    imu = imu_signals(vehicle, motion)
    odometry = rear_axle_signals(vehicle, motion)
    return [
        velocity_topic(recorder, truth, odometry["longitudinal_velocity"]),
        recorder.sensed(IMU, "imu", truth.imu, imu),
        recorder.sensed(ODOMETRY, "odometry", truth.odometry, odometry),
    ]


def velocity_topic(recorder: Recorder, truth: Truth, speed: Signal) -> Topic:
    """Record the speed of the wheels: without a turning wheel there is no pulse and the speed is zero."""
    topic = recorder.sensed(VELOCITY, "speed", truth.velocity, {"speed": speed})
    turning = speed(seconds(topic.stamps)) > 0.0
    measured = np.where(turning, topic.columns[0], 0.0)
    return Topic(topic.name, topic.kind, topic.stamps, topic.arrivals, (measured,))


def rear_axle_signals(vehicle: Vehicle, motion: Motion) -> dict[str, Signal]:
    """Pose and velocity of the middle of the rear axle, l_r behind the centre of gravity."""
    state, behind = motion.states.T, vehicle.body.cg_to_rear_axle
    true = {
        "x": state[X] - behind * np.cos(state[HEADING]),
        "y": state[Y] - behind * np.sin(state[HEADING]),
        "heading": state[HEADING],
        "longitudinal_velocity": state[V_X],
        "lateral_velocity": state[V_Y] - behind * state[YAW_RATE],
        "yaw_rate": state[YAW_RATE],
    }
    return _between(motion.time, true)


def imu_signals(vehicle: Vehicle, motion: Motion) -> dict[str, Signal]:
    """Turning rates and specific forces at the inertial unit, which does not roll or pitch.

    a_x,P = a_x - y_P ṙ - x_P r², a_y,P = a_y + x_P ṙ - y_P r².
    """
    state, rate = motion.states.T, motion.rates.T
    forward, left, _ = vehicle.imu_position
    along = rate[V_X] - state[V_Y] * state[YAW_RATE]
    across = rate[V_Y] + state[V_X] * state[YAW_RATE]
    turning, squared = rate[YAW_RATE], state[YAW_RATE] ** 2
    level = np.zeros_like(motion.time)
    true = {
        "roll_rate": level,
        "pitch_rate": level,
        "yaw_rate": state[YAW_RATE],
        "longitudinal_acceleration": along - left * turning - forward * squared,
        "lateral_acceleration": across + forward * turning - left * squared,
        "vertical_acceleration": level + GRAVITY,
    }
    return _between(motion.time, true)


def _between(grid: Array, true: dict[str, Array]) -> dict[str, Signal]:
    return {name: lambda time, values=values: np.interp(time, grid, values) for name, values in true.items()}
