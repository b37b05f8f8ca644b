"""What is driven: the table of controllers, the matrix of models, the sweeps of mismatch, the found effects.

Everything but the table is driven in the first scenario at the first speed, where that is enough to tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ident.control.closed_loop import Disturbance
from ident.results import ControllerName
from ident.stages.validate_bench import IDENTIFIED, Drive, Driven, Outcome, Path
from ident.stages.validate_settings import ValidateSettings

IMPROVED = "improved"  # simulated truck
QUICK_STARTS = 2
MARGIN_STARTS = 1  # beside an undisturbed one


@dataclass(frozen=True)
class Plan:
    """Drives by what they are for.

    table : of all controllers in all scenarios, on trucks drawn from the error bars
    pairs : prediction model against simulation model
    sweeps : one mismatch at a time, from an undisturbed start
    margins : on the truck as identified, and with the effects that were found
    """

    table: list[Drive]
    pairs: list[Drive]
    sweeps: list[Drive]
    margins: list[Drive]

    @property
    def drives(self) -> list[Drive]:
        """All of them, in a fixed order."""
        return [*self.table, *self.pairs, *self.sweeps, *self.margins]

    def parted(self, made: Sequence[Outcome]) -> list[list[Driven]]:
        """Take what came of ``drives`` apart again, without what could not be driven."""
        ends = np.cumsum([0, *(len(part) for part in (self.table, self.pairs, self.sweeps, self.margins))])
        parts = [made[first:last] for first, last in pairwise(ends.tolist())]
        return [[one for one in part if isinstance(one, Driven)] for part in parts]


def drawn_name(number: int) -> str:
    """Name of a simulated truck that is drawn from the error bars."""
    return f"drawn {number}"


def chosen(settings: ValidateSettings) -> ValidateSettings:
    """The settings, cut down where only a first look is asked for."""
    if not settings.quick:
        return settings
    less = {"scenarios": settings.scenarios[:1], "speeds": settings.speeds[:1], "mismatch": {}, "pairs": []}
    return settings.model_copy(update={**less, "starts": min(settings.starts, QUICK_STARTS)})


def plan(
    settings: ValidateSettings,
    prediction: str,
    starts: Sequence[Disturbance],
    drawn: int,
    others: Sequence[str],
    *,
    improved: bool,
    seed: int,
) -> Plan:
    """Say what is driven.

    Parameters
    ----------
    prediction : model that controllers are designed with
    starts : the same for every controller, scenario and speed
    drawn : how many trucks there are that are drawn from the error bars
    others : models that predict and simulate each other
    improved : whether there is a truck with effects that were found
    """
    first = Path(settings.scenarios[0], settings.speeds[0], prediction)
    table = [
        Drive(
            name,
            Path(scenario, speed, prediction),
            _drawn(number, drawn),
            start,
            seed=seed + number,
            kept=True,
        )
        for scenario in settings.scenarios
        for speed in settings.speeds
        for name in settings.controllers
        for number, start in enumerate(starts)
    ]
    pairs = [
        Drive(name, Path(first.scenario, first.speed, model), simulation, starts[0], seed=seed)
        for name in settings.pairs
        if name in settings.controllers
        for model in others
        for simulation in others
    ]
    margins = [
        Drive(name, Path(scenario, first.speed, prediction), simulation, start, seed=seed + number)
        for scenario in (settings.scenarios if improved else [])
        for name in settings.controllers
        for simulation in (IDENTIFIED, IMPROVED)
        for number, start in enumerate([Disturbance(), *starts[:MARGIN_STARTS]])
    ]
    return Plan(table, pairs, _sweeps(settings.controllers, settings, first, seed), margins)


def _drawn(number: int, drawn: int) -> str:
    return drawn_name(number % drawn) if drawn else IDENTIFIED


def _sweeps(
    controllers: Sequence[ControllerName], settings: ValidateSettings, path: Path, seed: int
) -> list[Drive]:
    """Each mismatch alone; the run without any is part of every curve and driven once."""
    if not settings.mismatch:
        return []
    sizes = [{}, *({what: size} for what, found in settings.mismatch.items() for size in found)]
    return [Drive(name, path, IDENTIFIED, mismatch=one, seed=seed) for name in controllers for one in sizes]
