"""A file read at places, without a position of its own: threads share it, and nothing is mapped into memory.

What a file does not hold reads as less than was asked for, never as an error.
"""

from __future__ import annotations

import os
import threading
import weakref
from pathlib import Path
from typing import Self

import numpy as np

LEAST, MOST = 16 << 10, 1 << 20
MOST_SPARE = 64 << 20


class Source:
    """One file, open for reading at places."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        self._close = weakref.finalize(self, os.close, self._file)
        self.size = os.fstat(self._file).st_size
        self._own = threading.local()

    def read(self, place: int, size: int) -> bytes:
        """Read bytes from ``place`` on: fewer where the file ends."""
        size = max(min(size, self.size - place), 0)
        return os.pread(self._file, size, place) if size else b""

    def borrow(self, place: int, size: int) -> memoryview:
        """Read bytes into a buffer of this thread, which the next call overwrites."""
        return self.fill(self._kept("packed", max(min(size, self.size - place), 0)), place)

    def fill(self, target: memoryview, place: int) -> memoryview:
        """Read bytes from ``place`` on into ``target``: fewer where the file ends."""
        return target[: os.preadv(self._file, [target], place)] if len(target) else target

    def scratch(self, size: int) -> memoryview:
        """Return a buffer of this thread to unpack to, which the next call gives again."""
        return self._kept("unpacked", size)

    def _kept(self, name: str, size: int) -> memoryview:
        buffer: memoryview | None = getattr(self._own, name, None)
        if buffer is None or len(buffer) < size:
            buffer = np.empty(max(size, 5 * size // 4 if size < MOST_SPARE else 0), np.uint8).data
            setattr(self._own, name, buffer)
        return buffer[:size]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()


class Window:
    """Small reads that mostly go forward, from a piece of the file that is kept."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._place = 0
        self._data = b""
        self._reach = LEAST
        self.size = source.size

    def read(self, place: int, size: int) -> bytes:
        """Read bytes from ``place`` on: fewer where the file ends."""
        begin = place - self._place
        if begin >= 0 and begin + size <= len(self._data):
            return self._data[begin : begin + size]
        onward = 0 <= begin <= len(self._data)
        self._reach = min(2 * self._reach, MOST) if onward and self._data else LEAST
        self._place, self._data = place, self._source.read(place, max(size, self._reach))
        return self._data[:size]
