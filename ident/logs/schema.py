"""MESSAGE DEFINITIONS -> SCHEMA: what a message is made of, whatever language it was written in.

Names are those of ROS 2: ``a::b::dds_::C_`` and ``a/b/C`` are the same type, ``pkg/C`` is ``pkg/msg/C``.
What a definition refers to and does not hold is looked up in the standard ROS 2 types and in
``definitions/``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ident.logs.record import FieldError

EMPTY_STRUCT = "structure_needs_at_least_one_member"
_ROS_NUMBERS = {"char": "uint8", "octet": "uint8"}


@dataclass(frozen=True)
class Number:
    """A number, by its numpy type; ``enum``: the value of one of several names, or the bits of a mask."""

    type: str
    enum: bool = False


@dataclass(frozen=True)
class Text:
    """A string of bytes."""


@dataclass(frozen=True)
class Unknown:
    """What cannot be read; messages that hold one are refused with this reason."""

    reason: str


@dataclass(frozen=True)
class Struct:
    """A type of the schema, by its name."""

    name: str


@dataclass(frozen=True)
class Many:
    """Several of one kind: ``size`` of them, or None where each message says how many."""

    of: Kind
    size: int | None = None


Kind = Number | Text | Struct | Many | Unknown


@dataclass(frozen=True)
class Member:
    """One field of a type; an optional one may be absent from a message.

    id : number of the member in parameter lists, None where the definition gives none
    """

    name: str
    kind: Kind
    optional: bool = False
    id: int | None = None


@dataclass(frozen=True)
class Schema:
    """All types that a message needs.

    types : name -> members in their order
    delimited : types before which XCDR2 writes their length (appendable ones)
    mutable : types that are written as a parameter list
    """

    root: str
    types: Mapping[str, Sequence[Member]]
    delimited: frozenset[str] = field(default_factory=frozenset)
    mutable: frozenset[str] = field(default_factory=frozenset)

    def check(self) -> Schema:
        """Return itself; ``FieldError`` where it holds what cannot be read."""
        for name in self._used():
            if name not in self.types:
                raise FieldError(f"definition of {self.root} is incomplete: {name} is not defined")
            numbers = [member.id for member in self.types[name]]
            if name in self.mutable and len(set(numbers)) < len(numbers):
                raise FieldError(
                    f"{name}: two of its members have the same id, a mutable type needs different ones"
                )
            for member in self.types[name]:
                inner = innermost(member.kind)
                if isinstance(inner, Unknown):
                    raise FieldError(f"{name}.{member.name}: {inner.reason}")
        return self

    def _used(self) -> Iterator[str]:
        names, seen = [self.root], {self.root}
        while names:
            name = names.pop()
            yield name
            for kind in map(innermost, (member.kind for member in self.types.get(name, ()))):
                if isinstance(kind, Struct) and kind.name not in seen:
                    seen.add(kind.name)
                    names.append(kind.name)


def innermost(kind: Kind) -> Kind:
    """Return what an array (of arrays) is made of."""
    while isinstance(kind, Many):
        kind = kind.of
    return kind


def normal(name: str) -> str:
    """Return the name of a type as ROS 2 writes it."""
    parts = [part for part in name.replace("::", "/").split("/") if part]
    if "dds_" in parts[:-1]:
        parts = [part for part in parts if part != "dds_"]
        parts[-1] = parts[-1].removesuffix("_")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else "/".join(parts)


# --- ROS ------------------------------------------------------------------------------------------


@lru_cache(maxsize=1024)
def ros_schema(kind: str, text: str, *, ros1: bool = False) -> Schema:
    """Read a message definition of ROS 2 or ROS 1, with the types that follow it.

    Raises
    ------
    FieldError
        If it cannot be read, or refers to a type that is not defined.
    """
    # A recorder of DDS writes "MSG: fastdds/pkg/msg/Type" and refers to pkg/msg/Type.
    text = re.sub(r"^MSG: fastdds/", "MSG: ", text, flags=re.MULTILINE)
    name = normal(kind)
    full = name if "/" in name else f"dds/msg/{name}"
    try:
        found = get_types_from_msg(text, full)
    except (TypesysError, RecursionError, ValueError, AssertionError) as error:
        raise FieldError(
            f"definition of {kind} cannot be read as {'ros1msg' if ros1 else 'ros2msg'}"
        ) from error
    types = {key: _members(members, ros1=ros1) for key, (_, members) in found.items()}
    return _completed(next(iter(types)), types, ros1=ros1)


@lru_cache(maxsize=1024)
def standard_schema(kind: str) -> Schema:
    """Return the definition of a type that ROS 2 comes with, or that ``definitions/`` holds.

    Raises
    ------
    FieldError
        If the type is not known.
    """
    name = normal(kind)
    if not any(name in store.fielddefs for store in _standard_stores()):
        raise FieldError(f"type {kind!r} is not known and the log holds no definition of it")
    return _completed(name, {}, ros1=False)


def _completed(root: str, types: dict[str, list[Member]], *, ros1: bool) -> Schema:
    """Add the types that are referred to and missing, where they are standard ones."""
    names, seen = [root], {root}
    while names:
        name = names.pop()
        store = next((store for store in _standard_stores() if name in store.fielddefs), None)
        if name not in types and store is not None:
            types[name] = _members(store.fielddefs[name][1], ros1=ros1)
        for kind in map(innermost, (member.kind for member in types.get(name, ()))):
            if isinstance(kind, Struct) and kind.name not in seen:
                seen.add(kind.name)
                names.append(kind.name)
    return Schema(root, types).check()


def _members(found: Sequence[tuple[str, tuple[Any, Any]]], *, ros1: bool) -> list[Member]:
    """Fields of a type; for one without any ROS 2 writes a byte, ROS 1 nothing."""
    members = [Member(name, _kind(desc, ros1=ros1)) for name, desc in found if name != EMPTY_STRUCT]
    return members if members or ros1 else [Member(EMPTY_STRUCT, Number("uint8"))]


def _kind(desc: tuple[Any, Any], *, ros1: bool) -> Kind:
    node, rest = desc
    if node == Nodetype.NAME:
        return Struct(rest)
    if node == Nodetype.ARRAY:
        return Many(_kind(rest[0], ros1=ros1), rest[1])
    if node == Nodetype.SEQUENCE:
        return Many(_kind(rest[0], ros1=ros1))
    return _base_kind(rest[0], ros1=ros1)


def _base_kind(name: str, *, ros1: bool) -> Kind:
    if name == "string":
        return Text()
    if name in {"wstring", "wchar", "float128"}:
        return Unknown(f"{name} is not read: its length differs between writers")
    if name == "byte":  # ROS 1: another name of int8; ROS 2: an octet
        return Number("int8" if ros1 else "uint8")
    return Number(_ROS_NUMBERS.get(name, name))


@lru_cache(maxsize=1)
def _standard_stores() -> tuple[Typestore, ...]:
    stores = tuple(get_typestore(name) for name in (Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY))
    for file in resources.files("ident.logs").joinpath("definitions").iterdir():
        first, _, text = file.read_text(encoding="utf-8").partition("\n")
        types = get_types_from_msg(text, first.removeprefix("MSG: "))
        for store in stores:
            store.register(types)
    return stores
