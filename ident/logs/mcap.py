"""MCAP files: every message that can still be read, and what cannot.

The file is walked once when it is opened: chunks are unpacked and checked (CRC), the place of each message
is kept, and what is damaged is counted. A file without footer or summary, cut off, or with damaged chunks
loses only what is damaged; of a chunk that is cut off, the beginning is read.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ident.errors import UnusableLog
from ident.logs import mcap_records as records
from ident.logs.compression import Damaged, decompress_chunk, salvage
from ident.logs.damage import Loss, summarise
from ident.logs.record import Channel, Stored, Times
from ident.results import Damage

CACHE_BYTES = 256 << 20
_BLOCK = 1 << 20


@dataclass(frozen=True)
class _Place:
    """Where a chunk's data lie in the file."""

    offset: int
    length: int
    size: int
    compression: str
    complete: bool


@dataclass
class _Index:
    """Messages of one channel: log and publish time [ns], chunk (-1: outside chunks), begin and end."""

    times: array[int] = field(default_factory=lambda: array("q"))
    published: array[int] = field(default_factory=lambda: array("q"))
    chunks: array[int] = field(default_factory=lambda: array("q"))
    begins: array[int] = field(default_factory=lambda: array("q"))
    ends: array[int] = field(default_factory=lambda: array("q"))

    def add(self, time: int, published: int, chunk: int, begin: int, end: int) -> None:
        if time < 1 << 63:
            self.times.append(time)
            self.published.append(published if published < 1 << 63 else 0)
            self.chunks.append(chunk)
            self.begins.append(begin)
            self.ends.append(end)


