"""The page of a stage that cannot answer from these logs: why, and what would help."""

from __future__ import annotations

from ident.report.page import Page, Verdict


def refused_page(name: str, title: str, reason: str) -> Page:
    """Turn a refusal into a page; ``reason`` holds what was found, what is needed and what to do."""
    return Page(
        name=name, title=title, verdict=Verdict("no answer", f"{reason}.", "caution"), lead=[], sections=[]
    )
