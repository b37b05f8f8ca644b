"""The page of the evaluation: which model is good enough, and for what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from ident.report.evaluate_signals import on_request, simulated_by
from ident.report.evaluated import by_agreement, shown_model
from ident.report.numbers import duration
from ident.report.page import (
    Block,
    Code,
    Columns,
    Details,
    Figure,
    Lines,
    Page,
    Section,
    Text,
    Tone,
    Verdict,
)
from ident.report.pages import evaluate_conclusions as conclusions
from ident.report.pages import evaluate_figures as figures
from ident.report.pages import evaluate_tables as tables_of
from ident.report.pages import health
from ident.report.pages.steering import refusals
from ident.report.tyre_signals import runs_of
from ident.results import EvaluateResult

MOST_RUNS_DRAWN = 12


def evaluate_page(result: EvaluateResult, tables: Mapping[str, pd.DataFrame]) -> Page:
    """Turn a result and its table into a page.

    Parameters
    ----------
    tables : "evaluate": run, time [s], speed [m/s]; each signal as measured, ``<signal>__<model>`` as
        simulated on the measured steering, ``<signal>__<model>__request`` on the request; NaN where none
    """
    runs = runs_of(tables["evaluate"]) if "evaluate" in tables else {}
    ranked = by_agreement(result, list(runs))
    return Page(
        name="evaluate",
        title="Evaluation",
        verdict=_verdict(result),
        lead=_lead(result, runs, ranked),
        sections=[
            Section("bands", "Errors by lateral acceleration", _bands(result), "By a_y"),
            Section("windows", "Errors by length of the windows", _windows(result), "By length"),
            Section("runs", "Held-out runs", _runs(result, runs, ranked), "Runs"),
            Section(
                "pairs", "Is one model really better?", conclusions.comparisons(result.comparisons), "Pairs"
            ),
            Section(
                "characteristics",
                "Characteristics of the truck and of the models",
                conclusions.characteristics(result.characteristics),
                "Characteristics",
            ),
            Section("checks", "Checks", [conclusions.checks(result.checks)]),
            Section("requirements", "Requirements", [conclusions.requirements(result.requirements)]),
            Section("measures", "All measures", [tables_of.measures(result)], "Measures"),
            Section("refused", "Refused and warned", _refused(result), "Refused"),
            Section("health", "Log health", _health(result), "Health"),
            Section("provenance", "Provenance", health.provenance_blocks(result.provenance)),
        ],
    )


def _verdict(result: EvaluateResult) -> Verdict:
    """Say in a badge whether a model may be used, after requirements and checks."""
    met = {one.met for one in result.requirements}
    checked = {one.verdict for one in result.checks}
    found: list[tuple[bool, str, Tone]] = [
        ("refused" in checked, "not to be believed", "bad"),
        (False in met, "requirement not met", "bad"),
        (result.chosen is None, "no model is good enough", "bad"),
        (None in met, "requirement not measured", "caution"),
        (result.split_by == "none", "not held out", "caution"),
        ("warning" in checked, "usable, see the checks", "caution"),
        (True, "usable", "good"),
    ]
    badge, tone = next((badge, tone) for holds, badge, tone in found if holds)
    return Verdict(badge, result.verdict, tone, result.next_step)


def _lead(result: EvaluateResult, runs: Mapping[str, pd.DataFrame], ranked: Sequence[str]) -> list[Block]:
    told: list[Block] = [tables_of.key_figures(result), Code(result.provenance.command)]
    return [
        Columns([[tables_of.overview(result)], told], wide=2.6),
        figures.lead_figure(result, runs, ranked),
    ]


def _bands(result: EvaluateResult) -> list[Block]:
    figure = figures.bands_figure(result)
    if figure is None:
        return [Text("The lateral acceleration is not known: no band was evaluated.", "muted")]
    return [figure, Details("As a table", [tables_of.by_band(result)])]


def _windows(result: EvaluateResult) -> list[Block]:
    figure = figures.windows_figure(result)
    drawn: list[Block] = [figure] if figure else [Text("No window was evaluated.", "muted")]
    return [*drawn, Details("As a table, with whole runs", [tables_of.by_window(result)])]


def _runs(result: EvaluateResult, runs: Mapping[str, pd.DataFrame], ranked: Sequence[str]) -> list[Block]:
    """Draw the run that is followed worst in the open, the others behind a line each."""
    if not ranked:
        return [Text("No run was held out: there is nothing to compare.", "muted"), tables_of.by_run(result)]
    order = [ranked[-1], *ranked[:-1]][:MOST_RUNS_DRAWN]
    blocks: list[Block] = []
    for name in order:
        rows = runs[name]
        seconds = duration(float(rows["time"].max() - rows["time"].min()))
        told = ", ".join(part for part in (seconds, figures.largest_error(name, result)) if part)
        inside = _run_blocks(result, rows, len(order))
        blocks.append(Details(f"{name}: {told}", inside, open=name == order[0]))
    if len(ranked) > len(order):
        blocks.append(Text(f"{len(ranked) - len(order)} more runs are in run.rrd.", "muted"))
    return [*blocks, Details("Errors by run as a table", [tables_of.by_run(result)])]


def _run_blocks(result: EvaluateResult, rows: pd.DataFrame, drawn: int) -> list[Block]:
    told = {str(model.name) for model in result.models}
    models: list[str] = [name for name in simulated_by(rows) if name in told]
    shown = shown_model(result)
    models += on_request(rows, shown.name) if shown else []
    found: list[Figure | None] = []
    if models:
        found = [
            figures.path_figure(result, rows, models),
            figures.run_figure(result, rows, models, drawn),
        ]
    blocks: list[Block] = [figure for figure in found if figure is not None]
    return blocks or [Text("Nothing of this run was both measured and simulated.", "muted")]


def _health(result: EvaluateResult) -> list[Block]:
    return [health.runs_table(result.runs), *[health.run_details(run) for run in result.runs]]


def _refused(result: EvaluateResult) -> list[Block]:
    blocks: list[Block] = [refusals(result.refused)]
    if result.warnings:
        blocks.append(Lines([("Warning:", text) for text in result.warnings]))
    return blocks
