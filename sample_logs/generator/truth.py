"""The true values that the simulated truck is given, read from a folder of YAML files.

SI units throughout, ISO 8855 axes; the steering angles are those of the steering wheel. The values
themselves stand in the files, never here.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

DEFAULT_FOLDER = Path(__file__).resolve().parents[2] / "tests" / "truth"


@dataclass(frozen=True)
class Actuator:
    """K e^(-L s) / ((T1 s + 1)(T2 s + 1)) from the request to the steering-wheel angle.

    gain : K [-]
    dead_time : L [s]
    time_constant_1 : T1 [s], positive
    time_constant_2 : T2 [s], zero for one lag alone; T1 and T2 may be complex conjugates
    """

    gain: float
    dead_time: float
    time_constant_1: complex
    time_constant_2: complex

    @classmethod
    def from_damping(
        cls, gain: float, dead_time: float, natural_frequency: float, damping_ratio: float
    ) -> Actuator:
        """Build from the denominator s²/ω² + 2 ζ s/ω + 1, with ω [rad/s] and ζ [-]."""
        half_distance = natural_frequency * complex(damping_ratio**2 - 1.0) ** 0.5
        decay = natural_frequency * damping_ratio
        return cls(gain, dead_time, 1.0 / (decay - half_distance), 1.0 / (decay + half_distance))


@dataclass(frozen=True)
class Channel:
    """The errors of one measured quantity, in its unit.

    bias : constant error
    white_std : standard deviation of the white part of the noise
    noise_std : standard deviation of the coloured part
    noise_ar : a_i of n_k = sum a_i n_(k-i) + e_k, on the sample index; empty for none
    resolution : quantisation step, zero for none
    """

    bias: float = 0.0
    white_std: float = 0.0
    noise_std: float = 0.0
    noise_ar: tuple[float, ...] = ()
    resolution: float = 0.0


@dataclass(frozen=True)
class Sensor:
    """When a device sends, and how wrong each quantity of it is.

    rate : messages a second [1/s]
    jitter : standard deviation of a stamp about its even spacing [s]; the stamp is the true time
    """

    rate: float
    jitter: float
    channels: dict[str, Channel]


@dataclass(frozen=True)
class Recording:
    """How late messages reach the log: log time = stamp + latency [s]."""

    latency_shortest: float
    latency_excess: float
    tail_share: float
    tail_excess: float
    spacing: float


@dataclass(frozen=True)
class Steering:
    """The steering actuator, the commands sent to it and the sensor of its angle."""

    actuator: Actuator
    request: Sensor
    angle: Sensor


@dataclass(frozen=True)
class Body:
    """Mass [kg], yaw inertia [kg m²] and dimensions [m] of a truck with two axles."""

    mass: float
    yaw_inertia: float
    cg_to_front_axle: float
    cg_to_rear_axle: float
    track: float
    cg_height: float


@dataclass(frozen=True)
class AxleTyre:
    """F = D sin(C atan(B α - E (B α - atan(B α)))) of a whole axle, α its slip angle [rad].

    stiffness : B [1/rad]
    shape : C [-]
    peak : D [N]
    curvature : E [-]
    """

    stiffness: float
    shape: float
    peak: float
    curvature: float


@dataclass(frozen=True)
class WheelTyre:
    """The same formula for one wheel, with D and B C D that depend on its load Fz [N].

    stiffness_max, load_at_max : B C D = stiffness_max sin(2 atan(Fz / load_at_max)) [N/rad], [N]
    friction, friction_slope, nominal_load : D = friction (1 - slope (Fz - nominal)/nominal) Fz [-], [-], [N]
    shape, curvature : C, E [-]
    """

    stiffness_max: float
    load_at_max: float
    friction: float
    friction_slope: float
    nominal_load: float
    shape: float
    curvature: float


@dataclass(frozen=True)
class Planar:
    """The truck as a bicycle: no height, no track, an imposed speed.

    steering_ratio : steering-wheel angle per road-wheel angle [-]
    imu_position : from the centre of gravity: forward, left, up [m]
    """

    steering_ratio: float
    imu_position: tuple[float, float, float]
    body: Body
    front: AxleTyre
    rear: AxleTyre


@dataclass(frozen=True)
class TwoTrack:
    """The truck on four wheels, with quasi-static load transfer and a controlled speed.

    front_roll_share : share of the lateral load transfer that the front axle takes [-]
    speed_gain : acceleration per speed error [1/s]
    """

    steering_ratio: float
    imu_position: tuple[float, float, float]
    body: Body
    front_roll_share: float
    speed_gain: float
    front: WheelTyre
    rear: WheelTyre


@dataclass(frozen=True)
class Truth:
    """Everything that the generator is given."""

    steering: Steering
    velocity: Sensor
    imu: Sensor
    odometry: Sensor
    recording: Recording
    truck: TwoTrack
    planar: Planar


def load_truth(folder: Path = DEFAULT_FOLDER) -> Truth:
    """Read the truth from the YAML files of a folder."""
    sensors = {name: _sensor(values) for name, values in _read(folder / "sensors.yaml").items()}
    return Truth(
        steering=_steering(_read(folder / "steering.yaml")),
        recording=Recording(**_read(folder / "recording.yaml")),
        truck=_truck(_read(folder / "truck.yaml")),
        planar=_planar(_read(folder / "planar.yaml")),
        **sensors,
    )


def _read(path: Path) -> dict[str, Any]:
    return YAML(typ="safe", pure=True).load(path)


def _steering(values: dict[str, Any]) -> Steering:
    return Steering(
        actuator=Actuator(**values["actuator"]),
        request=_sensor(values["request"]),
        angle=_sensor(values["angle"]),
    )


def _sensor(values: dict[str, Any]) -> Sensor:
    channels = {name: _channel(errors) for name, errors in values["channels"].items()}
    return Sensor(rate=values["rate"], jitter=values["jitter"], channels=channels)


def _channel(errors: dict[str, Any]) -> Channel:
    return Channel(**{**errors, "noise_ar": tuple(errors.get("noise_ar", ()))})


def _truck(values: dict[str, Any]) -> TwoTrack:
    tyres = {axle: WheelTyre(**values[axle]) for axle in ("front", "rear")}
    return TwoTrack(**{**values, **tyres, **_body_and_imu(values)})


def _planar(values: dict[str, Any]) -> Planar:
    tyres = {axle: AxleTyre(**values[axle]) for axle in ("front", "rear")}
    return Planar(**{**values, **tyres, **_body_and_imu(values)})


def _body_and_imu(values: dict[str, Any]) -> dict[str, Any]:
    return {"body": Body(**values["body"]), "imu_position": tuple(values["imu_position"])}
