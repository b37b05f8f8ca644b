"""Record live topics, where the part that this needs is installed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from ident.errors import UsageError
from ident.record.selection import Selection
from ident.record.status import Status
from ident.units import parse_quantity

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["Status", "missing_topics", "record_topics"]

_INSTALL = "pip install 'ident[dds]'"


def record_topics(
    domain: int,
    out: Path,
    wanted: Sequence[str],
    unwanted: Sequence[str],
    *,
    duration: str | None,
    overwrite: bool,
    show: Callable[[Status], None],
    note: Callable[[str], None],
) -> Status:
    """Record until interrupted (Ctrl-C, SIGTERM) or, where ``duration`` is given, for that long.

    Raises
    ------
    UsageError
        If Cyclone DDS is not installed, the duration makes no sense, or the file exists or cannot be made.
    """
    seconds = None if duration is None else parse_quantity(duration, unit="s", quantity="--duration")
    if seconds is not None and seconds <= 0:
        raise UsageError(f"--duration: {seconds:g} s, need more than 0 s")
    try:
        from ident.record.recorder import Request, Watch, record
    except ImportError as error:
        text = f"recording needs Cyclone DDS, which is not installed: {_INSTALL} ({error})"
        raise UsageError(text) from error
    request = Request(domain, out, Selection(wanted, unwanted), seconds, overwrite)
    with _until_signalled() as stopped:
        return record(request, Watch(lambda: bool(stopped), show, note))


def missing_topics(wanted: Sequence[str], status: Status) -> list[str]:
    """Return what was asked for and is neither recorded nor refused."""
    seen = [(tally.topic, tally.kind) for tally in status.topics]
    return Selection(wanted).missing([*seen, *((topic, kind) for topic, kind, _ in status.refused)])


@contextmanager
def _until_signalled() -> Iterator[list[int]]:
    """Give a list that is empty until a first SIGINT or SIGTERM; a second one does what it usually does."""
    stopped: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def stop(number: int, _: FrameType | None) -> None:
        stopped.append(number)
        restore()

    for number in before:
        signal.signal(number, stop)
    try:
        yield stopped
    finally:
        restore()
