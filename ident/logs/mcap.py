"""MCAP files: every message that can still be read, and what cannot.

Opening a file reads all records but the insides of its chunks. Those are unpacked and checked (CRC) as they
are needed, as long as the summary of the file counts as many messages of each channel as the indexes behind
the chunks list; else, and where anything is out of place, all of them at once (see ``ident.logs.chunks``). A
file without footer or summary, cut off, or with damaged chunks loses only what is damaged; of a chunk that is
cut off, the beginning is read.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

from ident.errors import UnusableLog
from ident.logs import mcap_records as records
from ident.logs.chunks import ChunkedStorage, Loose, Target
from ident.logs.compression import Buffer, checked, decompress_chunk, salvage
from ident.logs.contents import Chunk, Contents
from ident.logs.damage import Loss, summarise
from ident.logs.record import Channel, Times
from ident.logs.source import Source, Window
from ident.results import Damage

_BLOCK = 1 << 20


class McapStorage(ChunkedStorage):
    """One MCAP file (see ``ident.logs.record.Storage``)."""

    format = "mcap"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._heads: dict[int, tuple[int, str, str]] = {}
        self._counted: records.Statistics | None = None
        self._doubtful = False
        self._closed_properly = False
        self._data_end = (0, 0)
        self._data_crc_is_right: bool | None = None
        with Source(path) as source:
            self._scan(source)
        if not self._is_consistent():
            self._go_through()
        if self._loose or not all(chunk.crc for chunk in self._chunks):
            self._check_data_crc()
        self.channels = self._resolve_channels()

    def check(self) -> None:
        """Look at every part of the file that was not looked at yet."""
        super().check()
        self._check_data_crc()

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""

    @property
    def damage(self) -> list[Damage]:
        """What is known to be lost."""
        damage = summarise(self.path.name, sorted(self._losses, key=lambda loss: loss.place))
        if self._data_crc_is_right is False:
            text = "the CRC of the data does not match: bytes are wrong that cannot be told from right ones"
            damage.insert(0, Damage(f"{self.path.name}: {text}"))
        orphans = sum(count for number, count in self._counts().items() if number not in self._heads)
        if orphans:
            text = f"{self.path.name}: messages whose channel is defined in a lost part of the file"
            damage.append(Damage(text, orphans))
        if not self._closed_properly:
            damage.append(Damage(f"{self.path.name}: has no footer, the recorder did not close it"))
        return damage + self._not_looked_at()

    # --- opening ----------------------------------------------------------------------------------

    def _scan(self, source: Source) -> None:
        window = Window(source)
        if window.read(0, len(records.MAGIC)) != records.MAGIC:
            raise UnusableLog(f"{self.path}: not an MCAP file (its first bytes are not those of one)")
        for record in records.walk(window, source.size):
            if isinstance(record, records.Hole):
                self._losses.append(Loss("bytes that are no records", record.offset, bytes=record.bytes))
                continue
            try:
                self._take(record)
            except struct.error:
                self._losses.append(Loss("unreadable record", record.offset, bytes=record.length))

    def _take(self, record: records.Record) -> None:
        if record.opcode == records.CHUNK:
            head = records.read_chunk(record.content)
            begin = record.offset + head.data_offset
            length = record.offset + records.HEAD_SIZE + record.length - begin
            place = (record.offset, begin, length, head.size, head.crc, head.compression)
            self._chunks.append(Chunk(*place, record.complete, head.start, head.end))
        elif not record.complete:
            self._losses.append(Loss("a record cut off at the end", record.offset, bytes=record.length))
        elif record.opcode == records.MESSAGE:
            self._take_message(record)
        elif record.opcode == records.MESSAGE_INDEX:
            self._take_index(record)
        elif record.opcode == records.STATISTICS:
            self._counted = records.read_statistics(record.content)
        elif record.opcode == records.FOOTER:
            self._closed_properly = True
        elif record.opcode == records.DATA_END:
            self._data_end = (record.offset, records.read_data_crc(record.content))
        else:
            self._take_definition(record.opcode, record.content)

    def _take_message(self, record: records.Record) -> None:
        channel, time, published, begin = records.read_message_head(record.content, 0)
        if time >= 1 << 63:
            what = "message whose time is later than any clock's"
            self._losses.append(Loss(what, record.offset, 1, bytes=record.length))
        else:
            loose = self._loose.setdefault(channel, Loose())
            loose.times.append(time)
            loose.published.append(published if published < 1 << 63 else 0)
            loose.begins.append(record.offset + records.HEAD_SIZE + begin)
            loose.sizes.append(record.length - begin)

    def _take_index(self, record: records.Record) -> None:
        """Keep the index of the chunk before; where it makes no sense, no index is believed."""
        found = records.read_message_index(record.content)
        if found is None or not self._chunks:
            self._doubtful = True
            return
        number, entries = found
        chunk = self._chunks[-1]
        chunk.counted = (chunk.counted or 0) + len(entries)
        self._doubtful |= number in chunk.entries
        if len(entries):
            chunk.entries[number] = entries

    def _take_definition(self, opcode: int, content: bytes) -> None:
        if opcode == records.SCHEMA:
            number, *schema = records.read_schema(content)
            self._schemas.setdefault(number, (schema[0], schema[1], schema[2]))
        elif opcode == records.CHANNEL:
            number, schema_number, topic, encoding = records.read_channel(content)
            self._heads.setdefault(number, (schema_number, topic, encoding))

    def _is_consistent(self) -> bool:
        """Whether the summary and the indexes say the same, and leave nothing open."""
        if not self._closed_properly or self._losses or self._doubtful or self._counted is None:
            return False
        known = all(head[0] in self._schemas or not head[0] for head in self._heads.values())
        channels, messages = self._counted.channels, self._counted.messages
        return known and channels == len(self._heads) and self._counts() == messages

    def _resolve_channels(self) -> list[Channel]:
        found: dict[tuple[str, ...], Channel] = {}
        for number, (schema_number, topic, encoding) in sorted(self._heads.items()):
            type_name, definition_format, text = self._schemas.get(schema_number, ("", "", ""))
            key = (topic, type_name, encoding, definition_format, text)
            channel = found.setdefault(key, Channel(topic, type_name, encoding, text, definition_format))
            self._numbers.setdefault(id(channel), []).append(number)
        return list(found.values())

    # --- chunks -----------------------------------------------------------------------------------

    def _unpack(self, source: Source, chunk: Chunk, target: Target) -> Buffer:
        if chunk.complete and not chunk.compression and chunk.length == chunk.size:
            return checked(source.fill(target(chunk.size), chunk.begin), chunk.size, chunk.crc)
        data = source.borrow(chunk.begin, chunk.length)
        if not chunk.complete:
            return salvage(data, chunk.compression)
        return decompress_chunk(data, chunk.compression, chunk.size, chunk.crc, target)

    def _indexed(self, data: Buffer, entries: Mapping[int, Times]) -> Contents | None:
        return records.indexed_contents(data, entries)

    def _walked(self, data: Buffer, chunk: Chunk) -> Contents:
        return records.walked_contents(data, chunk.entries)

    def _take_others(self, chunk: Chunk, contents: Contents) -> None:
        for opcode, content in contents.others:
            try:
                self._take_definition(opcode, content)
            except struct.error:
                what = "unreadable record in a chunk"
                self._losses.append(Loss(what, chunk.offset, bytes=len(content)))

    def _check_data_crc(self) -> None:
        """Find damage that shows nowhere else: in messages outside chunks, in chunks without a CRC."""
        end, expected = self._data_end
        if not expected or self._losses or self._data_crc_is_right is not None:
            return
        crc = 0
        with Source(self.path) as source:
            for start in range(0, end, _BLOCK):
                crc = zlib.crc32(source.borrow(start, min(_BLOCK, end - start)), crc)
        self._data_crc_is_right = crc == expected
