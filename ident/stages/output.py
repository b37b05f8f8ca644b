"""What every stage is given beside its settings, and what it returns to the pipeline."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    import pandas as pd

    from ident.model_file import Model

Result = TypeVar("Result")
Progress = Callable[[str, int, int], None]


def no_progress(what: str, done: int, total: int) -> None:
    """Take a progress report (what is done, steps done, steps in all) and show nothing."""


@dataclass(frozen=True)
class Context:
    """Who asked, when, and where progress is shown.

    command : the command line that makes this output again
    date : ISO 8601, the only thing that differs between two equal runs
    loaded : logs that were read already, for the next stage of the same run (``ident.stages.inputs.load``)
    models : stage that this one uses -> model as it stands after that one
    jobs : processes that may work side by side
    """

    command: str
    date: str
    seed: int = 0
    progress: Progress = no_progress
    loaded: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    models: Mapping[str, Model] = field(default_factory=dict, repr=False, compare=False)
    jobs: int = 1


@dataclass(frozen=True)
class StageOutput(Generic[Result]):
    """A stage's answer.

    result : one of the classes of ``ident.results``
    tables : name -> table; becomes ``signals/<name>.parquet``
    model : the part of ``model.yaml`` that this stage has identified, None where it has none
    """

    result: Result
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    model: Mapping[str, Any] | None = None
