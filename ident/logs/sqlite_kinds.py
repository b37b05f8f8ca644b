"""SQLITE FILE -> READER: rosbag2, eProsima's and RTI's recorders all keep messages in SQLite."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from ident.errors import UnusableLog
from ident.logs.eprosima import EprosimaStorage
from ident.logs.record import Storage
from ident.logs.rti import RtiStorage, sample_tables
from ident.logs.sqlite import SqliteStorage
from ident.logs.sqlite_file import UNREADABLE, SqliteFile, computed_tables


def open_sqlite(path: Path) -> Storage:
    """Open an SQLite file by the tables that it holds.

    Raises
    ------
    UnusableLog
        If they are of no recorder that is known, or cannot be read.
    """
    file = SqliteFile(path)
    try:
        with closing(file.connect()) as database:
            columns = _columns(database, "messages")
            tables = sample_tables(database)
            computed = computed_tables(database)
    except UNREADABLE as error:
        raise UnusableLog(f"{path}: not a rosbag2 file that can be read ({error})") from error
    finally:
        file.close()
    if computed:
        raise UnusableLog(f"{path}: {computed[0]!r} is a view or a virtual table, need plain tables")
    if {"data_cdr", "log_time"} <= columns:
        return EprosimaStorage(path)
    if tables:
        return RtiStorage(path, tables)
    return SqliteStorage(path)


def _columns(database: sqlite3.Connection, table: str) -> set[str]:
    return {
        str(row[0]).lower() for row in database.execute("SELECT name FROM pragma_table_info(?)", (table,))
    }
