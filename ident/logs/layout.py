"""ONE MESSAGE -> WHERE ITS FIELDS LIE: the layout of a message in any of the encodings of DDS and ROS.

Where a field lies in a message depends on nothing but what the message states before it: lengths of strings
and sequences, in XCDR2 also of delimited types, the flags of optional fields, and in a parameter list the
headers of the members. So one message is walked through, and the bytes that state these are remembered:
another message of the same size in which these ``guards`` are the same has the same layout.

Encapsulations (DDS-XTypes 1.3, 7.6.3.1.2; even ones are big-endian):

- 0000, 0001 plain XCDR1: numbers are aligned to 8 bytes at most; 0002, 0003 a parameter list (the type is
  mutable): each member stands behind a header that names it and states its length, the last header is an
  end mark, and within a member alignment begins anew. An optional field of any other type has such a header
  too, with length 0 where it is absent (7.4.1.2, 7.4.2).
- 0006, 0007 plain XCDR2: numbers are aligned to 4 bytes at most; 0008, 0009 delimited: an appendable type,
  and an array or sequence of anything but numbers, is preceded by its length in bytes; 000a, 000b a parameter
  list, preceded by its length too. An optional field has a flag of one byte (7.4.3.4, 7.4.3.5).

Members of a parameter list come in any order and may be absent; one that the definition does not know is
stepped over, unless its writer marked it as one that must be understood. Writers of XCDR2 differ in whether
an array of enums states its length in bytes: it is read as the standard says (it does) where the message
fits so, else without; a message that is longer than its type so, and fits it without, is refused. ROS 1
messages have no encapsulation, no alignment, and are little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ident.logs.schema import Kind, Many, Member, Number, Schema, Struct, Text, innermost

DEEPEST = 64
MOST_EMPTY = 10_000
ID_BITS = 0x0FFFFFFF
EXTENDED, LIST_END, IGNORED = 0x3F01, 0x3F02, 0x3F03
Order = Literal["<", ">"]
Form = Literal["plain", "delimited", "parameters"]
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
    root : the form of the message as a whole; that of types inside it is told by their definition
    terminated : whether strings end in a zero
    """

    order: Order
    alignment: int
    begin: int = 4
    padding: int = 3
    xcdr2: bool = False
    root: Form = "plain"
    terminated: bool = True


ROS1 = Encoding("<", 1, begin=0, padding=0, terminated=False)
ENCAPSULATIONS = {
    b"\x00\x00": Encoding(">", 8),
    b"\x00\x01": Encoding("<", 8),
    b"\x00\x02": Encoding(">", 8, root="parameters"),
    b"\x00\x03": Encoding("<", 8, root="parameters"),
    b"\x00\x06": Encoding(">", 4, xcdr2=True),
    b"\x00\x07": Encoding("<", 4, xcdr2=True),
    b"\x00\x08": Encoding(">", 4, xcdr2=True, root="delimited"),
    b"\x00\x09": Encoding("<", 4, xcdr2=True, root="delimited"),
    b"\x00\x0a": Encoding(">", 4, xcdr2=True, root="parameters"),
    b"\x00\x0b": Encoding("<", 4, xcdr2=True, root="parameters"),
}


@dataclass(frozen=True)
class Layout:
    """Where the wanted fields lie in messages whose ``guards`` (places of bytes) hold the same bytes.

    places : path -> offset [bytes]; what the message does not hold is absent
    """

    order: Order
    places: Mapping[Path, int]
    guards: Sequence[int]


def encoding_of(data: bytes) -> Encoding:
    """Return the encoding that the first bytes of a message state; ``CdrError`` where there is none."""
    head = data[:2]
    if len(data) < 4:
        raise CdrError(f"has {len(data)} bytes, need at least the 4 of the encapsulation")
    if head not in ENCAPSULATIONS:
        raise CdrError(f"CDR encapsulation {head.hex()} is not known", (0, 1))
    return ENCAPSULATIONS[head]


def find_layout(data: bytes, schema: Schema, wanted: Wanted, encoding: Encoding) -> Layout:
    """Walk through one message; ``CdrError`` where it does not fit the schema."""
    walker = _Walker(data, schema, encoding)
    problem = walker.walk(wanted)
    guards: Sequence[int] = walker.guards
    if walker.met_enums:
        other = _Walker(data, schema, encoding, enum_lengths=False)
        walks = [(walker, problem), (other, other.walk(wanted))]
        guards = [*walker.guards, *other.guards]
        walker, problem = _best_fit(walks)
    if problem:
        raise CdrError(problem, guards)
    return Layout(encoding.order, walker.places, guards)


