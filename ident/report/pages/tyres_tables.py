"""Tables of the tyre page."""

from __future__ import annotations

from collections.abc import Sequence

from ident.glossary import AXLES
from ident.report.estimates import agreement_cell, estimate_cells, parameter_columns
from ident.report.numbers import (
    NONE,
    angle,
    count,
    duration,
    estimate_interval,
    estimate_value,
    fixed,
    p_value,
    significant,
    unit_text,
    with_unit,
)
from ident.report.page import Block, Cell, Column, Details, Facts, Lines, Table, Text, Tone
from ident.report.pages import health
from ident.report.tyre_parameters import (
    FORMULAS,
    KINDS,
    PARAMETERS,
    chosen_fit,
    displayed,
    estimates,
    full_name,
    in_order,
    parameter,
    short_name,
    signal_head,
    signal_unit,
)
from ident.results import (
    EffectEstimate,
    Estimate,
    FixedValue,
    ForceComparison,
    ResidualNoise,
    TyreFit,
    TyreRun,
    TyresResult,
)

OFF = 3.0
"""How far off a fixed value is taken to be in the example [%]."""
MATTERS = 0.05
"""A parameter depends on a fixed value that moves it by at least this share of its own change [-]."""


def parameters(result: TyresResult) -> Table:
    """Give the parameters of the chosen fit and what follows from them: the answer itself."""
    columns = parameter_columns()
    rows = [
        [Cell(parameter(name).symbol), Cell(full_name(name)), *estimate_cells(estimate, displayed(estimate))]
        for name, estimate in _answers(result).items()
    ]
    return Table(columns, rows, notes=[runs_behind(result)], download="tyre_parameters.csv")


def _answers(result: TyresResult) -> dict[str, Estimate]:
    return estimates(chosen_fit(result)) | {
        "understeer_gradient": result.understeer_gradient,
        "characteristic_speed": result.characteristic_speed,
    }


def open_questions(result: TyresResult) -> list[Block]:
    """Say behind one line why some parameters are weak or not identifiable, and what to drive instead."""
    reasons: dict[str, list[str]] = {}
    for name, estimate in _answers(result).items():
        if estimate.reason:
            reasons.setdefault(estimate.reason, []).append(short_name(name))
    if not reasons:
        return []
    lines = Lines([(f"{', '.join(names)}:", f"{why.rstrip('.')}.") for why, names in reasons.items()])
    open_ones = count(sum(map(len, reasons.values())), "parameter is", "parameters are")
    return [Details(f"Why {open_ones} not known better, and what to drive", [lines])]


def runs_behind(result: TyresResult) -> str:
    """Say in one line what the parameters come from."""
    used = [run for run in result.by_run if run.used]
    windows = count(sum(run.windows for run in used), "window")
    seconds = duration(sum(run.seconds for run in used))
    return (
        f"One model for {count(len(used), 'run')}, {windows}, {seconds}, {count(result.samples, 'sample')}."
    )


def key_figures(result: TyresResult) -> Facts:
    """Give what tells at a glance which tyres were chosen, how far they hold and what they were made from."""
    mass = result.fixed.get("mass")
    return Facts(
        [
            ("tyres", Cell(KINDS[result.chosen], detail=result.why)),
            *[(f"slip excited, {axle}", _slip_range(result.excited.get(axle))) for axle in AXLES],
            ("speed", _range(result.speed, "m/s")),
            ("lateral acceleration", _range(result.lateral_acceleration, "m/s²")),
            ("one model for all runs", agreement_cell(result.agreement_p)),
            *([("mass, taken as given", _stated(mass))] if mass else []),
            ("logs", health.brief(result.runs)),
        ]
    )


def _slip_range(ends: Sequence[float] | None) -> Cell:
    if not ends:
        return Cell("not known", tone="muted")
    return Cell(f"{angle(ends[0])} … {angle(ends[1])}", raw=f"{ends[0]} {ends[1]}")


def _range(ends: Sequence[float], unit: str) -> Cell:
    return Cell(f"{significant(ends[0])} … {with_unit(ends[1], unit)}") if len(ends) == 2 else Cell(NONE)


