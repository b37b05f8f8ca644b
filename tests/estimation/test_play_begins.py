"""A fit of a play ends at one minimum, wherever in the play its runs are taken to begin at first."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from generator.injected_actuator import play
from motion_case import TRUCK, TRUE, coloured, layer_of
from plane_truck import inputs

from ident.estimation.gauss_newton import minimise
from ident.estimation.motion_starts import anew
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_records import MotionRecord

WIDTH = 0.006  # [rad]
REST = 0.05  # of a run
NEAR_AN_END = 2.85  # of which the hyperbolic tangent is 0.993


def loose(run: int, rest: float) -> MotionRecord:
    """A truck whose road wheels follow with a play, within which the angle stays at first."""
    angle, speed = inputs(20.0, seed=run)
    angle[: round(rest * angle.size)] *= 0.25 * WIDTH / np.abs(angle).max()
    return replace(TRUCK.drive(play(angle, WIDTH), speed, run=run, seed=run), road_wheel_angle=angle)


@cache
def minimum(rest: float) -> VehiclePoint:
    """Fitted from the middle of the play."""
    problem = layer_of([loose(run, rest) for run in range(2)]).problem(("steering_linkage_play",))
    values = {**TRUE, "linkage_play": 0.8 * WIDTH}
    shared = np.array([one.coordinate(values[one.name]) for one in problem.coordinates])
    of_runs = np.zeros((problem.windows.runs, len(problem.run_terms)))
    return followed(VehiclePoint(problem, shared, of_runs, problem.initial_local, coloured(problem)))


def followed(point: VehiclePoint) -> VehiclePoint:
    return minimise(point, 30, negligible=1e-3)[0]


def prior_of(point: VehiclePoint) -> float:
    return float(np.square((point.shared - point.problem.prior_mean) / point.problem.prior_std).sum())


@pytest.mark.parametrize("rest", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("end", [-NEAR_AN_END, NEAR_AN_END])
def test_a_run_that_is_taken_to_begin_at_an_end_of_its_play_finds_back(rest: float, end: float) -> None:
    found = minimum(rest)
    of_runs = found.of_runs.copy()
    of_runs[0, found.problem.begins] = end
    again = anew(followed(replace(found, of_runs=of_runs)))
    assert again.value < found.value + 1.0, "of 2 log likelihood"


def test_from_no_place_in_a_play_does_a_step_make_things_worse() -> None:
    found = minimum(REST)
    for end in np.linspace(-4.0, 4.0, 9):
        of_runs = found.of_runs.copy()
        of_runs[0, found.problem.begins] = end
        point = replace(found, of_runs=of_runs)
        moved = point.moved(np.zeros(found.shared.size))
        assert moved.value <= point.value * (1 + 1e-9)
        assert moved.value == pytest.approx(moved.run_sums.sum() + prior_of(moved), rel=1e-9)
