"""The page of a stage that cannot answer from these logs: why, and what would help."""

from __future__ import annotations

from ident.report.page import Page, Text, Verdict

WHERE_TO_LOOK = (
    "The page of the logs shows which signals were found and which are missing. Once the logs, the files "
    "that apply to them or the recipe have changed, the next run asks this question again."
)


def refused_page(name: str, title: str, reason: str) -> Page:
    """Turn a refusal into a page; ``reason`` holds what was found, what is needed and what to do."""
    return Page(name, title, Verdict("no answer", f"{reason}.", "caution"), [Text(WHERE_TO_LOOK)])
