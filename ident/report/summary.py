"""The answer of a stage in plain text, for the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from ident.glossary import AXLES
from ident.report.estimates import STATUS
from ident.report.evaluated import (
    MARKS,
    STANDARD,
    costs_told,
    judge,
    judge_position,
    model_name,
    position_error,
    reason,
    shown_error,
    standard,
)
from ident.report.improved import (
    CHECKED,
    added_names,
    by_verdict,
    effect_name,
    parameter_name,
    shown_interval,
    signals_of,
    size_text,
    taken,
)
from ident.report.improved import shown as shown_size
from ident.report.numbers import (
    NONE,
    angle,
    count,
    estimate_interval,
    estimate_value,
    fixed,
    listed,
    p_value,
    percent,
    plain,
    significant,
    unit_text,
    with_unit,
)
from ident.report.refusals import by_reason
from ident.report.steering_parameters import CLASSES, PARAMETERS, SHORT_METHODS, of_model
from ident.report.tyre_parameters import (
    KINDS,
    chosen_fit,
    displayed,
    estimates,
    in_order,
    parameter,
    short_name,
    signal_unit,
)
from ident.results import (
    Bandwidth,
    Error,
    Estimate,
    EvaluateResult,
    Experiment,
    ImproveResult,
    Requirement,
    SteeringModel,
    SteeringResult,
    TyresResult,
)

TOLD = ("yaw_rate", "lateral_acceleration", "heading", "lateral_velocity")
MOST_TOLD = 2  # beside the position
MOST_LINES = 8
"""Refusals and warnings beyond these are counted."""


def describe_steering(result: SteeringResult) -> str:
    """Say what was identified, how well, from what, and what to do next.

    Returns
    -------
    text : of a few lines, without control characters; the last line does not end with a line break
    """
    lines = ["adequate" if result.adequate else "NOT adequate", f"  {plain(result.verdict)}", ""]
    lines += parameter_lines(result.model)
    lines += ["", *_fit_lines(result), *_bandwidth_lines(result.bandwidth)]
    lines += experiment_lines(result.experiments)
    lines += _limited("refused", [f"{what}: {reason}" for what, reason in by_reason(result.refused)])
    lines += _limited("warning", result.warnings)
    if result.next_step:
        lines += ["", f"next: {plain(result.next_step)}"]
    return "\n".join(lines)


def parameter_lines(model: SteeringModel) -> list[str]:
    """Give one line a parameter, in columns: symbol, name, value, 95 % interval, unit, status."""
    return _table_lines([(item.symbol, item.name, of_model(model, item)) for item in PARAMETERS])


def _table_lines(found: Sequence[tuple[str, str, Estimate]]) -> list[str]:
    """Put estimates into columns, each with its symbol and name; the reasons stand below."""
    rows = [("", "", "value", "95 % interval", "unit", "")]
    reasons: dict[str, list[str]] = {}
    for symbol, name, estimate in found:
        status = "" if estimate.status == "identified" else STATUS[estimate.status]
        interval, unit = estimate_interval(estimate), unit_text(estimate.unit)
        rows.append((symbol, name, estimate_value(estimate), interval, unit, status))
        if estimate.reason:
            reasons.setdefault(plain(estimate.reason), []).append(symbol)
    widths = [max(len(row[column]) for row in rows) for column in range(6)]
    lines = []
    for row in rows:
        cells = [
            cell.rjust(width) if column in {2, 3} else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append(("  " + "  ".join(cells)).rstrip())
    return lines + [f"  {', '.join(symbols)}: {reason}" for reason, symbols in reasons.items()]


def _fit_lines(result: SteeringResult) -> list[str]:
    agree = "not tested" if result.agreement_p is None else p_value(result.agreement_p)
    response = f"response: {CLASSES[result.classification]} ({plain(result.classification_reason)})"
    fit = f"fit: {percent(result.vaf)} of the variance, RMS error {angle(result.rms_error)}"
    noise = f"noise {angle(result.noise.total_std)}"
    used = sum(fit.used for fit in result.by_run)
    runs = f"runs: {used}, {count(result.samples, 'sample')}; same model in all of them: {agree}"
    return [response, f"{fit}, {noise}", runs]


def _bandwidth_lines(bandwidth: Bandwidth | None) -> list[str]:
    if bandwidth is None:
        return []
    one = bandwidth.bode
    said = {True: "agrees with", False: "contradicts", None: "not compared with"}[bandwidth.overlap]
    value = f"bandwidth: {estimate_value(one)} ({estimate_interval(one)}) {unit_text(one.unit)}"
    return [f"{value}, {said} the measured response", f"  {plain(bandwidth.reason)}"]


def experiment_lines(experiments: Sequence[Experiment]) -> list[str]:
    """Count the experiments found, used by each method, and left out by all with the commonest reasons."""
    if not experiments:
        return ["experiments: none found in the request"]
    kinds = Counter(experiment.kind for experiment in experiments)
    users = Counter(method for experiment in experiments for method in experiment.used_by)
    unused = [experiment for experiment in experiments if not experiment.used_by]
    found = ", ".join(count(number, kind) for kind, number in kinds.most_common())
    used = ", ".join(f"{SHORT_METHODS.get(method, method)} {number}" for method, number in users.items())
    lines = [f"experiments: {found}; used by {used or 'nothing'}; left out by all {len(unused)}"]
    reasons = Counter(plain(reason) for experiment in unused for reason in set(experiment.rejected.values()))
    return lines + [f"  left out {number}×: {reason}" for reason, number in reasons.most_common(3)]


def _limited(what: str, texts: Sequence[str]) -> list[str]:
    lines = [f"{what}: {plain(text)}" for text in texts[:MOST_LINES]]
    left = len(texts) - len(lines)
    return [*lines, f"{what}: and {left} more, in the report"] if left else lines


def describe_tyres(result: TyresResult) -> str:
    """Say which tyres were identified, how well, from what, and what to do next.

    Returns
    -------
    text : of a few lines, without control characters; the last line does not end with a line break
    """
    fit = chosen_fit(result)
    derived = {
        "understeer_gradient": result.understeer_gradient,
        "characteristic_speed": result.characteristic_speed,
    }
    found = [
        (short_name(name), parameter(name).name, displayed(estimate))
        for name, estimate in (estimates(fit) | derived).items()
    ]
    lines = [plain(result.verdict), f"  tyres: {KINDS[result.chosen]} ({plain(result.why)})", ""]
    lines += [*_table_lines(found), "", *_tyre_fit_lines(result)]
    others = [refusal for refusal in result.refused if refusal.what not in estimates(fit)]
    lines += _limited("refused", [f"{what}: {reason}" for what, reason in by_reason(others)])
    lines += _limited("warning", result.warnings)
    if result.next_step:
        lines += ["", f"next: {plain(result.next_step)}"]
    return "\n".join(lines)


def _tyre_fit_lines(result: TyresResult) -> list[str]:
    """Say how well each signal is followed, what range was driven, and what was taken as given."""
    rms, errors = chosen_fit(result).rms, []
    for name in in_order(rms):
        factor, unit = signal_unit(name)
        errors.append(f"{name.replace('_', ' ')} {significant(rms[name] * factor)} {unit}")
    slips = [
        f"{axle} {angle(ends[0])} … {angle(ends[1])}" for axle in AXLES if (ends := result.excited.get(axle))
    ]
    used = sum(run.used for run in result.by_run)
    agree = "not tested" if result.agreement_p is None else p_value(result.agreement_p)
    lines = [
        f"RMS error: {', '.join(errors) or 'none'}",
        f"slip angles excited: {'; '.join(slips) or 'none'}",
        f"runs: {used}, {count(result.samples, 'sample')}; same model in all of them: {agree}",
    ]
    unstated = [name.replace("_", " ") for name, fixed in result.fixed.items() if fixed.std is None]
    if unstated:
        lines.append(
            f"taken as exact: {', '.join(unstated)}: the intervals leave their errors out; "
            "state them in the vehicle file, such as mass: 12500 kg +- 300 kg"
        )
    return lines


def describe_evaluate(result: EvaluateResult) -> str:
    """Say which model is good enough, how far each is off, whether requirements are met, what to do next.

    Returns
    -------
    text : of a few lines, without control characters; the last line does not end with a line break
    """
    lines = [plain(result.verdict), *_choice_lines(result), "", *_model_lines(result), ""]
    lines += _against_lines(result)
    lines += _requirement_lines(result.requirements)
    found = [one for one in result.checks if one.verdict != "fine"]
    lines += _limited("check", [f"{one.what}: {one.text}" for one in found])
    told = {one.text for one in found}
    lines += _limited("refused", [f"{what}: {reason}" for what, reason in by_reason(result.refused)])
    lines += _limited("warning", [text for text in result.warnings if text not in told])
    if result.next_step:
        lines += ["", f"next: {plain(result.next_step)}"]
    return "\n".join(lines)


def _choice_lines(result: EvaluateResult) -> list[str]:
    chosen = "none" if result.chosen is None else model_name(result.chosen)
    held = {"run": "whole runs", "part": "parts of the same run", "block": "blocks of the same run"}
    on = held.get(result.split_by, "NOT held out: used in the fit")
    names = listed([plain(name) for name in result.held_out], 6)
    why = reason(result)
    told = "" if why is None else f" ({plain(why)})"
    return [f"  chosen: {chosen}{told}", f"  held out: {names or 'nothing'} ({on})"]


def _model_lines(result: EvaluateResult) -> list[str]:
    """Put the errors of every model over windows into columns, with how far it holds and what it costs."""
    models = result.models
    told = [name for name in TOLD if any(name in standard(model) for model in models)][:MOST_TOLD]
    placed = any(position_error(standard(model)) is not None for model in models)
    heads = [f"{name.replace('_', ' ')} [{signal_unit(name)[1]}]" for name in told]
    rows = [("model", *heads, *(["position [m]"] if placed else []), "good to [m/s²]", "ns/step")]
    for model in models:
        name = model_name(model.name) + (", on the request" if model.input == "request" else "")
        errors = _error_cells(result, standard(model), told, placed=placed)
        rows.append((name, *errors, significant(model.valid_to, 2), significant(model.cost_ns_per_step)))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    note = f"  RMS over windows of {STANDARD}; ✗ beyond the acceptable size, ≈ its interval holds it"
    return [
        *("  " + _aligned(row, widths) for row in rows),
        note,
        *(f"  {cost}" for cost in costs_told(result)),
    ]


def _error_cells(
    result: EvaluateResult, found: Mapping[str, Error], told: Sequence[str], *, placed: bool
) -> list[str]:
    """Mark and size of the error of each signal, then of the position."""
    judged = [judge(found.get(name), result.acceptable.get(name)) for name in told]
    sizes = [shown_error(name, found.get(name)) for name in told]
    if placed:
        judged.append(judge_position(found, result.acceptable))
        sizes.append(significant(position_error(found)))
    return [MARKS[one].replace("\u00a0", " ") + size for one, size in zip(judged, sizes, strict=True)]


def _against_lines(result: EvaluateResult) -> list[str]:
    """Say of each signal whether the identified model or that of the other file is better."""
    lines = []
    for one in result.comparisons:
        if result.against is None or result.against not in (one.better, one.worse):
            continue
        low, high = (significant(end) for end in (one.ratio.low, one.ratio.high))
        certain = "" if one.ratio.status == "identified" else ": within the spread between blocks"
        lines.append(
            f"  {one.signal.replace('_', ' ')}: {plain(model_name(one.better))} leaves "
            f"{significant(one.ratio.value)} ({low} … {high}) times the error of "
            f"{plain(model_name(one.worse))}{certain}"
        )
    return [*lines, ""] if lines else []


def _aligned(row: Sequence[str], widths: Sequence[int]) -> str:
    cells = [cell.rjust(width) for cell, width in zip(row, widths, strict=True)]
    return "  ".join([row[0].ljust(widths[0]), *cells[1:]])


def _requirement_lines(found: Sequence[Requirement]) -> list[str]:
    lines = []
    for one in found:
        verdict = {True: "met", False: "NOT met", None: "not measured"}[one.met]
        limit, measured = (
            with_unit(value, one.unit).replace("\u00a0", " ") for value in (one.limit, one.measured)
        )
        told = "" if one.measured is None else f" {measured},"
        lines.append(f"requirement {verdict}: {plain(one.signal).replace('_', ' ')}{told} at most {limit}")
    return lines


def describe_improve(result: ImproveResult) -> str:
    """Say what the model lacked, the error before and after, what cannot be separated, what to do next.

    Returns
    -------
    text : of a few lines, without control characters; the last line does not end with a line break
    """
    looked = " and ".join(result.layers) or "sensors alone"
    lines = [plain(result.told), f"  began with: {plain(result.base)}; looked at: {looked}", ""]
    lines += [*_error_lines(result), *_added_lines(result), *_sensor_lines(result)]
    lines += _limited("refused", [f"{what}: {reason}" for what, reason in by_reason(result.refused)])
    lines += _limited("warning", result.warnings)
    if result.not_testable:
        names = listed([effect_name(one.what) for one in result.not_testable], 4)
        lines.append(f"not tested: {plain(names)}")
    if result.next_experiment:
        lines += ["", f"next: {plain(result.next_experiment.drive)}"]
    return "\n".join(lines)


def _error_lines(result: ImproveResult) -> list[str]:
    """Put the errors before and after, with the noise floor, into columns."""
    signals, error = signals_of(result), result.error
    if not signals:
        return []
    on = "RMS, held out" if error.split_by != "none" else "RMS, of the fit itself"
    rows: list[tuple[str, ...]] = [(on, "before", "after", "95 % interval", "noise floor", "gone", "unit")]
    for name in signals:
        gone = taken(result, name)
        lower = "≥ " if name in error.at_least else ""
        share = NONE if gone is None else f"{lower if gone > 0 else ''}{fixed(100 * gone, 0)} %"
        sizes = [shown_size(name, one) for one in (error.before[name], error.after[name])]
        noise = lower + shown_size(name, error.noise.get(name))
        interval = shown_interval(name, error.after[name])
        rows.append((name.replace("_", " "), *sizes, interval or NONE, noise, share, signal_unit(name)[1]))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    notes = ["  gone: of what is above the noise"]
    if error.at_least:
        notes.append("  ≥: errors of the sensor that last longer are not told from the model's")
    return [*("  " + _aligned(row, widths) for row in rows), *notes, ""]


def _added_lines(result: ImproveResult) -> list[str]:
    """Say what was added, of what size, what it cannot be told from, and whether held-out data confirm it."""
    lines = []
    for effect in result.effects:
        sizes = [f"{parameter_name(name)} {size_text(one)}" for name, one in effect.parameters.items()]
        lines.append(
            f"added: {plain(effect_name(effect.key))}, {'; '.join([*sizes, p_value(effect.p_value)])}"
        )
        others = [effect_name(one) for one in effect.members if one not in {effect.key, effect.name}]
        lines += [f"  cannot be told from: {plain(', '.join(others))}"] if others else []
    if result.discovered is not None:
        term = f"{added_names(result)[-1]}, {size_text(result.discovered.coefficient)}"
        lines.append(f"added without a name: {plain(term)}, {p_value(result.discovered.p_value)}")
    if result.confirmation is not None:
        said = "confirmed" if result.confirmation.confirmed else "NOT confirmed"
        gain = size_text(result.confirmation.gain)
        lines.append(
            f"{said} on held-out data: {gain} log likelihood a sample ({plain(result.confirmation.how)})"
        )
    return lines


def _sensor_lines(result: ImproveResult) -> list[str]:
    """Count the checks of sensors, and say what those that differ mean."""
    found = by_verdict(result.sensors)
    told = [f"{one.name}: {one.meaning}" for one in found if one.verdict == "differs"]
    counts = [
        f"{number} {CHECKED[way][0]}" for way in CHECKED if (number := sum(s.verdict == way for s in found))
    ]
    lines = [f"sensors: {', '.join(counts)}"] if counts else []
    return lines + _limited("sensor", told)
