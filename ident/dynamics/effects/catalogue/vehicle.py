"""Effects in the tyres, in the lateral force and in the yaw moment."""

from __future__ import annotations

from math import pi

from ident.dynamics.constants import GRAVITY
from ident.dynamics.effects.body_roll import BODY_ROLL
from ident.dynamics.effects.catalogue.entry import Entry, Usual
from ident.dynamics.effects.load_transfer import LOAD_TRANSFER
from ident.dynamics.effects.road_bank import ROAD_BANK
from ident.dynamics.effects.tyre_relaxation import TYRE_RELAXATION

DEGREES_PER_G = pi / 180 / GRAVITY
HERTZ = 2 * pi

VEHICLE = (
    Entry(
        "load_transfer",
        "T",
        (Usual("sensitivity", "1", 0.2, 0.7), Usual("front_share", "1", 0.2, 0.6)),
        LOAD_TRANSFER.meaning,
        "constant radius up to 0.4 g (ISO 14792)",
        ("friction_change", "steering_ratio_nonlinearity"),
        ("motion",),
        LOAD_TRANSFER.equation,
    ),
    Entry(
        "tyre_relaxation",
        "T",
        (Usual("length", "m", 0.3, 0.9),),
        TYRE_RELAXATION.meaning,
        "sweep of the steering at three speeds",
        ("sensor_latency", "dead time"),
        ("motion",),
        TYRE_RELAXATION.equation,
    ),
    Entry(
        "friction_change",
        "T",
        (Usual("factor", "1", 0.25, 0.8), Usual("time", "s", 0.0, 3600.0)),
        "The road becomes slippery, at a time or at a place.",
        "hard manoeuvre before and after",
        ("load_transfer",),
    ),
    Entry(
        "tyre_stiffness_drift",
        "T",
        (Usual("loss", "1", 0.05, 0.25), Usual("time_constant", "s", 60.0, 1800.0)),
        "Tyres lose stiffness while they warm up.",
        "the same run cold and warm",
        ("payload_change",),
    ),
    Entry(
        "combined_slip",
        "T",
        (Usual("strength", "1", 0.01, 0.05),),
        "Driving and braking take from the side force of the tyres.",
        "turn under drive or brake",
        ("friction_change",),
    ),
    Entry(
        "pneumatic_trail",
        "R",
        (Usual("trail", "m", 0.03, 0.08),),
        "The side force of a tyre acts behind its middle and turns the truck straight.",
        "none alone: it is as a shift of the centre of gravity",
        ("payload_change",),
    ),
    Entry(
        "body_roll",
        "Y, M",
        (
            Usual("gain", "rad s^2/m", 3 * DEGREES_PER_G, 10 * DEGREES_PER_G),
            Usual("frequency", "rad/s", 0.5 * HERTZ, 1.2 * HERTZ),
            Usual("damping", "1", 0.1, 0.5),
        ),
        BODY_ROLL.meaning,
        "sine of the steering, 0.3 to 1.5 Hz, with the roll rate measured",
        ("wheel_speed_scale", "gyro_scale"),
        ("motion",),
        BODY_ROLL.equation,
    ),
    Entry(
        "road_bank",
        "Y, M",
        (Usual("angle", "rad", 0.01, 0.08), Usual("heading", "rad", -pi, pi)),
        ROAD_BANK.meaning,
        "the same road both ways",
        ("sensor_bias", "steering_offset", "crosswind"),
        ("motion",),
        ROAD_BANK.equation,
    ),
    Entry(
        "crosswind",
        "Y, R",
        (Usual("force", "N", 1e3, 5e3), Usual("heading", "rad", -pi, pi), Usual("arm", "m", -1.0, 1.0)),
        "A steady wind pushes the truck to one side of the compass and turns it.",
        "straight, both headings",
        ("steering_offset", "road_bank"),
    ),
    Entry(
        "payload_change",
        "Y, R",
        (
            Usual("mass", "kg", 1e3, 3e4),
            Usual("yaw_inertia", "kg m^2", 1e3, 3e5),
            Usual("cg_shift", "m", -1.5, 1.5),
        ),
        "The load differs from run to run.",
        "the same run empty, half full and full",
        ("cornering stiffness",),
    ),
    Entry(
        "tandem_scrub",
        "R",
        (Usual("moment", "N m^2/rad", 1e5, 4e5),),
        "The axles of a tandem work against each other in a turn and hold the truck straight.",
        "slow circles of several radii",
        ("wheelbase", "steering_ratio_nonlinearity"),
    ),
    Entry(
        "lifted_axle",
        "Y, R",
        (Usual("force_share", "1", 0.1, 0.5),),
        "An axle is raised or lowered, and the wheelbase with it.",
        "the same run raised and lowered",
        ("tandem_scrub",),
    ),
    Entry(
        "trailer",
        "Y, R",
        (
            Usual("mass", "kg", 5e3, 3e4),
            Usual("length", "m", 3.0, 9.0),
            Usual("stiffness", "N/rad", 2e5, 1e6),
        ),
        "A trailer pulls at the hitch and swings.",
        "lane change with the hitch angle measured",
        ("payload_change", "body_roll"),
    ),
    Entry(
        "slosh",
        "Y",
        (
            Usual("mass", "kg", 5e2, 1e4),
            Usual("frequency", "rad/s", 0.3 * HERTZ, 0.7 * HERTZ),
            Usual("damping", "1", 0.01, 0.2),
        ),
        "A liquid load swings on after a turn.",
        "lane change with the tank partly full",
        ("body_roll", "trailer"),
    ),
)
