"""`ident run` as a user calls it, on runs of the sample logs: what it leaves, skips, requires and refuses."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner, Result
from generator.truth import load_truth

from ident.cli import main

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_logs"
STAGES = ("info", "steering", "tyres", "evaluate", "improve", "validate")
RECIPE = """\
runs: ["planar_*", "steering_*"]
split: {held_out: [planar_c]}
tyres: {kinds: [linear]}
evaluate: {models: [kinematic, linear], require: {yaw_rate: LIMIT}}
improve: {runs: ["steering_*"], draws: 199}
validate: {quick: true, controllers: [lqr], scenarios: [single_lane_change], speeds: [40 km/h]}
"""


def call(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments), prog_name="ident")


def states(ended: Result) -> dict[str, str]:
    return {step["stage"]: step["state"] for step in json.loads(ended.stdout)["stages"]}


def read(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of three runs that turn, one of the steering and one of another truck, with recipes.

    One recipe asks for little and one for much; the other truck is in neither.
    """
    folder = tmp_path_factory.mktemp("run")
    for run in ("planar/planar_a", "planar/planar_b", "planar/planar_c", "steering_pulses_a"):
        shutil.copytree(SAMPLES / run, folder / "logs" / Path(run).name)
    for name in ("channels.yaml", "vehicle.yaml"):
        shutil.copy(SAMPLES / name, folder / "logs")
    shutil.copytree(SAMPLES / "undeclared" / "set_w9" / "run_01", folder / "logs" / "other" / "run_01")
    shutil.copy(SAMPLES / "undeclared" / "set_w9" / "vehicle.yaml", folder / "logs" / "other")
    for name, limit in (("recipe", "0.05 rad/s"), ("strict", "1e-6 rad/s")):
        (folder / f"{name}.yaml").write_text(RECIPE.replace("LIMIT", limit), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def first(place: Path) -> Result:
    """What `ident run RECIPE LOGS --out OUT` gave."""
    return call("run", str(place / "recipe.yaml"), str(place / "logs"), "--out", str(place / "out"), "--json")


def test_every_stage_answers_and_keeps_its_contract(first: Result, place: Path) -> None:
    assert first.exit_code == 0, first.output
    assert states(first) == dict.fromkeys(STAGES, "done")
    for stage in states(first):
        schema = read(ROOT / "docs" / "schema" / f"{stage}.schema.json")
        jsonschema.Draft202012Validator(schema).validate(read(place / "out" / f"{stage}.json"))
    html = (place / "out" / "index.html").read_text(encoding="utf-8")
    for page in states(first):
        assert f'href="#{page}"' in html


def test_the_other_truck_is_not_read_and_the_report_says_which_runs_were(first: Result, place: Path) -> None:
    named = ["planar_a", "planar_b", "planar_c", "steering_pulses_a"]
    for stage in states(first):
        result = read(place / "out" / f"{stage}.json")
        assert list(result["provenance"]["applied"]) == named
        assert "only the runs that the recipe names were read: planar_*, steering_*" in result["warnings"]
        assert not any("other" in one["path"] for one in result["provenance"]["files"])


def test_what_is_held_out_took_no_part_in_the_fit(first: Result, place: Path) -> None:
    tyres, evaluated = (read(place / "out" / f"{stage}.json") for stage in ("tyres", "evaluate"))
    assert [run["run"] for run in tyres["by_run"] if run["used"]] == ["planar_a", "planar_b"]
    assert (evaluated["split_by"], evaluated["held_out"]) == ("run", ["planar_c"])
    assert evaluated["training"] == ["planar_a", "planar_b"]
    assert [(one["signal"], one["met"]) for one in evaluated["requirements"]] == [("yaw_rate", True)]


def test_the_second_run_computes_nothing_and_changes_no_file(first: Result, place: Path) -> None:
    out = place / "out"
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    ended = call("run", str(place / "recipe.yaml"), str(place / "logs"), "--out", str(out))
    assert ended.exit_code == 0
    assert ended.stdout.splitlines()[:7] == [f"{what}: up to date" for what in (*STAGES, "report")]
    assert "Evaluation: " in ended.stdout
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


def test_a_requirement_that_is_not_met_ends_with_5_and_fits_nothing_again(first: Result, place: Path) -> None:
    arguments = ("run", str(place / "strict.yaml"), str(place / "logs"), "--out", str(place / "out"))
    ended = call(*arguments, "--json")
    assert ended.exit_code == 5
    assert states(ended) == {
        **dict.fromkeys(STAGES, "up to date"),
        "evaluate": "done",
    }
    lines = [line for line in ended.stderr.splitlines() if line.startswith("ident: ")]
    assert len(lines) == 1
    assert lines[0].startswith("ident: yaw rate rms is ")
    assert "required is at most 1e-06 rad/s" in lines[0]
    assert call(*arguments, "--quiet").exit_code == 5
    assert read(place / "out" / "evaluate.json")["requirements"][0]["met"] is False


def logs_of_one_run(folder: Path, channels: str) -> tuple[str, ...]:
    """Give the arguments of `ident run` on a run without request and vehicle file."""
    shutil.copytree(SAMPLES / "manual_a", folder / "logs" / "manual_a")
    (folder / "recipe.yaml").write_text("seed: 1\n", encoding="utf-8")
    (folder / "logs" / "channels.yaml").write_text(channels, encoding="utf-8")
    return "run", str(folder / "recipe.yaml"), str(folder / "logs"), "--out", str(folder / "out"), "--json"


def test_logs_that_answer_nothing_are_told_of_and_everything_is_refused(tmp_path: Path) -> None:
    speed = "signals: {speed: {topic: /vehicle/velocity, field: twist.linear.x, unit: m/s}}"
    ended = call(*logs_of_one_run(tmp_path, speed))
    assert ended.exit_code == 4
    refused = ("steering", "tyres", "evaluate", "improve", "validate")
    assert states(ended) == {"info": "done", **dict.fromkeys(refused, "refused")}
    assert ended.stderr.splitlines()[-1].startswith("ident: no stage can answer from these logs: steering: ")
    html = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert html.count("no answer") >= 4
    assert sorted(path.name for path in (tmp_path / "out").glob("*.json")) == ["info.json"]


def test_logs_without_a_model_have_their_sensors_compared(tmp_path: Path) -> None:
    ended = call(*logs_of_one_run(tmp_path, (SAMPLES / "channels.yaml").read_text(encoding="utf-8")))
    assert ended.exit_code == 0, ended.output
    refused = dict.fromkeys(("steering", "tyres", "evaluate", "validate"), "refused")
    assert states(ended) == {"info": "done", **refused, "improve": "done"}
    improved = read(tmp_path / "out" / "improve.json")
    assert (improved["layers"], improved["effects"], improved["error"]["split_by"]) == ([], [], "none")
    bias = load_truth().imu.channels["yaw_rate"].bias
    (found,) = [one for one in improved["sensors"] if one["verdict"] == "differs"]
    assert found["effect"] == "sensor_bias"
    assert found["estimate"]["low"] < bias < found["estimate"]["high"]
