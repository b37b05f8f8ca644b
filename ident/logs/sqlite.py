"""rosbag2 files of the SQLite kind (.db3): every row that can still be read."""

from __future__ import annotations

import sqlite3
from array import array
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from ident.errors import UnusableLog
from ident.logs.damage import Loss, summarise
from ident.logs.record import Channel, ChannelByChannel, Stored, Times
from ident.logs.sqlite_file import UNREADABLE, SqliteFile, walk_rows
from ident.results import Damage


class SqliteStorage(ChannelByChannel):
    """One .db3 file (see ``ident.logs.record.Storage``)."""

    format = "rosbag2 sqlite3"

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = SqliteFile(path)
        self.files = self._file.files
        self.damage: list[Damage] = []
        self._losses: list[Loss] = []
        with closing(self._file.connect()) as database:
            self._numbers: dict[int, list[int]] = {}
            self.channels = self._read_channels(database)
            self._rows = self._read_rows(database)
        self.damage += summarise(path.name, self._losses, unit="row")

    def times(self, channel: Channel) -> Times:
        """Log times of a channel [ns], in the order in which they were recorded."""
        return self._rows_of(channel)[:, 2]

    def messages(self, channel: Channel) -> Stored:
        """Read the messages of a channel, in the order in which they were recorded."""
        rows = self._rows_of(channel)[:, 0]
        with closing(self._file.connect()) as database:
            found = dict(_read_data(database, rows.tolist()))
        return Stored(self.times(channel), [found.get(row) for row in rows.tolist()])

    def close(self) -> None:
        """Remove the temporary copy, if one was made."""
        self._file.close()

    # --- opening ----------------------------------------------------------------------------------

    def _read_channels(self, database: sqlite3.Connection) -> list[Channel]:
        try:
            topics = database.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
        except UNREADABLE as error:
            raise UnusableLog(f"{self.path}: not a rosbag2 file that can be read ({error})") from error
        definitions = self._read_definitions(database)
        found: dict[tuple[str, str, str], Channel] = {}
        for number, *names in topics:
            topic, kind, encoding = (_text(name) for name in names)
            text, text_format = definitions.get(kind, ("", ""))
            channel = found.setdefault(
                (topic, kind, encoding), Channel(topic, kind, encoding, text, text_format)
            )
            self._numbers.setdefault(id(channel), []).append(number)
        return list(found.values())

    def _read_definitions(self, database: sqlite3.Connection) -> dict[str, tuple[str, str]]:
        query = "SELECT topic_type, encoded_message_definition, encoding FROM message_definitions"
        try:
            rows = database.execute(query).fetchall()
        except UNREADABLE as error:
            if "no such table" not in str(error):  # there is none before ROS 2 Iron
                self.damage.append(Damage(f"{self.path.name}: message definitions cannot be read ({error})"))
            return {}
        return {_text(kind): (_text(text), _text(encoding)) for kind, text, encoding in rows}

    def _read_rows(self, database: sqlite3.Connection) -> Times:
        """Row number, topic number and time of every row, (n, 3), stepping over what cannot be read."""
        rows = array("q")
        try:
            for row in walk_rows(database, _select_rows, self._losses):
                rows.extend(row)
        except UNREADABLE as error:
            raise UnusableLog(f"{self.path}: not a rosbag2 file ({error})") from error
        return np.array(rows, dtype=np.int64).reshape(-1, 3)

    # --- reading ----------------------------------------------------------------------------------

    def _rows_of(self, channel: Channel) -> Times:
        return self._rows[np.isin(self._rows[:, 1], self._numbers.get(id(channel), []))]


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _select_rows(database: sqlite3.Connection, after: int) -> Iterator[tuple[int, int, int]]:
    query = (
        "SELECT id, CAST(topic_id AS INTEGER), CAST(timestamp AS INTEGER) FROM messages "
        "WHERE id > ? ORDER BY id"
    )
    for row in database.execute(query, (after,)):
        if None not in row:
            yield row


def _read_data(database: sqlite3.Connection, rows: list[int]) -> Iterator[tuple[int, bytes]]:
    """Yield (row, data), leaving out the rows whose data cannot be read."""
    query = "SELECT CAST(data AS BLOB) FROM messages WHERE id = ?"
    for row in rows:
        try:
            found = database.execute(query, (row,)).fetchone()
        except UNREADABLE:
            continue
        if found is not None and found[0] is not None:
            yield row, found[0]