def _stated(given: FixedValue) -> Cell:
    value = with_unit(given.value, given.unit, 4)
    if given.std is None:
        return Cell(value, tone="caution", detail=f"{given.source}; how well it is known is not stated")
    share = 100 * given.std / abs(given.value) if given.value else 0.0
    told = f"{value} ± {with_unit(given.std, given.unit, 2)} ({significant(share, 2)} %)"
    return Cell(told, detail=f"{given.source}; one standard deviation")


def fits(result: TyresResult) -> Table:
    """Give every kind of tyres that was fitted: errors of each signal, criterion, what follows from it."""
    signals = in_order(name for fit in result.fits for name in fit.rms)
    columns = [
        Column("tyres"),
        *[Column(signal_head(name), "number") for name in signals],
        Column("criterion (BIC)", "number"),
        Column("Kᵤₛ [mrad/(m/s²)]", "number"),
        Column("parameters", "number"),
    ]
    best = min((fit.criterion for fit in result.fits), default=0.0)
    rows = [_fit_row(fit, signals, best, chosen=fit.kind == result.chosen) for fit in result.fits]
    notes = ["errors: RMS of measured minus modelled, in windows with initial states of their own"]
    return Table(columns, rows, notes=notes, download="tyre_fits.csv")


def warnings_of(result: TyresResult) -> list[Block]:
    """Say what is doubtful about each fit."""
    told = [(f"{KINDS[fit.kind]}:", f"{text}.") for fit in result.fits for text in fit.warnings]
    return [Lines(told)] if told else []


def _fit_row(fit: TyreFit, signals: Sequence[str], best: float, *, chosen: bool) -> list[Cell]:
    detail = "chosen" if chosen else None if fit.converged else "not converged"
    tone: Tone = "good" if chosen else "plain" if fit.converged else "bad"
    more = fit.criterion - best
    errors = [_error(name, fit.rms.get(name)) for name in signals]
    gradient = displayed(fit.understeer_gradient)
    return [
        Cell(KINDS[fit.kind], tone=tone, detail=detail),
        *errors,
        Cell("least" if more == 0 else f"+{significant(more)}", raw=fit.criterion),
        Cell(estimate_value(gradient), raw=gradient.value, detail=estimate_interval(gradient)),
        Cell(str(len(fit.parameters))),
    ]


def _error(signal: str, value: float | None) -> Cell:
    """Give the error of a signal in the unit that heads its column."""
    factor = signal_unit(signal)[0]
    return Cell(NONE) if value is None else Cell(significant(value * factor), raw=value * factor)


def kind_parameters(fit: TyreFit) -> Table:
    """Give the parameters of one kind of tyres."""
    columns = [
        Column("parameter"),
        Column("value", "number"),
        Column("95 % interval", "number"),
        Column("unit"),
        Column("status"),
        Column("why", wrap=True),
    ]
    rows = [
        [Cell(full_name(name)), *estimate_cells(estimate, displayed(estimate)), Cell(estimate.reason or "")]
        for name, estimate in estimates(fit).items()
    ]
    return Table(columns, rows, notes=[FORMULAS[fit.kind]], download=f"{fit.kind}.csv")


def by_run(result: TyresResult) -> Table:
    """Give how well the chosen model follows each run, and whether the run agrees with the others."""
    signals = in_order(name for run in result.by_run for name in run.rms)
    columns = [
        Column("run", wrap=True),
        Column("windows", "number"),
        Column("length [s]", "number"),
        Column("speed [m/s]", "number"),
        Column("driven to [m/s²]", "number"),
        *[Column(signal_head(name), "number") for name in signals],
        Column("agrees", "number"),
    ]
    rows = [_run_row(run, signals) for run in result.by_run]
    notes = [
        "driven to: lateral acceleration; signals: RMS of measured minus modelled",
        "agrees: p-value of the hypothesis that the run has the parameters of all runs together",
    ]
    return Table(columns, rows, notes=notes, download="tyre_runs.csv", scroll=len(rows) > 15)


