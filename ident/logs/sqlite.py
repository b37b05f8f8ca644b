"""rosbag2 files of the SQLite kind (.db3): every row that can still be read."""

from __future__ import annotations

import sqlite3
from array import array
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from ident.errors import UnusableLog
from ident.logs.damage import Loss, summarise
from ident.logs.payloads import Payloads
from ident.logs.record import Channel, Stored, Times, join_stored
from ident.logs.sqlite_file import FIRST_ROW, UNREADABLE, SqliteFile, walk_rows
from ident.results import Damage

MOST_ROWS = 50_000
ONE_BY_ONE = 64
PIECE_BYTES = 8 << 20


class SqliteStorage:
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
        numbers, counts = np.unique(self._rows[:, 1], return_counts=True)
        self._counts = dict(zip(numbers.tolist(), counts.tolist(), strict=True))
        self.damage += [*self._file.damage, *summarise(path.name, self._losses, unit="row")]

    def count(self, channel: Channel) -> int:
        """How many messages of a channel there are."""
        numbers = set(self._numbers.get(id(channel), []))  # a damaged table may list a topic twice
        return sum(self._counts.get(number, 0) for number in numbers)

    def times(self, channel: Channel) -> Times:
        """Log times of a channel [ns], in the order in which they were recorded."""
        return self._rows_of(channel)[:, 2]

    def messages(self, channel: Channel) -> Stored:
        """Read the messages of a channel, in the order in which they were recorded."""
        return join_stored([stored for _, stored in self.pieces([channel])])

    def pieces(self, channels: Sequence[Channel]) -> Iterator[tuple[Channel, Stored]]:
        """Read the messages of several channels in one pass, each in the order of recording, bit by bit."""
        numbers = [self._numbers.get(id(channel), []) for channel in channels]
        rows = self._rows[np.isin(self._rows[:, 1], [number for each in numbers for number in each])]
        first = 0
        with closing(self._file.connect()) as database:
            for block in _blocks(database, rows):
                part = rows[first : first + len(block)]
                first += len(block)
                for channel, own in zip(channels, numbers, strict=True):
                    chosen = np.flatnonzero(np.isin(part[:, 1], own))
                    if len(chosen):
                        yield channel, Stored(part[chosen, 2], block.rows(chosen))

    def check(self) -> None:
        """Do nothing: opening has looked at every row; data that cannot be read is told when it is read."""

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
        try:
            rows = _all_rows(database)
            if rows is None:
                found = array("q")
                for row in walk_rows(database, _select_rows, self._losses):
                    if None not in row:  # in spite of the query: SQLite believes a column that says so
                        found.extend(row)
                rows = np.array(found, dtype=np.int64).reshape(-1, 3)
        except UNREADABLE as error:
            raise UnusableLog(f"{self.path}: not a rosbag2 file ({error})") from error
        return rows

    # --- reading ----------------------------------------------------------------------------------

    def _rows_of(self, channel: Channel) -> Times:
        return self._rows[np.isin(self._rows[:, 1], self._numbers.get(id(channel), []))]


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


_ROWS = (
    "SELECT id, CAST(topic_id AS INTEGER) AS topic, CAST(timestamp AS INTEGER) AS time FROM messages "
    "WHERE id >= ? AND topic_id IS NOT NULL AND timestamp IS NOT NULL ORDER BY id LIMIT ?"
)
_ROWS_AT_ONCE = f"SELECT group_concat(id), group_concat(topic), group_concat(time) FROM ({_ROWS})"  # noqa: S608


def _all_rows(database: sqlite3.Connection) -> Times | None:
    """Row number, topic number and time of every row, (n, 3); None where any of them is not sound.

    SQLite puts many rows into one text, which takes half the time of as many rows.
    """
    parts = [np.empty((0, 3), np.int64)]
    first = FIRST_ROW
    try:
        while (texts := database.execute(_ROWS_AT_ONCE, (first, MOST_ROWS)).fetchone())[0] is not None:
            columns = [_whole_numbers(text) for text in texts]
            rising = columns[0][0] >= first and (np.diff(columns[0]) > 0).all()
            if len({len(column) for column in columns}) > 1 or not rising:
                return None
            parts.append(np.column_stack(columns))
            first = int(columns[0][-1]) + 1
    except (*UNREADABLE, TypeError, ValueError, OverflowError):
        return None
    return np.concatenate(parts)


def _whole_numbers(text: str) -> Times:
    """Read numbers parted by commas; ``ValueError`` where there is anything else."""
    found = np.fromstring(text, dtype=np.int64, sep=",")
    if len(found) != text.count(",") + 1:
        raise ValueError("no numbers")
    return found


def _select_rows(database: sqlite3.Connection, first: int, limit: int) -> Iterator[tuple[int, int, int]]:
    yield from database.execute(_ROWS, (first, limit))


def _blocks(database: sqlite3.Connection, rows: Times) -> Iterator[Payloads]:
    """Read the data of these rows, all that there are of their topics, some at a time and in their order.

    Where that fails the rows are read one by one, so that only data that cannot be read are lost.
    """
    # SQLite joins bytes as they are only where its text is of the form of one byte each.
    by_many = database.execute("PRAGMA encoding").fetchone() == ("UTF-8",)
    topics = np.unique(rows[:, 1]).tolist()
    done, count = 0, 16
    while done < len(rows):
        part = rows[done : done + count]
        block = _together(database, topics, part) if by_many else None
        if block is None:
            part, count = part[:ONE_BY_ONE], ONE_BY_ONE // 8
            block = Payloads.of([_read_data(database, row) for row in part[:, 0].tolist()])
        yield block
        done += len(part)
        count = min(max(PIECE_BYTES * len(part) // max(len(block.block), 1), 1), 8 * count, MOST_ROWS)


def _together(database: sqlite3.Connection, topics: list[int], rows: Times) -> Payloads | None:
    """Read the data of rows that follow one another in one answer of SQLite; None where that is not sound."""
    query = (
        "SELECT CAST(group_concat(data, '') AS BLOB), group_concat(length(data)), max(id), sum(id) FROM ("  # noqa: S608
        "SELECT id, CAST(data AS BLOB) AS data FROM messages WHERE CAST(topic_id AS INTEGER) IN "
        f"({', '.join('?' * len(topics))}) AND timestamp IS NOT NULL AND id >= ? ORDER BY id LIMIT ?)"
    )
    try:
        data, sizes, *check = database.execute(query, (*topics, int(rows[0, 0]), len(rows))).fetchone()
    except UNREADABLE:
        return None
    if check != [rows[-1, 0], rows[:, 0].sum()] or not isinstance(data, bytes) or sizes is None:
        return None
    found = _whole_numbers(sizes)
    sound = len(found) == len(rows) and found.sum() == len(data)
    return Payloads(np.frombuffer(data, np.uint8), found) if sound else None


def _read_data(database: sqlite3.Connection, row: int) -> bytes | None:
    """Read the data of one row, None where that cannot be read."""
    try:
        found = database.execute("SELECT CAST(data AS BLOB) FROM messages WHERE id = ?", (row,)).fetchone()
    except UNREADABLE:
        return None
    return None if found is None else found[0]
