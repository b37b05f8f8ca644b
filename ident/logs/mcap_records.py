"""The record structure of an MCAP file, walked in a way that survives damage.

A record is an opcode (1 byte), a length (8 bytes) and its content; chunks hold compressed records
(https://mcap.dev/spec). Where a record makes no sense, the walk goes on at the next chunk whose header is
consistent in itself, in a file without chunks at the next message that other records follow, and says how
many bytes it passed over. Of chunks and messages only the beginning is read: what they hold is read when it
is needed.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ident.logs.compression import Buffer
from ident.logs.contents import Contents, in_file_order, only_between
from ident.logs.payloads import equal_slices
from ident.logs.record import Times

MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 0x03, 0x04, 0x05, 0x06, 0x07
FOOTER, STATISTICS, DATA_END = 0x02, 0x0B, 0x0F
_WANTED = {SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, STATISTICS, FOOTER, DATA_END}
_HEAD = struct.Struct("<BQ")
HEAD_SIZE = _HEAD.size
_CHUNK_HEAD = struct.Struct("<QQQII")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_WINDOW = 1 << 20
_READ = {CHUNK: 64, MESSAGE: _MESSAGE_HEAD.size}

# A chunk record with a known compression, or the record that ends the data section.
_LANDMARK = re.compile(
    rb"\x06.{36}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)|\x0f\x04\x00{7}.{4}[\x02-\x0e]", re.DOTALL
)
# The same, or a message of less than 4 GiB: for a file without chunks.
_LANDMARK_OR_MESSAGE = re.compile(_LANDMARK.pattern + rb"|\x05.{4}\x00{4}", re.DOTALL)
_LANDMARK_SIZE = 64
_CHAIN = 3
_MESSAGE_RECORD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("time", "<i8"),
        ("sent", "<i8"),
    ]
)


class Readable(Protocol):
    """What can be read at places; fewer bytes where it ends."""

    def read(self, place: int, size: int) -> bytes:
        """Read bytes from ``place`` on."""
        ...


class Record(NamedTuple):
    """A record at ``offset``; ``complete`` is False where the file ends inside it.

    content : of chunks and messages only the beginning
    length : of the content [bytes], as far as the file holds it
    """

    opcode: int
    offset: int
    content: bytes
    length: int
    complete: bool = True


class Hole(NamedTuple):
    """``bytes`` bytes from ``offset`` on that are no records."""

    offset: int
    bytes: int


@dataclass(frozen=True)
class ChunkHead:
    """A chunk's header; its data [compressed] begin ``data_offset`` bytes after the record does."""

    start: int
    end: int
    size: int
    crc: int
    compression: str
    data_offset: int
    data_length: int


@dataclass(frozen=True)
class Statistics:
    """What the writer counted: channels, and the messages of each that has any."""

    channels: int
    messages: dict[int, int]


def walk(file: Readable, size: int) -> Iterator[Record | Hole]:
    """Yield the records of a file of ``size`` bytes, and the holes between them."""
    position, chunked = len(MAGIC), False
    while size - position >= _HEAD.size:
        opcode, length = _HEAD.unpack(file.read(position, _HEAD.size))
        start = position + _HEAD.size
        held = min(length, size - start)
        sound = 0 < opcode <= DATA_END or opcode >= 0x80
        content = file.read(start, min(held, _READ.get(opcode, held))) if sound and opcode in _WANTED else b""
        if sound and opcode == CHUNK:
            sound = _chunk_is_consistent(content, length)
            chunked |= sound
        if not sound or held < length:
            after = _next_landmark(file, position + 1, size, chunked=chunked)
            if after is None and sound:
                yield Record(opcode, position, content, held, complete=False)
                return
            yield Hole(position, (size if after is None else after) - position)
            if after is None:
                return
            position = after
            continue
        yield Record(opcode, position, content, length)
        if opcode == FOOTER:
            return
        position = start + length
    if position < size:
        yield Hole(position, size - position)


def _chunk_is_consistent(content: bytes, length: int) -> bool:
    """Whether the lengths inside a chunk record agree with the length of the record."""
    try:
        chunk = read_chunk(content)
    except (struct.error, UnicodeDecodeError):
        return False
    return chunk.data_offset - _HEAD.size + chunk.data_length == length and chunk.start <= chunk.end


