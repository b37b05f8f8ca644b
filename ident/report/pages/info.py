"""The page of the info stage: what is in the logs and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence

from ident.glossary import SIGNALS
from ident.report.numbers import NONE, count, duration, listed, shorten, unit_text
from ident.report.page import Block, Cell, Column, Facts, Lines, Page, Section, Table, Text, Verdict
from ident.report.pages import health
from ident.results import InfoResult, RunHealth

NAME_THEM = "name the topics of your logs in channels.yaml; ident init LOGS writes a first one with guesses"
MOST_OPEN = 3
"""With more runs than this, the details of all but the first are folded."""


def info_page(result: InfoResult) -> Page:
    """Turn an info result into a page."""
    few = len(result.runs) <= MOST_OPEN
    details: list[Block] = [
        health.run_details(run, unfolded=few or index == 0) for index, run in enumerate(result.runs)
    ]
    return Page(
        name="info",
        title="Logs",
        verdict=_verdict(result),
        lead=[Facts([("recording", health.brief(result.runs))]), signals_found(result.runs)],
        sections=[
            Section("runs", "Run by run", [health.runs_table(result.runs), *details], "Runs"),
            Section("unreadable", "Unreadable and warned", _problems(result), "Problems"),
            Section("provenance", "Provenance", health.provenance_blocks(result.provenance)),
        ],
    )


def _verdict(result: InfoResult) -> Verdict:
    total = sum(run.duration for run in result.runs)
    text = f"{count(len(result.runs), 'run')} read, {duration(total)}"
    damaged = sum(bool(run.damage) for run in result.runs)
    if damaged:
        text += f"; {damaged} of them damaged"
    if result.unreadable:
        text += f"; {count(len(result.unreadable), 'log')} unreadable"
    if result.runs and not any(run.signals for run in result.runs):
        return Verdict("no signals", f"{text}; no topic is known as a signal.", "caution", NAME_THEM)
    if result.unreadable or damaged:
        return Verdict("partly read", f"{text}.", "caution")
    return Verdict("read", f"{text}.", "good")


def signals_found(runs: Sequence[RunHealth]) -> Table:
    """Say which signal is in how many runs, where it comes from, and where it is missing."""
    names = dict.fromkeys(
        [name for run in runs for name in run.signals] + [name for run in runs for name in run.missing]
    )
    columns = [
        Column("signal"),
        Column("unit"),
        Column("runs", "number"),
        Column("from", code=True, wrap=True),
        Column("missing in", wrap=True),
    ]
    return Table(
        columns, [_signal_row(name, runs) for name in names], download="signals.csv", scroll=len(names) > 12
    )


def _signal_row(name: str, runs: Sequence[RunHealth]) -> list[Cell]:
    sources = dict.fromkeys(run.signals[name].source for run in runs if name in run.signals)
    without = [run.name for run in runs if name not in run.signals]
    found = len(runs) - len(without)
    unit = SIGNALS[name].unit if name in SIGNALS else NONE
    return [
        Cell(name.replace("_", " ")),
        Cell(unit_text(unit)),
        Cell(f"{found} of {len(runs)}", raw=found, tone="plain" if found else "muted"),
        Cell(listed(list(sources), 3) or NONE),
        Cell(
            "every run" if not found else listed([shorten(run, 30) for run in without]) or NONE, tone="muted"
        ),
    ]


def _problems(result: InfoResult) -> list[Block]:
    lines = [(f"{refusal.what}:", refusal.reason) for refusal in result.unreadable]
    lines += [("Warning:", text) for text in result.warnings]
    return [Lines(lines)] if lines else [Text("Every log could be read.", "good")]
