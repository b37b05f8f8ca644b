"""ROS 1 bags (format 2.0): every message that can still be read, and what cannot.

The file is walked once, record by record, so that neither an index nor a proper end is needed. A record is a
header of named fields and its data; chunks hold compressed records (http://wiki.ros.org/Bags/Format/2.0).
Where a record makes no sense, the walk goes on at the next chunk; the index behind a damaged chunk says how
many messages it held. The format has no checksums: a wrong byte inside a value cannot be told.
"""

from __future__ import annotations

import bz2
import mmap
import struct
from array import array
from collections import OrderedDict
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import lz4.frame
import numpy as np

from ident.errors import UnusableLog
from ident.logs.compression import LARGEST_CHUNK, most_bytes
from ident.logs.damage import Loss, summarise
from ident.logs.record import Channel, ChannelByChannel, Stored, Times
from ident.logs.schema import normal
from ident.results import Damage

MAGIC = b"#ROSBAG V2.0\n"
ANY_MAGIC = b"#ROSBAG V"
MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
LARGEST_HEADER = 1 << 26
CACHE_BYTES = 256 << 20
_LENGTH = struct.Struct("<I")
_CHUNK_MARK = b"\x04\x00\x00\x00op=\x05"
_FURTHEST_MARK = 96

Buffer = bytes | mmap.mmap


@dataclass(frozen=True)
class _Record:
    """A record at ``offset``, its header fields, and where its data lie; ``complete``: they are all there."""

    offset: int
    fields: dict[bytes, bytes]
    begin: int
    end: int
    complete: bool

    @property
    def op(self) -> int:
        return self.fields.get(b"op", b"\x00")[0]

    def number(self, name: bytes) -> int:
        """Unsigned number in a header field; ``struct.error`` where it is missing."""
        return int(_LENGTH.unpack(self.fields.get(name, b""))[0])


@dataclass
class _Index:
    """Messages of one connection: log time [ns], chunk number (-1: outside chunks), begin and end."""

    times: array[int] = field(default_factory=lambda: array("q"))
    chunks: array[int] = field(default_factory=lambda: array("q"))
    begins: array[int] = field(default_factory=lambda: array("q"))
    ends: array[int] = field(default_factory=lambda: array("q"))


