"""Small files that would take gigabytes, or hours, if what they say of themselves were believed."""

from __future__ import annotations

import bz2
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import zstandard
from log_corpus import Seed

HUGE, LESS = 300 << 20, 100 << 20
ZEROS = bytes(1 << 20)
MCAP = b"\x89MCAP0\r\n"


def zstd_zeros(*, told: bool, head: bytes = b"") -> bytes:
    """``HUGE`` bytes, ``head`` and zeros, as zstd; ``told``: the frame says how many."""
    packer = zstandard.ZstdCompressor().compressobj(size=HUGE if told else -1)
    first = head + ZEROS[len(head) :]
    parts = [packer.compress(first), *(packer.compress(ZEROS) for _ in range((HUGE >> 20) - 1))]
    return b"".join([*parts, packer.flush()])


def _record(opcode: int, content: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(content) if length is None else length) + content


def _chunk(packed: bytes, size: int, kind: bytes = b"zstd", length: int | None = None) -> bytes:
    head = struct.pack("<QQQII", 1, 2, size, 0, len(kind)) + kind
    return _record(6, head + struct.pack("<Q", len(packed)) + packed, length)


def _message_head() -> bytes:
    return struct.pack("<BQHIQQ", 5, HUGE - 9, 1, 0, 1, 1)


def mcap(*chunks: bytes) -> Seed:
    """An MCAP file of these chunks."""
    return Seed("", {"a.mcap": MCAP + b"".join(chunks)})


def _ros1(compression: bytes, packed: bytes, size: int) -> Seed:
    def record(fields: dict[bytes, bytes], data: bytes) -> bytes:
        head = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in fields.items())
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data

    head = record({b"op": b"\x03", b"index_pos": bytes(8)}, b"")
    chunk = record({b"op": b"\x05", b"compression": compression, b"size": struct.pack("<I", size)}, packed)
    return Seed("", {"a.bag": b"#ROSBAG V2.0\n" + head + chunk})


def bz2_zeros() -> bytes:
    """``LESS`` zeros as bz2, which takes its time."""
    packer = bz2.BZ2Compressor()
    return b"".join([*(packer.compress(ZEROS) for _ in range(LESS >> 20)), packer.flush()])


def _sqlite(folder: Path, *statements: str, row: bytes | None = None) -> Seed:
    path = folder / "bomb.db3"
    path.unlink(missing_ok=True)
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
    database.execute("INSERT INTO topics VALUES (1, '/x', 'std_msgs/msg/Float64', 'cdr')")
    for statement in statements:
        database.execute(statement)
    if row is not None:
        database.execute("INSERT INTO messages VALUES (1, 1, 1, ?)", (row,))
    database.commit()
    database.close()
    return Seed("", {"a.db3": path.read_bytes()})


