"""What many closed loops say: a table of scenarios and controllers, an order, and claims that are examined.

All controllers begin from the same disturbed starts, so they are compared pair by pair. Intervals are 95 %
intervals of a bootstrap over the starts; a controller is clearly better than another in a measure where the
interval of the median difference over the starts that both completed lies on its side of zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ident.glossary import controller_name
from ident.results import Cell, Claim, ClosedLoopRun, ControllerName, Estimate, ScenarioName, Score

Array = NDArray[np.float64]

MEASURES: dict[str, str] = {
    "lateral_error_rms": "m",
    "lateral_error_p95": "m",
    "lateral_error_max": "m",
    "lateral_error_settled": "m",
    "heading_error_rms": "rad",
    "arrival_time_error": "s",
    "braking_work": "J/kg",
    "acceleration_work": "J/kg",
    "drive_switches": "1",
    "lateral_acceleration_max": "m/s^2",
    "lateral_jerk_rms": "m/s^3",
    "steering_rate_rms": "rad/s",
    "steering_rate_max": "rad/s",
    "steering_reversals": "1/s",
}
TIMED = {"solve_time_p99": "s"}
TRACKING = ("lateral_error_rms", "lateral_error_max", "lateral_error_settled")
RANKED = (*TRACKING, "arrival_time_error", "braking_work", "lateral_jerk_rms", "steering_rate_rms")
RANKING = (
    "most runs completed within the lane first; then most scenarios and measures of tracking "
    f"({', '.join(TRACKING)}) in which no other is clearly better; then the same of all of "
    f"{', '.join(RANKED)}; then the least median of the largest lateral error"
).replace("_", " ")
DRAWS = 2000
FEWEST = 3  # starts for an interval
NEGLIGIBLE = 1e-9

SPATIAL: tuple[ControllerName, ...] = ("mpc_spatial", "mpc_spatial_rate")
CLAIMS: tuple[tuple[str, str], ...] = (
    ("turns smoothly: least lateral jerk", "lateral_jerk_rms"),
    ("steers smoothly: least steering rate", "steering_rate_rms"),
    ("brakes least", "braking_work"),
    ("accelerates least", "acceleration_work"),
    ("leaves no offset: least settled lateral error", "lateral_error_settled"),
    ("arrives on time: least error of the arrival time", "arrival_time_error"),
)


@dataclass(frozen=True)
class Compared:
    """The runs of all controllers over the same starts.

    values : measure -> controller -> (n,) one a start, NaN where the run was not completed
    """

    values: Mapping[str, Mapping[ControllerName, Array]]
    seed: int

    def difference(self, measure: str, one: ControllerName, other: ControllerName) -> Estimate:
        """Median of a measure of one controller less that of the other, over starts that both completed."""
        gap = self.values[measure][one] - self.values[measure][other]
        return _estimate(gap[np.isfinite(gap)], MEASURES[measure], self.seed)

    def is_better(self, measure: str, one: ControllerName, other: ControllerName) -> bool:
        """Whether one is clearly better, that is, less."""
        high = self.difference(measure, one, other).high
        return high is not None and high < -NEGLIGIBLE

    def completed(self, controller: ControllerName) -> int:
        """How many runs came to the end."""
        return int(np.isfinite(self.values["lateral_error_rms"][controller]).sum())


def compared(runs: Sequence[ClosedLoopRun], seed: int) -> Compared:
    """Put the runs of each controller side by side, start by start."""
    starts = list(dict.fromkeys(_start(run) for run in runs))
    found = {(run.controller, _start(run)): run for run in runs}
    values: dict[str, dict[ControllerName, Array]] = {}
    for measure in MEASURES:
        values[measure] = {
            name: np.array([_value(found.get((name, start)), measure) for start in starts])
            for name in dict.fromkeys(run.controller for run in runs)
        }
    return Compared(values, seed)


def _start(run: ClosedLoopRun) -> tuple[str, float, int | None]:
    return run.scenario, run.speed, run.seed


def cells(runs: Sequence[ClosedLoopRun], seed: int) -> list[Cell]:
    """One a controller and scenario, in the order of the runs."""
    made = []
    for scenario in dict.fromkeys(run.scenario for run in runs):
        own = [run for run in runs if run.scenario == scenario]
        side_by_side = compared(own, seed)
        made += [
            _cell(name, scenario, [run for run in own if run.controller == name], side_by_side)
            for name in dict.fromkeys(run.controller for run in own)
        ]
    return made


def ranking(table: Sequence[Cell]) -> list[ControllerName]:
    """Controllers, the best first, by ``RANKING``."""
    names = list(dict.fromkeys(cell.controller for cell in table))

    def order(name: ControllerName) -> tuple[float, float, float, float]:
        own = [cell for cell in table if cell.controller == name]
        best = [sum(len(set(cell.best_in) & set(of)) for cell in own) for of in (TRACKING, RANKED)]
        worst = [score.value for cell in own for score in cell.scores if score.measure == "lateral_error_max"]
        completed = sum(cell.completed for cell in own)
        return -completed, -best[0], -best[1], float(np.median(worst)) if worst else np.inf

    return sorted(names, key=order)


def claims(runs: Sequence[ClosedLoopRun], seed: int) -> list[Claim]:
    """The source's claims on the spatial-error MPC against every other controller, over all scenarios."""
    side_by_side = compared(runs, seed)
    names = list(side_by_side.values["lateral_error_rms"])
    own = next((name for name in SPATIAL if name in names), None)
    others = [name for name in names if name not in SPATIAL]
    if own is None or not others:
        return []
    made = [
        _claim(f"{controller_name(own)} {text}", measure, own, others, side_by_side)
        for text, measure in CLAIMS
    ]
    return [*made, _lqr(side_by_side, own)] if "lqr" in names else made


