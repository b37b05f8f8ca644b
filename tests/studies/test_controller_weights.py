"""What the gains of the controllers are chosen by."""

from __future__ import annotations

from types import SimpleNamespace

import controller_weights as study
import numpy as np
import pytest

from ident.control.controllers.weights import ACCEPTABLE, WEIGHTS, weights_of


def loop(completed=True, wheels=0.0, error=0.0):
    times = np.array([0.0, 0.1, 0.3])
    road = SimpleNamespace(arc_length=np.array([0.0, 10.0]), road_wheel_angle=np.zeros(2))
    return SimpleNamespace(
        completed=completed,
        times=times,
        states={"road_wheel_angle": np.full(3, wheels)},
        arc_length=np.array([0.0, 1.0, 3.0]),
        reference=road,
        lateral_error=np.full(3, error),
        heading_error=np.zeros(3),
    )


def test_an_acceptable_deviation_costs_one():
    assert study.cost(loop()) == 0.0
    assert study.cost(loop(error=ACCEPTABLE["lateral_error"])) == pytest.approx(1.0)
    both = loop(error=-ACCEPTABLE["lateral_error"], wheels=ACCEPTABLE["steering_request"])
    assert study.cost(both) == pytest.approx(2.0)


def test_a_lost_path_costs_more_than_any_that_was_kept():
    assert study.cost(loop(completed=False)) == study.LOST


def test_the_tuning_path_is_not_that_of_the_validation():
    path = study.path_of(2.0, 15.0)
    assert path.position_y[-1] == pytest.approx(2.0, abs=1e-6)
    assert np.abs(path.curvature).max() * 15.0**2 == pytest.approx(1.5, rel=0.02)


def test_the_first_candidate_is_what_is_in_use_and_the_rest_are_seeded():
    first = study.candidates("stanley", 3, seed=1)
    assert first[0] == weights_of("stanley") == dict(WEIGHTS["stanley"])
    assert first == study.candidates("stanley", 3, seed=1)
    assert first[1]["softening_speed"] == first[0]["softening_speed"]
    assert first[1]["error_gain"] != first[0]["error_gain"]
