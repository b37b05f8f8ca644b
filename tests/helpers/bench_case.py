"""A truck, roads with a closed form, and simple controllers, to try the bench with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.control.controllers.controller import Command, Diagnostics, Measured
from ident.control.reference import Reference
from ident.control.truck import Drive, SteeringActuator, Truck

RATIO = 20.0
STEERING = SteeringActuator(
    gain=0.95,
    dead_time=0.12,
    time_constant_1=0.1,
    time_constant_2=0.05,
    ratio=np.array([[-12.0, -12.0 / RATIO], [12.0, 12.0 / RATIO]]),
)
BODY = {"mass": 12500.0, "yaw_inertia": 60000.0, "cg_to_front_axle": 2.6, "cg_to_rear_axle": 1.9}
TYRES = {
    "linear": {},
    "piecewise_linear": {"saturation_slip": 0.12},
    "magic_formula": {"peak_force": 42000.0, "shape": 1.4, "curvature": -0.8},
    "brush": {"peak_force": 42000.0},
}
STIFFNESS = {"front": 2.4e5, "rear": 4.1e5}
NO_LAG = 1e-7  # [s]


def truck(model: str = "linear", **changes) -> Truck:
    """One truck; changes by the fields of ``SteeringActuator`` and of ``Truck``."""
    steering = {
        key: changes.pop(key) for key in list(changes) if key in SteeringActuator.__dataclass_fields__
    }
    parameters = {
        name: value for name, value in BODY.items() if model != "kinematic" or name.startswith("cg")
    }
    if model != "kinematic":
        for axle, stiffness in STIFFNESS.items():
            parameters[f"{axle}.cornering_stiffness"] = stiffness
            parameters |= {f"{axle}.{name}": value for name, value in TYRES[model].items()}
    made = Truck(model, parameters, replace(STEERING, **steering), Drive())
    return replace(made, **changes)


def direct(model: str = "linear", **changes) -> Truck:
    """A truck whose wheels stand where they are asked to, at once; the request is theirs."""
    at_once = {
        "gain": 1.0,
        "dead_time": 0.0,
        "time_constant_1": NO_LAG,
        "time_constant_2": NO_LAG,
        "ratio": np.array([[-1.0, -1.0], [1.0, 1.0]]),
    }
    return truck(model, **(at_once | changes))


def circle(curvature: float, speed: float, length: float, step: float = 0.5) -> Reference:
    """A circle from the origin along x; straight where the curvature is zero. Steady drift is left out."""
    s = np.arange(0.0, length + step / 2, step)
    angle = curvature * s
    x, y = s, np.zeros_like(s)
    if curvature != 0.0:
        x, y = np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature
    full, none = np.ones_like(s), np.zeros_like(s)
    return Reference(
        name="circle",
        arc_length=s,
        position_x=x,
        position_y=y,
        heading=angle,
        curvature=curvature * full,
        speed=speed * full,
        time=s / speed,
        acceleration=none,
        road_wheel_angle=none,
        yaw_rate=none,
        lateral_velocity=none,
        heading_error=none,
    )


def straight(speed: float, length: float) -> Reference:
    """Along x."""
    return circle(0.0, speed, length)


class Held:
    """Always the same command."""

    name = "held"

    def __init__(self, steering: float = 0.0, acceleration: float = 0.0, period: float = 0.05) -> None:
        self.command = Command(steering, acceleration)
        self.period = period

    def reset(self) -> None:
        """Nothing is kept."""

    def step(self, measured: Measured, reference: Reference) -> tuple[Command, Diagnostics]:
        """Answer the same, and tell where the truck is on a straight road along x."""
        left = measured.position_y - float(reference.position_y[0])
        return self.command, Diagnostics(0.001, left, measured.heading)


class Steers:
    """Proportional to the error of a point far ahead of a straight road along x."""

    name = "pid"

    def __init__(self, gain: float = 0.012, ahead: float = 25.0, period: float = 0.05, ratio: float = RATIO):
        self.gain, self.ahead, self.period, self.ratio = gain, ahead, period, ratio
        self.seen: list[Measured] = []

    def reset(self) -> None:
        """Forget what was seen."""
        self.seen = []

    def step(self, measured: Measured, reference: Reference) -> tuple[Command, Diagnostics]:
        """Steer back, and hold the speed of the road."""
        self.seen.append(measured)
        error = measured.position_y + self.ahead * np.sin(measured.heading)
        missing = float(reference.speed[0]) - measured.longitudinal_velocity
        request = -self.ratio * self.gain * float(error)
        return Command(request, 0.5 * missing), Diagnostics(0.002, measured.position_y, measured.heading)