class Ros1Storage(ChannelByChannel):
    """One ROS 1 bag (see ``ident.logs.record.Storage``)."""

    format = "ros1"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = [path]
        self._chunks: list[tuple[int, int, str, int]] = []
        self._connections: dict[int, Channel] = {}
        self._index: dict[int, _Index] = {}
        self._losses: list[Loss] = []
        self._lost_chunk: Loss | None = None
        self._cache: OrderedDict[int, bytes] = OrderedDict()
        self._read_header = False
        self._closed_properly = False
        with path.open("rb") as file, closing(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)) as data:
            if data[: len(MAGIC)] != MAGIC:
                version = data[len(ANY_MAGIC) : 16].split(b"\n")[0].decode("ascii", "replace")
                raise UnusableLog(f"{path}: ROS 1 bag of version {version}, need 2.0: run 'rosbag fix' on it")
            self._scan(data)
        if not self._connections and not self._read_header:
            raise UnusableLog(
                f"{path}: ROS 1 bag without a record that can be read ({path.stat().st_size} bytes)"
            )
        self._numbers: dict[int, list[int]] = {}
        self.channels = self._merge_connections()
        self.damage = self._damage()

    def times(self, channel: Channel) -> Times:
        """Log times of a channel [ns], connection by connection."""
        parts = [np.asarray(self._index[number].times, dtype=np.int64) for number in self._of(channel)]
        return np.concatenate([np.empty(0, np.int64), *parts])

    def messages(self, channel: Channel) -> Stored:
        """Read the messages of a channel, connection by connection."""
        data: list[bytes | None] = []
        with (
            self.path.open("rb") as file,
            closing(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)) as raw,
        ):
            for number in self._of(channel):
                index = self._index[number]
                for chunk, begin, end in zip(index.chunks, index.begins, index.ends, strict=True):
                    data.append((raw if chunk < 0 else self._chunk_data(raw, chunk))[begin:end])
        return Stored(self.times(channel), data)

    def close(self) -> None:
        """Forget the chunks kept in memory."""
        self._cache.clear()

    # --- opening ----------------------------------------------------------------------------------

    def _scan(self, data: Buffer) -> None:
        position = len(MAGIC)
        while position < len(data):
            record = _record_at(data, position)
            if record is None or (not record.complete and record.op != CHUNK):
                position = self._step_over(data, position, cut=record is not None)
                continue
            if not record.complete and (after := _next_chunk(data, position + 1)) is not None:
                self._losses.append(Loss("bytes that are no records", position, bytes=after - position))
                position = after
                continue
            try:
                self._take(data, record)
            except struct.error:
                size = record.end - record.offset
                self._losses.append(Loss("unreadable record", record.offset, bytes=size))
            position = record.end

    def _step_over(self, data: Buffer, position: int, *, cut: bool) -> int:
        """Pass over what is no record; return where to go on."""
        after = _next_chunk(data, position + 1)
        end = len(data) if after is None else after
        what = "a record cut off at the end" if cut and after is None else "bytes that are no records"
        self._losses.append(Loss(what, position, bytes=end - position))
        return end

    def _take(self, data: Buffer, record: _Record) -> None:
        if record.op == BAG_HEADER:
            if record.fields.get(b"encryptor"):
                raise UnusableLog(f"{self.path}: is encrypted: decrypt it first")
            self._read_header = True
            self._closed_properly = int.from_bytes(record.fields.get(b"index_pos", b""), "little") > 0
        elif record.op == CHUNK:
            self._take_chunk(data, record)
        elif record.op == INDEX and self._lost_chunk is not None:
            self._lost_chunk.messages = (self._lost_chunk.messages or 0) + record.number(b"count")
        else:
            self._take_inner(data, record, -1)

    def _take_inner(self, data: Buffer, record: _Record, chunk: int) -> None:
        if record.op == CONNECTION:
            self._connections.setdefault(record.number(b"conn"), _channel(data, record))
        elif record.op == MESSAGE:
            sec, nanosec = struct.unpack("<II", record.fields.get(b"time", b""))
            index = self._index.setdefault(record.number(b"conn"), _Index())
            index.times.append(sec * 1_000_000_000 + nanosec)
            index.chunks.append(chunk)
            index.begins.append(record.begin)
            index.ends.append(record.end)

    def _take_chunk(self, data: Buffer, record: _Record) -> None:
        self._lost_chunk = None
        compression = record.fields.get(b"compression", b"").decode("ascii", "replace")
        size = record.number(b"size")
        packed = data[record.begin : record.end]
        inner, problem = _unpack(packed, compression, size)
        if not record.complete:
            self._losses.append(Loss("a chunk cut off at the end", record.offset))
        elif problem:
            self._lost_chunk = Loss("damaged chunk", record.offset, bytes=len(packed), detail=problem)
            self._losses.append(self._lost_chunk)
            return
        number = len(self._chunks)
        self._chunks.append((record.begin, record.end, compression, size))
        position = 0
        while position < len(inner):
            found = _record_at(inner, position)
            if found is None or not found.complete:
                if record.complete:
                    text = "records inside a chunk that cannot be read"
                    self._losses.append(Loss(text, record.offset, bytes=len(inner) - position))
                return
            self._take_inner(inner, found, number)
            position = found.end

    def _merge_connections(self) -> list[Channel]:
        """Make one channel of all connections of a topic and type."""
        found: dict[tuple[str, str], Channel] = {}
        for number, connection in sorted(self._connections.items()):
            channel = found.setdefault((connection.topic, connection.type), connection)
            self._numbers.setdefault(id(channel), []).append(number)
        return list(found.values())

    def _damage(self) -> list[Damage]:
        damage = summarise(self.path.name, self._losses)
        orphans = sum(len(i.times) for number, i in self._index.items() if number not in self._connections)
        if orphans:
            text = f"{self.path.name}: messages whose connection is defined in a lost part of the file"
            damage.append(Damage(text, orphans))
        if not self._closed_properly:
            damage.append(Damage(f"{self.path.name}: has no index, the recorder did not close it"))
        return damage

    # --- reading ----------------------------------------------------------------------------------

    def _of(self, channel: Channel) -> list[int]:
        return [number for number in self._numbers.get(id(channel), []) if number in self._index]

    def _chunk_data(self, raw: Buffer, number: int) -> bytes:
        data = self._cache.get(number)
        if data is not None:
            self._cache.move_to_end(number)
            return data
        begin, end, compression, size = self._chunks[number]
        data, _ = _unpack(raw[begin:end], compression, size)
        self._cache[number] = data
        while len(self._cache) > 1 and sum(map(len, self._cache.values())) > CACHE_BYTES:
            self._cache.popitem(last=False)
        return data


