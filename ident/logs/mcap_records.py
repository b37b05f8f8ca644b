"""The record structure of an MCAP file, walked in a way that survives damage.

A record is an opcode (1 byte), a length (8 bytes) and its content; chunks hold compressed records
(https://mcap.dev/spec). Where a record makes no sense, the walk goes on at the next chunk whose header is
consistent in itself, and says how many bytes it passed over.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 0x03, 0x04, 0x05, 0x06, 0x07
FOOTER, STATISTICS, DATA_END = 0x02, 0x0B, 0x0F
_WANTED = {SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, STATISTICS, FOOTER, DATA_END}
_HEAD = struct.Struct("<BQ")
HEAD_SIZE = _HEAD.size
_CHUNK_HEAD = struct.Struct("<QQQII")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_WINDOW = 1 << 20

# A chunk record with a known compression, or the record that ends the data section.
_LANDMARK = re.compile(
    rb"\x06.{36}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)|\x0f\x04\x00{7}.{4}[\x02-\x0e]", re.DOTALL
)
_LANDMARK_SIZE = 64


@dataclass(frozen=True)
class Record:
    """A record at ``offset``; ``complete`` is False where the file ends inside it."""

    opcode: int
    offset: int
    content: bytes
    complete: bool = True


@dataclass(frozen=True)
class Hole:
    """``bytes`` bytes from ``offset`` on that are no records."""

    offset: int
    bytes: int


@dataclass(frozen=True)
class Chunk:
    """A chunk's header; ``data`` [compressed] begins ``data_offset`` bytes after the record does."""

    start: int
    end: int
    size: int
    crc: int
    compression: str
    data_offset: int
    data: bytes


def walk(file: BinaryIO, size: int) -> Iterator[Record | Hole]:
    """Yield the records of a file of ``size`` bytes, and the holes between them."""
    position = len(MAGIC)
    while size - position >= _HEAD.size:
        file.seek(position)
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        start = position + _HEAD.size
        complete = length <= size - start
        sound = 0 < opcode <= DATA_END or opcode >= 0x80
        content = file.read(min(length, size - start)) if sound and opcode in _WANTED else b""
        if sound and opcode == CHUNK:
            sound = _chunk_is_consistent(content, length)
        if not sound or not complete:
            after = _next_landmark(file, position + 1, size)
            if after is None and sound:
                yield Record(opcode, position, content, complete=False)
                return
            yield Hole(position, (size if after is None else after) - position)
            if after is None:
                return
            position = after
            continue
        yield Record(opcode, position, content)
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
    data_length = struct.unpack_from("<Q", content, chunk.data_offset - _HEAD.size - 8)[0]
    return chunk.data_offset - _HEAD.size + data_length == length and chunk.start <= chunk.end


def _next_landmark(file: BinaryIO, position: int, size: int) -> int | None:
    """Find the next chunk or end of data at or after ``position``."""
    while position < size:
        file.seek(position)
        window = file.read(_WINDOW + _LANDMARK_SIZE)
        for match in _LANDMARK.finditer(window):
            if _is_landmark(file, position + match.start(), size):
                return position + match.start()
        position += _WINDOW
    return None


def _is_landmark(file: BinaryIO, position: int, size: int) -> bool:
    file.seek(position)
    opcode, length = _HEAD.unpack(file.read(_HEAD.size))
    if opcode == DATA_END:
        return True
    head = file.read(_LANDMARK_SIZE)
    return length <= size - position and _chunk_is_consistent(head, length)


def read_chunk(content: bytes) -> Chunk:
    """Read a chunk record; ``struct.error`` where it is too short to have a header."""
    start, end, size, crc, text = _CHUNK_HEAD.unpack_from(content)
    compression = bytes(content[_CHUNK_HEAD.size : _CHUNK_HEAD.size + text]).decode()
    begin = _CHUNK_HEAD.size + text + 8
    struct.unpack_from("<Q", content, begin - 8)
    return Chunk(start, end, size, crc, compression, _HEAD.size + begin, content[begin:])


def inner_records(data: bytes) -> Iterator[tuple[int, int, int]]:
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


def read_message_index(content: bytes) -> int:
    """Return how many messages a message index record lists."""
    (_channel, length) = struct.unpack_from("<HI", content)
    return int(length) // 16


def read_data_crc(content: bytes) -> int:
    """Return the CRC-32 of everything before the record that ends the data section, 0: none was written."""
    return int(struct.unpack_from("<I", content)[0])


def read_statistics(content: bytes) -> int:
    """Return the number of messages that the writer counted."""
    return int(struct.unpack_from("<Q", content)[0])
