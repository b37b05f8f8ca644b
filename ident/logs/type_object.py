"""TYPE OBJECTS -> SCHEMA: types as DDS participants tell them to each other (DDS-XTypes 1.3, annex B).

A complete type object is itself an XCDR2 message: the kind and flags of the type, its header (base type and
name) and its members, each with a type identifier. An identifier of a type that is not built in is a hash,
which the recording lists beside each object.
"""

from __future__ import annotations

import base64
import binascii
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from ident.logs.record import FieldError
from ident.logs.schema import Kind, Many, Member, Number, Schema, Struct, Text, Unknown

COMPLETE, MINIMAL = 0xF2, 0xF1
ALIAS, ENUM, BITMASK, STRUCTURE = 0x30, 0x40, 0x41, 0x51
APPENDABLE, MUTABLE, OPTIONAL = 0x02, 0x04, 0x08
UNION = 0x52
HASH = 14
NO_BASE = Unknown("no type is not read")
_PRIMITIVES = {
    0x01: "bool", 0x02: "uint8", 0x03: "int16", 0x04: "int32", 0x05: "int64", 0x06: "uint16", 0x07: "uint32",
    0x08: "uint64", 0x09: "float32", 0x0A: "float64", 0x0C: "int8", 0x0D: "uint8", 0x10: "uint8",
}  # fmt: skip
_DEEPEST = 32


@dataclass(frozen=True)
class _Type:
    """A struct: what is its own, and the kind of its base, None where it has none."""

    members: list[Member]
    flags: int = 0
    base: Kind | None = None


@dataclass(frozen=True)
class TypeObjects:
    """All types of a recording by the text of their hash; ``names``: type name -> that text."""

    names: dict[str, str] = field(default_factory=dict)
    structs: dict[str, _Type] = field(default_factory=dict)
    others: dict[str, Kind] = field(default_factory=dict)

    def schema(self, name: str) -> Schema:
        """Return the definition of a type; ``FieldError`` where there is none."""
        if name not in self.names:
            raise FieldError(f"the recording holds no definition of {name}")
        called = {hashed: name for name, hashed in self.names.items()}
        types = {
            called.get(hashed, hashed): [
                replace(member, kind=self._resolved(member.kind, called, 0))
                for member in self._members(hashed, 0)
            ]
            for hashed in self.structs
        }
        delimited, mutable = (
            frozenset(
                called.get(hashed, hashed) for hashed, type_ in self.structs.items() if type_.flags & flag
            )
            for flag in (APPENDABLE, MUTABLE)
        )
        return Schema(called[self.names[name]], types, delimited, mutable)

    def _members(self, key: str, depth: int) -> list[Member]:
        """Members of a struct, those of its base first."""
        type_ = self.structs[key]
        if type_.base is None:
            return type_.members
        base = type_.base.name if isinstance(type_.base, Struct) else ""
        if base not in self.structs or depth >= _DEEPEST:
            return [Member("", Unknown("a type whose base the recording does not define is not read"))]
        return [*self._members(base, depth + 1), *type_.members]

    def _resolved(self, kind: Kind, called: dict[str, str], depth: int) -> Kind:
        """Follow enums and aliases, and name what is a struct."""
        if isinstance(kind, Many):
            return Many(self._resolved(kind.of, called, depth), kind.size)
        if not isinstance(kind, Struct):
            return kind
        if kind.name in self.others and depth < _DEEPEST:
            return self._resolved(self.others[kind.name], called, depth + 1)
        return Struct(called.get(kind.name, kind.name))


def read_type_objects(rows: Sequence[tuple[str, str, str]]) -> TypeObjects:
    """Read (name, identifier, object) of each type, the last two in base64; leave out what cannot be read."""
    names: dict[str, str] = {}
    structs: dict[str, _Type] = {}
    others: dict[str, Kind] = {}
    for name, identifier, data in rows:
        try:
            key = base64.b64decode(identifier, validate=True)[1 : 1 + HASH].hex()
            parser = _Parser(base64.b64decode(data, validate=True))
            read = parser.type_object()
        except (binascii.Error, struct.error, IndexError, UnicodeDecodeError, RecursionError):
            continue
        names[name] = key
        if isinstance(read, _Type):
            structs[key] = read
        else:
            others[key] = read
    return TypeObjects(names, structs, others)


class _Parser:
    """Reads little-endian XCDR2: numbers are aligned to 4 bytes at most."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def type_object(self) -> _Type | Kind:
        """Return a struct, or what stands for a type of another kind."""
        self._number("I")
        if self._number("B") != COMPLETE:
            return Unknown("only complete type objects are read")
        kind = self._number("B")
        flags = self._number("H")
        if kind == STRUCTURE:
            return self._struct(flags)
        if kind in {ENUM, BITMASK}:
            self._number("I")
            bits = self._number("H")
            size = next((size for size in (8, 16, 32) if bits <= size), 32 if kind == ENUM else 64)
            return Number(f"{'' if kind == ENUM else 'u'}int{size}", enum=True)
        if kind == ALIAS:
            self._at = self._end()
            self._number("I")
            self._number("H")
            return self._identifier(0)
        what = "a union" if kind == UNION else f"a type of kind {kind:#x}"
        return Unknown(f"{what} is not read")

    def _struct(self, flags: int) -> _Type:
        header = self._end()
        base = self._identifier(0)
        self._at = header
        self._number("I")
        members = [self._member() for _ in range(self._number("I"))]
        return _Type(members, flags, None if base == NO_BASE else base)

    def _member(self) -> Member:
        end = self._end()
        number = self._number("I")
        flags = self._number("H")
        kind = self._identifier(0)
        size = self._number("I")
        name = self._data[self._at : self._at + size - 1].decode("utf-8")
        self._at = end
        return Member(name, kind, bool(flags & OPTIONAL), number)

    def _identifier(self, depth: int) -> Kind:
        if depth > _DEEPEST:
            raise RecursionError
        kind = self._number("B")
        if not kind:
            return NO_BASE
        if kind in _PRIMITIVES:
            return Number(_PRIMITIVES[kind])
        if kind in {0x70, 0x71}:
            self._number("B" if kind == 0x70 else "I")
            return Text()
        if kind in {0x80, 0x81, 0x90, 0x91}:
            return self._collection(kind, depth)
        if kind in {COMPLETE, MINIMAL}:
            self._at += HASH
            return Struct(self._data[self._at - HASH : self._at].hex())
        return Unknown(f"a type of kind {kind:#x} is not read")

    def _collection(self, kind: int, depth: int) -> Kind:
        bound = "I" if kind & 1 else "B"
        self._number("B")
        self._number("H")
        if kind < 0x90:
            self._number(bound)
            return Many(self._identifier(depth + 1))
        sizes = [self._number(bound) for _ in range(self._number("I"))]
        found = self._identifier(depth + 1)
        for size in reversed(sizes):
            found = Many(found, size)
        return found

    def _end(self) -> int:
        """Read the length of what follows; return where it ends."""
        size = self._number("I")
        return self._at + size

    def _number(self, code: str) -> int:
        size = struct.calcsize("<" + code)
        self._at = -(-self._at // size) * size
        (value,) = struct.unpack_from("<" + code, self._data, self._at)
        self._at += size
        return int(value)