def _next_landmark(file: Readable, position: int, size: int, *, chunked: bool) -> int | None:
    """Find the next chunk or end of data, or message outside chunks, at or after ``position``."""
    landmark = _LANDMARK if chunked else _LANDMARK_OR_MESSAGE
    while position < size:
        window = file.read(position, _WINDOW + _LANDMARK_SIZE)
        for match in landmark.finditer(window):
            if _is_landmark(file, position + match.start(), size):
                return position + match.start()
        position += _WINDOW
    return None


def _is_landmark(file: Readable, position: int, size: int) -> bool:
    opcode, length = _HEAD.unpack(file.read(position, _HEAD.size))
    if opcode == DATA_END:
        return True
    if opcode == MESSAGE:
        return _begins_chain(file, position, size)
    head = file.read(position + _HEAD.size, _LANDMARK_SIZE)
    return length <= size - position and _chunk_is_consistent(head, length)


def _begins_chain(file: Readable, position: int, size: int) -> bool:
    """Whether a message and then records follow one another, up to the end of the data if that is near."""
    for _ in range(_CHAIN):
        head = file.read(position, _HEAD.size)
        if len(head) < _HEAD.size:
            return False
        opcode, length = _HEAD.unpack(head)
        if opcode == DATA_END:
            return bool(length == 4)
        if opcode not in {MESSAGE, SCHEMA, CHANNEL} or (opcode == MESSAGE and length < _MESSAGE_HEAD.size):
            return False
        position += _HEAD.size + length
        if position > size:
            return False
    return True


def read_chunk(content: bytes) -> ChunkHead:
    """Read the beginning of a chunk record; ``struct.error`` where it is too short to have a header."""
    start, end, size, crc, text = _CHUNK_HEAD.unpack_from(content)
    compression = bytes(content[_CHUNK_HEAD.size : _CHUNK_HEAD.size + text]).decode()
    begin = _CHUNK_HEAD.size + text + 8
    (length,) = struct.unpack_from("<Q", content, begin - 8)
    return ChunkHead(start, end, size, crc, compression, _HEAD.size + begin, length)


def read_message_head(data: bytes, begin: int) -> tuple[int, int, int, int]:
    """Return channel number, log and publish time [ns] and the place where the message's data begins."""
    channel, _sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(data, begin)
    return channel, log_time, publish_time, begin + _MESSAGE_HEAD.size


