"""RUN -> MOTION WINDOWS: what the fit of a vehicle model needs, from the raw signals of a run.

The model is driven by the road-wheel angle and the speed, both on one uniform grid (interpolated, low-passed
where they hold more than the grid can). What it is compared with stays on its own stamps. A window is a part
of a run in which both inputs are known without a gap and the vehicle moves forward faster than
``least_speed``; no window reaches across a jump of heading or position, because the start of a window is
estimated and nothing is continuous there. Windows of one stretch share the instant at which one ends and
the next begins; each sample belongs to one window only.

Left out, and said: raw counts; samples that repeat the one before because nothing new was measured;
outliers; signals that certainly have another unit, sign or axis. A signal faster than the grid is low-passed
and thinned to about its rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ident.experiments.comparison import Finding, refused
from ident.experiments.motion_inputs import Input, Table, road_wheel_input, speed_input
from ident.experiments.motion_samples import Reference, measured_signals
from ident.experiments.plausibility import check_plausibility
from ident.results import Refusal
from ident.signals.signal import Run, Signal

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

INPUTS = ("road_wheel_angle", "speed")
FEWEST_SAMPLES = 3
NEGLIGIBLE = 0.1  # [s]


@dataclass(frozen=True)
class MotionSettings:
    """How runs are cut into windows.

    rate : of the grid of the simulation [1/s]; max_gap : longest stretch without samples that is bridged [s]
    window, shortest : length of a window, about and at least [s]
    least_speed : below which nothing is used: tyre models say nothing at crawling [m/s]
    refuse_late : whether a signal later than the others by 0.1 s is left out; not where its lag is looked for
    """

    rate: float = 100.0
    max_gap: float = 0.2
    window: float = 10.0
    shortest: float = 3.0
    least_speed: float = 3.0
    refuse_late: bool = True


@dataclass(frozen=True)
class Measurement:
    """One measured signal in one window, on its raw stamps.

    signal : yaw_rate, lateral_acceleration, lateral_velocity, heading, position_x or position_y
    times : (n,) since the start of the run, inside the grid of the window [s]
    values : (n,), a heading unwrapped
    """

    signal: str
    times: Array
    values: Array


@dataclass(frozen=True)
class MotionWindow:
    """A part of a run without gaps.

    times : (m,) uniform, since the start of the run [s]
    road_wheel_angle : (m,) [rad]; speed : (m,) along x [m/s]
    """

    times: Array
    road_wheel_angle: Array
    speed: Array
    measurements: dict[str, Measurement]


@dataclass(frozen=True)
class MotionRun:
    """The windows of a run.

    reference_x : x of the point that pose and velocity refer to, from the CG [m]
    reference_known : whether that was stated
    imu : x and y of the IMU from the CG [m]; (0, 0) where that is not said
    rejected : what was left out and why, with seconds or samples
    notes : what was assumed
    findings : what comparing the signals with each other gave
    """

    name: str
    windows: list[MotionWindow]
    reference_x: float
    imu: tuple[float, float]
    rejected: list[str]
    steering_source: str
    speed_source: str
    notes: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    reference_known: bool = True


def motion_runs(
    runs: Sequence[Run], *, ratio: Table | None = None, settings: MotionSettings | None = None
) -> tuple[list[MotionRun], list[Refusal]]:
    """Windows of every run that has any, and why the others have none.

    Parameters
    ----------
    ratio : [[steering wheel, road wheel], ...] [rad], rising; None: that of the vehicle file of each run
    """
    usable, refusals = [], []
    for run in runs:
        found = motion_run(run, ratio=ratio, settings=settings)
        if isinstance(found, str):
            refusals.append(Refusal(run.name, found))
        else:
            usable.append(found)
    return usable, refusals


def motion_run(
    run: Run, *, ratio: Table | None = None, settings: MotionSettings | None = None
) -> MotionRun | str:
    """Windows of a run, or why there is none."""
    how = settings or MotionSettings()
    steering, speed = road_wheel_input(run, ratio), speed_input(run)
    if isinstance(steering, str):
        return steering
    if isinstance(speed, str):
        return speed
    return _with_inputs(run, steering, speed, how)


def _with_inputs(run: Run, steering: Input, speed: Input, how: MotionSettings) -> MotionRun | str:
    grid = np.arange(int(np.floor(run.duration * how.rate)) + 1) / how.rate
    angle, velocity = (each.at(grid, how.rate, how.max_gap) for each in (steering, speed))
    findings = check_plausibility(
        run,
        _as_signal(INPUTS[0], grid, angle),
        _as_signal(INPUTS[1], grid, velocity),
        refuse_late=how.refuse_late,
    )
    wrong = refused(findings)
    for name in INPUTS:
        if name in wrong:
            return wrong[name]
    reference = Reference(grid, angle, velocity, run.vehicle, how.least_speed, how.rate, how.max_gap)
    measured = measured_signals(run, wrong, reference)
    usable, left_out = _usable(angle, velocity, how)
    pieces, cut = _pieces(grid, usable, measured.cuts, how)
    measured.rejected.extend(dict.fromkeys(wrong.values()))
    windows = [
        window
        for begin, end, last in _windows(pieces, how)
        if (window := _window(grid, (angle, velocity), begin, end, measured.signals, last=last)).measurements
    ]
    rejected = [*left_out, *cut, *measured.rejected, *steering.notes, *speed.notes]
    if not windows:
        return _why_none(measured.signals, rejected, how)
    return MotionRun(
        run.name,
        windows,
        measured.reference_x,
        _imu(run),
        rejected,
        steering.source,
        speed.source,
        [*measured.notes],
        findings,
        measured.reference_known,
    )


def _as_signal(name: str, grid: Array, values: Array) -> Signal:
    known = np.isfinite(values)
    return Signal(name, grid[known], values[known], "rad" if name == INPUTS[0] else "m/s")


def _imu(run: Run) -> tuple[float, float]:
    position = run.vehicle.imu_position if run.vehicle else None
    return (position[0], position[1]) if position else (0.0, 0.0)


# --- windows --------------------------------------------------------------------------------------


def _usable(angle: Array, speed: Array, how: MotionSettings) -> tuple[Mask, list[str]]:
    """Instants with both inputs and fast enough, and how much is not."""
    known = np.isfinite(angle) & np.isfinite(speed)
    moving = np.nan_to_num(speed, nan=0.0) >= how.least_speed
    missing = np.count_nonzero(~known) / how.rate
    slow = np.count_nonzero(known & ~moving) / how.rate
    told = []
    if missing > NEGLIGIBLE:
        told.append(f"{missing:.1f} s without road-wheel angle or speed")
    if slow > NEGLIGIBLE:
        told.append(f"{slow:.1f} s slower than {how.least_speed:g} m/s")
    return known & moving, told


def _pieces(
    grid: Array, usable: Mask, cuts: Array, how: MotionSettings
) -> tuple[list[tuple[int, int]], list[str]]:
    """First and last index of each piece that is long enough, and what the others come to."""
    broken = usable.copy()
    pieces = []
    for after, before in cuts:  # nothing is known between the sample before a jump and the one after
        first = int(np.searchsorted(grid, after, side="right"))
        last = int(np.searchsorted(grid, before, side="left"))
        broken[first:last] = False
        if first >= last and 0 < first < len(grid):
            broken[first] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[False], broken, [False]]).astype(int)))
    short = 0.0
    for begin, end in edges.reshape(-1, 2):
        length = (end - 1 - begin) / how.rate
        if length >= how.shortest:
            pieces.append((int(begin), int(end) - 1))
        else:
            short += (end - begin) / how.rate
    told = [f"{short:.1f} s in pieces shorter than {how.shortest:g} s"] if short > NEGLIGIBLE else []
    return pieces, told


def _windows(pieces: Sequence[tuple[int, int]], how: MotionSettings) -> list[tuple[int, int, bool]]:
    """First and last index of each window, and whether it is the last of its piece."""
    windows = []
    for begin, end in pieces:
        length = (end - begin) / how.rate
        count = max(1, min(round(length / how.window), int(length / how.shortest)))
        edges = np.round(np.linspace(begin, end, count + 1)).astype(int)
        windows += [(int(edges[k]), int(edges[k + 1]), k == count - 1) for k in range(count)]
    return windows


def _window(
    grid: Array,
    inputs: Sequence[Array],
    begin: int,
    end: int,
    signals: Sequence[Signal],
    *,
    last: bool,
) -> MotionWindow:
    times = grid[begin : end + 1]
    measurements = {}
    for signal in signals:
        first = int(np.searchsorted(signal.time, times[0], side="left"))
        behind = int(np.searchsorted(signal.time, times[-1], side="right" if last else "left"))
        if behind - first >= FEWEST_SAMPLES:
            measurements[signal.name] = Measurement(
                signal.name, signal.time[first:behind], signal.values[first:behind]
            )
    angle, speed = (values[begin : end + 1] for values in inputs)
    return MotionWindow(times, angle, speed, measurements)


def _why_none(signals: Sequence[Signal], rejected: Sequence[str], how: MotionSettings) -> str:
    if not signals:
        reason = (
            "nothing to compare a vehicle model with: need one of yaw_rate, lateral_acceleration, heading"
        )
    else:
        reason = (
            f"no {how.shortest:g} s at {how.least_speed:g} m/s or faster with road-wheel angle, speed and a "
            "measured motion"
        )
    return "; ".join([reason, *rejected])
