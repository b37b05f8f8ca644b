"""The record structure of a ROS 1 bag: headers of named fields, each with its data, in chunks and outside.

See http://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

import lz4.frame
import numpy as np
from numpy.typing import NDArray

from ident.logs.compression import LARGEST_CHUNK, Buffer, Damaged, most_bytes
from ident.logs.contents import Chunk, Contents, in_file_order, only_between
from ident.logs.damage import Loss
from ident.logs.payloads import equal_slices
from ident.logs.record import Times
from ident.logs.source import Window

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
LARGEST_HEADER = 1 << 26
_LENGTH = struct.Struct("<I")
_CHUNK_MARK = b"\x04\x00\x00\x00op=\x05"
_FURTHEST_MARK = 96
_BLOCK = 1 << 20
_SMALL = 512
NO_RECORDS = "bytes in a chunk that are no records"


class Record(NamedTuple):
    """A record at ``offset``, its header fields, and where its data lie; ``complete``: they are all there."""

    offset: int
    fields: dict[bytes, bytes]
    op: int
    begin: int
    end: int
    complete: bool

    @property
    def time(self) -> int:
        """Time of a message [ns]; ``struct.error`` where it has none."""
        sec, nanosec = struct.unpack("<II", self.fields.get(b"time", b""))
        return int(sec) * 1_000_000_000 + int(nanosec)

    def number(self, name: bytes) -> int:
        """Unsigned number in a header field; ``struct.error`` where it is missing."""
        return int(_LENGTH.unpack(self.fields.get(name, b""))[0])

    def long(self, name: bytes) -> int:
        """Unsigned number of 8 bytes in a header field; ``struct.error`` where it is missing."""
        return int(struct.unpack("<Q", self.fields.get(name, b""))[0])


def record_at(data: Buffer, position: int) -> Record | None:
    """Read the header of the record at ``position``, None where there is none."""
    if len(data) - position < 8:
        return None
    (size,) = _LENGTH.unpack_from(data, position)
    begin = position + 4 + size
    if size > LARGEST_HEADER or begin + 4 > len(data):
        return None
    (length,) = _LENGTH.unpack_from(data, begin)
    return _record(position, bytes(data[position + 4 : begin]), length, len(data))


def record_in(window: Window, position: int) -> Record | None:
    """Read the header of the record at ``position`` of a file, None where there is none."""
    head = window.read(position, _SMALL)
    if len(head) < 8:
        return None
    (size,) = _LENGTH.unpack_from(head)
    if size > min(LARGEST_HEADER, window.size - position - 8):
        return None
    if size + 8 > len(head):
        head = window.read(position, size + 8)
    (length,) = _LENGTH.unpack_from(head, size + 4)
    return _record(position, head[4 : size + 4], length, window.size)


def _record(position: int, head: bytes, length: int, limit: int) -> Record | None:
    fields = header(head) if b"time=" in head else _header_again(head)
    op = 0 if fields is None else fields.get(b"op", b"\x00")[0]
    if fields is None or not MESSAGE <= op <= CONNECTION:
        return None
    begin = position + 8 + len(head)
    end = begin + length
    return Record(position, fields, op, begin, min(end, limit), end <= limit)


def header(data: bytes) -> dict[bytes, bytes] | None:
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


@lru_cache(maxsize=4096)
def _header_again(data: bytes) -> dict[bytes, bytes] | None:
    """Split a header that may come again: those of indexes do, those of messages do not."""
    return header(data)


def next_chunk(window: Window, position: int) -> int | None:
    """Find the next chunk record at or after ``position``."""
    for start in range(position, window.size, _BLOCK):
        data = window.read(start, _BLOCK + _FURTHEST_MARK + len(_CHUNK_MARK))
        found = data.find(_CHUNK_MARK)
        while found >= 0:
            for place in range(max(start + found - _FURTHEST_MARK, position), start + found - 3):
                record = record_in(window, place)
                if record is not None and record.op == CHUNK and b"compression" in record.fields:
                    return place
            found = data.find(_CHUNK_MARK, found + 1)
    return None


def read_index(content: bytes) -> Times:
    """Entries of an index record, (n, 2): time [ns], place in the unpacked chunk."""
    found = np.frombuffer(content, "<u4", len(content) // 12 * 3).reshape(-1, 3).astype(np.int64)
    found[:, 1] += found[:, 0] * 1_000_000_000
    return found[:, 1:]


def read_counts(content: bytes) -> dict[int, int]:
    """Return how many messages of each connection a chunk holds, by the record at the end of the bag."""
    whole = content[: len(content) // 8 * 8]
    return {number: count for number, count in struct.iter_unpack("<II", whole) if count}


# --- inside a chunk -------------------------------------------------------------------------------


def unpack(data: Buffer, chunk: Chunk) -> Buffer:
    """Unpack a chunk; one that is cut off as far as it goes; ``Damaged`` where it is not whole."""
    if chunk.size > min(most_bytes(len(data)), LARGEST_CHUNK):
        raise Damaged(f"claims to hold {chunk.size} bytes in {len(data)}")
    try:
        if chunk.compression == "bz2":
            raw: Buffer = bz2.BZ2Decompressor().decompress(data, max_length=chunk.size)
        elif chunk.compression == "lz4":
            raw = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=chunk.size)
        elif chunk.compression == "none":
            raw = data
        else:
            raise Damaged(f"compression {chunk.compression!r} is not known")
    except (OSError, RuntimeError, EOFError, MemoryError) as error:
        if not chunk.complete:
            return b""
        raise Damaged(f"does not unpack ({error})") from error
    if chunk.complete and len(raw) != chunk.size:
        raise Damaged(f"unpacks to {len(raw)} bytes instead of {chunk.size}")
    return raw


def indexed_contents(data: Buffer, entries: Mapping[int, Times]) -> Contents | None:
    """Find the messages of a chunk by its index; None where that is not the whole truth about it.

    Each entry must be that of a message of its connection and time, and between the messages, sorted by
    place, there may be nothing but other records.
    """
    if not entries:
        return None
    bounds: dict[int, tuple[int, int]] = {}
    begins, sizes = [], []
    first = 0
    for number, listed in entries.items():
        found = _listed(data, number, listed)
        if found is None:
            return None
        begins.append(found[0])
        sizes.append(found[1])
        bounds[number] = (first, first + len(listed))
        first += len(listed)
    listed = np.concatenate(list(entries.values()))
    begin, size = np.concatenate(begins), np.concatenate(sizes)
    others = only_between(data, listed[:, 1], begin + size, _others)
    if others is None or not in_file_order(listed[:, 1], bounds):
        return None
    return Contents(bounds, listed[:, 0], None, listed[:, 1], begin, size, others)


def _listed(data: Buffer, number: int, listed: Times) -> tuple[Times, Times] | None:
    """Begins and sizes of the messages of a connection; None unless all are where the index says.

    All must have the header of the first, but for the time.
    """
    offsets = listed[:, 1]
    record = record_at(data, int(offsets[0])) if offsets.min() >= 0 else None
    if record is None or record.op != MESSAGE or record.fields.get(b"conn") != _LENGTH.pack(number):
        return None
    length = record.begin - record.offset
    if len(record.fields.get(b"time", b"")) != 8 or offsets.max() + length > len(data):
        return None
    heads = equal_slices(data, offsets, length)
    time = heads[0].tobytes().find(b"\x0d\x00\x00\x00time=") + 9
    moments = heads[:, time : time + 8].copy().view("<u4").astype(np.int64)
    sizes = heads[:, -4:].copy().view("<u4")[:, 0].astype(np.int64)
    heads[:, time : time + 8] = 0
    alike = heads[:, :-4] == heads[0, :-4]
    begins = offsets + length
    true = alike.all() and np.array_equal(moments[:, 0] * 1_000_000_000 + moments[:, 1], listed[:, 0])
    return (begins, sizes) if true and (begins + sizes <= len(data)).all() else None


def _others(data: Buffer, start: int, stop: int) -> list[tuple[int, bytes]] | None:
    """Return the records that fill this gap between messages; None where there is anything else."""
    found = []
    while start < stop:
        record = record_at(data, start)
        if record is None or not record.complete or record.op == MESSAGE or record.end > stop:
            return None
        found.append((record.op, bytes(data[start : record.end])))
        start = record.end
    return found


def walked_contents(data: Buffer, chunk: Chunk) -> Contents:
    """Find the messages of a chunk by going from record to record, over what is none by the index."""
    places = [np.empty(0, np.int64), *(each[:, 1] for each in chunk.entries.values())]
    table, rest, position = _alike_messages(data)
    rows: list[tuple[int, int, int, int, int]] = []
    others: list[tuple[int, bytes]] = []
    losses: list[Loss] = []
    for record in chain(rest, _records(data, np.unique(np.concatenate(places)), position)):
        if isinstance(record, Gap):
            if chunk.complete:
                losses.append(Loss(NO_RECORDS, chunk.offset, record.messages or None, bytes=record.bytes))
            continue
        if record.op != MESSAGE:
            others.append((record.op, bytes(data[record.offset : record.end])))
            continue
        try:
            row = (
                record.number(b"conn"),
                record.time,
                record.offset,
                record.begin,
                record.end - record.begin,
            )
        except struct.error:
            size = record.end - record.offset
            losses.append(Loss("unreadable record in a chunk", chunk.offset, bytes=size))
        else:
            rows.append(row)
    table = np.concatenate([table, np.array(rows, dtype=np.int64).reshape(-1, 5)])
    nothing = not len(table) and not chunk.entries
    return replace(_contents(table), others=others, losses=losses, as_indexed=nothing)


def _alike_messages(data: Buffer) -> tuple[Times, list[Record], int]:
    """Read the messages whose headers are alike but for connection and time, all at once.

    Returns
    -------
    table : (n, 5) number, time [ns], place of the record, begin and size of each
    rest : the other records between them
    position : where the records end, or make no sense
    """
    offsets, sizes, position = _chain_of_records(data)
    odd = np.ones(len(offsets), dtype=np.bool_)
    tables = [np.empty((0, 5), np.int64)]
    for size in np.unique(sizes):
        group = np.flatnonzero(sizes == size)
        found = _alike(data, offsets[group], int(size))
        if found is not None:
            tables.append(found[0])
            odd[group[found[1]]] = False
    rest: list[Record] = []
    for offset in offsets[odd].tolist():
        record = record_at(data, offset)
        if record is None:
            position = offset
            break
        rest.append(record)
    table = np.concatenate(tables)
    return table[table[:, 2] < position], rest, position


def _chain_of_records(data: Buffer) -> tuple[Times, Times, int]:
    """Places and sizes of the headers of records that follow one another, as long as they are complete."""
    offsets, sizes = [], []
    position, last = 0, len(data) - 8
    read = _LENGTH.unpack_from
    while position <= last:
        (size,) = read(data, position)
        begin = position + 4 + size
        if size > LARGEST_HEADER or begin > last + 4:
            break
        end = begin + 4 + read(data, begin)[0]
        if end > last + 8:
            break
        offsets.append(position)
        sizes.append(size)
        position = end
    return np.array(offsets, dtype=np.int64), np.array(sizes, dtype=np.int64), position


def _alike(data: Buffer, offsets: Times, size: int) -> tuple[Times, NDArray[np.bool_]] | None:
    """Messages among records with headers of one size, and which they are; None if the first is none."""
    first = record_at(data, int(offsets[0]))
    if first is None or first.op != MESSAGE or first.fields.keys() != {b"op", b"conn", b"time"}:
        return None  # of a header with more in it nobody knows where "conn=" may stand as well
    if len(first.fields[b"conn"]) != 4 or len(first.fields[b"time"]) != 8:
        return None
    heads = equal_slices(data, offsets + 4, size + 4)
    whole = heads[0].tobytes()
    conn, time = whole.find(b"\x09\x00\x00\x00conn=") + 9, whole.find(b"\x0d\x00\x00\x00time=") + 9
    numbers = heads[:, conn : conn + 4].copy().view("<u4")[:, 0].astype(np.int64)
    moments = heads[:, time : time + 8].copy().view("<u4").astype(np.int64)
    lengths = heads[:, size:].copy().view("<u4")[:, 0].astype(np.int64)
    for begin, end in ((conn, conn + 4), (time, time + 8), (size, size + 4)):
        heads[:, begin:end] = 0
    like = (heads == heads[0]).all(axis=1)
    times = moments[:, 0] * 1_000_000_000 + moments[:, 1]
    return np.column_stack([numbers, times, offsets, offsets + size + 8, lengths])[like], like


@dataclass(frozen=True)
class Gap:
    """``bytes`` bytes of a chunk that are no records, in which its index lists ``messages`` messages."""

    bytes: int
    messages: int


def _records(data: Buffer, listed: Times, position: int) -> Iterator[Record | Gap]:
    """Yield the records of a chunk; where there is none, the gap up to the next place that is ``listed``."""
    while position < len(data):
        record = record_at(data, position)
        if record is not None and record.complete:
            yield record
            position = record.end
            continue
        first, behind = np.searchsorted(listed, (position, position + 1)).tolist()
        end = int(listed[behind]) if behind < len(listed) else len(data)
        yield Gap(min(end, len(data)) - position, behind - first)
        position = end


def _contents(table: Times) -> Contents:
    table = table[np.lexsort((table[:, 2], table[:, 0]))]
    numbers, firsts = np.unique(table[:, 0], return_index=True)
    stops = [*firsts[1:].tolist(), len(table)]
    bounds = dict(zip(numbers.tolist(), zip(firsts.tolist(), stops, strict=False), strict=False))
    return Contents(bounds, table[:, 1], None, table[:, 2], table[:, 3], table[:, 4])
