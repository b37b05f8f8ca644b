"""Tables of the steering page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from ident.report.estimates import TONES, agreement_cell, estimate_cells, parameter_columns
from ident.report.numbers import (
    NONE,
    angle,
    count,
    decimals_of,
    estimate_interval,
    estimate_value,
    fixed,
    percent,
    significant,
)
from ident.report.page import Cell, Column, Facts, Table
from ident.report.pages import health
from ident.report.steering_parameters import (
    CLASSES,
    EQUATIONS,
    METHODS,
    PARAMETERS,
    SHORT_METHODS,
    SIGNALS_OF_PAIR,
    of_model,
)
from ident.results import Estimate, Experiment, Noise, RunFit, SteeringResult, StepFit

MANY_METHODS = 4  # with one reason: called the step methods


def parameters(result: SteeringResult) -> Table:
    """Give the identified parameters with their intervals: the answer itself."""
    columns = parameter_columns()
    rows = []
    reasons: dict[str, list[str]] = {}
    for parameter in PARAMETERS:
        estimate = of_model(result.model, parameter)
        rows.append([Cell(parameter.symbol), Cell(parameter.name), *estimate_cells(estimate)])
        if estimate.reason:
            reasons.setdefault(estimate.reason, []).append(parameter.symbol)
    notes = [f"{', '.join(symbols)}: {reason}." for reason, symbols in reasons.items()]
    if not result.adequate:
        notes.append(
            "The intervals assume that the model explains the data; it does not, so they are too narrow."
        )
    return Table(columns, rows, notes=[runs_behind(result), *notes], download="parameters.csv")


def runs_behind(result: SteeringResult) -> str:
    """Say in one line which runs the parameters come from."""
    used = sum("likelihood" in experiment.used_by for experiment in result.experiments)
    experiments = f", {count(used, 'experiment')}" if used else ""
    runs = count(sum(fit.used for fit in result.by_run), "run")
    return f"One model for {runs}{experiments}, {count(result.samples, 'sample')}."


def key_figures(result: SteeringResult) -> Facts:
    """Give what tells at a glance how good the model is and what it was made from."""
    request, measured = SIGNALS_OF_PAIR[result.pair]
    return Facts(
        [
            ("from → to", f"{request.replace('_', ' ')} → {measured.replace('_', ' ')}"),
            ("response", Cell(CLASSES[result.classification], detail=result.classification_reason)),
            ("variance accounted for", Cell(percent(result.vaf), raw=result.vaf)),
            ("RMS error", angle(result.rms_error)),
            ("measurement noise", Cell(angle(result.noise.total_std), detail=noise_text(result.noise))),
            ("one model for all runs", agreement_cell(result.agreement_p)),
            ("logs", health.brief(result.runs)),
        ]
    )


def noise_text(noise: Noise) -> str:
    """Describe the noise model in one line."""
    if noise.kind == "ar":
        kind = f"AR({len(noise.ar)}) from sample to sample" if noise.ar else "white"
    else:
        time = noise.correlation_time
        kind = "continuous AR(1)" + (f", correlation time {significant(time)} s" if time else "")
    if noise.quantisation:
        kind += f"; quantised to {significant(noise.quantisation * 1e3)} mrad"
    return kind


def by_run(result: SteeringResult) -> Table:
    """Give the fit to each run alone beside the common model on that run."""
    shown = PARAMETERS[:5]
    columns = [
        Column("run", wrap=True),
        Column("excitation"),
        Column("samples", "number"),
        Column("VAF", "number"),
        Column("RMS error [mrad]", "number"),
        *[Column(_head(parameter.symbol, parameter.field), "number") for parameter in shown],
    ]
    rows = [_run_row(fit, [parameter.field for parameter in shown]) for fit in result.by_run]
    notes = [
        "VAF and RMS error: of the common model on that run; below, VAF of its own fit",
        "parameters: fitted to that run alone",
    ]
    return Table(columns, rows, notes=notes, download="fits_by_run.csv", scroll=len(rows) > 15)


def _head(symbol: str, field: str) -> str:
    return symbol if field == "gain" else f"{symbol} [s]"


def _run_row(fit: RunFit, fields: Sequence[str]) -> list[Cell]:
    own = None if fit.vaf_own is None else f"own fit {percent(fit.vaf_own)}"
    row = [
        Cell(fit.run, detail=fit.reason),
        Cell(", ".join(fit.excitation)),
        Cell(str(fit.samples)),
        Cell(percent(fit.vaf), raw=fit.vaf, detail=own),
        Cell(significant(fit.rms_error * 1e3), raw=fit.rms_error * 1e3),
    ]
    if fit.model is None:
        return row + [Cell(NONE)] * len(fields)
    return row + [_spread_cell(getattr(fit.model, field)) for field in fields]


def _spread_cell(estimate: Estimate) -> Cell:
    return Cell(
        estimate_value(estimate),
        raw=estimate.value,
        detail=estimate_interval(estimate),
        tone="plain" if estimate.status == "identified" else TONES[estimate.status],
    )


def step_methods(result: SteeringResult) -> Table:
    """Give the step methods beside the maximum likelihood estimate."""
    fields = ("gain", "dead_time", "time_constant_1", "time_constant_2")
    symbols = [_head(parameter.symbol, parameter.field) for parameter in PARAMETERS[:4]]
    columns = [
        Column("method"),
        Column("steps", "number"),
        *[Column(symbol, "number") for symbol in symbols],
        Column("RMS error of the steps [mrad]", "number"),
    ]
    best = [_spread_cell(getattr(result.model, field)) for field in fields]
    rows = [[Cell(METHODS["likelihood"]), Cell(NONE), *best, Cell(NONE)]]
    rows += [_method_row(fit, fields) for fit in result.step_methods]
    notes = [
        "step methods: median over the steps, ± standard deviation between steps",
        "maximum likelihood: value and 95 % interval; this is the estimate that goes on",
    ]
    return Table(columns, rows, notes=notes, download="step_methods.csv")


def _method_row(fit: StepFit, fields: Sequence[str]) -> list[Cell]:
    name = f"{METHODS[fit.method]} {EQUATIONS.get(fit.method, '')}".strip()
    row = [Cell(name, detail=fit.reason or _damping(fit)), Cell(str(fit.steps))]
    for field in fields:
        value, spread = getattr(fit, field), fit.spread.get(field)
        row.append(_median_cell(value, spread))
    error = fit.rms_error
    row.append(Cell(NONE) if error is None else Cell(significant(error * 1e3), raw=error * 1e3))
    return row


def _damping(fit: StepFit) -> str | None:
    if fit.natural_frequency is None or fit.damping_ratio is None:
        return None
    return f"ωₙ = {significant(fit.natural_frequency)} rad/s, ζ = {significant(fit.damping_ratio)}"


def by_amplitude(result: SteeringResult) -> Table:
    """Give the fit to the steps of each size alone."""
    shown = PARAMETERS[:5]
    columns = [
        Column("size of the steps [rad]", "number"),
        Column("steps", "number"),
        *[Column(_head(parameter.symbol, parameter.field), "number") for parameter in shown],
    ]
    rows = [
        [
            Cell(significant(fit.amplitude), raw=fit.amplitude),
            Cell(str(fit.steps)),
            *[_spread_cell(getattr(fit, parameter.field)) for parameter in shown],
        ]
        for fit in result.by_amplitude
    ]
    notes = ["maximum likelihood of the steps and pulses of one size (within 5 %) alone, with 95 % intervals"]
    return Table(columns, rows, notes=notes, download="by_amplitude.csv")


def ratio(result: SteeringResult) -> Table:
    """Give the map from steering-wheel to road-wheel angle, with the ratio of each piece."""
    columns = [
        Column("steering wheel [rad]", "number"),
        Column("road wheel [rad]", "number"),
        Column("ratio up to here [–]", "number"),
    ]
    rows, before = [], None
    for wheel, road in result.ratio:
        steps = None if before is None else (wheel - before[0], road - before[1])
        local = steps[0] / steps[1] if steps and steps[1] else None
        rows.append([Cell(significant(x, 4), raw=x) for x in (wheel, road, local)])
        before = (wheel, road)
    notes = [f"from: {result.ratio_source}"]
    if result.ratio_source == "kinematic gain at low speed":
        notes.append(
            "the tyres' slip at the speed driven is in it: understeer makes it a few per cent larger"
        )
    return Table(columns, rows, notes=notes, download="ratio.csv")


def _median_cell(value: float | None, spread: float | None) -> Cell:
    """Give a median to the place that the spread between steps supports."""
    places = decimals_of(spread)
    if value is None or spread is None or places is None:
        return Cell(significant(value, 4), raw=value)
    return Cell(fixed(value, places), raw=value, detail=f"± {fixed(spread, places)}")


def experiments(found: Sequence[Experiment]) -> Table:
    """Give every experiment found, what uses it, and why it is left out elsewhere."""
    columns = [
        Column("run", wrap=True),
        Column("kind"),
        Column("start [s]", "number"),
        Column("length [s]", "number"),
        Column("amplitude [rad]", "number"),
        Column("frequency [rad/s]", "number"),
        Column("used by", wrap=True),
        Column("left out", wrap=True),
    ]
    rows = [_experiment_row(experiment) for experiment in found]
    return Table(columns, rows, download="experiments.csv", scroll=len(rows) > 14)


def _reasons(experiment: Experiment) -> list[str]:
    """Say why methods do not use an experiment, those with the same reason together."""
    by_reason: dict[str, list[str]] = {}
    for method, reason in experiment.rejected.items():
        by_reason.setdefault(reason, []).append(SHORT_METHODS.get(method, method))
    return [
        f"{'step methods' if len(methods) > MANY_METHODS else ', '.join(methods)}: {reason}"
        for reason, methods in by_reason.items()
    ]


def _experiment_row(experiment: Experiment) -> list[Cell]:
    uncertain = experiment.start_uncertainty
    left_out = _reasons(experiment)
    used = ", ".join(SHORT_METHODS.get(method, method) for method in experiment.used_by)
    return [
        Cell(experiment.run),
        Cell(experiment.kind),
        Cell(
            f"{experiment.start:.2f}",
            raw=experiment.start,
            detail=f"up to {significant(uncertain * 1e3, 2)} ms earlier" if uncertain else None,
        ),
        Cell(f"{experiment.end - experiment.start:.2f}", raw=experiment.end - experiment.start),
        Cell(significant(experiment.amplitude), raw=experiment.amplitude),
        Cell(significant(experiment.frequency), raw=experiment.frequency),
        Cell(used) if used else Cell("nothing", tone="caution"),
        Cell("; ".join(left_out) or NONE, tone="muted"),
    ]


def experiment_counts(found: Sequence[Experiment]) -> str:
    """Count the experiments by kind, and those that each method uses."""
    if not found:
        return "No experiment was found in the request."
    kinds = Counter(experiment.kind for experiment in found)
    users = Counter(method for experiment in found for method in experiment.used_by)
    unused = sum(not experiment.used_by for experiment in found)
    text = "Found: " + ", ".join(count(number, kind) for kind, number in kinds.items()) + ". Used by "
    text += (
        "; ".join(f"{SHORT_METHODS.get(method, method)}: {number}" for method, number in users.items())
        or "none"
    )
    return f"{text}. Left out altogether: {unused}." if unused else f"{text}."


def glossary() -> Table:
    """Say what each parameter means."""
    rows = [[Cell(item.symbol), Cell(item.name), Cell(item.meaning)] for item in PARAMETERS]
    return Table([Column("symbol"), Column("name"), Column("meaning")], rows)
