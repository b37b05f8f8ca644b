"""OUT/index.html: every page in one file that needs no network.

plotly.js is written into it once. Text from logs is escaped by the template; figures are JSON in script
blocks that hold no "<"; a content security policy lets only this file's own two scripts run and forbids
every request, so that what slips through is neither executed nor sent.
"""

from __future__ import annotations

import base64
import csv
import functools
import hashlib
import io
import json
import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import markupsafe

from ident.report import palette
from ident.report.page import Page, Table

TEMPLATES = Path(__file__).parent / "templates"
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
Content = float | int | str | None
DIGITS = 7
"""Significant digits of a drawn number."""


def write_report(out: Path, pages: Sequence[Page], shown: str | None = None) -> Path:
    """Write OUT/index.html, replacing it whole.

    Parameters
    ----------
    out : folder, made where it is missing
    pages : in the order of the stages
    shown : name of the page that opens first, by default the last

    Returns
    -------
    path : of the file written
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "index.html"
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        draft.write_bytes(render(pages, shown).encode(errors="replace"))
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    return path


def render(pages: Sequence[Page], shown: str | None = None) -> str:
    """Give the whole document as text."""
    scripts = [plotly_script(), _own("report.js")]
    return (
        _environment()
        .get_template("index.html.j2")
        .render(
            pages=pages,
            shown=shown or (pages[-1].name if pages else ""),
            scripts=[markupsafe.Markup(script) for script in scripts],  # noqa: S704 -- this package's own
            style=markupsafe.Markup(_own("report.css")),  # noqa: S704 -- this package's own
            policy=content_policy(scripts),
            light=palette.LIGHT,
            dark=palette.DARK,
            dark_of_light=palette.dark_of_light(),
        )
    )


@functools.cache
def plotly_script() -> str:
    """Give the text of plotly.js as the plotly package ships it."""
    from plotly.offline import get_plotlyjs  # noqa: PLC0415 -- 1 s; only a report needs it

    return f"\n{str(get_plotlyjs()).strip()}\n"


def content_policy(scripts: Sequence[str]) -> str:
    """Allow these scripts by their hashes, inline styles, pictures made by a script, and nothing else."""
    hashes = " ".join(f"'sha256-{_hash(script)}'" for script in scripts)
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


def embed_json(value: Any) -> markupsafe.Markup:
    """Write JSON that may stand inside a script block: without "<", ">", "&"; NaN becomes null.

    Parameters
    ----------
    value : of dicts, lists, arrays, text and numbers; arrays keep ``DIGITS`` significant digits
    """
    text = json.dumps(_plain(value), allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return markupsafe.Markup(text)  # noqa: S704 -- escaped above


def table_csv(table: Table) -> str:
    """Give a table as CSV with unrounded numbers; a text that a spreadsheet would compute is quoted."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    heads, rows = _contents(table)
    writer.writerow(heads)
    writer.writerows([_csv_cell(value) for value in row] for row in rows)
    return stream.getvalue()


def table_json(table: Table) -> str:
    """Give a table as JSON: one object a row, numbers not rounded; what is missing is null."""
    heads, rows = _contents(table)
    records = [dict(zip(_distinct(heads), map(_finite, row), strict=True)) for row in rows]
    return json.dumps(records, allow_nan=False, ensure_ascii=False, indent=1)


def csv_address(table: Table) -> str:
    """Give a data address that holds the table as CSV."""
    return f"data:text/csv;charset=utf-8;base64,{_base64(table_csv(table))}"


def json_address(table: Table) -> str:
    """Give a data address that holds the table as JSON."""
    return f"data:application/json;charset=utf-8;base64,{_base64(table_json(table))}"


def download_name(name: str, suffix: str) -> str:
    """Name a file after a table: letters, digits, "_", "-" and "." only, with this suffix."""
    bare = re.sub(r"[^A-Za-z0-9_-]+", "_", name.removesuffix(".csv")).strip("_-")
    return f"{bare or 'table'}.{suffix}"


def _contents(table: Table) -> tuple[list[str], list[list[Content]]]:
    """Give the heads and the rows that a download holds."""
    if table.records:
        heads = list(dict.fromkeys(name for record in table.records for name in record))
        return heads, [[record.get(name) for name in heads] for record in table.records]
    rows: list[list[Content]] = [
        [cell.text if cell.raw is None else cell.raw for cell in row] for row in table.cells()
    ]
    return [column.head for column in table.columns], rows


def _distinct(heads: Sequence[str]) -> list[str]:
    """Give each head a name of its own: an empty one, and one that was there before, its number."""
    named = [head or f"column {number + 1}" for number, head in enumerate(heads)]
    return [f"{name} ({number + 1})" if name in named[:number] else name for number, name in enumerate(named)]


def _finite(value: Content) -> Content:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _csv_cell(value: Content) -> Content:
    if isinstance(value, str) and value.startswith(FORMULA_STARTS):
        return f"'{value}"
    return value


def _base64(text: str) -> str:
    return base64.b64encode(text.encode(errors="replace")).decode()


def _plain(value: Any) -> Any:
    """Turn arrays into lists of rounded numbers and what is not finite into None."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value


@functools.cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["json"] = embed_json
    environment.filters["mathml"] = _mathml
    environment.filters["csv_address"] = csv_address
    environment.filters["json_address"] = json_address
    environment.filters["download_name"] = download_name
    return environment


def _mathml(text: str) -> markupsafe.Markup:
    return markupsafe.Markup(text)  # noqa: S704 -- Equation.mathml is written in this package


def _own(name: str) -> str:
    return "\n" + (TEMPLATES / name).read_text(encoding="utf-8").strip() + "\n"


def _hash(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
