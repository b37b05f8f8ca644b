"""CHUNKS OF A LOG: unpacked only where they are needed, in several threads, each checked as it is read.

MCAP files and ROS 1 bags keep their messages in chunks, with an index behind each that says at which time and
where in it the messages of a channel lie. Opening such a file reads what is between the chunks. The indexes
are believed as long as they agree with what the writer counted at the end of the file, and with each chunk
that is read: every message must be where the index says, and nothing may lie between them that the index
leaves out. Where one does not agree, all chunks are unpacked and their messages found one behind the other.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ident.logs.compression import Buffer, Damaged
from ident.logs.damage import Loss
from ident.logs.parallel import in_order
from ident.logs.payloads import Bytes, Payloads, slices
from ident.logs.record import Channel, Stored, Times, join_stored
from ident.logs.source import Source
from ident.results import Damage

JOB_BYTES = 3 << 20
PIECE_BYTES = 8 << 20


class IndexLied(Exception):
    """An index was found to be wrong; by now all chunks were looked at, and reading can begin again."""


@dataclass
class Chunk:
    """A chunk whose record begins at ``offset``, its data [compressed] at ``begin``.

    complete : whether the file holds all of it
    start, end : log times that its header states [ns]
    counted : messages in its indexes, None where there is none
    entries : number of a channel -> (n, 2) log times [ns] and places of its messages in the unpacked data
    looked : whether it was unpacked, so that ``entries`` are what it holds, and not only what an index says
    """

    offset: int
    begin: int
    length: int
    size: int
    crc: int
    compression: str
    complete: bool = True
    start: int = 0
    end: int = 0
    counted: int | None = None
    entries: dict[int, Times] = field(default_factory=dict)
    looked: bool = False


@dataclass(frozen=True)
class Contents:
    """Messages of an unpacked chunk: those of a channel lie together, in the order of the file.

    bounds : number of a channel -> first and last of its messages (+ 1)
    offsets, begins, sizes : (n,) places of the record and of the message, and size of the message [bytes]
    others : records that are no messages: kind and content
    as_indexed : whether the index of the chunk says the same
    losses : what in it cannot be read
    """

    bounds: Mapping[int, tuple[int, int]]
    times: Times
    published: Times | None
    offsets: Times
    begins: Times
    sizes: Times
    others: Sequence[tuple[int, bytes]] = ()
    as_indexed: bool = True
    losses: Sequence[Loss] = ()


@dataclass
class Loose:
    """Messages of one channel outside chunks: log and publish time [ns], begin and size in the file."""

    times: list[int] = field(default_factory=list)
    published: list[int] = field(default_factory=list)
    begins: list[int] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class Part:
    """Messages of one channel that follow one another."""

    times: Times
    published: Times | None
    sizes: Times
    block: Bytes


@dataclass(frozen=True)
class _Unpacked:
    """A chunk and what came out of it: its contents, or what is wrong; the parts that were asked for."""

    chunk: Chunk
    contents: Contents | None
    problem: str = ""
    parts: Sequence[tuple[int, Part]] = ()


class ChunkedStorage(ABC):
    """What MCAP files and ROS 1 bags have in common (see ``ident.logs.record.Storage``).

    A format adds what is abstract here, and fills the chunks when it opens a file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = [path]
        self.channels: list[Channel] = []
        self._numbers: dict[int, list[int]] = {}
        self._chunks: list[Chunk] = []
        self._loose: dict[int, Loose] = {}
        self._losses: list[Loss] = []

    # --- what a format adds -----------------------------------------------------------------------

    @abstractmethod
    def _unpack(self, source: Source, chunk: Chunk) -> Buffer:
        """Read and unpack a chunk, and check it; ``Damaged`` where it is not what was written."""

    @abstractmethod
    def _indexed(self, data: Buffer, entries: Mapping[int, Times]) -> Contents | None:
        """Find messages by an index; None where it is not the whole truth about the data."""

    @abstractmethod
    def _walked(self, data: Buffer, chunk: Chunk) -> Contents:
        """Find the messages in a chunk by going through it."""

    @abstractmethod
    def _take_others(self, chunk: Chunk, contents: Contents) -> None:
        """Take in what a chunk holds beside messages."""

    # --- looking at chunks ------------------------------------------------------------------------

    def check(self) -> None:
        """Look at every chunk that was not looked at yet, so that all damage is known."""
        left = [chunk for chunk in self._chunks if not chunk.looked]
        with Source(self.path) as source, closing(self._unpacked(source, left, [])) as unpacked:
            for found in unpacked:
                self._settle(found)

    def _not_looked_at(self) -> list[Damage]:
        """Say, where something is lost, how much of the file nobody has looked at."""
        left = sum(not chunk.looked for chunk in self._chunks)
        if not left or not self._losses:
            return []
        text = f"{left} of {len(self._chunks)} chunks hold nothing that is needed and were not looked at"
        return [Damage(f"{self.path.name}: {text}: 'ident info' checks all of them")]

    def _counts(self) -> dict[int, int]:
        """How many messages each channel has, by its number, as far as is known."""
        counts = Counter({number: len(each.times) for number, each in self._loose.items()})
        for chunk in self._chunks:
            for number, entries in chunk.entries.items():
                counts[number] += len(entries)
        return dict(counts)

    def _settle(self, found: _Unpacked) -> bool:
        """Keep what a chunk was found to hold; return whether its index told the truth."""
        chunk, contents = found.chunk, found.contents
        if chunk.looked:
            return True
        chunk.looked = True
        if contents is None:
            seconds = (chunk.end - chunk.start) / 1e9 if chunk.end else None
            self._losses.append(
                Loss("damaged chunk", chunk.offset, chunk.counted, seconds, chunk.length, found.problem)
            )
            chunk.entries = {}
            return True
        self._losses += contents.losses
        self._take_others(chunk, contents)
        if not contents.as_indexed:
            chunk.entries = {
                number: np.column_stack([contents.times[a:b], contents.offsets[a:b]])
                for number, (a, b) in contents.bounds.items()
            }
        if not chunk.complete:
            last = int(contents.times.max()) if len(contents.times) else 0
            gone = max(chunk.end - max(last, chunk.start), 0) / 1e9 if chunk.end else None
            self._losses.append(Loss("a chunk cut off at the end", chunk.offset, seconds=gone))
        return contents.as_indexed

    def _unpacked(
        self, source: Source, chunks: Sequence[Chunk], wanted: Sequence[Sequence[int]]
    ) -> Generator[_Unpacked]:
        """Unpack chunks in threads; pick the messages of these channels, each with its numbers."""

        def work(job: Sequence[Chunk]) -> list[_Unpacked]:
            return [self._unpack_one(source, chunk, wanted) for chunk in job]

        with closing(in_order(work, _grouped(chunks))) as found:
            for done in found:
                yield from done

    def _unpack_one(self, source: Source, chunk: Chunk, wanted: Sequence[Sequence[int]]) -> _Unpacked:
        try:
            data = self._unpack(source, chunk)
        except Damaged as error:
            return _Unpacked(chunk, None, str(error))
        contents = self._indexed(data, chunk.entries) or self._walked(data, chunk)
        return _Unpacked(chunk, contents, "", _picked(data, contents, wanted))

    # --- reading ----------------------------------------------------------------------------------

    def times(self, channel: Channel) -> Times:
        """Log times of a channel [ns], in the order of the file."""
        numbers = self._numbers.get(id(channel), [])
        parts = [(chunk.offset, _entry_times(chunk, numbers)) for chunk in self._chunks]
        parts += [(begin, part.times) for begin, part in self._loose_parts(numbers, with_data=None)]
        parts.sort(key=lambda part: part[0])
        return np.concatenate([np.empty(0, np.int64), *(times for _, times in parts)])

    def messages(self, channel: Channel) -> Stored:
        """Read the messages of a channel, in the order of the file."""
        try:
            return join_stored([stored for _, stored in self.pieces([channel])])
        except IndexLied:
            return join_stored([stored for _, stored in self.pieces([channel])])

    def pieces(self, channels: Sequence[Channel]) -> Iterator[tuple[Channel, Stored]]:
        """Read the messages of several channels in one pass, each in the order of the file, bit by bit.

        Raises
        ------
        IndexLied
            If an index was found to be wrong after some were given: begin again, it cannot happen twice.
        """
        wanted = [self._numbers.get(id(channel), []) for channel in channels]
        gathered: list[list[Part]] = [[] for _ in channels]
        size = 0
        for key, part in self._parts(wanted):
            gathered[key].append(part)
            size += part.block.nbytes + 64 * len(part.times)
            if size >= PIECE_BYTES:
                yield from _flushed(channels, gathered)
                size = 0
        yield from _flushed(channels, gathered)

    def _parts(self, wanted: Sequence[Sequence[int]]) -> Iterator[tuple[int, Part]]:
        """Parts of all wanted channels in the order of the file."""
        numbers = {number for each in wanted for number in each}
        chunks = [chunk for chunk in self._chunks if not numbers.isdisjoint(chunk.entries)]
        with Source(self.path) as source:
            loose = [
                (begin, key, part)
                for key, each in enumerate(wanted)
                for begin, part in self._loose_parts(each, with_data=source)
            ]
            loose.sort(key=lambda each: each[0])
            # The threads must have ended before the file is closed, also where nobody reads to the end.
            with closing(self._unpacked(source, chunks, wanted)) as unpacked:
                for found in unpacked:
                    while loose and loose[0][0] < found.chunk.offset:
                        yield loose.pop(0)[1:]
                    if not self._settle(found):
                        self.check()
                        raise IndexLied
                    yield from found.parts
            for _, key, part in loose:
                yield key, part

    def _loose_parts(self, numbers: Sequence[int], with_data: Source | None) -> Iterator[tuple[int, Part]]:
        """Messages outside chunks, in runs that no chunk divides, with the place of each run."""
        found = [self._loose[number] for number in numbers if number in self._loose]
        if not found:
            return
        begins, sizes, times, published = (
            np.concatenate([np.array(getattr(each, name), dtype=np.int64) for each in found])
            for name in ("begins", "sizes", "times", "published")
        )
        order = np.argsort(begins, kind="stable")
        run = np.searchsorted([chunk.offset for chunk in self._chunks], begins[order])
        for rows in np.split(order, np.flatnonzero(np.diff(run)) + 1):
            block = np.empty(0, np.uint8)
            if with_data is not None:
                block = read_slices(with_data, begins[rows], sizes[rows])
            yield int(begins[rows[0]]), Part(times[rows], published[rows], sizes[rows], block)


