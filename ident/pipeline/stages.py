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
    from ident.results import InfoResult, SteeringResult, TyresResult

Tables = Mapping[str, "pd.DataFrame"]


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline.

    run : computes; it is given the logs, the whole recipe (of which it takes its part) and the context
    describe : its result in plain text, for the terminal
    page : its page of the report, from its result and its tables
    tables : names of the tables that ``page`` and ``record`` need
    record : its part of the recording, None where there is nothing to record
    """

    run: Callable[[Sequence[Path], Recipe, Context], StageOutput[Any]]
    describe: Callable[[Any], str]
    page: Callable[[Any, Tables], Page]
    tables: tuple[str, ...] = ()
    record: Callable[[Any, Tables], Part] | None = None


def _info(logs: Sequence[Path], recipe: Recipe, context: Context) -> StageOutput[InfoResult]:
    from ident.stages.info import info

    return info(logs, recipe.inputs(), context)


def _describe_info(result: InfoResult) -> str:
    from ident.report.text import describe

    return describe(result)


def _info_page(result: InfoResult, _: Tables) -> Page:
    from ident.report.pages.info import info_page

    return info_page(result)


def _steering(logs: Sequence[Path], recipe: Recipe, context: Context) -> StageOutput[SteeringResult]:
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


def _tyres(logs: Sequence[Path], recipe: Recipe, context: Context) -> StageOutput[TyresResult]:
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


STAGES: dict[str, Stage] = {
    "info": Stage(_info, _describe_info, _info_page),
    "steering": Stage(
        _steering,
        _describe_steering,
        _steering_page,
        tables=("steering", "steering_request"),
        record=_record_steering,
    ),
    "tyres": Stage(
        _tyres,
        _describe_tyres,
        _tyres_page,
        tables=("tyres", "tyre_forces"),
        record=_record_tyres,
    ),
}
