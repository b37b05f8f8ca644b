"""The stages there are: how each is called, and how its answer is shown.

A stage's modules are imported when it is used: what one stage needs does not slow another down.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.pipeline.recipe import Recipe
from ident.stages.output import Context, StageOutput

if TYPE_CHECKING:
    import pandas as pd

    from ident.report.page import Page
    from ident.report.recording import Part
    from ident.results import (
        EvaluateResult,
        ImproveResult,
        InfoResult,
        SteeringResult,
        TyresResult,
        ValidateResult,
    )

Tables = Mapping[str, "pd.DataFrame"]
Results = Mapping[str, Any]
"""Stage -> its result, None where it cannot answer."""


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline.

    run : computes; it is given the logs, the whole recipe (of which it takes its part), the context and the
        results of the stages that it needs
    describe : its result in plain text, for the terminal
    page : its page of the report, from its result and its tables
    tables : names of the tables that ``page`` and ``record`` need
    record : its part of the recording, None where there is nothing to record
    title : of its page, where that can only say why there is no answer
    needs : stages whose results it cannot do without; helped_by : those that it takes where they answer
    takes : those that it takes only where they are there and up to date: they are not run for it
    given : whether the recipe gives what those stages would identify: none of them is used then
    settings : keys of the recipe on which its result depends, beside ``align``, ``runs`` and ``seed``
    reads : files on which it depends beside the logs and what applies to them, by what they are
    identifies : whether it answers what the logs were driven for
    unmet : requirements that its result does not meet, one line each
    """

    run: Callable[[Sequence[Path], Recipe, Context, Results], StageOutput[Any]]
    describe: Callable[[Any], str]
    page: Callable[[Any, Tables], Page]
    tables: tuple[str, ...] = ()
    record: Callable[[Any, Tables], Part] | None = None
    title: str = ""
    needs: tuple[str, ...] = ()
    helped_by: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()
    given: Callable[[Recipe], bool] = lambda _: False
    settings: tuple[str, ...] = ()
    reads: Callable[[Recipe], Mapping[str, Path]] = lambda _: {}
    identifies: bool = True
    unmet: Callable[[Any], list[str]] = lambda _: []


def _info(logs: Sequence[Path], recipe: Recipe, context: Context, _: Results) -> StageOutput[InfoResult]:
    from ident.stages.info import info

    return info(logs, recipe.inputs(), context)


def _describe_info(result: InfoResult) -> str:
    from ident.report.text import describe

    return describe(result)


def _info_page(result: InfoResult, _: Tables) -> Page:
    from ident.report.pages.info import info_page

    return info_page(result)


def _steering(
    logs: Sequence[Path], recipe: Recipe, context: Context, _: Results
) -> StageOutput[SteeringResult]:
    from ident.stages.steering import steering

    return steering(logs, recipe.inputs(), recipe.steering, context)


def _describe_steering(result: SteeringResult) -> str:
    from ident.report.summary import describe_steering

    return describe_steering(result)


def _steering_page(result: SteeringResult, tables: Tables) -> Page:
    from ident.report.pages.steering import steering_page

    return steering_page(result, tables)


def _record_steering(result: SteeringResult, tables: Tables) -> Part:
    from ident.report.recording import steering_part

    return steering_part(result, tables)


def _tyres(logs: Sequence[Path], recipe: Recipe, context: Context, _: Results) -> StageOutput[TyresResult]:
    from ident.stages.tyres import tyres

    return tyres(logs, recipe.inputs(), recipe.tyres, context)


def _describe_tyres(result: TyresResult) -> str:
    from ident.report.summary import describe_tyres

    return describe_tyres(result)


def _tyres_page(result: TyresResult, tables: Tables) -> Page:
    from ident.report.pages.tyres import tyres_page

    return tyres_page(result, tables)


def _record_tyres(result: TyresResult, tables: Tables) -> Part:
    from ident.report.recording import tyres_part

    return tyres_part(result, tables)


def _evaluate(
    logs: Sequence[Path], recipe: Recipe, context: Context, results: Results
) -> StageOutput[EvaluateResult]:
    from ident.stages.evaluate import evaluate

    return evaluate(
        logs,
        recipe.inputs(),
        recipe.evaluate,
        context,
        tyres=results["tyres"],
        steering=results["steering"],
    )


