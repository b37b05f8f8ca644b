"""How late signals of a run are against others that measure the same motion; reported, never removed.

Pairs: yaw rate against the derivative of the heading; position against speed, heading and lateral velocity;
speed against the localization's; longitudinal acceleration against the derivative of the speed (less v_y r,
where that is known); lateral acceleration against v r + dv_y/dt, moved to the place of the IMU.

A steering angle is no such pair: between it and the yaw rate lies the vehicle, whose own lag cannot be told
from a late sensor. Nor is position against heading without the lateral velocity, or lateral acceleration
against v r alone: the side slip and its growth look like a delay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ident.results import Estimate, Latency
from ident.signals.delay import Piece, estimate_delay
from ident.signals.motion import Motion
from ident.signals.signal import Signal
from ident.vehicle import Vehicle

Array = NDArray[np.float64]

LOWEST_RATE = 4.0


@dataclass(frozen=True)
class _Known:
    """Where the signals come from, and the vehicle."""

    sources: Mapping[str, str]
    vehicle: Vehicle | None


def latencies(
    signals: Mapping[str, Signal], vehicle: Vehicle | None, sources: Mapping[str, str]
) -> list[Latency]:
    """Estimate the latency of every pair that a run holds.

    Parameters
    ----------
    signals : of one run
    vehicle : for the place of the IMU
    sources : signal -> "topic.field", or "derivative of ..."; two signals of one source are no pair
    """
    usable = {
        name: signal
        for name, signal in signals.items()
        if not signal.raw and not sources.get(name, "").startswith("derivative")
    }
    motion = Motion(usable)
    known = _Known(sources, vehicle)
    return [late for pair in PAIRS if (late := pair(motion, known)) is not None]


def _yaw_rate(motion: Motion, _known: _Known) -> Latency | None:
    if not motion.has("yaw_rate", "heading"):
        return None
    grid, rate = motion.grid("yaw_rate", "heading")
    late, reference = motion.at("yaw_rate", grid, rate), motion.derivative("heading", grid, rate)
    return Latency("yaw_rate", "heading", _estimate([(late, reference)], rate))


def _position(motion: Motion, _known: _Known) -> Latency | None:
    speed = "longitudinal_velocity" if motion.has("longitudinal_velocity") else "speed"
    names = ("position_x", "position_y", speed, "heading", "lateral_velocity")
    if not motion.has(*names):
        return None
    grid, rate = motion.grid(*names)
    v_x, heading, v_y = (motion.at(name, grid, rate) for name in names[2:])
    east = v_x * np.cos(heading) - v_y * np.sin(heading)
    north = v_x * np.sin(heading) + v_y * np.cos(heading)
    pairs = [
        (motion.derivative("position_x", grid, rate), east),
        (motion.derivative("position_y", grid, rate), north),
    ]
    return Latency("position", f"{speed}, heading, lateral_velocity", _estimate(pairs, rate))


def _speed(motion: Motion, known: _Known) -> Latency | None:
    names = ("speed", "longitudinal_velocity")
    if not motion.has(*names) or known.sources.get(names[0]) == known.sources.get(names[1]):
        return None
    grid, rate = motion.grid(*names)
    return Latency(
        *names, _estimate([(motion.at(names[0], grid, rate), motion.at(names[1], grid, rate))], rate)
    )


def _longitudinal_acceleration(motion: Motion, known: _Known) -> Latency | None:
    names = ("longitudinal_acceleration", "speed")
    if not motion.has(*names):
        return None
    turning = motion.has("yaw_rate", "lateral_velocity")
    grid, rate = motion.grid(*names, *(("yaw_rate", "lateral_velocity") if turning else ()))
    late, reference = motion.at(names[0], grid, rate), motion.derivative("speed", grid, rate)
    if turning:
        yaw_rate = motion.at("yaw_rate", grid, rate)
        arm = _lever_arm(motion, known) or 0.0
        reference -= yaw_rate * (motion.at("lateral_velocity", grid, rate) + arm * yaw_rate)
    return Latency(*names, _estimate([(late, reference)], rate))


def _lateral_acceleration(motion: Motion, known: _Known) -> Latency | None:
    names = ("lateral_acceleration", "speed", "yaw_rate", "lateral_velocity")
    if not motion.has(*names):
        return None
    grid, rate = motion.grid(*names)
    late, speed, yaw_rate = (motion.at(name, grid, rate) for name in names[:3])
    arm = _lever_arm(motion, known)
    reference = speed * yaw_rate + motion.derivative("lateral_velocity", grid, rate)
    reference += (arm or 0.0) * motion.derivative("yaw_rate", grid, rate)
    found = _estimate([(late, reference)], rate)
    if arm is None and found.value is not None:
        reason = "imu_position, or the point of the lateral velocity, is not known: 1 m looks like 1 m / v"
        found = replace(found, status="weak", reason=reason)
    return Latency("lateral_acceleration", "speed, yaw_rate, lateral_velocity", found)


def _lever_arm(motion: Motion, known: _Known) -> float | None:
    """How far the IMU is before the point of the lateral velocity [m], None where that is not known."""
    vehicle, at = known.vehicle, motion.signals["lateral_velocity"].at
    if vehicle is None or vehicle.imu_position is None or at is None:
        return None
    rear = vehicle.cg_to_rear_axle
    if at == "cg":
        return vehicle.imu_position[0]
    return None if rear is None else vehicle.imu_position[0] + rear


PAIRS: tuple[Callable[[Motion, _Known], Latency | None], ...] = (
    _yaw_rate,
    _position,
    _speed,
    _longitudinal_acceleration,
    _lateral_acceleration,
)


def _estimate(pairs: list[tuple[Array, Array]], rate: float) -> Estimate:
    if rate < LOWEST_RATE:
        reason = f"only {rate:.1f} samples a second, need {LOWEST_RATE:g}"
        return Estimate(None, None, None, None, "s", "not_identifiable", reason)
    pieces = [piece for late, reference in pairs for piece in _pieces(late, reference)]
    return estimate_delay(pieces, rate)


def _pieces(late: Array, reference: Array) -> list[Piece]:
    """Stretches in which both series have values."""
    usable = np.flatnonzero(np.isfinite(late) & np.isfinite(reference))
    runs = np.split(usable, np.flatnonzero(np.diff(usable) > 1) + 1)
    return [Piece(late[run], reference[run]) for run in runs if len(run)]
