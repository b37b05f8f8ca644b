"""The scenarios by name: a path, the speeds on it, and the steady cornering of a truck at each point."""

from __future__ import annotations

import numpy as np

from ident.control.paths import (
    Path,
    double_lane_change,
    double_lane_change_scaled,
    lane_change_length,
    single_lane_change,
    truncated_slalom,
)
from ident.control.reference import Reference
from ident.control.speed_profile import SpeedLimits, SpeedProfile, speed_profile
from ident.control.steady_state import steady_cornering
from ident.control.truck import Truck
from ident.errors import BadRecipe

SCENARIOS = ("single_lane_change", "double_lane_change", "double_lane_change_scaled", "truncated_slalom")
LEAD_IN = 3.0  # [s] of straight driving at the set speed before
RUN_OUT = 6.0  # [s] after, in which errors settle


def scenario_path(name: str, limits: SpeedLimits, *, width: float = 2.5) -> Path:
    """The path of a scenario.

    All but that of ISO 3888-1 are as sharp as the lateral acceleration of the limits allows at the set speed.

    Parameters
    ----------
    name : one of ``SCENARIOS``
    width : of the vehicle [m], for the lanes between cones

    Raises
    ------
    BadRecipe
        If there is no such scenario, or none of that sharpness.
    """
    sharpest = limits.lateral_acceleration / limits.set_speed**2
    lead_in, run_out = LEAD_IN * limits.set_speed, RUN_OUT * limits.set_speed
    if name == "single_lane_change":
        return single_lane_change(lane_change_length(sharpest), lead_in=lead_in, run_out=run_out)
    if name == "double_lane_change":
        return double_lane_change(width=width, lead_in=lead_in, run_out=run_out)
    if name == "double_lane_change_scaled":
        return double_lane_change_scaled(sharpest, width=width, lead_in=lead_in, run_out=run_out)
    if name == "truncated_slalom":
        return truncated_slalom(sharpest, lead_in=lead_in, run_out=run_out)
    raise BadRecipe(f"no scenario {name}: need one of {', '.join(SCENARIOS)}")


def scenario(
    name: str, truck: Truck, limits: SpeedLimits, *, tracked_x: float = 0.0, width: float = 2.5
) -> Reference:
    """The reference of a scenario; parameters and errors as of ``scenario_path`` and ``reference``."""
    return reference(scenario_path(name, limits, width=width), truck, limits, tracked_x=tracked_x)


def reference(path: Path, truck: Truck, limits: SpeedLimits, *, tracked_x: float = 0.0) -> Reference:
    """What a controller is to follow: the path at the fastest speeds within the limits.

    Parameters
    ----------
    path : of the tracked point
    truck : whose steady cornering is the feed-forward: the one that the controller is designed with
    tracked_x : of the tracked point, forward of the centre of gravity [m]

    Raises
    ------
    BadRecipe
        If the truck cannot corner like that.
    """
    profile = speed_profile(path.arc_length, path.curvature, limits)
    return timed_reference(path, profile, truck, tracked_x=tracked_x)


def timed_reference(path: Path, profile: SpeedProfile, truck: Truck, *, tracked_x: float = 0.0) -> Reference:
    """The path at speeds that are given; errors as of ``reference``."""
    cornering = steady_cornering(truck, path.curvature, profile.speed, tracked_x=tracked_x)
    return Reference(
        name=path.name,
        arc_length=path.arc_length,
        position_x=path.position_x,
        position_y=path.position_y,
        heading=path.heading,
        curvature=path.curvature,
        speed=np.asarray(profile.speed),
        time=profile.time,
        acceleration=profile.acceleration,
        road_wheel_angle=cornering.road_wheel_angle,
        yaw_rate=cornering.yaw_rate,
        lateral_velocity=cornering.lateral_velocity,
        heading_error=cornering.heading_error,
        tracked_x=tracked_x,
    )
