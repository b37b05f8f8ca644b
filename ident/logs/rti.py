"""Recordings of RTI Recording Service in SQLite (``.dat``, ``.db``).

Built from the vendor's documentation alone, for want of a public sample: one table a topic, named
``"<topic>@<domain>"``, with the sample as text (``rti_json_sample``) or as CDR with its encapsulation
(``rti_cdr_sample``), and the times ``SampleInfo_reception_timestamp`` and ``SampleInfo_source_timestamp``
[ns]. CDR needs an IDL file (``*.idl``) beside the recording: of the types in it the one named like the topic
is taken, else the only one that no other is made of.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ident.logs.damage import Loss, summarise
from ident.logs.idl import idl_schema, idl_text_beside
from ident.logs.record import Channel, ChannelByChannel, FieldError, Stored, Times
from ident.logs.sqlite_file import UNREADABLE, Row, SqliteFile, walk_rows
from ident.results import Damage

JSON, CDR = "rti_json_sample", "rti_cdr_sample"
RECEIVED, SENT = "SampleInfo_reception_timestamp", "SampleInfo_source_timestamp"
VALID = "SampleInfo_valid_data"


def sample_tables(database: sqlite3.Connection) -> dict[str, set[str]]:
    """Tables of samples with their columns."""
    names = [str(row[0]) for row in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
    found = {}
    for name in names:
        rows = database.execute("SELECT name FROM pragma_table_info(?)", (name,))
        columns = {str(row[0]) for row in rows}
        if "@" in name and columns & {JSON, CDR} and RECEIVED in columns:
            found[name] = columns
    return found


class RtiStorage(ChannelByChannel):
    """One recording (see ``ident.logs.record.Storage``)."""

    format = "rti sqlite"

    def __init__(self, path: Path, tables: dict[str, set[str]]) -> None:
        self.path = path
        self._file = SqliteFile(path)
        self.files = self._file.files
        self.damage = list(self._file.damage)
        self._idl = idl_text_beside(path)
        self._rows: dict[int, tuple[str, NDArray[np.int64]]] = {}
        self.channels: list[Channel] = []
        for table, columns in tables.items():
            channel = self._channel(table, columns)
            self.channels.append(channel)
            self._rows[id(channel)] = (table, self._read_rows(table, columns))

    def times(self, channel: Channel) -> Times:
        """Times of reception of a channel [ns], in the order in which they were recorded."""
        return self._rows[id(channel)][1][:, 1]

    def messages(self, channel: Channel) -> Stored:
        """Read the samples of a channel, in the order in which they were recorded."""
        table, rows = self._rows[id(channel)]
        column = JSON if channel.encoding == "json" else CDR
        query = f"SELECT CAST({column} AS BLOB) FROM {_quoted(table)} WHERE rowid = ?"  # noqa: S608 quoted
        with closing(self._file.connect()) as database:
            data = [_fetch(database, query, number) for number in rows[:, 0].tolist()]
        return Stored(rows[:, 1], data, rows[:, 2] if rows[:, 2].any() else None)

    def close(self) -> None:
        """Remove the temporary copy, if one was made."""
        self._file.close()

    def _channel(self, table: str, columns: set[str]) -> Channel:
        topic = table.rpartition("@")[0]
        if JSON in columns:
            return Channel(topic, topic, "json")
        try:
            schema = idl_schema(topic, self._idl, guess=True)
        except FieldError as error:
            reason = str(error) if self._idl else "needs an IDL file (*.idl) beside the recording"
            text = f"{topic}: its samples are CDR, whose type the recording does not tell: {reason}"
            self.damage.append(Damage(text))
            return Channel(topic, topic, "cdr")
        return Channel(topic, schema.root, "cdr", "", "omgidl", schema)

    def _read_rows(self, table: str, columns: set[str]) -> NDArray[np.int64]:
        """Row number, times of reception and source [ns] of every valid sample, (n, 3)."""
        sent = SENT if SENT in columns else "0"
        valid = f"AND {VALID} != 0" if VALID in columns else ""
        query = (
            f"SELECT rowid, CAST({RECEIVED} AS INTEGER), CAST({sent} AS INTEGER) FROM {_quoted(table)} "  # noqa: S608
            f"WHERE rowid >= ? {valid} ORDER BY rowid LIMIT ?"
        )

        def select(database: sqlite3.Connection, first: int, limit: int) -> Iterator[Row]:
            yield from database.execute(query, (first, limit))

        losses: list[Loss] = []
        with closing(self._file.connect()) as database:
            rows = [row for row in walk_rows(database, select, losses) if row[1] is not None]
        self.damage += summarise(f"{self.path.name}, {table}", losses, unit="row")
        return np.array([[n, at, sent or 0] for n, at, sent in rows], dtype=np.int64).reshape(-1, 3)


def _quoted(name: str) -> str:
    """Quote the name of a table."""
    return '"' + name.replace('"', '""') + '"'


def _fetch(database: sqlite3.Connection, query: str, number: int) -> bytes | None:
    try:
        found = database.execute(query, (number,)).fetchone()
    except UNREADABLE:
        return None
    return None if found is None or found[0] is None else bytes(found[0])
