"""TOPICS -> GUESSES: which topic may be which signal, by message type and by name.

A standard message type says what its fields are (REP 103: SI, x forward, y left, z up); of other types the
names of topic and field are read. A topic that is named like a command or a reference gives requests and
references. What is guessed is checked against the data by ``ident.signals.evidence``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from ident.glossary import SIGNALS

Angle = Literal["yaw", "roll"]

REQUEST = re.compile(r"cmd|command|request|req\b|target|desired|setpoint|reference|\bref\b|demand|wanted")
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


@dataclass(frozen=True)
class Guess:
    """A topic that may be a signal; the higher the score, the likelier.

    unit : as it is assumed before the data are looked at
    why : in a few words
    """

    signal: str
    topic: str
    field: str
    unit: str
    why: str
    score: float
    as_: Angle | None = None
    equals: float | None = None


@dataclass(frozen=True)
class _Meaning:
    """What a field of a standard type is: as a measurement, and where the topic is a command."""

    field: str
    measured: str | None
    commanded: str | None = None
    as_: Angle | None = None
    equals: float | None = None


def _pose(prefix: str) -> list[_Meaning]:
    return [
        _Meaning(f"{prefix}position.x", "position_x", "reference_x"),
        _Meaning(f"{prefix}position.y", "position_y", "reference_y"),
        _Meaning(f"{prefix}orientation", "heading", "reference_heading", "yaw"),
    ]


def _twist(prefix: str, forward: str) -> list[_Meaning]:
    return [
        _Meaning(f"{prefix}linear.x", forward, "reference_speed"),
        _Meaning(f"{prefix}linear.y", "lateral_velocity"),
        _Meaning(f"{prefix}angular.z", "yaw_rate"),
    ]


def _acceleration(prefix: str) -> list[_Meaning]:
    return [
        _Meaning(f"{prefix}x", "longitudinal_acceleration", "acceleration_request"),
        _Meaning(f"{prefix}y", "lateral_acceleration"),
    ]


_IMU = [
    _Meaning("angular_velocity.z", "yaw_rate"),
    *_acceleration("linear_acceleration."),
    _Meaning("angular_velocity.x", "roll_rate"),
    _Meaning("orientation", "roll_angle", as_="roll"),
]
_CONTROL = [_Meaning("lateral.steering_tire_angle", None, "road_wheel_request")]
TYPES: dict[str, list[_Meaning]] = {
    "sensor_msgs/msg/Imu": _IMU,
    "nav_msgs/msg/Odometry": [*_pose("pose.pose."), *_twist("twist.twist.", "longitudinal_velocity")],
    "geometry_msgs/msg/PoseStamped": _pose("pose."),
    "geometry_msgs/msg/PoseWithCovarianceStamped": _pose("pose.pose."),
    "geometry_msgs/msg/TwistStamped": _twist("twist.", "speed"),
    "geometry_msgs/msg/TwistWithCovarianceStamped": _twist("twist.twist.", "speed"),
    "geometry_msgs/msg/AccelStamped": _acceleration("accel.linear."),
    "geometry_msgs/msg/AccelWithCovarianceStamped": _acceleration("accel.accel.linear."),
    "autoware_control_msgs/msg/Control": [
        *_CONTROL,
        _Meaning("longitudinal.acceleration", None, "acceleration_request"),
        _Meaning("longitudinal.velocity", None, "reference_speed"),
    ],
    "autoware_auto_control_msgs/msg/AckermannControlCommand": [
        *_CONTROL,
        _Meaning("longitudinal.acceleration", None, "acceleration_request"),
        _Meaning("longitudinal.speed", None, "reference_speed"),
    ],
}
for _package in ("autoware_vehicle_msgs", "autoware_auto_vehicle_msgs"):
    TYPES[f"{_package}/msg/SteeringReport"] = [_Meaning("steering_tire_angle", "road_wheel_angle")]
    TYPES[f"{_package}/msg/VelocityReport"] = [
        _Meaning("longitudinal_velocity", "speed"),
        _Meaning("lateral_velocity", "lateral_velocity"),
        _Meaning("heading_rate", "yaw_rate"),
    ]
    TYPES[f"{_package}/msg/ControlModeReport"] = [_Meaning("mode", "engaged", "engaged", equals=1)]

_ROAD_WHEEL = r"road_?wheel|tire|tyre|front_?wheel|wheel_?angle_?(?:fl|fr)"
_WHEEL = r"steer|hand_?wheel|\bswa\b"
_NO_ANGLE = r"force|torque|speed|pressure|rate|velocity|effort|moment"
_ASIDE = r"lateral|angular|steer|rotation|wheel|yaw"
_ACCELERATION_ASIDE = r"lateral|angular|pedal"
# signal, what the name holds, what it must not hold, whether the topic or field is a command (None: either)
_NAMES: list[tuple[str, str, str | None, bool | None]] = [
    ("steering_torque_request", rf"(?:{_WHEEL}).*(?:torque|effort)", None, True),
    ("steering_wheel_rate", rf"(?:{_WHEEL}).*(?:rate|velocity|speed)", _ROAD_WHEEL, False),
    ("road_wheel_request", _ROAD_WHEEL, _NO_ANGLE, True),
    ("road_wheel_angle_left", rf"(?:{_ROAD_WHEEL}).*left", _NO_ANGLE, False),
    ("road_wheel_angle_right", rf"(?:{_ROAD_WHEEL}).*right", _NO_ANGLE, False),
    ("road_wheel_angle", _ROAD_WHEEL, rf"{_NO_ANGLE}|left|right", False),
    ("steering_wheel_request", _WHEEL, rf"{_NO_ANGLE}|{_ROAD_WHEEL}", True),
    ("steering_wheel_angle", _WHEEL, rf"{_NO_ANGLE}|{_ROAD_WHEEL}", False),
    ("yaw_rate", r"(?:yaw|heading)_?rate", None, False),
    ("lateral_velocity", r"lateral_?(?:velocity|speed)|\bv_?y\b", None, False),
    ("hitch_angle", r"hitch|articulation|trailer.*angle", _NO_ANGLE, False),
    ("acceleration_request", r"accel", _ACCELERATION_ASIDE, True),
    ("lateral_acceleration", r"lateral_?accel", None, False),
    ("longitudinal_acceleration", r"(?:longitudinal_?|vehicle_?)accel", None, False),
    ("reference_speed", r"speed|velocity", _ASIDE, True),
    ("speed", r"speed|velocity", _ASIDE, False),
    ("gear", r"\bgear\b|gear_", None, False),
]
_FLAGS = [
    ("driver_override", r"override|driver_?interven"),
    ("engaged", r"engage|autonom|auto_?mode|enabled"),
]


def guesses(topic: str, kind: str, fields: Mapping[str, str]) -> list[Guess]:
    """What the fields of a topic may be.

    Parameters
    ----------
    kind : message type
    fields : path -> type of every number in a message
    """
    if kind in TYPES:
        return list(_by_type(topic, kind, fields))
    return [guess for field, number in fields.items() if (guess := _by_name(topic, field, number))]


def _by_type(topic: str, kind: str, fields: Mapping[str, str]) -> Iterator[Guess]:
    command = bool(REQUEST.search(plain(topic)))
    raw = 0.5 if "raw" in topic.lower() else 0.0
    for meaning in TYPES[kind]:
        present = meaning.field in fields or f"{meaning.field}.w" in fields
        signal = meaning.commanded if command or meaning.measured is None else meaning.measured
        if not present or signal is None:
            continue
        score = 3.0 - raw - _detour(signal, kind)
        unit = SIGNALS[signal].unit
        yield Guess(signal, topic, meaning.field, unit, kind, score, meaning.as_, meaning.equals)


def _detour(signal: str, kind: str) -> float:
    """Prefer the sensor to the filter that is fed by it."""
    if signal in {"yaw_rate", "roll_rate", "lateral_acceleration", "longitudinal_acceleration"}:
        return 0.0 if kind == "sensor_msgs/msg/Imu" else 0.3
    return 0.1 if "Pose" in kind else 0.0


def _by_name(topic: str, field: str, number: str) -> Guess | None:
    if field.startswith(("header.", "stamp.")) or ".stamp." in field:
        return None
    text = plain(f"{topic} {field}")
    if number == "bool":
        found = next((signal for signal, pattern in _FLAGS if re.search(pattern, text)), None)
        return Guess(found, topic, field, "1", "a flag of that name", 2.0) if found else None
    command = bool(REQUEST.search(text))
    for signal, pattern, without, commanded in _NAMES:
        if commanded is not None and commanded != command:
            continue
        if re.search(pattern, text) and not (without and re.search(without, text)):
            unit = "raw" if signal == "steering_torque_request" else SIGNALS[signal].unit
            return Guess(signal, topic, field, unit, "by its name", 2.0 if _near(pattern, field) else 1.5)
    return None


def _near(pattern: str, field: str) -> bool:
    return bool(re.search(pattern, plain(field)))


def plain(name: str) -> str:
    """Lower case, words parted by underscores, parts by blanks."""
    return re.sub(r"[/.\s]+", " ", _CAMEL.sub("_", name)).lower()
