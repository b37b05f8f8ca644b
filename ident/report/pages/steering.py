"""The page of the steering stage: the transfer function, how well it fits, and what it was made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from ident.report import residuals, responses
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
from ident.report.pages import bode, health
from ident.report.pages import steering_figures as figures
from ident.report.pages import steering_tables as tables_of
from ident.report.refusals import by_reason
from ident.results import Refusal, SteeringResult

MOST_RUNS_DRAWN = 40
SORTS = {
    "More steps and pulses": figures.STEP_KINDS,
    "More sines": {"sine"},
    "Other excitation": {"other"},
}

EQUATION = Equation(
    mathml=(
        '<math display="inline" displaystyle="true"><mrow><mi>G</mi><mo>(</mo><mi>s</mi><mo>)</mo><mo>=</mo>'
        "<mfrac><mrow><mi>K</mi><msup><mi>e</mi><mrow><mo>−</mo><mi>L</mi><mi>s</mi></mrow></msup></mrow>"
        "<mrow><mo>(</mo><msub><mi>T</mi><mn>1</mn></msub><mi>s</mi><mo>+</mo><mn>1</mn><mo>)</mo>"
        "<mo>(</mo><msub><mi>T</mi><mn>2</mn></msub><mi>s</mi><mo>+</mo><mn>1</mn><mo>)</mo></mrow></mfrac>"
        "</mrow></math>"
    ),
    text="G(s) = K exp(-L s) / ((T1 s + 1)(T2 s + 1))",
)


def steering_page(result: SteeringResult, tables: Mapping[str, pd.DataFrame]) -> Page:
    """Turn a result and its tables into a page.

    Parameters
    ----------
    tables : "steering" (run, part, time, measured, modelled, residual, experiment, used) and
        "steering_request" (run, part, time, request); angles in rad, times in s since the run's start
    """
    runs = responses.signals_of(tables["steering"], tables["steering_request"])
    lag = result.model.total_lag.value
    steps = responses.step_groups(result.experiments, runs, total_lag=lag)
    sines = responses.sine_groups(result.experiments, runs)
    groups = [*steps, *sines, *responses.other_groups(result.experiments, runs)]
    first = figures.choose_first(groups, lag)
    return Page(
        name="steering",
        title="Steering",
        verdict=_verdict(result),
        lead=_lead(result, figures.first_responses(first, len(groups))),
        sections=[
            Section(
                "responses", "Responses", _responses([group for group in groups if group not in first], runs)
            ),
            Section("frequency", "Frequency response and bandwidth", bode.frequency_blocks(result), "Bode"),
            Section(
                "runs",
                "Fits by run",
                _blocks(figures.runs_compared(result), tables_of.by_run(result)),
                "Runs",
            ),
            *_amplitude(result),
            Section("methods", "Step methods side by side", [tables_of.step_methods(result)], "Step methods"),
            *_ratio(result),
            Section("residual", "Residual", _residual(result, tables["steering"])),
            Section("experiments", "Experiments", _experiments(result)),
            Section("health", "Log health", _health(result)),
            Section("refused", "Refused and warned", _refused(result), "Refused"),
            Section("model", "The model", [EQUATION, tables_of.glossary()], "Model"),
            Section("provenance", "Provenance", health.provenance_blocks(result.provenance)),
        ],
    )


def _amplitude(result: SteeringResult) -> list[Section]:
    if not result.by_amplitude:
        return []
    blocks = _blocks(figures.amplitudes_compared(result), tables_of.by_amplitude(result))
    return [Section("amplitude", "Dependence on amplitude", blocks, "Amplitude")]


def _ratio(result: SteeringResult) -> list[Section]:
    if not result.ratio:
        return []
    return [Section("ratio", "Ratio map", [tables_of.ratio(result)], "Ratio")]


def _verdict(result: SteeringResult) -> Verdict:
    if result.adequate:
        return Verdict("adequate", result.verdict, "good", result.next_step)
    return Verdict("not adequate", result.verdict, "caution", result.next_step)


def _lead(result: SteeringResult, figure: Figure | None) -> list[Block]:
    answer: list[Block] = [tables_of.parameters(result), Code(result.provenance.command)]
    first: list[Block] = [Columns([answer, [tables_of.key_figures(result)]], wide=1.1)]
    return first + (
        _blocks(figure) or [Text("No response could be drawn: no experiment was found.", "muted")]
    )


def _blocks(*blocks: Block | None) -> list[Block]:
    return [block for block in blocks if block is not None]


def _responses(groups: Sequence[responses.Group], runs: dict[str, responses.Signals]) -> list[Block]:
    """Draw what the first screen had no room for, then every run from end to end."""
    blocks: list[Block] = []
    for title, kinds in SORTS.items():
        blocks += figures.more_responses([group for group in groups if group.kind in kinds], title)
    drawn = list(runs.items())[:MOST_RUNS_DRAWN]
    for name, signals in drawn:
        length = float(signals.time[-1] - signals.time[0]) if signals.time.size else 0.0
        blocks.append(Details(f"{name}: {duration(length)}", [figures.whole_run(signals, len(drawn))]))
    if len(runs) > len(drawn):
        blocks.append(Text(f"{len(runs) - len(drawn)} more runs are in run.rrd.", "muted"))
    return blocks


def _residual(result: SteeringResult, steering: pd.DataFrame) -> list[Block]:
    blocks = residuals.residual_blocks(steering, result.noise)
    figure = figures.residual_tests(blocks, result.noise)
    return _blocks(figure) or [Text("Too few samples in a row to say anything of the residual.", "muted")]


def _experiments(result: SteeringResult) -> list[Block]:
    return [Text(tables_of.experiment_counts(result.experiments)), tables_of.experiments(result.experiments)]


def _health(result: SteeringResult) -> list[Block]:
    return [health.runs_table(result.runs), *[health.run_details(run) for run in result.runs]]


def _refused(result: SteeringResult) -> list[Block]:
    blocks: list[Block] = [refusals(result.refused)]
    if result.warnings:
        blocks.append(Lines([("Warning:", text) for text in result.warnings]))
    return blocks


def refusals(refused: Sequence[Refusal]) -> Block:
    """List what the data cannot answer and what to drive instead, each reason once."""
    if not refused:
        return Text("Everything asked of this stage could be answered.", "good")
    return Lines([(f"{what}:", reason) for what, reason in by_reason(refused)])
