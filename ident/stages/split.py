"""Draw which data are held out, where the recipe does not say it: once, for all stages alike."""

from __future__ import annotations

from collections.abc import Sequence
from glob import escape
from pathlib import Path

from ident.errors import NotIdentifiable
from ident.experiments.motion import MotionRun
from ident.experiments.splits import FEWEST, draw_split, last_third, manoeuvre_of
from ident.stages.inputs import InputSettings, SplitSettings, load
from ident.stages.output import Context
from ident.stages.tyre_data import LEAST_ACCELERATION, hardest_turn, tyre_data
from ident.stages.tyre_settings import TyresSettings


def drawn_split(
    logs: Sequence[Path], inputs: InputSettings, settings: TyresSettings, context: Context
) -> SplitSettings:
    """Return a split that is stated in full: among the runs that tell how the vehicle turns.

    With fewer than three of them the last third of each is held out. All of them are of one vehicle: runs of
    others take part neither in the fit nor in its evaluation.

    Raises
    ------
    UnusableLog
        If there is no log that can be read.
    """
    try:
        data = tyre_data(load(logs, inputs, context), inputs.align, settings.runs, settings.least_speed)
    except NotIdentifiable:
        return inputs.split  # nothing turns: the stages that need it say why
    turning = [run for run in data.runs if hardest_turn(run) >= LEAST_ACCELERATION]
    names = [run.name for run in turning]
    if len(names) < FEWEST:
        return inputs.split.model_copy(update={"blocks": _blocks(turning)})
    groups = [manoeuvre_of(name) for name in names]
    drawn = draw_split(names, groups, inputs.seed, inputs.split.share)
    return inputs.split.model_copy(update={"held_out": [escape(name) for name in drawn]})


def _blocks(runs: Sequence[MotionRun]) -> dict[str, tuple[float, float]]:
    spans = {run.name: (float(run.windows[0].times[0]), float(run.windows[-1].times[-1])) for run in runs}
    return {name: last_third(*span) for name, span in spans.items()}
