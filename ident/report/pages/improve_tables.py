"""Tables of the improvement page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from ident.report.estimates import STATUS, TONES
from ident.report.improved import (
    CHECKED,
    LAYERS,
    added_names,
    by_verdict,
    effect_name,
    held_out_rms,
    in_unit,
    parameter_name,
    place_name,
    ranked,
    shown,
    shown_interval,
    signals_of,
    size_text,
    taken,
)
from ident.report.numbers import (
    NONE,
    count,
    estimate_interval,
    estimate_value,
    fixed,
    listed,
    p_value,
    significant,
    unit_text,
)
from ident.report.page import Block, Cell, Column, Facts, Table, Text, Tone
from ident.report.pages import health
from ident.report.tyre_parameters import displayed, in_order, signal_head, signal_unit
from ident.results import (
    Candidate,
    DetectableSize,
    ErrorRange,
    FoundEffect,
    ImproveGate,
    ImproveResult,
    SensorCheck,
)

PLURAL = {"differs": "differ", "agrees": "agree"}
NEAR_NOISE = 1.1
"""Up to so many times the noise floor an error is as small as it can be."""
HELD_OUT = {
    "run": "whole runs, each while it took no part in the fit",
    "part": "parts of the same run",
    "block": "blocks of the same run",
    "none": "nothing: the data were used in the fit",
}


def errors(result: ImproveResult) -> Table:
    """Give the error of every signal before and after, beside the noise floor."""
    columns = [
        Column("RMS error, held out" if result.error.split_by != "none" else "RMS error, of the fit itself"),
        Column("before", "number"),
        Column("after", "number"),
        Column("noise floor", "number"),
        Column("after over noise [–]", "number"),
        Column("gone, of what is above noise", "number"),
    ]
    rows = [_error_row(result, signal) for signal in signals_of(result)]
    notes = ["below each value its 95 % interval; green: within 1.1 times the noise floor"]
    if result.error.at_least:
        notes.append(
            "≥: errors of the sensor that last longer cannot be told from errors of the model; its noise is "
            "at least so large, and the model may be better than the last columns say"
        )
    return Table(columns, rows, notes=notes, download="improve_errors.csv", records=_records(result))


def _error_row(result: ImproveResult, signal: str) -> list[Cell]:
    before, after = result.error.before[signal], result.error.after[signal]
    floor, gone = result.error.noise.get(signal), taken(result, signal)
    ratio = None if not floor else after.value / floor
    limit = signal in result.error.at_least
    tone: Tone = "plain" if ratio is None else "good" if ratio <= NEAR_NOISE else "caution"
    tone = "plain" if limit and tone == "caution" else tone
    upper, lower = ("≤\u00a0", "≥\u00a0") if limit else ("", "")
    return [
        Cell(signal_head(signal)),
        _error_cell(signal, before),
        _error_cell(signal, after),
        Cell(lower + shown(signal, floor), tone="muted"),
        Cell(upper + significant(ratio), raw=ratio, tone=tone, badge=ratio is not None),
        Cell(NONE if gone is None else f"{lower if gone > 0 else ''}{fixed(100 * gone, 0)}\u00a0%", raw=gone),
    ]


def _error_cell(signal: str, error: ErrorRange) -> Cell:
    raw = error.value * signal_unit(signal)[0]
    return Cell(shown(signal, error), raw=raw, detail=shown_interval(signal, error))


def _records(result: ImproveResult) -> list[dict[str, float | str | None]]:
    """Give the errors as one row a signal, in SI units, for downloads."""
    records: list[dict[str, float | str | None]] = []
    for signal in signals_of(result):
        record: dict[str, float | str | None] = {"signal": signal}
        for when, found in (("before", result.error.before), ("after", result.error.after)):
            error = found[signal]
            record |= {when: error.value, f"{when}_low": error.low, f"{when}_high": error.high}
        records.append(
            record | {"noise": result.error.noise.get(signal), "unit": result.error.before[signal].unit}
        )
    return records


def key_figures(result: ImproveResult) -> Facts:
    """Give what was added and how sure it is, the sensors, and what all of it rests on."""
    layers = ", ".join(LAYERS[layer] for layer in result.layers)
    items: list[tuple[str, Cell | str]] = [
        ("began with", Cell(result.base, detail=layers or None)),
        *[("added", _added(effect)) for effect in result.effects],
        *_discovered(result),
        ("confirmed", _confirmed(result)),
        ("sensors", sensors_brief(result.sensors)),
        *([("held out", HELD_OUT[result.error.split_by])] if result.layers else []),
        ("logs", health.brief(result.runs)),
    ]
    if not added_names(result):
        items.insert(1, ("added", Cell("nothing", tone="muted")))
    return Facts(items)


def _added(effect: FoundEffect) -> Cell:
    sizes = [f"{parameter_name(name)} {size_text(found)}" for name, found in effect.parameters.items()]
    several: Tone = "caution" if len(effect.members) > 1 else "good"
    return Cell(
        effect_name(effect.key), tone=several, detail="; ".join([*sizes[:2], p_value(effect.p_value)])
    )


def _discovered(result: ImproveResult) -> list[tuple[str, Cell | str]]:
    found = result.discovered
    if found is None:
        return []
    text = f"{found.term} in the {place_name(found.equation)}"
    return [("without a name", Cell(text, tone="caution", detail=size_text(found.coefficient)))]


def _confirmed(result: ImproveResult) -> Cell:
    found = result.confirmation
    if found is None:
        return Cell("nothing to confirm" if not added_names(result) else "not tested", tone="muted")
    gains = [gain > 0 for gain in found.by_run.values()]
    detail = f"{sum(gains)} of {count(len(gains), 'run')} gain; {found.how}"
    return Cell("yes" if found.confirmed else "no", tone="good" if found.confirmed else "bad", detail=detail)


def sensors_brief(checks: Sequence[SensorCheck]) -> Cell:
    """Count the checks of sensors, and name those that differ."""
    if not checks:
        return Cell("none could be checked", tone="muted")
    told = [
        count(number, CHECKED[verdict][0], PLURAL.get(verdict, CHECKED[verdict][0]))
        for verdict in CHECKED
        if (number := sum(one.verdict == verdict for one in checks))
    ]
    differ = [one.name for one in checks if one.verdict == "differs"]
    tone: Tone = "caution" if differ else "good" if checks_agree(checks) else "muted"
    return Cell(", ".join(told), tone=tone, detail=listed(differ, 3) or None)


def checks_agree(checks: Sequence[SensorCheck]) -> bool:
    """Say whether at least one check of sensors could be made and none differs."""
    found = {one.verdict for one in checks}
    return "agrees" in found and "differs" not in found


def parameters(effect: FoundEffect) -> Table:
    """Give the parameters of an effect with their intervals and what they are."""
    columns = [
        Column("parameter"),
        Column("value", "number"),
        Column("95 % interval", "number"),
        Column("unit"),
        Column("status"),
        Column("meaning", wrap=True),
    ]
    rows = []
    for name, estimate in effect.parameters.items():
        own = displayed(estimate)
        rows.append(
            [
                Cell(parameter_name(name)),
                Cell(estimate_value(own), raw=own.value),
                Cell(estimate_interval(own)),
                Cell(unit_text(own.unit)),
                Cell(STATUS[own.status], tone=TONES[own.status], badge=True, detail=own.reason),
                Cell(effect.meanings.get(name, "")),
            ]
        )
    return Table(columns, rows, download=f"improve_{effect.name}.csv")


def gate_facts(gate: ImproveGate) -> Facts:
    """Say what the gate of one step found."""
    tone: Tone = "caution" if gate.rejected else "good"
    said = "something is left" if gate.rejected else "nothing that noise does not explain"
    how = (
        f"{count(gate.tests, 'direction')} together at {100 * gate.level:g}\u00a0%; blocks of "
        f"{significant(gate.block, 2)}\u00a0s drawn {count(gate.draws, 'time')}"
    )
    return Facts(
        [
            ("gate", Cell(f"{said}, {p_value(gate.p_value)}", raw=gate.p_value, tone=tone, detail=how)),
            ("strongest", Cell(gate.strongest or NONE, detail=LAYERS[gate.layer])),
        ]
    )


def candidates(found: Sequence[Candidate], step: int) -> Table:
    """Give what was compared in a step, the best first, and why each was not added."""
    columns = [
        Column("candidate"),
        Column("enters"),
        Column("score [–]", "number"),
        Column("p", "number"),
        Column("gain of the full fit [–]", "number"),
        Column("held-out gain [1/sample]", "number"),
        Column("size"),
        Column("why not", wrap=True),
    ]
    notes = [
        "score: 2 log likelihood that one step would gain, with the number of parameters below",
        "p: corrected for all that was looked at",
        "gain: the same fitted in full; held-out gain: log likelihood a sample",
    ]
    several = sum(one.in_class for one in found) > 1
    rows = [_candidate_row(one, several=several) for one in ranked(found)]
    name = f"improve_candidates_{step}.csv"
    return Table(columns, rows, notes=notes, download=name, scroll=len(rows) > 14)


def _candidate_row(one: Candidate, *, several: bool) -> list[Cell]:
    tone: Tone = "good" if one.why_not is None else "caution" if one.in_class else "plain"
    sizes = [f"{parameter_name(name)} {size_text(found)}" for name, found in one.parameters.items()]
    why = one.why_not or "added"
    alike = "cannot be told from the best" if one.in_class and several else None
    return [
        Cell(effect_name(one.key), tone=tone, detail=alike),
        Cell(place_name(one.enters)),
        Cell(significant(one.statistic), raw=one.statistic, detail=str(one.freedom)),
        Cell(p_value(one.p_value).removeprefix("p = ").removeprefix("p "), raw=one.p_value),
        Cell(significant(one.gain), raw=one.gain),
        Cell(significant(one.held_out_gain), raw=one.held_out_gain),
        Cell("; ".join(sizes) or NONE),
        Cell(why, tone="good" if one.why_not is None else "plain"),
    ]


def detectable(found: Mapping[str, DetectableSize]) -> Table:
    """Give the smallest size of each effect that these data would show, beside a typical one."""
    columns = [
        Column("effect that is not in the model"),
        Column("smallest size shown", "number"),
        Column("typical size", "number"),
        Column("unit"),
        Column("over typical [–]", "number"),
        Column(""),
    ]
    rows = [
        _detectable_row(key, size) for key, size in sorted(found.items(), key=lambda one: ratio_of(one[1]))
    ]
    notes = ["at 85 % power, with 5 % false alarms over all effects together"]
    return Table(columns, rows, notes=notes, download="improve_detectable.csv", scroll=len(rows) > 16)


def ratio_of(size: DetectableSize) -> float:
    """Give a detectable size over the typical one [-]; infinite where no typical size is known."""
    return abs(size.value / size.typical) if size.typical else float("inf")


def _detectable_row(key: str, size: DetectableSize) -> list[Cell]:
    ratio = ratio_of(size)
    tone: Tone = "good" if ratio <= 1 else "caution"
    said = "a typical one would show" if ratio <= 1 else "a typical one may hide here"
    value, unit = in_unit(size.value, size.unit)
    typical, _ = in_unit(size.typical, size.unit)
    return [
        Cell(effect_name(key)),
        Cell(significant(value), raw=value),
        Cell(significant(typical), raw=typical),
        Cell(unit),
        Cell(significant(ratio), raw=ratio),
        Cell(said, tone=tone, badge=True),
    ]


def not_testable(result: ImproveResult) -> list[Block]:
    """List the effects of which these data say nothing, each with its reason."""
    if not result.not_testable:
        return []
    rows = [[Cell(effect_name(one.what)), Cell(one.reason)] for one in result.not_testable]
    columns = [Column("effect: whether it is there is not known"), Column("why", wrap=True)]
    name = "improve_not_testable.csv"
    return [Table(columns, rows, "Not tested", download=name, scroll=len(rows) > 16)]


def sensors(checks: Sequence[SensorCheck]) -> Block:
    """Give the sensors against each other, those that differ first."""
    if not checks:
        return Text("No two sensors of these logs measure the same, and the truck never stood.", "muted")
    columns = [
        Column("verdict"),
        Column("check", wrap=True),
        Column("found", "number"),
        Column("95 % interval", "number"),
        Column("unit"),
        Column("expected", "number"),
        Column("p", "number"),
        Column("meaning", wrap=True),
    ]
    rows = [_sensor_row(one) for one in by_verdict(checks)]
    notes = ["no model of the vehicle takes part"]
    return Table(columns, rows, notes=notes, download="improve_sensors.csv")


def _sensor_row(one: SensorCheck) -> list[Cell]:
    own, (said, tone) = displayed(one.estimate), CHECKED[one.verdict]
    expected, _ = in_unit(one.expected, one.estimate.unit)
    would_be = None if one.effect is None else effect_name(one.effect)
    return [
        Cell(said, tone=tone, badge=True),
        Cell(one.name, detail=would_be),
        Cell(estimate_value(own), raw=own.value),
        Cell(estimate_interval(own)),
        Cell(unit_text(own.unit)),
        Cell(significant(expected), raw=expected),
        Cell(p_value(one.p_value).removeprefix("p = ").removeprefix("p "), raw=one.p_value),
        Cell(one.meaning),
    ]


def by_run(table: pd.DataFrame) -> Table:
    """Give the error of each run while it was held out, before and after."""
    found = held_out_rms(table)
    signals = in_order(signal for errors_of in found.values() for signal in errors_of)
    columns = [Column("run", wrap=True), *[Column(signal_head(name), "number") for name in signals]]
    rows = [
        [Cell(run), *[_change_cell(name, errors_of.get(name)) for name in signals]]
        for run, errors_of in found.items()
    ]
    records: list[dict[str, float | str | None]] = [
        {"run": run, "signal": signal, "before": before, "after": after}
        for run, errors_of in found.items()
        for signal, (before, after) in errors_of.items()
    ]
    notes = ["RMS before → after; ✗: larger after"]
    name = "improve_by_run.csv"
    return Table(columns, rows, notes=notes, download=name, records=records, scroll=len(rows) > 15)


def _change_cell(signal: str, found: tuple[float, float] | None) -> Cell:
    if found is None:
        return Cell(NONE, tone="muted")
    before, after = found
    worse = after > before
    text = f"{shown(signal, before)} → {shown(signal, after)}"
    return Cell(f"✗\u00a0{text}" if worse else text, tone="caution" if worse else "plain")
