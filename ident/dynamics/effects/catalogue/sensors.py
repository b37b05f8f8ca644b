"""Effects of the sensors and of the time base."""

from __future__ import annotations

import sympy

from ident.dynamics.effects.catalogue.entry import Entry, Usual
from ident.dynamics.effects.sensor_bias import EQUATION as BIAS
from ident.dynamics.effects.sensor_bias import MEANING as MEANING_OF_BIAS
from ident.dynamics.effects.wheel_speed_scale import WHEEL_SPEED_SCALE


def _late() -> sympy.Basic:
    measured, time, delay = sympy.symbols("y_measured t tau")
    return sympy.Eq(measured, sympy.Function("y")(time - delay), evaluate=False)


def _scaled() -> sympy.Basic:
    measured, true, scale = sympy.symbols("r_measured r e")
    return sympy.Eq(measured, (1 + scale) * true, evaluate=False)


SENSORS = (
    Entry(
        "imu_lever_arm",
        "M",
        (Usual("x", "m", -3.0, 3.0), Usual("y", "m", -3.0, 3.0)),
        "The inertial unit is not where it is said to be.",
        "sine of the steering above 0.5 Hz",
        ("centre of gravity", "sensor_latency"),
    ),
    Entry(
        "imu_misalignment",
        "M",
        (
            Usual("roll", "rad", -0.05, 0.05),
            Usual("pitch", "rad", -0.05, 0.05),
            Usual("yaw", "rad", -0.05, 0.05),
        ),
        "The inertial unit is mounted askew.",
        "standstill, and straight braking",
        ("sensor_bias",),
    ),
    Entry(
        "sensor_bias",
        "M",
        (Usual("bias", "of the signal", 0.001, 0.2),),
        MEANING_OF_BIAS,
        "60 s of standstill",
        ("steering_offset", "road_bank"),
        ("sensors", "motion"),
        BIAS,
    ),
    Entry(
        "gyro_scale",
        "M",
        (Usual("scale", "1", 0.001, 0.01),),
        "The gyro reads e times the yaw rate too much.",
        "full circles with the heading measured",
        ("steering ratio",),
        ("sensors",),
        _scaled(),
    ),
    Entry(
        "wheel_speed_scale",
        "M",
        (Usual("scale", "1", 0.005, 0.04),),
        WHEEL_SPEED_SCALE.meaning,
        "straight with the position measured",
        ("steering ratio", "body_roll"),
        ("sensors", "motion"),
        WHEEL_SPEED_SCALE.equation,
    ),
    Entry(
        "sensor_latency",
        "M",
        (Usual("delay", "s", 0.005, 0.15),),
        "One sensor reads what was a delay tau ago.",
        "sweep of the steering at three speeds",
        ("tyre_relaxation", "dead time"),
        ("sensors", "motion"),
        _late(),
    ),
    Entry(
        "sensor_filter",
        "M",
        (Usual("time_constant", "s", 0.008, 0.08),),
        "One sensor is smoothed by a first-order lag.",
        "sweep of the steering up to 5 Hz",
        ("sensor_latency",),
    ),
    Entry(
        "clock_drift",
        "M",
        (Usual("drift", "1", 1e-5, 5e-5),),
        "The clock of one sensor runs too fast or too slow.",
        "long run, stamps of the sender against those of the receiver",
        ("sensor_latency",),
    ),
    Entry(
        "angle_resolution",
        "M",
        (Usual("step", "rad", 8e-5, 5e-4),),
        "The angle sensor reads in steps.",
        "slow ramp of the steering",
        ("command_quantisation",),
    ),
    Entry(
        "antenna_offset",
        "M",
        (Usual("x", "m", -4.0, 4.0), Usual("y", "m", -4.0, 4.0), Usual("heading", "rad", -0.035, 0.035)),
        "Pose and velocity belong to another point than is said, or the antenna is turned.",
        "circles to both sides",
        ("sensor_bias",),
    ),
)
