"""SQLite files, read without a trace: read-only and immutable, so that nothing beside them is created.

Where the recorder left a write-ahead log (``-wal``) the newest rows are in there: both are copied to a
temporary folder and read from the copy. So is a file that was cut off within a page, without that page, whose
missing end SQLite would take for zeros. A damaged page costs the rows in it: rows are read by number, and the
walk steps over those that cannot be read.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
import tempfile
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ident.logs.damage import Loss
from ident.results import Damage

MAGIC = b"SQLite format 3\x00"
UNREADABLE = (sqlite3.DatabaseError, MemoryError)
"""What reading a damaged file raises: SQLite takes some damage for a want of memory."""
FIRST_ROW = -(1 << 40)
LARGEST_STEP = 1 << 40
TABLES = {"messages", "topics", "message_definitions", "types"}
SHORTEST_LIMIT, LONGEST_LIMIT = 1 << 16, (1 << 31) - 1
Row = tuple[Any, ...]
Select = Callable[[sqlite3.Connection, int, int], Iterator[Row]]
ALL = -1


class SqliteFile:
    """One SQLite file; ``files`` are those that are read, ``damage`` is what is missing at its end."""

    def __init__(self, path: Path) -> None:
        self.files = [path]
        size, whole, stated = _sizes(path)
        text = f"{path.name}: cut off at byte {size}, its header states {stated} bytes"
        self.damage = [Damage(text, bytes_lost=stated - size)] if stated > size else []
        self._path = path
        self._copy: Path | None = None
        wal = path.with_name(path.name + "-wal")
        if wal.exists() and wal.stat().st_size > 0:
            self.files.append(wal)
        if len(self.files) > 1 or whole < size:
            self._copy = Path(tempfile.mkdtemp(prefix="ident-"))
            weakref.finalize(self, shutil.rmtree, self._copy, ignore_errors=True)
            for file in self.files:
                shutil.copyfile(file, self._copy / file.name)
            os.truncate(self._copy / path.name, whole)

    def connect(self) -> sqlite3.Connection:
        """Open the file for reading."""
        path = self._path if self._copy is None else self._copy / self._path.name
        options = "mode=ro&immutable=1" if self._copy is None else "mode=rw"
        database = sqlite3.connect(f"{path.absolute().as_uri()}?{options}", uri=True)
        # Nothing in a file is longer than the file: what claims to be is refused before it takes memory.
        size = sum(file.stat().st_size for file in self.files)
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(max(size, SHORTEST_LIMIT), LONGEST_LIMIT))
        # Without this SQLite refuses a file that is shorter than its header says (one cut off).
        database.execute("PRAGMA writable_schema=ON")
        return database

    def close(self) -> None:
        """Remove the temporary copy, if one was made."""
        if self._copy is not None:
            shutil.rmtree(self._copy, ignore_errors=True)


def _sizes(path: Path) -> tuple[int, int, int]:
    """Size of a file, of its whole pages, and that which its header states; all in bytes (0: it does not)."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(100)
    if len(head) < 100:
        return size, size, 0
    (page,) = struct.unpack_from(">H", head, 16)
    page = 65536 if page == 1 else page
    if page < 512 or page & (page - 1):
        return size, size, 0
    changed, pages, valid_for = (struct.unpack_from(">I", head, place)[0] for place in (24, 28, 92))
    return size, size // page * page, pages * page if changed == valid_for else 0


def computed_tables(database: sqlite3.Connection) -> list[str]:
    """Names of recorders' tables that are none: rows of a view are computed, without end if so written."""
    query = "SELECT name FROM pragma_table_list WHERE schema = 'main' AND type IN ('view', 'virtual')"
    names = [str(row[0]) for row in database.execute(query)]
    return [name for name in names if name.lower() in TABLES or "@" in name]


def walk_rows(database: sqlite3.Connection, select: Select, losses: list[Loss]) -> Iterator[Row]:
    """Yield all rows that can be read; each defect that is stepped over goes into ``losses``.

    Parameters
    ----------
    select : yields the rows from a number on in their order, each beginning with its number, as many as are
        asked for or ``ALL``

    Raises
    ------
    sqlite3.DatabaseError
        If a table or column is missing.
    """
    first: int | None = FIRST_ROW
    defect: Loss | None = None
    limit = ALL
    while first is not None:
        last = first - 1
        try:
            for row in select(database, first, limit):
                if not isinstance(row[0], int) or row[0] <= last:
                    raise sqlite3.DatabaseError("rows are out of order")
                if defect is not None:  # each number that is missing behind a defect is a lost message
                    defect.messages = row[0] - defect.place - 1
                    defect = None
                last = row[0]
                yield row
        except UNREADABLE as error:
            if "no such" in str(error):
                raise
            if limit == ALL:  # Python drops the row before one that cannot be read: it is asked for alone
                first, limit = last + 1, 1
                continue
            place = max(last, 0)
            if defect is None:
                defect = Loss("rows that cannot be read", place, detail=str(error))
                losses.append(defect)
            first, limit = _behind_defect(database, select, place), ALL
        else:
            first = None if limit == ALL or last < first else last + 1
            limit = ALL


def _behind_defect(database: sqlite3.Connection, select: Select, last: int) -> int | None:
    """Find the first number from which on rows can be read again, None where there is none."""

    def readable(number: int) -> bool:
        try:
            first = next(select(database, number, 1), None)
        except UNREADABLE:
            return False
        return first is None or first[0] >= number

    step = 2
    while not readable(last + step):
        step *= 2
        if step > LARGEST_STEP:
            return None
    low, high = last + step // 2, last + step
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if readable(middle) else (middle, high)
    return high
