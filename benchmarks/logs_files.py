"""The logs that ``bench_logs.py`` reads: thin channels of a truck between its images and point clouds.

Steering twice at 100 Hz, Imu at 200 Hz, Odometry at 50 Hz, TwistStamped at 100 Hz, and at 10 Hz compressed
images of 100 kB (which nothing makes smaller) and point clouds of 50 kB (about half of which zstd takes
away): 100 MB a minute. The same messages go into every format, from one seed. They are laid out here by hand
with numpy and written by the libraries of others, so that nothing is shared with the readers.
"""

from __future__ import annotations

import heapq
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_700_000_000 * 10**9
CHUNK = 768 << 10  # what rosbag2 writes unless told otherwise
STEERING = "truck_msgs/msg/SteeringWheelAngle"
FRAME = b"base_link\0"
IMAGE_BYTES, CLOUD_BYTES = 100_000, 50_000
SPARES = 16  # different images and clouds

TYPES = get_typestore(Stores.ROS2_HUMBLE)
TYPES.register(get_types_from_msg("std_msgs/Header header\nfloat64 angle\n", STEERING))
TYPES_1 = get_typestore(Stores.ROS1_NOETIC)
TYPES_1.register(get_types_from_msg("std_msgs/Header header\nfloat64 angle\n", STEERING))

# What is behind the header of a message, in 8-byte numbers: name -> how many.
_VECTORS = {"linear": 3, "angular": 3}
_IMU = {"q": 4, "q_cov": 9, "angular": 3, "angular_cov": 9, "linear": 3, "linear_cov": 9}
_ODOMETRY = {"position": 3, "q": 4, "pose_cov": 36, "linear": 3, "angular": 3, "twist_cov": 36}


@dataclass(frozen=True)
class Stream:
    """A channel: topic, type, rate [Hz], and the numbers of its messages (empty: a large one)."""

    topic: str
    kind: str
    rate: int
    numbers: dict[str, int]


STREAMS = (
    Stream("/steering/request", STEERING, 100, {"angle": 1}),
    Stream("/steering/measured", STEERING, 100, {"angle": 1}),
    Stream("/imu", "sensor_msgs/msg/Imu", 200, _IMU),
    Stream("/odometry", "nav_msgs/msg/Odometry", 50, _ODOMETRY),
    Stream("/twist", "geometry_msgs/msg/TwistStamped", 100, _VECTORS),
    Stream("/camera", "sensor_msgs/msg/CompressedImage", 10, {}),
    Stream("/points", "sensor_msgs/msg/PointCloud2", 10, {}),
)


def _numbers(stream: Stream, count: int, seed: int) -> NDArray[np.float64]:
    """Noise that wanders slowly, as signals do, (count, numbers)."""
    width = sum(stream.numbers.values())
    steps = np.random.default_rng(seed).normal(0.0, 1e-3, (count, width))
    values = np.cumsum(steps, axis=0)
    place = 0
    for name, size in stream.numbers.items():
        if name.endswith("cov"):
            values[:, place : place + size] = np.linspace(0.0, 1.0, size)
        place += size
    return values


def _layout(stream: Stream, *, ros1: bool) -> np.dtype[np.void]:
    """Build the layout of a thin message: CDR aligned to 8 bytes behind 4, ROS 1 not aligned at all."""
    fields: list[tuple[str, object]] = [("head", "V4")]
    if ros1:
        fields = [("seq", "<u4")]
    fields += [("sec", "<u4"), ("nanosec", "<u4"), ("length", "<u4")]
    frame = FRAME[:-1] if ros1 else FRAME
    fields.append(("frame", f"S{len(frame)}"))
    if not ros1:
        fields.append(("pad", f"V{-(12 + len(frame)) % 8}"))
    if "position" in stream.numbers:  # of an odometry, its child_frame_id
        fields += [("length_2", "<u4"), ("frame_2", f"S{len(frame)}")]
        if not ros1:
            fields[-3:] = [("pad", f"V{-(12 + len(frame)) % 4}"), *fields[-2:]]
            used = 12 + len(frame) + -(12 + len(frame)) % 4 + 4 + len(frame)
            fields.append(("pad_2", f"V{-used % 8}"))
    fields.append(("numbers", ("<f8", (sum(stream.numbers.values()),))))
    return np.dtype(fields)


def thin_messages(stream: Stream, times: NDArray[np.int64], seed: int, *, ros1: bool) -> list[bytes]:
    """Serialise all messages of a thin channel."""
    layout = _layout(stream, ros1=ros1)
    table = np.zeros(len(times), layout)
    frame = FRAME[:-1] if ros1 else FRAME
    table["sec"], table["nanosec"] = times // 10**9, times % 10**9
    if ros1:
        table["seq"] = np.arange(len(times))
    else:
        table["head"] = b"\x00\x01\x00\x00"
    for suffix in ("", "_2"):
        if f"length{suffix}" in (layout.names or ()):
            table[f"length{suffix}"], table[f"frame{suffix}"] = len(frame), frame
    table["numbers"] = _numbers(stream, len(times), seed)
    raw, size = table.tobytes(), layout.itemsize
    return [raw[start : start + size] for start in range(0, len(raw), size)]


