"""One recording in every format, damaged in every way; and what of it is still there, by its bytes alone.

Whether a message can be saved is told without a reader: its payload, which is unlike any other, is looked
for in what is left of the file, where that is compressed in what its chunks unpack to. A chunk that was hit
counts as lost where the format has a checksum, or compression, to tell. Of a Parquet file without its end,
which alone says where what lies, nothing can be saved.
"""

from __future__ import annotations

import bz2
import io
import os
import struct
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from damaged_tables import BESIDE, HELD, NAMES, WRITERS, csv_line, mdf_record, parquet_rows_left
from log_corpus import active
from log_files import ANGLE, START, TYPES, angles, message, nanoseconds, velocity, write_bag, write_mcap
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

COUNT = 1200
NAME = {"mcap": "run.mcap", "sqlite": "run.db3", "ros1": "run.bag", **NAMES}
IN_PAGES = {"sqlite", "eprosima", "rti"}
PAGE = 4096
Messages = Sequence
Span = tuple[int, int]

_ROS1_TYPES = get_typestore(Stores.ROS1_NOETIC)
_ROS1_TYPES.register(get_types_from_msg("Header header\nfloat64 angle\n", ANGLE))


def recording() -> list:
    """Angles at 100 Hz, speeds at 20 Hz, in the order of their times; every payload is unlike all others."""
    speeds = [velocity(nanoseconds(k / 20), 10 + k / 7) for k in range(COUNT // 6)]
    return sorted(angles(COUNT - len(speeds)) + speeds, key=lambda each: each.time)


# --- formats --------------------------------------------------------------------------------------


def _mcap(compression: CompressionType, *, chunks: bool = True) -> Callable[[Path, Messages], None]:
    def write(path: Path, messages: Messages) -> None:
        write_mcap(path, messages, compression=compression, chunks=chunks, chunk_size=4096)

    return write


def _sqlite(path: Path, messages: Messages) -> None:
    folder = path.parent / "written"
    write_bag(folder, messages, sqlite=True)
    (folder / "written.db3").rename(path)
    (folder / "metadata.yaml").unlink()
    folder.rmdir()


def _ros1(compression: str) -> Callable[[Path, Messages], None]:
    def write(path: Path, messages: Messages) -> None:
        writer = Ros1Writer(path)
        writer.chunk_threshold = 4096
        if compression != "none":
            writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
        with writer:
            connections = {}
            for each in messages:
                if (each.topic, each.kind) not in connections:
                    connection = writer.add_connection(each.topic, each.kind, typestore=_ROS1_TYPES)
                    connections[each.topic, each.kind] = connection
                writer.write(connections[each.topic, each.kind], each.time, ros1_payload(each))

    return write


def ros1_payload(each) -> bytes:
    """The same message as ROS 1 writes it."""
    return bytes(TYPES.cdr_to_ros1(each.data, each.kind))


FORMATS: dict[str, Callable[[Path, Messages], None]] = {
    "mcap zstd": _mcap(CompressionType.ZSTD),
    "mcap lz4": _mcap(CompressionType.LZ4),
    "mcap none": _mcap(CompressionType.NONE),
    "mcap unchunked": _mcap(CompressionType.NONE, chunks=False),
    "sqlite": _sqlite,
    "ros1 none": _ros1("none"),
    "ros1 bz2": _ros1("bz2"),
    "ros1 lz4": _ros1("lz4"),
    **WRITERS,
}


def file_name(kind: str) -> str:
    """Name of the file of a format."""
    return NAME[kind.split(maxsplit=1)[0]]


# --- where things lie -----------------------------------------------------------------------------


def records(kind: str, data: bytes) -> list[tuple[int, Span, str, Span]]:
    """Records of a sound file: op, whole span, compression (of chunks), span of what is compressed."""
    return _mcap_records(data) if kind.startswith("mcap") else _ros1_records(data)


def _mcap_records(data: bytes) -> list[tuple[int, Span, str, Span]]:
    found, at = [], 8
    while at < len(data) - 8:
        op, size = struct.unpack_from("<BQ", data, at)
        end, inner, compression = at + 9 + size, (0, 0), ""
        if op == 6:
            (length,) = struct.unpack_from("<I", data, at + 9 + 28)
            compression = data[at + 41 : at + 41 + length].decode()
            inner = (at + 41 + length + 8, end)
        found.append((op, (at, end), compression, inner))
        at = end
    return found


def _ros1_records(data: bytes) -> list[tuple[int, Span, str, Span]]:
    found, at = [], 13
    while at < len(data):
        (head,) = struct.unpack_from("<I", data, at)
        fields = data[at + 4 : at + 4 + head]
        (size,) = struct.unpack_from("<I", data, at + 4 + head)
        begin = at + 8 + head
        op = fields[fields.find(b"op=") + 3]
        place = fields.find(b"compression=") + 12
        compression = (
            next(c for c in ("none", "bz2", "lz4") if fields.startswith(c.encode(), place)) if op == 5 else ""
        )
        found.append((op, (at, begin + size), compression, (begin, begin + size)))
        at = begin + size
    return found


def chunk_spans(kind: str, data: bytes) -> list[tuple[Span, str, Span]]:
    """Chunks of a sound file."""
    if not kind.startswith(("mcap", "ros1")):
        return []
    op = 6 if kind.startswith("mcap") else 5
    return [
        (span, compression, inner) for each, span, compression, inner in records(kind, data) if each == op
    ]


def unpacked(data: bytes, compression: str) -> bytes:
    """What compressed data unpack to, as far as they go."""
    if compression == "zstd":
        reader, parts = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)), []
        while part := reader.read(1 << 16):
            parts.append(part)
        return b"".join(parts)
    if compression == "lz4":
        return lz4.frame.LZ4FrameDecompressor().decompress(data) if len(data) > 19 else b""
    if compression == "bz2":
        return bz2.BZ2Decompressor().decompress(data)
    return data


