"""JSON MESSAGES -> COLUMNS: messages that some recorders keep as text.

JSON has no definition: the fields of a topic are those found in its first messages, and a field is had where
any of these holds a number there.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ident.logs.record import Columns, FieldError, Stored
from ident.results import Damage
from ident.yaml_file import nearest

LOOKED_AT = 100
MAX_ELEMENTS = 16
MAX_DEPTH = 12
STAMPS = ("header.stamp", "stamp")


class JsonDecoder:
    """Decodes the JSON messages of one topic."""

    def __init__(self, kind: str, stored: Stored) -> None:
        self.type = kind
        self._fields: dict[str, str] = {}
        for message in filter(None, map(_object, stored.data[:LOOKED_AT])):
            self._fields.update(_numbers("", message, 0))
        if not self._fields and any(stored.data):
            raise FieldError("its JSON holds no numbers")
        whole = [
            path
            for path in STAMPS
            if all(self._fields.get(f"{path}.{p}") == "int" for p in ("sec", "nanosec"))
        ]
        self._stamp = whole[0] if whole else None

    def fields(self) -> dict[str, str]:
        """Return the paths of all numbers, with their types; of a list, the first elements."""
        return dict(self._fields)

    def expand(self, name: str) -> list[str]:
        """Check that ``name`` is a number, or has the four of a quaternion."""
        if name in self._fields or re.fullmatch(r".+\[\d{1,9}\]", name):
            return [name]
        below = [path for path in self._fields if path.startswith(f"{name}.")]
        parts = [f"{name}.{part}" for part in "xyzw"]
        if sorted(below) == sorted(parts):
            return parts
        if below:
            raise FieldError(f"field {name!r} is no number, need one of its numbers: {', '.join(below[:6])}")
        raise FieldError(f"{self.type} has no number {name!r}, {nearest(name, self._fields)}")

    def columns(self, stored: Stored, fields: Sequence[str]) -> Columns:
        """Pick these fields out of all messages; NaN where a message holds no number there."""
        paths = [path for name in fields for path in self.expand(name)]
        messages = [_object(data) for data in stored.data]
        kept = np.array(
            [index for index, message in enumerate(messages) if message is not None], dtype=np.intp
        )
        read = [messages[index] for index in kept]
        values = {path: np.array([_number(message, path) for message in read], float) for path in paths}
        lost = len(messages) - len(kept)
        damage = [Damage("cannot be decoded: is no JSON object", lost)] if lost else []
        stamps = None if stored.published is None else stored.published[kept]
        if self._stamp:
            pairs = [_stamp(message, self._stamp) for message in read]
            stamps = np.array(pairs, dtype=np.int64)
        return Columns(stored.times[kept], stamps, values, damage)


def _object(data: bytes | None) -> dict[str, Any] | None:
    try:
        found = json.loads(data) if data is not None else None
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _numbers(prefix: str, value: object, depth: int) -> Iterator[tuple[str, str]]:
    if isinstance(value, (bool, int, float)):
        yield prefix, type(value).__name__
    elif isinstance(value, dict) and depth < MAX_DEPTH:
        for key, inner in value.items():
            if re.fullmatch(r"\w+", key):
                yield from _numbers(f"{prefix}.{key}" if prefix else key, inner, depth + 1)
    elif isinstance(value, list) and depth < MAX_DEPTH:
        for index, inner in enumerate(value[:MAX_ELEMENTS]):
            yield from _numbers(f"{prefix}[{index}]", inner, depth + 1)


def _found(message: object, path: str) -> object:
    for step in re.findall(r"\w+", path):
        if isinstance(message, list):
            message = message[int(step)] if step.isdigit() and int(step) < len(message) else None
        else:
            message = message.get(step) if isinstance(message, dict) else None
    return message


def _number(message: object, path: str) -> float:
    value = _found(message, path)
    if not isinstance(value, (bool, int, float)):
        return np.nan
    try:
        return float(value)
    except OverflowError:
        return np.nan


def _stamp(message: object, path: str) -> int:
    """Stamp of a message [ns], 0 where it holds none."""
    sec, nanosec = (_found(message, f"{path}.{part}") for part in ("sec", "nanosec"))
    if isinstance(sec, int) and isinstance(nanosec, int) and abs(sec) < 1 << 33:
        return sec * 1_000_000_000 + nanosec % 1_000_000_000
    return 0
