"""What is told beside the table: pairs of models, curves of mismatch, lost margins, verdict, next step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

import numpy as np

from ident.control.closed_loop import Disturbance
from ident.glossary import controller_name
from ident.model_file import ValidRange
from ident.results import (
    Cell,
    ClosedLoopRun,
    ControllerName,
    LoggedLevel,
    MarginLoss,
    MismatchCurve,
    ModelPair,
)
from ident.stages.validate_bench import Driven
from ident.stages.validate_plan import IMPROVED
from ident.stages.validate_settings import UNITS

LOST_SHARE = 0.5
LOST = (
    "fewer runs completed, or the largest error from an undisturbed start grown by more than half of what was"
    " left to the lane's edge"
)
HARMLESS = 1.1  # times the speed or acceleration that the model was identified at


def pairs_of(driven: Sequence[Driven], costs: Mapping[str, float]) -> list[ModelPair]:
    """One a controller, prediction model and simulation model."""
    return [
        ModelPair(
            controller=one.run.controller,
            prediction_model=one.run.prediction_model,
            simulation_model=one.run.simulation_model,
            completed=float(one.run.completed),
            lateral_error_rms=one.run.lateral_error_rms,
            lateral_error_max=one.run.lateral_error_max,
            cost_ns_per_step=costs.get(one.run.prediction_model),
        )
        for one in driven
    ]


def curves_of(driven: Sequence[Driven]) -> list[MismatchCurve]:
    """One a controller and mismatch, the run without any among its points."""
    made = []
    for controller, of_one in groupby(driven, key=lambda one: one.drive.controller):
        runs = list(of_one)
        nominal = next((one.run for one in runs if not one.drive.mismatch), None)
        kinds = dict.fromkeys(name for one in runs for name in one.drive.mismatch)
        for what in kinds:
            points = {one.drive.mismatch[what]: one.run for one in runs if what in one.drive.mismatch}
            if nominal is not None:
                points[1.0 if what == "friction" else 0.0] = nominal
            made.append(_curve(controller, what, points))
    return made


def _curve(controller: ControllerName, what: str, points: Mapping[float, ClosedLoopRun]) -> MismatchCurve:
    sizes = sorted(points)
    return MismatchCurve(
        controller=controller,
        scenario=points[sizes[0]].scenario,
        what=what,
        unit=UNITS[what],
        sizes=sizes,
        lateral_error_max=[points[s].lateral_error_max if points[s].completed else None for s in sizes],
    )


def margins_of(driven: Sequence[Driven], effects: Sequence[str], lane_half_width: float) -> list[MarginLoss]:
    """One a controller and scenario; see ``LOST``.

    The largest error is that from an undisturbed start: beside the path it would be that of the start itself.
    """
    made = []
    keys = dict.fromkeys((one.run.controller, one.run.scenario) for one in driven)
    for controller, scenario in keys:
        own = [one for one in driven if (one.run.controller, one.run.scenario) == (controller, scenario)]
        parts = [
            [one for one in own if (one.drive.simulation == IMPROVED) is found] for found in (False, True)
        ]
        if not all(parts):
            continue
        share = [float(np.mean([one.run.completed for one in part])) for part in parts]
        undisturbed = [[o for o in part if o.drive.start == Disturbance()] or part for part in parts]
        worst = [max(one.run.lateral_error_max for one in part) for part in undisturbed]
        left = max(lane_half_width - worst[0], 0.0)
        is_lost = share[1] < share[0] or (share[0] > 0 and worst[1] - worst[0] > LOST_SHARE * left)
        made.append(
            MarginLoss(
                controller=controller,
                scenario=scenario,
                effects=list(effects),
                completed_without=share[0],
                completed_with=share[1],
                lateral_error_max_without=worst[0],
                lateral_error_max_with=worst[1],
                is_lost=is_lost,
            )
        )
    return made


def worst_of(runs: Sequence[ClosedLoopRun]) -> int | None:
    """Index of the run that went worst: one that lost the path first, then the largest lateral error."""
    if not runs:
        return None
    return max(
        range(len(runs)), key=lambda number: (not runs[number].completed, runs[number].lateral_error_max)
    )


def verdict(
    table: Sequence[Cell],
    order: Sequence[ControllerName],
    curves: Sequence[MismatchCurve],
    margins: Sequence[MarginLoss],
    speeds: Sequence[float],
    model: str,
) -> str:
    """One line: which controller, on which model, holds how far."""
    if not order:
        return "no controller could be driven"
    first = order[0]
    own = [cell for cell in table if cell.controller == first]
    runs, completed = sum(cell.runs for cell in own), sum(cell.completed for cell in own)
    at = " and ".join(f"{3.6 * speed:.0f}" for speed in speeds)
    if completed == 0:
        return f"no controller holds the lane at {at} km/h on the {_plain(model)} model: every run left it"
    worst = _worst(own)
    told = f"{controller_name(first)} holds {completed} of {runs} disturbed starts at {at} km/h"
    told += f", largest lateral error {worst:.2f} m (median start of its worst scenario)"
    lost = sorted(
        {_size(curve, size) for curve in curves if curve.controller == first for size in _losing(curve)}
    )
    if lost:
        told += f"; it loses the lane with {', '.join(lost)}"
    elif curves:
        told += "; no mismatch that was tried makes it lose the lane"
    if any(one.is_lost for one in margins if one.controller == first):
        told += f"; its margin is gone with {' and '.join(map(_plain, margins[0].effects))}"
    return told


def next_step(
    table: Sequence[Cell],
    valid: ValidRange | None,
    speeds: Sequence[float],
    levels: Sequence[LoggedLevel],
    *,
    logs: bool,
) -> str | None:
    """The one thing to do next."""
    if valid is not None and valid.speed is not None and max(speeds) > HARMLESS * valid.speed[1]:
        return (
            f"drive and identify at {3.6 * max(speeds):.0f} km/h: the model comes from at most "
            f"{3.6 * valid.speed[1]:.0f} km/h, so what is told here of higher speeds is a guess"
        )
    stopped = next((one for one in levels if one.agrees is False and one.level in {0, 1}), None)
    if stopped is not None:
        return (
            f"`ident improve`: {stopped.run} and the model differ at level {stopped.level}: {stopped.reason}"
        )
    if table and not any(cell.completed == cell.runs for cell in table):
        return "validate at a lower speed: no controller completes all starts of any scenario"
    if not logs:
        return "name logs that hold a path and a steering request, to hold the model against them"
    if not levels:
        return (
            "record reference_x and reference_y with the steering request: the logs hold no path to compare"
        )
    return None


def beyond_the_data(valid: ValidRange | None, runs: Sequence[ClosedLoopRun]) -> list[str]:
    """Say where the runs leave what the model was identified at."""
    if valid is None:
        return ["the model does not say at which speed and lateral acceleration it was identified"]
    made = []
    fastest = max((run.speed for run in runs), default=0.0)
    if valid.speed is not None and fastest > HARMLESS * valid.speed[1]:
        made.append(
            f"driven at up to {fastest:.1f} m/s, the model was identified up to {valid.speed[1]:.1f} m/s"
        )
    felt = max((run.lateral_acceleration_max for run in runs if run.completed), default=0.0)
    if valid.lateral_acceleration is not None:
        known = max(map(abs, valid.lateral_acceleration))
        if felt > HARMLESS * known:
            made.append(
                f"lateral acceleration up to {felt:.1f} m/s², the model was identified up to {known:.1f}"
            )
    return made


def _worst(cells: Sequence[Cell]) -> float:
    return max(score.value for cell in cells for score in cell.scores if score.measure == "lateral_error_max")


def _losing(curve: MismatchCurve) -> list[float]:
    """The smallest size to each side that loses the path, where the run without it does not."""
    nominal = 1.0 if curve.what == "friction" else 0.0
    known = dict(zip(curve.sizes, curve.lateral_error_max, strict=True))
    if known.get(nominal) is None:
        return []
    lost = [size for size, error in known.items() if error is None]
    below, above = [s for s in lost if s < nominal], [s for s in lost if s > nominal]
    return [*([max(below)] if below else []), *([min(above)] if above else [])]


def _size(curve: MismatchCurve, size: float) -> str:
    what = _plain(curve.what)
    if curve.what == "friction":
        return f"{what} {size:g}"
    return f"{what} {size:+g} s" if curve.unit == "s" else f"{what} {100 * size:+.0f} %"


def _plain(name: str) -> str:
    return name.replace("_", " ")
