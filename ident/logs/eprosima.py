"""DDS recordings of eProsima's Record & Replay in SQLite (``.db``).

Table Messages holds the CDR with its encapsulation (``data_cdr``), the same as JSON (``data_json``; either
may be missing) and times as text to the nanosecond, in UTC. The first of these definitions of a type is used
that the first message fits: an IDL file (``*.idl``) beside the recording, the recording's own type objects
(it keeps none of nested types), the standard ROS 2 types. Where there is none, the JSON is read. ``format``
says which of them served. Topics and types of ROS 2 get their ROS names: ``rt/chatter`` is ``/chatter``.
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ident.errors import UnusableLog
from ident.logs.cdr import CdrError, encoding_of, find_layout
from ident.logs.damage import Loss, summarise
from ident.logs.idl import idl_schema, idl_text_beside
from ident.logs.record import Channel, ChannelByChannel, FieldError, Stored, Times
from ident.logs.schema import Schema, normal, standard_schema
from ident.logs.sqlite_file import UNREADABLE, Row, SqliteFile, walk_rows
from ident.logs.type_object import TypeObjects, read_type_objects
from ident.results import Damage

_TIME = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(\.\d{1,9})?")


class EprosimaStorage(ChannelByChannel):
    """One recording (see ``ident.logs.record.Storage``)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = SqliteFile(path)
        self.files = self._file.files
        losses: list[Loss] = []
        with closing(self._file.connect()) as database:
            try:
                rows = list(walk_rows(database, _select_rows, losses))
            except UNREADABLE as error:
                raise UnusableLog(f"{path}: not a DDS recording that can be read ({error})") from error
            types = _read_types(database)
        self.damage = [*self._file.damage, *summarise(path.name, losses, unit="row")]
        self._rows = self._take_rows(rows)
        self._idl = idl_text_beside(path)
        self.channels = [self._channel(topic, kind, types) for topic, kind in self._rows]
        self._numbers = {id(c): key for c, key in zip(self.channels, self._rows, strict=True)}
        used = dict.fromkeys(channel.definition_format for channel in self.channels)
        self.format = f"eprosima sqlite ({', '.join(used)})" if used else "eprosima sqlite"

    def times(self, channel: Channel) -> Times:
        """Log times of a channel [ns], in the order in which they were recorded."""
        return self._rows[self._numbers[id(channel)]][:, 1]

    def messages(self, channel: Channel) -> Stored:
        """Read the messages of a channel, in the order in which they were recorded."""
        rows = self._rows[self._numbers[id(channel)]]
        column = "CAST(data_json AS BLOB)" if channel.encoding == "json" else "CAST(data_cdr AS BLOB)"
        query = f"SELECT {column} FROM Messages WHERE rowid = ?"  # noqa: S608 one of two literals
        with closing(self._file.connect()) as database:
            data = [_fetch(database, query, int(number)) for number in rows[:, 0]]
        return Stored(rows[:, 1], data, rows[:, 2])

    def close(self) -> None:
        """Remove the temporary copy, if one was made."""
        self._file.close()

    def _take_rows(self, rows: list[Row]) -> dict[tuple[str, str], NDArray[np.int64]]:
        """Sort the rows by topic and type: row number, log time and publish time [ns]."""
        found: dict[tuple[str, str], list[tuple[int, int, int]]] = {}
        wrong = 0
        for number, topic, kind, logged, published in rows:
            time, sent = _nanoseconds(logged), _nanoseconds(published)
            if time is None:
                wrong += 1
                continue
            found.setdefault((str(topic), str(kind)), []).append((number, time, 0 if sent is None else sent))
        if wrong:
            self.damage.append(Damage(f"{self.path.name}: messages whose log time is no time", wrong))
        return {key: np.array(each, dtype=np.int64) for key, each in found.items()}

    def _channel(self, topic: str, kind: str, types: TypeObjects) -> Channel:
        name = topic.removeprefix("rt") if topic.startswith("rt/") and "::dds_::" in kind else topic
        sources: dict[str, Callable[[], Schema]] = {
            "types from the IDL beside it": lambda: idl_schema(kind, self._idl),
            "types from the recording": lambda: types.schema(kind).check(),
            "standard ROS 2 types": lambda: standard_schema(kind),
        }
        first, text = self._first("data_cdr", topic, kind), self._first("data_json", topic, kind)
        for source, read in sources.items():
            try:
                schema = read()
                if first is not None:
                    find_layout(first, schema, {}, encoding_of(first))
                    return Channel(name, normal(kind), "cdr", "", source, schema)
            except (FieldError, CdrError):
                continue
        if text is not None:
            return Channel(name, normal(kind), "json", "", "messages from JSON")
        return Channel(name, normal(kind), "cdr", "", "types unknown")

    def _first(self, column: str, topic: str, kind: str) -> bytes | None:
        """Return the first message that can be read, by which a definition is tried."""
        column = f"CAST({column} AS BLOB)"
        query = f"SELECT {column} FROM Messages WHERE topic = ? AND type = ? AND {column} > x'' LIMIT 1"  # noqa: S608
        try:
            with closing(self._file.connect()) as database:
                found = database.execute(query, (topic, kind)).fetchone()
        except UNREADABLE:
            return None
        return None if found is None else bytes(found[0])


def _select_rows(database: sqlite3.Connection, first: int, limit: int) -> Iterator[Row]:
    query = (
        "SELECT rowid, topic, type, log_time, publish_time FROM Messages "
        "WHERE rowid >= ? ORDER BY rowid LIMIT ?"
    )
    yield from database.execute(query, (first, limit))


def _fetch(database: sqlite3.Connection, query: str, number: int) -> bytes | None:
    try:
        found = database.execute(query, (number,)).fetchone()
    except UNREADABLE:
        return None
    return None if found is None or found[0] is None else bytes(found[0])


def _read_types(database: sqlite3.Connection) -> TypeObjects:
    try:
        rows = database.execute("SELECT name, information, object FROM Types").fetchall()
    except UNREADABLE:
        rows = []
    return read_type_objects([(str(name), str(identifier), str(data)) for name, identifier, data in rows])


def _nanoseconds(text: object) -> int | None:
    """Read "2025-10-02 07:24:06.159037672", UTC; None where it is no time."""
    if not _TIME.fullmatch(str(text)):
        return None
    try:
        return int(np.datetime64(str(text), "ns").astype(np.int64))
    except ValueError:
        return None