# --- contents by an index -------------------------------------------------------------------------

Others = list[tuple[int, bytes]]


def only_between(
    data: Buffer, begins: Times, ends: Times, others: Callable[[Buffer, int, int], Others | None]
) -> Others | None:
    """Return the other records between these messages, which fill a chunk; None where anything else does.

    Parameters
    ----------
    others : reads the records that fill the data from here to there, None where that is not so
    """
    order = np.argsort(begins, kind="stable")
    begins, ends = begins[order], ends[order]
    found: Others = []
    gaps = np.flatnonzero(begins[1:] != ends[:-1])
    edges = [(0, begins[0]), *zip(ends[gaps], begins[gaps + 1], strict=True), (ends[-1], len(data))]
    for start, stop in edges:
        between = others(data, int(start), int(stop)) if start <= stop else None
        if between is None:
            return None
        found += between
    return found


def in_file_order(offsets: Times, bounds: Mapping[int, tuple[int, int]]) -> bool:
    """Whether the messages of each channel are in the order of the file."""
    falls = np.flatnonzero(offsets[1:] <= offsets[:-1]) + 1
    return not len(falls) or set(falls.tolist()) <= {first for first, _ in bounds.values()}


# --- helpers --------------------------------------------------------------------------------------


def _grouped(chunks: Iterable[Chunk]) -> Iterator[list[Chunk]]:
    """Group chunks that follow one another into jobs that are worth a thread's while."""
    job: list[Chunk] = []
    size = 0
    for chunk in chunks:
        job.append(chunk)
        size += max(chunk.size, chunk.length)
        if size >= JOB_BYTES:
            yield job
            job, size = [], 0
    if job:
        yield job


