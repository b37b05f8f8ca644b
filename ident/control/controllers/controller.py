"""One face for all controllers: measured state, reference and time -> command and diagnostics."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ident.control.reference import Reference

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """What the truck tells its controller; velocities are those of the CG, the pose that of the CG too.

    time : [s]; position_x, position_y : [m]; heading : [rad], unwrapped
    longitudinal_velocity, lateral_velocity : [m/s]; yaw_rate : [rad/s]
    longitudinal_acceleration : [m/s²]
    steering_angle, steering_rate : of the angle before the ratio map [rad], [rad/s]
    """

    time: float
    position_x: float
    position_y: float
    heading: float
    longitudinal_velocity: float
    lateral_velocity: float
    yaw_rate: float
    longitudinal_acceleration: float
    steering_angle: float
    steering_rate: float


@dataclass(frozen=True)
class Command:
    """What a controller asks for, held until the next one.

    steering_request : of the angle before the ratio map [rad]
    acceleration_request : [m/s²]
    """

    steering_request: float
    acceleration_request: float


@dataclass(frozen=True)
class Diagnostics:
    """How a command came about.

    solve_time : of the whole step [s]
    lateral_error : of the tracked point from the path, left positive [m]; heading_error : [rad]
    solved : whether the optimisation found its optimum; True where a controller has none
    fallback : what was used where it did not, None where it did
    violation : largest violation of a softened constraint that the plan expects, in units of its limit
    horizon : (k, 2) predicted positions of the tracked point [m], None where a controller predicts none
    """

    solve_time: float
    lateral_error: float
    heading_error: float
    solved: bool = True
    fallback: str | None = None
    violation: float = 0.0
    horizon: Array | None = None
    extra: dict[str, Any] = field(default_factory=dict)


class Controller(Protocol):
    """Made from a ``Truck`` as the designer believes it to be, a period and weights.

    It keeps its own past (commands that are still on their way, estimated disturbances), so one object drives
    one run; ``reset`` forgets that past.
    """

    name: str
    period: float

    def reset(self) -> None:
        """Forget all runs before."""

    def step(self, measured: Measured, reference: Reference) -> tuple[Command, Diagnostics]:
        """Return the command for the period that begins now."""
