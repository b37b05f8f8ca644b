"""TABLES: a CSV or Parquet file is a run with one topic, named after the file; its columns are the fields.

The column of times is the first of these that is there, whatever its case: ``time``, ``timestamp``,
``stamp``, ``t``, ``log_time``, ``seconds``, ``sec`` (together with ``nanosec`` or ``nsec``, if there is one).
Its unit stands behind the name (``time_ms``, ``time [ms]``, ``t (us)``: s, ms, us, µs or ns). Without one,
times since 1970 are told by their size (in ms, µs and ns they lie above 1e11, 1e14 and 1e17), and all else is
seconds. Rows more than 10 s apart show a wrong unit and are refused, as are times that do not rise, but for
those of a column that can be nothing else (``time``, ``timestamp``, ``log_time``, or any with a unit), whose
rows are put in order. Dates (ISO 8601) are read as UTC. A row without a time, with too few or too many cells,
or without its end of line at the end of the file, is lost and told; a cell that is no number is NaN and told.
Of a damaged Parquet file what is left is read: every column of every group of rows for itself.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ident.errors import UnusableLog
from ident.logs.compression import most_bytes
from ident.logs.csv_text import CsvText, read_csv
from ident.logs.open import PARQUET_MAGIC
from ident.logs.record import Columns, FieldError, Times, Topic, Values
from ident.results import Damage
from ident.yaml_file import nearest

TIME_NAMES = ("time", "timestamp", "stamp", "t", "log_time", "seconds", "sec")
FRACTIONS = ("nanosec", "nsec", "nanosecs", "nsecs")
UNITS = {"s": 1e9, "sec": 1e9, "seconds": 1e9, "ms": 1e6, "us": 1e3, "µs": 1e3, "μs": 1e3, "ns": 1.0}
EPOCHS = ((1e17, 1.0), (1e14, 1e3), (1e11, 1e6))
FEWEST_RISING = 0.9
MOST_COLUMNS = 10_000
SURE = {"time", "timestamp", "log_time"}
KIND = "table"
_WHOLE = re.compile(r" *[+-]?([0-9]{1,18}|[1-8][0-9]{18}) *")
_UNIT = re.compile(r"(.+?)\s*(?:_|\s|\[|\()\s*(s|sec|seconds|ms|us|µs|μs|ns)\s*[\])]?")


class TableLog:
    """One CSV or Parquet file (see ``ident.logs.record.Log``)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = [path]
        self.damage: list[Damage] = []
        self._garbled = False
        parquet = _is_parquet(path)
        self.format = "parquet" if parquet else "csv"
        table = self._first_of_each_name(self._read_parquet() if parquet else self._read_csv())
        self._topic = "/" + re.sub(r"(\.csv|\.parquet)$", "", path.name, flags=re.IGNORECASE)
        times, used, good = _times(table, path)
        lost = int(np.count_nonzero(~good))
        if lost:
            counted = None if self._garbled else lost
            self.damage.append(Damage(f"{path.name}: rows without a time{_first_row(~good)}", counted))
        order = self._order(times[good], used[0])
        rows = np.flatnonzero(good)[order]
        self._times = times[rows]
        _check_apart(self._times, used[0], path)
        self._values = {
            name: values[rows]
            for name in table.columns
            if name not in used and (values := self._numbers_of(name, table[name])) is not None
        }
        self.topics = [Topic(self._topic, KIND, len(self._times))]

    def times(self, topic: str) -> Times:
        """Times of all rows [ns]."""
        self._check(topic)
        return self._times

    def fields(self, topic: str) -> dict[str, str]:
        """Return the names of all columns of numbers."""
        self._check(topic)
        return dict.fromkeys(self._values, "float64")

    def expand(self, topic: str, name: str) -> list[str]:
        """Check that ``name`` is a column of numbers; ``FieldError`` where it is not."""
        self._check(topic)
        if name not in self._values:
            raise FieldError(f"{topic} has no column of numbers {name!r}, {nearest(name, self._values)}")
        return [name]

    def columns(self, topic: str, fields: Sequence[str]) -> Columns:
        """Return these columns; ``FieldError`` where one does not exist."""
        names = [self.expand(topic, name)[0] for name in fields]
        return Columns(self._times, None, {name: self._values[name] for name in names})

    def read(self, wanted: Mapping[str, Sequence[str]]) -> dict[str, Columns]:
        """Return columns of the one topic; ``FieldError`` where one does not exist."""
        return {topic: self.columns(topic, fields) for topic, fields in wanted.items()}

    def check(self) -> None:
        """Do nothing: the file was read whole."""

    def close(self) -> None:
        """Do nothing: the file was read whole."""

    def _check(self, topic: str) -> None:
        if topic != self._topic:
            raise FieldError(f"no topic {topic!r}, {nearest(topic, [self._topic])}")

    # --- reading ----------------------------------------------------------------------------------

    def _read_parquet(self) -> pd.DataFrame:
        try:
            with pq.ParquetFile(self.path, page_checksum_verification=True) as file:
                self._check_size(file.metadata.num_rows, file.metadata.num_columns)
                try:
                    table = file.read()
                except (pa.ArrowException, OSError, ValueError):
                    table = self._parts_of(file)
            return self._valid(table).to_pandas(ignore_metadata=True)  # type: ignore[no-any-return]
        except (pa.ArrowException, OSError, ValueError) as error:
            reason = " ".join(str(error).split())[:160]
            if not _ends_as_parquet(self.path):
                reason = (
                    f"its end, which alone says what it holds, is missing at byte {self.path.stat().st_size}"
                )
            raise UnusableLog(f"{self.path}: Parquet file that cannot be read ({reason})") from error

    def _parts_of(self, file: pq.ParquetFile) -> pa.Table:
        """Read every column of every group of rows for itself; what cannot be read is empty, and told."""
        groups, first = [], 0
        for number in range(file.num_row_groups):
            count = file.metadata.row_group(number).num_rows
            if count * file.metadata.num_columns * 8 > most_bytes(self.path.stat().st_size):
                raise ValueError(f"a group claims to hold {count} rows")
            columns = {}
            for each in file.schema_arrow:
                try:
                    columns[each.name] = file.read_row_group(number, columns=[each.name])[each.name]
                except (pa.ArrowException, OSError, ValueError) as error:
                    reason = " ".join(str(error).split())[:120]
                    what = f"column {each.name!r} cannot be read in {count} rows, first at row {first + 1}"
                    self.damage.append(Damage(f"{self.path.name}: {what} ({reason})"))
                    columns[each.name] = pa.chunked_array([pa.nulls(count, each.type)])
            groups.append(pa.table(columns))
            first += count
        return pa.concat_tables(groups)

    def _valid(self, table: pa.Table) -> pa.Table:
        """Leave out the columns whose contents are not what their type says."""
        for name, column in zip(table.column_names, table.columns, strict=True):
            try:
                column.validate(full=True)
            except pa.ArrowException as error:
                reason = " ".join(str(error).split())[:160]
                self.damage.append(Damage(f"{self.path.name}: column {name!r} is left out ({reason})"))
                table = table.drop_columns([name])
        return table

    def _read_csv(self) -> pd.DataFrame:
        text = CsvText(self.path)
        self._check_size(1, text.columns)
        table = read_csv(text)
        self.damage += text.damage
        self._garbled = text.garbled
        return table

    def _numbers_of(self, name: str, column: pd.Series) -> Values | None:
        """Values of a column of numbers; cells with anything else in them are told."""
        values = _numbers(column)
        if values is None or column.dtype.kind in "iufb":
            return values
        wrong = ~np.isfinite(values) & np.array([_is_other(cell) for cell in column], dtype=np.bool_)
        if wrong.any():
            text = f"column {name!r} holds {np.count_nonzero(wrong)} cells that are no numbers"
            self.damage.append(Damage(f"{self.path.name}: {text}{_first_row(wrong)}"))
        return values

    def _order(self, times: Times, name: str) -> NDArray[np.intp]:
        """Rows in their order, or in that of their times where they do not rise; told, or refused."""
        if len(times) < 2:
            raise UnusableLog(f"{self.path}: {len(times)} rows with a time, need at least 2")
        rising = float(np.mean(np.diff(times) >= 0))
        if rising >= FEWEST_RISING and times.max() > times.min():
            return np.arange(len(times))
        plain, unit = _name_and_unit(name.strip().lower())
        if times.max() == times.min() or not (plain in SURE or unit):
            text = f"rise in {100 * rising:.0f} % of the rows, need {100 * FEWEST_RISING:.0f} %"
            raise UnusableLog(f"{self.path}: the times in {name!r} {text}: name the column of times 'time'")
        text = f"the times in {name!r} rise in {100 * rising:.0f} % of the rows, which are put in their order"
        self.damage.append(Damage(f"{self.path.name}: {text}"))
        return np.argsort(times, kind="stable")

    def _first_of_each_name(self, table: pd.DataFrame) -> pd.DataFrame:
        """Leave out the columns whose name an earlier one has."""
        again = table.columns.duplicated()
        for name in dict.fromkeys(table.columns[again]):
            self.damage.append(Damage(f"{self.path.name}: several columns {name!r}, only the first is read"))
        return table.loc[:, ~again]

    def _check_size(self, rows: int, columns: int) -> None:
        """Refuse what would take far more memory than the file does."""
        if columns > MOST_COLUMNS:
            raise UnusableLog(f"{self.path}: has {columns} columns, at most {MOST_COLUMNS} are read")
        if 8 * rows * columns > most_bytes(self.path.stat().st_size):
            size = self.path.stat().st_size
            text = f"claims to hold {rows} rows of {columns} columns in {size} bytes"
            raise UnusableLog(f"{self.path}: {text}: write it anew from the recording")


