"""The table of controllers: what is best, who comes first, which claims hold, on known numbers."""

from __future__ import annotations

import numpy as np
import pytest

from ident.results import ClosedLoopRun, ControllerName
from ident.stages.validate_cells import cells, claims, compared, ranking

STARTS = 8
PLAIN = dict.fromkeys(ClosedLoopRun.__dataclass_fields__, 0.0)


def runs_of(
    name: ControllerName, *, lost: int = 0, worse: float = 0.0, **measures: float
) -> list[ClosedLoopRun]:
    """One a start; starts differ far more than controllers do. ``worse`` is added to the lateral errors."""
    size = 1.0 + np.arange(STARTS)
    made = []
    for seed in range(STARTS):
        errors = {
            f"lateral_error_{kind}": float(size[seed] + worse) for kind in ("rms", "p95", "max", "settled")
        }
        known = {**PLAIN, **errors, **{key: size[seed] + value for key, value in measures.items()}}
        named = {"controller": name, "scenario": "single_lane_change", "speed": 20.0, "seed": seed}
        made.append(
            ClosedLoopRun(
                **{**known, **named, "completed": seed >= lost, "disturbance": {}, "scenario_run": None}
            )
        )
    return made


def test_pairs_tell_what_means_cannot() -> None:
    side = compared([*runs_of("lqr"), *runs_of("pid", worse=0.1)], seed=1)
    gap = side.difference("lateral_error_rms", "pid", "lqr")
    assert gap.value is not None
    assert np.isclose(gap.value, 0.1)  # the spread of the starts is 20 times that
    assert side.is_better("lateral_error_rms", "lqr", "pid")
    assert not side.is_better("braking_work", "lqr", "pid")


def test_completed_runs_come_first_then_tracking() -> None:
    smooth = runs_of("pure_pursuit", worse=0.2, lateral_jerk_rms=-0.5, steering_rate_rms=-0.5)
    close = runs_of("lqr", lateral_jerk_rms=0.5, steering_rate_rms=0.5)
    closest = runs_of("pid", lost=1, worse=-0.5)
    table = cells([*smooth, *close, *closest], seed=1)
    assert ranking(table) == ["lqr", "pure_pursuit", "pid"]
    best = {cell.controller: set(cell.best_in) for cell in table}
    assert best["pid"] == set()  # who loses the path is best in nothing
    assert "lateral_error_rms" in best["lqr"] - best["pure_pursuit"]
    assert "lateral_jerk_rms" in best["pure_pursuit"] - best["lqr"]


def test_a_claim_holds_against_all_or_in_part_or_not() -> None:
    spatial = runs_of("mpc_spatial", lateral_jerk_rms=0.0, steering_rate_rms=0.2, braking_work=0.5)
    first = runs_of("lqr", lateral_jerk_rms=0.3, steering_rate_rms=0.1, braking_work=0.1)
    second = runs_of("pid", lateral_jerk_rms=0.2, steering_rate_rms=0.4, braking_work=0.1)
    found = {
        one.claim.partition("spatial MPC ")[2]: one for one in claims([*spatial, *first, *second], seed=1)
    }
    smooth = found["turns smoothly: least lateral jerk"]
    assert (smooth.holds, smooth.against) == ("yes", ["lqr", "pid"])
    assert smooth.measures == ["lateral_jerk_rms"] * 2
    assert [round(one.value or 0.0, 9) for one in smooth.difference] == [-0.3, -0.2]
    assert found["steers smoothly: least steering rate"].holds == "in part"
    assert found["brakes least"].holds == "no"
    assert found["leaves no offset: least settled lateral error"].holds == "undecided"


def test_where_lqr_does_better_it_is_said() -> None:
    made = claims([*runs_of("mpc_spatial", braking_work=0.5), *runs_of("lqr", lateral_jerk_rms=0.4)], seed=1)
    assert made[-1].claim == "LQR with feed-forward does better than spatial MPC"
    assert made[-1].holds == "in part"
    assert made[-1].evidence == "clearly better in braking work; clearly worse in lateral jerk rms"
    told = dict(zip(made[-1].measures, made[-1].difference, strict=True))
    assert told["braking_work"].value == pytest.approx(-5.0)  # of nothing less that of the median start
