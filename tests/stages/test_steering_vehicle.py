"""Logs of several vehicles: the steering is that of one of them, the others are left out with a reason."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from steering_logs import TRUTH, answer, near_truth, pulse_test, sine_test, values, write

from ident.errors import NotIdentifiable
from ident.results import SteeringResult
from ident.stages.inputs import InputSettings
from ident.stages.output import Context
from ident.stages.steering import SteeringSettings, steering
from ident.stages.steering_vehicle import NO_FILE, OTHER_FILE

SLOW = replace(TRUTH, gain=0.7, time_constant_1=0.6)
RESTING = ("resting", "waiting", "parked")
AXLES = "cg_to_front_axle: 2.4 m\ncg_to_rear_axle: 2.1 m\n"


def run(*logs: Path) -> SteeringResult:
    context = Context(command="test", date="2026-01-01T00:00:00Z")
    return steering(list(logs), InputSettings(), SteeringSettings(), context).result


def vehicle(folder: Path, ratio: float) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vehicle.yaml").write_text(f"steering_ratio: {ratio}\n{AXLES}", encoding="utf-8")


@pytest.fixture
def two_trucks(tmp_path: Path) -> Path:
    """Two runs of one truck; of another, above it in the alphabet, one that can be used and three at rest."""
    write(tmp_path / "b" / "one.mcap", pulse_test(1), answer(pulse_test(1)))
    write(tmp_path / "b" / "two.mcap", sine_test(2), answer(sine_test(2), seed=2))
    write(tmp_path / "a" / "slow.mcap", pulse_test(3), answer(pulse_test(3), SLOW))
    rest = pulse_test(4)
    rest.command_values[:] = 0.0
    for number, name in enumerate(RESTING):
        write(tmp_path / "a" / f"{name}.mcap", rest, answer(rest, SLOW, seed=number))
    vehicle(tmp_path / "a", 25.0)
    vehicle(tmp_path / "b", 18.0)
    return tmp_path


def test_the_vehicle_that_most_usable_runs_are_of_is_identified(two_trucks: Path) -> None:
    result = run(two_trucks)
    near_truth(result)
    assert result.adequate
    assert {one.run for one in result.by_run} == {"b/one", "b/two"}
    assert {one.run for one in result.experiments} == {"b/one", "b/two"}
    left_out = {one.what: one.reason for one in result.refused}
    assert left_out == dict.fromkeys((*(f"a/{name}" for name in RESTING), "a/slow"), OTHER_FILE)


def test_every_number_is_that_of_the_one_vehicle_alone(two_trucks: Path) -> None:
    together, alone = run(two_trucks), run(two_trucks / "b")
    assert together.ratio_source == "vehicle file"
    assert together.ratio == alone.ratio == [[-18.0, -1.0], [18.0, 1.0]]
    np.testing.assert_array_equal(values(together), values(alone))
    assert together.noise == alone.noise
    assert [one.name for one in together.runs] == ["b/one", "b/two"]


def test_the_provenance_says_which_vehicle_file_applied_to_the_runs_that_were_left_out(
    two_trucks: Path,
) -> None:
    made_from = run(two_trucks).provenance
    assert made_from.applied["a/slow"].endswith("vehicle: a/vehicle.yaml")
    assert made_from.applied["b/one"].endswith("vehicle: b/vehicle.yaml")
    assert len(made_from.files) == 6


def test_equal_vehicle_files_are_of_one_vehicle(two_trucks: Path) -> None:
    shutil.copy(two_trucks / "b" / "vehicle.yaml", two_trucks / "a" / "vehicle.yaml")
    result = run(two_trucks)
    assert {one.run for one in result.by_run} == {"a/slow", "b/one", "b/two"}
    assert not result.adequate


def test_without_any_vehicle_file_all_runs_are_of_one_vehicle(two_trucks: Path) -> None:
    for folder in "ab":
        (two_trucks / folder / "vehicle.yaml").unlink()
    assert {one.run for one in run(two_trucks).by_run} == {"a/slow", "b/one", "b/two"}


def test_a_run_without_a_vehicle_file_is_not_taken_for_one_of_a_known_vehicle(two_trucks: Path) -> None:
    (two_trucks / "a" / "vehicle.yaml").unlink()
    result = run(two_trucks)
    near_truth(result)
    assert {one.reason for one in result.refused} == {NO_FILE}


def test_where_no_run_of_any_vehicle_can_be_used_the_reasons_of_all_are_told(two_trucks: Path) -> None:
    for name in ("a/slow", "b/one", "b/two"):
        (two_trucks / f"{name}.mcap").unlink()
    write(two_trucks / "b" / "still.mcap", pulse_test(1), np.full(pulse_test(1).times.size, 0.3))
    with pytest.raises(NotIdentifiable, match=r"the measured angle stays .* the request is constant"):
        run(two_trucks)


def test_the_result_of_several_vehicles_is_plain_json(two_trucks: Path) -> None:
    assert json.dumps(asdict(run(two_trucks)), allow_nan=False)
