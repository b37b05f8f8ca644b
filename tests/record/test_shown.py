"""What the command shows of a recording; topics are named by others, and may be named anything."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import pytest
from rich.console import Console

from ident.cli.record import _followed, _summary, _table
from ident.record.status import Status, Tally

TOPICS = [
    Tally("/slow", "A", messages=10, bytes=1_000_000, rate=1.0),
    Tally("/fast\x1b[2J", "B", messages=1000, bytes=2_500_000, lost=7, rate=100.0, best_effort=True),
    *(Tally(f"/idle{k}", "C") for k in range(30)),
]
STATUS = Status(10.0, TOPICS, [("/un\x07told", "D", "no type")], 3_500_000)


def test_the_table_shows_the_busiest_topics_first() -> None:
    shown = io.StringIO()
    Console(file=shown, width=100).print(_table(STATUS))
    lines = [line.split() for line in shown.getvalue().splitlines()]
    assert shown.getvalue().startswith("10 s: 1010 messages, 101/s, 3.5 MB, 32 topics, 7 lost\n")
    assert lines[2] == ["/fast\\x1b[2J", "1000", "100", "2.5", "7"]
    assert lines[3] == ["/slow", "10", "1", "1.0", "0"]
    assert len(lines) == 22


def test_the_summary_tells_losses_and_refusals() -> None:
    lines = _summary(Path("my drive.mcap"), STATUS).splitlines()
    assert lines[:2] == [
        "/slow: 10 messages, 1.0/s",
        "/fast\x1b[2J: 1000 messages, 100.0/s, 7 lost (best effort: what was lost on the way is not counted)",
    ]
    assert lines[-3:] == [
        "refused /un\x07told (D): no type",
        "my drive.mcap: 1010 messages, 3.5 MB in 10.0 s, 7 counted as lost",
        "Look at it with: ident info 'my drive.mcap'",
    ]


def test_events_are_lines_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with _followed(quiet=False) as (show, note):
        note("recording /a\x1b[2J\nb (A)")
        for seconds in (1.0, 10.5, 11.5, 21.0):
            show(Status(seconds, TOPICS[:1], [], 1_000_000))
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.splitlines() == [
        "recording /a\\x1b[2J b (A)",
        "10 s: 10 messages, 1/s, 1.0 MB, 1 topics, 0 lost",
        "21 s: 10 messages, 1/s, 1.0 MB, 1 topics, 0 lost",
    ]


def test_quiet_shows_nothing(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with _followed(quiet=True) as (show, note):
        note("recording /a")
        show(STATUS)
    assert capsys.readouterr() == ("", "")
