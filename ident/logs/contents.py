"""CONTENTS OF UNPACKED CHUNKS: where their messages lie, and the copies of those that are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ident.logs.compression import Buffer
from ident.logs.damage import Loss
from ident.logs.payloads import Bytes, slices
from ident.logs.record import Times

SMALL_MESSAGE = 4096
Wanted = Sequence[Sequence[int]]


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


@dataclass(frozen=True)
class Part:
    """Messages of one channel that follow one another."""

    times: Times
    published: Times | None
    sizes: Times
    block: Bytes


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


# --- copies ---------------------------------------------------------------------------------------


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


def picked(data: Buffer, contents: Contents, wanted: Wanted | None) -> list[tuple[int, Part]]:
    """Copy the messages of each wanted channel, which has these numbers; where none is given, small ones."""
    if wanted is None:
        return [
            (number, _part(data, contents, slice(*bounds)))
            for number, bounds in contents.bounds.items()
            if contents.sizes[slice(*bounds)].max() <= SMALL_MESSAGE
        ]
    return [
        (key, _part(data, contents, rows))
        for key, numbers in enumerate(wanted)
        if (rows := _rows(contents, numbers)) is not None
    ]


# --- several chunks side by side ------------------------------------------------------------------


def entries_together(chunks: Sequence[Chunk], ends: Sequence[int]) -> dict[int, Times]:
    """Indexes of chunks that lie side by side, as if of one: the data of each ends at these places."""
    found: dict[int, list[tuple[int, Times]]] = {}
    for chunk, end in zip(chunks, ends, strict=True):
        for number, entries in chunk.entries.items():
            found.setdefault(number, []).append((end - chunk.size, entries))
    together = {}
    for number, parts in found.items():
        entries = np.concatenate([each for _, each in parts])
        begins = [begin for begin, _ in parts]
        entries[:, 1] += np.repeat(begins, [len(each) for _, each in parts])
        together[number] = entries
    return together


def crosses(contents: Contents, edges: Sequence[int]) -> bool:
    """Whether a message lies on both sides of any of these places."""
    ends = contents.begins + contents.sizes
    order = np.argsort(contents.offsets, kind="stable")
    behind = np.searchsorted(contents.offsets[order], edges)
    inside = behind > 0
    return bool((ends[order][behind[inside] - 1] > np.asarray(edges)[inside]).any())
