"""Table ``validate_logged``: logged, modelled and simulated motion; see ``validate_tables``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.control.closed_loop import ClosedLoop, tracked_point
from ident.control.tracking import project
from ident.estimation.evaluation import predict, whole
from ident.estimation.vehicle_records import MotionRecord
from ident.stages.evaluate_data import by_request
from ident.stages.validate_bench import Compared
from ident.stages.validate_logged import candidate
from ident.stages.validate_logged_data import FollowedRun
from ident.stages.validate_stretch import LoggedStretch
from ident.stages.validate_truck import Believed

Array = NDArray[np.float64]

COLUMNS = (
    *("run", "part", "level", "source", "time", "arc_length", "x", "y", "heading"),
    *("lateral_error", "heading_error", "speed"),
    *("steering_request", "steering_angle", "road_wheel_angle", "yaw_rate"),
)


def logged_table(
    runs: Sequence[FollowedRun],
    stretches: Sequence[LoggedStretch],
    made: Sequence[Compared],
    truck: Believed,
) -> pd.DataFrame | None:
    """All levels of the stretches that were looked at; None where there is none."""
    by_name = {one.run.name: one for one in runs}
    parts = []
    for stretch in stretches:
        followed = by_name[stretch.run]
        parts.append(_log(stretch, followed.records[stretch.part]))
        parts += [_modelled(level, stretch, followed, truck) for level in (0, 1)]
        for one in made:
            if one.beside.stretch.run == stretch.run:
                parts.append(_shadow(one, stretch))
                if one.course is not None:
                    parts.append(_simulated(one.course, one.beside.controller, stretch))
    if not parts:
        return None
    table = pd.concat(parts, ignore_index=True)
    return table.astype({"run": "category", "source": "category"})


def _rows(
    stretch: LoggedStretch, level: int, source: str, time: Array, columns: Mapping[str, Array]
) -> pd.DataFrame:
    named = {"run": stretch.run, "part": np.int32(stretch.part), "level": np.int32(level), "source": source}
    rest = {name: columns.get(name, np.full(time.size, np.nan)) for name in COLUMNS if name not in named}
    return pd.DataFrame({**named, **rest, "time": time})[list(COLUMNS)]


def _log(stretch: LoggedStretch, record: MotionRecord) -> pd.DataFrame:
    road = np.interp(stretch.cycles, record.times, record.road_wheel_angle)
    columns = {
        "x": stretch.x,
        "y": stretch.y,
        "heading": stretch.heading,
        "arc_length": stretch.arc_length,
        "lateral_error": stretch.lateral_error,
        "heading_error": stretch.heading_error,
        "speed": np.array([one.longitudinal_velocity for one in stretch.measured]),
        "steering_request": stretch.request,
        "steering_angle": np.array([one.steering_angle for one in stretch.measured]),
        "road_wheel_angle": road,
        "yaw_rate": np.array([one.yaw_rate for one in stretch.measured]),
    }
    return _rows(stretch, 0, "log", stretch.cycles, columns)


def _modelled(level: int, stretch: LoggedStretch, followed: FollowedRun, truck: Believed) -> pd.DataFrame:
    """The model, free from the beginning of the stretch to its end."""
    segments = whole([followed.records[stretch.part]], followed.rear_arm)
    if level == 1:
        segments, _ = by_request(followed.driver, segments)
    windows, outputs = segments.windows, predict(candidate(truck.truck, truck.offset), segments).outputs
    at = {name: np.interp(stretch.cycles, windows.times, outputs[name]) for name in MODELLED}
    columns = {
        **_beside(stretch, at["position_x"], at["position_y"], at["heading"], stretch.arc_length),
        "yaw_rate": at["yaw_rate"],
        "road_wheel_angle": np.interp(stretch.cycles, windows.times, windows.inputs[:, 0]),
        "speed": np.interp(stretch.cycles, windows.times, windows.inputs[:, 1]),
    }
    return _rows(stretch, level, "model", stretch.cycles, columns)


MODELLED = ("position_x", "position_y", "heading", "yaw_rate")


def _shadow(one: Compared, stretch: LoggedStretch) -> pd.DataFrame:
    columns = {"arc_length": stretch.arc_length, "steering_request": one.shadow.request}
    return _rows(stretch, 2, one.beside.controller, stretch.cycles, columns)


def _simulated(course: ClosedLoop, name: str, stretch: LoggedStretch) -> pd.DataFrame:
    at = {key: np.interp(course.cycles, course.times, values) for key, values in course.states.items()}
    x, y = tracked_point(at, course.reference.tracked_x)
    columns = {
        "x": x,
        "y": y,
        "heading": at["heading"],
        "arc_length": np.interp(course.cycles, course.times, course.arc_length),
        "lateral_error": np.interp(course.cycles, course.times, course.lateral_error),
        "heading_error": np.interp(course.cycles, course.times, course.heading_error),
        "speed": at["longitudinal_velocity"],
        "steering_request": np.array([one.steering_request for one in course.commands]),
        **{key: at[key] for key in ("steering_angle", "road_wheel_angle", "yaw_rate")},
    }
    return _rows(stretch, 3, name, course.cycles + stretch.cycles[0], columns)


def _beside(stretch: LoggedStretch, x: Array, y: Array, heading: Array, near: Array) -> dict[str, Array]:
    """Pose of the point of the log, and its errors from the path."""
    reference = stretch.reference
    arc, left, tangent, _ = project(reference, x, y, near)
    turned = np.angle(np.exp(1j * (heading - tangent)))
    error = turned - np.interp(arc, reference.arc_length, reference.heading_error)
    return {
        "x": x,
        "y": y,
        "heading": heading,
        "arc_length": arc,
        "lateral_error": left,
        "heading_error": error,
    }
