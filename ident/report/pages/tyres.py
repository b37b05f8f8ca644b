"""The page of the tyre stage: the axle tyres, how well they explain the motion, and what they rest on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from ident.report.numbers import duration
from ident.report.page import (
    Block,
    Code,
    Columns,
    Details,
    Equation,
    Figure,
    Lines,
    Page,
    Section,
    Text,
    Verdict,
)
from ident.report.pages import health, tyre_curves, tyre_observer
from ident.report.pages import tyres_figures as figures
from ident.report.pages import tyres_tables as tables_of
from ident.report.pages.steering import refusals
from ident.report.pages.tyres_two_track import two_track_sections
from ident.report.tyre_parameters import FORMULAS, KINDS, chosen_fit, estimates
from ident.report.tyre_signals import DYNAMIC, SIGNALS, by_agreement, runs_of
from ident.results import TyresResult

MOST_RUNS_DRAWN = 20

EQUATION = Equation(
    mathml=(
        '<math display="block"><mtable columnalign="left" displaystyle="true">'
        "<mtr><mtd><mrow><mi>m</mi><mo>(</mo><msub><mover><mi>v</mi><mo>˙</mo></mover><mi>y</mi></msub>"
        "<mo>+</mo><msub><mi>v</mi><mi>x</mi></msub><mi>r</mi><mo>)</mo><mo>=</mo>"
        "<msub><mi>F</mi><mi>f</mi></msub><mo>(</mo><msub><mi>α</mi><mi>f</mi></msub><mo>)</mo>"
        "<mi>cos</mi><mi>δ</mi><mo>+</mo><msub><mi>F</mi><mi>r</mi></msub><mo>(</mo>"
        "<msub><mi>α</mi><mi>r</mi></msub><mo>)</mo></mrow></mtd></mtr>"
        "<mtr><mtd><mrow><msub><mi>I</mi><mi>z</mi></msub><mover><mi>r</mi><mo>˙</mo></mover><mo>=</mo>"
        "<msub><mi>l</mi><mi>f</mi></msub><msub><mi>F</mi><mi>f</mi></msub><mi>cos</mi><mi>δ</mi><mo>−</mo>"
        "<msub><mi>l</mi><mi>r</mi></msub><msub><mi>F</mi><mi>r</mi></msub></mrow></mtd></mtr>"
        "<mtr><mtd><mrow><msub><mi>α</mi><mi>f</mi></msub><mo>=</mo><mi>δ</mi><mo>−</mo><mi>atan</mi>"
        "<mfrac><mrow><msub><mi>v</mi><mi>y</mi></msub><mo>+</mo><msub><mi>l</mi><mi>f</mi></msub><mi>r</mi>"
        "</mrow><msub><mi>v</mi><mi>x</mi></msub></mfrac><mo>,</mo><mspace width='1em'/>"
        "<msub><mi>α</mi><mi>r</mi></msub><mo>=</mo><mo>−</mo><mi>atan</mi>"
        "<mfrac><mrow><msub><mi>v</mi><mi>y</mi></msub><mo>−</mo><msub><mi>l</mi><mi>r</mi></msub><mi>r</mi>"
        "</mrow><msub><mi>v</mi><mi>x</mi></msub></mfrac></mrow></mtd></mtr>"
        "</mtable></math>"
    ),
    text=(
        "m (dvy/dt + vx r) = Ff(αf) cos δ + Fr(αr); Iz dr/dt = lf Ff cos δ − lr Fr; "
        "αf = δ − atan((vy + lf r)/vx), αr = −atan((vy − lr r)/vx)"
    ),
)


def tyres_page(result: TyresResult, tables: Mapping[str, pd.DataFrame]) -> Page:
    """Turn a result and its tables into a page.

    Parameters
    ----------
    tables : "tyres" (run, window, time [s], each signal as measured and ``<signal>_model``, what drives the
        model and its slip angles and forces) and "tyre_forces" (run, time, axle, slip_angle [rad], force [N],
        lateral_acceleration [m/s²], measured_force [N])
    """
    runs, forces = runs_of(tables["tyres"]), runs_of(tables["tyre_forces"])
    ranked = by_agreement(result, list(runs))
    fit = chosen_fit(result)
    return Page(
        name="tyres",
        title="Tyres",
        verdict=_verdict(result),
        lead=_lead(result, tables["tyre_forces"]),
        sections=[
            Section("fits", "Kinds of tyres side by side", _fits(result), "Fits"),
            *two_track_sections(result),
            Section("signals", "Measured against simulated", _signals(runs, ranked), "Signals"),
            *_axle_forces(result, runs, forces, ranked),
            *_measured_forces(result),
            Section("correlation", "Correlation", _correlation(result), "Correlation"),
            Section("fixed", "What was taken as given", tables_of.fixed_values(result), "Given"),
            Section("nuisance", "Offsets and biases", [tables_of.nuisance(result.nuisance)], "Offsets"),
            Section("runs", "Runs", [tables_of.by_run(result)]),
            Section("noise", "Noise", [tables_of.noise(result.noise)]),
            Section("health", "Log health", _health(result), "Health"),
            Section("refused", "Refused and warned", _refused(result), "Refused"),
            Section(
                "model", "The model", [EQUATION, Text(FORMULAS[fit.kind]), tables_of.glossary(fit)], "Model"
            ),
            Section("provenance", "Provenance", health.provenance_blocks(result.provenance)),
        ],
    )


def _verdict(result: TyresResult) -> Verdict:
    """Say in a badge whether the model explains the motion and the data pin it down."""
    fit = chosen_fit(result)
    found = {estimate.status for estimate in estimates(fit).values()}
    lacking = [name for name, noise in result.noise.items() if noise.coloured_beyond]
    if not fit.converged:
        return Verdict("not converged", result.verdict, "bad", result.next_step)
    if lacking:
        return Verdict("model lacks something", result.verdict, "caution", result.next_step)
    if found != {"identified"}:
        return Verdict("identified in part", result.verdict, "caution", result.next_step)
    return Verdict("identified", result.verdict, "good", result.next_step)


def _lead(result: TyresResult, forces: pd.DataFrame) -> list[Block]:
    told: list[Block] = [tables_of.key_figures(result), Code(result.provenance.command)]
    return [
        Columns([[tables_of.parameters(result), *tables_of.open_questions(result)], told], wide=1.25),
        tyre_curves.force_figure(result, forces),
    ]


def _fits(result: TyresResult) -> list[Block]:
    blocks: list[Block] = [
        Text(f"Chosen: {KINDS[result.chosen]}. Why: {result.why}."),
        tables_of.fits(result),
    ]
    blocks += tables_of.warnings_of(result)
    others = [fit for fit in result.fits if fit.kind != result.chosen]
    return blocks + [
        Details(f"Parameters with {KINDS[fit.kind]} tyres", [tables_of.kind_parameters(fit)])
        for fit in others
    ]


def _signals(runs: Mapping[str, pd.DataFrame], ranked: Sequence[str]) -> list[Block]:
    """Draw the run that the model follows worst in the open, the others behind a line each."""
    if not ranked:
        return [Text("No run was used: there is nothing to compare.", "muted")]
    order = [ranked[-1], *ranked[:-1]][:MOST_RUNS_DRAWN]
    blocks: list[Block] = []
    for name in order:
        seconds = float(runs[name]["time"].max() - runs[name]["time"].min())
        first = name == order[0]
        inside = _run_figures(runs[name], len(order), worst=first and len(ranked) > 1)
        blocks.append(Details(f"{name}: {duration(seconds)}", inside, open=first))
    if len(ranked) > len(order):
        blocks.append(Text(f"{len(ranked) - len(order)} more runs are in run.rrd.", "muted"))
    return blocks


def _run_figures(rows: pd.DataFrame, drawn: int, *, worst: bool) -> list[Block]:
    title = "The run that the model follows worst" if worst else "Measured and simulated"
    others = [signal for signal in SIGNALS if signal not in DYNAMIC]
    found = [
        figures.run_figure(rows, DYNAMIC, "road_wheel_angle", drawn, title),
        figures.run_figure(rows, others, "speed", drawn, "Heading and position"),
    ]
    blocks: list[Block] = [figure for figure in found if figure is not None]
    return blocks or [Text("No signal of this run was measured in its windows.", "muted")]


def _axle_forces(
    result: TyresResult, runs: dict[str, pd.DataFrame], forces: dict[str, pd.DataFrame], ranked: Sequence[str]
) -> list[Section]:
    chosen = (
        [("followed best", ranked[0]), ("followed worst", ranked[-1])]
        if len(ranked) > 1
        else [("run", name) for name in ranked]
    )
    figure: Figure | None = figures.axle_forces(runs, forces, chosen)
    if figure is None:
        return []
    blocks: list[Block] = [figure]
    if result.observer is not None:
        blocks += tyre_observer.tables(result.observer)
    return [Section("forces", "Axle forces", blocks, "Forces")]


def _measured_forces(result: TyresResult) -> list[Section]:
    if not result.measured_forces:
        return []
    table = tables_of.measured_forces(result.measured_forces)
    return [Section("wheels", "Measured wheel forces", [table], "Wheel forces")]


def _correlation(result: TyresResult) -> list[Block]:
    figure = tyre_curves.correlation_figure(chosen_fit(result))
    return [figure] if figure else [Text("One parameter alone has no correlation.", "muted")]


def _health(result: TyresResult) -> list[Block]:
    return [health.runs_table(result.runs), *[health.run_details(run) for run in result.runs]]


def _refused(result: TyresResult) -> list[Block]:
    blocks: list[Block] = [refusals(result.refused)]
    if result.warnings:
        blocks.append(Lines([("Warning:", text) for text in result.warnings]))
    return blocks
