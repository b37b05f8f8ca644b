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

from ident.logs.compression import Buffer, Damaged, most_bytes
from ident.logs.contents import Chunk, Contents, Part, Wanted, crosses, entries_together, picked
from ident.logs.damage import Loss
from ident.logs.parallel import in_order
from ident.logs.payloads import Bytes, Payloads, slices
from ident.logs.record import Channel, Stored, Times, join_stored
from ident.logs.source import Source
from ident.results import Damage

JOB_BYTES = 3 << 20
PIECE_BYTES = 4 << 20
KEPT_BYTES = 64 << 20
Target = Callable[[int], memoryview]


class IndexLied(Exception):
    """An index was found to be wrong; by now all chunks were looked at, and reading can begin again."""


@dataclass
class Loose:
    """Messages of one channel outside chunks: log and publish time [ns], begin and size in the file."""

    times: list[int] = field(default_factory=list)
    published: list[int] = field(default_factory=list)
    begins: list[int] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class _Unpacked:
    """Chunks and what came out of them: their contents, or what is wrong; the parts that were asked for."""

    chunks: Sequence[Chunk]
    contents: Contents | None
    problem: str = ""
    parts: Sequence[tuple[int, Part]] = ()


@dataclass(frozen=True)
class _Kept:
    """Small messages of chunks that were gone through when the file was opened: number of a channel -> part.

    numbers : of all channels that these chunks hold
    """

    offset: int
    numbers: frozenset[int]
    parts: Mapping[int, Part]


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
        self._totals: dict[int, int] | None = None
        self._kept: list[_Kept] = []
        self._chunks_kept = 0

    # --- what a format adds -----------------------------------------------------------------------

    @abstractmethod
    def _unpack(self, source: Source, chunk: Chunk, target: Target) -> Buffer:
        """Read and unpack a chunk, and check it; ``Damaged`` where it is not what was written.

        ``target`` gives memory of so many bytes, once, which is used where that saves a copy.
        """

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

    def _go_through(self) -> None:
        """Look at every chunk, for want of an index; keep small messages, that need not be unpacked again."""
        size = 0
        with Source(self.path) as source, closing(self._unpacked(source, self._chunks, None)) as unpacked:
            for found in unpacked:
                self._settle(found)
                size += sum(part.block.nbytes + 24 * len(part.times) for _, part in found.parts)
                if size < KEPT_BYTES:
                    numbers = frozenset() if found.contents is None else frozenset(found.contents.bounds)
                    self._kept.append(_Kept(found.chunks[0].offset, numbers, dict(found.parts)))
                    self._chunks_kept += len(found.chunks)

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
        contents = found.contents
        if all(chunk.looked for chunk in found.chunks):
            return True
        self._totals = None
        for chunk in found.chunks:
            chunk.looked = True
        chunk = found.chunks[0]
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
        self, source: Source, chunks: Sequence[Chunk], wanted: Wanted | None
    ) -> Generator[_Unpacked]:
        """Unpack chunks in threads; pick the messages of these channels, each with its numbers.

        Where nothing is wanted yet (None) the small messages are picked, by the numbers of their channels.
        """

        def work(job: Sequence[Chunk]) -> list[_Unpacked]:
            together = self._unpack_together(source, job, wanted)
            return [together] if together else [self._unpack_one(source, chunk, wanted) for chunk in job]

        with closing(in_order(work, _grouped(chunks))) as found:
            for done in found:
                yield from done

    def _unpack_one(self, source: Source, chunk: Chunk, wanted: Wanted | None) -> _Unpacked:
        try:
            data = self._unpack(source, chunk, source.scratch)
        except Damaged as error:
            return _Unpacked([chunk], None, str(error))
        contents = self._indexed(data, chunk.entries) or self._walked(data, chunk)
        return _Unpacked([chunk], contents, "", picked(data, contents, wanted))

    def _unpack_together(
        self, source: Source, job: Sequence[Chunk], wanted: Wanted | None
    ) -> _Unpacked | None:
        """Unpack chunks side by side, so that numpy has more to do at once; None where any is not sound."""
        sound = all(chunk.complete and chunk.entries and chunk.looked == job[0].looked for chunk in job)
        if len(job) < 2 or not sound or self._loose or any(c.size > most_bytes(c.length) for c in job):
            return None
        ends = np.cumsum([chunk.size for chunk in job]).tolist()
        data = source.scratch(ends[-1])
        for chunk, end in zip(job, ends, strict=True):
            place = data[end - chunk.size : end]
            try:
                raw = self._unpack(source, chunk, _giving(place))
            except Damaged:
                return None
            if not isinstance(raw, memoryview) or raw.obj is not data.obj:
                place[:] = raw
        contents = self._indexed(data, entries_together(job, ends))
        if contents is None or crosses(contents, ends[:-1]):
            return None
        return _Unpacked(job, contents, "", picked(data, contents, wanted))

    # --- reading ----------------------------------------------------------------------------------

    def count(self, channel: Channel) -> int:
        """How many messages of a channel there are, as far as is known."""
        if self._totals is None:
            self._totals = self._counts()
        return sum(self._totals.get(number, 0) for number in self._numbers.get(id(channel), []))

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

    def _parts(self, wanted: Wanted) -> Iterator[tuple[int, Part]]:
        """Parts of all wanted channels in the order of the file."""
        numbers = {number for each in wanted for number in each}
        kept = self._kept_parts(wanted)
        left = self._chunks if kept is None else self._chunks[self._chunks_kept :]
        chunks = [chunk for chunk in left if not numbers.isdisjoint(chunk.entries)]
        with Source(self.path) as source:
            loose = [
                (begin, key, part)
                for key, each in enumerate(wanted)
                for begin, part in self._loose_parts(each, with_data=source)
            ]
            loose.sort(key=lambda each: each[0])
            for offset, key, part in kept or ():
                while loose and loose[0][0] < offset:
                    yield loose.pop(0)[1:]
                yield key, part
            # The threads must have ended before the file is closed, also where nobody reads to the end.
            with closing(self._unpacked(source, chunks, wanted)) as unpacked:
                for found in unpacked:
                    while loose and loose[0][0] < found.chunks[0].offset:
                        yield loose.pop(0)[1:]
                    if not self._settle(found):
                        self.check()
                        raise IndexLied
                    yield from found.parts
            for _, key, part in loose:
                yield key, part

    def _kept_parts(self, wanted: Wanted) -> list[tuple[int, int, Part]] | None:
        """Parts that were kept, with the places of their chunks; None where a wanted one was not."""
        found = []
        for kept in self._kept:
            for key, each in enumerate(wanted):
                numbers = kept.numbers.intersection(each)
                if len(numbers) > 1 or not numbers <= kept.parts.keys():
                    return None
                found += [(kept.offset, key, kept.parts[number]) for number in numbers]
        return found

    def _loose_parts(self, numbers: Sequence[int], with_data: Source | None) -> Iterator[tuple[int, Part]]:
        """Messages outside chunks, in runs that no chunk divides, with the place of each run."""
        found = [self._loose[number] for number in numbers if number in self._loose]
        if not found:
            return
        begins, sizes, times, published = (
            np.concatenate([np.array(getattr(each, name), dtype=np.int64) for each in found])
            for name in ("begins", "sizes", "times", "published")
        )
        if not begins.size:
            return
        order = np.argsort(begins, kind="stable")
        run = np.searchsorted([chunk.offset for chunk in self._chunks], begins[order])
        for rows in np.split(order, np.flatnonzero(np.diff(run)) + 1):
            block = np.empty(0, np.uint8)
            if with_data is not None:
                block = read_slices(with_data, begins[rows], sizes[rows])
            yield int(begins[rows[0]]), Part(times[rows], published[rows], sizes[rows], block)


# --- helpers --------------------------------------------------------------------------------------


def _giving(place: memoryview) -> Target:
    return lambda size: place[:size]


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
