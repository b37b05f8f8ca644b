"""MESSAGES -> COLUMNS: which numbers the messages of a topic hold, and their values.

A field is a dotted path with indices, ``pose.pose.position.x`` or ``data[3]``; a quaternion asked for as a
whole gives its four parts, ``orientation`` -> ``orientation.x`` ... ``orientation.w``. Message definitions
come from the log, else from the standard ROS 2 types and from ``definitions/``. Where a message holds no
stamp of its own, the time at which the sender published it stands for one, if the recorder kept it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ident.logs import cdr
from ident.logs.idl import idl_schema
from ident.logs.json_messages import JsonDecoder
from ident.logs.payloads import Payloads
from ident.logs.record import Channel, Columns, FieldError, Stored, Times
from ident.logs.schema import Kind, Many, Number, Schema, Struct, Text, normal, ros_schema, standard_schema
from ident.results import Damage
from ident.yaml_file import nearest

QUATERNION = "geometry_msgs/msg/Quaternion"
STAMPS = ("header.stamp", "stamp")
MAX_DEPTH = 12
MAX_ELEMENTS = 16
MOST_LISTED = 20_000
LOST = "its data lie in a damaged part of the file"
_STEP = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)((?:\[\d{1,9}\])*)")


class Decoder(Protocol):
    """What reads the messages of one topic."""

    def fields(self) -> dict[str, str]:
        """Return the paths of all numbers, with their types; of an array, the first elements."""
        ...

    def expand(self, name: str) -> list[str]:
        """Check that ``name`` is a number, or a quaternion, which gives four."""
        ...

    def columns(self, stored: Stored, fields: Sequence[str]) -> Columns:
        """Pick these fields out of all messages."""
        ...


def make_decoder(channel: Channel, stored: Callable[[], Stored]) -> Decoder:
    """Return what decodes a channel.

    Parameters
    ----------
    stored : reads its messages, for encodings that have no definition

    Raises
    ------
    FieldError
        If its encoding or its definition cannot be used.
    """
    if channel.encoding == "json":
        return JsonDecoder(channel.type, stored())
    return BinaryDecoder(channel)


class BinaryDecoder:
    """Decodes CDR and ROS 1 messages of one type; ``FieldError`` where its definition cannot be used."""

    def __init__(self, channel: Channel) -> None:
        if channel.encoding not in {"cdr", "ros1"}:
            raise FieldError(f"message encoding {channel.encoding!r} is not read")
        self._encoding = cdr.ROS1 if channel.encoding == "ros1" else None
        self._schema = _schema(channel)
        self.type = normal(channel.type)
        self._resolved: dict[str, Kind] = {}
        self._stamp = next((path for path in STAMPS if self._is_stamp(path)), None)

    def is_like(self, other: BinaryDecoder) -> bool:
        """Whether messages are decoded alike."""
        return self._encoding == other._encoding and self._schema == other._schema

    def fields(self) -> dict[str, str]:
        """Return the paths of all numbers, with their types; of an array, the first elements."""
        return dict(self._numbers("", Struct(self._schema.root)))

    def columns(self, stored: Stored, fields: Sequence[str]) -> Columns:
        """Read these fields of all messages."""
        names = {_steps(name): name for field in fields for name in self.expand(field)}
        parts = [f"{self._stamp}.sec", f"{self._stamp}.nanosec"] if self._stamp else []
        payloads = Payloads.of(stored.data)
        present = payloads.present
        read = cdr.read_columns(
            payloads.kept(),
            self._schema,
            {path: self._type_of(name) for path, name in names.items()},
            {_steps(name): self._type_of(name) for name in parts},
            self._encoding,
        )
        errors = [LOST] * int(np.count_nonzero(~present)) + read.errors
        good = slice(None) if read.good.all() else read.good
        kept = slice(None) if not errors else np.flatnonzero(present)[read.good]
        return Columns(
            stored.times[kept],
            self._stamps([read.whole[_steps(name)][good] for name in parts], stored, kept),
            {name: read.columns[path][good] for path, name in names.items()},
            [Damage(f"cannot be decoded: {errors[0]}", len(errors))] if errors else [],
        )

    def expand(self, name: str) -> list[str]:
        """Check that ``name`` is a number, or a quaternion, which gives four."""
        kind = self._resolve(name)
        if isinstance(kind, Number):
            return [name]
        if isinstance(kind, Struct):
            if normal(kind.name) == QUATERNION:
                return [f"{name}.{part}" for part in "xyzw"]
            what = normal(kind.name)
            raise FieldError(f"field {name!r} is a {what}, need one of its numbers: {self._below(name)}")
        if isinstance(kind, Text):
            raise FieldError(f"field {name!r} of {self.type} is text, need a number")
        raise FieldError(f"field {name!r} is an array, need one of its elements: '{name}[0]'")

    def _stamps(self, parts: Sequence[Times], stored: Stored, kept: NDArray[np.intp] | slice) -> Times | None:
        if parts:
            return parts[0] * 1_000_000_000 + parts[1]
        return None if stored.published is None else stored.published[kept]

    # --- types ------------------------------------------------------------------------------------

    def _type_of(self, name: str) -> str:
        kind = self._resolve(name)
        return kind.type if isinstance(kind, Number) else ""

    def _resolve(self, name: str) -> Kind:
        """Return what a path leads to; long logs are decoded in many pieces, which ask for it again."""
        if name not in self._resolved:
            self._resolved[name] = self._follow(name)
        return self._resolved[name]

    def _follow(self, name: str) -> Kind:
        found: Kind = Struct(self._schema.root)
        for step in name.split("."):
            match = _STEP.fullmatch(step)
            if match is None:
                raise FieldError(f"field {name!r} is not a path such as 'pose.position.x' or 'data[3]'")
            found = self._member(found, match[1], name)
            for index in re.findall(r"\d+", match[2]):
                if not isinstance(found, Many):
                    raise FieldError(f"field {name!r} of {self.type} is no array: leave out the index")
                if found.size is not None and int(index) >= found.size:
                    raise FieldError(f"field {name!r} of {self.type} has {found.size} elements")
                found = found.of
        return found

    def _member(self, owner: Kind, name: str, path: str) -> Kind:
        if not isinstance(owner, Struct):
            raise FieldError(f"field {path!r} of {self.type} has nothing named {name!r}")
        members = {member.name: member.kind for member in self._schema.types[owner.name]}
        if name not in members:
            raise FieldError(f"{normal(owner.name)} has no field {name!r}, {nearest(name, members)}")
        return members[name]

    def _below(self, name: str) -> str:
        found = [path for path, _ in self._numbers(name + ".", self._resolve(name))]
        return ", ".join(found[:6]) + (", ..." if len(found) > 6 else "")

    def _numbers(self, prefix: str, kind: Kind) -> Iterator[tuple[str, str]]:
        """List the numbers below a path; of a type with more than anyone can choose from, the first."""
        return self._walk(prefix, kind, 0, iter(range(MOST_LISTED)))

    def _walk(self, prefix: str, kind: Kind, depth: int, left: Iterator[int]) -> Iterator[tuple[str, str]]:
        if next(left, None) is None:
            return
        if isinstance(kind, Number):
            yield prefix.rstrip("."), kind.type
        elif isinstance(kind, Struct) and depth < MAX_DEPTH:
            for member in self._schema.types[kind.name]:
                yield from self._walk(f"{prefix}{member.name}.", member.kind, depth + 1, left)
        elif isinstance(kind, Many) and kind.size is not None:
            for index in range(min(kind.size, MAX_ELEMENTS)):
                yield from self._walk(f"{prefix.rstrip('.')}[{index}].", kind.of, depth + 1, left)

    def _is_stamp(self, path: str) -> bool:
        try:
            kind = self._resolve(path)
            parts = [self._resolve(f"{path}.{part}") for part in ("sec", "nanosec")]
        except FieldError:
            return False
        whole = all(isinstance(part, Number) and "int" in part.type for part in parts)
        return whole and isinstance(kind, Struct) and len(self._schema.types[kind.name]) == 2


def _schema(channel: Channel) -> Schema:
    if channel.schema is not None:
        return channel.schema.check()
    if not channel.definition:
        return standard_schema(channel.type)
    if channel.definition_format in {"ros2msg", "ros1msg"}:
        return ros_schema(channel.type, channel.definition, ros1=channel.encoding == "ros1")
    if channel.definition_format in {"omgidl", "ros2idl"}:
        return idl_schema(channel.type, channel.definition)
    raise FieldError(f"message definition in {channel.definition_format!r} is not read")


@lru_cache(maxsize=1 << 14)
def _steps(name: str) -> cdr.Path:
    """Split ``a.b[2]`` into ("a", "b", 2)."""
    return tuple(int(step) if step.isdigit() else step for step in re.findall(r"\w+", name))