def _is_parquet(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4) == PARQUET_MAGIC


def _ends_as_parquet(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-min(4, path.stat().st_size), os.SEEK_END)
        return file.read(4) == PARQUET_MAGIC


def _numbers(column: pd.Series) -> NDArray[np.float64] | None:
    """Values of a column, NaN where a cell is no number; None where none of them is one."""
    if column.dtype.kind in "Mm":
        return None
    if column.dtype.kind in "iufb":
        values = column.to_numpy(dtype=np.float64)
    else:
        values = np.array([_number(cell) for cell in column], dtype=np.float64)
        if not np.isfinite(values).any():
            return None
    return values


def _is_other(cell: object) -> bool:
    """Whether a cell holds text that stands for no number, not even for "none"."""
    return isinstance(cell, str) and cell.strip().lower() not in {"", "nan", "inf", "-inf", "+inf"}


def _first_row(chosen: NDArray[np.bool_]) -> str:
    return f", first at row {int(np.flatnonzero(chosen)[0]) + 1}"


def _number(cell: object) -> float:
    try:
        return float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return np.nan


# --- time -----------------------------------------------------------------------------------------


def _times(table: pd.DataFrame, path: Path) -> tuple[Times, list[str], NDArray[np.bool_]]:
    """Find the times [ns], the columns they come from, and the rows that have one."""
    names = {str(name).strip().lower(): str(name) for name in table.columns}
    plain = {_name_and_unit(name)[0]: name for name in reversed(names)}
    chosen = next((plain[name] for name in TIME_NAMES if name in plain), None)
    if chosen is None:
        known = ", ".join(TIME_NAMES)
        found = ", ".join(map(repr, table.columns[:6]))
        raise UnusableLog(f"{path}: no column of times among {found}: name one of {known}, as in 'time_s'")
    column = table[names[chosen]]
    if column.dtype.kind not in "iuf" and _numbers(column) is None:
        return _dates(column, names[chosen], path)
    fraction = next((names[name] for name in FRACTIONS if name in names), None)
    if fraction is not None and _name_and_unit(chosen)[0] == "sec":
        whole, part = _numbers(column), _numbers(table[fraction])
        if whole is not None and part is not None:
            good = np.isfinite(whole) & np.isfinite(part) & (np.abs(whole) < 9e9) & (np.abs(part) < 9e9)
            times = np.where(good, whole, 0).astype(np.int64) * 1_000_000_000
            return times + np.where(good, part, 0).astype(np.int64), [names[chosen], fraction], good
    return _scaled(column, names[chosen], _name_and_unit(chosen)[1])


