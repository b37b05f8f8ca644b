"""Effects along the truck: they need a measured drive or brake force."""

from __future__ import annotations

from ident.dynamics.effects.catalogue.entry import Entry, Usual

LONGITUDINAL = (
    Entry(
        "grade",
        "X, M",
        (Usual("angle", "rad", -0.06, 0.06),),
        "The road climbs or falls.",
        "the same hill both ways",
        ("mass", "imu_misalignment"),
    ),
    Entry(
        "aerodynamic_drag",
        "X",
        (Usual("cd_area", "m^2", 5.0, 6.5),),
        "The air holds the truck with the square of its speed.",
        "coast-down both ways",
        ("rolling_resistance",),
    ),
    Entry(
        "rolling_resistance",
        "X",
        (Usual("coefficient", "1", 0.005, 0.008),),
        "The tyres hold the truck with a constant share of its weight.",
        "slow coast-down",
        ("grade",),
    ),
    Entry(
        "powertrain_lag",
        "X",
        (Usual("time_constant", "s", 0.3, 1.0), Usual("delay", "s", 0.05, 0.5)),
        "The drive force follows its request late, and pauses while a gear is changed.",
        "pedal steps in each gear",
        ("sensor_latency",),
    ),
    Entry(
        "brake_fade",
        "X",
        (Usual("loss", "1", 0.1, 0.3),),
        "Hot brakes hold less.",
        "repeated stops",
        ("mass",),
    ),
    Entry(
        "longitudinal_slip",
        "X",
        (Usual("stiffness", "N", 2e5, 1e6),),
        "Driven wheels turn faster than the truck rolls.",
        "hard acceleration, laden",
        ("wheel_speed_scale",),
    ),
)
