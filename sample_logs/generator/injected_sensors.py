"""What the sensors of a truck with injected effects would read if they made no other error.

A sensor's lag, filter and clock change when it reads, its scale, bias and mounting what it reads. ``reads``
gives every signal as a function of time; noise and resolution follow when it is measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from .injected import ACROSS, DRIFT, YAW_RATE, Injected, parameters_of
from .injected_motion import HEADING, ROLL, ROLL_RATE, TURN, V_Y, Driven, X, Y
from .truth import Channel, Planar
from .vehicle import GRAVITY

Array = NDArray[np.float64]
Reading = Callable[[Array], Array]

ALONG = "longitudinal_acceleration"
DEVICES = {
    "imu": (YAW_RATE, ALONG, ACROSS),
    "odometry": ("position_x", "position_y", "heading", "longitudinal_velocity", DRIFT),
}
LATERAL = (
    "steering_wheel_request", "steering_wheel_angle", YAW_RATE, ACROSS, DRIFT, "heading", "position_y",
)  # fmt: skip


def reads(
    truck: Planar, injected: Sequence[Injected], driven: Driven, half_steps: Array, wheel: Array
) -> dict[str, Reading]:
    """Every measured signal as a function of time, and what else an inertial unit and odometry tell.

    half_steps, wheel : (n,) times [s] and angle of the steering wheel [rad]
    """
    true = {**_odometry(truck, injected, driven), **_imu(truck, injected, driven)}
    made = {signal: _delayed(driven.time, values, signal, injected) for signal, values in true.items()}
    made |= {
        "roll_rate": _between(driven.time, driven.states[:, ROLL_RATE]),
        "odometry_yaw_rate": _between(driven.time, driven.states[:, TURN]),
    }
    made["steering_wheel_angle"] = _delayed(half_steps, wheel, "steering_wheel_angle", injected)
    return made


def _odometry(truck: Planar, injected: Sequence[Injected], driven: Driven) -> dict[str, Array]:
    """Pose and velocity of the middle of the rear axle, and the speed of the wheels.

    The odometry takes its forward velocity from the wheels and its pose from elsewhere, so that a wrong
    scale of the wheels is in both speeds, unless it is said to be of one of them.
    """
    state, behind = driven.states.T, truck.body.cg_to_rear_axle
    drift = state[V_Y] - behind * state[TURN]
    scales = {name: 1.0 + _wheel_scale(injected, name) for name in ("speed", "longitudinal_velocity")}
    mounted = (parameters_of(injected, "antenna_offset") or {}).get("heading", 0.0)
    made = {
        "speed": scales["speed"] * driven.speed,
        "position_x": state[X] - behind * np.cos(state[HEADING]),
        "position_y": state[Y] - behind * np.sin(state[HEADING]),
        "heading": state[HEADING] + mounted,
        "longitudinal_velocity": driven.speed * np.cos(mounted) + drift * np.sin(mounted),
        DRIFT: drift * np.cos(mounted) - driven.speed * np.sin(mounted),
    }
    made["longitudinal_velocity"] = scales["longitudinal_velocity"] * made["longitudinal_velocity"]
    return _biased(made, injected)


def _wheel_scale(injected: Sequence[Injected], signal: str) -> float:
    wrong = [one for one in injected if one.name == "wheel_speed_scale" and one.signal in {"", signal}]
    return sum(one.values["scale"] for one in wrong)


def _imu(truck: Planar, injected: Sequence[Injected], driven: Driven) -> dict[str, Array]:
    """Yaw rate and specific forces where the inertial unit sits; a rolled body adds g sin φ."""
    forward, left, _ = truck.imu_position
    if moved := parameters_of(injected, "imu_lever_arm"):
        forward, left = forward + moved["x"], left + moved["y"]
    turn, squared = driven.states[:, TURN], driven.states[:, TURN] ** 2
    along = driven.pull - driven.states[:, V_Y] * turn - left * driven.turn_rate - forward * squared
    across = driven.felt + forward * driven.turn_rate - left * squared
    if any(one.name == "body_roll" for one in injected):
        across = across + GRAVITY * np.sin(driven.states[:, ROLL])
    if mounted := parameters_of(injected, "imu_misalignment"):
        yaw = mounted["yaw"]
        along, across = along * np.cos(yaw) + across * np.sin(yaw), across * np.cos(yaw) - along * np.sin(yaw)
        across = across + GRAVITY * np.sin(mounted["roll"])
    scales = {name: (parameters_of(injected, name) or {}).get("scale", 0.0) for name in _SCALES}
    cubic = (parameters_of(injected, "gyro_cubic") or {}).get("coefficient", 0.0)
    made = {
        YAW_RATE: (1.0 + scales["gyro_scale"]) * turn + cubic * turn**3,
        ALONG: along,
        ACROSS: (1.0 + scales["accelerometer_scale"]) * across,
    }
    return _biased(made, injected)


_SCALES = ("gyro_scale", "accelerometer_scale")


def _biased(made: dict[str, Array], injected: Sequence[Injected]) -> dict[str, Array]:
    for one in injected:
        if one.name == "sensor_bias" and one.signal in made:
            made[one.signal] = made[one.signal] + one.values["bias"]
    return made


def _between(grid: Array, values: Array) -> Reading:
    return lambda time: np.interp(time, grid, values)


def _acts_on(one: Injected, signal: str) -> bool:
    return signal == one.signal or signal in DEVICES.get(one.signal, ())


def _delayed(grid: Array, values: Array, signal: str, injected: Sequence[Injected]) -> Reading:
    """Return what a sensor reads at a time: of earlier, filtered, by a clock that runs at another pace."""
    late, pace = 0.0, 0.0
    for one in injected:
        if one.name == "sensor_latency" and _acts_on(one, signal):
            late += one.values["delay"]
        if one.name == "sensor_filter" and _acts_on(one, signal):
            values = _filtered(values, float(grid[1] - grid[0]), one.values["time_constant"])
        if one.name == "clock_drift" and signal in DEVICES["imu"]:
            pace = one.values["drift"]
    return lambda time: np.interp(time * (1.0 + pace) - late, grid, values)


def _filtered(values: Array, step: float, time_constant: float) -> Array:
    """First-order lag, at rest at the first value; between steps the input is a straight line."""
    if time_constant <= 0.0:
        return values
    ratio = time_constant / step
    keep = np.exp(-1.0 / ratio)
    old, new = ratio * (1.0 - keep) - keep, 1.0 - ratio * (1.0 - keep)
    state = values[0] * (keep + old)
    return lfilter([new, old], [1.0, -keep], values, zi=[state])[0]


def channel_with(channel: Channel, signal: str, injected: Sequence[Injected]) -> Channel:
    """Return the errors of a sensor: no bias but an injected one, and an injected resolution."""
    coarse = parameters_of(injected, "sensor_resolution") if signal == YAW_RATE else None
    step = max(channel.resolution, coarse["step"]) if coarse else channel.resolution
    return replace(channel, bias=0.0, resolution=step)
