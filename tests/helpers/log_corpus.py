"""Seeds of the fuzzing, by name: small files of every format that is read, and definitions of types.

A seed is one or more files of a folder: the first is opened, each may be hit. They are written by the
libraries that others write theirs with, where there is one; each holds few messages, so that a change of a
few bytes has somewhere to go.
"""

from __future__ import annotations

import csv
import io
import json
import shutil
import sqlite3
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import zstandard
from cdr_writer import Writer
from log_files import START, TYPES, angles, imu, new, plain, velocity, write_bag, write_mcap
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from type_trees import EXTENSIBILITIES, Arr, Choice, Field, Num, Rec, Seq, Str, as_idl

IDL = (
    "module truck { @final struct Angle { string<20> frame; double angle; @key octet side; }; "
    "enum Gear { PARK, @value(5) DRIVE }; typedef sequence<float, 4> Few; const long N = 1 << 1; "
    "@appendable struct State : Angle { Gear gear; Few few; long grid[N][2]; @optional short last; }; };"
)
ROS2 = """std_msgs/Header header
uint8 KIND=3
string<=8 name "x"
float64[<=3] few
int32[2] pair [1, 2]
Inner[] many
================================================================================
MSG: truck_msgs/Inner
bool flag
byte octet
"""
ROS1 = """Header header
float64 angle
time at
duration[] lasts
char small
"""
JSON = {"header": {"stamp": {"sec": 1, "nanosec": 5}}, "list": [1, 2.5, True], "q": {"x": 0, "y": 0}}


@dataclass(frozen=True)
class Seed:
    """Files by their names; the first is opened."""

    name: str
    files: dict[str, bytes]


def cdr_angle(frame: str, angle: float, side: int) -> bytes:
    """XCDR1 of truck::Angle: string, double aligned to 8 bytes behind the encapsulation, octet."""
    text = frame.encode() + b"\0"
    body = len(text).to_bytes(4, "little") + text
    body += bytes(-len(body) % 8) + np.float64(angle).tobytes() + bytes([side])
    return b"\x00\x01\x00\x00" + body


def messages() -> list:
    """A few messages of four types: with a header, without, with arrays, with a sequence."""
    found = [*angles(12), *(velocity(START + k * 20_000_000, k) for k in range(4)), imu(START + 1)]
    joints = {"name": ["a", "bc"], "position": np.arange(3.0), "velocity": np.zeros(0), "effort": np.ones(1)}
    header = new(
        "std_msgs/msg/Header", stamp=new("builtin_interfaces/msg/Time", sec=1, nanosec=2), frame_id="x"
    )
    found.append(plain("/joints", "sensor_msgs/msg/JointState", START + 2, header=header, **joints))
    return sorted(found, key=lambda message: message.time)


# --- containers -----------------------------------------------------------------------------------


def mcap_seeds(folder: Path) -> Iterator[Seed]:
    """MCAP of every compression, with and without chunks, summary and checksums, and of other encodings."""
    for kind in CompressionType:
        path = write_mcap(folder / "a.mcap", messages(), compression=kind, chunk_size=400)
        yield Seed(f"{kind.name.lower()}", {"a.mcap": path.read_bytes()})
    whole = path.read_bytes()
    yield Seed("no footer", {"a.mcap": whole[:-37]})
    path = write_mcap(folder / "a.mcap", messages(), chunks=False)
    yield Seed("unchunked", {"a.mcap": path.read_bytes()})
    yield Seed("no checksums", {"a.mcap": _mcap(use_chunking=True)})
    yield Seed("no summary", {"a.mcap": _mcap(use_chunking=False, **NO_SUMMARY)})
    yield Seed("two types", {"a.mcap": _two_types()})


