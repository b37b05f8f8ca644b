"""What the evaluation concludes: comparisons in words, characteristics, checks, requirements."""

from __future__ import annotations

from collections.abc import Sequence

from ident.report.evaluated import CHECK_TONES, model_name
from ident.report.numbers import (
    NONE,
    estimate_interval,
    estimate_value,
    p_value,
    significant,
    unit_text,
    with_unit,
)
from ident.report.page import Block, Cell, Column, Lines, Table, Text, Tone
from ident.report.tyre_parameters import displayed
from ident.results import Characteristic, Check, Comparison, Requirement

SURE = 0.05
"""p-value below which one model is said to be better than another."""


def comparisons(found: Sequence[Comparison]) -> list[Block]:
    """Say in words which model is really better than which, and give the figures."""
    if not found:
        return [Text("There is no pair of models to compare.", "muted")]
    columns = [
        Column("better"),
        Column("worse"),
        Column("signal"),
        Column("ratio of RMS", "number"),
        Column("95 % interval", "number"),
        Column("p", "number"),
    ]
    rows = [
        [
            Cell(model_name(one.better)),
            Cell(model_name(one.worse)),
            Cell(one.signal.replace("_", " ")),
            Cell(estimate_value(one.ratio), raw=one.ratio.value),
            Cell(estimate_interval(one.ratio)),
            Cell(_p(one.p_value), raw=one.p_value),
        ]
        for one in found
    ]
    notes = ["paired on the same stretches of held-out driving; p: of the hypothesis of no difference"]
    table = Table(columns, rows, notes=notes, download="evaluate_comparisons.csv", scroll=len(rows) > 15)
    return [Lines([_in_words(one) for one in found]), table]


def _p(value: float) -> str:
    return "< 0.001" if value < 0.001 else significant(value, 2)


def _in_words(one: Comparison) -> tuple[str, str]:
    about = f"{one.signal.replace('_', ' ')}:"
    better, worse = model_name(one.better), model_name(one.worse)
    share = f"{estimate_value(one.ratio)} of its error, 95 % {estimate_interval(one.ratio)}"
    told = f"({share}, {p_value(one.p_value)})"
    if one.p_value < SURE:
        return about, f"{better} is better than {worse} {told}."
    return about, f"these runs do not tell {better} from {worse} {told}."


def characteristics(found: Sequence[Characteristic]) -> list[Block]:
    """Give what the truck does, measured and simulated, in the style of the standards."""
    if not found:
        return [Text("No characteristic could be measured in the held-out data.", "muted")]
    names = list(dict.fromkeys(name for one in found for name in one.simulated))
    columns = [
        Column("characteristic"),
        Column("in the style of"),
        Column("measured", "number"),
        *[Column(model_name(name), "number") for name in names],
        Column("unit"),
        Column("tolerance", "number"),
    ]
    rows = [_characteristic_row(one, names) for one in found]
    note = "below each value its 95 % interval; ✗: measured and simulated differ by more than the tolerance"
    told = Text(
        "Figures in the style of ISO 14792 (steady state) and ISO 14793 (transient), taken from whatever was "
        "driven: no test of these standards was made, and nothing here is a statement of conformity."
    )
    return [told, Table(columns, rows, notes=[note], download="evaluate_characteristics.csv")]


def _characteristic_row(one: Characteristic, names: Sequence[str]) -> list[Cell]:
    shown = displayed(one.measured)
    measured = Cell(estimate_value(shown), raw=shown.value, detail=estimate_interval(shown))
    return [
        Cell(one.name.replace("_", " ")),
        Cell(one.style),
        measured,
        *[_simulated(one, name) for name in names],
        Cell(unit_text(shown.unit)),
        Cell(f"±\u00a0{significant(100 * one.tolerance, 2)}\u00a0%", raw=one.tolerance),
    ]


def _simulated(one: Characteristic, name: str) -> Cell:
    if name not in one.simulated:
        return Cell(NONE, tone="muted")
    shown, within = displayed(one.simulated[name]), one.within.get(name)
    tone: Tone = "plain" if within is None else "good" if within else "bad"
    mark = "✗\u00a0" if within is False else ""
    text, interval = mark + estimate_value(shown), estimate_interval(shown)
    return Cell(text, raw=shown.value, tone=tone, badge=within is not None, detail=interval)


def checks(found: Sequence[Check]) -> Block:
    """Give what was looked at before any number was believed, the worst first."""
    if not found:
        return Text("Nothing was checked.", "caution")
    order = list(CHECK_TONES)[::-1]
    rows = [
        [Cell(one.verdict, tone=CHECK_TONES[one.verdict], badge=True), Cell(one.what), Cell(one.text)]
        for one in sorted(found, key=lambda one: order.index(one.verdict))
    ]
    columns = [Column("verdict"), Column("what"), Column("found", wrap=True)]
    return Table(columns, rows, download="evaluate_checks.csv")


def requirements(found: Sequence[Requirement]) -> Block:
    """Give the limits of the recipe with what was measured."""
    if not found:
        return Text("The recipe requires nothing: say evaluate: {require: {yaw_rate: 0.02 rad/s}}.", "muted")
    columns = [Column("requirement"), Column("limit", "number"), Column("measured", "number"), Column("")]
    rows = [_requirement_row(one) for one in found]
    return Table(columns, rows, download="evaluate_requirements.csv")


def _requirement_row(one: Requirement) -> list[Cell]:
    told: dict[bool | None, tuple[str, Tone]] = {
        True: ("met", "good"),
        False: ("not met", "bad"),
        None: ("not measured", "caution"),
    }
    text, tone = told[one.met]
    return [
        Cell(one.signal.replace("_", " ")),
        Cell(with_unit(one.limit, one.unit), raw=one.limit),
        Cell(with_unit(one.measured, one.unit), raw=one.measured),
        Cell(text, tone=tone, badge=True),
    ]