def _run_row(run: TyreRun, signals: Sequence[str]) -> list[Cell]:
    errors = [_error(name, run.rms.get(name)) for name in signals]
    if not run.used:
        agrees = Cell("left out", tone="caution")
    elif run.agreement_p is None:
        agrees = Cell("not tested", tone="muted")
    else:
        agrees = Cell(p_value(run.agreement_p), tone="plain" if run.agreement_p >= 0.01 else "caution")
    ends = [run.speed, run.lateral_acceleration] if run.windows else [[], []]
    return [
        Cell(run.run, detail=run.reason),
        Cell(str(run.windows)),
        Cell(f"{run.seconds:.1f}", raw=run.seconds),
        *[Cell(f"{significant(e[0])} … {significant(e[1])}" if len(e) == 2 else NONE) for e in ends],
        *errors,
        agrees,
    ]


def fixed_values(result: TyresResult) -> list[Block]:
    """Say what the fit takes as given and how far its answers move with it."""
    fit = chosen_fit(result)
    stated = Table(
        [Column("taken as given"), Column("value", "number"), Column("from", wrap=True)],
        [[Cell(name.replace("_", " ")), *_given(given)] for name, given in result.fixed.items()],
        download="tyre_given.csv",
    )
    return [*_examples(result, fit), stated, *_property_files(result), *_sensitivity(result, fit)]


def _property_files(result: TyresResult) -> list[Block]:
    """Give the property files whose scaling factors were fitted."""
    if not result.property_files:
        return []
    columns = [
        Column("property file", wrap=True),
        Column("tyres"),
        Column("sha256"),
        Column("not used", wrap=True),
    ]
    rows = [
        [
            Cell(one.name),
            Cell(", ".join(f"{number} {axle}" for axle, number in one.number.items())),
            Cell(one.sha256[:16], raw=one.sha256),
            Cell(", ".join(one.not_modelled) or NONE),
        ]
        for one in result.property_files
    ]
    return [Table(columns, rows, download="tyre_property_files.csv")]


def _sensitivity(result: TyresResult, fit: TyreFit) -> list[Block]:
    names = [name for name in result.fixed if any(name in change for change in fit.to_fixed.values())]
    if not names:
        return []
    columns = [Column("parameter"), *[Column(f"{name.replace('_', ' ')} +1 %", "number") for name in names]]
    known = _identified(fit)
    rows = [
        [Cell(full_name(key)), *_moves(change, names, known=key in known)]
        for key, change in fit.to_fixed.items()
    ]
    note = "relative change of each parameter where what was taken as given is 1 % larger"
    table = Table(columns, rows, notes=[note], download="tyre_fixed.csv")
    return [Details("How each parameter moves with what was taken as given", [table])]


def _given(given: FixedValue) -> list[Cell]:
    cell = _stated(given)
    return [Cell(cell.text, raw=given.value, tone=cell.tone), Cell(cell.detail or "")]


def _moves(change: dict[str, float], names: Sequence[str], *, known: bool) -> list[Cell]:
    """Give relative changes; those of what the data hardly tell mean little and are grey."""
    return [
        Cell(_signed(change[name], 2), raw=change[name], tone="plain" if known else "muted")
        if name in change
        else Cell(NONE)
        for name in names
    ]


def _signed(value: float, places: int) -> str:
    return f"{'+' if value > 0 else ''}{fixed(value, places)}\u00a0%"


def _identified(fit: TyreFit) -> set[str]:
    return {name for name, estimate in estimates(fit).items() if estimate.status == "identified"}


def _examples(result: TyresResult, fit: TyreFit) -> list[Block]:
    """Put into words what a wrong mass, or whatever was taken as given, does."""
    lines, known = [], _identified(fit)
    for name, given in result.fixed.items():
        moved = {
            short_name(key): OFF * change[name]
            for key, change in fit.to_fixed.items()
            if key in known and abs(change.get(name, 0.0)) >= MATTERS
        }
        if not moved:
            continue
        told = ", ".join(f"{key} {_signed(value, 1)}" for key, value in moved.items())
        counted = (
            "the vehicle file does not say how well it is known: the intervals leave it out"
            if given.std is None
            else "its stated standard deviation is in the intervals"
        )
        lines.append((f"{name.replace('_', ' ')} {OFF:g} % larger:", f"{told}; {counted}."))
    if not lines:
        return [Text("No parameter moves with what was taken as given.", "muted")]
    return [Lines(lines)]


