from dataclasses import replace

import evaluate_case as evaluation
import numpy as np
import pandas as pd
import pytest

from ident.report import evaluate_signals, evaluated
from ident.results import Error

LIMIT = Error(0.1, None, None, "rad/s")


@pytest.mark.parametrize(
    ("error", "limit", "expected"),
    [
        (Error(0.08, 0.07, 0.09, "rad/s"), LIMIT, "within"),
        (Error(0.08, 0.07, 0.1, "rad/s"), LIMIT, "within"),
        (Error(0.08, 0.07, 0.11, "rad/s"), LIMIT, "near"),
        (Error(0.12, 0.09, 0.15, "rad/s"), LIMIT, "near"),
        (Error(0.12, 0.11, 0.13, "rad/s"), LIMIT, "beyond"),
        (Error(0.12, None, None, "rad/s"), LIMIT, "beyond"),
        (Error(0.08, None, None, "rad/s"), LIMIT, "within"),
        (Error(0.08, 0.07, 0.09, "rad/s"), None, "unknown"),
        (None, LIMIT, "unknown"),
    ],
)
def test_an_error_is_judged_by_its_interval(error, limit, expected):
    assert evaluated.judge(error, limit) == expected


def test_the_worse_coordinate_judges_the_position():
    limits = {"position_x": LIMIT, "position_y": LIMIT}
    errors = {"position_x": Error(0.01, None, None, "m"), "position_y": Error(0.2, None, None, "m")}
    assert evaluated.judge_position(errors, limits) == "beyond"
    assert evaluated.judge_position({"position_x": errors["position_x"]}, limits) == "within"
    assert evaluated.judge_position({}, limits) == "unknown"
    assert evaluated.position_error(errors) == pytest.approx(np.hypot(0.01, 0.2))
    assert evaluated.position_error({}) is None


def test_the_signal_furthest_from_acceptable_is_found(evaluate_case):
    model = evaluate_case[0].models[0]
    errors = {"yaw_rate": Error(0.008, None, None, "rad/s"), "heading": Error(0.006, None, None, "rad")}
    worst = evaluated.over_acceptable(evaluate_case[0], replace(model, windows={"2 s": errors}))
    assert worst == ("yaw_rate", pytest.approx(2.0))
    assert evaluated.over_acceptable(replace(evaluate_case[0], acceptable={}), model) is None


def test_the_chosen_model_is_shown_on_measured_steering_else_the_most_accurate(evaluate_case):
    result = evaluate_case[0]
    shown = evaluated.shown_model(result)
    assert (shown.name, shown.input) == ("brush", "measured")
    assert evaluated.shown_model(replace(result, chosen=None)).name == "magic_formula"
    assert evaluated.shown_model(replace(result, models=[], chosen=None)) is None


def test_every_model_has_a_colour_of_its_own(evaluate_case):
    roles = evaluated.roles(evaluate_case[0])
    assert set(roles) == set(evaluation.MODELS)
    assert len(set(roles.values())) == len(evaluation.MODELS)
    assert roles["brush"] == "modelled"


def test_runs_are_ranked_by_the_errors_of_the_shown_model(evaluate_case):
    result = evaluate_case[0]
    brush = evaluated.shown_model(result)
    runs = [
        replace(run, rms={"yaw_rate": rms}) for run, rms in zip(brush.by_run, (0.03, 0.01, 0.02), strict=True)
    ]
    others = [model for model in result.models if model.name != "brush"]
    changed = replace(result, models=[*others, replace(brush, by_run=runs)])
    first, second, third = evaluation.RUNS
    assert evaluated.by_agreement(changed, ["new", *evaluation.RUNS]) == [second, third, first, "new"]


def test_windows_are_sorted_by_their_length():
    assert sorted(["10 s", "2 s", "odd", "1.5 s"], key=evaluated.window_seconds) == [
        *("1.5 s", "2 s", "10 s", "odd")
    ]


def test_a_position_is_drawn_from_where_the_run_begins_and_its_residual_is_not():
    rows = pd.DataFrame(
        {"time": [0.0, 0.1, 0.2], "position_x": [np.nan, 5e5, 5e5 + 1], "position_x__linear": 5e5 + 2.0}
    )
    assert evaluate_signals.measured(rows, "position_x").value.tolist() == [0.0, 1.0]
    assert evaluate_signals.simulated(rows, "position_x", "linear").value.tolist() == [2.0, 2.0, 2.0]
    assert evaluate_signals.residual(rows, "position_x", "linear").value.tolist() == [-2.0, -1.0]


def test_what_a_model_is_driven_by_compares_nothing():
    rows = pd.DataFrame({"time": [0.0, 0.1], "road_wheel_angle": [0.1, 0.2]})
    rows = rows.assign(road_wheel_angle__linear=rows["road_wheel_angle"], yaw_rate=1.0, yaw_rate__linear=1.1)
    assert evaluate_signals.simulated_by(rows) == ["linear"]
    assert evaluate_signals.measured_signals(rows, ["linear"]) == ["yaw_rate"]


def test_columns_that_are_none_of_ours_are_no_models():
    rows = pd.DataFrame(
        {"time": [0.0], "yaw_rate__<b>": [1.0], "odd__linear": [1.0], "heading__brush": [np.nan]}
    )
    assert evaluate_signals.simulated_by(rows) == []