def _text(content: bytes, position: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", content, position)
    end = position + 4 + length
    if end > len(content):
        raise struct.error("text is longer than its record")
    return content[position + 4 : end].decode("utf-8", "replace"), end


def read_schema(content: bytes) -> tuple[int, str, str, str]:
    """Return number, name, encoding and text of a schema record."""
    (number,) = struct.unpack_from("<H", content)
    name, position = _text(content, 2)
    encoding, position = _text(content, position)
    text, _ = _text(content, position)
    return number, name, encoding, text


def read_channel(content: bytes) -> tuple[int, int, str, str]:
    """Return number, schema number, topic and message encoding of a channel record."""
    number, schema = struct.unpack_from("<HH", content)
    topic, position = _text(content, 4)
    encoding, _ = _text(content, position)
    return number, schema, topic, encoding


def read_message_index(content: bytes) -> tuple[int, Times] | None:
    """Return the channel number of a message index record and its entries, (n, 2): time [ns], place."""
    if len(content) < 6:
        return None
    channel, length = struct.unpack_from("<HI", content)
    if length % 16 or length > len(content) - 6:
        return None
    return channel, np.frombuffer(content, "<i8", length // 8, 6).reshape(-1, 2)


def read_data_crc(content: bytes) -> int:
    """Return the CRC-32 of everything before the record that ends the data section, 0: none was written."""
    return int(struct.unpack_from("<I", content)[0])


def read_statistics(content: bytes) -> Statistics:
    """Return what the writer counted."""
    (channels,) = struct.unpack_from("<I", content, 10)
    (length,) = struct.unpack_from("<I", content, 42)
    whole = length // 10 * 10
    pairs = struct.iter_unpack("<HQ", content[46 : 46 + whole][: (len(content) - 46) // 10 * 10])
    return Statistics(channels, {channel: count for channel, count in pairs if count})


# --- inside a chunk -------------------------------------------------------------------------------


def inner_records(data: Buffer) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, begin, end) of the records in a chunk's data, as long as they are complete."""
    position, size = 0, len(data)
    unpack = _HEAD.unpack_from
    while size - position >= 9:
        opcode, length = unpack(data, position)
        position += 9
        if length > size - position:
            return
        yield opcode, position, position + length
        position += length


def indexed_contents(data: Buffer, entries: Mapping[int, Times]) -> Contents | None:
    """Find the messages of a chunk by its index; None where that is not the whole truth about it.

    Each entry must be that of a message of its channel and time, and between the messages, sorted by place,
    there may be nothing but other records.
    """
    if not entries:
        return None
    listed = np.concatenate(list(entries.values()))
    offsets = listed[:, 1]
    last = len(data) - _MESSAGE_RECORD.itemsize
    if not len(offsets) or offsets.min() < 0 or offsets.max() > last:
        return None
    heads = _heads(data, offsets)
    counts = [len(each) for each in entries.values()]
    numbers = np.repeat(np.array(list(entries), dtype=np.uint16), counts)
    lengths = heads["length"].astype(np.int64)
    ends = offsets + HEAD_SIZE + lengths
    true = (heads["opcode"] == MESSAGE) & (heads["channel"] == numbers) & (heads["time"] == listed[:, 0])
    true &= (lengths >= _MESSAGE_HEAD.size) & (ends <= len(data)) & (listed[:, 0] >= 0)
    if not true.all():
        return None
    bounds: dict[int, tuple[int, int]] = {}
    first = 0
    for number, count in zip(entries, counts, strict=True):
        bounds[number] = (first, first + count)
        first += count
    others = only_between(data, offsets, ends, _others)
    if others is None or not in_file_order(offsets, bounds):
        return None
    return _contents(bounds, heads, offsets, others, as_indexed=True)


def _others(data: Buffer, start: int, stop: int) -> list[tuple[int, bytes]] | None:
    """Return the records that fill this gap between messages; None where there is anything else."""
    found = []
    position = start
    for opcode, begin, end in inner_records(data[start:stop]):
        if opcode == MESSAGE:
            return None
        found.append((opcode, bytes(data[start + begin : start + end])))
        position = start + end
    return found if position == stop or stop == len(data) else None


def walked_contents(data: Buffer, entries: Mapping[int, Times]) -> Contents:
    """Find the messages of a chunk by going from record to record, as long as they are complete."""
    found, others = [], []
    for opcode, begin, end in inner_records(data):
        if opcode != MESSAGE:
            others.append((opcode, bytes(data[begin:end])))
        elif end - begin >= _MESSAGE_HEAD.size:
            found.append(begin - HEAD_SIZE)
    offsets = np.array(found, dtype=np.int64)
    heads = _heads(data, offsets)
    possible = heads["time"] >= 0
    order = np.flatnonzero(possible)[np.argsort(heads["channel"][possible], kind="stable")]
    offsets, heads = offsets[order], heads[order]
    numbers, firsts = np.unique(heads["channel"], return_index=True)
    stops = [*firsts[1:].tolist(), len(heads)]
    bounds = dict(zip(numbers.tolist(), zip(firsts.tolist(), stops, strict=False), strict=False))
    return _contents(bounds, heads, offsets, others, as_indexed=not bounds and not entries)


def _heads(data: Buffer, offsets: Times) -> NDArray[np.void]:
    raw = equal_slices(data, offsets, _MESSAGE_RECORD.itemsize)
    return raw.view(_MESSAGE_RECORD)[:, 0] if len(offsets) else np.empty(0, _MESSAGE_RECORD)


def _contents(
    bounds: Mapping[int, tuple[int, int]],
    heads: NDArray[np.void],
    offsets: Times,
    others: Sequence[tuple[int, bytes]],
    *,
    as_indexed: bool,
) -> Contents:
    return Contents(
        bounds,
        heads["time"],
        np.maximum(heads["sent"], 0),
        offsets,
        offsets + _MESSAGE_RECORD.itemsize,
        heads["length"].astype(np.int64) - _MESSAGE_HEAD.size,
        others,
        as_indexed,
    )