def _describe_evaluate(result: EvaluateResult) -> str:
    from ident.report.summary import describe_evaluate

    return describe_evaluate(result)


def _evaluate_page(result: EvaluateResult, tables: Tables) -> Page:
    from ident.report.pages.evaluate import evaluate_page

    return evaluate_page(result, tables)


def _record_evaluate(result: EvaluateResult, tables: Tables) -> Part:
    from ident.report.recording import evaluate_part

    return evaluate_part(result, tables)


def _against(recipe: Recipe) -> dict[str, Path]:
    model = recipe.evaluate.against
    return {} if model is None else {"against": model}


def _unmet(result: EvaluateResult) -> list[str]:
    return [
        f"{one.signal.replace('_', ' ')} rms "
        + ("could not be measured" if one.measured is None else f"is {one.measured:.3g} {one.unit}")
        + f", required is at most {one.limit:.3g} {one.unit}: the report shows where it is lost"
        for one in result.requirements
        if not one.met
    ]


def _improve(
    logs: Sequence[Path], recipe: Recipe, context: Context, _: Results
) -> StageOutput[ImproveResult]:
    from ident.stages.improve import improve

    return improve(logs, recipe.inputs(), recipe.improve, context)


def _describe_improve(result: ImproveResult) -> str:
    from ident.report.summary import describe_improve

    return describe_improve(result)


def _improve_page(result: ImproveResult, tables: Tables) -> Page:
    from ident.report.pages.improve import improve_page

    return improve_page(result, tables)


def _record_improve(result: ImproveResult, tables: Tables) -> Part:
    from ident.report.recording import improve_part

    return improve_part(result, tables)


def _validate(
    logs: Sequence[Path], recipe: Recipe, context: Context, results: Results
) -> StageOutput[ValidateResult]:
    from ident.stages.validate import validate

    return validate(logs, recipe.inputs(), recipe.validation, context, tyres=results.get("tyres"))


def _describe_validate(result: ValidateResult) -> str:
    from ident.report.validate_summary import describe_validate

    return describe_validate(result)


def _validate_page(result: ValidateResult, tables: Tables) -> Page:
    from ident.report.pages.validate import validate_page

    return validate_page(result, tables)


def _record_validate(result: ValidateResult, tables: Tables) -> Part:
    from ident.report.recording import validate_part

    return validate_part(result, tables)


def _model_of(recipe: Recipe) -> dict[str, Path]:
    model = recipe.validation.model
    return {} if model is None else {"model": model}


STAGES: dict[str, Stage] = {
    "info": Stage(_info, _describe_info, _info_page, title="Logs", identifies=False),
    "steering": Stage(
        _steering,
        _describe_steering,
        _steering_page,
        tables=("steering", "steering_request"),
        record=_record_steering,
        title="Steering",
        settings=("steering",),
    ),
    "tyres": Stage(
        _tyres,
        _describe_tyres,
        _tyres_page,
        tables=("tyres", "tyre_forces"),
        record=_record_tyres,
        title="Tyres",
        settings=("tyres", "split"),
    ),
    "evaluate": Stage(
        _evaluate,
        _describe_evaluate,
        _evaluate_page,
        tables=("evaluate",),
        record=_record_evaluate,
        title="Evaluation",
        needs=("tyres",),
        helped_by=("steering",),
        settings=("evaluate", "split"),
        reads=_against,
        unmet=_unmet,
    ),
    "improve": Stage(
        _improve,
        _describe_improve,
        _improve_page,
        tables=("improve", "improve_held_out"),
        record=_record_improve,
        title="Improvement",
        settings=("improve",),
    ),
    "validate": Stage(
        _validate,
        _describe_validate,
        _validate_page,
        tables=("validate", "validate_reference", "validate_horizon", "validate_logged"),
        record=_record_validate,
        title="Validation",
        needs=("steering", "tyres"),
        takes=("improve",),
        given=lambda recipe: recipe.validation.model is not None,
        settings=("validation",),
        reads=_model_of,
        identifies=False,
    ),
}
"""In the order in which they run; what a stage uses stands before it."""
