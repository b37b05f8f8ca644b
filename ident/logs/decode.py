"""CDR MESSAGES -> COLUMNS: decode the messages of a topic and pick numbers out of them.

A field is a dotted path with indices, ``pose.pose.position.x`` or ``data[3]``; a quaternion asked for as a
whole gives its four parts, ``orientation`` -> ``orientation.x`` ... ``orientation.w``. Message definitions
come from the log, else from the standard ROS 2 types and from ``definitions/``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from importlib import resources
from operator import attrgetter
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import Typestore

from ident.logs.record import Channel, Columns, FieldError, Stored, Times
from ident.results import Damage
from ident.yaml_file import nearest

QUATERNION = "geometry_msgs/msg/Quaternion"
STAMPS = ("header.stamp", "stamp")
MAX_DEPTH = 12
MAX_ELEMENTS = 16
_STEP = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)((?:\[\d+\])*)")
_TEXT = {"string", "wstring", "wchar"}

FieldType = tuple[Any, Any]


class Decoder:
    """Decodes the messages of one type; ``FieldError`` where its definition cannot be used."""

    def __init__(self, channel: Channel) -> None:
        if channel.encoding != "cdr":
            raise FieldError(f"message encoding {channel.encoding!r} is not read yet")
        self.type = _normal(channel.type)
        self._store, self._name = _typestore(self.type, channel.definition, channel.definition_format)
        self._stamp = next((path for path in STAMPS if self._is_stamp(path)), None)

    def fields(self) -> dict[str, str]:
        """Return the paths of all numbers, with their types; of an array, the first elements."""
        return dict(self._walk("", (Nodetype.NAME, self._name), 0))

    def columns(self, stored: Stored, fields: Sequence[str]) -> Columns:
        """Decode each message once and pick these fields out of it."""
        paths = [path for name in fields for path in self.expand(name)]
        getters = [_getter(path) for path in paths]
        stamp = attrgetter(f"{self._stamp}.sec", f"{self._stamp}.nanosec") if self._stamp else None
        kept: list[int] = []
        rows: list[list[float]] = []
        stamps: list[tuple[int, int]] = []
        errors: list[str] = []
        for index, message in enumerate(self._messages(stored, errors)):
            if message is None:
                continue
            kept.append(index)
            rows.append([getter(message) for getter in getters])
            if stamp:
                stamps.append(stamp(message))
        table = np.array(rows, dtype=np.float64).reshape(len(rows), len(paths))
        return Columns(
            stored.times[np.array(kept, dtype=np.intp)],
            _nanoseconds(stamps) if stamp else None,
            {path: np.ascontiguousarray(table[:, i]) for i, path in enumerate(paths)},
            [Damage(f"cannot be decoded: {errors[0]}", len(errors))] if errors else [],
        )

    def expand(self, name: str) -> list[str]:
        """Check that ``name`` is a number, or a quaternion, which gives four."""
        kind, rest = self._resolve(name)
        if kind == Nodetype.BASE and rest[0] not in _TEXT:
            return [name]
        if kind == Nodetype.NAME and rest == QUATERNION:
            return [f"{name}.{part}" for part in "xyzw"]
        if kind == Nodetype.BASE:
            raise FieldError(f"field {name!r} of {self.type} is text, need a number")
        if kind == Nodetype.NAME:
            raise FieldError(f"field {name!r} is a {rest}, need one of its numbers: {self._below(name)}")
        raise FieldError(f"field {name!r} is an array, need one of its elements: '{name}[0]'")

    # --- types ------------------------------------------------------------------------------------

    def _resolve(self, name: str) -> FieldType:
        found: FieldType = (Nodetype.NAME, self._name)
        for step in name.split("."):
            match = _STEP.fullmatch(step)
            if match is None:
                raise FieldError(f"field {name!r} is not a path such as 'pose.position.x' or 'data[3]'")
            found = self._member(found, match[1], name)
            for _ in re.findall(r"\[\d+\]", match[2]):
                if found[0] not in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
                    raise FieldError(f"field {name!r} of {self.type} is no array: leave out the index")
                found = found[1][0]
        return found

    def _member(self, owner: FieldType, name: str, path: str) -> FieldType:
        if owner[0] != Nodetype.NAME:
            raise FieldError(f"field {path!r} of {self.type} has nothing named {name!r}")
        members = dict(self._members(owner[1]))
        if name not in members:
            raise FieldError(f"{owner[1]} has no field {name!r}, {nearest(name, members)}")
        return members[name]

    def _members(self, kind: str) -> list[tuple[str, FieldType]]:
        return list(self._store.fielddefs[kind][1])

    def _below(self, name: str) -> str:
        found = [path for path, _ in self._walk(name + ".", self._resolve(name), 0)]
        return ", ".join(found[:6]) + (", ..." if len(found) > 6 else "")

    def _walk(self, prefix: str, kind: FieldType, depth: int) -> Iterator[tuple[str, str]]:
        if kind[0] == Nodetype.BASE:
            if kind[1][0] not in _TEXT:
                yield prefix.rstrip("."), kind[1][0]
        elif kind[0] == Nodetype.NAME and depth < MAX_DEPTH:
            for name, member in self._members(kind[1]):
                yield from self._walk(f"{prefix}{name}.", member, depth + 1)
        elif kind[0] == Nodetype.ARRAY:
            inner, size = kind[1]
            for index in range(min(size, MAX_ELEMENTS)):
                yield from self._walk(f"{prefix.rstrip('.')}[{index}].", inner, depth + 1)

    def _is_stamp(self, path: str) -> bool:
        try:
            return self._resolve(path) == (Nodetype.NAME, "builtin_interfaces/msg/Time")
        except FieldError:
            return False

    # --- messages ---------------------------------------------------------------------------------

    def _messages(self, stored: Stored, errors: list[str]) -> Iterator[Any]:
        """Yield each message decoded, None for those that cannot be, whose reasons go into ``errors``."""
        read, kind = self._store.deserialize_cdr, self._name
        for data in stored.data:
            if data is None:
                errors.append("its data lie in a damaged part of the file")
                yield None
                continue
            try:
                message = read(data, kind)
            except (SerdeError, IndexError, AssertionError, OverflowError, MemoryError) as error:
                errors.append(_explain(data, error))
                message = None
            yield message


def _nanoseconds(stamps: list[tuple[int, int]]) -> Times:
    parts = np.array(stamps, dtype=np.int64).reshape(-1, 2)
    return parts[:, 0] * 1_000_000_000 + parts[:, 1]


def _explain(data: bytes, error: Exception) -> str:
    head = data[:2].hex()
    if head not in {"0000", "0001"}:
        return f"CDR encapsulation {head} is not read yet"
    return " ".join(str(error).split())


def _getter(path: str) -> Callable[[Any], float]:
    """Return a function that picks a field out of a decoded message; NaN beyond a sequence's end."""
    steps: list[Callable[[Any], Any]] = []
    for name, indices in _STEP.findall(path):
        steps.append(attrgetter(normalize_fieldname(name)))
        steps += [_element(int(index)) for index in re.findall(r"\d+", indices)]
    if "[" not in path:
        return attrgetter(".".join(normalize_fieldname(name) for name in path.split(".")))

    def get(message: Any) -> float:
        for step in steps:
            message = step(message)
            if message is None:
                return np.nan
        return float(message)

    return get


