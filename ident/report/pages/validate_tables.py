"""Tables of the validation page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.glossary import controller_name
from ident.report.numbers import (
    NONE,
    count,
    fixed,
    significant,
    with_unit,
)
from ident.report.page import Block, Column, Details, Facts, Table, Text, Tone
from ident.report.page import Cell as Entry
from ident.report.pages import health
from ident.report.validated import (
    ALWAYS_TOLD,
    BEST,
    SHORT_SCENARIOS,
    cell_of,
    completed_text,
    controllers_of,
    disturbance_text,
    is_best,
    lost_in,
    main_measure,
    measure_of,
    measures_of,
    reached_text,
    rounded,
    scenario_name,
    scenarios_of,
    score_of,
    shown_range,
    shown_score,
    simulated_name,
    upper_first,
)
from ident.results.validate import Cell, ClosedLoopRun, ModelPair, ValidateResult

STARRED = f"{BEST}: no other controller is clearly better there (paired over the same starts)"
MEDIANS = "median over the runs that came to the end; small: its 95 % interval"


def matrix(result: ValidateResult) -> Block:
    """Give each controller in each scenario by the measure that matters, the best first."""
    measure, scenarios = main_measure(result), scenarios_of(result)
    if measure is None:
        return Text("No closed loop was scored: see what was refused.", "caution")
    heads = [Column(SHORT_SCENARIOS[name], "number") for name in SHORT_SCENARIOS if name in scenarios]
    columns = [Column("controller"), *heads, Column("step p99 [ms]", "number")]
    rows = [
        [
            Entry(f"{place}. {controller_name(name)}"),
            *[_matrix_entry(cell_of(result, name, where), measure) for where in scenarios],
            _slowest(result, name),
        ]
        for place, name in enumerate(controllers_of(result), 1)
    ]
    shown = measure_of(measure)
    return Table(
        columns,
        rows,
        f"{upper_first(shown.name)} [{shown.unit}] of each controller, best ranked first",
        notes=[MEDIANS, STARRED, "✗: the truck left the lane or did not come to the end"],
        records=cell_records(result),
        download="validate_cells.csv",
    )


def _matrix_entry(cell: Cell | None, measure: str) -> Entry:
    if cell is None or not cell.runs:
        return Entry(NONE, tone="muted")
    score, lost = score_of(cell, measure), lost_in(cell)
    text = shown_score(score) if cell.completed else "✗\u00a0lost"
    if is_best(cell, measure):
        text = f"{BEST}\u00a0{text}"
    said = [part for part in (shown_range(score), completed_text(cell) if lost else None) if part]
    return Entry(text, tone=_tone(cell, measure), detail="; ".join(said) or None)


def _tone(cell: Cell, measure: str) -> Tone:
    if lost_in(cell):
        return "bad"
    return "good" if is_best(cell, measure) else "plain"


def _slowest(result: ValidateResult, controller: str) -> Entry:
    """Give the longest 99th percentile of the time of a step, over all runs."""
    times = [run.solve_time_p99 for run in result.runs if run.controller == controller]
    if not times:
        return Entry(NONE, tone="muted")
    late = max(times) > result.period
    text = significant(1e3 * max(times), 2)
    return Entry(f"✗\u00a0{text}" if late else text, raw=max(times), tone="bad" if late else "plain")


def cell_records(result: ValidateResult) -> list[dict[str, float | int | str | None]]:
    """Give one record for each measure of each cell, in SI units."""
    return [
        {
            "scenario": cell.scenario,
            "controller": cell.controller,
            "runs": cell.runs,
            "completed": cell.completed,
            "measure": score.measure,
            "value": score.value,
            "low": score.low,
            "high": score.high,
            "unit": score.unit,
            "best": int(is_best(cell, score.measure)),
        }
        for cell in result.cells
        for score in cell.scores
    ]


def key_figures(result: ValidateResult) -> Facts:
    """Give what tells at a glance what was driven, how the loop was closed, how far logs were followed."""
    lost = sum(not run.completed for run in result.runs)
    speeds = sorted({run.speed for run in result.runs})
    missed = sum(run.deadline_misses for run in result.runs)
    failed = sum(run.infeasible for run in result.runs)
    items: list[tuple[str, Entry | str]] = [
        (
            "closed loops",
            Entry(count(len(result.runs), "run"), detail=f"{lost} lost their path" if lost else None),
        ),
        ("controllers", Entry(str(len(controllers_of(result))), detail=_best(result))),
        ("speed", _speeds(speeds)),
        (
            "period",
            Entry(with_unit(1e3 * result.period, "ms", 2), detail=f"{count(missed, 'step')} took longer"),
        ),
        ("solver", Entry(f"{count(failed, 'step')} on the fallback", tone="caution" if failed else "good")),
        ("against logs", Entry(reached_text(result), tone="muted" if result.reached is None else "plain")),
    ]
    return Facts(items + ([("logs", health.brief(result.health))] if result.health else []))


def _best(result: ValidateResult) -> str | None:
    return f"best: {controller_name(result.ranking[0])}" if result.ranking else None


def _speeds(speeds: Sequence[float]) -> Entry:
    if not speeds:
        return Entry(NONE, tone="muted")
    ends = [fixed(3.6 * speed, 0) for speed in (speeds[0], speeds[-1])]
    return Entry(f"{ends[0]}\u00a0km/h" if ends[0] == ends[1] else f"{ends[0]} … {ends[1]}\u00a0km/h")


def scenario_tables(result: ValidateResult, scenario: str) -> list[Block]:
    """Give every measure of every controller in one scenario, the rarely asked ones behind a line."""
    found = [cell_of(result, name, scenario) for name in controllers_of(result)]
    cells = [cell for cell in found if cell is not None]
    measures = measures_of(cells)
    first, rest = ([m for m in measures if (m in ALWAYS_TOLD) == told] for told in (True, False))
    tables: list[Block] = [_scores(cells, first or rest, f"validate_{scenario}.csv")]
    if first and rest:
        tables.append(Details("Other measures", [_scores(cells, rest, f"validate_{scenario}_other.csv")]))
    return tables


def _scores(cells: Sequence[Cell], measures: Sequence[str], download: str) -> Table:
    heads = [Column(measure_of(name, _unit(cells, name)).head, "number") for name in measures]
    rows = [
        [
            Entry(controller_name(cell.controller)),
            Entry(completed_text(cell), tone="bad" if lost_in(cell) else "good"),
            *[_score_entry(cell, name) for name in measures],
        ]
        for cell in cells
    ]
    columns = [Column("controller"), Column("came through"), *heads]
    return Table(columns, rows, notes=[MEDIANS, STARRED], download=download)


def scenario_summary(result: ValidateResult, scenario: str) -> str:
    """Say in one line how a scenario went."""
    cells = [cell for cell in result.cells if cell.scenario == scenario]
    runs, lost = sum(cell.runs for cell in cells), sum(map(lost_in, cells))
    return f"{upper_first(scenario_name(scenario))}: {count(runs, 'run')}, {lost or 'none'} lost"


def _unit(cells: Sequence[Cell], measure: str) -> str:
    return next(score.unit for cell in cells for score in cell.scores if score.measure == measure)


def _score_entry(cell: Cell, measure: str) -> Entry:
    score = score_of(cell, measure)
    if score is None:
        return Entry(NONE, tone="muted")
    best = is_best(cell, measure)
    text = f"{BEST}\u00a0{shown_score(score)}" if best else shown_score(score)
    return Entry(text, raw=score.value, tone="good" if best else "plain", detail=shown_range(score))


def run_facts(run: ClosedLoopRun) -> Facts:
    """Give the measures of one run."""
    late = NONE if run.arrival_time_error is None else f"{rounded(run.arrival_time_error, 3)}\u00a0s"
    came = (
        Entry("yes", tone="good")
        if run.completed
        else Entry(f"no: {run.lost or 'the path was lost'}", tone="bad")
    )
    cycles = f"{run.violations} beyond a limit, {run.infeasible} without a solution"
    return Facts(
        [
            ("came through", came),
            ("disturbed", disturbance_text(run)),
            ("predicts with", simulated_name(run.prediction_model)),
            ("simulated as", simulated_name(run.simulation_model)),
            ("lateral error", _sizes(("largest", run.lateral_error_max), ("RMS", run.lateral_error_rms))),
            ("settled at", f"{rounded(1e3 * run.lateral_error_settled, 1)}\u00a0mm"),
            ("late by", late),
            ("work, braking and accelerating", _works(run)),
            ("lateral acceleration, jerk", _dynamics(run)),
            ("steering rate", _rates(run)),
            ("cycles", cycles),
            ("step p50, p99", f"{significant(1e3 * run.solve_time_p50, 2)}, {_ms(run.solve_time_p99)}"),
        ]
    )


def _sizes(*sizes: tuple[str, float]) -> str:
    return ", ".join(f"{name} {with_unit(size, 'm')}" for name, size in sizes)


def _works(run: ClosedLoopRun) -> str:
    works = (significant(run.braking_work), with_unit(run.acceleration_work, "J/kg"))
    return f"{' and '.join(works)}, {count(run.drive_switches, 'change', 'changes')}"


def _dynamics(run: ClosedLoopRun) -> str:
    jerk = with_unit(run.lateral_jerk_rms, "m/s³")
    return f"at most {with_unit(run.lateral_acceleration_max, 'm/s²')}, RMS {jerk}"


def _rates(run: ClosedLoopRun) -> str:
    rates = (significant(1e3 * run.steering_rate_rms), with_unit(1e3 * run.steering_rate_max, "mrad/s"))
    return f"RMS {rates[0]}, at most {rates[1]}, {with_unit(run.steering_reversals, '1/s', 2)} reversals"


def _ms(seconds: float) -> str:
    return with_unit(1e3 * seconds, "ms", 2)


def pairs(found: Sequence[ModelPair]) -> Table:
    """Give every pair of a prediction model and a simulation model in numbers."""
    columns = [
        Column("controller"),
        Column("predicts with"),
        Column("simulated as"),
        Column("came through [%]", "number"),
        Column("e_y RMS [m]", "number"),
        Column("|e_y| max [m]", "number"),
        Column("prediction [ns/step]", "number"),
    ]
    rows = [
        [
            Entry(controller_name(one.controller)),
            Entry(simulated_name(one.prediction_model)),
            Entry(simulated_name(one.simulation_model)),
            share_entry(one.completed),
            Entry(significant(one.lateral_error_rms), raw=one.lateral_error_rms),
            Entry(significant(one.lateral_error_max), raw=one.lateral_error_max),
            Entry(significant(one.cost_ns_per_step), raw=one.cost_ns_per_step),
        ]
        for one in found
    ]
    return Table(columns, rows, download="validate_pairs.csv", scroll=len(rows) > 16)


def share_entry(completed: float) -> Entry:
    """Give the share of runs that came through in percent, never rounded up to all of them."""
    lost = completed < 1
    text = fixed(min(100 * completed, 99.0) if lost else 100.0, 0)
    return Entry(f"✗\u00a0{text}" if lost else text, raw=completed, tone="bad" if lost else "good")


def solve_times(result: ValidateResult) -> Table:
    """Give the time of a step of each controller, and how often it failed or took too long."""
    columns = [
        Column("controller"),
        Column("p50 [ms]", "number"),
        Column("p95 [ms]", "number"),
        Column("p99 [ms]", "number"),
        Column("of the period [%]", "number"),
        Column("took longer than the period", "number"),
        Column("no solution: fallback", "number"),
        Column("beyond a limit", "number"),
        Column("runs", "number"),
    ]
    rows = [
        _time_row(result, name, own)
        for name in controllers_of(result)
        if (own := [run for run in result.runs if run.controller == name])
    ]
    notes = [
        f"period {with_unit(1e3 * result.period, 'ms', 2)}; p50: median over the runs, p95 and p99: largest"
    ]
    return Table(columns, rows, notes=notes, download="validate_times.csv")


def _time_row(result: ValidateResult, name: str, runs: Sequence[ClosedLoopRun]) -> list[Entry]:
    p50 = float(np.median([run.solve_time_p50 for run in runs]))
    p95, p99 = (max(getattr(run, f"solve_time_{part}") for run in runs) for part in ("p95", "p99"))
    share = p99 / result.period
    return [
        Entry(controller_name(name)),
        *[Entry(rounded(1e3 * value, 2), raw=value) for value in (p50, p95, p99)],
        Entry(significant(100 * share, 2), raw=share, tone="bad" if share > 1 else "plain"),
        *[_counted(sum(getattr(run, what) for run in runs)) for what in ("deadline_misses", "infeasible")],
        Entry(str(violations := sum(run.violations for run in runs)), raw=violations),
        Entry(str(len(runs)), raw=len(runs)),
    ]


def _counted(number: int) -> Entry:
    return Entry(f"✗\u00a0{number}" if number else "0", raw=number, tone="bad" if number else "good")
