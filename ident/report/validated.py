"""What the validation says, as every view of it tells it: names, units, order, what was best, what was lost.

A run is lost where the truck did not come to the end of the path within the lane.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ident.glossary import SIGNALS, controller_name
from ident.report.evaluated import model_name
from ident.report.improved import effect_name
from ident.report.numbers import NONE, fixed, significant, unit_text
from ident.report.page import Tone
from ident.results.validate import (
    Cell,
    Claim,
    ClosedLoopRun,
    ControllerName,
    LoggedLevel,
    ScenarioName,
    Score,
    ValidateResult,
)

SCENARIOS: dict[ScenarioName, str] = {
    "single_lane_change": "single lane change",
    "double_lane_change": "double lane change (ISO 3888-1)",
    "double_lane_change_scaled": "double lane change, scaled by speed",
    "truncated_slalom": "truncated slalom",
    "logged": "path of a log",
}
SHORT_SCENARIOS: dict[ScenarioName, str] = {
    "single_lane_change": "single lane change",
    "double_lane_change": "ISO 3888-1",
    "double_lane_change_scaled": "double, scaled",
    "truncated_slalom": "slalom",
    "logged": "logged path",
}
STYLES: dict[ControllerName, tuple[str, str]] = {
    "pid": ("request", "dot"),
    "pure_pursuit": ("other_3", "dot"),
    "stanley": ("other_4", "dot"),
    "lqr": ("other_2", "solid"),
    "mpc_time_kinematic": ("other_1", "dash"),
    "mpc_time": ("other_1", "solid"),
    "mpc_spatial": ("modelled", "dash"),
    "mpc_spatial_rate": ("modelled", "solid"),
    "mpc_robust": ("caution", "solid"),
}
"""Colour and dash of the lines of a controller."""
SHOWN_IN = {"rad": (1e3, "mrad"), "rad/s": (1e3, "mrad/s")}
MISMATCHES = {
    "mass": "mass",
    "stiffness": "cornering stiffness",
    "friction": "friction",
    "dead_time": "dead time",
    "time_constant": "time constants",
    "ratio": "steering ratio",
    "lateral_error": "lateral error at the start",
    "heading_error": "heading error at the start",
    "speed": "speed at the start",
}
HOLDS: dict[str, tuple[str, Tone]] = {
    "yes": ("holds", "good"),
    "no": ("does not hold", "bad"),
    "in part": ("in part", "caution"),
    "undecided": ("undecided", "muted"),
}
LEVELS = {
    0: "measured steering → vehicle",
    1: "command → actuator and vehicle",
    2: "our controller on the logged states",
    3: "the whole loop on the logged reference",
}
ALWAYS_TOLD = (
    *("lateral_error_rms", "lateral_error_max", "lateral_error_settled", "arrival_time_error"),
    *("braking_work", "acceleration_work", "lateral_jerk_rms", "steering_rate_rms", "solve_time_p99"),
)
"""Measures of the table of a scenario; the others stand behind a line."""
WHOLE_LOOP = 3
"""The level at which the whole loop agrees with a log."""
BEST = "★"
"""Stands before a number that no other controller is clearly better in."""


@dataclass(frozen=True)
class Measure:
    """A measure of a closed loop, of which less is better.

    name : for a reader; short : where there is little room; unit : as it is shown; factor : from SI to it
    places : more decimals than these are never shown
    """

    name: str
    short: str
    unit: str
    factor: float = 1.0
    places: int = 3

    def shown(self, value: float) -> str:
        """Give a value [SI] in the shown unit."""
        return rounded(self.factor * value, self.places)

    @property
    def head(self) -> str:
        """The short name with its unit."""
        return f"{self.short} [{self.unit}]"


MEASURES: dict[str, Measure] = {
    "lateral_error_rms": Measure("lateral error, RMS", "e_y RMS", "m"),
    "lateral_error_max": Measure("largest lateral error", "|e_y| max", "m"),
    "lateral_error_p95": Measure("lateral error, 95 %", "|e_y| 95 %", "m"),
    "lateral_error_settled": Measure("settled lateral error", "|e_y| settled", "mm", 1e3, 1),
    "heading_error_rms": Measure("heading error, RMS", "e_ψ RMS", "mrad", 1e3, 1),
    "arrival_time_error": Measure("error of the arrival time", "|arrival error|", "s"),
    "braking_work": Measure("braking work per mass", "braking", "J/kg", places=2),
    "acceleration_work": Measure("acceleration work per mass", "accelerating", "J/kg", places=2),
    "drive_switches": Measure("changes of braking and accelerating", "drive switches", "–", places=1),
    "steering_rate_rms": Measure("steering effort, RMS rate", "steering rate", "mrad/s", 1e3, 1),
    "steering_rate_max": Measure("largest rate of the road wheels", "rate max", "mrad/s", 1e3, 1),
    "steering_reversals": Measure("steering reversals", "reversals", "1/s", places=2),
    "lateral_acceleration_max": Measure("largest lateral acceleration", "a_y max", "m/s²"),
    "lateral_jerk_rms": Measure("lateral jerk, RMS", "jerk RMS", "m/s³"),
    "solve_time_p50": Measure("time of a step, median", "step p50", "ms", 1e3, 2),
    "solve_time_p99": Measure("time of a step, 99 %", "step p99", "ms", 1e3, 2),
    "violations": Measure("cycles beyond a limit", "violations", "–"),
    "infeasible": Measure("cycles without a solution", "infeasible", "–"),
}
"""In the order in which they are told."""
MAIN = "lateral_error_rms"
"""What the first table shows: the largest error is often that of the disturbed start itself."""


def measure_of(name: str, unit: str = "1") -> Measure:
    """Give how a measure is shown; one that is not known by its own name, in its own unit."""
    factor, shown = SHOWN_IN.get(unit, (1.0, unit_text(unit)))
    own = name.replace("_", " ")
    return MEASURES.get(name) or Measure(own, own, shown, factor)


def upper_first(text: str) -> str:
    """Begin a text with a capital letter, the rest as it is."""
    return text[:1].upper() + text[1:]


def rounded(value: float, places: int) -> str:
    """Round to three significant digits, and never to more than so many decimals."""
    text = significant(value)
    return (
        fixed(value, places) if value and math.isfinite(value) and abs(value) < 10.0 ** (2 - places) else text
    )


def scenario_name(name: str, run: str | None = None) -> str:
    """Name a scenario for a reader, with the run whose path it is."""
    text = {str(key): said for key, said in SCENARIOS.items()}.get(name, name.replace("_", " "))
    return text if run is None else f"{text}, {run}"


def style_of(name: str) -> tuple[str, str]:
    """Give colour and dash of a controller."""
    return {str(key): style for key, style in STYLES.items()}.get(name, ("muted", "dot"))


def mismatch_name(what: str) -> str:
    """Name a mismatch or a disturbance of the start for a reader."""
    return MISMATCHES.get(what, what.replace("_", " ").replace(".", ", "))


def simulated_name(name: str) -> str:
    """Name a model, such as magic_formula+tyre_relaxation, for a reader."""
    model, *effects = name.split("+")
    return " + ".join([model_name(model), *(effect_name(effect) for effect in effects if effect)])


def controllers_of(result: ValidateResult) -> list[str]:
    """Name every controller that was driven, best first, those without a rank behind."""
    found: dict[str, None] = dict.fromkeys(result.ranking)
    found |= dict.fromkeys(
        [*(cell.controller for cell in result.cells), *(run.controller for run in result.runs)]
    )
    return list(found)


def scenarios_of(result: ValidateResult) -> list[str]:
    """Name every scenario of the table, in the order in which they are told."""
    found = [cell.scenario for cell in result.cells]
    return [name for name in SCENARIOS if name in found]


def cell_of(result: ValidateResult, controller: str, scenario: str) -> Cell | None:
    """Give what a controller did in a scenario, None where it was not driven there."""
    found = (cell for cell in result.cells if (cell.controller, cell.scenario) == (controller, scenario))
    return next(found, None)


def score_of(cell: Cell | None, measure: str) -> Score | None:
    """Give a measure of a cell, None where it has none or where it is no number."""
    scores = [] if cell is None else cell.scores
    return next((one for one in scores if one.measure == measure and math.isfinite(one.value)), None)


def measures_of(cells: Iterable[Cell]) -> list[str]:
    """Name every measure that some cell has, in the order in which they are told."""
    found = {score.measure: None for cell in cells for score in cell.scores}
    return [name for name in MEASURES if name in found] + [name for name in found if name not in MEASURES]


def main_measure(result: ValidateResult) -> str | None:
    """Name the measure that the first table shows: the lateral error, else the first there is."""
    found = measures_of(result.cells)
    return MAIN if MAIN in found else next(iter(found), None)


def shown_score(score: Score | None) -> str:
    """Give a measure in its shown unit."""
    if score is None:
        return NONE
    return measure_of(score.measure, score.unit).shown(score.value)


def shown_range(score: Score | None) -> str | None:
    """Give the 95 % interval of a measure in its shown unit, None without one that can be seen."""
    if score is None or score.low is None or score.high is None:
        return None
    low, high = (measure_of(score.measure, score.unit).shown(end) for end in (score.low, score.high))
    return None if low == high else f"{low} … {high}"


def is_best(cell: Cell, measure: str) -> bool:
    """Say whether no other is clearly better; without intervals, of too few starts, nobody is told to be."""
    score = score_of(cell, measure)
    return measure in cell.best_in and score is not None and score.low is not None


def lost_in(cell: Cell) -> int:
    """Count the runs of a cell in which the path was lost."""
    return cell.runs - cell.completed


def completed_text(cell: Cell) -> str:
    """Say how many runs came to the end of the path."""
    lost = lost_in(cell)
    if lost == 0:
        return f"all {cell.runs}" if cell.runs > 1 else "yes"
    return f"✗\u00a0{lost} of {cell.runs} lost" if cell.completed else f"✗\u00a0all {cell.runs} lost"


def disturbance_text(run: ClosedLoopRun) -> str:
    """Say what was disturbed in a run."""
    parts = [
        f"{mismatch_name(name)} {disturbed_size(name, size)}"
        for name, size in run.disturbance.items()
        if size
    ]
    return ", ".join(parts) or "undisturbed"


UNITS = {"lateral_error": "m", "heading_error": "rad", "speed": "m/s", "dead_time": "s", "friction": "1"}
"""Units of disturbances that are no share of what they disturb."""


def disturbed_size(name: str, size: float) -> str:
    """Give the size of a disturbance with its sign; a mismatch without a unit is a share of what it is of."""
    unit = UNITS.get(name)
    if unit is None:
        return f"{'+' if size > 0 else ''}{fixed(100 * size, 0)}\u00a0%"
    if unit == "1":
        return significant(size, 2)
    if unit == "rad":
        return f"{'+' if size > 0 else ''}{significant(math.degrees(size), 2)}°"
    return f"{'+' if size > 0 else ''}{significant(size, 2)}\u00a0{unit}"


def run_title(run: ClosedLoopRun) -> str:
    """Name a run: controller, scenario, speed, what was disturbed, on which truck."""
    where = scenario_name(run.scenario, run.scenario_run)
    speed = f"{fixed(3.6 * run.speed, 0)}\u00a0km/h"
    text = f"{controller_name(run.controller)}, {where} at {speed}, {disturbance_text(run)}"
    if run.simulation_model != run.prediction_model:
        text += f", simulated as {simulated_name(run.simulation_model)}"
    return text


LEVEL_UNITS = {
    "lateral_error": "m",
    "heading_error": "rad",
    "steering_request": "rad",
    "steering_angle": "rad",
}


def level_unit(signal: str) -> tuple[float, str]:
    """Give the factor and the unit in which a difference from a log is shown, "" where it has none."""
    known = SIGNALS.get(signal)
    unit = LEVEL_UNITS.get(signal) or (known.unit if known else "1")
    factor, shown = SHOWN_IN.get(unit, (1.0, unit_text(unit)))
    return factor, "" if unit == "1" else shown


def by_claim(claims: Sequence[Claim]) -> list[Claim]:
    """Put claims in the order in which they are told: decided ones first, each in its own order."""
    return sorted(claims, key=lambda one: one.holds == "undecided")


def levels_by_run(levels: Sequence[LoggedLevel]) -> dict[str, list[LoggedLevel]]:
    """Give the levels of each logged run, lowest first."""
    found: dict[str, list[LoggedLevel]] = {}
    for one in levels:
        found.setdefault(one.run, []).append(one)
    return {run: sorted(own, key=lambda one: one.level) for run, own in found.items()}


def reached_text(result: ValidateResult) -> str:
    """Say how far the comparison with logs came."""
    if result.reached is None:
        return "no run could be compared" if result.logged else "not compared"
    return f"level {result.reached}: {LEVELS[result.reached]}"


def verdict_badge(result: ValidateResult) -> tuple[str, Tone]:
    """Give the badge of the answer: whether the first of the ranking held its path from every start.

    It is a caution where the found effects cost its margin, or a mismatch that was tried its path. Until the
    whole loop agrees with a log it holds in simulation only.
    """
    if not result.ranking:
        return "nothing ranked", "caution"
    first = result.ranking[0]
    own = [cell for cell in result.cells if cell.controller == first]
    if any(lost_in(cell) for cell in own):
        return "path lost", "bad"
    if any(one.is_lost for one in result.margins if one.controller == first):
        return "margin lost", "caution"
    if any(None in curve.lateral_error_max for curve in result.mismatch if curve.controller == first):
        return "holds, within limits", "caution"
    return ("holds" if result.reached == WHOLE_LOOP else "holds in simulation"), "good"


def lost_share(completed: float) -> str:
    """Say which share of the runs lost the path, "" for none."""
    lost = 1.0 - completed
    if lost <= 0:
        return ""
    return "all lost" if completed <= 0 else f"{fixed(max(100 * lost, 1.0), 0)}\u00a0% lost"
