"""Small logs for tests, written by the libraries that others write theirs with."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_700_000_000 * 10**9
ANGLE = "truck_msgs/msg/SteeringWheelAngle"
REQUEST = "truck_msgs/msg/SteeringWheelRequest"
FLAG = "truck_msgs/msg/Engaged"
TYPES = get_typestore(Stores.ROS2_HUMBLE)
for _name, _field in ((ANGLE, "float64 angle"), (REQUEST, "float64 angle"), (FLAG, "bool engaged")):
    TYPES.register(get_types_from_msg(f"std_msgs/Header header\n{_field}\n", _name))


@dataclass(frozen=True)
class Message:
    """One message as it lies in a log; ``time`` is when it was recorded [ns]."""

    topic: str
    kind: str
    time: int
    data: bytes


def nanoseconds(seconds: float) -> int:
    return START + round(seconds * 1e9)


def new(kind: str, **fields):
    return TYPES.types[kind](**fields)


def header(stamp: int):
    time = new("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
    return new("std_msgs/msg/Header", stamp=time, frame_id="base_link")


def message(topic: str, kind: str, stamp: int, *, time: int | None = None, **fields) -> Message:
    """A message with a header stamped ``stamp`` [ns], recorded at ``time``, by default at its stamp."""
    data = TYPES.serialize_cdr(new(kind, header=header(stamp), **fields), kind)
    return Message(topic, kind, stamp if time is None else time, bytes(data))


def plain(topic: str, kind: str, time: int, **fields) -> Message:
    """A message without a header."""
    return Message(topic, kind, time, bytes(TYPES.serialize_cdr(new(kind, **fields), kind)))


def angles(
    count: int = 1000,
    rate: float = 100.0,
    topic: str = "/vehicle/steering_wheel",
    value: Callable[[float], float] = lambda t: t,
    kind: str = ANGLE,
) -> list[Message]:
    """Angles at a steady rate; by default each has its time since the start as its value."""
    times = np.arange(count) / rate
    return [message(topic, kind, nanoseconds(t), angle=float(value(t))) for t in times]


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0):
    return new("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def quaternion(yaw: float = 0.0, roll: float = 0.0):
    cy, sy, cr, sr = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(roll / 2), np.sin(roll / 2)
    parts = {"x": cy * sr, "y": sy * sr, "z": sy * cr, "w": cy * cr}
    return new("geometry_msgs/msg/Quaternion", **{name: float(part) for name, part in parts.items()})


def imu(stamp: int, *, rates=(0.0, 0.0, 0.0), forces=(0.0, 0.0, 9.81), yaw=None, roll=0.0, **more) -> Message:
    known = np.zeros(9) if yaw is not None else np.array([-1.0, *[0.0] * 8])
    fields = {
        "orientation": quaternion(yaw or 0.0, roll),
        "orientation_covariance": known,
        "angular_velocity": vector(*rates),
        "angular_velocity_covariance": np.zeros(9),
        "linear_acceleration": vector(*forces),
        "linear_acceleration_covariance": np.zeros(9),
    }
    return message(more.pop("topic", "/sensing/imu"), "sensor_msgs/msg/Imu", stamp, **fields, **more)


def odometry(stamp: int, x: float, y: float, yaw: float, v_x=0.0, v_y=0.0, rate=0.0, **more) -> Message:
    point = new("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0)
    pose = new("geometry_msgs/msg/Pose", position=point, orientation=quaternion(yaw))
    twist = new("geometry_msgs/msg/Twist", linear=vector(v_x, v_y), angular=vector(z=rate))
    fields = {
        "child_frame_id": "base_link",
        "pose": new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
        "twist": new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    }
    return message("/localization/odometry", "nav_msgs/msg/Odometry", stamp, **fields, **more)


def velocity(stamp: int, speed: float, topic: str = "/vehicle/velocity", **more) -> Message:
    twist = new("geometry_msgs/msg/Twist", linear=vector(speed), angular=vector())
    return message(topic, "geometry_msgs/msg/TwistStamped", stamp, twist=twist, **more)


def write_bag(folder: Path, messages: Iterable[Message], *, sqlite: bool = False, compress: str = "") -> Path:
    """A rosbag2 folder; ``compress`` is "", "file", "message" or "storage"."""
    plugin = StoragePlugin.SQLITE3 if sqlite else StoragePlugin.MCAP
    writer = Writer(folder, version=9, storage_plugin=plugin)
    if compress:
        writer.set_compression(CompressionMode[compress.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for each in messages:
            key = each.topic, each.kind
            if key not in connections:
                connections[key] = writer.add_connection(*key, typestore=TYPES)
            writer.write(connections[key], each.time, each.data)
    return folder


def write_mcap(
    path: Path,
    messages: Iterable[Message],
    *,
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 4096,
    chunks: bool = True,
    definitions: dict[str, tuple[str, str]] | None = None,
) -> Path:
    """An MCAP file; ``definitions`` replaces (encoding, text) of the schema of a type."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=chunk_size, compression=compression, use_chunking=chunks)
        writer.start(profile="ros2")
        channels: dict[tuple[str, str], int] = {}
        for each in messages:
            if (each.topic, each.kind) not in channels:
                encoding, text = (definitions or {}).get(each.kind) or ("ros2msg", _definition(each.kind))
                schema = writer.register_schema(each.kind, encoding, text.encode())
                channels[each.topic, each.kind] = writer.register_channel(each.topic, "cdr", schema)
            writer.add_message(channels[each.topic, each.kind], each.time, each.data, each.time)
        writer.finish()
    return path


def _definition(kind: str) -> str:
    return TYPES.generate_msgdef(kind, ros_version=2)[0]