def _element(index: int) -> Callable[[Any], Any]:
    return lambda sequence: sequence[index] if index < len(sequence) else None


# --- definitions ----------------------------------------------------------------------------------


def _normal(kind: str) -> str:
    parts = kind.replace("::", "/").split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else "/".join(parts)


@lru_cache(maxsize=1024)
def _typestore(kind: str, definition: str, definition_format: str) -> tuple[Typestore, str]:
    """Return a store that knows a type, and the name that it has in there."""
    if not definition:
        return _standard_store_with(kind), kind
    if definition_format != "ros2msg":
        raise FieldError(f"message definition in {definition_format!r} is not read yet")
    try:
        types = get_types_from_msg(definition, kind)
    except (TypesysError, RecursionError, ValueError) as error:
        raise FieldError(f"definition of {kind} cannot be read as {definition_format}") from error
    name = next(iter(types))
    for base in (get_typestore(Stores.EMPTY), get_typestore(Stores.ROS2_HUMBLE)):
        try:
            base.register(types)
            base.get_msgdef(name)
        except (TypesysError, KeyError, SyntaxError, RecursionError) as error:
            problem = error
            continue
        return base, name
    raise FieldError(f"definition of {kind} is incomplete: {_shorten(problem)}")


def _standard_store_with(kind: str) -> Typestore:
    for name in (Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY):
        store = get_typestore(name)
        for file in resources.files("ident.logs").joinpath("definitions").iterdir():
            first, _, text = file.read_text(encoding="utf-8").partition("\n")
            store.register(get_types_from_msg(text, first.removeprefix("MSG: ")))
        if kind in store.fielddefs:
            return store
    raise FieldError(f"type {kind!r} is not known and the log holds no definition of it")


def _shorten(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= 160 else text[:157] + "..."
