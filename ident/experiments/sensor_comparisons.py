"""What each sensor should say by the others, without a model of the vehicle (ISO 8855 axes).

    yaw rate               dψ/dt
    speed                  |dp/dt|, with v_y; else the velocity of the localization
    lateral acceleration   v r + dv_y/dt + (x_IMU - x_P) dr/dt - y_IMU r²
    dp/dt (a vector)       (k v + i (v_y + ε v)) e^{iψ}
    steering angle         (L + K v²) r / v, zero where the vehicle drives straight

Where the heading is logged, r is its derivative: a bias of the gyro would look like one of the accelerometer
times the speed. Where v_y is not logged, the lateral acceleration is compared slowly enough that dv_y/dt is
small; and the position tells the direction on a straight only. All sides go through the same smoothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ident.experiments.sensor_fit import Comparison, Series
from ident.experiments.sensor_series import RATE, SPEEDS, STEERING, SensorSeries, rate_of, smoothed

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WIDTH, SLOW = 1.0, 4.0  # [s] of the kernel
REST_WIDTH = 0.5  # [s]
GENTLE, STRAIGHT = 1.5, 0.05  # [m/s²], [rad/s]
REST, EDGE, LEAST_REST = 0.05, 0.5, 3.5  # [m/s], [s] left out at both ends, [s] that must remain
TURNED = 0.8  # mean of e^{iψ} below which the headings are various


def gyro(series: SensorSeries) -> Comparison | None:
    """Yaw rate against the derivative of the heading; columns: that derivative, one."""
    if not series.has("yaw_rate", "heading"):
        return None
    expected = rate_of(series.values["heading"], WIDTH)
    return _comparison(
        series,
        _moving(series, smoothed(series.values["yaw_rate"], WIDTH)),
        [expected, np.ones(expected.size)],
        [_turning_of_steering(series, 1), None],
    )


def speed_by_position(series: SensorSeries, name: str) -> Comparison | None:
    """Return one speed against that of the position; columns: the latter, r (a point beside the axis)."""
    if name not in series.values or not series.has("position_x", "position_y"):
        return None
    over_ground = np.abs(_velocity(series))
    across = series.values.get("lateral_velocity", np.zeros(series.time.size))
    along = np.where(np.isfinite(series.speed), series.values[name], np.nan)
    if series.has("heading"):
        moved = smoothed((along + 1j * across) * np.exp(1j * series.values["heading"]), WIDTH)
        return _comparison(series, np.abs(moved), [over_ground, _turning(series, WIDTH)], [None, None])
    if series.has("yaw_rate"):
        over_ground = np.where(np.abs(_turning(series, WIDTH)) < STRAIGHT, over_ground, np.nan)
    return _comparison(series, smoothed(np.hypot(along, across), WIDTH), [over_ground], [None])


def speed_by_velocity(series: SensorSeries) -> Comparison | None:
    """Speed against the velocity of the localization; column: the latter."""
    if not series.has(*SPEEDS) or series.sources.get(SPEEDS[0]) == series.sources.get(SPEEDS[1]):
        return None
    measured, expected = (smoothed(series.values[name], WIDTH) for name in SPEEDS)
    return _comparison(series, _moving(series, measured), [expected], [None])


def accelerometer(series: SensorSeries) -> Comparison | None:
    """Lateral acceleration against v r + dv_y/dt at the IMU; columns: that, one, then dr/dt, cos ψ, sin ψ."""
    if not (series.has("lateral_acceleration") and series.has_turning and series.speed_source):
        return None
    width = WIDTH if series.has("lateral_velocity") else SLOW
    turning = _turning(series, width)
    expected = smoothed(series.speed, width) * turning - series.imu_y * turning**2
    if series.has("lateral_velocity"):
        expected = expected + rate_of(series.values["lateral_velocity"], width)
    yaw_acceleration = np.gradient(turning, series.time)
    expected = expected + (series.arm or 0.0) * yaw_acceleration
    columns = [expected, np.ones(expected.size)]
    instruments = [_turning_of_steering(series, 2, width), None]
    if series.arm is None:
        columns.append(yaw_acceleration)
        instruments.append(None)
    measured = smoothed(series.values["lateral_acceleration"], width)
    return _comparison(series, measured, columns, instruments)


def with_headings(made: Sequence[tuple[SensorSeries, Comparison]]) -> list[Comparison] | None:
    """Add cos ψ and sin ψ to comparisons: a bank of the road turns over with the heading, a bias does not.

    None where the headings are too much alike to tell.
    """
    if not all(series.has("heading") for series, _ in made):
        return None
    arrows = [smoothed(np.exp(1j * series.values["heading"]), WIDTH) for series, _ in made]
    used = [a[np.isfinite(a) & np.isfinite(c.measured)] for a, (_, c) in zip(arrows, made, strict=True)]
    if abs(np.mean(np.concatenate(used))) > TURNED:
        return None
    return [
        _extended(comparison, [arrow.real, arrow.imag])
        for arrow, (_, comparison) in zip(arrows, made, strict=True)
    ]


def pose(series: SensorSeries, *, with_bias: bool) -> Comparison | None:
    """Velocity of the position against speed, heading and lateral velocity, as complex numbers.

    Columns: v e^{iψ} and the same turned by 90 degrees; with a lateral velocity what its lag adds, and its
    bias where ``with_bias``; without it what side slip and the place of the point add.
    """
    if not series.has("position_x", "position_y", "heading") or series.speed_source is None:
        return None
    turn = np.exp(1j * series.values["heading"])
    along = smoothed(series.speed * turn, WIDTH)
    turning = rate_of(series.values["heading"], WIDTH)
    columns = [along, 1j * along]
    fixed = np.zeros_like(along)
    if series.has("lateral_velocity"):
        across = series.values["lateral_velocity"]
        fixed = smoothed(1j * across * turn, WIDTH)
        columns.append(rate_of(1j * across * turn, WIDTH) + turning * smoothed(across * turn, WIDTH))
        columns += [smoothed(1j * turn, WIDTH)] if with_bias else []
    else:
        columns.append(1j * turning * along)
    if not (series.point_known and series.has("lateral_velocity")):
        columns.append(1j * turning * smoothed(turn, WIDTH))
    return _comparison(series, _velocity(series), columns, [None] * len(columns), fixed)


def steering_zero(series: SensorSeries) -> tuple[str, Comparison] | None:
    """Return which steering angle, and its comparison with r/v; columns: one, r/v, r v."""
    name = next((one for one in STEERING if one in series.values), None)
    if name is None or not series.has_turning or series.speed_source is None:
        return None
    speed, turning = smoothed(series.speed, WIDTH), _turning(series, WIDTH)
    gentle = np.abs(speed * turning) < GENTLE
    measured = np.where(gentle, smoothed(series.values[name], WIDTH), np.nan)
    columns = [np.ones(speed.size), turning / speed, turning * speed]
    return name, _comparison(series, measured, columns, [None] * 3)


def rests(series: SensorSeries) -> list[slice]:
    """Parts of at least ``LEAST_REST`` in which every speed of the log is zero, without their edges."""
    speeds = [smoothed(series.values[name], REST_WIDTH) for name in SPEEDS if name in series.values]
    if not speeds:
        return []
    still = np.all([np.abs(speed) < REST for speed in speeds], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int))).reshape(-1, 2)
    cut = round(EDGE * RATE)
    return [
        slice(int(first) + cut, int(last) - cut)
        for first, last in edges
        if last - first - 2 * cut >= LEAST_REST * RATE
    ]


# --- parts ----------------------------------------------------------------------------------------


def _velocity(series: SensorSeries) -> Series:
    east, north = (series.values[name] for name in ("position_x", "position_y"))
    return rate_of(east + 1j * north, WIDTH)


def _turning(series: SensorSeries, width: float) -> Array:
    """Smoothed turning rate (n,): of the heading, else of the gyro."""
    if series.has("heading"):
        return np.asarray(rate_of(series.values["heading"], width), dtype=np.float64)
    return np.asarray(smoothed(series.values["yaw_rate"], width), dtype=np.float64)


def _turning_of_steering(series: SensorSeries, power: int, width: float = WIDTH) -> Array | None:
    """v^power times the steering angle, (n,): moves like the turning, and shares no noise with it."""
    name = next((one for one in STEERING if one in series.values), None)
    if name is None or series.speed_source is None:
        return None
    made = smoothed(series.speed**power * series.values[name], width)
    return np.asarray(made, dtype=np.float64)


def _moving(series: SensorSeries, measured: Series) -> Series:
    """Leave out standstill, where the log tells it: a heading from movement means nothing there."""
    if series.speed_source is None:
        return measured
    return np.where(np.isfinite(smoothed(series.speed, WIDTH)), measured, np.nan)


def _comparison(
    series: SensorSeries,
    measured: Series,
    columns: Sequence[Series],
    instruments: Sequence[Series | None],
    fixed: Series | None = None,
) -> Comparison:
    own = [column if better is None else better for column, better in zip(columns, instruments, strict=True)]
    return Comparison(
        series.time,
        measured,
        np.zeros_like(measured) if fixed is None else fixed,
        np.column_stack(columns),
        np.column_stack(own),
    )


def _extended(comparison: Comparison, more: Sequence[Array]) -> Comparison:
    return Comparison(
        comparison.time,
        comparison.measured,
        comparison.fixed,
        np.column_stack([comparison.columns, *more]),
        np.column_stack([comparison.instruments, *more]),
    )
