"""Measured motion of a window, smoothed and brought to the centre of gravity on the grid of the window.

Each signal is interpolated to the grid, then a parabola (for the heading a cubic) is fitted around every grid
point (Savitzky and Golay 1964) over ``WINDOW`` seconds, or over five samples of the slowest signal where that
is longer. Value and slope come from the same fit, without delay; with 0.2 s slopes are within 3 % up to
0.85 Hz and at -3 dB at 2.75 Hz. What is faster is lost: a heavy truck turns slower than that.

To the centre of gravity (METHODS section 2): a_y = a_y,P - x_P ṙ + y_P r², v_y = v_y,P - x_P r.

The lateral velocity is the measured one. Where none was measured it is the integral of a_y - v r: its start
and a steady drift (the bias of the accelerometer, a bank of the road) of each window are those which put the
force of the rear axle and its slip angle on one straight line for all windows,

    ∫(a_y - v r) dt = l_r r - v F_yr / C_r + c_0 + c_1 t,

taken where the tyres slip little. Without lateral acceleration it is the velocity of the position across the
heading, which is noisy (the window is ``OF_POSITION`` long) and holds v times an error of the heading.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import savgol_filter

from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord, Samples, cut

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WINDOW = 0.2  # [s]
PIECE = 10.0  # [s] in which a drift is steady
OF_POSITION = 0.8  # [s] window where velocities are slopes of the position
LONGEST_BRIDGE = 0.25  # [s] from a grid point to the nearest sample
GENTLE = 2.0  # [m/s²]
FEWEST = 200
TYPICAL_COEFFICIENT = 8.0  # [1/rad] cornering stiffness of a heavy axle over its load


@dataclass(frozen=True)
class SmoothMotion:
    """Motion of the centre of gravity on the grid (m,) of one window.

    road_wheel_angle [rad], speed [m/s]
    yaw_rate [rad/s], yaw_acceleration [rad/s²], lateral_acceleration [m/s²], lateral_velocity [m/s]
    valid : (m,) where all of these come from samples nearby and not from an edge
    slip_source : where the lateral velocity comes from, None where from nothing
    """

    run: int
    times: Array
    road_wheel_angle: Array
    speed: Array
    yaw_rate: Array
    yaw_acceleration: Array
    lateral_acceleration: Array
    lateral_velocity: Array
    valid: Mask
    slip_source: str | None


def smooth_motion(
    records: Sequence[MotionRecord], body: Body, bias: Mapping[str, float] | None = None
) -> list[SmoothMotion]:
    """Smooth all windows, cut into pieces of ``PIECE`` seconds.

    Parameters
    ----------
    bias : signal -> what is subtracted from it; "steering_offset" -> what is added to the road-wheel angle;
        "lateral_velocity_by_speed" -> what, times the speed, is subtracted from the lateral velocity

    Notes
    -----
    A window without yaw rate and without heading is left out.
    """
    pieces = [piece for record in records for piece in cut(record, PIECE)]
    kinematic = [_kinematic(piece, bias or {}) for piece in pieces]
    known = [motion for motion in kinematic if motion is not None]
    return _with_integrated_velocity(known, body)


def _kinematic(record: MotionRecord, bias: Mapping[str, float]) -> SmoothMotion | None:
    smoother = _Smoother(record, bias)
    turning = smoother.turning()
    if turning is None:
        return None
    yaw_rate, yaw_acceleration = turning
    forward, left = record.imu
    along, across = smoother.inputs()
    lateral_velocity, source = smoother.lateral_velocity(yaw_rate)
    measured = smoother.get("lateral_acceleration")
    if measured is not None:
        lateral_acceleration = measured[0] - forward * yaw_acceleration + left * yaw_rate**2
    else:
        rising = 0.0 if lateral_velocity is None else smoother.slope(lateral_velocity)
        lateral_acceleration = along * yaw_rate + rising
    nothing = np.full(record.times.size, np.nan)
    return SmoothMotion(
        record.run,
        record.times,
        across,
        along,
        yaw_rate,
        yaw_acceleration,
        lateral_acceleration,
        nothing if lateral_velocity is None else lateral_velocity,
        smoother.valid(),
        source,
    )


MEASURED, INTEGRAL, POSITION = "measured lateral velocity", "integrated a_y - v r", "position and heading"


class _Smoother:
    """Signals of one window, smoothed alike; remembers where they are known."""

    def __init__(self, record: MotionRecord, bias: Mapping[str, float]) -> None:
        self.record, self.bias = record, bias
        slowest = max((_period(one) for one in record.measured.values() if one.times.size > 1), default=0.0)
        own = WINDOW if {"lateral_velocity", "lateral_acceleration"} & set(record.measured) else OF_POSITION
        points = max(own, 5 * slowest) / record.period
        self.count = min(2 * max(2, round(points / 2)) + 1, record.times.size - (record.times.size + 1) % 2)
        self.known = np.ones(record.times.size, dtype=np.bool_)

    def get(self, name: str, order: int = 2, deriv: int = 1) -> list[Array] | None:
        """Value and derivatives up to ``deriv`` of a measured signal, None where there is none."""
        samples = self.record.measured.get(name)
        if samples is None or samples.times.size < 5 or self.count < 5:
            return None
        self.known &= _near(self.record.times, samples)
        values = np.interp(self.record.times, samples.times, samples.values) - self.bias.get(name, 0.0)
        return [self._smooth(values, order, each) for each in range(deriv + 1)]

    def inputs(self) -> tuple[Array, Array]:
        """Speed and road-wheel angle."""
        angle = self.record.road_wheel_angle + self.bias.get("steering_offset", 0.0)
        return self._smooth(self.record.speed, 2, 0), self._smooth(angle, 2, 0)

    def turning(self) -> tuple[Array, Array] | None:
        """Yaw rate and its derivative, from the heading where no yaw rate was measured."""
        found = self.get("yaw_rate")
        if found is not None:
            return found[0], found[1]
        heading = self.get("heading", order=3, deriv=2)
        return None if heading is None else (heading[1], heading[2])

    def lateral_velocity(self, yaw_rate: Array) -> tuple[Array | None, str | None]:
        """At the centre of gravity, from the measured one or from position and heading."""
        arm = self.record.reference_x * yaw_rate
        found = self.get("lateral_velocity")
        if found is not None:
            turned = self.bias.get("lateral_velocity_by_speed", 0.0)
            return found[0] - arm - turned * self._smooth(self.record.speed, 2, 0), MEASURED
        if "lateral_acceleration" in self.record.measured:
            return None, INTEGRAL
        known = self.known.copy()
        x, y, heading = (self.get(name) for name in ("position_x", "position_y", "heading"))
        if x is None or y is None or heading is None:
            self.known = known
            return None, None
        return y[1] * np.cos(heading[0]) - x[1] * np.sin(heading[0]) - arm, POSITION

    def slope(self, values: Array) -> Array:
        """Derivative of a series on the grid."""
        return self._smooth(values, 2, 1)

    def valid(self) -> Mask:
        """Where every signal that was asked for has samples nearby, and half a window from the ends."""
        inside = np.zeros(self.known.size, dtype=np.bool_)
        inside[self.count // 2 : self.known.size - self.count // 2] = True
        return self.known & inside

    def _smooth(self, values: Array, order: int, deriv: int) -> Array:
        if self.count <= order:
            return np.full(values.size, np.nan)
        return np.asarray(savgol_filter(values, self.count, order, deriv=deriv, delta=self.record.period))


def _period(samples: Samples) -> float:
    return float(np.median(np.diff(samples.times)))


def _near(grid: Array, samples: Samples) -> Mask:
    """Which grid points have a sample within ``LONGEST_BRIDGE`` or two periods."""
    after = np.clip(np.searchsorted(samples.times, grid), 1, samples.times.size - 1)
    distance = np.minimum(np.abs(grid - samples.times[after - 1]), np.abs(samples.times[after] - grid))
    return np.asarray(distance <= max(LONGEST_BRIDGE, 2 * _period(samples)))


# --- lateral velocity by integration --------------------------------------------------------------


def rear_force(motion: SmoothMotion, body: Body, yaw_inertia: float) -> Array:
    """F_yr = (l_f m a_y - I_z ṙ)/L [N]."""
    moment = body.cg_to_front_axle * body.mass * motion.lateral_acceleration
    return (moment - yaw_inertia * motion.yaw_acceleration) / body.wheelbase


def usual_inertia(body: Body) -> float:
    """Yaw inertia as stated, else m l_f l_r [kg m²]."""
    return body.yaw_inertia or body.mass * body.cg_to_front_axle * body.cg_to_rear_axle


def gentle(motions: Sequence[SmoothMotion]) -> list[Mask]:
    """Of each window the valid instants at which the tyres slip little: below ``GENTLE`` m/s².

    Where all windows together hold fewer than ``FEWEST`` of them, the gentler half.
    """
    sizes = [np.abs(motion.lateral_acceleration) for motion in motions]
    masks = [motion.valid & (size <= GENTLE) for motion, size in zip(motions, sizes, strict=True)]
    if sum(int(np.count_nonzero(mask)) for mask in masks) >= FEWEST:
        return masks
    return [_gentler_half(motion) for motion in motions]


def _gentler_half(motion: SmoothMotion) -> Mask:
    size = np.abs(motion.lateral_acceleration)
    return motion.valid & (size <= (np.median(size[motion.valid]) if motion.valid.any() else 0.0))


def _with_integrated_velocity(motions: list[SmoothMotion], body: Body) -> list[SmoothMotion]:
    open_ones = [motion for motion in motions if motion.slip_source == INTEGRAL]
    if not open_ones:
        return motions
    sides = [_sides(m, body, use) for m, use in zip(open_ones, gentle(open_ones), strict=True)]
    product = sum(float(x @ y) for x, y in sides)
    square = sum(float(x @ x) for x, _ in sides)
    load = body.load("rear")
    compliance = product / square if square > 0 else 0.0
    if not 1 / (60 * load) < compliance < 1 / (1.5 * load):
        compliance = 1 / (TYPICAL_COEFFICIENT * load)
    return [
        _integrated(motion, body, compliance) if motion.slip_source == INTEGRAL else motion
        for motion in motions
    ]


def _sides(motion: SmoothMotion, body: Body, use: Mask) -> tuple[Array, Array]:
    """-v F_yr and the integral less l_r r where ``use``, both without level and drift."""
    force = -motion.speed * rear_force(motion, body, usual_inertia(body))
    left = _integral(motion) - body.cg_to_rear_axle * motion.yaw_rate
    return _without_drift(motion.times, force, use)[use], _without_drift(motion.times, left, use)[use]


def _integral(motion: SmoothMotion) -> Array:
    rate = motion.lateral_acceleration - motion.speed * motion.yaw_rate
    return np.asarray(cumulative_trapezoid(rate, motion.times, initial=0))


def _without_drift(times: Array, values: Array, use: Mask) -> Array:
    """Values less the straight line through those in use."""
    if np.count_nonzero(use) < 3:
        return np.zeros_like(values)
    return np.asarray(values - np.polyval(np.polyfit(times[use], values[use], 1), times))


def _integrated(motion: SmoothMotion, body: Body, compliance: float) -> SmoothMotion:
    use = motion.valid & (np.abs(motion.lateral_acceleration) <= GENTLE)
    if np.count_nonzero(use) < FEWEST:
        use = _gentler_half(motion)
    if np.count_nonzero(use) < 3:
        return replace(motion, valid=np.zeros_like(motion.valid))
    force = rear_force(motion, body, usual_inertia(body))
    linear = body.cg_to_rear_axle * motion.yaw_rate - motion.speed * force * compliance
    rest = _integral(motion) - linear
    return replace(motion, lateral_velocity=linear + _without_drift(motion.times, rest, use))
