"""Points of the vehicle that logged motion refers to, and motion moved from one to another.

On a rigid vehicle, with (x, y) the way from one point to the other in the vehicle's frame:

    v_x' = v_x - y r,      a_x' = a_x - y ṙ - x r²
    v_y' = v_y + x r,      a_y' = a_y + x ṙ - y r²

The functions take numbers, arrays and SymPy expressions alike, so that models and data use the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Kind = Literal["cg", "rear_axle", "front_axle", "imu"]


@dataclass(frozen=True)
class ReferencePoint:
    """A point that is fixed to the vehicle.

    x, y : from the centre of gravity, forward and left [m]; numbers or expressions
    """

    kind: Kind
    x: Any
    y: Any = 0

    def to(self, other: ReferencePoint) -> tuple[Any, Any]:
        """The way to another point [m]."""
        return other.x - self.x, other.y - self.y


CG = ReferencePoint("cg", 0, 0)


def rear_axle(cg_to_rear_axle: Any) -> ReferencePoint:
    """The middle of the rear axle; ``cg_to_rear_axle`` is positive [m]."""
    return ReferencePoint("rear_axle", -cg_to_rear_axle)


def front_axle(cg_to_front_axle: Any) -> ReferencePoint:
    """The middle of the front axle."""
    return ReferencePoint("front_axle", cg_to_front_axle)


def moved_velocity(
    along: Any, across: Any, yaw_rate: Any, start: ReferencePoint, end: ReferencePoint
) -> tuple[Any, Any]:
    """Velocity [m/s] at ``end`` of a vehicle whose velocity at ``start`` is (along, across)."""
    x, y = start.to(end)
    return along - y * yaw_rate, across + x * yaw_rate


def moved_acceleration(
    along: Any,
    across: Any,
    yaw_rate: Any,
    yaw_acceleration: Any,
    start: ReferencePoint,
    end: ReferencePoint,
) -> tuple[Any, Any]:
    """Acceleration [m/s²] at ``end`` of a vehicle whose acceleration at ``start`` is (along, across)."""
    x, y = start.to(end)
    return (
        along - y * yaw_acceleration - x * yaw_rate**2,
        across + x * yaw_acceleration - y * yaw_rate**2,
    )


def moved_position(
    position: tuple[Any, Any],
    cosine: Any,
    sine: Any,
    start: ReferencePoint,
    end: ReferencePoint,
) -> tuple[Any, Any]:
    """Position [m] of ``end``, where that of ``start`` is given and the heading by its cosine and sine."""
    x, y = start.to(end)
    return position[0] + x * cosine - y * sine, position[1] + x * sine + y * cosine
