"""How an estimate stands in a table: value, interval, unit, and whether the data tell it."""

from __future__ import annotations

from ident.report.numbers import estimate_interval, estimate_value, p_value, unit_text
from ident.report.page import Cell, Column, Tone
from ident.results import Estimate, Status

STATUS: dict[Status, str] = {
    "identified": "identified",
    "weak": "weak",
    "not_identifiable": "not identifiable",
}
TONES: dict[Status, Tone] = {"identified": "good", "weak": "caution", "not_identifiable": "bad"}
AGREE_FROM = 0.05
"""p-value from which the runs are said to agree."""


def parameter_columns() -> list[Column]:
    """Columns of a table of parameters: symbol, name, and those of :func:`estimate_cells`."""
    return [
        Column(""),
        Column("parameter"),
        Column("value", "number"),
        Column("95 % interval", "number"),
        Column("unit"),
        Column("status"),
    ]


def estimate_cells(estimate: Estimate, shown: Estimate | None = None) -> list[Cell]:
    """Value, interval, unit and status.

    shown : the same estimate in the unit in which it is read, where that is another
    """
    own = estimate if shown is None else shown
    return [
        Cell(estimate_value(own), raw=own.value),
        Cell(estimate_interval(own)),
        Cell(unit_text(own.unit)),
        Cell(STATUS[estimate.status], tone=TONES[estimate.status], badge=True),
    ]


def agreement_cell(p: float | None) -> Cell:
    """Whether one model holds for all runs, by the p-value of that hypothesis."""
    if p is None:
        return Cell("not tested: it takes two runs with a fit of their own", tone="muted")
    if p < AGREE_FROM:
        return Cell(f"rejected at 5 % ({p_value(p)})", raw=p, tone="caution")
    return Cell(f"not rejected at 5 % ({p_value(p)})", raw=p, tone="good")
