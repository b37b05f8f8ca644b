"""The stage of validation: end to end on a model file, what it refuses, and that nothing but time differs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from validate_case import MODEL, write_model

from ident.errors import NotIdentifiable, UsageError
from ident.glossary import controller_name
from ident.pipeline.store import result_text
from ident.results import ValidateResult
from ident.stages.inputs import InputSettings
from ident.stages.output import Context, StageOutput
from ident.stages.validate import validate
from ident.stages.validate_settings import ValidateSettings

SCHEMA = Path(__file__).parents[2] / "docs" / "schema" / "validate.schema.json"
TIMED = {"solve_time_p50", "solve_time_p95", "solve_time_p99", "deadline_misses", "cost_ns_per_step"}
SMALL: dict[str, Any] = {
    "controllers": ["lqr", "stanley"],
    "scenarios": ["single_lane_change"],
    "speeds": ["15 m/s"],
    "starts": 3,
    "mismatch": {"dead_time": ["0.6 s"]},
    "pairs": [],
}


def go(model: Path, **said: Any) -> StageOutput[ValidateResult]:
    settings = ValidateSettings(**{**SMALL, "model": model, **said})
    return validate([], InputSettings(seed=3), settings, Context("c", "d", seed=3))


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> StageOutput[ValidateResult]:
    return go(write_model(tmp_path_factory.mktemp("validate")))


def untimed(value: Any) -> Any:
    """Without what takes another time in every run."""
    if isinstance(value, dict):
        if value.get("measure") in TIMED:
            return None
        return {key: untimed(inner) for key, inner in value.items() if key not in TIMED}
    return [untimed(one) for one in value] if isinstance(value, list) else value


def test_every_controller_drives_every_start_and_is_ranked(answered: StageOutput[ValidateResult]) -> None:
    result = answered.result
    assert [(run.controller, run.seed) for run in result.runs] == [
        (name, seed) for name in ("lqr", "stanley") for seed in (3, 4, 5)
    ]
    assert {run.prediction_model for run in result.runs} == {"linear"}
    assert [(cell.controller, cell.runs, cell.completed) for cell in result.cells] == [
        ("lqr", 3, 3),
        ("stanley", 3, 3),
    ]
    assert sorted(result.ranking) == ["lqr", "stanley"]
    assert result.verdict.startswith(
        f"{controller_name(result.ranking[0])} holds 3 of 3 disturbed starts at 54 km/h"
    )
    assert (result.reached, result.logged, result.pairs, result.margins) == (None, [], [], [])


def test_controllers_begin_from_the_same_starts(answered: StageOutput[ValidateResult]) -> None:
    starts = {
        name: [run.disturbance for run in answered.result.runs if run.controller == name]
        for name in ("lqr", "stanley")
    }
    assert starts["lqr"] == starts["stanley"]
    assert len({one["lateral_error"] for one in starts["lqr"]}) == 3


def test_a_curve_holds_the_run_without_mismatch(answered: StageOutput[ValidateResult]) -> None:
    curves = {one.controller: one for one in answered.result.mismatch}
    assert set(curves) == {"lqr", "stanley"}
    for curve in curves.values():
        assert (curve.what, curve.unit, curve.sizes) == ("dead_time", "s", [0.0, 0.6])
        without, late = curve.lateral_error_max
        assert without is not None
        assert without < 0.3
        assert late is None or late > 2 * without


def test_the_tables_hold_the_opened_runs(answered: StageOutput[ValidateResult]) -> None:
    result, table = answered.result, answered.tables["validate"]
    assert result.worst is not None
    assert result.worst in set(table["run"])
    opened = {int(number) for number in table["run"].unique()}
    assert {result.runs[number].seed for number in opened} == {result.runs[result.worst].seed}
    own = table[table["run"] == result.worst]
    assert own["time"].diff().dropna().round(9).eq(result.period).all()
    run = result.runs[result.worst]
    assert own["lateral_error"].abs().max() <= run.lateral_error_max + 1e-9
    assert own["lateral_error"].iloc[0] == pytest.approx(run.disturbance["lateral_error"], abs=1e-6)
    path = answered.tables["validate_reference"]
    assert np.all(np.diff(path["arc_length"]) > 0)
    assert path["y"].iloc[-1] == pytest.approx(3.5, abs=1e-6)


def test_the_result_keeps_its_schema(answered: StageOutput[ValidateResult]) -> None:
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    jsonschema.validate(json.loads(result_text(answered.result)), schema)


def test_two_runs_differ_in_time_alone(answered: StageOutput[ValidateResult], tmp_path: Path) -> None:
    again = go(write_model(tmp_path))
    first, second = (untimed(json.loads(result_text(one.result))) for one in (answered, again))
    assert first == second
    pairs = zip(answered.tables.items(), again.tables.items(), strict=True)
    for (name, table), (other, repeated) in pairs:
        assert name == other
        assert table.drop(columns="solve_time", errors="ignore").equals(
            repeated.drop(columns="solve_time", errors="ignore")
        )


def test_another_seed_starts_elsewhere(answered: StageOutput[ValidateResult], tmp_path: Path) -> None:
    settings = ValidateSettings(**{**SMALL, "model": write_model(tmp_path), "quick": True})
    other = validate([], InputSettings(seed=8), settings, Context("c", "d", seed=8)).result
    assert other.runs[0].disturbance != answered.result.runs[0].disturbance
    assert (len(other.runs), other.mismatch) == (4, [])  # a first look: two starts, no sweep


def test_found_effects_are_in_the_simulated_truck_alone(tmp_path: Path) -> None:
    play = (
        "effects: [{name: steering_column_play, enters: A, parameters: "
        "{width: {value: 0.6, std: 0.01, unit: rad}}}]\n"
    )
    model = write_model(tmp_path, more=play, improved=True)
    result = go(model, controllers=["lqr"], mismatch={}, starts=2).result
    (margin,) = result.margins
    assert margin.effects == ["steering_column_play"]
    start = max(abs(run.disturbance["lateral_error"]) for run in result.runs)
    assert margin.lateral_error_max_without < margin.lateral_error_max_with < 0.8 * start
    assert {run.simulation_model for run in result.runs} == {"linear"}


def test_a_kinematic_prediction_is_told_and_each_controller_with_its_weights(tmp_path: Path) -> None:
    names = ["lqr", "mpc_time_kinematic"]
    result = go(write_model(tmp_path), controllers=names, mismatch={}, starts=1).result
    told = {run.controller: (run.prediction_model, run.simulation_model) for run in result.runs}
    assert told == {"lqr": ("linear", "linear"), "mpc_time_kinematic": ("kinematic", "linear")}
    assert "steering_request" in result.weights["lqr"]
    assert "steering_request" not in result.weights["mpc_time_kinematic"]


@pytest.mark.parametrize(
    ("std", "said"),
    [
        (0.0002, None),
        (0.0015, "the set about its plan reaches"),
        (0.05, "has a set of usual size, not that of the residuals: at 22.0 m/s the tube takes"),
    ],
)
def test_the_set_of_the_robust_controller_comes_from_the_residuals(
    std: float, said: str | None, tmp_path: Path
) -> None:
    sizes = {"yaw_rate": std, "heading": std, "lateral_velocity": 10 * std, "position_across": 10 * std}
    noise = "".join(f"  {name}: {{std: {size}}}\n" for name, size in sizes.items())
    model = write_model(tmp_path, more=f"noise:\n{noise}")
    result = go(model, controllers=["mpc_robust"], mismatch={}, starts=1).result
    told = [text for text in result.warnings if text.startswith("robust MPC (tube)")]
    assert len(told) == (said is not None)
    assert all(said in text for text in told if said is not None)


def test_models_drive_each_other(tmp_path: Path) -> None:
    result = go(write_model(tmp_path), controllers=["lqr"], mismatch={}, starts=1, pairs=["lqr"]).result
    found = {(one.prediction_model, one.simulation_model): one for one in result.pairs}
    assert set(found) == {(a, b) for a in ("kinematic", "linear") for b in ("kinematic", "linear")}
    assert all(one.cost_ns_per_step is not None and one.cost_ns_per_step > 0 for one in result.pairs)
    own, wrong = found["linear", "linear"], found["kinematic", "linear"]
    assert own.completed == 1.0
    assert wrong.lateral_error_rms != own.lateral_error_rms


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("  ratio: [[-20.5, -1.0], [20.5, 1.0]]\n", "", "no steering.ratio"),
        ("value: 52000.0", "value: null", "vehicle.yaw_inertia has no value"),
        ("value: 310000.0", "value: null", "tyres.front.cornering_stiffness has no value"),
        (
            "time_constant_1: {value: 0.262",
            "time_constant_1: {value: null",
            "steering.time_constant_1 has no",
        ),
    ],
)
def test_a_model_without_a_part_is_refused_in_one_line(
    before: str, after: str, said: str, tmp_path: Path
) -> None:
    assert before in MODEL
    with pytest.raises(NotIdentifiable, match=said) as refused:
        go(write_model(tmp_path, MODEL.replace(before, after)))
    assert "\n" not in str(refused.value)


def test_a_model_without_steering_says_what_to_run(tmp_path: Path) -> None:
    head, _, rest = MODEL.partition("steering:\n")
    text = head + "tyres:" + rest.partition("tyres:")[2]
    with pytest.raises(NotIdentifiable, match="holds no steering actuator: run `ident steering`"):
        go(write_model(tmp_path, text))


def test_refuses_neither_logs_nor_model() -> None:
    with pytest.raises(UsageError, match="name logs, or a model"):
        validate([], InputSettings(), ValidateSettings(), Context("c", "d"))


def test_a_speed_beyond_the_data_is_a_guess(tmp_path: Path) -> None:
    slow = MODEL.replace("speed: [3.0, 25.0]", "speed: [3.0, 9.0]")
    result = go(write_model(tmp_path, slow), controllers=["lqr"], mismatch={}, starts=1).result
    assert result.next_step is not None
    assert result.next_step.startswith("drive and identify at 54 km/h")
    assert any("identified up to 9.0 m/s" in one for one in result.warnings)


def test_what_no_controller_can_drive_is_told(tmp_path: Path) -> None:
    mismatch = {"dead_time": ["-0.2 s", "0.05 s"], "friction": 0.5}
    result = go(write_model(tmp_path), controllers=["lqr"], mismatch=mismatch, starts=1).result
    assert [(one.what, one.sizes) for one in result.mismatch] == [("dead_time", [0.0, 0.05])]
    assert any("dead time" in one.reason for one in result.refused)
    assert any("no largest force" in one.reason for one in result.refused)
    assert replace(result, refused=[]).verdict == result.verdict