def _two_types() -> bytes:
    """One topic with two types, of one of which there are two definitions."""
    file = io.BytesIO()
    writer = McapWriter(file, chunk_size=300)
    writer.start(profile="ros2")
    kinds = [("a/msg/X", b"float64 x\n"), ("a/msg/X", b"float64 y\nfloat64 x\n"), ("a/msg/Y", b"int32 x\n")]
    channels = [
        writer.register_channel("/t", "cdr", writer.register_schema(kind, "ros2msg", text))
        for kind, text in kinds
    ]
    for k in range(24):
        data = b"\x00\x01\x00\x00" + (struct.pack("<i", k) if k % 3 == 2 else struct.pack("<dd", k, -k))
        writer.add_message(channels[k % 3], START + k, data[:12] if k % 3 == 0 else data, START + k)
    writer.finish()
    return file.getvalue()


NO_SUMMARY = {"use_statistics": False, "use_summary_offsets": False, "repeat_channels": False}


def _mcap(**options) -> bytes:
    """CDR in IDL, ROS 1, JSON and an unknown encoding, without a checksum anywhere."""
    file = io.BytesIO()
    writer = McapWriter(file, compression=CompressionType.NONE, chunk_size=300, enable_crcs=False, **options)
    writer.start()
    idl = writer.register_schema("truck::State", "omgidl", IDL.encode())
    ros1 = writer.register_schema("truck_msgs/Angle", "ros1msg", b"time at\nfloat64 angle\n")
    ros2 = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
    contents = {
        "cdr": (idl, contents_of_state()),
        "ros1": (ros1, struct.pack("<IId", 1, 2, 0.5)),
        "json": (0, json.dumps(JSON).encode()),
        "cdr2": (ros2, b"\x00\x07\x00\x00" + struct.pack("<d", 1.5)),
        "protobuf": (0, b"\x08\x96\x01"),
    }
    channels = {
        name: writer.register_channel(f"/{name}", name.rstrip("2"), schema)
        for name, (schema, _) in contents.items()
    }
    for k in range(4):
        for name, (_, data) in contents.items():
            writer.add_message(channels[name], START + k, data, START + k - 1)
    writer.finish()
    return file.getvalue()


def sqlite_seeds(folder: Path) -> Iterator[Seed]:
    """rosbag2's SQLite: as Iron writes it, with pages of 512 bytes, and with a write-ahead log."""
    path = write_bag(folder / "run", messages(), sqlite=True) / "run.db3"
    yield Seed("rosbag2", {"run.db3": path.read_bytes()})
    yield Seed("small pages", {"run.db3": _rosbag2(folder / "p.db3", "PRAGMA page_size=512")["p.db3"]})
    found = _rosbag2(folder / "run.db3", "PRAGMA journal_mode=WAL")
    yield Seed("write-ahead log", {"run.db3": found["run.db3"], "run.db3-wal": found["run.db3-wal"]})


def _rosbag2(path: Path, pragma: str) -> dict[str, bytes]:
    """Write a bag as Humble does, without definitions; return the files as they lie while it is open."""
    database = sqlite3.connect(path)
    database.execute(pragma)
    database.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
    database.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    database.execute("INSERT INTO topics VALUES (1, '/x', 'std_msgs/msg/Float64', 'cdr')")
    database.execute("INSERT INTO topics VALUES (2, '/imu', 'sensor_msgs/msg/Imu', 'cdr')")
    kind = "std_msgs/msg/Float64"
    rows = [(1, START + k, plain("/x", kind, START + k, data=float(k)).data) for k in range(40)]
    rows += [(2, START + k, imu(START + k).data) for k in range(4)]
    database.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    database.commit()
    found = {each.name: each.read_bytes() for each in path.parent.glob(f"{path.name}*")}
    database.close()
    return found


