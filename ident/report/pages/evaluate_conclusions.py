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
from ident.report.page import Block, Cell, Column, Details, Lines, Table, Text, Tone
from ident.report.tyre_parameters import displayed
from ident.results import Characteristic, Check, Comparison, Requirement

MOST_ROWS = 12
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
    return [Lines(_in_words(found)), Details("As a table", [table])]


def _p(value: float) -> str:
    return "< 0.001" if value < 0.001 else significant(value, 2)


def _in_words(found: Sequence[Comparison]) -> list[tuple[str, str]]:
    """Say of each pair which is better on which signal, and on which the runs do not tell."""
    pairs: dict[tuple[str, ...], list[Comparison]] = {}
    for one in found:
        pairs.setdefault(tuple(sorted((one.better, one.worse))), []).append(one)
    lines = []
    for pair, own in pairs.items():
        winners = [name for name in pair if any(one.better == name and one.p_value < SURE for one in own)]
        parts = [_better(name, own) for name in winners]
        same = [one.signal.replace("_", " ") for one in own if one.p_value >= SURE]
        parts += [f"the runs do not tell them apart on {', '.join(same)}"] if same else []
        first, second = (model_name(name) for name in pair)
        lines.append((f"{first} and {second}:", "; ".join(parts) + "."))
    return lines


def _better(name: str, found: Sequence[Comparison]) -> str:
    """Say on which signals a model is surely better, with its error in parts of the other's."""
    told = [
        f"{one.signal.replace('_', ' ')} ({estimate_value(one.ratio)} of its error, 95 % "
        f"{estimate_interval(one.ratio)}, {p_value(one.p_value)})"
        for one in found
        if one.better == name and one.p_value < SURE
    ]
    return f"{model_name(name)} is better on {', '.join(told)}"


def characteristics(found: Sequence[Characteristic]) -> list[Block]:
    """Give what the truck does, measured and simulated, in the style of the standards."""
    if not found:
        return [Text("No characteristic could be measured in the held-out data.", "muted")]
    known = [one for one in found if one.measured.value is not None]
    missing = [one.name.replace("_", " ") for one in found if one.measured.value is None]
    names = list(dict.fromkeys(name for one in known for name in one.simulated))
    columns = [
        Column("characteristic"),
        Column("in the style of"),
        Column("measured", "number"),
        *[Column(model_name(name), "number") for name in names],
        Column("unit"),
        Column("tolerance", "number"),
    ]
    rows = [_characteristic_row(one, names) for one in known]
    note = (
        "below each value its 95 % interval; ✗: measured and simulated differ by more than the tolerance; "
        "without a colour: the intervals do not tell"
    )
    told = Text(
        "Figures in the style of ISO 14792 (steady state) and ISO 14793 (transient), taken from whatever was "
        "driven: no test of these standards was made, and nothing here is a statement of conformity."
    )
    table = Table(
        columns, rows, notes=[note], download="evaluate_characteristics.csv", scroll=len(rows) > MOST_ROWS
    )
    lacking = [Lines([("The driving does not tell:", f"{', '.join(missing)}.")])] if missing else []
    return [told, table, *lacking]


def _characteristic_row(one: Characteristic, names: Sequence[str]) -> list[Cell]:
    shown = displayed(one.measured)
    measured = Cell(estimate_value(shown), raw=shown.value, detail=estimate_interval(shown))
    return [
        Cell(one.name.replace("_", " ")),
        Cell(one.style.replace(" ", "\u00a0")),
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
