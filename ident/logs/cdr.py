"""CDR -> WHOLE COLUMNS: where the fields of a message lie, and numbers read from many messages at once.

Where a field lies in a message depends on nothing but the lengths that the message states before it: of
strings and sequences, in XCDR2 also of delimited types and the flags of optional fields. So one message is
walked through, the bytes that state those lengths are remembered, and every other message of the same size
in which these bytes are the same is read by the same layout, with numpy.

Encapsulations (DDS-XTypes 1.3, 7.6.3.1.2): 0000, 0001 plain CDR (XCDR1, alignment to 8 bytes at most);
0006, 0007 plain XCDR2 (alignment to 4 bytes at most); 0008, 0009 delimited XCDR2; even ones are big-endian.
In XCDR2 a delimited (appendable) type, and an array or sequence of anything but numbers, is preceded by its
length in bytes. ROS 1 messages have no encapsulation and no alignment and are little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ident.logs.schema import Kind, Many, Member, Number, Schema, Struct, Text, innermost

DEEPEST = 64
MIN_WINDOW = 16
BLOCK = 64 << 20
Order = Literal["<", ">"]
Path = tuple[str | int, ...]
Wanted = Mapping[str | int, "Wanted"]


class CdrError(ValueError):
    """A message does not fit its definition; ``guards`` are the places of the bytes that show it."""

    def __init__(self, what: str, guards: Sequence[int] = ()) -> None:
        super().__init__(what)
        self.guards = guards


@dataclass(frozen=True)
class Encoding:
    """How numbers are laid out.

    order : of the bytes, "<" or ">"
    alignment : the largest [bytes]
    begin : where the message itself begins, behind its encapsulation [bytes]
    padding : how many bytes may follow the last field
    xcdr2 : whether lengths precede delimited types
    terminated : whether strings end in a zero
    """

    order: Order
    alignment: int
    begin: int = 4
    padding: int = 3
    xcdr2: bool = False
    delimited_root: bool = False
    terminated: bool = True


ROS1 = Encoding("<", 1, begin=0, padding=0, terminated=False)
ENCAPSULATIONS = {
    b"\x00\x00": Encoding(">", 8),
    b"\x00\x01": Encoding("<", 8),
    b"\x00\x06": Encoding(">", 4, xcdr2=True),
    b"\x00\x07": Encoding("<", 4, xcdr2=True),
    b"\x00\x08": Encoding(">", 4, xcdr2=True, delimited_root=True),
    b"\x00\x09": Encoding("<", 4, xcdr2=True, delimited_root=True),
}
PARAMETER_LISTS = {b"\x00\x02", b"\x00\x03", b"\x00\x0a", b"\x00\x0b"}


@dataclass(frozen=True)
class Layout:
    """Where the wanted fields lie in messages whose ``guards`` (places of bytes) hold the same bytes.

    places : path -> offset [bytes]; what the message does not hold is absent
    """

    order: Order
    places: Mapping[Path, int]
    guards: Sequence[int]


def encoding_of(data: bytes) -> Encoding:
    """Return the encoding that the first bytes of a message state."""
    head = data[:2]
    if len(data) < 4:
        raise CdrError(f"has {len(data)} bytes, need at least the 4 of the encapsulation")
    if head in PARAMETER_LISTS:
        text = f"CDR encapsulation {head.hex()} (parameter list of a mutable type) is not read"
        raise CdrError(text, (0, 1))
    if head not in ENCAPSULATIONS:
        raise CdrError(f"CDR encapsulation {head.hex()} is not known", (0, 1))
    return ENCAPSULATIONS[head]


def find_layout(data: bytes, schema: Schema, wanted: Wanted, encoding: Encoding) -> Layout:
    """Walk through one message; ``CdrError`` where it does not fit the schema."""
    walker = _Walker(data, schema, encoding)
    walker.guard(0, min(encoding.begin, 2))
    try:
        walker.struct(schema.root, wanted, (), delimited=encoding.delimited_root)
    except CdrError as error:
        raise CdrError(str(error), walker.guards) from error
    left = len(data) - walker.position
    if left > encoding.padding:
        text = f"{left} bytes are left over behind the last field of {schema.root}"
        raise CdrError(text, walker.guards)
    return Layout(encoding.order, walker.places, walker.guards)


@dataclass
class _Walker:
    """Goes through one message, field by field."""

    data: bytes
    schema: Schema
    encoding: Encoding
    position: int = 0
    end: int = 0
    places: dict[Path, int] = field(default_factory=dict)
    guards: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.position = self.encoding.begin
        self.end = len(self.data)
        self._unpack_length = struct.Struct(self.encoding.order + "I").unpack_from

    def guard(self, begin: int, size: int) -> None:
        self.guards.extend(range(begin, begin + size))

    def struct(self, name: str, wanted: Wanted, path: Path, *, delimited: bool) -> None:
        """Walk the members of a type; one that ends early lacks its last members, which are then absent."""
        if len(path) > DEEPEST:
            raise CdrError(f"{name} is nested more than {DEEPEST} deep")
        outer = self.end
        stop = self.enter() if delimited else outer
        for member in self.schema.types[name]:
            if delimited and self.position >= stop:
                break
            self._member(member, wanted.get(member.name), (*path, member.name))
        if delimited:
            self.position, self.end = stop, outer

    def _member(self, member: Member, wanted: Wanted | None, path: Path) -> None:
        if member.optional:
            if not self.encoding.xcdr2:
                raise CdrError(f"{_text(path)}: optional fields are read in XCDR2 only")
            here = self._take(1, 1)
            self.guard(here, 1)
            if not self.data[here]:
                return
        self.value(member.kind, wanted, path)

    def value(self, kind: Kind, wanted: Wanted | None, path: Path) -> None:
        if isinstance(kind, Number):
            size = np.dtype(kind.type).itemsize
            here = self._take(size, size)
            if wanted is not None:
                self.places[path] = here
        elif isinstance(kind, Text):
            self._string()
        elif isinstance(kind, Struct):
            delimited = self.encoding.xcdr2 and kind.name in self.schema.delimited
            self.struct(kind.name, wanted or {}, path, delimited=delimited)
        elif isinstance(kind, Many):
            self._many(kind, wanted or {}, path)

    def enter(self) -> int:
        """Read the length in bytes of what follows; return its end."""
        length = self.length()
        if length > self.end - self.position:
            raise CdrError(
                f"states {length} bytes at byte {self.position - 4}, has {self.end - self.position}"
            )
        self.end = self.position + length
        return self.end

    def length(self) -> int:
        """Read a length, and remember where it stands."""
        here = self._take(4, 4)
        self.guard(here, 4)
        return int(self._unpack_length(self.data, here)[0])

    def _many(self, kind: Many, wanted: Wanted, path: Path, *, row: bool = False) -> None:
        """Walk an array or a sequence; a ``row`` of one of several dimensions has no length of its own."""
        inner = innermost(kind)
        if self.encoding.xcdr2 and isinstance(inner, Number) and inner.enum:
            raise CdrError(f"{_text(path)}: arrays of enums are not read in XCDR2, writers differ in them")
        outer = self.end
        delimited = self.encoding.xcdr2 and not row and not _of_numbers(kind)
        stop = self.enter() if delimited else outer
        count = self.length() if kind.size is None else kind.size
        if count > self.end - self.position:
            raise CdrError(
                f"{_text(path)} states {count} elements, {self.end - self.position} bytes are left"
            )
        for index in range(0 if isinstance(kind.of, Number) else count):
            if isinstance(kind.of, Many) and kind.of.size is not None and kind.size is not None:
                self._many(kind.of, wanted.get(index, {}), (*path, index), row=True)
            else:
                self.value(kind.of, wanted.get(index), (*path, index))
        if isinstance(kind.of, Number):
            self._numbers(kind.of, count, wanted, path)
        if delimited:
            self.position, self.end = stop, outer

    def _numbers(self, kind: Number, count: int, wanted: Wanted, path: Path) -> None:
        if count == 0:  # then there is no padding either
            return
        size = np.dtype(kind.type).itemsize
        here = self._take(size, size * count)
        for index in wanted:
            if isinstance(index, int) and index < count:
                self.places[*path, index] = here + index * size

    def _string(self) -> None:
        length = self.length()
        here = self._take(1, length)
        if self.encoding.terminated and length:
            self.guard(self.position - 1, 1)
            if self.data[self.position - 1]:
                raise CdrError(f"a string of {length} bytes at byte {here} does not end in a zero")

    def _take(self, alignment: int, size: int) -> int:
        """Step over ``size`` aligned bytes; return where they begin."""
        step = min(alignment, self.encoding.alignment)
        begin = self.encoding.begin
        here = begin + -(-(self.position - begin) // step) * step
        if here + size > self.end:
            raise CdrError(f"ends at byte {self.end}, need {here + size}")
        self.position = here + size
        return here


def _of_numbers(kind: Many) -> bool:
    """Whether its elements are numbers: those of an array of several dimensions are those of the last."""
    return isinstance(kind.of if kind.size is None else _element(kind), Number)


def _element(kind: Many) -> Kind:
    of = kind.of
    while isinstance(of, Many) and of.size is not None:
        of = of.of
    return of


def _text(path: Path) -> str:
    return ".".join(map(str, path))


# --- many messages --------------------------------------------------------------------------------


@dataclass
class Read:
    """Numbers read from messages.

    columns : path -> (n,) values, NaN (or 0 where whole numbers were asked for) where there is none
    good : (n,) whether the message could be decoded
    errors : reasons of those that could not, in no order
    """

    columns: dict[Path, NDArray[np.float64]]
    whole: dict[Path, NDArray[np.int64]]
    good: NDArray[np.bool_]
    errors: list[str]


def read_columns(
    messages: Sequence[bytes],
    schema: Schema,
    numbers: Mapping[Path, str],
    whole: Mapping[Path, str],
    encoding: Encoding | None = None,
) -> Read:
    """Read fields of all messages.

    Parameters
    ----------
    numbers, whole : path -> numpy type of the fields to read as float64 and as int64
    encoding : of all messages; None: that which each of them states
    """
    count = len(messages)
    read = Read(
        {path: np.full(count, np.nan) for path in numbers},
        {path: np.zeros(count, np.int64) for path in whole},
        np.zeros(count, dtype=np.bool_),
        [],
    )
    wanted = _tree([*numbers, *whole])
    sizes = np.array([len(data) for data in messages], dtype=np.int64)
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        block = max(BLOCK // max(int(size), 1), 1)
        for start in range(0, len(rows), block):
            part = rows[start : start + block]
            _read_equal_sizes(messages, part, read, schema, wanted, {**numbers, **whole}, encoding)
    return read


def _tree(paths: Sequence[Path]) -> Wanted:
    tree: dict[str | int, dict] = {}  # type: ignore[type-arg]
    for path in paths:
        node = tree
        for step in path:
            node = node.setdefault(step, {})
    return tree


def _read_equal_sizes(
    messages: Sequence[bytes],
    rows: NDArray[np.intp],
    read: Read,
    schema: Schema,
    wanted: Wanted,
    types: Mapping[Path, str],
    encoding: Encoding | None,
) -> None:
    """Read messages of one size: find a layout, read all that share it, go on with the others.

    Only as many messages as seem worth it are compared with a layout, else messages of which each has a
    layout of its own would take a time that grows with the square of their number.
    """
    table = np.frombuffer(b"".join(messages[row] for row in rows), np.uint8).reshape(len(rows), -1)
    left = np.arange(len(rows))
    window = len(rows)
    while len(left):
        first = messages[rows[left[0]]]
        layout, problem = _layout_or_problem(first, schema, wanted, encoding)
        near = left[:window]
        guards = problem.guards if problem else layout.guards if layout else ()
        places = np.array(guards, dtype=np.intp)
        same = np.all(table[near][:, places] == table[left[0], places], axis=1)
        chosen = near[same]
        if layout is None:
            read.errors += [str(problem)] * len(chosen)
        else:
            _take_columns(table[chosen], rows[chosen], layout, types, read)
        left = np.concatenate([near[~same], left[window:]])
        window = max(MIN_WINDOW, 4 * len(chosen))


def _layout_or_problem(
    data: bytes, schema: Schema, wanted: Wanted, encoding: Encoding | None
) -> tuple[Layout | None, CdrError | None]:
    try:
        return find_layout(data, schema, wanted, encoding or encoding_of(data)), None
    except CdrError as error:
        return None, error


def _take_columns(
    table: NDArray[np.uint8],
    rows: NDArray[np.intp],
    layout: Layout,
    types: Mapping[Path, str],
    read: Read,
) -> None:
    read.good[rows] = True
    for path, offset in layout.places.items():
        kind = np.dtype(types[path])
        raw = np.ascontiguousarray(table[:, offset : offset + kind.itemsize])
        ordered = kind.newbyteorder(layout.order)
        values = raw[:, 0] != 0 if kind == np.bool_ else raw.view(ordered)[:, 0]
        if path in read.columns:
            read.columns[path][rows] = values
        if path in read.whole:
            read.whole[path][rows] = values