def _rows(contents: Contents, numbers: Sequence[int]) -> slice | NDArray[np.intp] | None:
    """Rows of a channel that has these numbers, in the order of the file; None where there are none."""
    found = [contents.bounds[number] for number in numbers if number in contents.bounds]
    if not found:
        return None
    if len(found) == 1:
        return slice(*found[0])
    rows = np.concatenate([np.arange(a, b) for a, b in found])
    return rows[np.argsort(contents.offsets[rows], kind="stable")]


def _part(data: Buffer, contents: Contents, rows: slice | NDArray[np.intp]) -> Part:
    sizes = contents.sizes[rows]
    published = None if contents.published is None else contents.published[rows]
    return Part(contents.times[rows], published, sizes, slices(data, contents.begins[rows], sizes))


def _picked(data: Buffer, contents: Contents, wanted: Sequence[Sequence[int]]) -> list[tuple[int, Part]]:
    """Copy the messages of each wanted channel, which has these numbers."""
    return [
        (key, _part(data, contents, rows))
        for key, numbers in enumerate(wanted)
        if (rows := _rows(contents, numbers)) is not None
    ]


def _entry_times(chunk: Chunk, numbers: Sequence[int]) -> Times:
    found = [chunk.entries[number] for number in numbers if number in chunk.entries]
    if not found:
        return np.empty(0, np.int64)
    entries = found[0] if len(found) == 1 else np.concatenate(found)
    in_order_of_file = np.argsort(entries[:, 1], kind="stable")
    return np.ascontiguousarray(entries[in_order_of_file, 0])


