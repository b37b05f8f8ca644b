"""Tables of the evaluation page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ident.report.evaluated import (
    CHECK_TONES,
    INPUTS,
    MARKS,
    STANDARD,
    TONES,
    costs_told,
    driven_by,
    judge,
    model_name,
    reason,
    shown_error,
    signals_of,
    standard,
    window_seconds,
)
from ident.report.numbers import (
    NONE,
    count,
    duration,
    percent,
    significant,
    unit_text,
)
from ident.report.page import Cell, Column, Facts, Table, Tone
from ident.report.pages import health
from ident.report.tyre_parameters import in_order, signal_head, signal_unit
from ident.results import (
    Check,
    Error,
    EvaluatedModel,
    EvaluateResult,
    Requirement,
    RunError,
)

LEGEND = (
    "green: within the acceptable size of the first row; ≈: the 95 % interval holds that size; "
    "✗: beyond it; grey, below: over whole runs from the logged initial state"
)
Record = dict[str, float | int | str | None]


def overview(result: EvaluateResult) -> Table:
    """Give the errors of every model on every signal, over windows with those over whole runs below."""
    models = overview_models(result)
    signals = [name for name in signals_of(result) if any(name in standard(m) for m in models[:-1] or models)]
    columns = [
        Column("model"),
        *[Column(signal_head(name), "number") for name in signals],
        Column("good to |a_y| [m/s²]", "number"),
        Column("cost [ns/step]", "number"),
    ]
    rows = [_limits(result, signals)] if result.acceptable else []
    rows += [_overview_row(result, model, signals) for model in models]
    notes = [f"RMS error on held-out data over windows of {STANDARD} from many starts; {LEGEND}."]
    told = zip(costs_told(result), result.cost_ratios, strict=True)
    notes += [f"{cost}: {one.reason}." for cost, one in told]
    notes += [f"{result.two_track}."] if result.two_track else []
    return Table(columns, rows, notes=notes, download="evaluate_models.csv", records=error_records(result))


def overview_models(result: EvaluateResult) -> list[EvaluatedModel]:
    """Choose the models of the first screen: all on measured steering; on the request the chosen one."""
    measured = driven_by(result, "measured")
    asked = driven_by(result, "request")
    return [*measured, *[model for model in asked if model.name == result.chosen or not measured]]


def _limits(result: EvaluateResult, signals: Sequence[str]) -> list[Cell]:
    limits = [result.acceptable.get(name) for name in signals]
    sizes = [
        Cell("" if limit is None else f"≤\u00a0{shown_error(name, limit)}", tone="muted")
        for name, limit in zip(signals, limits, strict=True)
    ]
    return [Cell("acceptable", tone="muted"), *sizes, Cell(""), Cell("")]


def _overview_row(result: EvaluateResult, model: EvaluatedModel, signals: Sequence[str]) -> list[Cell]:
    found = standard(model)
    cells = [
        _judged(name, found.get(name), result.acceptable.get(name), model.rms.get(name)) for name in signals
    ]
    reach = NONE if model.valid_to is None else significant(model.valid_to)
    return [
        _model_cell(result, model),
        *cells,
        Cell(reach, raw=model.valid_to),
        Cell(significant(model.cost_ns_per_step), raw=model.cost_ns_per_step),
    ]


def _model_cell(result: EvaluateResult, model: EvaluatedModel) -> Cell:
    told = ["chosen"] if model.name == result.chosen else []
    told += ["on the request"] if model.input == "request" else []
    tone: Tone = "good" if model.name == result.chosen else "plain"
    return Cell(model_name(model.name), tone=tone, detail=", ".join(told) or None)


def _judged(signal: str, error: Error | None, limit: Error | None, whole: Error | None = None) -> Cell:
    if error is None:
        return Cell(NONE, tone="muted")
    verdict = judge(error, limit)
    detail = None if whole is None else shown_error(signal, whole)
    return Cell(
        MARKS[verdict] + shown_error(signal, error),
        raw=error.value * signal_unit(signal)[0],
        tone=TONES[verdict],
        badge=verdict != "unknown",
        detail=detail,
    )


def _error(signal: str, value: float | None) -> Cell:
    """Give an error in the unit that heads its column."""
    raw = None if value is None else value * signal_unit(signal)[0]
    return Cell(shown_error(signal, value), raw=raw)


def error_records(result: EvaluateResult) -> list[Record]:
    """Give every error of every model as one row each, in SI units, for downloads."""
    records: list[Record] = []
    for model in result.models:
        spans = {**model.windows, "whole run": model.rms}
        for span, errors in spans.items():
            records += [_record(result, model, span, name, error) for name, error in errors.items()]
    return records


def _record(result: EvaluateResult, model: EvaluatedModel, span: str, signal: str, error: Error) -> Record:
    limit = result.acceptable.get(signal)
    return {
        "model": model.name,
        "input": model.input,
        "over": span,
        "signal": signal,
        "rms": error.value,
        "low": error.low,
        "high": error.high,
        "unit": error.unit,
        "acceptable": limit.value if limit else None,
        "cost_ns_per_step": model.cost_ns_per_step,
    }


def key_figures(result: EvaluateResult) -> Facts:
    """Give the choice and its reason, what the numbers rest on, and how the requirements stand."""
    chosen = "none" if result.chosen is None else model_name(result.chosen)
    items: list[tuple[str, Cell | str]] = [
        ("chosen", Cell(chosen, tone="bad" if result.chosen is None else "good", detail=reason(result))),
        ("held out", Cell(_split(result), detail=", ".join(result.held_out) or None)),
        ("requirements", _requirements_brief(result.requirements)),
        ("checks", _checks_brief(result.checks)),
        ("logs", health.brief(result.runs)),
    ]
    if result.against is not None:
        items.insert(1, ("compared with", result.against))
    return Facts(items)


def _split(result: EvaluateResult) -> str:
    held = count(len(result.held_out), "run" if result.split_by == "run" else "stretch", "")
    told = {
        "run": "whole runs",
        "part": "parts of the same run",
        "block": "blocks of the same run",
        "none": "nothing: the data were used in the fit",
    }[result.split_by]
    return told if result.split_by == "none" else f"{held.replace('stretchs', 'stretches')}, {told}"


def _requirements_brief(found: Sequence[Requirement]) -> Cell:
    if not found:
        return Cell("none stated", tone="muted")
    met = sum(one.met is True for one in found)
    failed = any(one.met is False for one in found)
    tone: Tone = "bad" if failed else "good" if met == len(found) else "caution"
    return Cell(f"{met} of {len(found)} met", tone=tone)


def _checks_brief(found: Sequence[Check]) -> Cell:
    told = [
        count(number, word, "warnings" if word == "warning" else word)
        for word in ("refused", "warning", "fine")
        if (number := sum(one.verdict == word for one in found))
    ]
    worst = next((word for word in ("refused", "warning") if any(c.verdict == word for c in found)), "fine")
    return Cell(", ".join(told) or NONE, tone=CHECK_TONES[worst])


def measures(result: EvaluateResult) -> Table:
    """Give every measure of every model over whole runs."""
    columns = [
        Column("model"),
        Column("driven by"),
        Column("signal"),
        Column("RMS", "number"),
        Column("95 % interval", "number"),
        Column("peak", "number"),
        Column("unit"),
        Column("NRMSE [–]", "number"),
        Column("VAF", "number"),
        *([Column("over noise [–]", "number")] if result.repeat_noise else []),
    ]
    rows = [
        _measures_row(model, name, noise=bool(result.repeat_noise))
        for model in result.models
        for name in in_order(model.rms)
    ]
    notes = ["over whole runs, from the logged initial state; intervals: bootstrap of blocks of driving"]
    if result.repeat_noise:
        notes.append("over noise: RMS over that of a run driven again")
    return Table(columns, rows, notes=notes, download="evaluate_measures.csv", scroll=len(rows) > 15)


def _measures_row(model: EvaluatedModel, signal: str, *, noise: bool) -> list[Cell]:
    error, (factor, unit) = model.rms[signal], signal_unit(signal)
    peak, nrmse, vaf = (found.get(signal) for found in (model.peak, model.nrmse, model.vaf))
    over = model.over_noise.get(signal)
    return [
        Cell(model_name(model.name)),
        Cell(INPUTS[model.input]),
        Cell(signal.replace("_", " ")),
        Cell(shown_error(signal, error), raw=error.value * factor),
        _interval(signal, error),
        Cell(shown_error(signal, peak), raw=None if peak is None else peak * factor),
        Cell(unit_text(unit)),
        Cell(significant(nrmse), raw=nrmse),
        Cell(percent(vaf), raw=vaf),
        *([Cell(significant(over), raw=over)] if noise else []),
    ]


def _interval(signal: str, error: Error) -> Cell:
    if error.low is None or error.high is None:
        return Cell(NONE)
    return Cell(f"{shown_error(signal, error.low)} … {shown_error(signal, error.high)}")


def by_window(result: EvaluateResult) -> Table:
    """Give the errors over windows of each length and over whole runs."""
    signals = signals_of(result)
    columns = [
        Column("model"),
        Column("driven by"),
        Column("over"),
        *[Column(signal_head(s), "number") for s in signals],
    ]
    rows = []
    for model in result.models:
        for length, errors in spans(model).items():
            judged = result.acceptable if length == STANDARD else {}
            cells = [_judged(name, errors.get(name), judged.get(name)) for name in signals]
            rows.append([Cell(model_name(model.name)), Cell(INPUTS[model.input]), Cell(length), *cells])
    notes = ["RMS error; the acceptable sizes are those of windows of " + STANDARD]
    return Table(
        columns,
        rows,
        notes=notes,
        download="evaluate_windows.csv",
        scroll=len(rows) > 15,
    )


def spans(model: EvaluatedModel) -> dict[str, Mapping[str, Error]]:
    """Give the errors of a model over windows, the shortest first, and over whole runs."""
    lengths = sorted(model.windows, key=window_seconds)
    return {**{length: model.windows[length] for length in lengths}, "whole run": model.rms}


def by_band(result: EvaluateResult) -> Table:
    """Give the errors of every model by size of the lateral acceleration."""
    signals = signals_of(result)
    columns = [
        Column("|a_y| [m/s²]", "number"),
        Column("driven [s]", "number"),
        Column("model"),
        Column("driven by"),
        *[Column(signal_head(name), "number") for name in signals],
    ]
    rows: list[list[Cell]] = []
    records: list[Record] = []
    for number in range(max((len(model.by_lateral_acceleration) for model in result.models), default=0)):
        for model in result.models:
            for band in model.by_lateral_acceleration[number : number + 1]:
                judged = [_judged(s, band.rms.get(s), result.acceptable.get(s)) for s in signals]
                told = [Cell(model_name(model.name)), Cell(INPUTS[model.input])]
                rows.append(
                    [Cell(band_text(band.lowest, band.highest)), _seconds(band.seconds), *told, *judged]
                )
                ends: Record = {"from": band.lowest, "to": band.highest, "seconds": band.seconds}
                records += [
                    ends | _record(result, model, "band", name, error) for name, error in band.rms.items()
                ]
    return Table(columns, rows, download="evaluate_bands.csv", scroll=len(rows) > 15, records=records)


def band_text(lowest: float, highest: float | None) -> str:
    """Name a band of lateral acceleration."""
    return f"above {lowest:g}" if highest is None else f"{lowest:g} … {highest:g}"


def _seconds(seconds: float) -> Cell:
    return Cell(f"{seconds:.0f}", raw=seconds)


def by_run(result: EvaluateResult) -> Table:
    """Give the errors of every model in every held-out run."""
    signals = signals_of(result)
    columns = [
        Column("run", wrap=True),
        Column("length", "number"),
        Column("model"),
        Column("driven by"),
        *[Column(signal_head(name), "number") for name in signals],
    ]
    found: dict[str, list[tuple[EvaluatedModel, RunError]]] = {}
    for model in result.models:
        for run in model.by_run:
            found.setdefault(run.run, []).append((model, run))
    rows = [
        [
            Cell(run.run),
            Cell(duration(run.seconds), raw=run.seconds),
            Cell(model_name(model.name)),
            Cell(INPUTS[model.input]),
            *[_error(s, run.rms.get(s)) for s in signals],
        ]
        for both in found.values()
        for model, run in both
    ]
    notes = ["RMS error over the whole run, from the logged initial state"]
    return Table(columns, rows, notes=notes, download="evaluate_runs.csv", scroll=len(rows) > 15)
