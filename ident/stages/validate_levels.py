"""All levels of all logged runs, and the table of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ident.errors import NotIdentifiable
from ident.results import LoggedLevel, Refusal
from ident.signals.run import LoadedLogs
from ident.stages.inputs import InputSettings
from ident.stages.output import Context
from ident.stages.validate_logged import open_levels
from ident.stages.validate_logged_data import followed_runs
from ident.stages.validate_setup import Setup

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Compared:
    """What the logs say of the model.

    levels : of each run; reached : the highest that agrees in every run, None where there is none
    """

    levels: list[LoggedLevel] = field(default_factory=list)
    refused: list[Refusal] = field(default_factory=list)
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)

    @property
    def reached(self) -> int | None:
        """The highest level at which every run agrees."""
        for level in (3, 2, 1, 0):
            own = [one for one in self.levels if one.level == level]
            if own and all(
                any(o.agrees for o in own if o.run == run) for run in {one.run for one in self.levels}
            ):
                return level
        return None


def compare(loaded: LoadedLogs, inputs: InputSettings, setup: Setup, context: Context) -> Compared:
    """Hold the model against every run that has a path and a steering request."""
    if not loaded.runs:
        return Compared()
    truck = setup.subject.truck
    try:
        found, refused = followed_runs(loaded, inputs.align, setup.settings.runs, truck)
    except NotIdentifiable as error:
        return Compared(refused=[Refusal("logged runs", str(error))])
    levels = []
    for number, one in enumerate(found):
        context.progress("compare with the logs", number, len(found))
        levels += open_levels(one, truck, setup.drawn_trucks, setup.settings.acceptable)
    if not found and not refused:
        refused = [Refusal("logged runs", "none holds reference_x, reference_y and a steering request")]
    return Compared(levels, refused)
