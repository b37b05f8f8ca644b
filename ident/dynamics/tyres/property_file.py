"""Tyre property files (``.tir``): TYDEX/ADAMS sections of ``KEYWORD = value  $comment``, read and written.

A file is kept as its lines, so that everything in it survives a round trip byte for byte: comments (``!``,
``$``), order, tables, vendor sections, unknown keywords, line ends, encoding. A changed value changes its
own line only. What a line may hold:

    [SECTION]                a section; keywords are looked for in all of them
    KEYWORD = 1e+006 $text   a number (also 1.0D+06), a 'text', a bare word, or nothing
    {pen  fz}   0.1  5000    heads and rows of tables, which nobody here reads

Any other line is refused. Values are checked where they are asked for, so that an oddity in a vendor's
section keeps nobody from reading the rest: a keyword that stands twice with two values, and a number that
is none, are refused then. Numbers come in SI (see ``property_units``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ident.dynamics.tyres.property_units import si_factor
from ident.errors import BadRecipe

LARGEST_FILE = 5_000_000  # [byte] a property file has some 20 000
UNITS = "UNITS"
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
_SECTION = re.compile(r"\ufeff?\s*\[([^\]]*)\]")
_KEYWORD = re.compile(r"\ufeff?\s*([A-Za-z_][\w.-]*)[ \t]*=[ \t]*")
_COMMENT = re.compile(r"\ufeff?\s*(?:[$!].*)?")
_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eEdD][-+]?\d+)?")
_ROW = re.compile(rf"\s*(?:\{{.*|{_NUMBER.pattern}(?:[\s,]+{_NUMBER.pattern})*[\s,]*(?:[$!].*)?)")


@dataclass(frozen=True)
class Entry:
    """One keyword.

    section, keyword : in capitals; the section is empty above the first one
    line : index into the lines of the file
    start, end : where in the line the value stands, with its quotes
    text : the value without quotes; empty where there is none
    quoted : whether it stood in quotes, so that it is text even where it looks like a number
    """

    section: str
    keyword: str
    line: int
    start: int
    end: int
    text: str
    quoted: bool


@dataclass(frozen=True)
class PropertyFile:
    """A tyre property file.

    lines : with their line ends
    entries : every keyword, in order
    encoding : that the bytes were read with; UTF-8, or Latin-1 where they are none
    source : what messages begin with, mostly the path
    """

    lines: tuple[str, ...]
    entries: tuple[Entry, ...]
    encoding: str
    source: str

    @cached_property
    def sections(self) -> frozenset[str]:
        """Names of the sections, in capitals."""
        names = (_SECTION.match(line) for line in self.lines)
        return frozenset(name[1].strip().upper() for name in names if name)

    @cached_property
    def units(self) -> dict[str, str]:
        """Words of the units section, such as {"LENGTH": "meter"}."""
        return {entry.keyword: entry.text for entry in self.entries if entry.section == UNITS}

    @cached_property
    def _by_keyword(self) -> dict[str, list[Entry]]:
        found: dict[str, list[Entry]] = {}
        for entry in self.entries:
            if entry.section != UNITS and entry.text:
                found.setdefault(entry.keyword, []).append(entry)
        return found

    def entry(self, *keywords: str) -> Entry | None:
        """Find the entry of a keyword, or of its other spellings, that has a value; None where none has.

        Raises
        ------
        BadRecipe
            If it stands there more than once with different values.
        """
        found = [entry for keyword in keywords for entry in self._by_keyword.get(keyword, [])]
        for other in found[1:]:
            if not _same(other, found[0]):
                raise BadRecipe(
                    f"{self.source}: {_told(found[0])} and {_told(other)}, need one value: remove one of them"
                )
        return found[0] if found else None

    def text(self, *keywords: str) -> str | None:
        """Text of a keyword; None where it is missing or empty."""
        entry = self.entry(*keywords)
        return None if entry is None else entry.text

    def number(self, *keywords: str) -> float | None:
        """Value of a keyword in SI; None where it is missing or empty.

        A keyword that is not known to have a unit is taken for a number alone, as all coefficients are.

        Raises
        ------
        BadRecipe
            If it is no finite number, stands twice with different values, or its unit is not known.
        """
        entry = self.entry(*keywords)
        if entry is None:
            return None
        value = _read_number(entry)
        if value is None:
            raise BadRecipe(
                f"{self.source}: line {entry.line + 1}: {entry.keyword} = {_short(entry.text)!r} "
                f"({'text' if entry.quoted else 'not a number'}), need a finite number such as 1.5 or -2e-3"
            )
        return value * si_factor(entry.keyword, self.units, self.source)

    def with_numbers(self, values: Mapping[str, float], section: str | None = None) -> PropertyFile:
        """Return the file with other values; only the lines of those that change differ.

        Parameters
        ----------
        values : keyword -> value in SI
        section : at whose end a keyword is added that the file lacks, itself added if need be; None: a
            missing keyword is refused

        Raises
        ------
        BadRecipe
            If a value is not finite, or a keyword is missing and there is no section for it.
        """
        lines, new = list(self.lines), []
        for keyword, value in values.items():
            if not math.isfinite(value):
                raise BadRecipe(f"{self.source}: {keyword} = {value}, need a finite number to write")
            stored = value / si_factor(keyword, self.units, self.source)
            places = [entry for entry in self.entries if entry.keyword == keyword and entry.section != UNITS]
            for entry in places:
                if _read_number(entry) != stored:
                    lines[entry.line] = _with_value(lines[entry.line], entry, _as_text(stored))
            if not places:
                new.append(f"{keyword:<24} = {_as_text(stored)}")
        if new and section is None:
            raise BadRecipe(
                f"{self.source}: {new[0].split()[0]} is not in the file, need a section to add it to"
            )
        if new and section is not None:
            self._insert(lines, new, section.upper())
        return parse_property_file("".join(lines).encode(self.encoding), self.source)

    def to_bytes(self) -> bytes:
        """Return the file as it is stored."""
        return "".join(self.lines).encode(self.encoding)

    def _insert(self, lines: list[str], new: list[str], section: str) -> None:
        """Add lines after the last keyword of a section, or in a section of their own at the end."""
        own = [entry.line for entry in self.entries if entry.section == section]
        at = own[-1] if own else len(lines) - 1
        ending = lines[0][len(lines[0].rstrip("\r\n")) :] or "\n"
        if not lines[at].endswith(("\n", "\r")):
            lines[at] += ending
        added = new if own else [f"[{section}]", *new]
        lines[at] += "".join(text + ending for text in added)


def read_property_file(path: Path) -> PropertyFile:
    """Read a tyre property file.

    Raises
    ------
    BadRecipe
        If it cannot be read, is no text, or holds a line that has no place in a property file.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise BadRecipe(
                f"{path}: {size} bytes, need at most {LARGEST_FILE}: this is no tyre property file"
            )
        data = path.read_bytes()
    except OSError as error:
        raise BadRecipe(f"{path}: cannot be read: {error.strerror}") from error
    return parse_property_file(data, str(path))


