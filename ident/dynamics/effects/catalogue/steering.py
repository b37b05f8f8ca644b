"""Effects between the request and the road wheels; sizes are those at the road wheels."""

from __future__ import annotations

import sympy

from ident.dynamics.effects.catalogue.entry import Entry, Usual
from ident.dynamics.effects.steering_column_play import STEERING_COLUMN_PLAY
from ident.dynamics.effects.steering_dead_zone import STEERING_DEAD_ZONE
from ident.dynamics.effects.steering_offset import STEERING_OFFSET
from ident.dynamics.effects.steering_rate_limit import STEERING_RATE_LIMIT
from ident.dynamics.effects.steering_ratio_nonlinearity import STEERING_RATIO_NONLINEARITY


def _play() -> sympy.Basic:
    wheel, measured, width = sympy.symbols("delta delta_measured w")
    return sympy.LessThan(sympy.Abs(measured - wheel), width / 2)


STEERING = (
    Entry(
        "steering_column_play",
        "A",
        (Usual("width", "rad", 2e-3, 13e-3),),
        STEERING_COLUMN_PLAY.meaning,
        STEERING_COLUMN_PLAY.shown_by,
        ("steering_friction", "dead time"),
        ("actuator",),
        STEERING_COLUMN_PLAY.equation,
    ),
    Entry(
        "steering_linkage_play",
        "G",
        (Usual("width", "rad", 1e-3, 8e-3),),
        "The road wheels follow the measured angle only where a play of width w is used up: the truck holds "
        "its yaw rate while the angle already turns back.",
        "on-centre weave (ISO 11012) at two amplitudes",
        ("steering_column_play", "steering_offset", "tyre_relaxation"),
        ("motion",),
        _play(),
    ),
    Entry(
        "steering_friction",
        "A",
        (Usual("band", "rad", 2e-3, 6e-3),),
        "Dry friction holds the steering until the request is a band away, then it jumps.",
        "slow triangle, with and without dither",
        ("steering_column_play",),
    ),
    Entry(
        "steering_rate_limit",
        "A",
        (Usual("rate", "rad/s", 0.06, 0.5),),
        STEERING_RATE_LIMIT.meaning,
        STEERING_RATE_LIMIT.shown_by,
        ("first time constant",),
        ("actuator",),
        STEERING_RATE_LIMIT.equation,
    ),
    Entry(
        "steering_dead_zone",
        "A",
        (Usual("width", "rad", 1e-3, 7e-3),),
        STEERING_DEAD_ZONE.meaning,
        STEERING_DEAD_ZONE.shown_by,
        ("steering_column_play", "steering_friction"),
        ("actuator",),
        STEERING_DEAD_ZONE.equation,
    ),
    Entry(
        "speed_dependent_steering",
        "A",
        (Usual("gain_slope", "1", -0.1, 0.1), Usual("lag_slope", "1", 0.3, 1.0)),
        "Gain and lag of the steering change with the speed of the truck.",
        "steps at 0, 3, 6 and 15 m/s",
        ("first time constant", "steering_rate_limit"),
    ),
    Entry(
        "steering_asymmetry",
        "A",
        (Usual("gain_difference", "1", 0.02, 0.1),),
        "The steering answers otherwise to the left than to the right.",
        "mirrored steps",
        ("steering_offset",),
    ),
    Entry(
        "steering_resonance",
        "A",
        (Usual("frequency", "rad/s", 12.0, 32.0), Usual("damping", "1", 0.3, 0.7)),
        "The steering swings: it overshoots as no chain of lags can.",
        "steps, and sines up to 5 Hz",
        ("second time constant", "dead time"),
    ),
    Entry(
        "command_quantisation",
        "A",
        (Usual("step", "rad", 1e-4, 5e-3),),
        "The request reaches the actuator in steps of a least size.",
        "slow ramp of the request",
        ("steering_dead_zone",),
    ),
    Entry(
        "command_hold",
        "A",
        (Usual("probability", "1", 1e-3, 5e-2),),
        "Now and then the actuator misses a request and holds the last one.",
        "fast sine of the request",
        ("clock_drift",),
    ),
    Entry(
        "steering_offset",
        "G",
        (Usual("angle", "rad", 1e-3, 10e-3),),
        STEERING_OFFSET.meaning,
        "straight, both headings, two speeds",
        ("crosswind", "road_bank", "sensor_bias"),
        ("motion",),
        STEERING_OFFSET.equation,
    ),
    Entry(
        "steering_ratio_nonlinearity",
        "G",
        (Usual("cubic", "1", -0.15, 0.15), Usual("quadratic", "1", -0.1, 0.1)),
        STEERING_RATIO_NONLINEARITY.meaning,
        "slow circles of five angles, both sides",
        ("load_transfer", "tandem_scrub"),
        ("motion",),
        STEERING_RATIO_NONLINEARITY.equation,
    ),
    Entry(
        "compliance_steer",
        "G",
        (Usual("compliance", "rad/N", 3e-7, 8e-7),),
        "The force of the front axle turns its wheels back.",
        "turns with the angle measured at the wheel itself",
        ("front cornering stiffness",),
    ),
    Entry(
        "roll_steer",
        "G",
        (Usual("coefficient", "1", -0.3, 0.3),),
        "The wheels steer as the body rolls.",
        "sine of the steering at the roll frequency",
        ("compliance_steer", "rear cornering stiffness"),
    ),
    Entry(
        "rear_axle_steer",
        "T",
        (Usual("ratio", "1", -0.3, 0.3),),
        "The rear axle, or a tag axle, steers along with the front one.",
        "slow circles with a measured lateral velocity, lane change",
        ("wheelbase", "steering_ratio_nonlinearity"),
    ),
)
