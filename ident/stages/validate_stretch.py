"""A stretch of a log as a controller would have seen it: states at its cycles, and the path to follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.controller import Measured
from ident.control.path_log import LoggedPath, path_of_log, reference_of_log
from ident.control.reference import Reference
from ident.control.tracking import project
from ident.errors import BadRecipe, NotIdentifiable
from ident.estimation.vehicle_records import MotionRecord
from ident.glossary import STEERING_PAIRS
from ident.results import Refusal
from ident.signals.run import Run
from ident.stages.validate_logged_data import FollowedRun
from ident.stages.validate_truck import Believed

Array = NDArray[np.float64]

NEEDED = ("position_x", "position_y", "heading", "yaw_rate")
RATE_OVER = 0.1  # [s] over which the rate of the steering is taken


@dataclass(frozen=True)
class LoggedStretch:
    """One stretch in which a logged controller drove, cycle by cycle.

    part : number of the stretch in its run
    reference : path that was followed, for the model that controllers are designed with
    lost : what was left out of that path, in words
    cycles : (m,) [s since the start of the run]; measured : state at each
    request : (m,) of the logged controller [rad]; acceleration : (m,) [m/s²]
    x, y, heading : (m,) of the point that the path is of [m], [rad]
    arc_length, lateral_error, heading_error : (m,) of it from the path [m], [rad]
    """

    run: str
    part: int
    reference: Reference
    lost: tuple[str, ...]
    cycles: Array
    measured: tuple[Measured, ...]
    request: Array
    acceleration: Array
    x: Array
    y: Array
    heading: Array
    arc_length: Array
    lateral_error: Array
    heading_error: Array


def stretches_of(
    followed: FollowedRun, truck: Believed, period: float
) -> tuple[list[LoggedStretch], list[Refusal]]:
    """The stretches of a run that hold a path and a pose, and why others do not."""
    found, refused = [], []
    for part, record in enumerate(followed.records):
        what = f"{followed.run.name}, stretch {part}"
        if missing := [name for name in NEEDED if name not in record.measured]:
            refused.append(Refusal(what, f"no level above 1: no {' and no '.join(missing)}"))
            continue
        try:
            found.append(_stretch(followed.run, part, record, truck, period, followed.rear_arm))
        except (NotIdentifiable, BadRecipe) as error:
            refused.append(Refusal(what, f"no level above 1: {error}"))
    return found, refused


def _stretch(
    run: Run, part: int, record: MotionRecord, truck: Believed, period: float, rear_arm: float
) -> LoggedStretch:
    logged = _path(run, record)
    reference = reference_of_log(logged, truck.truck, tracked_x=record.reference_x)
    cycles = np.arange(record.times[0], record.times[-1], period)
    at = {name: np.interp(cycles, one.times, one.values) for name, one in record.measured.items()}
    speed = np.interp(cycles, record.times, record.speed)
    x, y, heading = (at[name] for name in ("position_x", "position_y", "heading"))
    near = np.concatenate([[0.0], np.cumsum(speed[:-1] * np.diff(cycles))])
    arc, left, tangent, _ = project(reference, x, y, near)
    request, angle = (run.signals[name] for name in STEERING_PAIRS[truck.pair])
    measured = _measured(record, cycles, at, speed, (angle.time, angle.values), rear_arm)
    sent = np.clip(np.searchsorted(request.time, cycles, side="right") - 1, 0, None)
    turned = np.angle(np.exp(1j * (heading - tangent)))
    return LoggedStretch(
        run=run.name,
        part=part,
        reference=reference,
        lost=logged.lost,
        cycles=cycles,
        measured=measured,
        request=request.values[sent],
        acceleration=np.array([one.longitudinal_acceleration for one in measured]),
        x=x,
        y=y,
        heading=heading,
        arc_length=arc,
        lateral_error=left,
        heading_error=turned - np.interp(arc, reference.arc_length, reference.heading_error),
    )


def _path(run: Run, record: MotionRecord) -> LoggedPath:
    """The path that the run says it followed, at the speeds that it says, or else drove.

    Whether it leads forwards is told by its own heading, or else by that of the truck.
    """
    x, y = run.signals["reference_x"], run.signals["reference_y"]
    own = slice(*np.searchsorted(x.time, [record.times[0], record.times[-1]]))
    times = x.time[own]
    wanted = run.signals.get("reference_speed")
    speed = np.interp(times, record.times, record.speed)
    if wanted is not None:
        speed = np.interp(times, wanted.time, wanted.values)
    across = np.interp(times, y.time, y.values)
    return path_of_log(run.name, x.values[own], across, speed, heading=_heading(run, record, times))


def _heading(run: Run, record: MotionRecord, times: Array) -> Array:
    """(n,) heading of the path at these times [rad]; unwrapped, so that nothing turns between two samples."""
    wanted = run.signals.get("reference_heading")
    if wanted is None:
        measured = record.measured["heading"]
        return np.asarray(np.interp(times, measured.times, measured.values))
    known = np.isfinite(wanted.values)
    return np.asarray(np.interp(times, wanted.time[known], np.unwrap(wanted.values[known])))


def _measured(
    record: MotionRecord,
    cycles: Array,
    at: dict[str, Array],
    speed: Array,
    angle: tuple[Array, Array],
    rear_arm: float,
) -> tuple[Measured, ...]:
    """State of the CG at each cycle; without a lateral velocity the rear axle is taken not to slip."""
    x_p, turn = record.reference_x, at["yaw_rate"]
    across = at["lateral_velocity"] - x_p * turn if "lateral_velocity" in at else rear_arm * turn
    wheel, later, before = (
        np.interp(cycles + shift, *angle) for shift in (0.0, RATE_OVER / 2, -RATE_OVER / 2)
    )
    columns = {
        "time": cycles - cycles[0],
        "position_x": at["position_x"] - x_p * np.cos(at["heading"]),
        "position_y": at["position_y"] - x_p * np.sin(at["heading"]),
        "heading": at["heading"],
        "longitudinal_velocity": speed,
        "lateral_velocity": across,
        "yaw_rate": turn,
        "longitudinal_acceleration": np.gradient(speed, cycles),
        "steering_angle": wheel,
        "steering_rate": (later - before) / RATE_OVER,
    }
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return tuple(Measured(**dict(zip(columns, row, strict=True))) for row in rows)