def _scaled(column: pd.Series, name: str, unit: float | None) -> tuple[Times, list[str], NDArray[np.bool_]]:
    whole = _whole_numbers(column)
    if whole is not None:
        return _scaled_whole(*whole, name, unit)
    values = _numbers(column)
    if values is None:
        values = np.full(len(column), np.nan)
    scale = unit or _unit_by_size(values)
    good = np.isfinite(values) & (np.abs(values) < (1 << 62) / scale)
    safe = np.where(good, values, 0.0)
    seconds = np.floor(safe)
    # The whole part apart, so that times since 1970 keep what a float64 of seconds still holds.
    times = seconds.astype(np.int64) * int(scale) + np.round((safe - seconds) * scale).astype(np.int64)
    return times, [name], good


def _whole_numbers(column: pd.Series) -> tuple[Times, NDArray[np.bool_]] | None:
    """Times that are whole numbers, exact beyond 2^53, and which rows have one; None where few are whole."""
    if column.dtype.kind in "iu":
        values = column.to_numpy()
        good = values <= np.iinfo(np.int64).max
        return np.where(good, values, 0).astype(np.int64), good
    if column.dtype.kind == "f":
        return None
    good = np.array([isinstance(c, str) and _WHOLE.fullmatch(c) is not None for c in column], dtype=np.bool_)
    if 2 * np.count_nonzero(good) < len(column):
        return None
    found = [int(cell) if is_whole else 0 for cell, is_whole in zip(column, good.tolist(), strict=True)]
    return np.array(found, dtype=np.int64), good