def ros1_seeds(folder: Path) -> Iterator[Seed]:
    """ROS 1 bags of every compression, and one that was not closed."""
    types = get_typestore(Stores.ROS1_NOETIC)
    kind = "truck_msgs/msg/Angle"
    types.register(get_types_from_msg("Header header\nfloat64 angle\nfloat32[] more\n", kind))
    for compression in ("none", "bz2", "lz4"):
        path = folder / f"{compression}.bag"
        writer = Ros1Writer(path)
        writer.chunk_threshold = 300
        if compression != "none":
            writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
        with writer:
            connections = [writer.add_connection(f"/{name}", kind, typestore=types) for name in "ab"]
            for k in range(16):
                stamp = types.types["builtin_interfaces/msg/Time"](sec=START // 10**9, nanosec=k)
                header = types.types["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="x" * (k % 3))
                more = np.arange(k % 4, dtype=np.float32)
                message = types.types[kind](header=header, angle=float(k), more=more)
                writer.write(connections[k % 2], START + k, types.serialize_ros1(message, kind))
        yield Seed(compression, {"a.bag": path.read_bytes()})
    yield Seed("active", {"a.bag.active": active(path.read_bytes())})


def active(data: bytes) -> bytes:
    """A ROS 1 bag as its recorder leaves it when it is killed: without an index, and told so in its head."""
    place = data.find(b"index_pos=") + len(b"index_pos=")
    (index,) = struct.unpack_from("<Q", data, place)
    return data[:place] + bytes(8) + data[place + 8 : index]


def eprosima_seeds(folder: Path) -> Iterator[Seed]:
    """Recordings of eProsima: types from IDL, from type objects, messages as JSON only."""
    for name, cdr, idl in (("idl", True, True), ("type objects", True, False), ("json", False, False)):
        path = folder / f"{name}.db"
        database = sqlite3.connect(path)
        database.execute("CREATE TABLE Types (name TEXT, information TEXT, object TEXT, is_ros2_type TEXT)")
        database.execute(
            "CREATE TABLE Messages (writer_guid TEXT NOT NULL, sequence_number INTEGER NOT NULL, "
            "data_json TEXT, data_cdr BLOB, data_cdr_size INTEGER, topic TEXT, type TEXT, key TEXT, "
            "log_time DATETIME, publish_time DATETIME, PRIMARY KEY(writer_guid, sequence_number))"
        )
        for row in type_objects():
            database.execute("INSERT INTO Types VALUES (?, ?, ?, 'false')", row)
        when = "2025-10-02 07:24:06.{:09d}"
        database.executemany(
            "INSERT INTO Messages VALUES ('guid', ?, ?, ?, 0, '/angle', 'truck::Angle', '', ?, ?)",
            [
                (
                    k,
                    json.dumps(JSON),
                    cdr_angle("base", k, 1) if cdr else None,
                    when.format(k),
                    when.format(k),
                )
                for k in range(24)
            ],
        )
        database.commit()
        database.close()
        beside = {"types.idl": IDL.encode()} if idl else {}
        yield Seed(name, {"run.db": path.read_bytes(), **beside})


def rti_seeds(folder: Path) -> Iterator[Seed]:
    """Recordings of RTI: samples as JSON, and as CDR with an IDL file beside."""
    for column in ("rti_json_sample", "rti_cdr_sample"):
        path = folder / f"{column}.dat"
        database = sqlite3.connect(path)
        database.execute(
            f'CREATE TABLE "Angle@0" ({column}, SampleInfo_reception_timestamp INTEGER, '
            "SampleInfo_source_timestamp INTEGER, SampleInfo_valid_data INTEGER)"
        )
        json_sample = column == "rti_json_sample"
        sample = json.dumps(JSON) if json_sample else cdr_angle("base", 0.5, 1)
        rows = [(sample, START + k, START + k - 1, 1) for k in range(24)]
        database.executemany('INSERT INTO "Angle@0" VALUES (?, ?, ?, ?)', rows)
        database.commit()
        database.close()
        beside = {} if json_sample else {"types.idl": IDL.encode()}
        yield Seed(column, {"run.dat": path.read_bytes(), **beside})


def _frame() -> pd.DataFrame:
    count = 30
    return pd.DataFrame(
        {
            "time_s": np.arange(count) / 10,
            "angle": np.linspace(-1, 1, count),
            "gear": ["D"] * count,
            "few": [1.0 if k % 7 else None for k in range(count)],
        }
    )


def csv_seeds(_: Path) -> Iterator[Seed]:
    """CSV with commas and numbers, with semicolons and dates, with seconds and nanoseconds apart."""
    yield Seed("seconds", {"a.csv": _frame().to_csv(index=False).encode()})
    rows = [["stamp", "a b", "c"], *([f"2025-10-02T07:24:{k:02d}Z", k, f'"{k}'] for k in range(20))]
    text = io.StringIO()
    csv.writer(text, delimiter=";").writerows(rows)
    yield Seed("dates", {"a.csv": text.getvalue().encode()})
    lines = ["sec,nanosec,x", *(f"{1_700_000_000 + k},{k},{k / 3}" for k in range(20))]
    yield Seed("sec and nanosec", {"a.csv": "\r\n".join([*lines, ""]).encode("utf-8-sig")})


def parquet_seeds(folder: Path) -> Iterator[Seed]:
    """Parquet of several compressions."""
    for compression in ("snappy", "gzip", "zstd", "none"):
        path = folder / "a.parquet"
        _frame().to_parquet(path, compression=None if compression == "none" else compression, index=False)
        yield Seed(compression, {"a.parquet": path.read_bytes()})


def folder_seeds(folder: Path) -> Iterator[Seed]:
    """rosbag2 folders with what their metadata.yaml says, and with compressed files and messages."""
    for name, options in (
        ("mcap", {}),
        ("message compression", {"sqlite": True, "compress": "message"}),
        ("file compression", {"sqlite": True, "compress": "file"}),
    ):
        bag = write_bag(folder / name.split()[0], messages(), **options)
        files = {path.name: path.read_bytes() for path in sorted(bag.iterdir(), reverse=True)}
        first = {"metadata.yaml": files.pop("metadata.yaml")}
        yield Seed(name, {**first, **files})
    packed = zstandard.ZstdCompressor().compress(write_mcap(folder / "a.mcap", messages()).read_bytes())
    yield Seed("zstd alone", {"a.mcap.zstd": packed})


# --- definitions ----------------------------------------------------------------------------------


def type_objects() -> list[tuple[str, str, str]]:
    """Name, identifier and complete type object of truck::Angle, the last two in base64."""
    import base64  # noqa: PLC0415 (used here alone)

    key = bytes(range(14))
    return [
        (
            "truck::Angle",
            base64.b64encode(b"\xf2" + key).decode(),
            base64.b64encode(struct_object("truck::Angle")).decode(),
        )
    ]


def struct_object(name: str) -> bytes:
    """The complete type object of a final struct: string<20> frame; double angle; octet side (XCDR2)."""

    def sized(content: bytes) -> bytes:
        return struct.pack("<I", len(content)) + content

    def text(value: str) -> bytes:
        return sized(value.encode() + b"\0")

    members = b""
    for number, (identifier, called) in enumerate(
        ((b"\x70\x14", "frame"), (b"\x0a", "angle"), (b"\x0d", "side"))
    ):
        head = struct.pack("<IH", number, 1) + identifier
        members += bytes(-len(members) % 4) + sized(head + bytes(-len(head) % 4) + text(called) + b"\0\0")
    header = b"\0\0\0\0" + text(name)
    body = b"\xf2\x51" + struct.pack("<H", 1) + sized(header)
    body += bytes(-len(body) % 4) + sized(struct.pack("<I", 3) + members)
    return sized(body)


def definition_seeds(_: Path) -> Iterator[Seed]:
    """Texts of types, and type objects; the name of the file says which."""
    yield Seed("idl", {"idl": IDL.encode()})
    for kind, (root, _) in wheels().items():
        yield Seed(f"idl, {kind}", {"idl": as_idl(root).encode()})
    yield Seed("ros2msg", {"ros2msg": ROS2.encode()})
    yield Seed("ros1msg", {"ros1msg": ROS1.encode()})
    yield Seed("type object", {"type object": struct_object("truck::Angle")})
    for kind in ("sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry"):
        yield Seed(kind, {"ros2msg": TYPES.generate_msgdef(kind, ros_version=2)[0].encode()})


def cdr_seeds(_: Path) -> Iterator[Seed]:
    """Messages alone; the name of the file is that of their type."""
    for kind, each in {each.kind: each for each in messages()}.items():
        yield Seed(kind, {kind: each.data})
    yield Seed("truck::State", {"truck::State": contents_of_state()})
    for kind, (root, value) in wheels().items():
        for version, order in ((1, "<"), (1, ">"), (2, "<")):
            data = Writer(version, order, short=kind == "final").message(root, value)
            yield Seed(f"{kind}, XCDR{version}{order}", {root.name: data})


def wheels() -> dict[str, tuple[Rec, dict]]:
    """A struct of each extensibility, with optional members, enums and what is nested; and a value of it."""
    found = {}
    for kind in EXTENSIBILITIES:
        inner = Rec("Inner", kind, (Field("a", Num("octet")), Field("b", Num("double"))))
        fields = (
            *(
                Field("gear", Choice(8)),
                Field("name", Str(), optional=True),
                Field("away", Num("long"), True),
            ),
            *(
                Field("many", Seq(inner)),
                Field("enums", Arr(Arr(Choice(32), 2), 2)),
                Field("x", Num("double")),
            ),
        )
        value = {"gear": 2, "name": "left", "away": None, "many": [{"a": 1, "b": 0.5}] * 2}
        found[kind] = (Rec(f"Wheel_{kind}", kind, fields), {**value, "enums": [[1, 2], [3, 0]], "x": 1.5})
    return found


def definition_of(kind: str) -> tuple[str, str]:
    """Format and text of the definition of a type of the messages."""
    if kind.startswith("Wheel_"):
        return "omgidl", as_idl(wheels()[kind.removeprefix("Wheel_")][0])
    if kind.startswith("truck::"):
        return "omgidl", IDL
    return "ros2msg", TYPES.generate_msgdef(kind, ros_version=2)[0]


def contents_of_state() -> bytes:
    """XCDR2 of truck::State of ``IDL``, delimited: its base, enum, sequence, array and an optional member."""
    body = struct.pack("<I5s3xdB3xi", 5, b"base\0", 0.5, 1, 5) + struct.pack("<I2f", 2, 1.0, 2.0)
    body += struct.pack("<4iBxh", 1, 2, 3, 4, 1, 7)
    return b"\x00\x09\x00\x00" + struct.pack("<I", len(body)) + body


def channel_seeds(_: Path) -> Iterator[Seed]:
    """Channel maps."""
    here = Path(__file__).resolve().parents[2]
    yield Seed("sample logs", {"channels.yaml": (here / "sample_logs" / "channels.yaml").read_bytes()})
    for path in sorted((here / "ident" / "signals").rglob("*.yaml"))[:2]:
        yield Seed(path.stem, {"channels.yaml": path.read_bytes()})


SEEDS: dict[str, Callable[[Path], Iterator[Seed]]] = {
    "mcap": mcap_seeds,
    "sqlite": sqlite_seeds,
    "ros1": ros1_seeds,
    "eprosima": eprosima_seeds,
    "rti": rti_seeds,
    "csv": csv_seeds,
    "parquet": parquet_seeds,
    "folder": folder_seeds,
    "definitions": definition_seeds,
    "cdr": cdr_seeds,
    "channels": channel_seeds,
}


def seeds(kind: str, folder: Path) -> list[Seed]:
    """Make the seeds of a format in ``folder``, which is empty again behind it."""
    place = folder / f"seeds_{kind}"
    place.mkdir()
    try:
        return list(SEEDS[kind](place))
    finally:
        shutil.rmtree(place)
