"""All levels of all logged runs, and the table of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from ident.control.reference import Reference
from ident.errors import NotIdentifiable
from ident.glossary import controller_name
from ident.results import LoggedLevel, Refusal
from ident.signals.run import LoadedLogs
from ident.stages.inputs import InputSettings
from ident.stages.output import Context
from ident.stages.validate_bench import Beside, Compared, Path
from ident.stages.validate_logged import open_levels
from ident.stages.validate_logged_data import FollowedRun, followed_runs
from ident.stages.validate_logged_table import logged_table
from ident.stages.validate_setup import Setup
from ident.stages.validate_stretch import LoggedStretch, stretches_of

POSITION = "position_y"


@dataclass(frozen=True)
class Logged:
    """What the logs say of the model.

    levels : of each run, those that were looked at or why they were not
    stretches : the longest of each run that agrees at levels 0 and 1
    """

    levels: list[LoggedLevel] = field(default_factory=list)
    refused: list[Refusal] = field(default_factory=list)
    runs: list[FollowedRun] = field(default_factory=list)
    stretches: list[LoggedStretch] = field(default_factory=list)

    @property
    def warnings(self) -> list[str]:
        """What is told of the paths that were followed."""
        return [f"{one.run}, path: {text}" for one in self.stretches for text in one.lost]

    def besides(self, setup: Setup) -> list[Beside]:
        """What is to be driven beside the logged controllers."""
        settings, noise = setup.settings, setup.subject.truck.noise
        acceptable = settings.acceptable.get(POSITION, 0.0)
        size = noise.get("position_across", noise.get(POSITION, 0.0))
        return [
            Beside(name, stretch, acceptable, size)
            for stretch in self.stretches
            for name in settings.controllers
        ]

    def joined(self, made: Sequence[Compared]) -> Logged:
        """With the levels of what was driven; where no controller agrees at level 2, that is the end."""
        levels = [*self.levels, *(level for one in made for level in one.levels)]
        for stretch in self.stretches:
            own = [one for one in made if one.beside.stretch.run == stretch.run]
            if own and not any(level.level == 3 for one in own for level in one.levels):
                nearest = min(own, key=lambda one: one.shadow.share)
                why = (
                    "no controller asks for what the logged one asked for: the nearest is "
                    f"{controller_name(nearest.beside.controller)}, {100 * nearest.shadow.share:.0f} % off"
                )
                levels.append(LoggedLevel(stretch.run, 3, None, {}, {}, reason=why))
        return replace(self, levels=sorted(levels, key=lambda one: (one.run, one.level)))

    def references(self, prediction: str) -> dict[Path, Reference]:
        """The logged paths."""
        return {
            Path("logged", float(np.mean(one.reference.speed)), prediction, one.run): one.reference
            for one in self.stretches
        }

    @property
    def reached(self) -> int | None:
        """The highest level at which, in every run, the vehicle or one of the controllers agrees."""
        runs = {one.run for one in self.levels}
        found = {
            level
            for level in range(4)
            if runs
            and all(any(o.agrees for o in self.levels if (o.run, o.level) == (r, level)) for r in runs)
        }
        return next((level for level in (3, 2, 1, 0) if set(range(level + 1)) <= found), None)


def compare(loaded: LoadedLogs, inputs: InputSettings, setup: Setup, context: Context) -> Logged:
    """Hold the model against every run that has a path and a steering request: levels 0 and 1."""
    if not loaded.runs:
        return Logged()
    truck = setup.subject.truck
    try:
        found, refused = followed_runs(loaded, inputs.align, setup.settings.runs, truck)
    except NotIdentifiable as error:
        return Logged(refused=[Refusal("logged runs", str(error))])
    if not found and not refused:
        refused = [Refusal("logged runs", "none holds reference_x, reference_y and a steering request")]
    levels, stretches = [], []
    for number, one in enumerate(found):
        context.progress("compare with the logs", number, len(found))
        own = open_levels(one, truck, setup.drawn_trucks, setup.settings.acceptable)
        levels += own
        if all(level.agrees for level in own):
            longest, why_not = _longest(one, setup)
            stretches += longest
            refused += why_not
    kept = stretches[:1] if setup.settings.quick else stretches
    return Logged(levels, refused, found, kept)


def _longest(followed: FollowedRun, setup: Setup) -> tuple[list[LoggedStretch], list[Refusal]]:
    made, refused = stretches_of(followed, setup.subject.truck, setup.settings.period)
    return ([max(made, key=lambda one: one.cycles.size)] if made else []), refused


def tables_of(logged: Logged, made: Sequence[Compared], setup: Setup) -> dict[str, pd.DataFrame]:
    """Table ``validate_logged``, where a run was compared."""
    table = logged_table(logged.runs, logged.stretches, made, setup.subject.truck)
    return {} if table is None else {"validate_logged": table}
