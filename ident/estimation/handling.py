"""Figures of steady cornering in the style of ISO 14792, from any motion of the centre of gravity.

With tyres whose force is linear a motion that changes slowly needs the steering angle (force inversion of
both axles, METHODS section 3; c takes up the yaw inertia and v̇_y)

    δ = atan(L r/v) + K v r + c ṙ + δ_0,      K = m/L (l_r/C_f - l_f/C_r),

so that the understeer gradient K is a regression, as long as the angle is small (``SMALL``). It is taken
from parts that are nearly steady: over ``SETTLED`` seconds the steering asked for a change of the lateral
acceleration of less than ``STEADY`` (by v² δ/L), and the speed changed by less than ``STEADY_SPEED``; what is
left of the transient goes into c. The steering of tyres that are not linear is δ = ... + K_3 (v r)³: the
linear range ends where that is ``DEPARTURE`` of the linear steering (L/v² + K) v r.

Standard errors are those of the sandwich over blocks of ``BLOCK`` seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import savgol_filter
from scipy.stats import t

from ident.estimation.sandwich import coefficient
from ident.estimation.smooth_motion import SmoothMotion, smooth_motion
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord, Samples
from ident.results import Estimate, Status

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLED = 1.0  # [s]
STEADY, STEADY_SPEED = 1.5, 0.5  # [m/s²], [m/s]
LEAST_SPEED = 3.0  # [m/s]
SMALL = 0.15  # [rad]: with slip, atan(L r/v) is wrong by (L r/v)² times the slip angle
LINEAR = 2.0  # [m/s²] up to which the gradient is that of the linear range
LEAST_SPAN = 1.0  # [m/s²] of the lateral acceleration, without ``APART`` at either end
APART = 1.0  # [s]
LEAST_CORRELATION = 0.9  # of steering and yaw rate over speed
LEAST_SECONDS = 5.0
BLOCK = 2.5  # [s]
FEWEST_BLOCKS = 6
DEPARTURE = 0.1
CLASS = 5.0  # [m/s] width of a class of speeds
NEAR = 0.25  # of the speed of a class
IDENTIFIED, WEAK = 0.1, 0.5  # relative standard errors


@dataclass(frozen=True)
class Figure(Estimate):
    """An estimate that remembers where its error comes from.

    influence : (b,) what each block of driving, or each spectral line, adds to the error, None where unknown.
        Two figures of the same driving have errors in common, which their difference has not.
    """

    influence: Array | None = None


@dataclass(frozen=True)
class Drive:
    """One uninterrupted stretch of motion of the centre of gravity on a uniform grid (m,).

    road_wheel_angle [rad], speed [m/s], yaw_rate [rad/s]
    yaw_acceleration [rad/s²], by a parabola over ``SETTLED`` seconds: noise would make c too small
    lateral_acceleration [m/s²], which is v r where ``is_felt`` is False
    valid : (m,) where all of these come from samples nearby
    """

    run: int
    period: float
    road_wheel_angle: Array
    speed: Array
    yaw_rate: Array
    yaw_acceleration: Array
    lateral_acceleration: Array
    valid: Mask
    is_felt: bool


def drives(records: Sequence[MotionRecord], body: Body) -> list[Drive]:
    """Motion of the stretches of which yaw rate or heading is known; records must not overlap."""
    prepared = [pair for record in records if (pair := _prepared(record)) is not None]
    motions = smooth_motion([replace(one, imu=(0.0, 0.0)) for one, _ in prepared], body)
    by_start = {(one.run, float(one.times[0])): (one.imu, has) for one, has in prepared}
    made: list[tuple[SmoothMotion, tuple[float, float], bool]] = []
    for motion in motions:
        key = (motion.run, float(motion.times[0]))
        if key in by_start:
            made.append((motion, *by_start[key]))
        elif made and (made[-1][0].run, float(made[-1][0].times[-1])) == key:
            made[-1] = (_joined(made[-1][0], motion), *made[-1][1:])
    return [_drive(motion, imu, is_felt=is_felt) for motion, imu, is_felt in made]


def _prepared(record: MotionRecord) -> tuple[MotionRecord, bool] | None:
    """Keep yaw rate (or heading) and lateral acceleration; v r where that was not measured."""
    name = next((one for one in ("yaw_rate", "heading") if _holds(record, one)), None)
    if name is None:
        return None
    turn = record.measured[name]
    if _holds(record, "lateral_acceleration"):
        kept = {name: turn, "lateral_acceleration": record.measured["lateral_acceleration"]}
        return replace(record, measured=kept), True
    rate = turn.values if name == "yaw_rate" else np.gradient(turn.values, turn.times)
    across = Samples(turn.times, np.interp(turn.times, record.times, record.speed) * rate)
    return replace(record, measured={name: turn, "lateral_acceleration": across}, imu=(0.0, 0.0)), False


def _holds(record: MotionRecord, name: str) -> bool:
    samples = record.measured.get(name)
    return samples is not None and samples.times.size >= 5


def _drive(motion: SmoothMotion, imu: tuple[float, float], *, is_felt: bool) -> Drive:
    """Bring the smoothed motion of the IMU to the centre of gravity.

    The slope is that of the smoothed yaw rate, so that all parts of the sum are smoothed alike.
    """
    period = float((motion.times[-1] - motion.times[0]) / (motion.times.size - 1))
    slope = np.gradient(motion.yaw_rate, period)
    points = min(2 * round(SETTLED / period / 2) + 1, motion.times.size - (motion.times.size + 1) % 2)
    trend = savgol_filter(motion.yaw_rate, points, 2, deriv=1, delta=period) if points > 2 else slope
    moved = motion.lateral_acceleration - imu[0] * slope + imu[1] * motion.yaw_rate**2
    return Drive(
        motion.run,
        period,
        motion.road_wheel_angle,
        motion.speed,
        motion.yaw_rate,
        np.asarray(trend),
        np.asarray(moved),
        motion.valid & (motion.speed >= LEAST_SPEED),
        is_felt,
    )


def _joined(one: SmoothMotion, other: SmoothMotion) -> SmoothMotion:
    """Two pieces, the second of which begins at the last instant of the first."""

    def both(name: str) -> Array:
        return np.concatenate([getattr(one, name), getattr(other, name)[1:]])

    return replace(
        one,
        times=both("times"),
        road_wheel_angle=both("road_wheel_angle"),
        speed=both("speed"),
        yaw_rate=both("yaw_rate"),
        lateral_acceleration=both("lateral_acceleration"),
        valid=np.concatenate([one.valid, other.valid[1:]]),
    )


def steady(drive: Drive, wheelbase: float) -> Mask:
    """Where (m,) steering and speed have been steady; decided by what drives the vehicle alone."""
    points = max(2, round(SETTLED / drive.period))
    turning = drive.speed**2 * np.tan(drive.road_wheel_angle) / wheelbase
    calm = (_spread(turning, points) <= STEADY) & (_spread(drive.speed, points) <= STEADY_SPEED)
    calm &= np.abs(drive.road_wheel_angle) <= SMALL
    calm[: points - 1] = False
    return np.asarray(calm & drive.valid)


def _spread(values: Array, points: int) -> Array:
    """Largest minus smallest value of the last ``points``."""
    back = (points - 1) // 2
    highest = maximum_filter1d(values, points, origin=back)
    return np.asarray(highest - minimum_filter1d(values, points, origin=back))


@dataclass(frozen=True)
class SteadyStates:
    """All instants (n,) of nearly steady motion, and the block of each.

    angle [rad], speed [m/s], yaw_rate [rad/s], yaw_acceleration [rad/s²]
    seconds : of them all together
    """

    angle: Array
    speed: Array
    yaw_rate: Array
    yaw_acceleration: Array
    block: NDArray[np.intp]
    seconds: float

    @property
    def lateral_acceleration(self) -> Array:
        """V r, that of the steady motion [m/s²]: a sensor would add the roll of the body and a bank."""
        return self.speed * self.yaw_rate

    def where(self, mask: Mask) -> SteadyStates:
        """Some of the instants."""
        share = float(np.count_nonzero(mask)) / max(1, mask.size)
        return SteadyStates(
            self.angle[mask],
            self.speed[mask],
            self.yaw_rate[mask],
            self.yaw_acceleration[mask],
            self.block[mask],
            self.seconds * share,
        )


def steady_states(given: Sequence[Drive], masks: Sequence[Mask]) -> SteadyStates:
    """Gather the instants of all stretches."""
    blocks: list[NDArray[np.intp]] = [np.zeros(0, dtype=np.intp)]
    count = 0
    for drive, mask in zip(given, masks, strict=True):
        own = np.arange(mask.size) // max(1, round(BLOCK / drive.period))
        blocks.append((own[mask] + count).astype(np.intp))
        count += int(own[-1]) + 1
    seconds = sum(float(np.count_nonzero(m)) * d.period for d, m in zip(given, masks, strict=True))

    def gathered(name: str) -> Array:
        own = [getattr(drive, name)[mask] for drive, mask in zip(given, masks, strict=True)]
        return np.concatenate([np.zeros(0), *own])

    return SteadyStates(
        gathered("road_wheel_angle"),
        gathered("speed"),
        gathered("yaw_rate"),
        gathered("yaw_acceleration"),
        np.concatenate(blocks),
        seconds,
    )


def understeer_gradient(states: SteadyStates, wheelbase: float) -> Figure:
    """K of the linear range [rad s²/m]."""
    own = states.where(np.abs(states.lateral_acceleration) <= LINEAR)
    reason = _why_not(own)
    if reason is not None:
        return unknown("rad s^2/m", reason)
    needed = own.angle - np.arctan(wheelbase * own.yaw_rate / own.speed)
    columns = np.column_stack([np.ones(needed.size), own.lateral_acceleration, own.yaw_acceleration])
    value, influence, freedom = coefficient(needed, columns, own.block, 1)
    return from_influence(value, influence, "rad s^2/m", freedom)


def end_of_linear_range(states: SteadyStates, wheelbase: float) -> Figure:
    """|a_y| [m/s²] from which the steering departs by ``DEPARTURE`` from that of linear tyres."""
    reason = _why_not(states)
    if reason is not None:
        return unknown("m/s^2", reason)
    size = states.lateral_acceleration
    needed = states.angle - np.arctan(wheelbase * states.yaw_rate / states.speed)
    columns = np.column_stack([np.ones(size.size), size, states.yaw_acceleration, size**3])
    linear, _, _ = coefficient(needed, columns, states.block, 1)
    cubic, influence, freedom = coefficient(needed, columns, states.block, 3)
    most = float(np.quantile(np.abs(size), 0.99))
    per_acceleration = wheelbase / float(np.median(states.speed)) ** 2 + linear
    end = np.sqrt(DEPARTURE * abs(per_acceleration / cubic)) if cubic else np.inf
    if end > most or abs(cubic) < 2 * np.linalg.norm(influence):
        return unknown(
            "m/s^2",
            f"the steering stays within {100 * DEPARTURE:g} % of that of linear tyres in steady cornering up "
            f"to {most:.1f} m/s², the hardest driven",
        )
    return from_influence(float(end), -end / (2 * cubic) * influence, "m/s^2", freedom)


def speed_classes(states: SteadyStates) -> list[float]:
    """Speeds [m/s], multiples of ``CLASS``, near which there is enough steady cornering."""
    numbers = np.unique(np.round(states.speed / CLASS)) * CLASS
    return [float(one) for one in numbers if one > 0 and _why_not(_near(states, float(one))) is None]


def yaw_rate_gain(states: SteadyStates, wheelbase: float, speed: float) -> Figure:
    """Steady yaw rate over road-wheel angle [1/s] at a speed [m/s].

    Samples at other speeds near it are scaled by v/(L + K v²), with the gradient K of the same motion.
    """
    own = _near(states, speed)
    reason = _why_not(own)
    if reason is not None:
        return unknown("1/s", reason)
    gradient = understeer_gradient(states, wheelbase).value or 0.0
    scale = (speed / (wheelbase + gradient * speed**2)) / (own.speed / (wheelbase + gradient * own.speed**2))
    columns = np.column_stack([np.ones(own.speed.size), own.yaw_rate * scale, own.yaw_acceleration])
    inverse, influence, freedom = coefficient(own.angle, columns, own.block, 1)
    return from_influence(1 / inverse, -influence / inverse**2, "1/s", freedom)


def _near(states: SteadyStates, speed: float) -> SteadyStates:
    near = np.abs(states.speed - speed) <= max(NEAR * speed, 0.5 * CLASS)
    return states.where(near & (np.abs(states.lateral_acceleration) <= LINEAR))


def _why_not(states: SteadyStates) -> str | None:
    """Say why these instants do not tell, None where they do."""
    blocks = np.unique(states.block).size
    if states.seconds < LEAST_SECONDS or blocks < FEWEST_BLOCKS:
        return (
            f"{states.seconds:.1f} s of nearly steady cornering in {blocks} blocks, need {LEAST_SECONDS:g} s "
            f"in {FEWEST_BLOCKS}: drive circles or slow ramps of the steering"
        )
    apart = min(0.25, APART / states.seconds)
    span = float(np.ptp(np.quantile(states.lateral_acceleration, [apart, 1 - apart])))
    if span < LEAST_SPAN:
        return (
            f"in steady cornering the lateral acceleration spans {span:.2f} m/s², need {LEAST_SPAN:g} m/s²: "
            "drive circles of other radii or speeds"
        )
    correlation = float(np.corrcoef(states.angle, states.yaw_rate / states.speed)[0, 1])
    if not correlation >= LEAST_CORRELATION:
        return (
            f"in steady cornering the yaw rate follows the steering with a correlation of {correlation:.2f}, "
            f"need {LEAST_CORRELATION:g}: drive tighter or longer circles"
        )
    return None


def from_influence(value: float, influence: Array, unit: str, freedom: float) -> Figure:
    """Figure whose standard error is the norm of what the blocks add to it."""
    return replace(estimate(value, float(np.linalg.norm(influence)), unit, freedom), influence=influence)


def estimate(value: float, std: float, unit: str, freedom: float) -> Figure:
    """Put the interval of Student's t about a value."""
    reach = float(t.ppf(0.975, max(1.0, freedom))) * std
    relative = std / abs(value) if value else (0.0 if std == 0 else np.inf)
    status: Status = "identified" if relative <= IDENTIFIED else "weak"
    reason = None if status == "identified" else f"its standard error is {std:.2g}"
    return Figure(value, std, value - reach, value + reach, unit, status, reason)


def unknown(unit: str, reason: str) -> Figure:
    """Give no value, and why."""
    return Figure(None, None, None, None, unit, "not_identifiable", reason)


def std_of_difference(one: Figure, other: Figure) -> float:
    """Standard error of the difference of two figures of the same driving.

    Where it is not known what each block adds, the larger of the two errors.
    """
    if one.influence is None or other.influence is None:
        return max(one.std or 0.0, other.std or 0.0)
    parts = np.zeros((2, max(one.influence.size, other.influence.size)))
    for row, figure in zip(parts, (one.influence, other.influence), strict=True):
        row[: figure.size] = figure
    return float(np.linalg.norm(parts[0] - parts[1]))
