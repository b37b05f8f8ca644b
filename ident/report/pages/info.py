"""The page of the info stage: what is in the logs and what is wrong with them."""

from __future__ import annotations

from ident.report.numbers import count, duration
from ident.report.page import Block, Cell, Facts, Lines, Page, Section, Text, Verdict
from ident.report.pages import health
from ident.results import InfoResult

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
        lead=[_facts(result), health.runs_table(result.runs)],
        sections=[
            Section("runs", "Run by run", details, "Runs"),
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
    if result.unreadable or damaged:
        return Verdict("partly read", f"{text}.", "caution")
    return Verdict("read", f"{text}.", "good")


def _facts(result: InfoResult) -> Facts:
    mapped = sorted({name for run in result.runs for name in run.signals})
    everywhere = [name for name in mapped if all(name in run.signals for run in result.runs)]
    partly = [name for name in mapped if name not in everywhere]
    items: list[tuple[str, Cell | str]] = [
        ("signals in every run", ", ".join(everywhere).replace("_", " ") or "none"),
        ("signals in some runs", ", ".join(partly).replace("_", " ") or "none"),
        ("recording", health.brief(result.runs)),
    ]
    return Facts(items)


def _problems(result: InfoResult) -> list[Block]:
    lines = [(f"{refusal.what}:", refusal.reason) for refusal in result.unreadable]
    lines += [("Warning:", text) for text in result.warnings]
    return [Lines(lines)] if lines else [Text("Every log could be read.", "good")]
