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
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import markupsafe

from ident.report import palette
from ident.report.page import Page, Table

TEMPLATES = Path(__file__).parent / "templates"
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
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
    writer.writerow(column.head for column in table.columns)
    for row in table.cells():
        writer.writerow([_csv_cell(cell.text if cell.raw is None else cell.raw) for cell in row])
    return stream.getvalue()


def csv_address(table: Table) -> str:
    """Give a data address that holds the table as CSV."""
    data = base64.b64encode(table_csv(table).encode(errors="replace")).decode()
    return f"data:text/csv;charset=utf-8;base64,{data}"


def _csv_cell(value: float | str) -> float | str:
    if isinstance(value, str) and value.startswith(FORMULA_STARTS):
        return f"'{value}"
    return value


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
    return environment


def _mathml(text: str) -> markupsafe.Markup:
    return markupsafe.Markup(text)  # noqa: S704 -- Equation.mathml is written in this package


def _own(name: str) -> str:
    return "\n" + (TEMPLATES / name).read_text(encoding="utf-8").strip() + "\n"


def _hash(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
