"""Tables of the validation, for the report and the recording. SI units; NaN where there is no value.

``validate`` : the opened runs, one row a cycle of the controller. Opened are, in every scenario at every
speed, the runs of all controllers from the start at which one of them did worst.
    run : index into ``ValidateResult.runs``; controller, scenario : categories
    time [s], arc_length : of the tracked point's foot on the path [m]
    x, y, heading : of the truck's CG [m], [rad]
    lateral_error [m], heading_error [rad] : of the tracked point, left positive
    speed, reference_speed [m/s]
    steering_request, steering_angle : before the ratio map [rad]; road_wheel_angle [rad]
    acceleration_request, acceleration [m/s²]
    solve_time [s]; solved : whether the optimisation found its optimum

``validate_reference`` : the paths, one row a point of them
    scenario; set_speed : as in the settings [m/s]; run : name of the logged run, "" where there is none
    arc_length, x, y [m], heading [rad], curvature [1/m], speed [m/s], time [s], road_wheel_angle [rad]
    The lane reaches ``ValidateResult.lane_half_width`` to either side.

``validate_horizon`` : what the controller of ``ValidateResult.worst`` predicted, one row a point
    run : index; time : of the cycle [s]; step : 0, 1, ... along the horizon; x, y : of the tracked point [m]

``validate_logged`` : a logged run, measured and simulated, one row a sample
    run : its name; part : number of the engaged stretch
    level : 0 to 3, as in ``LoggedLevel``; source : "log", "model", or the name of a controller
    time [s since the start of the run], arc_length : along the logged reference [m]
    x, y [m], heading [rad] : of the reference point of the log
    lateral_error [m], heading_error [rad] : from the logged reference
    speed [m/s], steering_request, steering_angle, road_wheel_angle [rad], yaw_rate [rad/s]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.control.closed_loop import ClosedLoop
from ident.control.reference import Reference
from ident.results import ClosedLoopRun
from ident.stages.validate_bench import Path

Array = NDArray[np.float64]

AT_CYCLES = ("heading", "steering_angle", "road_wheel_angle")
REFERENCE = ("arc_length", "heading", "curvature", "speed", "time", "road_wheel_angle")


def opened(runs: Sequence[ClosedLoopRun]) -> list[int]:
    """Runs to be opened: of each scenario and speed, those from the start at which one of them did worst."""
    made = []
    keys = dict.fromkeys((run.scenario, run.speed) for run in runs)
    for key in keys:
        own = [number for number, run in enumerate(runs) if (run.scenario, run.speed) == key]
        worst = max(own, key=lambda number: (not runs[number].completed, runs[number].lateral_error_max))
        made += [number for number in own if runs[number].seed == runs[worst].seed]
    return made


def course_table(courses: Mapping[int, ClosedLoop], runs: Sequence[ClosedLoopRun]) -> pd.DataFrame:
    """Table ``validate`` of runs by their index."""
    parts = [_course(number, course, runs[number]) for number, course in courses.items()]
    table = pd.concat(parts, ignore_index=True)
    return table.astype({"controller": "category", "scenario": "category"})


def _course(number: int, course: ClosedLoop, run: ClosedLoopRun) -> pd.DataFrame:
    """One row a cycle."""

    def at(values: Array) -> Array:
        return np.interp(course.cycles, course.times, values)

    reference, arc = course.reference, at(course.arc_length)
    return pd.DataFrame(
        {
            "run": np.int32(number),
            "controller": run.controller,
            "scenario": run.scenario,
            "time": course.cycles,
            "arc_length": arc,
            "x": at(course.states["position_x"]),
            "y": at(course.states["position_y"]),
            **{name: at(course.states[name]) for name in AT_CYCLES},
            "lateral_error": at(course.lateral_error),
            "heading_error": at(course.heading_error),
            "speed": at(course.states["longitudinal_velocity"]),
            "reference_speed": np.interp(arc, reference.arc_length, reference.speed),
            "steering_request": [one.steering_request for one in course.commands],
            "acceleration_request": [one.acceleration_request for one in course.commands],
            "acceleration": at(course.states["longitudinal_acceleration"]),
            "solve_time": [one.solve_time for one in course.diagnostics],
            "solved": [one.solved for one in course.diagnostics],
        }
    )


def reference_table(references: Mapping[Path, Reference]) -> pd.DataFrame:
    """Table ``validate_reference``."""
    parts = []
    for path, reference in references.items():
        columns = {name: getattr(reference, name) for name in REFERENCE}
        place = {"x": reference.position_x, "y": reference.position_y}
        named = {"scenario": path.scenario, "set_speed": path.speed, "run": path.run or ""}
        parts.append(pd.DataFrame({**named, **place, **columns}))
    return pd.concat(parts, ignore_index=True).astype({"scenario": "category", "run": "category"})


def horizon_table(number: int, course: ClosedLoop) -> pd.DataFrame:
    """Table ``validate_horizon`` of one run; empty where its controller predicts nothing."""
    parts = [
        pd.DataFrame(
            {
                "run": np.int32(number),
                "time": time,
                "step": np.arange(len(told.horizon)),
                "x": told.horizon[:, 0],
                "y": told.horizon[:, 1],
            }
        )
        for time, told in zip(course.cycles.tolist(), course.diagnostics, strict=True)
        if told.horizon is not None
    ]
    columns = ["run", "time", "step", "x", "y"]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns, dtype=float)
