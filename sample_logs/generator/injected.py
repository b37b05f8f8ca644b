"""What may be wrong with the truck: effects that are injected, by name, with parameters and usual sizes.

Angles of a steering wheel are at the steering wheel, those behind its sensor at the road wheels; SI units.
``TYPICAL`` holds the effects with which the loop of `ident` begins, ``OUTSIDE`` others: some from the same
catalogue, some made up here. Where a larger value is a smaller effect (``INVERSE``), a factor divides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

Parameters = Mapping[str, float]

YAW_RATE, ACROSS, DRIFT = "yaw_rate", "lateral_acceleration", "lateral_velocity"

TYPICAL: dict[str, dict[str, float]] = {
    "steering_column_play": {"width": 0.12},  # [rad] of the steering wheel, from one end to the other
    "steering_linkage_play": {"width": 4e-3},  # [rad] of the road wheels, from one end to the other
    "steering_rate_limit": {"rate": 3.0},  # [rad/s] of the steering wheel
    "steering_dead_zone": {"width": 0.06},  # [rad] of the request at the steering wheel, to one side
    "steering_offset": {"angle": 3e-3},  # [rad] of the road wheels
    "steering_ratio_nonlinearity": {"cubic": 0.5, "quadratic": 0.0},  # [1/rad²], [1/rad]: 12 % at 0.5 rad
    "tyre_relaxation": {"length": 0.5},  # [m]
    "load_transfer": {"sensitivity": 0.45, "front_share": 0.4},  # [-] see ``injected_motion``, [-]
    "sensor_latency": {"delay": 0.04},  # [s]
    "sensor_bias": {"bias": 4e-3},  # [rad/s] of the gyro; see BIAS
    "wheel_speed_scale": {"scale": 0.02},  # [-] of the logged speeds, not of the position
    "body_roll": {"gain": 0.011, "frequency": 5.0, "damping": 0.25},  # [rad s²/m], [rad/s], [-]
}
BIAS = {YAW_RATE: 4e-3, ACROSS: 0.08, DRIFT: 0.04}  # [rad/s], [m/s²], [m/s]
OF = {"sensor_latency": YAW_RATE, "sensor_bias": YAW_RATE, "sensor_filter": ACROSS}

OUTSIDE: dict[str, dict[str, float]] = {
    # actuator, at the steering wheel
    "steering_friction": {"band": 0.08},  # [rad] held back while at rest; less while moving
    "steering_resonance": {"frequency": 18.0, "damping": 0.35},  # [rad/s], [-] in place of the second lag
    "command_quantisation": {"step": 0.05},  # [rad]
    "command_hold": {"probability": 0.05},
    "speed_dependent_steering": {"lag_slope": 0.8, "gain_slope": 0.0},  # at standstill, none from 12 m/s on
    "steering_asymmetry": {"gain_difference": 0.06},  # left minus right
    "request_saturation": {"level": 6.0},  # [rad] request u acts as level tanh(u/level)
    # between steering wheel and road wheel
    "compliance_lag": {"compliance": 5e-7, "time_constant": 0.3},  # [rad/N], [s]
    "roll_steer": {"coefficient": 0.12, "frequency": 4.0},  # [-], [rad/s]
    "loosened_linkage": {"angle": 4e-3, "time": 455.0},  # [rad] from a time of the campaign on [s]
    # tyres
    "rear_axle_steer": {"ratio": 0.12},
    "friction_change": {"factor": 0.7, "time": 455.0},
    "tyre_stiffness_drift": {"loss": 0.2, "time_constant": 250.0},
    "combined_slip": {"strength": 3.0},
    "stiffness_with_speed": {"slope": 0.15},  # [-] a 10 m/s
    # forces and moments
    "quadratic_yaw_damping": {"coefficient": 8e4},  # [N m s²]
    "sideslip_moment": {"coefficient": 1.5e6},  # [N m] on the sine of the sideslip, times its size
    "speed_moment": {"coefficient": 6.0},  # [kg/s² m²] on v²
    "dragging_brake": {"moment": 1500.0, "time": 455.0},  # [N m]
    "steer_rate_moment": {"coefficient": 2.5e4},  # [N m s]
    "crosswind": {"force": 1500.0, "heading": 0.7, "arm": 0.8},  # [N], [rad], [m]
    "road_bank": {"angle": 0.03, "heading": 0.4},
    "local_bank": {"angle": 0.03, "wavelength": 130.0},  # [rad], [m] along the map's x
    "tandem_scrub": {"moment": 2.5e5},  # [N m²] on r/v
    "trailer": {"mass": 2500.0, "length": 5.5, "stiffness": 8e4},  # [kg], [m], [N/rad]
    "slosh": {"mass": 2500.0, "frequency": 3.2, "damping": 0.08},
    "payload_change": {"mass": 3000.0, "yaw_inertia": 12000.0, "cg_shift": -0.15},  # from the fifth run on
    # sensors
    "gyro_scale": {"scale": 0.02},
    "gyro_cubic": {"coefficient": 1.2},  # [s²/rad²]
    "accelerometer_scale": {"scale": 0.05},
    "sensor_filter": {"time_constant": 0.08},
    "sensor_resolution": {"step": 0.02},  # [rad/s] of the gyro
    "imu_lever_arm": {"x": 1.2, "y": 0.0},  # [m] beside where the vehicle file says
    "imu_misalignment": {"roll": 0.0, "yaw": 0.04},  # [rad]
    "clock_drift": {"drift": 1e-3, "jitter": 0.0},  # [-], [s] of the inertial unit
    "antenna_offset": {"heading": 0.01},  # [rad]
}

INVERSE = {"steering_rate_limit", "steering_resonance", "request_saturation"}


@dataclass(frozen=True)
class Injected:
    """One effect that the truck has.

    name : of ``TYPICAL`` or ``OUTSIDE``
    parameters : what is not said has its usual size
    of : signal or device ("imu", "odometry") that it acts on, where it acts on one
    """

    name: str
    parameters: Parameters = field(default_factory=dict)
    of: str | None = None

    def __post_init__(self) -> None:
        """Refuse names that mean nothing here."""
        known = {**TYPICAL, **OUTSIDE}
        if self.name not in known:
            raise ValueError(f"no effect {self.name}: one of {', '.join(known)}")
        allowed = {*known[self.name], *OPTIONAL.get(self.name, ())}
        if strange := set(self.parameters) - allowed:
            raise ValueError(f"{self.name} has no {', '.join(sorted(strange))}, but {', '.join(allowed)}")

    @property
    def values(self) -> dict[str, float]:
        """All parameters."""
        usual = dict({**TYPICAL, **OUTSIDE}[self.name])
        if self.name == "sensor_bias":
            usual = {"bias": BIAS.get(self.signal, 0.0)}
        return {**usual, **self.parameters}

    @property
    def signal(self) -> str:
        """The signal or device that it acts on."""
        return self.of or OF.get(self.name, "")


OPTIONAL = {"tyre_relaxation": ("length_front", "length_rear")}


def typical(name: str, factor: float = 1.0, of: str | None = None) -> Injected:
    """Return an effect of so many times its usual size, which is its first parameter."""
    usual = Injected(name, of=of).values
    size = next(iter(usual))
    value = usual[size] / factor if name in INVERSE else usual[size] * factor
    return Injected(name, {**usual, size: value}, of)


def parameters_of(injected: Sequence[Injected], name: str) -> Parameters | None:
    """Parameters of an effect, None where the truck does not have it."""
    found = [one.values for one in injected if one.name == name]
    if len(found) > 1:
        raise ValueError(f"{name} is injected twice")
    return found[0] if found else None
