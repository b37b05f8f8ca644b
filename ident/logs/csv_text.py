"""CSV FILE -> CELLS: the rows that have as many cells as the first line has names.

Bytes that are no text (not UTF-8, or zeros, as a disk leaves them) become a mark that is no number, so that
they cost the cells that they are in, and are told with their place. A last line without its end may be cut
off within a number: it is left out.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import pandas as pd
import pyarrow as pa
from pyarrow import csv

from ident.errors import UnusableLog
from ident.results import Damage

_MARK = "\ufffd"
_NO_TEXT = re.compile(r"[\x00\ufffd]")


class CsvText:
    """Text of a CSV file; ``damage`` is what was found wrong with it.

    mark : what parts the cells; columns : how many the first line has
    garbled : whether bytes are no text, so that nobody can count the rows that were there

    Raises
    ------
    UnusableLog
        If its first line is no line of names.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: list[Damage] = []
        data = path.read_bytes()
        text = data.decode("utf-8-sig", "replace").lstrip()
        names = text.partition("\n")[0]
        self.mark = max(",;\t", key=names.count)
        if self.mark not in names or "\0" in names:
            raise UnusableLog(f"{path}: no table: need a first line of names, parted by ',', ';' or tabs")
        self.columns = names.count(self.mark) + 1
        self.garbled = "\0" in text or _MARK in text
        if self.garbled:
            what = f"bytes that are no UTF-8 text, first at byte {_first_wrong(data)}"
            self.damage.append(Damage(f"{path.name}: {what}"))
            text = text.replace("\0", _MARK)
        if not text.endswith(("\n", "\r")):
            text = self._without_last(text)
        self.text = text

    def _without_last(self, text: str) -> str:
        whole, end, last = text.rpartition("\n")
        if not end or _NO_TEXT.sub("", last):
            row = whole.count("\n") + 1
            what = "the last line has no end and may be cut off, it is left out"
            self.damage.append(Damage(f"{self.path.name}: {what}, at row {row}"))
        return whole + end


def _first_wrong(data: bytes) -> int:
    """Place of the first byte that is no text."""
    zero = data.find(b"\0")
    try:
        data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        return error.start if zero < 0 else min(zero, error.start)
    return max(zero, data.find(_MARK.encode()) if zero < 0 else zero)


def read_csv(text: CsvText) -> pd.DataFrame:
    """Read the rows; those with too few or too many cells go into the damage of the text.

    Raises
    ------
    UnusableLog
        If the rows cannot be told apart.
    """
    wrong: list[int] = []

    def skip(row: csv.InvalidRow) -> str:
        wrong.append(int(row.number or 0) - 1)
        return "skip"

    parse = csv.ParseOptions(
        delimiter=text.mark, newlines_in_values='"' in text.text, invalid_row_handler=skip
    )
    data = text.text.encode()
    try:
        table = _read(data, parse, wrong)
    except (pa.ArrowException, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise UnusableLog(f"{text.path}: CSV file that cannot be read ({reason})") from error
    if wrong:
        what = f"rows that have not the {text.columns} cells of the first line, first at row {wrong[0]}"
        text.damage.append(Damage(f"{text.path.name}: {what}", None if text.garbled else len(wrong)))
    table.columns = [str(name).strip() for name in table.columns]
    return table


def _read(data: bytes, parse: csv.ParseOptions, wrong: list[int]) -> pd.DataFrame:
    """Read columns as what their beginning is; where their rest is not, all as text."""
    one_thread = csv.ReadOptions(use_threads=False)  # so that rows are numbered
    try:
        return csv.read_csv(io.BytesIO(data), one_thread, parse).to_pandas()  # type: ignore[no-any-return]
    except pa.ArrowInvalid:
        wrong.clear()
        first = csv.open_csv(io.BytesIO(data), parse_options=parse)
        texts = dict.fromkeys(first.schema.names, pa.string())
        wrong.clear()
        options = csv.ConvertOptions(column_types=texts, strings_can_be_null=True)
        return csv.read_csv(io.BytesIO(data), one_thread, parse, options).to_pandas()  # type: ignore[no-any-return]