def nuisance(effects: Sequence[EffectEstimate]) -> Block:
    """Give the offsets and biases that were fitted with the tyres."""
    if not effects:
        return Text("No offset or bias was fitted.", "muted")
    columns = [
        Column("effect"),
        Column("of", wrap=True),
        Column("run", wrap=True),
        Column("parameter"),
        Column("value", "number"),
        Column("95 % interval", "number"),
        Column("unit"),
        Column("needed"),
    ]
    rows = [
        [
            Cell(f"{effect.name.replace('_', ' ')} ({effect.enters})"),
            Cell((effect.of or NONE).replace("_", " ")),
            Cell(effect.run or "all"),
            Cell(name.replace("_", " ")),
            *estimate_cells(estimate, displayed(estimate))[:3],
            _needed(effect),
        ]
        for effect in effects
        for name, estimate in effect.parameters.items()
    ]
    notes = ["needed: the data call for it, all of that name together at 1 %"]
    return Table(columns, rows, notes=notes, download="tyre_effects.csv", scroll=len(rows) > 15)


def _needed(effect: EffectEstimate) -> Cell:
    told = "" if effect.p_value is None else f" ({p_value(effect.p_value)})"
    return Cell(f"yes{told}") if effect.needed else Cell(f"no{told}", tone="muted")


def noise(found: dict[str, ResidualNoise]) -> Table:
    """Give what the noise of each signal was found to be."""
    columns = [
        Column("signal"),
        Column("noise", "number"),
        Column("innovations", "number"),
        Column("unit"),
        Column("AR coefficients", wrap=True),
        Column("every [ms]", "number"),
        Column("what is left"),
    ]
    rows = []
    for name, one in found.items():
        factor, unit = signal_unit(name)
        left = (
            Cell("holds what the model lacks", tone="caution", badge=True)
            if one.coloured_beyond
            else Cell("noise of a sensor", tone="good", badge=True)
        )
        rows.append(
            [
                Cell(name.replace("_", " ")),
                Cell(significant(one.total_std * factor), raw=one.total_std * factor),
                Cell(significant(one.std * factor), raw=one.std * factor),
                Cell(unit_text(unit)),
                Cell(", ".join(significant(a, 2) for a in one.ar) or "white"),
                Cell(significant(one.sample_period * 1e3), raw=one.sample_period * 1e3),
                left,
            ]
        )
    note = (
        "standard deviations; where what is left is correlated over longer than sensors are, the intervals "
        "rest on how far stretches of the data disagree"
    )
    return Table(columns, rows, notes=[note], download="tyre_noise.csv")


def measured_forces(compared: Sequence[ForceComparison]) -> Table:
    """Give the axles as their measured wheel forces see them, beside what the motion says."""
    columns = [
        Column("axle"),
        Column("stiffness from wheel forces [kN/rad]", "number"),
        Column("stiffness from the motion [kN/rad]", "number"),
        Column("measured over needed force [–]", "number"),
        Column("correlation [–]", "number"),
        Column("what explains the difference", wrap=True),
    ]
    rows = [
        [
            Cell(one.axle),
            *[_with_interval(estimate) for estimate in (one.from_forces, one.from_motion, one.scale)],
            Cell(significant(one.correlation, 4), raw=one.correlation),
            Cell(one.reason),
        ]
        for one in compared
    ]
    return Table(columns, rows, download="measured_forces.csv")


def _with_interval(estimate: Estimate) -> Cell:
    shown = displayed(estimate)
    return Cell(estimate_value(shown), raw=shown.value, detail=estimate_interval(shown))


def glossary(fit: TyreFit) -> Table:
    """Say what each parameter of the chosen tyres means."""
    bare: dict[str, None] = dict.fromkeys(
        [*fit.front, *fit.rear, "yaw_inertia", "understeer_gradient", "characteristic_speed"]
    )
    known = [PARAMETERS[name] for name in bare if name in PARAMETERS]
    rows = [[Cell(item.symbol), Cell(item.name), Cell(item.meaning)] for item in known]
    return Table([Column("symbol"), Column("name"), Column("meaning")], rows)
