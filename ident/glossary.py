"""The names of signals, the same in channel maps, code, JSON and reports, with their SI units;
and what the controllers are called.

Axes are those of ISO 8855: x forward, y left, z up; angles are counted counterclockwise from above.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Between = Literal["held", "linear", "angle"]
AXLES = ("front", "rear")


@dataclass(frozen=True)
class Quantity:
    """What a signal name means.

    unit : SI unit, as text
    description : one line
    between : what the signal does between its samples: a command is held, a measurement is
        interpolated, a heading is interpolated along the shorter arc
    """

    unit: str
    description: str
    between: Between = "linear"


def _wheel_forces() -> dict[str, Quantity]:
    axes = ("longitudinal", "lateral", "vertical")
    wheels = [(axle, side) for axle in AXLES for side in ("left", "right")]
    return {
        f"{axle}_{side}_{axis}_force": Quantity("N", f"{axis} tyre force, {axle} {side} wheel")
        for axle, side in wheels
        for axis in axes
    }


def _wheel_speeds() -> dict[str, Quantity]:
    return {
        f"wheel_speed_{axle}_{side}": Quantity("m/s", f"wheel speed times radius, {axle} {side}")
        for axle in ("front", "rear")
        for side in ("left", "right")
    }


SIGNALS: dict[str, Quantity] = {
    "steering_wheel_request": Quantity("rad", "requested steering-wheel angle", "held"),
    "steering_wheel_angle": Quantity("rad", "measured steering-wheel angle"),
    "steering_wheel_rate": Quantity("rad/s", "measured steering-wheel rate"),
    "steering_torque_request": Quantity("N m", "requested steering torque", "held"),
    "road_wheel_request": Quantity("rad", "requested road-wheel angle", "held"),
    "road_wheel_angle": Quantity("rad", "measured road-wheel angle"),
    "road_wheel_angle_left": Quantity("rad", "measured angle of the left road wheel"),
    "road_wheel_angle_right": Quantity("rad", "measured angle of the right road wheel"),
    "speed": Quantity("m/s", "speed over ground or of the wheels, forward positive"),
    "longitudinal_velocity": Quantity("m/s", "velocity along x at the reference point"),
    "lateral_velocity": Quantity("m/s", "velocity along y at the reference point"),
    "yaw_rate": Quantity("rad/s", "yaw rate"),
    "heading": Quantity("rad", "heading, from x counterclockwise", "angle"),
    "position_x": Quantity("m", "position of the reference point, x"),
    "position_y": Quantity("m", "position of the reference point, y"),
    "longitudinal_acceleration": Quantity("m/s^2", "acceleration along x"),
    "lateral_acceleration": Quantity("m/s^2", "acceleration along y"),
    "acceleration_request": Quantity("m/s^2", "requested longitudinal acceleration", "held"),
    "drive_force": Quantity("N", "drive force"),
    "brake_force": Quantity("N", "brake force"),
    "gear": Quantity("1", "engaged gear", "held"),
    "roll_angle": Quantity("rad", "roll angle, left side up positive", "angle"),
    "roll_rate": Quantity("rad/s", "roll rate"),
    "hitch_angle": Quantity("rad", "angle between tractor and trailer"),
    "reference_x": Quantity("m", "path reference, x", "held"),
    "reference_y": Quantity("m", "path reference, y", "held"),
    "reference_heading": Quantity("rad", "path reference, heading", "held"),
    "reference_speed": Quantity("m/s", "speed reference", "held"),
    "engaged": Quantity("1", "1 while the controller commands the vehicle", "held"),
    "driver_override": Quantity("1", "1 while the driver overrides the controller", "held"),
    **_wheel_speeds(),
    **_wheel_forces(),
}

STEERING_PAIRS: dict[str, tuple[str, str]] = {
    "steering_wheel": ("steering_wheel_request", "steering_wheel_angle"),
    "road_wheel": ("road_wheel_request", "road_wheel_angle"),
}

CONTROLLERS: dict[str, str] = {
    "pid": "PID",
    "pure_pursuit": "pure pursuit",
    "stanley": "Stanley",
    "lqr": "LQR with feed-forward",
    "mpc_time_kinematic": "MPC in time (kinematic)",
    "mpc_time": "MPC in time (dynamic)",
    "mpc_spatial": "spatial MPC",
    "mpc_spatial_rate": "spatial MPC with rate limit",
    "mpc_robust": "robust MPC (tube)",
}


def controller_name(name: str) -> str:
    """Name a controller for a reader."""
    return CONTROLLERS.get(name, name.replace("_", " "))
