"""The page of the improvement: what the model lacked, what was added, and the error before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from ident.report.improved import (
    BADGES,
    added_names,
    effect_name,
    place_name,
    runs_in,
    signals_of,
    size_text,
)
from ident.report.mathml import equation
from ident.report.numbers import NONE, duration, fixed, p_value
from ident.report.page import Block, Code, Columns, Details, Lines, Page, Section, Text, Verdict
from ident.report.pages import health
from ident.report.pages import improve_figures as figures
from ident.report.pages import improve_tables as tables_of
from ident.report.pages.steering import refusals
from ident.report.tyre_parameters import displayed, in_order
from ident.results import DIFFERENT_SIZES, DOUBTFUL_SIZES, Discovered, FoundEffect, ImproveResult, ImproveStep

MOST_RUNS_DRAWN = 12


def improve_page(result: ImproveResult, tables: Mapping[str, pd.DataFrame]) -> Page:
    """Turn a result and its tables into a page.

    Parameters
    ----------
    tables : "improve" and "improve_held_out", as ``ident.report.improved`` describes them
    """
    table = tables.get("improve")
    return Page(
        name="improve",
        title="Improvement",
        verdict=_verdict(result),
        lead=_lead(result, table),
        sections=[
            *(_of_the_loop(result, tables, table) if result.layers else []),
            Section("detectable", "What these data would show", _detectable(result), "Detectable"),
            Section("sensors", "Sensors against each other", [tables_of.sensors(result.sensors)], "Sensors"),
            Section("refused", "Refused and warned", _refused(result), "Refused"),
            Section("health", "Log health", _health(result), "Health"),
            Section("provenance", "Provenance", health.provenance_blocks(result.provenance)),
        ],
    )


def _of_the_loop(
    result: ImproveResult, tables: Mapping[str, pd.DataFrame], table: pd.DataFrame | None
) -> list[Section]:
    """Sections that there are where a model was looked at."""
    return [
        Section("effect", "What was added", _effects(result), "Effect"),
        Section("residual", "The residual and what explains it", _residual(result, table), "Residual"),
        Section("evidence", "Chain of evidence", _evidence(result), "Evidence"),
        Section("confirmation", "Runs that took no part", _confirmation(result, tables), "Held out"),
        Section("separate", "What could not be separated", _separate(result), "Next run"),
        Section("runs", "Measured, before and after", _runs(tables), "Runs"),
    ]


def _verdict(result: ImproveResult) -> Verdict:
    badge, tone = BADGES[result.verdict]
    if not result.layers:
        badge, tone = "only sensors tested", "caution"
    elif result.verdict == "named" and result.confirmation is not None and not result.confirmation.confirmed:
        badge, tone = "named, not confirmed", "caution"
    following = None if result.next_experiment is None else result.next_experiment.drive
    return Verdict(badge, result.told, tone, following)


def _lead(result: ImproveResult, table: pd.DataFrame | None) -> list[Block]:
    told: list[Block] = [tables_of.key_figures(result), Code(result.provenance.command)]
    if not signals_of(result):
        said = "No model could be compared with these data; only the sensors were."
        return [Text(said, "caution"), tables_of.sensors(result.sensors), *told]
    drawn = figures.lead_figure(result, table)
    return [Columns([[tables_of.errors(result)], told], wide=1.55), *([drawn] if drawn else [])]


def _effects(result: ImproveResult) -> list[Block]:
    blocks: list[Block] = []
    for effect in result.effects:
        blocks += _effect(effect)
    if result.discovered is not None:
        blocks += _discovered(result.discovered)
    share = {name: one for found in _added(result) for name, one in found.share.items()}
    blocks += (
        [Lines(_shares(share, result.error.at_least, together=len(_added(result)) > 1))] if share else []
    )
    return blocks or [Text(_nothing(result), "muted")]


def _added(result: ImproveResult) -> list[FoundEffect | Discovered]:
    return [*result.effects, *([] if result.discovered is None else [result.discovered])]


def _nothing(result: ImproveResult) -> str:
    """Say why nothing was added."""
    if not result.steps:
        return "Nothing was added: no model could be tested with these data."
    if result.verdict == "unexplained":
        return "Nothing was added: the model lacks something, but no effect and no term explains it."
    return "Nothing was added: the data do not tell that the model lacks anything."


def _effect(effect: FoundEffect) -> list[Block]:
    head = f"{effect_name(effect.key)} (enters at the {place_name(effect.enters)}):"
    same = effect.same_in_runs_p
    told = [
        (head, effect.meaning),
        ("What speaks for it:", f"{p_value(effect.p_value)} after the correction."),
    ]
    if same is not None:
        told.append(("Run by run:", f"{_agreement(same)} ({p_value(same)})."))
    others = [effect_name(one) for one in effect.members if one not in (effect.key, effect.name)]
    if others:
        told.append(("These data cannot tell it from:", f"{', '.join(others)}."))
    typeset = [equation(effect.equation)] if effect.equation else []
    return [*typeset, tables_of.parameters(effect), Lines(told)]


def _agreement(p: float) -> str:
    """What a p-value says of the sizes that single runs give an effect."""
    if p < DIFFERENT_SIZES:
        return "the runs contradict each other"
    if p < DOUBTFUL_SIZES:
        return "the runs differ somewhat, less than it takes to doubt the effect"
    return "the runs agree on its size"


def _shares(share: Mapping[str, float], at_least: Sequence[str], *, together: bool) -> list[tuple[str, str]]:
    limits = {name: "at least " if name in at_least else "" for name in share}
    parts = [
        f"{name.replace('_', ' ')} {limits[name]}{fixed(100 * share[name], 0)}\u00a0%"
        for name in in_order(share)
    ]
    head = "All together take away" if together else "Takes away"
    return [(f"{head}, of the error above the noise:", f"{', '.join(parts)}.")]


def _discovered(found: Discovered) -> list[Block]:
    head = f"{found.term} in the {place_name(found.equation)}:"
    told = [
        (head, "no effect of the catalogue; the term that fits what is left best, without a physical name."),
        ("Coefficient:", f"{size_text(found.coefficient)}, {p_value(found.p_value)}."),
        ("Chosen in half-samples:", f"{fixed(100 * found.stability, 0)}\u00a0% of them."),
    ]
    return [equation(found.mathml), Lines(told)]


def _residual(result: ImproveResult, table: pd.DataFrame | None) -> list[Block]:
    drawn = None if table is None else figures.residual_figure(result, table)
    if drawn is None:
        return [Text("No variable was found on which the residual hangs.", "muted")]
    return [drawn]


def _evidence(result: ImproveResult) -> list[Block]:
    if not result.steps:
        return [Text("No step could be made: see what was refused.", "muted")]
    return [_step(number, step, len(result.steps)) for number, step in enumerate(result.steps, 1)]


def _step(number: int, step: ImproveStep, steps: int) -> Details:
    outcome = f"added {effect_name(step.added)}" if step.added else "added nothing"
    drawn = figures.evidence_figure(step)
    blocks: list[Block] = [tables_of.gate_facts(step.gate), Lines([("Decided by:", step.why)])]
    blocks += [drawn] if drawn else []
    blocks += [tables_of.candidates(step.candidates, number)] if step.candidates else []
    summary = f"Step {number} of {steps}: {p_value(step.gate.p_value)}, {outcome}"
    return Details(summary, blocks, open=number == 1)


def _confirmation(result: ImproveResult, tables: Mapping[str, pd.DataFrame]) -> list[Block]:
    found = result.confirmation
    blocks: list[Block] = []
    if found is not None:
        said = "above zero" if found.confirmed else "not above zero"
        own = displayed(found.gain)
        text = f"{size_text(own)} log likelihood a sample: its interval lies {said} ({found.how})."
        blocks = [Lines([("Gained on data that took no part:", text)])]
        drawn = figures.confirmation_figure(result)
        blocks += [drawn] if drawn else []
    elif added_names(result):
        blocks = [Text("What was added was not tested on data that took no part in the fit.", "caution")]
    table = tables.get("improve_held_out")
    blocks += [tables_of.by_run(table)] if table is not None and len(table) else []
    return blocks or [Text("Nothing was added: there is nothing to confirm.", "muted")]


def _separate(result: ImproveResult) -> list[Block]:
    told: list[tuple[str, str]] = []
    for effect in result.effects:
        if len(effect.members) > 1:
            names = [effect_name(one) for one in effect.members]
            told.append(("Cannot be told apart here:", f"{', '.join(names)}."))
    following = result.next_experiment
    if following is not None:
        apart = ", ".join(effect_name(one) for one in following.separates) or NONE
        told += [("Drive next:", following.drive), ("It separates:", f"{apart}."), ("Why:", following.why)]
    if told:
        return [Lines(told)]
    if not added_names(result):
        return [Text("Nothing was added: there is nothing to separate.", "muted")]
    return [Text("Nothing else of the catalogue that was tested fits these data as well.", "good")]


def _detectable(result: ImproveResult) -> list[Block]:
    sizes: list[Block] = [Text("No smallest size could be worked out.", "muted")]
    if result.minimum_detectable:
        sizes = [tables_of.detectable(result.minimum_detectable)]
    return [*sizes, *tables_of.not_testable(result)]


def _runs(tables: Mapping[str, pd.DataFrame]) -> list[Block]:
    """Draw the run in which the effect acts most in the open, the others behind a line each."""
    runs = runs_in(tables)
    if not runs:
        return [Text("No run was compared.", "muted")]
    drawn = list(runs)[:MOST_RUNS_DRAWN]
    blocks: list[Block] = []
    for name in drawn:
        seconds = duration(float(runs[name]["time"].max() - runs[name]["time"].min()))
        inside = figures.run_figure(runs[name], len(drawn))
        nothing = Text("Nothing of this run was both measured and modelled.", "muted")
        blocks.append(Details(f"{name}: {seconds}", [inside or nothing], open=name == drawn[0]))
    left = len(runs) - len(drawn)
    return [*blocks, Text(f"{left} more runs are in run.rrd.", "muted")] if left else blocks


def _health(result: ImproveResult) -> Sequence[Block]:
    return [health.runs_table(result.runs), *[health.run_details(run) for run in result.runs]]


def _refused(result: ImproveResult) -> list[Block]:
    blocks: list[Block] = [refusals(result.refused)]
    if result.warnings:
        blocks.append(Lines([("Warning:", text) for text in result.warnings]))
    return blocks
