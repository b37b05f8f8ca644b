"""A point that moves on a plane by closed formulas, and sensors that get it wrong in any way a test may want.

Nothing is simulated: speed, turning rate and lateral velocity are sums of sines, everything else follows from
them by definition. No vehicle takes part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.glossary import SIGNALS
from ident.results import RunHealth
from ident.signals.health import signal_health
from ident.signals.run import AT_REFERENCE_POINT
from ident.signals.signal import Run, Signal
from ident.vehicle import Vehicle

Array = NDArray[np.float64]

FINE = 0.002  # [s]
REAR, IMU = 2.0, (0.5, 0.1)  # [m] CG to rear axle, place of the IMU from the CG
VEHICLE = Vehicle(
    mass=9000.0,
    cg_to_front_axle=2.5,
    cg_to_rear_axle=REAR,
    steering_ratio=20.0,
    reference_point="rear_axle",
    imu_position=(*IMU, 0.0),
)
SOURCES = {  # signal: device, samples a second
    "speed": ("wheels", 50.0),
    "steering_wheel_angle": ("column", 100.0),
    "yaw_rate": ("imu", 100.0),
    "lateral_acceleration": ("imu", 100.0),
    "heading": ("localization", 25.0),
    "position_x": ("localization", 25.0),
    "position_y": ("localization", 25.0),
    "longitudinal_velocity": ("localization", 25.0),
    "lateral_velocity": ("localization", 25.0),
}


@dataclass(frozen=True)
class Sensor:
    """What a sensor does: value = scale * true(t - lag) + bias + AR(1) noise, rounded to ``step``."""

    scale: float = 1.0
    bias: float = 0.0
    lag: float = 0.0
    noise: float = 0.0
    colour: float = 0.0
    step: float = 0.0


NOISE = {
    "speed": Sensor(noise=0.03, colour=0.5, step=0.01),
    "steering_wheel_angle": Sensor(noise=0.004, step=0.002),
    "yaw_rate": Sensor(noise=0.002, colour=0.9),
    "lateral_acceleration": Sensor(noise=0.05, colour=0.9),
    "heading": Sensor(noise=0.0015, colour=0.7),
    "position_x": Sensor(noise=0.02, colour=0.8),
    "position_y": Sensor(noise=0.02, colour=0.8),
    "longitudinal_velocity": Sensor(noise=0.03, colour=0.5),
    "lateral_velocity": Sensor(noise=0.02, colour=0.5),
}


@dataclass(frozen=True)
class Drive:
    """How the point moves.

    seconds : [s]; speed, swing : mean and variation [m/s]; turn : largest turning rate, about [rad/s]
    still : [s] of standstill at the beginning; gap : (from, to) [s] without localization; jitter : of stamps
    """

    seconds: float = 120.0
    speed: float = 10.0
    swing: float = 3.0
    turn: float = 0.15
    mean_turn: float = 0.0
    heading: float = 0.4
    still: float = 0.0
    gap: tuple[float, float] | None = None
    jitter: float = 0.002
    mirrored: bool = False
    signals: tuple[str, ...] = tuple(SOURCES)
    vehicle: Vehicle | None = field(default=VEHICLE)


def sensed(
    drive: Drive, seed: int, sensors: Mapping[str, Mapping[str, float]] = {}, name: str = "run"
) -> Run:
    """One run of the point, measured; ``sensors``: signal -> what is other than in ``NOISE``."""
    random = np.random.default_rng([seed, 5])
    time, true = _true(drive, np.random.default_rng([seed, 6]))
    stamps = {}
    signals = {}
    for signal, (device, rate) in SOURCES.items():
        if device not in stamps:
            stamps[device] = _stamps(drive, device, rate, random)
        if signal not in drive.signals:
            continue
        sensor = replace(NOISE[signal], **sensors.get(signal, {}))
        value = sensor.scale * np.interp(stamps[device] - sensor.lag, time, true[signal])
        value = value + sensor.bias + sensor.noise * _coloured(random, value.size, sensor.colour)
        if signal == "speed":
            value = np.where(np.interp(stamps[device], time, true[signal]) > 0, value, 0.0)
        if sensor.step:
            value = sensor.step * np.round(value / sensor.step)
        at = "rear_axle" if signal in AT_REFERENCE_POINT and drive.vehicle else None
        signals[signal] = Signal(signal, stamps[device], value, SIGNALS[signal].unit, at=at)
    health = RunHealth(
        name=name,
        format="memory",
        start="",
        duration=drive.seconds,
        channels="as made",
        vehicle="as made",
        topics=[],
        signals={
            one.name: signal_health(one.name, one.unit, f"/{SOURCES[one.name][0]}.{one.name}", one.values, 0)
            for one in signals.values()
        },
        missing=[],
    )
    return Run(name, 0, drive.seconds, signals, drive.vehicle, health)


def _true(drive: Drive, random: np.random.Generator) -> tuple[Array, dict[str, Array]]:
    time = FINE * np.arange(round(drive.seconds / FINE) + 1)
    rolling = np.clip((time - drive.still) / 4.0, 0.0, 1.0) if drive.still else np.ones(time.size)
    rolling = rolling**2 * (3 - 2 * rolling)
    speed = rolling * (drive.speed + drive.swing * _sines(time, random, (0.03, 0.07, 0.15)))
    turn = drive.mean_turn + drive.turn * _sines(time, random, (0.05, 0.13, 0.31, 0.55))
    side = -1.0 if drive.mirrored else 1.0
    turn = side * turn * rolling
    drift = turn * (REAR - 0.02 * speed**2) - REAR * turn
    heading = side * drive.heading + _integral(turn)
    velocity = (speed + 1j * drift) * np.exp(1j * heading)
    place = _integral(velocity.real) + 1j * _integral(velocity.imag)
    at_cg = drift + REAR * turn
    felt = speed * turn + np.gradient(at_cg, FINE)
    return time, {
        "speed": speed,
        "steering_wheel_angle": 20.0 * turn * (4.5 + 0.03 * speed**2) / np.maximum(speed, 1.0),
        "yaw_rate": turn,
        "lateral_acceleration": felt + IMU[0] * np.gradient(turn, FINE) - IMU[1] * turn**2,
        "heading": heading,
        "position_x": place.real + 300.0,
        "position_y": place.imag - 200.0,
        "longitudinal_velocity": speed,
        "lateral_velocity": drift,
    }


def _sines(time: Array, random: np.random.Generator, frequencies: tuple[float, ...]) -> Array:
    """A sum of sines of random phase, of size one or less."""
    parts = [np.sin(2 * np.pi * f * time + random.uniform(0, 2 * np.pi)) for f in frequencies]
    return np.sum(parts, axis=0) / len(frequencies)


def _integral(values: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2) * FINE])


def _stamps(drive: Drive, device: str, rate: float, random: np.random.Generator) -> Array:
    nominal = np.arange(random.uniform(0, 1 / rate), drive.seconds - 0.01, 1 / rate)
    late = drive.jitter * random.standard_normal(nominal.size)
    stamps = np.clip(nominal + np.clip(late, -0.3 / rate, 0.3 / rate), 0.0, drive.seconds)
    if drive.gap and device == "localization":
        stamps = stamps[(stamps < drive.gap[0]) | (stamps > drive.gap[1])]
    return stamps


def _coloured(random: np.random.Generator, count: int, colour: float) -> Array:
    """Stationary AR(1) noise of standard deviation one."""
    return lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], random.standard_normal(count + 500))[500:]