# --- records --------------------------------------------------------------------------------------


def _record_at(data: Buffer, position: int) -> _Record | None:
    """Read the header of the record at ``position``, None where there is none."""
    if len(data) - position < 8:
        return None
    (size,) = _LENGTH.unpack_from(data, position)
    begin = position + 4 + size
    if size > LARGEST_HEADER or begin + 4 > len(data):
        return None
    fields = _header(data[position + 4 : begin])
    if fields is None or not MESSAGE <= fields.get(b"op", b"\x00")[0] <= CONNECTION:
        return None
    (length,) = _LENGTH.unpack_from(data, begin)
    end = begin + 4 + length
    return _Record(position, fields, begin + 4, min(end, len(data)), end <= len(data))


def _header(data: bytes) -> dict[bytes, bytes] | None:
    """Split a header into its fields, None where its lengths do not add up."""
    fields: dict[bytes, bytes] = {}
    position = 0
    while position < len(data):
        if len(data) - position < 4:
            return None
        (size,) = _LENGTH.unpack_from(data, position)
        position += 4 + size
        name, equals, value = data[position - size : position].partition(b"=")
        if position > len(data) or not equals or (name == b"op" and len(value) != 1):
            return None
        fields[name] = value
    return fields


def _next_chunk(data: Buffer, position: int) -> int | None:
    """Find the next chunk record at or after ``position``."""
    found = data.find(_CHUNK_MARK, position)
    while found >= 0:
        for start in range(max(found - _FURTHEST_MARK, position), found - 3):
            record = _record_at(data, start)
            if record is not None and record.op == CHUNK and b"compression" in record.fields:
                return start
        found = data.find(_CHUNK_MARK, found + 1)
    return None


def _channel(data: Buffer, record: _Record) -> Channel:
    about = _header(data[record.begin : record.end])
    if about is None or b"type" not in about:
        raise struct.error("a connection without its type")
    text = {name: value.decode("utf-8", "replace") for name, value in about.items()}
    topic = record.fields.get(b"topic", b"").decode("utf-8", "replace") or text.get(b"topic", "")
    return Channel(topic, normal(text[b"type"]), "ros1", text.get(b"message_definition", ""), "ros1msg")


def _unpack(data: bytes, compression: str, size: int) -> tuple[bytes, str]:
    """Unpack a chunk as far as it goes, and say what is wrong with it, nothing where it is whole."""
    if size > min(most_bytes(len(data)), LARGEST_CHUNK):
        return b"", f"claims to hold {size} bytes in {len(data)}"
    try:
        if compression == "bz2":
            raw = bz2.BZ2Decompressor().decompress(data, max_length=size)
        elif compression == "lz4":
            raw = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
        elif compression == "none":
            raw = data
        else:
            return b"", f"compression {compression!r} is not known"
    except (OSError, ValueError, RuntimeError, EOFError, MemoryError) as error:
        return b"", f"does not unpack ({error})"
    return raw, "" if len(raw) == size else f"unpacks to {len(raw)} bytes instead of {size}"