def large_messages(stream: Stream, *, ros1: bool) -> list[bytes]:
    """Serialise a few images or clouds, which are written again and again, stamped with the start."""
    types = TYPES_1 if ros1 else TYPES
    made = types.types
    more = {"seq": 0} if ros1 else {}
    header = made["std_msgs/msg/Header"](
        stamp=made["builtin_interfaces/msg/Time"](sec=START // 10**9, nanosec=0), frame_id="base_link", **more
    )
    random = np.random.default_rng(7)
    found = []
    for _ in range(SPARES):
        if stream.topic == "/camera":
            data = random.integers(0, 256, IMAGE_BYTES, dtype=np.uint8)
            message = made[stream.kind](header=header, format="jpeg", data=data)
        else:
            message = _cloud(made, header, random)
        write = types.serialize_ros1 if ros1 else types.serialize_cdr
        found.append(bytes(write(message, stream.kind)))
    return found


def _cloud(made: dict[str, Callable], header: object, random: np.random.Generator) -> object:  # type: ignore[type-arg]
    field = made["sensor_msgs/msg/PointField"]
    width = CLOUD_BYTES // 16
    points = np.zeros((width, 4), "<f4")
    points[:, :3] = np.round(random.normal(0.0, 20.0, (width, 3)), 2)
    names = ("x", "y", "z", "intensity")
    return made["sensor_msgs/msg/PointCloud2"](
        header=header,
        height=1,
        width=width,
        fields=[field(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate(names)],
        is_bigendian=False,
        point_step=16,
        row_step=16 * width,
        data=points.reshape(-1).view(np.uint8),
        is_dense=True,
    )


def messages(minutes: float, *, ros1: bool = False) -> Iterator[tuple[int, int, bytes]]:
    """Yield (time [ns], number of the stream, message) in the order of time."""

    def one(number: int, stream: Stream) -> Iterator[tuple[int, int, bytes]]:
        count = round(minutes * 60 * stream.rate)
        times = START + np.arange(count) * (10**9 // stream.rate) + 1000 * number
        if stream.numbers:
            made = thin_messages(stream, times, number, ros1=ros1)
        else:
            few = large_messages(stream, ros1=ros1)
            made = [few[k % SPARES] for k in range(count)]
        for time, data in zip(times.tolist(), made, strict=True):
            yield time, number, data

    return heapq.merge(*(one(number, stream) for number, stream in enumerate(STREAMS)))


# --- formats --------------------------------------------------------------------------------------


def write_mcap(path: Path, minutes: float, compression: CompressionType) -> None:
    """Write an MCAP file in chunks, with indexes and summary."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=CHUNK, compression=compression)
        writer.start(profile="ros2", library="bench")
        channels = []
        for stream in STREAMS:
            text, _ = TYPES.generate_msgdef(stream.kind, ros_version=2)
            schema = writer.register_schema(stream.kind, "ros2msg", text.encode())
            channels.append(writer.register_channel(stream.topic, "cdr", schema))
        for time, number, data in messages(minutes):
            writer.add_message(channels[number], time, data, time)
        writer.finish()


_SQLITE = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
    serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
    data BLOB NOT NULL);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
    encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""


def write_sqlite(folder: Path, minutes: float) -> None:
    """Write a rosbag2 folder with the tables of rosbag2's SQLite storage and its metadata.yaml."""
    folder.mkdir()
    counts = [round(minutes * 60 * stream.rate) for stream in STREAMS]
    with closing(sqlite3.connect(folder / "log.db3")) as database:
        database.executescript("PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF;" + _SQLITE)
        topics = [(n + 1, s.topic, s.kind, "cdr", "") for n, s in enumerate(STREAMS)]
        database.executemany("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", topics)
        kinds = dict.fromkeys(stream.kind for stream in STREAMS)
        texts = [(kind, "ros2msg", TYPES.generate_msgdef(kind, ros_version=2)[0], "") for kind in kinds]
        columns = "topic_type, encoding, encoded_message_definition, type_description_hash"
        database.executemany(f"INSERT INTO message_definitions({columns}) VALUES (?, ?, ?, ?)", texts)  # noqa: S608
        rows = ((number + 1, time, data) for time, number, data in messages(minutes))
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
        database.commit()
    topic = (
        "    - topic_metadata: {{name: {0.topic}, type: {0.kind}, serialization_format: cdr, "
        "offered_qos_profiles: ''}}\n      message_count: {1}\n"
    )
    listed = "".join(topic.format(stream, count) for stream, count in zip(STREAMS, counts, strict=True))
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 4\n  storage_identifier: sqlite3\n"
        "  relative_file_paths: [log.db3]\n  compression_format: ''\n  compression_mode: ''\n"
        f"  duration: {{nanoseconds: {round(minutes * 60e9)}}}\n"
        f"  starting_time: {{nanoseconds_since_epoch: {START}}}\n  message_count: {sum(counts)}\n"
        f"  topics_with_message_count:\n{listed}"
    )


def write_ros1(path: Path, minutes: float) -> None:
    """Write a ROS 1 bag in chunks that are not compressed, as rosbag does unless told otherwise."""
    writer = Ros1Writer(path)
    writer.chunk_threshold = CHUNK
    with writer:
        connections = [writer.add_connection(s.topic, s.kind, typestore=TYPES_1) for s in STREAMS]
        for time, number, data in messages(minutes, ros1=True):
            writer.write(connections[number], time, data)


FORMATS: dict[str, tuple[str, Callable[[Path, float], None]]] = {
    "mcap zstd": ("zstd.mcap", lambda path, minutes: write_mcap(path, minutes, CompressionType.ZSTD)),
    "mcap none": ("none.mcap", lambda path, minutes: write_mcap(path, minutes, CompressionType.NONE)),
    "mcap lz4": ("lz4.mcap", lambda path, minutes: write_mcap(path, minutes, CompressionType.LZ4)),
    "sqlite3": ("sqlite3", write_sqlite),
    "ros1": ("ros1.bag", write_ros1),
}


def make(folder: Path, name: str, minutes: float) -> Path:
    """Write one format into ``folder``, unless it is there; return its path."""
    file, write = FORMATS[name]
    path = folder / file
    if not path.exists():
        write(path, minutes)
    return path
