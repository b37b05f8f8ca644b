"""What is looked at before any number of the evaluation is believed.

A check is refused where a number would mean nothing: the steering was never measured, a signal has another
sign or unit, the models belong to another vehicle, or the fit has seen the runs that it is judged by.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ident.estimation.logged_point import point_of_lateral_velocity, point_of_position
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord, Samples
from ident.experiments.motion import MotionRun
from ident.results import Check, Estimate, TyresResult
from ident.signals.signal import Run, Signal
from ident.vehicle import Vehicle

Array = NDArray[np.float64]

PAIRS = (("steering_wheel_request", "steering_wheel_angle"), ("road_wheel_request", "road_wheel_angle"))
ECHO_LAGS = (0.0, 0.005, 0.01)  # [s]
SHOWN_LAG = 0.05  # [s] that would be seen
ECHO = 0.1  # of the difference that this lag makes
LARGEST_LAG = 0.6  # [s]
STALE = 0.5  # [s]
FEWEST = 50
LEAST_MOVED = 1e-4  # [rad]

MISPLACED, FAR = 0.5, 1.0  # [m]
TOLD = 0.75  # [m] standard error up to which a point can be told
CERTAIN = 3.0  # standard errors

SAME = 1e-6  # relative
PART = re.compile(r"(?P<run>.*) \[(?P<begin>[-\d.]+), (?P<end>[-\d.]+)\] s")

ECHOED, SIGNS, POINT, PARAMETERS, HELD_OUT = (
    "steering is measured",
    "signs and units",
    "reference point",
    "parameters are those of the file",
    "held-out runs took no part in the fit",
)


def checks(
    runs: Sequence[Run],
    motion: Sequence[MotionRun],
    tyres: TyresResult,
    vehicle: Vehicle,
    held_out: Sequence[str],
) -> list[Check]:
    """Everything that is looked at, one line or more each.

    Parameters
    ----------
    runs, motion : that are evaluated
    tyres : what the models come from
    vehicle : as the vehicle file says it now
    held_out : names of runs, or of parts of runs such as "manual_a [40, 60] s"
    """
    return [
        *_echoes(runs),
        *_signs(motion),
        *_points(motion, vehicle),
        _parameters(tyres, vehicle),
        *_moved_points(tyres, motion),
        _taken_part(tyres, held_out, motion),
    ]


# --- measured steering that only echoes the request -----------------------------------------------


def _echoes(runs: Sequence[Run]) -> list[Check]:
    found = [(run, told) for run in runs if (told := _lag_of_steering(run)) is not None]
    if not found:
        return [Check(ECHOED, "fine", "no run holds a request: nothing that the steering could only repeat")]
    made = [
        Check(
            ECHOED,
            "refused",
            f"{run.name}: the {name.replace('_', ' ')} equals the request at zero lag: it repeats what was "
            "asked for and measures nothing: map the measured angle in channels.yaml",
        )
        for run, (name, lag) in found
        if lag is None
    ]
    lags = [lag for _, (_, lag) in found if lag is not None]
    if lags:
        count = f"{len(lags)} run{'s' if len(lags) > 1 else ''}"
        text = f"it follows the request {_range([round(lag, 2) for lag in lags])} s late in {count}"
        made.append(Check(ECHOED, "fine", text))
    return made


def _lag_of_steering(run: Run) -> tuple[str, float | None] | None:
    """Name of the angle and its lag [s], None for the lag of an echo; None where there is nothing to tell."""
    for asked, name in PAIRS:
        request, angle = run.signals.get(asked), run.signals.get(name)
        if request is None or angle is None or request.raw or angle.raw:
            continue
        told = _lag(request, angle)
        if told is not None:
            return name, None if told < 0 else told
    return None


def _lag(request: Signal, angle: Signal) -> float | None:
    """Lag [s] at which the held request fits the angle best, -1 for an echo, None where nothing moves."""
    known = (angle.time >= request.time[0] + LARGEST_LAG) & (_held(request, angle.time)[1] <= STALE)
    if np.count_nonzero(known) < FEWEST:
        return None
    times, values = angle.time[known], angle.values[known]
    moved = _held(request, times)[0] - _held(request, times - SHOWN_LAG)[0]
    shown = float(np.sqrt(np.mean(moved**2)))
    if shown < LEAST_MOVED:
        return None
    if min(_misfit(request, times - lag, values) for lag in ECHO_LAGS) <= ECHO * shown:
        return -1.0
    lags = np.arange(0.0, LARGEST_LAG, 0.01)
    return float(lags[np.argmin([_misfit(request, times - lag, values) for lag in lags])])


def _held(request: Signal, times: Array) -> tuple[Array, Array]:
    """The last request before each instant and its age [s]."""
    index = np.maximum(np.searchsorted(request.time, times, side="right") - 1, 0)
    return request.values[index], times - request.time[index]


def _misfit(request: Signal, times: Array, values: Array) -> float:
    """Rms of what a factor and an offset leave."""
    columns = np.column_stack([_held(request, times)[0], np.ones(times.size)])
    rest = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(np.sqrt(np.mean(rest**2)))


# --- signs, units, points -------------------------------------------------------------------------


def _signs(motion: Sequence[MotionRun]) -> list[Check]:
    """Tell what the comparison of the signals with each other has found."""
    made = [
        Check(SIGNS, finding.verdict, f"{run.name}: {finding.text}")
        for run in motion
        for finding in run.findings
        if finding.verdict != "fine"
    ]
    ratios: dict[str, list[float]] = {}
    for run in motion:
        for finding in run.findings:
            if finding.verdict == "fine":
                ratios.setdefault(finding.check, []).append(finding.ratio)
    if not ratios and not made:
        text = "no run turns enough to compare steering, yaw rate, lateral acceleration and heading"
        return [Check(SIGNS, "warning", text)]
    told = [f"{check} {_range(values)}" for check, values in ratios.items()]
    if told:
        made.append(Check(SIGNS, "fine", "; ".join(told)))
    return made


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"


def _points(motion: Sequence[MotionRun], vehicle: Vehicle) -> list[Check]:
    """Compare the point that the motion belongs to with the stated one."""
    body = _body(vehicle)
    if body is None:
        return [
            Check(POINT, "warning", "not compared: the vehicle file lacks mass or distances of the axles")
        ]
    made = []
    for stated in dict.fromkeys(run.reference_x for run in motion):
        own = [run for run in motion if run.reference_x == stated]
        records = [record for number, run in enumerate(own) for record in _records(run, number)]
        ahead = stated + body.cg_to_rear_axle
        where = f"{ahead:.2f} m ahead of the rear axle"
        for what, point in (
            ("lateral velocity", point_of_lateral_velocity(records, body)),
            ("position", point_of_position(records, body)),
        ):
            if what == "position" or any("lateral_velocity" in r.measured for r in records):
                made.append(_point_check(what, point, ahead, where))
    known = [check for check in made if check is not None]
    if known:
        return known
    text = "the motion does not tell which point it belongs to: drive curves at two speeds, below 2 m/s²"
    return [Check(POINT, "warning", text)]


def _point_check(what: str, point: Estimate, ahead: float, where: str) -> Check | None:
    """Compare one point; None where the data do not tell."""
    if point.value is None or point.std is None or point.std > TOLD:
        return None
    off = abs(point.value - ahead)
    fits = f"the {what} fits a point {point.value:.2f} ± {point.std:.2f} m ahead of the rear axle"
    if off <= max(MISPLACED, CERTAIN * point.std):
        return Check(POINT, "fine", f"{fits}, taken is {where}")
    return Check(
        POINT,
        "refused" if off > FAR else "warning",
        f"{fits}, taken is {where}: correct reference_point in vehicle.yaml, or at: in channels.yaml",
    )


def _body(vehicle: Vehicle) -> Body | None:
    if vehicle.mass is None or vehicle.cg_to_front_axle is None or vehicle.cg_to_rear_axle is None:
        return None
    return Body(vehicle.mass, vehicle.cg_to_front_axle, vehicle.cg_to_rear_axle, vehicle.yaw_inertia)


def _records(run: MotionRun, number: int) -> list[MotionRecord]:
    return [
        MotionRecord(
            number,
            window.times,
            window.road_wheel_angle,
            window.speed,
            {name: Samples(one.times, one.values) for name, one in window.measurements.items()},
            run.reference_x,
            run.imu,
        )
        for window in run.windows
    ]


# --- the fit and the file -------------------------------------------------------------------------


def _parameters(tyres: TyresResult, vehicle: Vehicle) -> Check:
    """Compare what the fit took as given with the vehicle file."""
    wrong, same = [], []
    for name, fixed in tyres.fixed.items():
        now = getattr(vehicle, name, None)
        if isinstance(now, float | int) and abs(now - fixed.value) <= SAME * abs(fixed.value):
            same.append(name.replace("_", " "))
            continue
        unit = "" if fixed.unit == "1" else f" {fixed.unit}"
        says = f"{now:g}{unit}" if isinstance(now, float | int) else "something else" if now else "nothing"
        wrong.append(f"{name} was {fixed.value:g}{unit} in the fit, the vehicle file says {says}")
    if wrong:
        return Check(PARAMETERS, "refused", f"{'; '.join(wrong)}: run `ident tyres` again")
    return Check(PARAMETERS, "fine", ", ".join(same) or "the fit took nothing from the vehicle file")


def _moved_points(tyres: TyresResult, motion: Sequence[MotionRun]) -> list[Check]:
    """Compare the points of the logged motion with those in the fit."""
    fitted = {run.reference_x for run in tyres.by_run if run.used and run.reference_x is not None}
    made = []
    for run in motion:
        if fitted and all(abs(run.reference_x - one) > MISPLACED for one in fitted):
            told = ", ".join(f"{one:.2f}" for one in sorted(fitted))
            text = (
                f"{run.name}: its motion is taken as that of a point {run.reference_x:.2f} m from the CG, "
                f"in the fit it was {told} m: one of them is wrong, unless another sensor was used"
            )
            made.append(Check(POINT, "warning", text))
    return made


def _taken_part(tyres: TyresResult, held_out: Sequence[str], motion: Sequence[MotionRun]) -> Check:
    """Name the held-out runs that the fit has seen, whole or in part."""
    used = [one for run in tyres.by_run if run.used for one in _spans(run.run, run.spans)]
    windows = {run.name: [[w.times[0], w.times[-1]] for w in run.windows] for run in motion}
    seen = [
        name
        for name in held_out
        if any(_overlap(one, other) for one in _spans(name, windows.get(name, [])) for other in used)
    ]
    if seen:
        text = (
            f"{', '.join(seen)}: used in the fit, so that its error says nothing of other runs: hold it out "
            "with split.held_out, or run `ident tyres` again"
        )
        return Check(HELD_OUT, "refused", text)
    runs = len({run for run, _, _ in used})
    return Check(HELD_OUT, "fine", f"{len(held_out)} held out, {runs} in the fit, nothing in both")


Span = tuple[str, float, float]


def _spans(name: str, within: Sequence[Sequence[float]]) -> list[Span]:
    """Run and times [s] of a run or a part of one; all of it where nothing is said."""
    found = PART.fullmatch(name)
    if found is not None:
        return [(found["run"], float(found["begin"]), float(found["end"]))]
    return [(name, begin, end) for begin, end in within] or [(name, -np.inf, np.inf)]


def _overlap(one: Span, other: Span) -> bool:
    """Whether two parts of runs have time in common."""
    return one[0] == other[0] and max(one[1], other[1]) < min(one[2], other[2])
