"""What a page of the report is made of, before it is HTML: plain blocks of text, tables and figures.

A stage's module in ``ident.report.pages`` builds a ``Page`` from these; ``ident.report.html`` renders it.
Every string here is taken for text, never for HTML; only ``Equation.mathml`` is markup, and it is written
in this package, never taken from a log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

Tone = Literal["plain", "good", "caution", "bad", "muted"]
Align = Literal["text", "number"]


@dataclass(frozen=True)
class Cell:
    """One cell of a table or one fact.

    raw : what a download holds instead of ``text``, not rounded, in the unit that the table names
    detail : a second, smaller line
    badge : draw ``text`` as a badge in the colour of ``tone``
    """

    text: str
    raw: float | int | str | None = None
    tone: Tone = "plain"
    detail: str | None = None
    badge: bool = False


@dataclass(frozen=True)
class Column:
    """A column of a table: its head and whether it holds numbers, which stand right.

    code : in a fixed-width font
    wrap : break even inside a word, for names and paths of any length
    """

    head: str
    align: Align = "text"
    code: bool = False
    wrap: bool = False


@dataclass(frozen=True)
class Table:
    """A table.

    notes : short lines under it
    download : name of the CSV file that its link gives, None for no link; the same is given as JSON
    records : what the downloads hold instead of the rows, where those leave something out
    scroll : give it a height of its own, for long tables
    """

    kind: ClassVar[str] = "table"
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell | str]]
    caption: str | None = None
    notes: Sequence[str] = ()
    download: str | None = None
    scroll: bool = False
    records: Sequence[Mapping[str, float | int | str | None]] = ()

    def cells(self) -> list[list[Cell]]:
        """Give all rows as cells."""
        return [[cell if isinstance(cell, Cell) else Cell(cell) for cell in row] for row in self.rows]


@dataclass(frozen=True)
class Figure:
    """A figure: a plotly.js specification (data and layout) as ``ident.report.figures`` makes it.

    height : [px]
    title : above it; also what a reader that cannot see it is told
    caption : below it: what is drawn, what was left out
    """

    kind: ClassVar[str] = "figure"
    spec: dict[str, Any]
    height: int
    title: str
    caption: str = ""


@dataclass(frozen=True)
class Facts:
    """Labels with one value each, in a compact list."""

    kind: ClassVar[str] = "facts"
    items: Sequence[tuple[str, Cell | str]]

    def cells(self) -> list[tuple[str, Cell]]:
        """Give all values as cells."""
        return [(label, cell if isinstance(cell, Cell) else Cell(cell)) for label, cell in self.items]


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    kind: ClassVar[str] = "text"
    text: str
    tone: Tone = "plain"


@dataclass(frozen=True)
class Code:
    """Text in a fixed-width font, such as a command to copy."""

    kind: ClassVar[str] = "code"
    text: str


@dataclass(frozen=True)
class Lines:
    """A list of one-line remarks, each with what it is about."""

    kind: ClassVar[str] = "lines"
    items: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Equation:
    """An equation as MathML written in this package, and the same as plain text."""

    kind: ClassVar[str] = "equation"
    mathml: str
    text: str


@dataclass(frozen=True)
class Columns:
    """Blocks side by side; on a narrow screen one below the other.

    wide : how much wider the first is than each of the others
    """

    kind: ClassVar[str] = "columns"
    blocks: Sequence[Sequence[Block]]
    wide: float = 1.0


@dataclass(frozen=True)
class Details:
    """Blocks behind a line that opens them; their figures are drawn when they are first seen."""

    kind: ClassVar[str] = "details"
    summary: str
    blocks: Sequence[Block]
    open: bool = False


Block = Table | Figure | Facts | Text | Code | Lines | Equation | Columns | Details


@dataclass(frozen=True)
class Section:
    """A part of a page that its list of contents names.

    name : short, of letters and "-" only: becomes part of the address
    """

    name: str
    title: str
    blocks: Sequence[Block]
    short: str = ""


@dataclass(frozen=True)
class Verdict:
    """The answer in one line."""

    badge: str
    text: str
    tone: Tone
    next_step: str | None = None


@dataclass(frozen=True)
class Page:
    """What one stage has to show.

    name : the stage, of letters only: becomes the address
    lead : what the first screen holds, under the verdict
    """

    name: str
    title: str
    verdict: Verdict | None
    lead: Sequence[Block]
    sections: Sequence[Section] = field(default_factory=list)
