"""What a controller follows: a path by arc length, with the speed and the time at which to be where.

Axes are those of ISO 8855; curvature is positive in a left turn. The path is that of the tracked point, which
lies ``tracked_x`` forward of the centre of gravity (CG) on the middle line. In steady cornering
that point drifts: its lateral velocity is not zero, and the vehicle points inwards or outwards by minus the
drift angle. ``lateral_velocity`` and ``heading_error`` say by how much, so that a controller that holds both
at their reference leaves no offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Reference:
    """A path to follow, sampled at a strictly rising arc length.

    name : of the scenario, or of the run that it comes from
    arc_length : (n,) from the start of the path [m]
    position_x, position_y : (n,) of the tracked point [m]
    heading : (n,) of the path's tangent, unwrapped [rad]
    curvature : (n,) [1/m]
    speed : (n,) longitudinal velocity [m/s], positive
    time : (n,) stipulated, from zero [s]
    acceleration : (n,) longitudinal [m/s²]
    road_wheel_angle : (n,) of steady cornering on this curvature at this speed, the feed-forward [rad]
    yaw_rate : (n,) [rad/s]
    lateral_velocity : (n,) of the tracked point in steady cornering [m/s]
    heading_error : (n,) heading of the vehicle less that of the path in steady cornering [rad]
    tracked_x : of the tracked point, forward of the CG [m]
    """

    name: str
    arc_length: Array
    position_x: Array
    position_y: Array
    heading: Array
    curvature: Array
    speed: Array
    time: Array
    acceleration: Array
    road_wheel_angle: Array
    yaw_rate: Array
    lateral_velocity: Array
    heading_error: Array
    tracked_x: float = 0.0