def _scaled_whole(
    values: Times, good: NDArray[np.bool_], name: str, unit: float | None
) -> tuple[Times, list[str], NDArray[np.bool_]]:
    scale = int(unit or _unit_by_size(values[good].astype(np.float64)))
    good = good & (np.abs(values.astype(np.float64)) < (1 << 62) / scale)
    return np.where(good, values, 0) * scale, [name], good


def _dates(column: pd.Series, name: str, path: Path) -> tuple[Times, list[str], NDArray[np.bool_]]:
    try:
        found = pd.to_datetime(column, utc=True, errors="coerce", format="ISO8601")
    except (ValueError, TypeError, OverflowError) as error:
        raise UnusableLog(f"{path}: the times in {name!r} cannot be read ({error})") from error
    good = found.notna().to_numpy(dtype=np.bool_)
    if not good.any():
        raise UnusableLog(f"{path}: column {name!r} holds neither numbers nor dates as in ISO 8601")
    times = found.to_numpy(dtype="datetime64[ns]").astype(np.int64)
    return times, [name], good


def _name_and_unit(name: str) -> tuple[str, float | None]:
    match = _UNIT.fullmatch(name)
    return (match[1].strip(), UNITS[match[2]]) if match else (name, None)


def _unit_by_size(values: NDArray[np.float64]) -> float:
    """Tell ns, µs, ms and s of times since 1970 apart; anything smaller is seconds."""
    finite = np.abs(values[np.isfinite(values)])
    middle = float(np.median(finite)) if len(finite) else 0.0
    return next((scale for least, scale in EPOCHS if middle > least), 1e9)


def _check_apart(times: Times, name: str, path: Path) -> None:
    median = float(np.median(np.diff(times))) / 1e9
    if median > 10.0:
        text = f"are {median:.3g} s apart, need at most 10 s: say their unit in its name, as in 'time_ms'"
        raise UnusableLog(f"{path}: the times in {name!r} {text}")
