"""ROS 1 bags (format 2.0): every message that can still be read, and what cannot.

Opening a bag reads all records but the insides of its chunks. Those are unpacked as they are needed, as long
as the records at the end of the bag count as many messages of each connection in each chunk as the index
behind it; else, and where anything is out of place, all of them at once (see ``ident.logs.chunks``), so that
neither an index nor a proper end is needed. Where a record makes no sense, the walk goes on at the next
chunk; the index behind a damaged chunk says how many messages it held. The format has no checksums: a wrong
byte inside a value cannot be told.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

from ident.errors import UnusableLog
from ident.logs import ros1_records as records
from ident.logs.chunks import ChunkedStorage, Loose, Target
from ident.logs.compression import Buffer
from ident.logs.contents import Chunk, Contents
from ident.logs.damage import Loss, summarise
from ident.logs.record import Channel, Times
from ident.logs.ros1_records import Record
from ident.logs.schema import normal
from ident.logs.source import Source, Window
from ident.results import Damage

MAGIC = b"#ROSBAG V2.0\n"
ANY_MAGIC = b"#ROSBAG V"


class Ros1Storage(ChunkedStorage):
    """One ROS 1 bag (see ``ident.logs.record.Storage``)."""

    format = "ros1"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._connections: dict[int, Channel] = {}
        self._counted: dict[int, dict[int, int]] = {}
        self._read_header = False
        self._closed_properly = False
        self._doubtful = False
        with Source(path) as source:
            self._scan(source)
        if not self._is_consistent():
            self._go_through()
        if not self._connections and not self._read_header:
            raise UnusableLog(
                f"{path}: ROS 1 bag without a record that can be read ({path.stat().st_size} bytes)"
            )
        self.channels = self._merge_connections()

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""

    @property
    def damage(self) -> list[Damage]:
        """What is known to be lost."""
        damage = summarise(self.path.name, sorted(self._losses, key=lambda loss: loss.place))
        orphans = sum(count for number, count in self._counts().items() if number not in self._connections)
        if orphans:
            text = f"{self.path.name}: messages whose connection is defined in a lost part of the file"
            damage.append(Damage(text, orphans))
        if not self._closed_properly:
            damage.append(Damage(f"{self.path.name}: has no index, the recorder did not close it"))
        return damage + self._not_looked_at()

    # --- opening ----------------------------------------------------------------------------------

    def _scan(self, source: Source) -> None:
        window = Window(source)
        head = window.read(0, 16)
        if not head.startswith(MAGIC):
            version = head[len(ANY_MAGIC) :].split(b"\n")[0].decode("ascii", "replace")
            text = f"ROS 1 bag of version {version}, need 2.0: run 'rosbag fix' on it"
            raise UnusableLog(f"{self.path}: {text}")
        position = len(MAGIC)
        while position < source.size:
            record = records.record_in(window, position)
            if record is None or (not record.complete and record.op != records.CHUNK):
                position = self._step_over(window, position, cut=record is not None)
                continue
            if not record.complete and (after := records.next_chunk(window, position + 1)) is not None:
                self._losses.append(Loss("bytes that are no records", position, bytes=after - position))
                position = after
                continue
            try:
                self._take(window, record)
            except struct.error:
                size = record.end - record.offset
                self._losses.append(Loss("unreadable record", record.offset, bytes=size))
            position = record.end

    def _step_over(self, window: Window, position: int, *, cut: bool) -> int:
        """Pass over what is no record; return where to go on."""
        after = records.next_chunk(window, position + 1)
        end = window.size if after is None else after
        what = "a record cut off at the end" if cut and after is None else "bytes that are no records"
        self._losses.append(Loss(what, position, bytes=end - position))
        return end

    def _take(self, window: Window, record: Record) -> None:
        if record.op == records.BAG_HEADER:
            if record.fields.get(b"encryptor"):
                raise UnusableLog(f"{self.path}: is encrypted: decrypt it first")
            self._read_header = True
            self._closed_properly = int.from_bytes(record.fields.get(b"index_pos", b""), "little") > 0
        elif record.op == records.CHUNK:
            compression = record.fields.get(b"compression", b"").decode("ascii", "replace")
            length = record.end - record.begin
            place = (record.offset, record.begin, length, record.number(b"size"), 0, compression)
            self._chunks.append(Chunk(*place, record.complete))
        elif record.op == records.MESSAGE:
            self._take_message(record)
        else:
            content = window.read(record.begin, record.end - record.begin)
            if record.op == records.INDEX:
                self._take_index(record, content)
            elif record.op == records.CHUNK_INFO:
                self._counted[record.long(b"chunk_pos")] = records.read_counts(content)
            elif record.op == records.CONNECTION:
                self._connections.setdefault(record.number(b"conn"), _channel(record, content))

    def _take_message(self, record: Record) -> None:
        loose = self._loose.setdefault(record.number(b"conn"), Loose())
        loose.times.append(record.time)
        loose.published.append(record.time)
        loose.begins.append(record.begin)
        loose.sizes.append(record.end - record.begin)

    def _take_index(self, record: Record, content: bytes) -> None:
        """Keep the index of the chunk before; where it makes no sense, no index is believed."""
        if not self._chunks:
            return
        chunk, number = self._chunks[-1], record.number(b"conn")
        chunk.counted = (chunk.counted or 0) + record.number(b"count")
        entries = records.read_index(content)
        self._doubtful |= number in chunk.entries or len(entries) != record.number(b"count")
        if len(entries):
            chunk.entries[number] = entries

    def _is_consistent(self) -> bool:
        """Whether the end of the bag and the indexes say the same, and leave nothing open."""
        if not self._closed_properly or self._losses or self._doubtful or self._loose:
            return False
        indexed = {
            chunk.offset: {number: len(entries) for number, entries in chunk.entries.items()}
            for chunk in self._chunks
        }
        return indexed == self._counted and self._counts().keys() <= self._connections.keys()

    def _merge_connections(self) -> list[Channel]:
        """Make one channel of all connections of a topic, type and definition."""
        found: dict[tuple[str, ...], Channel] = {}
        for number, connection in sorted(self._connections.items()):
            key = (connection.topic, connection.type, connection.definition)
            channel = found.setdefault(key, connection)
            self._numbers.setdefault(id(channel), []).append(number)
        return list(found.values())

    # --- chunks -----------------------------------------------------------------------------------

    def _unpack(self, source: Source, chunk: Chunk, target: Target) -> Buffer:
        if chunk.complete and chunk.compression == "none" and chunk.length == chunk.size:
            return source.fill(target(chunk.size), chunk.begin)
        return records.unpack(source.borrow(chunk.begin, chunk.length), chunk)

    def _indexed(self, data: Buffer, entries: Mapping[int, Times]) -> Contents | None:
        return records.indexed_contents(data, entries)

    def _walked(self, data: Buffer, chunk: Chunk) -> Contents:
        return records.walked_contents(data, chunk)

    def _take_others(self, chunk: Chunk, contents: Contents) -> None:
        for op, content in contents.others:
            record = records.record_at(content, 0)
            if op != records.CONNECTION or record is None:
                continue
            try:
                channel = _channel(record, content[record.begin : record.end])
                self._connections.setdefault(record.number(b"conn"), channel)
            except struct.error:
                what = "unreadable record in a chunk"
                self._losses.append(Loss(what, chunk.offset, bytes=len(content)))


def _channel(record: Record, content: bytes) -> Channel:
    about = records.header(content)
    if about is None or b"type" not in about:
        raise struct.error("a connection without its type")
    text = {name: value.decode("utf-8", "replace") for name, value in about.items()}
    topic = record.fields.get(b"topic", b"").decode("utf-8", "replace") or text.get(b"topic", "")
    return Channel(topic, normal(text[b"type"]), "ros1", text.get(b"message_definition", ""), "ros1msg")