class McapStorage:
    """One MCAP file (see ``ident.logs.record.Storage``).

    counted : messages that the writer counted in the summary, None where there is none
    """

    format = "mcap"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = [path]
        self.damage: list[Damage] = []
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._heads: dict[int, tuple[int, str, str]] = {}
        self._index: dict[int, _Index] = {}
        self._chunks: list[_Place] = []
        self._cache: OrderedDict[int, bytes] = OrderedDict()
        self._losses: list[Loss] = []
        self._lost_chunk: Loss | None = None
        self.counted: int | None = None
        self._closed_properly = False
        self._data_end = (0, 0)
        self._scan()
        self._numbers: dict[int, list[int]] = {}
        self.channels = self._resolve_channels()
        self._report_damage()

    def times(self, channel: Channel) -> Times:
        """Log times of a channel [ns], in the order of the file."""
        return _joined([self._index[number].times for number in self._of(channel)])

    def messages(self, channel: Channel) -> Stored:
        """Read the messages of a channel, in the order of the file."""
        data: list[bytes | None] = []
        with self.path.open("rb") as file:
            for number in self._of(channel):
                index = self._index[number]
                for chunk, begin, end in zip(index.chunks, index.begins, index.ends, strict=True):
                    data.append(self._read(file, chunk, begin, end))
        times = self.times(channel)
        published = _joined([self._index[number].published for number in self._of(channel)])
        # Where the sender's time is not known, the writer puts the log time (https://mcap.dev/spec).
        return Stored(times, data, None if np.array_equal(published, times) else published)

    def close(self) -> None:
        """Forget the chunks kept in memory."""
        self._cache.clear()

    # --- opening ----------------------------------------------------------------------------------

    def _scan(self) -> None:
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            if file.read(len(records.MAGIC)) != records.MAGIC:
                raise UnusableLog(f"{self.path}: not an MCAP file (its first bytes are not those of one)")
            for record in records.walk(file, size):
                self._take(record)
            self._check_data_crc(file)

    def _check_data_crc(self, file: BinaryIO) -> None:
        """Find damage that shows nowhere else: in messages outside chunks, in chunks without a CRC."""
        end, expected = self._data_end
        if not expected or self._losses:
            return
        file.seek(0)
        crc = 0
        for start in range(0, end, _BLOCK):
            crc = zlib.crc32(file.read(min(_BLOCK, end - start)), crc)
        if crc != expected:
            text = "the CRC of the data does not match: bytes are wrong that cannot be told from right ones"
            self.damage.append(Damage(f"{self.path.name}: {text}"))

    def _take(self, record: records.Record | records.Hole) -> None:
        if isinstance(record, records.Hole):
            self._losses.append(Loss("bytes that are no records", record.offset, bytes=record.bytes))
            return
        try:
            if record.opcode == records.CHUNK:
                self._take_chunk(record)
            elif not record.complete:
                size = len(record.content)
                self._losses.append(Loss("a record cut off at the end", record.offset, bytes=size))
            else:
                self._take_record(record)
        except struct.error:
            self._losses.append(Loss("unreadable record", record.offset, bytes=len(record.content)))

    def _take_record(self, record: records.Record) -> None:
        if record.opcode == records.MESSAGE:
            channel, time, published, begin = records.read_message_head(record.content, 0)
            start = record.offset + records.HEAD_SIZE
            index = self._index_of(channel)
            index.add(time, published, -1, start + begin, start + len(record.content))
        elif record.opcode == records.MESSAGE_INDEX and self._lost_chunk is not None:
            lost = records.read_message_index(record.content)
            self._lost_chunk.messages = (self._lost_chunk.messages or 0) + lost
        elif record.opcode == records.STATISTICS:
            self.counted = records.read_statistics(record.content)
        elif record.opcode == records.FOOTER:
            self._closed_properly = True
        elif record.opcode == records.DATA_END:
            self._data_end = (record.offset, records.read_data_crc(record.content))
        else:
            self._take_definition(record.opcode, record.content)

    def _take_definition(self, opcode: int, content: bytes) -> None:
        if opcode == records.SCHEMA:
            number, *schema = records.read_schema(content)
            self._schemas.setdefault(number, (schema[0], schema[1], schema[2]))
        elif opcode == records.CHANNEL:
            number, schema_number, topic, encoding = records.read_channel(content)
            self._heads.setdefault(number, (schema_number, topic, encoding))

    def _take_chunk(self, record: records.Record) -> None:
        chunk = records.read_chunk(record.content)
        self._lost_chunk = None
        try:
            if record.complete:
                data = decompress_chunk(chunk.data, chunk.compression, chunk.size, chunk.crc)
            else:
                data = salvage(chunk.data, chunk.compression)
        except Damaged as error:
            seconds = (chunk.end - chunk.start) / 1e9
            loss = Loss("damaged chunk", record.offset, None, seconds, len(chunk.data), str(error))
            self._lost_chunk = loss
            self._losses.append(loss)
            return
        begin = record.offset + chunk.data_offset
        self._chunks.append(
            _Place(begin, len(chunk.data), chunk.size, chunk.compression, complete=record.complete)
        )
        last = self._take_chunk_records(data, record.offset, len(self._chunks) - 1)
        if not record.complete:
            seconds = max(chunk.end - max(last, chunk.start), 0) / 1e9
            self._losses.append(Loss("a chunk cut off at the end", record.offset, seconds=seconds))

    def _take_chunk_records(self, data: bytes, offset: int, number: int) -> int:
        """Index the records of the chunk at ``offset``; return the log time of its last message [ns]."""
        last = 0
        for opcode, begin, end in records.inner_records(data):
            if opcode == records.MESSAGE and end - begin >= 22:
                channel, last, published, start = records.read_message_head(data, begin)
                self._index_of(channel).add(last, published, number, start, end)
            elif opcode in {records.SCHEMA, records.CHANNEL}:
                try:
                    self._take_definition(opcode, data[begin:end])
                except struct.error:
                    self._losses.append(Loss("unreadable record in a chunk", offset, bytes=end - begin))
        return last

    def _index_of(self, channel: int) -> _Index:
        index = self._index.get(channel)
        if index is None:
            index = self._index[channel] = _Index()
        return index

    def _resolve_channels(self) -> list[Channel]:
        found: dict[tuple[str, str, str], Channel] = {}
        for number, (schema_number, topic, encoding) in sorted(self._heads.items()):
            type_name, definition_format, text = self._schemas.get(schema_number, ("", "", ""))
            key = (topic, type_name, encoding)
            channel = found.setdefault(key, Channel(topic, type_name, encoding, text, definition_format))
            self._numbers.setdefault(id(channel), []).append(number)
        return list(found.values())

    # --- damage -----------------------------------------------------------------------------------

    def _report_damage(self) -> None:
        self.damage += summarise(self.path.name, self._losses)
        orphans = sum(len(i.times) for number, i in self._index.items() if number not in self._heads)
        if orphans:
            text = f"{self.path.name}: messages whose channel is defined in a lost part of the file"
            self.damage.append(Damage(text, orphans))
        if not self._closed_properly:
            self.damage.append(Damage(f"{self.path.name}: has no footer, the recorder did not close it"))

    # --- reading ----------------------------------------------------------------------------------

    def _of(self, channel: Channel) -> list[int]:
        return [number for number in self._numbers.get(id(channel), []) if number in self._index]

    def _read(self, file: BinaryIO, chunk: int, begin: int, end: int) -> bytes:
        if chunk >= 0:
            return self._chunk_data(file, chunk)[begin:end]
        file.seek(begin)
        return file.read(end - begin)

    def _chunk_data(self, file: BinaryIO, number: int) -> bytes:
        data = self._cache.get(number)
        if data is not None:
            self._cache.move_to_end(number)
            return data
        place = self._chunks[number]
        file.seek(place.offset)
        packed = file.read(place.length)
        if place.complete:
            data = decompress_chunk(packed, place.compression, place.size, 0)
        else:
            data = salvage(packed, place.compression)
        self._cache[number] = data
        while len(self._cache) > 1 and sum(map(len, self._cache.values())) > CACHE_BYTES:
            self._cache.popitem(last=False)
        return data


def _joined(parts: Sequence[array[int]]) -> Times:
    return np.concatenate([np.empty(0, np.int64), *(np.asarray(part, dtype=np.int64) for part in parts)])