def _value(run: ClosedLoopRun | None, measure: str) -> float:
    """Size of a measure, not a number where there is none."""
    value = None if run is None or not run.completed else getattr(run, measure)
    return float("nan") if value is None else abs(float(value))


def _cell(
    name: ControllerName, scenario: ScenarioName, runs: Sequence[ClosedLoopRun], side: Compared
) -> Cell:
    scores = [
        _score(measure, unit, side.values[measure][name], side.seed) for measure, unit in MEASURES.items()
    ]
    timed = {"solve_time_p99": np.array([run.solve_time_p99 for run in runs])}
    scores += [_score(measure, unit, timed[measure], side.seed) for measure, unit in TIMED.items()]
    return Cell(
        controller=name,
        scenario=scenario,
        runs=len(runs),
        completed=side.completed(name),
        scores=[score for score in scores if score is not None],
        best_in=_best_in(name, side),
    )


def _best_in(name: ControllerName, side: Compared) -> list[str]:
    """Measures in which no other controller is clearly better, where none completed more runs."""
    names = list(side.values["lateral_error_rms"])
    most = max(side.completed(other) for other in names)
    if side.completed(name) < most or most == 0:
        return []
    rivals = [other for other in names if other != name and side.completed(other) == most]
    return [
        measure for measure in MEASURES if not any(side.is_better(measure, other, name) for other in rivals)
    ]


def _score(measure: str, unit: str, values: Array, seed: int) -> Score | None:
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    low, high = _interval(known, seed)
    return Score(measure, float(np.median(known)), low, high, unit)


def _interval(values: Array, seed: int) -> tuple[float, float] | tuple[None, None]:
    if values.size < FEWEST:
        return None, None
    drawn = np.random.default_rng(seed).integers(values.size, size=(DRAWS, values.size))
    low, high = np.quantile(np.median(values[drawn], axis=1), [0.025, 0.975])
    return float(low), float(high)


def _estimate(values: Array, unit: str, seed: int) -> Estimate:
    if not values.size:
        return Estimate(None, None, None, None, unit, "not_identifiable", "no start that both completed")
    low, high = _interval(values, seed)
    drawn = np.random.default_rng(seed).integers(values.size, size=(DRAWS, values.size))
    std = float(np.std(np.median(values[drawn], axis=1))) if values.size >= FEWEST else None
    return Estimate(float(np.median(values)), std, low, high, unit)


def _claim(
    text: str, measure: str, own: ControllerName, others: Sequence[ControllerName], side: Compared
) -> Claim:
    gaps = [side.difference(measure, own, other) for other in others]
    less = [name for name, gap in zip(others, gaps, strict=True) if gap.high is not None and gap.high < 0]
    more = [name for name, gap in zip(others, gaps, strict=True) if gap.low is not None and gap.low > 0]
    return Claim(
        text,
        _holds(less, more, others),
        _evidence(measure, less, more, others),
        gaps,
        [measure] * len(gaps),
        list(others),
    )


def _holds(
    less: Sequence[str], more: Sequence[str], others: Sequence[str]
) -> Literal["yes", "no", "in part", "undecided"]:
    if len(less) == len(others):
        return "yes"
    if less:
        return "in part"
    return "no" if more else "undecided"


def _evidence(measure: str, less: Sequence[str], more: Sequence[str], others: Sequence[str]) -> str:
    rest = [name for name in others if name not in less and name not in more]
    parts = [
        f"{word} {', '.join(map(controller_name, names))}"
        for word, names in (("less than", less), ("more than", more), ("not told from", rest))
        if names
    ]
    return f"{measure.replace('_', ' ')}: {'; '.join(parts)}"


def _lqr(side: Compared, own: ControllerName) -> Claim:
    """Where LQR with feed-forward is better than the spatial-error MPC."""
    wins = [measure for measure in RANKED if side.is_better(measure, "lqr", own)]
    loses = [measure for measure in RANKED if side.is_better(measure, own, "lqr")]
    parts = [
        f"{word} in {', '.join(name.replace('_', ' ') for name in names)}"
        for word, names in (("clearly better", wins), ("clearly worse", loses))
        if names
    ]
    holds: Literal["yes", "no", "in part", "undecided"] = (
        "in part" if wins and loses else "yes" if wins else "no" if loses else "undecided"
    )
    evidence = "; ".join(parts) or "no measure tells the two apart"
    gaps = [side.difference(measure, "lqr", own) for measure in RANKED]
    text = f"{controller_name('lqr')} does better than {controller_name(own)}"
    return Claim(text, holds, evidence, gaps, list(RANKED), [own] * len(gaps))
