"""The page of the validation: which controller holds its path, on which truck, how far, and against logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from ident.glossary import controller_name
from ident.report.numbers import NONE, fixed, shorten, significant
from ident.report.page import (
    Block,
    Code,
    Column,
    Columns,
    Details,
    Lines,
    Page,
    Section,
    Table,
    Text,
    Verdict,
)
from ident.report.pages import health
from ident.report.pages import validate_conclusions as conclusions
from ident.report.pages import validate_figures as figures
from ident.report.pages import validate_runs as runs_of
from ident.report.pages import validate_tables as tables_of
from ident.report.pages.steering import refusals
from ident.report.validated import (
    by_claim,
    controllers_of,
    reached_text,
    run_title,
    scenario_name,
    scenarios_of,
    verdict_badge,
)
from ident.report.validated_runs import logged_runs, opened, starts
from ident.results.validate import ValidateResult

MOST_LOGGED, MOST_STARTS = 6, 8
LOGGED = (
    "Level 0 drives the model of the vehicle with the measured steering, level 1 with the command; level 2 "
    "lets our controllers see the logged states and compares what they would ask for; level 3 closes the "
    "loop. Each is only run where the one before agrees."
)


def validate_page(result: ValidateResult, tables: Mapping[str, pd.DataFrame]) -> Page:
    """Turn a result and its tables into a page.

    Parameters
    ----------
    tables : "validate", "validate_reference", "validate_horizon" and "validate_logged", as
        ``ident.report.validated_runs`` reads them; any may be missing
    """
    return Page(
        name="validate",
        title="Validation",
        verdict=_verdict(result),
        lead=_lead(result),
        sections=[
            Section("scenarios", "Every controller in every scenario", _scenarios(result), "Scenarios"),
            Section("claims", "The claims of the source, examined", _claims(result), "Claims"),
            Section("worst", "The worst run, opened", _worst(result, tables), "Worst run"),
            Section("pairs", "Prediction model × simulation model", _pairs(result), "Models"),
            Section(
                "mismatch", "When the truck is not what it was identified as", _mismatch(result), "Mismatch"
            ),
            Section("margins", "When the effects that were found are real", _margins(result), "Effects"),
            Section("times", "Time of a step against the period", _times(result), "Times"),
            Section("logged", "Against logs", _logged(result, tables), "Logs"),
            Section("settings", "Weights and settings", _settings(result), "Settings"),
            Section("refused", "Refused and warned", _refused(result), "Refused"),
            Section("health", "Log health", _health(result), "Health"),
            Section("provenance", "Provenance", health.provenance_blocks(result.provenance)),
        ],
    )


def _verdict(result: ValidateResult) -> Verdict:
    badge, tone = verdict_badge(result)
    return Verdict(badge, result.verdict, tone, result.next_step)


def _lead(result: ValidateResult) -> list[Block]:
    told: list[Block] = [tables_of.key_figures(result), Code(result.provenance.command)]
    drawn = figures.measures_figure(result)
    return [Columns([[tables_of.matrix(result)], told], wide=2.1), *([drawn] if drawn else [])]


def _scenarios(result: ValidateResult) -> list[Block]:
    found = scenarios_of(result)
    if not found:
        return [Text("No closed loop was driven: see what was refused.", "muted")]
    return [
        Details(
            tables_of.scenario_summary(result, name),
            tables_of.scenario_tables(result, name),
            open=name == found[0],
        )
        for name in found
    ]


def _claims(result: ValidateResult) -> list[Block]:
    found = by_claim(result.claims)
    inside = conclusions.differences(found)
    return [conclusions.claims(found), *([Details("Each difference", [inside])] if inside else [])]


def _worst(result: ValidateResult, tables: Mapping[str, pd.DataFrame]) -> list[Block]:
    """Draw the worst run in the open, the same starts with all controllers behind a line each."""
    found = opened(result, tables)
    if result.worst is None or not 0 <= result.worst < len(result.runs):
        return [Text("No run was opened.", "muted")]
    blocks: list[Block] = [Lines([("Opened:", f"{run_title(result.runs[result.worst])}.")])]
    blocks.append(Details("Its measures", [tables_of.run_facts(result.runs[result.worst])]))
    if result.worst in found:
        blocks += runs_of.worst_figures(result, tables, found[result.worst])
    else:
        blocks.append(Text("Its signals were not stored.", "muted"))
    together = [one for one in starts(result, found) if len(one.runs) > 1]
    for one in together[:MOST_STARTS]:
        title = f"{scenario_name(one.scenario, one.logged)} at {fixed(3.6 * one.speed, 0)}\u00a0km/h"
        said = f"All {len(one.runs)} controllers from one start: {title}"
        blocks.append(Details(said, [runs_of.start_figure(result, one)]))
    left = len(together) - MOST_STARTS
    return [*blocks, Text(f"{left} more starts are in run.rrd.", "muted")] if left > 0 else blocks


def _pairs(result: ValidateResult) -> list[Block]:
    drawn = figures.pairs_figure(result)
    if drawn is None:
        return [Text("Only one model was there: nothing to pair.", "muted")]
    return [drawn, Details("In numbers", [tables_of.pairs(result.pairs)])]


def _mismatch(result: ValidateResult) -> list[Block]:
    drawn = figures.mismatch_figures(result)
    return [*drawn] if drawn else [Text("No mismatch was simulated.", "muted")]


def _margins(result: ValidateResult) -> list[Block]:
    return [conclusions.margins(result.margins)]


def _times(result: ValidateResult) -> list[Block]:
    if not result.runs:
        return [Text("Nothing was driven.", "muted")]
    drawn = figures.times_figure(result)
    return [*([drawn] if drawn else []), tables_of.solve_times(result)]


def _logged(result: ValidateResult, tables: Mapping[str, pd.DataFrame]) -> list[Block]:
    if not result.logged:
        return [
            Text("No log with a reference and a command was given: there is nothing to compare.", "muted")
        ]
    blocks: list[Block] = [
        Lines([("Reached:", f"{reached_text(result)}.")]),
        Text(LOGGED, "muted"),
        conclusions.levels(result.logged),
    ]
    names = logged_runs(tables)
    for name in names[:MOST_LOGGED]:
        drawn = runs_of.logged_figures(tables, name)
        if drawn:
            blocks.append(Details(f"{shorten(name, 60)}: by arc length", drawn, open=name == names[0]))
    left = len(names) - MOST_LOGGED
    return (
        [*blocks, Text(f"{left} more runs are in signals/validate_logged.parquet.", "muted")]
        if left > 0
        else blocks
    )


def _settings(result: ValidateResult) -> list[Block]:
    blocks: list[Block] = []
    if result.settings:
        blocks.append(
            Lines(
                [
                    (f"{name.replace('_', ' ').capitalize()}:", f"{told}.")
                    for name, told in result.settings.items()
                ]
            )
        )
    if result.weights:
        blocks.append(_weights(result))
    return blocks or [Text("No weights were stored.", "muted")]


def _weights(result: ValidateResult) -> Table:
    """Give the weights of each controller: a column for each name that some controller has."""
    names = list(dict.fromkeys(name for own in result.weights.values() for name in own))
    order = [name for name in controllers_of(result) if name in result.weights]
    order += [name for name in result.weights if name not in order]
    rows = [
        [controller_name(controller), *[_weight(result.weights[controller].get(name)) for name in names]]
        for controller in order
    ]
    columns = [Column("controller"), *[Column(name.replace("_", " "), "number") for name in names]]
    notes = ["chosen by one rule, on other scenarios than those reported"]
    return Table(columns, rows, "Weights", notes=notes, download="validate_weights.csv")


def _weight(value: float | None) -> str:
    return NONE if value is None else significant(value)


def _health(result: ValidateResult) -> Sequence[Block]:
    if not result.health:
        return [Text("No logs were given.", "muted")]
    return [health.runs_table(result.health), *[health.run_details(run) for run in result.health]]


def _refused(result: ValidateResult) -> list[Block]:
    blocks: list[Block] = [refusals(result.refused)]
    if result.warnings:
        blocks.append(Lines([("Warning:", text) for text in result.warnings]))
    return blocks