def _flushed(channels: Sequence[Channel], gathered: list[list[Part]]) -> Iterator[tuple[Channel, Stored]]:
    """Give what was gathered, and forget it."""
    for key, channel in enumerate(channels):
        parts, gathered[key] = gathered[key], []
        if parts:
            yield channel, _stored(parts)


def _stored(parts: Sequence[Part]) -> Stored:
    times = np.concatenate([part.times for part in parts])
    published = None
    if all(part.published is not None for part in parts):
        published = np.concatenate([part.published for part in parts if part.published is not None])
    block = np.concatenate([part.block for part in parts])
    # Where the sender's time is not known, the writer puts the log time (https://mcap.dev/spec).
    same = published is None or np.array_equal(published, times)
    data = Payloads(block, np.concatenate([part.sizes for part in parts]))
    return Stored(times, data, None if same else published)


def read_slices(source: Source, begins: Times, sizes: Times) -> Bytes:
    """Read slices of a file that follow one another, near ones together."""
    blocks = []
    first = 0
    ends = begins + sizes
    far = np.flatnonzero(begins[1:] - ends[:-1] > 1 << 16) + 1
    for stop in [*far.tolist(), len(begins)]:
        while first < stop:
            last = max(int(np.searchsorted(ends[:stop], begins[first] + JOB_BYTES)), first + 1)
            data = source.read(int(begins[first]), int(ends[last - 1] - begins[first]))
            blocks.append(slices(data, begins[first:last] - begins[first], sizes[first:last]))
            first = last
    return np.concatenate([np.empty(0, np.uint8), *blocks])
