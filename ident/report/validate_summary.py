"""The answer of ``ident validate`` in plain text, for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from ident.glossary import controller_name
from ident.report.numbers import NONE, count, listed, plain, significant
from ident.report.refusals import by_reason
from ident.report.validated import (
    HOLDS,
    SHORT_SCENARIOS,
    cell_of,
    completed_text,
    controllers_of,
    is_best,
    lost_in,
    main_measure,
    measure_of,
    reached_text,
    run_title,
    scenarios_of,
    score_of,
    shown_score,
    simulated_name,
)
from ident.results.validate import ClosedLoopRun, ValidateResult

MOST_LINES = 8
STAR = "*"


def describe_validate(result: ValidateResult) -> str:
    """Say which controller holds its path where, how far the logs were followed, what to do next.

    Returns
    -------
    text : of a few lines, without control characters; the last line does not end with a line break
    """
    lines = [plain(result.verdict), f"  predicts with: {plain(simulated_name(result.model))}", ""]
    lines += [*_table_lines(result), *_worst_lines(result), *_margin_lines(result), *_claim_lines(result)]
    if result.logged:
        lines.append(f"against logs: {reached_text(result)}")
    lines += _limited("refused", [f"{what}: {reason}" for what, reason in by_reason(result.refused)])
    lines += _limited("warning", result.warnings)
    if result.next_step:
        lines += ["", f"next: {plain(result.next_step)}"]
    return "\n".join(lines).rstrip("\n")


def _table_lines(result: ValidateResult) -> list[str]:
    """Put the measure that matters of each controller in each scenario into columns, the best first."""
    measure, scenarios = main_measure(result), scenarios_of(result)
    if measure is None:
        return []
    shown = measure_of(measure)
    heads = [SHORT_SCENARIOS[name] for name in SHORT_SCENARIOS if name in scenarios]
    rows: list[Sequence[str]] = [(f"{shown.name} [{shown.unit}]", *heads, "p99 [ms]")]
    for name in controllers_of(result):
        cells = [_cell_text(result, name, where, measure) for where in scenarios]
        rows.append((controller_name(name), *cells, _slowest(result, name)))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    note = f"  median over disturbed starts; {STAR} no other is clearly better; p99: of a step"
    period = f"period {significant(1e3 * result.period, 2)} ms"
    return [*("  " + _aligned(row, widths) for row in rows), f"{note}, {period}", ""]


def _cell_text(result: ValidateResult, controller: str, scenario: str, measure: str) -> str:
    cell = cell_of(result, controller, scenario)
    if cell is None or not cell.runs:
        return NONE
    if not cell.completed:
        return _words(completed_text(cell))
    star = f"{STAR} " if is_best(cell, measure) else ""
    lost = f" ({_words(completed_text(cell))})" if lost_in(cell) else ""
    return f"{star}{shown_score(score_of(cell, measure))}{lost}"


def _words(text: str) -> str:
    return text.replace("\u00a0", " ")


def _slowest(result: ValidateResult, controller: str) -> str:
    times = [run.solve_time_p99 for run in result.runs if run.controller == controller]
    late = bool(times) and max(times) > result.period
    return ("✗ " if late else "") + (significant(1e3 * max(times), 2) if times else NONE)


def _aligned(row: Sequence[str], widths: Sequence[int]) -> str:
    cells = [cell.rjust(width) for cell, width in zip(row, widths, strict=True)]
    return "  ".join([row[0].ljust(widths[0]), *cells[1:]])


def _worst_lines(result: ValidateResult) -> list[str]:
    if result.worst is None or not 0 <= result.worst < len(result.runs):
        return []
    run = result.runs[result.worst]
    said = _lost_text(run) or f"largest error {significant(run.lateral_error_max)} m"
    lost = sum(not one.completed for one in result.runs)
    driven = f"driven: {count(len(result.runs), 'closed loop')}, {lost} lost their path"
    return [_words(driven), f"worst: {plain(_words(run_title(run)))}: {said}"]


def _lost_text(run: ClosedLoopRun) -> str | None:
    """Say how a run lost its path, None where it did not."""
    return None if run.completed else f"path lost: {run.lost}" if run.lost else "path lost"


def _margin_lines(result: ValidateResult) -> list[str]:
    """Say which controllers lose their margin when the effects that were found are real."""
    if not result.margins:
        return []
    effects = listed(list(dict.fromkeys(name for one in result.margins for name in one.effects)))
    lost = list(dict.fromkeys(controller_name(one.controller) for one in result.margins if one.is_lost))
    said = listed(lost, 9) if lost else "no controller"
    return [
        plain(f"with {effects.replace('_', ' ')}: {said} {'lose' if len(lost) > 1 else 'loses'} the margin")
    ]


def _claim_lines(result: ValidateResult) -> list[str]:
    """Tell the claims that the runs decide, and count the others."""
    decided = [one for one in result.claims if one.holds != "undecided"]
    lines = [plain(f"claim {HOLDS[one.holds][0]}: {one.claim} ({one.evidence})") for one in decided]
    left = len(result.claims) - len(decided)
    return [*lines, f"{count(left, 'claim')} undecided: the report has them"] if left else lines


def _limited(what: str, texts: Sequence[str]) -> list[str]:
    lines = [f"{what}: {plain(text)}" for text in texts[:MOST_LINES]]
    left = len(texts) - len(lines)
    return [*lines, f"{what}: and {left} more, in the report"] if left else lines
