"""How the truck is driven: speeds, the hands of a driver, and the requests of slow manoeuvres.

A driver has a lateral acceleration in mind (lane changes, bends, and small corrections all the time) and
turns the wheel as the truck would need it in a steady bend; nobody corrects the outcome.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from .truth import AxleTyre, Planar
from .vehicle import magic_formula

Array = NDArray[np.float64]

KNOT = 0.02  # [s] between the knots of the wheel's path
SPEED_KNOT = 8.0  # [s]
SLIP_LIMIT = 0.2  # [rad] beyond which a driver expects no more force
WANDER = 0.35  # [m/s²] of the corrections


@dataclass(frozen=True)
class Speed:
    """A smooth speed as a function of time [s]: value [m/s] and derivative [m/s²]."""

    curve: PchipInterpolator

    def __call__(self, time: Array) -> Array:
        """Speed [m/s]."""
        return self.curve(time)

    def rate(self, time: Array) -> Array:
        """Acceleration [m/s²]."""
        return self.curve.derivative()(time)


def varied_speed(low: float, high: float, duration: float, random: np.random.Generator) -> Speed:
    """Wander between two speeds [m/s]."""
    knots = np.arange(0.0, duration + 2.0 * SPEED_KNOT, SPEED_KNOT)
    return Speed(PchipInterpolator(knots, random.uniform(low, high, len(knots))))


def smooth_step(phase: Array) -> Array:
    """From 0 to 1 while the phase goes from 0 to 1, with rest at both ends (10 s³ - 15 s⁴ + 6 s⁵)."""
    s = np.clip(phase, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def intended_acceleration(time: Array, peak: float, duration: float, random: np.random.Generator) -> Array:
    """Lateral acceleration in a driver's mind [m/s²]: bends and lane changes, ``peak`` the largest."""
    wanted = smooth_step(time / 2.0) * _corrections(time, random)
    begin, bend = 3.0, True
    while begin < duration - 7.0:
        size = random.choice([-1.0, 1.0]) * random.uniform(0.45, 0.9) * peak
        make = _bend if bend else _lane_change
        shape, length = make(time - begin, random)
        wanted = wanted + size * shape
        begin += length + random.uniform(1.0, 2.5)
        bend = not bend
    return wanted * peak / np.max(np.abs(wanted))


def _corrections(time: Array, random: np.random.Generator) -> Array:
    frequencies = random.uniform(0.3, 3.5, 10)  # [rad/s]
    phases = random.uniform(0.0, 2.0 * np.pi, 10)
    waves = np.sin(np.outer(time, frequencies) + phases)
    return WANDER * np.sqrt(2.0 / 10.0) * waves.sum(axis=1)


def _bend(time: Array, random: np.random.Generator) -> tuple[Array, float]:
    entry, hold = random.uniform(1.2, 2.2), random.uniform(2.0, 3.5)
    shape = smooth_step(time / entry) - smooth_step((time - entry - hold) / entry)
    return shape, 2.0 * entry + hold


def _lane_change(time: Array, random: np.random.Generator) -> tuple[Array, float]:
    length = random.uniform(3.0, 4.8)
    inside = (time > 0.0) & (time < length)
    wave = np.sin(2.0 * np.pi * time / length) * smooth_step(time / 0.6) * smooth_step((length - time) / 0.6)
    return np.where(inside, wave, 0.0), length


def drivers_wheel(
    truck: Planar, peak: float, speed: Speed, duration: float, random: np.random.Generator
) -> CubicSpline:
    """Steering-wheel angle of a driver as a smooth function of time [rad]."""
    time = np.arange(0.0, duration + 1.0, KNOT)
    acceleration = intended_acceleration(time, peak, duration, random)
    return CubicSpline(time, steady_wheel_angle(truck, acceleration, speed(time)))


def steady_wheel_angle(truck: Planar, acceleration: Array, speed: Array) -> Array:
    """Steering-wheel angle of a steady bend: i (L a/v² + α_f(F_f) - α_r(F_r)) [rad]."""
    body = truck.body
    wheelbase = body.cg_to_front_axle + body.cg_to_rear_axle
    front = body.mass * acceleration * body.cg_to_rear_axle / wheelbase
    rear = body.mass * acceleration * body.cg_to_front_axle / wheelbase
    slip = _slip_for(truck.front, front) - _slip_for(truck.rear, rear)
    return truck.steering_ratio * (wheelbase * acceleration / speed**2 + slip)


def _slip_for(tyre: AxleTyre, force: Array) -> Array:
    slip = np.linspace(-SLIP_LIMIT, SLIP_LIMIT, 2001)
    curve = magic_formula(slip, tyre.stiffness, tyre.shape, tyre.peak, tyre.curvature)
    return np.interp(force, np.maximum.accumulate(curve), slip)


def slalom_request(time: Array) -> Array:
    """A slow slalom of growing amplitude: steering-wheel angle [rad]."""
    amplitude = 0.6 + 1.6 * smooth_step(time / 45.0)
    return amplitude * smooth_step((time - 2.0) / 3.0) * np.sin(0.75 * (time - 2.0))


def circle_request(time: Array) -> Array:
    """A slow circle to the left, then a wider one to the right: steering-wheel angle [rad]."""
    left = smooth_step((time - 3.0) / 4.0) - smooth_step((time - 36.0) / 4.0)
    right = smooth_step((time - 40.0) / 4.0) - smooth_step((time - 70.0) / 4.0)
    return 3.1 * left - 2.3 * right
