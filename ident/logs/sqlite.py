"""rosbag2 files of the SQLite kind (.db3): every row that can still be read.

The file is opened read-only and immutable, so nothing beside it is created. Where the recorder left a
write-ahead log (``-wal``) the newest rows are in there: both are copied to a temporary folder and read
from the copy. A damaged page costs the rows in it: rows are read by number, and the walk steps over those
that cannot be read.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
import weakref
from array import array
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from ident.errors import UnusableLog
from ident.logs.damage import Loss, summarise
from ident.logs.record import Channel, Stored, Times
from ident.results import Damage

MAGIC = b"SQLite format 3\x00"
FIRST_ROW = -(1 << 40)
LARGEST_STEP = 1 << 40


class SqliteStorage:
    """One .db3 file (see ``ident.logs.record.Storage``)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = [path]
        self.damage: list[Damage] = []
        self._copy: Path | None = None
        self._losses: list[Loss] = []
        wal = path.with_name(path.name + "-wal")
        if wal.exists() and wal.stat().st_size > 0:
            self._read_from_copy(wal)
        with closing(self._connect()) as database:
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
        with closing(self._connect()) as database:
            found = dict(_read_data(database, rows.tolist()))
        return Stored(self.times(channel), [found.get(row) for row in rows.tolist()])

    def close(self) -> None:
        """Remove the temporary copy, if one was made."""
        if self._copy is not None:
            shutil.rmtree(self._copy, ignore_errors=True)

    # --- opening ----------------------------------------------------------------------------------

    def _read_from_copy(self, wal: Path) -> None:
        self._copy = Path(tempfile.mkdtemp(prefix="ident-"))
        weakref.finalize(self, shutil.rmtree, self._copy, ignore_errors=True)
        shutil.copyfile(self.path, self._copy / self.path.name)
        shutil.copyfile(wal, self._copy / wal.name)
        self.files.append(wal)

    def _connect(self) -> sqlite3.Connection:
        path = self.path if self._copy is None else self._copy / self.path.name
        options = "mode=ro&immutable=1" if self._copy is None else "mode=rw"
        database = sqlite3.connect(f"{path.absolute().as_uri()}?{options}", uri=True)
        # Without this SQLite refuses a file that is shorter than its header says (one cut off).
        database.execute("PRAGMA writable_schema=ON")
        return database

    def _read_channels(self, database: sqlite3.Connection) -> list[Channel]:
        try:
            topics = database.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
        except sqlite3.DatabaseError as error:
            raise UnusableLog(f"{self.path}: {_what_instead(database, error)}") from error
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
        except sqlite3.DatabaseError as error:
            if "no such table" not in str(error):  # there is none before ROS 2 Iron
                self.damage.append(Damage(f"{self.path.name}: message definitions cannot be read ({error})"))
            return {}
        return {_text(kind): (_text(text), _text(encoding)) for kind, text, encoding in rows}

    def _read_rows(self, database: sqlite3.Connection) -> Times:
        """Row number, topic number and time of every row, (n, 3), stepping over what cannot be read."""
        rows = array("q")
        after: int | None = FIRST_ROW
        while after is not None:
            after = self._read_until_defect(database, after, rows)
        found = np.array(rows, dtype=np.int64).reshape(-1, 3)
        self._count_lost(found)
        return found

    def _read_until_defect(self, database: sqlite3.Connection, after: int, rows: array[int]) -> int | None:
        """Append the rows behind ``after``; return where to go on behind a defect, None at the end."""
        try:
            for row in _select_rows(database, after):
                if row[0] <= after:
                    raise sqlite3.DatabaseError("rows are out of order")  # noqa: TRY301
                rows.extend(row)
                after = row[0]
        except sqlite3.DatabaseError as error:
            if "no such" in str(error):
                raise UnusableLog(f"{self.path}: not a rosbag2 file ({error})") from error
            after = max(after, 0)
            self._losses.append(Loss("rows that cannot be read", after, detail=str(error)))
            return _behind_defect(database, after)
        return None

    def _count_lost(self, found: Times) -> None:
        """Between rows that were read, each missing number behind a defect is a lost message."""
        for loss in self._losses:
            after = found[found[:, 0] > loss.place, 0]
            if len(after):
                loss.messages = int(after[0]) - loss.place - 1

    # --- reading ----------------------------------------------------------------------------------

    def _rows_of(self, channel: Channel) -> Times:
        return self._rows[np.isin(self._rows[:, 1], self._numbers.get(id(channel), []))]


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _what_instead(database: sqlite3.Connection, error: sqlite3.DatabaseError) -> str:
    """Say what an SQLite file without rosbag2's tables is."""
    try:
        schema = str(database.execute("SELECT group_concat(sql) FROM sqlite_master").fetchone()[0])
    except sqlite3.DatabaseError:
        schema = ""
    if "data_cdr" in schema or "rti_cdr_sample" in schema or "rti_json_sample" in schema:
        return "DDS recording: not read yet, convert it to MCAP or rosbag2"
    return f"not a rosbag2 file that can be read ({error})"


def _select_rows(database: sqlite3.Connection, after: int) -> Iterator[tuple[int, int, int]]:
    query = (
        "SELECT id, CAST(topic_id AS INTEGER), CAST(timestamp AS INTEGER) FROM messages "
        "WHERE id > ? ORDER BY id"
    )
    for row in database.execute(query, (after,)):
        if None not in row:
            yield row


def _behind_defect(database: sqlite3.Connection, after: int) -> int | None:
    """Find the first number behind which rows can be read again, None where there is none."""

    def readable(number: int) -> bool:
        try:
            first = next(_select_rows(database, number), None)
        except sqlite3.DatabaseError:
            return False
        return first is None or first[0] > number

    step = 1
    while not readable(after + step):
        step *= 2
        if step > LARGEST_STEP:
            return None
    low, high = after + step // 2, after + step
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if readable(middle) else (middle, high)
    return high


def _read_data(database: sqlite3.Connection, rows: list[int]) -> Iterator[tuple[int, bytes]]:
    """Yield (row, data), leaving out the rows whose data cannot be read."""
    query = "SELECT CAST(data AS BLOB) FROM messages WHERE id = ?"
    for row in rows:
        try:
            found = database.execute(query, (row,)).fetchone()
        except sqlite3.DatabaseError:
            continue
        if found is not None and found[0] is not None:
            yield row, found[0]
