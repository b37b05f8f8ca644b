"""Controllers on the identified model: which holds, how far the model may be wrong, and what the logs say.

Controllers are designed with the model as identified. They drive simulated trucks that are made anew from the
same file: drawn from the error bars of the fit, with a mismatch, with other tyres, or with the effects that
were found. Then the model is held against runs in which a logged controller followed a path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pandas as pd

from ident.control.controllers.weights import weights_of
from ident.errors import NotIdentifiable, UsageError
from ident.results import (
    SCHEMA_VERSION,
    LogFile,
    Provenance,
    Refusal,
    TyresResult,
    ValidateResult,
)
from ident.signals.run import LoadedLogs
from ident.stages.inputs import InputSettings, load, provenance
from ident.stages.output import Context, StageOutput
from ident.stages.validate_bench import Beside, Compared, Drive, Driven, NotDriven, Outcome, drive_all
from ident.stages.validate_cells import RANKING, cells, claims, ranking
from ident.stages.validate_levels import Logged, compare, tables_of
from ident.stages.validate_plan import Plan, chosen, plan
from ident.stages.validate_settings import ValidateSettings
from ident.stages.validate_setup import Setup, costs_of, set_up, subject_of
from ident.stages.validate_tables import course_table, horizon_table, opened, reference_table
from ident.stages.validate_told import (
    LOST,
    beyond_the_data,
    curves_of,
    margins_of,
    next_step,
    pairs_of,
    verdict,
    worst_of,
)

NO_LOGS = LoadedLogs([], [], [], [])


def validate(
    logs: Sequence[Path],
    inputs: InputSettings,
    settings: ValidateSettings,
    context: Context,
    *,
    tyres: TyresResult | None = None,
) -> StageOutput[ValidateResult]:
    """Drive controllers on the model, and hold the model against the runs under LOGS.

    Parameters
    ----------
    logs : may be empty where the settings name a model
    tyres : the fits with other tyres, for the matrix of models

    Raises
    ------
    UsageError
        If there are neither logs nor a model.
    UnusableLog
        If logs are named and none can be read.
    NotIdentifiable
        If the model lacks a part without which no truck can be simulated, or no scenario can be driven.
    """
    if not logs and settings.model is None:
        raise UsageError("ident validate without LOGS: name logs, or a model.yaml with --model")
    loaded = load(logs, inputs, context) if logs else NO_LOGS
    subject = subject_of(settings.model, context)
    wanted = chosen(settings)
    setup = set_up(subject, wanted, tyres, inputs.seed)
    asked = plan(
        setup.settings,
        subject.truck.name,
        setup.starts,
        setup.drawn,
        setup.others,
        improved=subject.improved is not None,
        seed=inputs.seed,
    )
    logged = compare(loaded, inputs, setup, context)
    everything: list[Drive | Beside] = [*asked.drives, *logged.besides(setup)]
    made = drive_all(setup.bench, everything, context.jobs, context.progress)
    return _output(loaded, context, setup, asked, made, logged)


def _output(
    loaded: LoadedLogs,
    context: Context,
    setup: Setup,
    asked: Plan,
    driven: Sequence[Outcome],
    logged: Logged,
) -> StageOutput[ValidateResult]:
    parts = asked.parted(driven)
    table = parts[0]
    if not table:
        reasons = dict.fromkeys(one.reason for one in driven if isinstance(one, NotDriven))
        raise NotIdentifiable(f"no controller could be driven: {next(iter(reasons))}")
    beside = [one for one in driven if isinstance(one, Compared)]
    refused = [*setup.refused, *_not_driven(driven), *logged.refused, *loaded.unreadable]
    result = _result(loaded, context, setup, parts, logged.joined(beside), refused)
    tables = _tables(setup, table, logged, result.worst) | tables_of(logged, beside, setup)
    return StageOutput(result, tables)


def _result(
    loaded: LoadedLogs,
    context: Context,
    setup: Setup,
    parts: Sequence[Sequence[Driven]],
    logged: Logged,
    refused: list[Refusal],
) -> ValidateResult:
    settings, subject, seed = setup.settings, setup.subject, context.seed
    table, pairs, sweeps, margins = parts
    runs = [one.run for one in table]
    found, order = cells(runs, seed), ranking(cells(runs, seed))
    curves, lost = curves_of(sweeps), margins_of(margins, subject.effects, settings.lane_half_width)
    valid = subject.model.valid_range
    return ValidateResult(
        schema_version=SCHEMA_VERSION,
        provenance=_provenance(context, loaded, settings),
        verdict=verdict(found, order, curves, lost, settings.speeds, subject.truck.name),
        next_step=next_step(found, valid, settings.speeds, logged.levels, logs=bool(loaded.runs)),
        model=subject.truck.name,
        period=settings.period,
        lane_half_width=settings.lane_half_width,
        settings=_settings_told(setup),
        runs=runs,
        cells=found,
        ranking=order,
        pairs=pairs_of(pairs, costs_of(setup.bench) if pairs else {}),
        mismatch=curves,
        margins=lost,
        claims=claims(runs, seed),
        logged=logged.levels,
        reached=logged.reached,
        worst=worst_of(runs),
        weights={name: weights_of(name) for name in order},
        health=[run.health for run in loaded.runs],
        refused=refused,
        warnings=[
            *loaded.warnings,
            *setup.warnings,
            *logged.warnings,
            *_notes(table),
            *beyond_the_data(valid, runs),
        ],
    )


def _notes(table: Sequence[Driven]) -> list[str]:
    """What the table says otherwise than it was asked."""
    return list(dict.fromkeys(one.note for one in table if one.note is not None))


def _not_driven(driven: Sequence[Outcome]) -> list[Refusal]:
    """Why something could not be driven, each reason once for a controller."""
    found = dict.fromkeys((one.drive.controller, one.reason) for one in driven if isinstance(one, NotDriven))
    return [Refusal(name, reason) for name, reason in found]


def _tables(
    setup: Setup, table: Sequence[Driven], logged: Logged, worst: int | None
) -> dict[str, pd.DataFrame]:
    runs = [one.run for one in table]
    courses = {number: one.course for number, one in enumerate(table) if one.course is not None}
    shown = {number: courses[number] for number in opened(runs) if number in courses}
    own = {
        path: reference
        for path, reference in setup.bench.references.items()
        if path.prediction == setup.subject.truck.name
    }
    own |= logged.references(setup.subject.truck.name)
    made = {"validate": course_table(shown, runs), "validate_reference": reference_table(own)}
    if worst is not None and worst in courses:
        made["validate_horizon"] = horizon_table(worst, courses[worst])
    return made


def _provenance(context: Context, loaded: LoadedLogs, settings: ValidateSettings) -> Provenance:
    made = provenance(context, loaded)
    if settings.model is None:
        return made
    data = settings.model.read_bytes()
    file = LogFile(settings.model.name, sha256(data).hexdigest(), len(data))
    return replace(made, files=[*made.files, file], applied={**made.applied, "model": settings.model.name})


def _settings_told(setup: Setup) -> dict[str, str]:
    settings, drawn = setup.settings, setup.drawn
    at = ", ".join(f"{3.6 * speed:.0f} km/h" for speed in settings.speeds)
    kind = "drawn at random" if settings.disturbances == "monte_carlo" else "one disturbance at a time"
    return {
        "starts": f"{len(setup.starts)}, {kind}, the same for every controller",
        "speeds": f"{at}, less where the path asks for more than {settings.lateral_acceleration:g} m/s²",
        "simulated trucks": f"{drawn} drawn from the error bars" if drawn else "as identified",
        "sensors": f"noise of {', '.join(sorted(setup.bench.sensors.noise)) or 'no signal'}",
        "ranking": RANKING,
        "a margin is lost": LOST,
        "first look": "yes: one scenario, no sweeps" if settings.quick else "no",
    }
