"""Text and progress on the terminal; names from a log may hold anything, also terminal commands."""

from __future__ import annotations

import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.progress import Progress as Bars

    from ident.pipeline.options import Progress

_ERROR_LENGTH = 500


def printable(text: str) -> str:
    """Write out control characters, such as the escape that begins a terminal command, except line ends."""
    return "".join(c if _is_harmless(c) else c.encode("unicode_escape").decode() for c in text)


def one_line(text: str) -> str:
    """Put a message on one line of bounded length."""
    line = printable(" ".join(text.split()))
    return line if len(line) <= _ERROR_LENGTH else f"{line[: _ERROR_LENGTH - 3]}..."


@contextmanager
def progress_shown(quiet: bool) -> Iterator[Progress]:
    """Show progress on standard error: a bar on a terminal, plain lines elsewhere, nothing if ``quiet``."""
    if quiet:
        yield lambda *_: None
    elif sys.stderr.isatty():
        with _bars() as bars:
            yield _Bar(bars)
    else:
        yield _Lines()


def _bars() -> Bars:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)


def _is_harmless(character: str) -> bool:
    return character == "\n" or character.isprintable() or unicodedata.category(character) == "Zs"


class _Bar:
    """One bar, which names what is being done."""

    def __init__(self, bars: Bars) -> None:
        self._bars = bars
        self._task = bars.add_task("starting", total=None)

    def __call__(self, what: str, done: int, total: int) -> None:
        self._bars.update(self._task, description=one_line(what), completed=done, total=total)


class _Lines:
    """One line when a thing begins."""

    def __init__(self) -> None:
        self._begun: set[str] = set()

    def __call__(self, what: str, done: int, total: int) -> None:
        if done < total and what not in self._begun:
            self._begun.add(what)
            click.echo(one_line(what), err=True)