def _parquet(folder: Path) -> Seed:
    rows = 1 << 20
    table = pa.table({"t": np.arange(rows) // 1000 / 100, "a": np.zeros(rows), "b": np.zeros(rows)})
    with pq.ParquetWriter(folder / "a.parquet", table.schema, compression="zstd") as writer:
        for _ in range(HUGE // rows // 24):
            writer.write_table(table)
    return Seed("", {"a.parquet": (folder / "a.parquet").read_bytes()})


def laughs_idl(levels: int = 11) -> str:
    """Structs that each hold sixteen of the one before."""
    structs = ["struct L0 { double x[16]; };"]
    structs += [f"struct L{k} {{ L{k - 1} a[16]; }};" for k in range(1, levels)]
    return " ".join([*structs, f"module truck {{ struct State {{ L{levels - 1} a; }}; }};"])


def laughs_ros1(levels: int = 60, base: str = "") -> str:
    """Types that each hold the one before twice; the first holds nothing."""
    types = [f"MSG: m/L{k}\nL{k - 1} a\nL{k - 1} b\n" for k in range(1, levels)]
    return ("=" * 80 + "\n").join([f"m/L{levels - 1} a\n", *types, f"MSG: m/L0\n{base}\n"])


def _mcap_of_empties() -> Seed:
    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    schema = struct.pack("<H", 1) + text("m/S") + text("ros1msg") + text(laughs_ros1())
    channel = struct.pack("<HH", 1, 1) + text("/x") + text("ros1") + struct.pack("<I", 0)
    message = struct.pack("<HIQQ", 1, 0, 1, 1)
    records = _record(3, schema) + _record(4, channel) + _record(5, message)
    return Seed("", {"a.mcap": MCAP + records})


MESSAGES = "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)"
COUNTING = "AS WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) SELECT"
ENDLESS_MESSAGES = f"CREATE VIEW messages {COUNTING} n AS id, 1 AS topic_id, 1 AS timestamp, 1 AS data FROM c"
ENDLESS_TOPICS = (
    f"CREATE VIEW topics {COUNTING} n AS id, n AS name, 1 AS type, 1 AS serialization_format FROM c"
)

# name -> (format of the fuzzing, its files)
BOMBS: dict[str, tuple[str, Callable[[Path], Seed]]] = {
    "zeros in a chunk": ("mcap", lambda _: mcap(_chunk(zstd_zeros(told=True, head=_message_head()), HUGE))),
    "zeros in a chunk, not told": ("mcap", lambda _: mcap(_chunk(zstd_zeros(told=False), HUGE))),
    "zeros in a chunk cut off": (
        "mcap",
        lambda _: mcap(_chunk(zstd_zeros(told=False, head=_message_head()), HUGE, length=1 << 30)),
    ),
    "a chunk that claims much": ("mcap", lambda _: mcap(_chunk(b"\x28\xb5\x2f\xfd" + bytes(60), 1 << 31))),
    "a chunk of lz4 that claims much": ("mcap", lambda _: mcap(_chunk(bytes(60), (1 << 31) - 1, b"lz4"))),
    "a record longer than the file": ("mcap", lambda _: mcap(_record(5, bytes(64), 1 << 62))),
    "types of nothing, doubled 60 times": ("mcap", lambda _: _mcap_of_empties()),
    "zeros in a file": ("folder", lambda _: Seed("", {"a.mcap.zstd": zstd_zeros(told=True, head=MCAP)})),
    "zeros in a message": ("sqlite", lambda f: _sqlite(f, MESSAGES, row=zstd_zeros(told=True))),
    "a view without end": ("sqlite", lambda f: _sqlite(f, ENDLESS_MESSAGES)),
    "topics without end": ("sqlite", lambda f: _sqlite(f, MESSAGES, "DROP TABLE topics", ENDLESS_TOPICS)),
    "data that are computed": (
        "sqlite",
        lambda f: _sqlite(
            f,
            MESSAGES.replace("data", f"data AS (zeroblob({HUGE}))"),
            "INSERT INTO messages VALUES (1, 1, 1)",
        ),
    ),
    "zeros in bz2": ("ros1", lambda _: _ros1(b"bz2", bz2_zeros(), LESS)),
    "lz4 that claims much": ("ros1", lambda _: _ros1(b"lz4", bytes(60), (1 << 31) - 1)),
    "rows of zeros": ("parquet", _parquet),
    "sixteen to the twelfth numbers, IDL": (
        "definitions",
        lambda _: Seed("", {"idl": laughs_idl().encode()}),
    ),
    "two to the sixtieth numbers, ROS 1": (
        "definitions",
        lambda _: Seed("", {"ros1msg": laughs_ros1(base="float64 x").encode()}),
    ),
    "two to the tenth numbers, ROS 2": (
        "definitions",
        lambda _: Seed("", {"ros2msg": laughs_ros1(11, base="float64[1000000] x").encode()}),
    ),
    "a sequence of 2^32 elements": (
        "cdr",
        lambda _: Seed("", {"sensor_msgs/msg/JointState": b"\x00\x01\x00\x00" + bytes(16) + b"\xff" * 8}),
    ),
    "a table of very many columns": (
        "csv",
        lambda _: Seed("", {"a.csv": b"t," + b"a," * 500_000 + b"\n1\n2\n"}),
    ),
}  # fmt: skip