def _best_fit(walks: Sequence[tuple[_Walker, str]]) -> tuple[_Walker, str]:
    """Choose the first walk that went through; refuse it where it left over what the other did not."""
    first, *others = [walk for walk in walks if not walk[1]] or walks[:1]
    if not first[0].exact and any(walker.exact for walker, _ in others):
        return first[0], "fits a longer type, and this one if its arrays of enums do not state their length"
    return first


@dataclass
class _Walker:
    """Goes through one message, field by field.

    origin : place from which alignment is counted
    enum_lengths : whether arrays of enums state their length in bytes; met_enums : whether there was one
    exact : whether every delimited type ended where its last member does
    """

    data: bytes
    schema: Schema
    encoding: Encoding
    enum_lengths: bool = True
    position: int = 0
    origin: int = 0
    end: int = 0
    met_enums: bool = False
    exact: bool = True
    places: dict[Path, int] = field(default_factory=dict)
    guards: list[int] = field(default_factory=list)
    steps: int = 0

    def __post_init__(self) -> None:
        self.position = self.origin = self.encoding.begin
        self.end = len(self.data)
        self._unpack_length = struct.Struct(self.encoding.order + "I").unpack_from

    def walk(self, wanted: Wanted) -> str:
        """Go through the whole message; return what does not fit, or nothing."""
        self.guard(0, min(self.encoding.begin, 2))
        try:
            self.struct(self.schema.root, wanted, (), self.encoding.root)
        except CdrError as error:
            return str(error)
        left = len(self.data) - self.position
        if left > self.encoding.padding:
            return f"{left} bytes are left over behind the last field of {self.schema.root}"
        return ""

    def guard(self, begin: int, size: int) -> None:
        self.guards.extend(range(begin, begin + size))

    # --- types ------------------------------------------------------------------------------------

    def struct(self, name: str, wanted: Wanted, path: Path, form: Form) -> None:
        """Walk the members of a type; a delimited one that ends early lacks its last, which are absent."""
        self._step(path)
        if form == "parameters":
            self._parameters(name, wanted, path)
            return
        outer = self.end
        stop = self.enter() if form == "delimited" else outer
        for member in self.schema.types[name]:
            if form == "delimited" and self.position >= stop:
                self.exact = False
                break
            self._member(member, wanted, path)
        if form == "delimited":
            self.exact &= self.position == stop
            self.position, self.end = stop, outer

    def _form(self, name: str) -> Form:
        """Form of a type inside a message."""
        if name in self.schema.mutable:
            return "parameters"
        return "delimited" if self.encoding.xcdr2 and name in self.schema.delimited else "plain"

    def _member(self, member: Member, wanted: Wanted, path: Path) -> None:
        if member.optional and not self.encoding.xcdr2:
            self._optional_parameter(member, wanted, path)
            return
        if member.optional:
            here = self._take(1, 1)
            self.guard(here, 1)
            if not self.data[here]:
                return
        self.value(member.kind, wanted.get(member.name), (*path, member.name))

    def value(self, kind: Kind, wanted: Wanted | None, path: Path) -> None:
        if isinstance(kind, Number):
            size = np.dtype(kind.type).itemsize
            here = self._take(size, size)
            if wanted is not None:
                self.places[path] = here
        elif isinstance(kind, Text):
            self._string()
        elif isinstance(kind, Struct):
            self.struct(kind.name, wanted or {}, path, self._form(kind.name))
        elif isinstance(kind, Many):
            self._many(kind, wanted or {}, path)

    def _many(self, kind: Many, wanted: Wanted, path: Path, *, row: bool = False) -> None:
        """Walk an array or a sequence; a ``row`` of one of several dimensions has no length of its own."""
        self._step(path)
        outer = self.end
        delimited = not row and self._states_its_length(kind)
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
            if self.position != stop and isinstance(innermost(kind), Number):
                raise CdrError(f"{_text(path)} ends at byte {self.position}, states byte {stop}")
            self.exact &= self.position == stop
            self.position, self.end = stop, outer

    def _states_its_length(self, kind: Many) -> bool:
        """Whether an array or a sequence is preceded by its length in bytes."""
        if not self.encoding.xcdr2:
            return False
        element = kind.of if kind.size is None else _element(kind)
        if isinstance(element, Number) and element.enum:
            self.met_enums = True
            if not self.enum_lengths and kind.size is not None:
                self._refuse_length(kind)
            return self.enum_lengths
        return not isinstance(element, Number)

    def _step(self, path: Path) -> None:
        """Count a type or an array: many that take no bytes would take for ever."""
        self.steps += 1
        if len(path) > DEEPEST:
            raise CdrError(f"{_text(path[:3])}... is nested more than {DEEPEST} deep")
        if self.steps > MOST_EMPTY + len(self.data):
            raise CdrError(f"has more than {MOST_EMPTY} parts that take no bytes")

    def _refuse_length(self, kind: Many) -> None:
        """Refuse an array whose length in bytes does stand before it: the message is cut off behind it."""
        of: Kind = kind
        size = 1
        while isinstance(of, Many):
            size *= of.size or 0
            of = of.of
        size *= np.dtype(of.type).itemsize if isinstance(of, Number) else 0
        position = self.position
        if self.end - position >= 8 and self.length() == size:
            raise CdrError(f"an array of {size} bytes states its length")
        self.position = position

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

    # --- parameter lists --------------------------------------------------------------------------

    def _parameters(self, name: str, wanted: Wanted, path: Path) -> None:
        """Walk a parameter list: members in the order of the message, each behind its header."""
        members = {member.id: member for member in self.schema.types[name]}
        if None in members:
            raise CdrError(f"is a parameter list, the definition of {name} does not number its members")
        outer = self.end
        stop = self.enter() if self.encoding.xcdr2 else outer
        seen: set[int] = set()
        while (header := self._header(stop)) is not None:
            number, needed, size = header
            if number in seen:
                raise CdrError(f"{name} states its member {number} twice")
            seen.add(number)
            if number in members:
                self._inside(members[number], size, wanted, path)
            elif needed:
                raise CdrError(f"{name} has no member {number}, which its writer marked must_understand")
            else:
                self._take(1, size)
        if self.encoding.xcdr2:
            self.position, self.end = stop, outer

    def _header(self, stop: int) -> tuple[int, bool, int] | None:
        """Read the header of a member: its number, whether it must be understood, its size [bytes]."""
        if not self.encoding.xcdr2:
            return self._header_xcdr1()
        if stop - self.position < 4:
            return None
        word = self.length()
        code = word >> 28 & 7
        size = 1 << code
        if code >= 4:
            size = self.length()
        if code >= 5:  # the length is also the first of the member itself
            size = 4 + size * (1, 4, 8)[code - 5]
            self.position -= 4
        return word & ID_BITS, bool(word >> 31), size

    def _header_xcdr1(self) -> tuple[int, bool, int] | None:
        while True:
            here = self._take(4, 4)
            self.guard(here, 4)
            first, size = struct.unpack_from(self.encoding.order + "HH", self.data, here)
            if first & 0x3FFF != IGNORED:
                break
            self._take(1, size)
        if first & 0x3FFF == LIST_END:
            return None
        if first & 0x3FFF == EXTENDED:
            word, size = self.length(), self.length()
            return (-1 if word >> 31 else word & ID_BITS), bool(word >> 30 & 1), size
        return (-1 if first & 0x8000 else first & 0x3FFF), bool(first & 0x4000), size

    def _optional_parameter(self, member: Member, wanted: Wanted, path: Path) -> None:
        """Walk an optional field of XCDR1: it has a header, whose length is 0 where it is absent."""
        header = self._header_xcdr1()
        number, size = (header[0], header[2]) if header else (None, 0)
        if number is None or (member.id is not None and number != member.id):
            text = f"{_text((*path, member.name))} has the header of {number}, need {member.id}"
            raise CdrError(text)
        if size:
            self._inside(member, size, wanted, path)

    def _inside(self, member: Member, size: int, wanted: Wanted, path: Path) -> None:
        """Walk a member that is ``size`` bytes long with its padding; XCDR1 aligns from its beginning."""
        begin, outer, origin = self.position, self.end, self.origin
        if size > outer - begin:
            raise CdrError(f"{_text((*path, member.name))} states {size} bytes, has {outer - begin}")
        self.end = begin + size
        if not self.encoding.xcdr2:
            self.origin = begin
        self.value(member.kind, wanted.get(member.name), (*path, member.name))
        left = self.end - self.position
        spare = 0 if self.encoding.xcdr2 and isinstance(member.kind, Number) else 3
        if left > spare and not isinstance(innermost(member.kind), Struct):
            raise CdrError(f"{_text((*path, member.name))} states {size} bytes, need {size - left}")
        self.position, self.end, self.origin = begin + size, outer, origin

    # --- bytes ------------------------------------------------------------------------------------

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
        """Read a length or a header, and remember where it stands."""
        here = self._take(4, 4)
        self.guard(here, 4)
        return int(self._unpack_length(self.data, here)[0])

    def _take(self, alignment: int, size: int) -> int:
        """Step over ``size`` aligned bytes; return where they begin."""
        step = min(alignment, self.encoding.alignment)
        here = self.origin + -(-(self.position - self.origin) // step) * step
        if here + size > self.end:
            raise CdrError(f"ends at byte {self.end}, need {here + size}")
        self.position = here + size
        return here


def _element(kind: Many) -> Kind:
    """Return what an array of several dimensions is made of."""
    of = kind.of
    while isinstance(of, Many) and of.size is not None:
        of = of.of
    return of


def _text(path: Path) -> str:
    return ".".join(map(str, path))
