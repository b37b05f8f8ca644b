"""Short steering tests in the containers of other recorders: a DDS recording, a ROS 1 bag and a plain MCAP.

The DDS recording is laid out as eProsima's recorder does it: MCAP with definitions in IDL and no headers in
the messages, so that the time of publishing is the only stamp; its payloads are plain CDR.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from .commands import Sine, pulses, pulses_end, sines, sines_end
from .messages import KINDS, TYPES, Topic, serialise
from .motion import velocity_topic
from .recorder import Recorder
from .sensors import NANOSECONDS
from .steering import ANGLE, REQUEST, SteeringTest, steering_signals
from .truth import Truth

Array = NDArray[np.float64]
Write = Callable[[Path, int, Sequence[Topic]], None]

SPEED = 5.0  # [m/s]
LIBRARY = "sample logs"
TRUCK_TYPES = ("SteeringWheelRequest", "SteeringWheelAngle")
IDL = """module truck_msgs {
  struct Vector3 { double x; double y; double z; };
  struct Twist { Vector3 linear; Vector3 angular; };
  @extensibility(APPENDABLE) struct SteeringWheelRequest { double angle; };
  @extensibility(APPENDABLE) struct SteeringWheelAngle { double angle; };
  @extensibility(APPENDABLE) struct Velocity { Twist twist; };
};
"""
DDS_TYPES = {"request": "SteeringWheelRequest", "angle": "SteeringWheelAngle", "speed": "Velocity"}
QOS = "reliability: true\ndurability: false\nownership: false\nkeyed: false"


def container_topics(truth: Truth, seed: int, name: str, sine: Sine) -> list[Topic]:
    """Record two pulses and a sine, at the speed of a crawl."""
    amplitudes = (np.pi / 4, -np.pi / 3)
    after = pulses_end(2.0, amplitudes)
    steps, wave = pulses(2.0, amplitudes), sines(after, [sine], 2.0)
    test = SteeringTest(lambda time: steps(time) + wave(time), sines_end(after, [sine], 2.0))
    own_seed = seed + 1000 * (1 + list(CONTAINERS).index(name))
    signals = steering_signals(test, truth.steering, own_seed)
    recorder = Recorder(truth.recording, seed, name, test.duration)
    return [
        recorder.logged(REQUEST, "request", _stamps(signals.request_time), signals.request),
        recorder.logged(ANGLE, "angle", _stamps(signals.angle_time), signals.angle),
        velocity_topic(recorder, truth, lambda time: np.full_like(time, SPEED)),
    ]


def _stamps(time: Array) -> NDArray[np.int64]:
    return np.round(time * NANOSECONDS).astype(np.int64)


def _in_order(topics: Sequence[Topic]) -> list[tuple[int, int, int]]:
    """(arrival, topic number, message number) of all messages."""
    return sorted((int(at), i, k) for i, topic in enumerate(topics) for k, at in enumerate(topic.arrivals))


def write_dds(path: Path, start: int, topics: Sequence[Topic]) -> None:
    """Write a DDS recording: definitions in IDL, the publish time as stamp."""
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library=LIBRARY)
        channels = []
        for topic in topics:
            schema = writer.register_schema(f"truck_msgs::{DDS_TYPES[topic.kind]}", "omgidl", IDL.encode())
            about = {"qos": QOS, "ros2-types": "false", "partitions": ""}
            channels.append(writer.register_channel(topic.name, "cdr", schema, about))
        for at, i, k in _in_order(topics):
            sent = start + int(topics[i].stamps[k])
            writer.add_message(channels[i], start + at, _dds_payload(topics[i], k), sent)
        writer.finish()


def _dds_payload(topic: Topic, k: int) -> bytes:
    """XCDR1, little-endian: doubles one after the other behind the encapsulation."""
    values = [float(column[k]) for column in topic.columns]
    if topic.kind == "speed":
        values += [0.0] * 5
    return b"\x00\x01\x00\x00" + np.array(values, dtype="<f8").tobytes()


def write_plain_mcap(path: Path, start: int, topics: Sequence[Topic]) -> None:
    """Write an MCAP file without metadata beside it, with ROS 2 definitions."""
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.LZ4)
        writer.start(profile="", library=LIBRARY)
        channels = []
        for topic in topics:
            kind = KINDS[topic.kind][0]
            text = TYPES.generate_msgdef(kind, ros_version=2)[0]
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels.append(writer.register_channel(topic.name, "cdr", schema))
        payloads = [serialise(topic, start) for topic in topics]
        for at, i, k in _in_order(topics):
            writer.add_message(channels[i], start + at, bytes(payloads[i][k]), start + at)
        writer.finish()


def write_ros1(path: Path, start: int, topics: Sequence[Topic]) -> None:
    """Write a ROS 1 bag."""
    types = get_typestore(Stores.ROS1_NOETIC)
    for name in TRUCK_TYPES:
        types.register(
            get_types_from_msg("std_msgs/Header header\nfloat64 angle\n", f"truck_msgs/msg/{name}")
        )
    path.unlink(missing_ok=True)
    writer = Ros1Writer(path)
    writer.set_compression(Ros1Writer.CompressionFormat.BZ2)
    with writer:
        connections = [writer.add_connection(t.name, KINDS[t.kind][0], typestore=types) for t in topics]
        for at, i, k in _in_order(topics):
            message = _ros1_message(types.types, topics[i], k, start)
            writer.write(connections[i], start + at, types.serialize_ros1(message, KINDS[topics[i].kind][0]))


def _ros1_message(types: dict[str, Any], topic: Topic, k: int, start: int) -> Any:
    kind, frame, _ = KINDS[topic.kind]
    sec, nanosec = divmod(start + int(topic.stamps[k]), NANOSECONDS)
    stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    header = types["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id=frame)
    value = float(topic.columns[0][k])
    if topic.kind != "speed":
        return types[kind](header=header, angle=value)
    vector = types["geometry_msgs/msg/Vector3"]
    twist = types["geometry_msgs/msg/Twist"](
        linear=vector(x=value, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0)
    )
    return types[kind](header=header, twist=twist)


# name: file, start of the recording [ns since 1970], writer, sine
CONTAINERS: dict[str, tuple[str, int, Write, Sine]] = {
    "steering_dds": ("steering_dds.mcap", 1_760_008_301_264_881_930, write_dds, Sine(1.0, 0.4, 2.0)),
    "steering_ros1": ("steering_ros1.bag", 1_760_008_502_718_035_244, write_ros1, Sine(2.0, 0.4, 4.0)),
    "steering_mcap": ("steering_mcap.mcap", 1_760_008_711_590_427_668, write_plain_mcap, Sine(3.0, 0.4, 6.0)),
}


def generate_containers(out: Path, truth: Truth, seed: int, names: Sequence[str]) -> list[Path]:
    """Write these runs of ``CONTAINERS`` into ``out``, in place of those of the same names."""
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for name in names:
        file, start, write, sine = CONTAINERS[name]
        write(out / file, start, container_topics(truth, seed, name, sine))
        written.append(out / file)
    return written
