"""The topics of a run, and the rosbag2 folders they are written to with the rosbags library."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from .sensors import NANOSECONDS

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]
Storage = Literal["mcap", "sqlite3"]
Build = Callable[..., Any]

TYPES = get_typestore(Stores.ROS2_HUMBLE)
for _name, _fields in {
    "SteeringWheelRequest": "float64 angle",
    "SteeringWheelAngle": "float64 angle",
    "Engaged": "bool engaged",
}.items():
    TYPES.register(get_types_from_msg(f"std_msgs/Header header\n{_fields}\n", f"truck_msgs/msg/{_name}"))


@dataclass(frozen=True)
class Topic:
    """The messages of one topic.

    kind : key of ``KINDS``
    stamps : (n,) times of measurement [ns since the start of the recording]
    arrivals : (n,) times at which they reached the log [ns since the same]
    columns : (n,) arrays, in the order in which the kind takes them
    """

    name: str
    kind: str
    stamps: Stamps
    arrivals: Stamps
    columns: tuple[NDArray[Any], ...]


def _new(message: str, **fields: Any) -> Any:
    return TYPES.types[message](**fields)


def _vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return _new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _pose(x: float, y: float, heading: float) -> Any:
    turn = _new(
        "geometry_msgs/msg/Quaternion",
        x=0.0,
        y=0.0,
        z=float(np.sin(heading / 2)),
        w=float(np.cos(heading / 2)),
    )
    return _new(
        "geometry_msgs/msg/Pose", position=_new("geometry_msgs/msg/Point", x=x, y=y, z=0.0), orientation=turn
    )


def _request(header: Any, angle: float) -> Any:
    return _new("truck_msgs/msg/SteeringWheelRequest", header=header, angle=angle)


def _angle(header: Any, angle: float) -> Any:
    return _new("truck_msgs/msg/SteeringWheelAngle", header=header, angle=angle)


def _engaged(header: Any, engaged: float) -> Any:
    return _new("truck_msgs/msg/Engaged", header=header, engaged=bool(engaged))


def _speed(header: Any, speed: float) -> Any:
    twist = _new("geometry_msgs/msg/Twist", linear=_vector(speed), angular=_vector())
    return _new("geometry_msgs/msg/TwistStamped", header=header, twist=twist)


def _imu(
    header: Any, roll_rate: float, pitch_rate: float, yaw_rate: float, ax: float, ay: float, az: float
) -> Any:
    nothing = np.zeros(9)
    no_orientation = np.array([-1.0, *nothing[1:]])
    return _new(
        "sensor_msgs/msg/Imu",
        header=header,
        orientation=_new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=no_orientation,
        angular_velocity=_vector(roll_rate, pitch_rate, yaw_rate),
        angular_velocity_covariance=nothing,
        linear_acceleration=_vector(ax, ay, az),
        linear_acceleration_covariance=nothing,
    )


def _odometry(header: Any, x: float, y: float, heading: float, vx: float, vy: float, yaw_rate: float) -> Any:
    nothing = np.zeros(36)
    twist = _new("geometry_msgs/msg/Twist", linear=_vector(vx, vy), angular=_vector(z=yaw_rate))
    return _new(
        "nav_msgs/msg/Odometry",
        header=header,
        child_frame_id="base_link",
        pose=_new("geometry_msgs/msg/PoseWithCovariance", pose=_pose(x, y, heading), covariance=nothing),
        twist=_new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=nothing),
    )


def _reference(header: Any, x: float, y: float, heading: float) -> Any:
    return _new("geometry_msgs/msg/PoseStamped", header=header, pose=_pose(x, y, heading))


# kind: message type, frame of the header, builder
KINDS: dict[str, tuple[str, str, Build]] = {
    "request": ("truck_msgs/msg/SteeringWheelRequest", "", _request),
    "angle": ("truck_msgs/msg/SteeringWheelAngle", "", _angle),
    "engaged": ("truck_msgs/msg/Engaged", "", _engaged),
    "speed": ("geometry_msgs/msg/TwistStamped", "base_link", _speed),
    "imu": ("sensor_msgs/msg/Imu", "imu", _imu),
    "odometry": ("nav_msgs/msg/Odometry", "map", _odometry),
    "reference": ("geometry_msgs/msg/PoseStamped", "map", _reference),
}


def write_run(folder: Path, storage: Storage, start: int, topics: Sequence[Topic]) -> None:
    """Write one rosbag2 folder, in place of one of that name.

    Parameters
    ----------
    folder : the run's folder; the file in it gets the folder's name
    storage : "mcap" (chunks compressed with zstd) or "sqlite3"
    start : the start of the recording [ns since 1970]
    topics : in any order; messages are written in the order in which they arrived
    """
    if folder.exists():
        shutil.rmtree(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if storage == "mcap":
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = [writer.add_connection(t.name, KINDS[t.kind][0], typestore=TYPES) for t in topics]
        serialised = [serialise(topic, start) for topic in topics]
        order = sorted(
            (int(at), i, k) for i, topic in enumerate(topics) for k, at in enumerate(topic.arrivals)
        )
        for arrived, i, k in order:
            writer.write(connections[i], start + arrived, serialised[i][k])


def serialise(topic: Topic, start: int) -> list[Any]:
    """Serialise all messages of a topic as ROS 2 does."""
    message_type, frame, build = KINDS[topic.kind]
    rows = zip(topic.stamps.tolist(), *(column.tolist() for column in topic.columns), strict=True)
    return [
        TYPES.serialize_cdr(build(_header(start + stamp, frame), *values), message_type)
        for stamp, *values in rows
    ]


def _header(nanoseconds: int, frame: str) -> Any:
    sec, nanosec = divmod(nanoseconds, NANOSECONDS)
    stamp = _new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return _new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)