def write_property_file(file: PropertyFile, path: Path) -> None:
    """Write a tyre property file, byte for byte as it was read where nothing was changed.

    Raises
    ------
    BadRecipe
        If it cannot be written.
    """
    try:
        path.write_bytes(file.to_bytes())
    except OSError as error:
        raise BadRecipe(f"{path}: cannot be written: {error.strerror}") from error


def parse_property_file(data: bytes, source: str) -> PropertyFile:
    """Read the bytes of a property file; see ``read_property_file``."""
    if not data.strip():
        raise BadRecipe(f"{source}: is empty, need a tyre property file with sections such as [MODEL]")
    if b"\0" in data:
        raise BadRecipe(f"{source}: holds zero bytes, need text in ASCII, UTF-8 or Latin-1: save it as such")
    try:
        text, encoding = data.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        text, encoding = data.decode("latin-1"), "latin-1"
    lines = tuple(_LINE.findall(text))
    entries, section = [], ""
    for number, line in enumerate(lines):
        body = line.rstrip("\r\n")
        found = _SECTION.match(body)
        if found:
            section = found[1].strip().upper()
        elif not _COMMENT.fullmatch(body):
            entry = _entry(body, number, section)
            if entry is not None:
                entries.append(entry)
            elif not _ROW.fullmatch(body):
                raise BadRecipe(_stray(body, number, last=number == len(lines) - 1, source=source))
    if not any(_SECTION.match(line) for line in lines):
        raise BadRecipe(
            f"{source}: has no [SECTION], need a tyre property file with sections such as [MODEL]"
        )
    return PropertyFile(lines, tuple(entries), encoding, source)


def _entry(body: str, number: int, section: str) -> Entry | None:
    """Read the keyword of a line; None where it holds none, or a quote is not closed."""
    found = _KEYWORD.match(body)
    if found is None:
        return None
    keyword, start = found[1].upper(), found.end()
    rest = body[start:]
    if rest[:1] in {"'", '"'}:
        close = rest.find(rest[0], 1)
        if close < 0:
            return None
        return Entry(section, keyword, number, start, start + close + 1, rest[1:close].strip(), quoted=True)
    value = re.split(r"[$!]", rest, maxsplit=1)[0].rstrip()
    return Entry(section, keyword, number, start, start + len(value), value, quoted=False)


def _stray(body: str, number: int, *, last: bool, source: str) -> str:
    ending = "; the file ends here: is it whole?" if last else ""
    return (
        f"{source}: line {number + 1}: {_short(body.strip())!r} is no [SECTION], no KEYWORD = value, "
        f"no comment ($ or !) and no row of numbers{ending}"
    )


def _short(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."


def _read_number(entry: Entry) -> float | None:
    if entry.quoted or not _NUMBER.fullmatch(entry.text):
        return None
    value = float(entry.text.replace("d", "e").replace("D", "e"))
    return value if math.isfinite(value) else None


def _told(entry: Entry) -> str:
    return f"{entry.keyword} = {_short(entry.text)!r} on line {entry.line + 1}"


def _same(one: Entry, other: Entry) -> bool:
    value = _read_number(one)
    return one.text == other.text if value is None else value == _read_number(other)


def _as_text(value: float) -> str:
    """Shortest text that reads back as the same number."""
    short = f"{value:.12g}"
    return short if float(short) == value else repr(value)


def _with_value(line: str, entry: Entry, text: str) -> str:
    """Put a value into its line; a comment after it keeps its column where there is room."""
    before, after = line[: entry.start], line[entry.end :]
    gap = len(after) - len(after.lstrip(" "))
    grown = len(text) - (entry.end - entry.start)
    if not after.strip():
        return before + text + after
    return before + text + " " * max(1, gap - grown) + after[gap:]
