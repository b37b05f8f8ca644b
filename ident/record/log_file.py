"""MCAP, written so that what was recorded can be read at any moment, also after the recorder was killed.

A chunk is closed and handed to the system at each ``flush``; whoever opens the file then finds every message
up to there, only without summary (https://mcap.dev/spec). Definitions stand before the first message of their
channel. What is known of the recording as a whole (samples lost, topics whose losses are not counted, writers
refused) is a metadata record named ``ident.record``, written whenever it has changed; the last one holds.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

from mcap.writer import CompressionType, Writer

from ident import __version__
from ident.errors import IdentError, UsageError

METADATA = "ident.record"
_MOST = (1 << 63) - 1


class LogFile:
    """One file that is being written.

    Raises
    ------
    UsageError
        If it exists and ``overwrite`` is not said, is no ``.mcap``, or cannot be made.
    """

    def __init__(self, path: Path, *, overwrite: bool) -> None:
        self.path = path
        self.bytes = 0
        self.messages = 0
        if path.suffix != ".mcap":
            raise UsageError(f"{path}: recordings are MCAP: give --out a name that ends in .mcap")
        try:
            self._file = path.open("wb" if overwrite else "xb")
        except FileExistsError:
            raise UsageError(
                f"{path} exists and stays as it is: give another --out, or say --overwrite"
            ) from None
        except OSError as error:
            raise UsageError(f"cannot write {path}: {error.strerror or error}: give another --out") from error
        self._writer: Any = Writer(self._file, compression=CompressionType.ZSTD)
        self._metadata: dict[str, str] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._fresh = False
        try:
            with self._told():
                self._writer.start(library=f"ident {__version__}")
                self._file.flush()
        except IdentError:
            self._abandon()
            raise

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the summary and close the file; where writing has failed, close what is there."""
        if kind is not None and issubclass(kind, DiskError):
            self._abandon()
            return
        try:
            with self._told():
                self._writer.finish()
                self._file.flush()
                with contextlib.suppress(OSError):  # a pipe or a device has nothing to be forced to
                    os.fsync(self._file.fileno())
        finally:
            self._abandon()

    def channel(self, topic: str, kind: str, idl: str, told: Mapping[str, str]) -> int:
        """Add a topic with the definition of its type; return its number."""
        key = (kind, idl)
        with self._told():
            if key not in self._schemas:
                self._schemas[key] = self._writer.register_schema(kind, "omgidl", idl.encode())
            return int(self._writer.register_channel(topic, "cdr", self._schemas[key], dict(told)))

    def write(self, channel: int, data: bytes, *, received: int, sent: int | None, number: int) -> None:
        """Add a message.

        Parameters
        ----------
        received, sent : when it arrived and when its writer stamped it [ns]; where that is not known, the log
            holds the first for both
        number : of the message in its channel
        """
        published = received if sent is None or not 0 < sent <= _MOST else sent
        with self._told():
            self._writer.add_message(channel, received, data, published, number & 0xFFFFFFFF)
        self.messages += 1
        self.bytes += len(data)
        self._fresh = True

    def flush(self, metadata: Mapping[str, str]) -> None:
        """Make what was written readable for others; ``metadata``: what is known of the recording by now."""
        with self._told():
            if self._fresh:
                self._writer.flush()
                self._fresh = False
            if metadata != self._metadata:
                self._metadata = dict(metadata)
                self._writer.add_metadata(METADATA, self._metadata)
                self._file.flush()

    def _abandon(self) -> None:
        with contextlib.suppress(OSError):
            self._file.close()

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise DiskError(
                f"cannot write on to {self.path}: {error.strerror or error}: it holds what was written "
                f"before (about {self.messages} messages); make room, or give another --out"
            ) from error


class DiskError(UsageError):
    """The disk took no more."""