def left_of(kind: str, whole: bytes, cut: int, hit: Span | None = None) -> bytes:
    """All bytes that may hold messages of a file cut off at ``cut``, without the part that was ``hit``."""
    if kind in IN_PAGES:
        pages = range(0, cut // PAGE * PAGE, PAGE)
        return b"".join(whole[p : p + PAGE] for p in pages if hit is None or not p <= hit[0] < p + PAGE)
    if kind.startswith("parquet"):
        return b""
    spans = chunk_spans(kind, whole)
    if not spans:
        return whole[:cut] if hit is None else whole[: hit[0]] + whole[hit[1] : cut]
    kept = [
        unpacked(whole[inner[0] : min(inner[1], cut)], compression)
        for span, compression, inner in spans
        if inner[0] < cut and (hit is None or not span[0] <= hit[0] < span[1])
    ]
    return b"".join(kept)


def saved(kind: str, messages: Messages, left: bytes) -> int:
    """How many messages are whole in the bytes that are left."""
    return sum(payload(kind, each) in left for each in messages)


def payload(kind: str, each) -> bytes:
    """The bytes of a message in a file of this format."""
    if kind.startswith("ros1"):
        return ros1_payload(each)
    if kind == "csv":
        return csv_line(each)
    return mdf_record(each) if kind == "mdf" else each.data


# --- damage ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """A damaged file: its bytes, what was recorded, and how many messages of that can be saved."""

    data: bytes
    messages: Messages
    can_be_saved: int
    name: str = ""


def _cut(part: float) -> Callable[[str, bytes, Messages], Case]:
    def make(kind: str, whole: bytes, messages: Messages) -> Case:
        cut = int(part * len(whole))
        return Case(whole[:cut], messages, saved(kind, messages, left_of(kind, whole, cut)))

    return make


def _no_footer(kind: str, whole: bytes, messages: Messages) -> Case | None:
    if not kind.startswith("mcap"):
        return None
    return Case(whole[:-37], messages, len(messages))


def _no_index(kind: str, whole: bytes, messages: Messages) -> Case | None:
    if kind.startswith("ros1"):
        return Case(active(whole), messages, len(messages))
    if not kind.startswith("mcap"):
        return None
    (end,) = [span[0] for op, span, *_ in records(kind, whole) if op == 0x0F]
    return Case(whole[:end], messages, len(messages))


def _active(kind: str, whole: bytes, messages: Messages) -> Case | None:
    """The recorder was killed in the middle of a chunk."""
    if not kind.startswith("ros1"):
        return None
    spans = chunk_spans(kind, whole)
    cut = (spans[-1][2][0] + spans[-1][2][1]) // 2
    can = saved(kind, messages, left_of(kind, whole, cut))
    return Case(active(whole)[:cut], messages, can, "run.bag.active")


def _hit(kind: str, whole: bytes, messages: Messages) -> Case:
    """Forty bytes in the middle of the file are lost: of a chunk, a record, or a page."""
    if kind.startswith("parquet"):
        return _hit_parquet(kind, whole, messages)
    place = _place_to_hit(kind, whole, messages)
    hit = (place, place + 40)
    if kind in IN_PAGES:  # the page says nothing of it: its head is hit instead
        hit = (place // PAGE * PAGE, place // PAGE * PAGE + 40)
    data = whole[: hit[0]] + b"\xff" * 40 + whole[hit[1] :]
    checked = kind not in {"ros1 none", "mcap unchunked", "csv", "mdf"}
    left = left_of(kind, whole, len(whole), hit) if checked else data
    return Case(data, messages, saved(kind, messages, left))


def _place_to_hit(kind: str, whole: bytes, messages: Messages) -> int:
    """From the head of a record into its payload, or the middle of a chunk."""
    middle = whole.find(payload(kind, messages[len(messages) // 2]))
    if kind in {"csv", "mdf"}:
        return middle
    if kind in {"mcap unchunked", "ros1 none"} | IN_PAGES:
        return middle - 31
    spans = [inner for _, _, inner in chunk_spans(kind, whole)]
    return sum(spans[len(spans) // 2]) // 2


def _hit_parquet(kind: str, whole: bytes, messages: Messages) -> Case:
    place = len(whole) // 3
    hit = (place, place + 40)
    left = parquet_rows_left(Path(tempfile.gettempdir()) / f"{os.getpid()}.parquet", whole, hit)
    return Case(whole[:place] + b"\xff" * 40 + whole[place + 40 :], messages, len(left))


def _bad_frame(kind: str, whole: bytes, messages: Messages) -> Case | None:
    """The head of the compressed data of one chunk is wrong."""
    if kind.rsplit(maxsplit=1)[-1] not in {"zstd", "lz4", "bz2"}:
        return None
    spans = chunk_spans(kind, whole)
    span, _, (begin, _) = spans[len(spans) // 3]
    data = whole[:begin] + bytes(8) + whole[begin + 8 :]
    return Case(data, messages, saved(kind, messages, left_of(kind, whole, len(whole), (span[0], begin))))


def _empty(kind: str, whole: bytes, messages: Messages) -> Case:
    return Case(b"", messages, 0)


DAMAGES: dict[str, Callable[[str, bytes, Messages], Case | None]] = {
    "cut off at 25 %": _cut(0.25),
    "cut off at 50 %": _cut(0.5),
    "cut off at 75 %": _cut(0.75),
    "footer missing": _no_footer,
    "index missing": _no_index,
    "`.active`, killed in a chunk": _active,
    "40 bytes lost in the middle": _hit,
    "a chunk's compression broken": _bad_frame,
    "zero length": _empty,
}


# --- odd recordings: whole files ------------------------------------------------------------------


def _out_of_order(messages: Messages) -> Messages:
    return [*messages[50:100], *messages[:50], *messages[100:][::-1]]


def _time_jumps(messages: Messages) -> Messages:
    """The recorder's clock falls back 5 s in the middle, and stands still for 20 messages."""
    middle = len(messages) // 2
    back = [replace(m, time=m.time - 5 * 10**9) for m in messages[middle:]]
    return [
        *messages[: middle - 20],
        *(replace(m, time=messages[middle].time) for m in messages[middle - 20 : middle]),
        *back,
    ]


def _stamps_zero(messages: Messages) -> Messages:
    return [
        message(m.topic, ANGLE, 0, time=m.time, angle=k) for k, m in enumerate(messages) if m.kind == ANGLE
    ]


def _not_numbers(messages: Messages) -> Messages:
    odd = [np.nan, np.inf, -np.inf]
    changed = [
        message(m.topic, ANGLE, m.time, angle=odd[k % 3]) for k, m in enumerate(messages) if m.kind == ANGLE
    ]
    return [*changed, *(m for m in messages if m.kind != ANGLE)]


def _two_types(messages: Messages) -> Messages:
    """The topic of the angles becomes one of speeds for the last tenth."""
    first = [m for m in messages if m.kind == ANGLE]
    end = first[-1].time
    return [
        *first,
        *(velocity(end + (k + 1) * 10**7, k, topic=first[0].topic) for k in range(len(first) // 9)),
    ]


def _two_clocks(messages: Messages) -> Messages:
    """The sender's clock is 100 s behind that of the recorder, and 50 ppm slow."""
    late = [(m, int((m.time - START) * 0.99995)) for m in messages if m.kind == ANGLE]
    return [message(m.topic, ANGLE, START - 100 * 10**9 + t, time=m.time, angle=t / 1e9) for m, t in late]


STAMPED = {"stamps of zero", "two clocks"}
TWO_TYPES = "one topic with two types"
ODD: dict[str, Callable[[Messages], Messages]] = {
    "messages out of order": _out_of_order,
    "time jumps back and repeats": _time_jumps,
    "stamps of zero": _stamps_zero,
    "NaN and infinity": _not_numbers,
    TWO_TYPES: _two_types,
    "two clocks": _two_clocks,
}


def cases(kind: str, folder: Path) -> dict[str, Case]:
    """All damaged files of a format."""
    held = HELD.get(kind, list)
    messages = held(recording())
    path = folder / file_name(kind)
    found: dict[str, Case] = {}
    FORMATS[kind](path, messages)
    whole = path.read_bytes()
    path.unlink()
    for name, damage in DAMAGES.items():
        case = damage(kind, whole, messages)
        if case is not None:
            found[name] = case
    for name, change in ODD.items():
        if kind in HELD and (name == TWO_TYPES or (name in STAMPED and kind != "rti")):
            continue  # it has no such thing
        changed = held(list(change(recording())))
        FORMATS[kind](path, changed)
        found[name] = Case(path.read_bytes(), changed, len(changed))
        path.unlink()
    return found


def beside(kind: str) -> dict[str, bytes]:
    """Files without which a recording of this format cannot be decoded."""
    return BESIDE.get(kind, {})


def truth(messages: Messages) -> dict[tuple[str, int, str], int]:
    """(topic, log time, value) of every message, and how often it was recorded."""
    counts: dict[tuple[str, int, str], int] = {}
    for each in messages:
        decoded = TYPES.deserialize_cdr(each.data, each.kind)
        value = decoded.angle if each.kind == ANGLE else decoded.twist.linear.x
        key = (each.topic, each.time, repr(float(value)))
        counts[key] = counts.get(key, 0) + 1
    return counts
