"""The program as a user calls it, on sample logs: what it prints, leaves behind, and leaves alone."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner, Result
from ruamel.yaml import YAML

from ident.cli import main

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_logs"


def call(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments), prog_name="ident")


def fingerprint(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def check_schema(name: str, data: Any) -> None:
    schema = json.loads((ROOT / "docs" / "schema" / f"{name}.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema).validate(data)


def reads_strictly(text: str) -> Any:
    """Read JSON, refusing the NaN and Infinity that Python would take."""

    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} in JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("my logs")
    for run in ("steering_pulses_a", "steering_pulses_b"):
        shutil.copytree(SAMPLES / run, folder / run)
    return folder


@pytest.fixture(scope="module")
def steering(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path, bool]:
    """What `ident steering LOGS --out OUT` gave, OUT, and whether the logs are as they were."""
    before = fingerprint(logs)
    out = tmp_path_factory.mktemp("outputs") / "out"
    ended = call("steering", str(logs), "--out", str(out))
    return ended, out, fingerprint(logs) == before


def test_steering_leaves_every_output_and_the_logs_as_they_were(steering: tuple[Result, Path, bool]) -> None:
    ended, out, unchanged = steering
    assert ended.exit_code == 0, ended.output
    assert ended.stdout.rstrip().endswith(f"Report: {out / 'index.html'}")
    written = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert written == {
        *(".ident/steering.json", ".ident/recording.json", ".ident/report.json"),
        *("index.html", "steering.json", "model.yaml", "run.rrd"),
        *("signals/steering.parquet", "signals/steering_request.parquet"),
    }
    assert unchanged


def test_steering_keeps_its_contract(steering: tuple[Result, Path, bool]) -> None:
    _, out, _ = steering
    result = reads_strictly((out / "steering.json").read_text(encoding="utf-8"))
    check_schema("steering", result)
    model = YAML(typ="safe", pure=True).load((out / "model.yaml").read_text(encoding="utf-8"))
    check_schema("model", model)
    for name, value in model["steering"].items():
        if isinstance(value, dict):
            assert value["value"] == result["model"][name]["value"]
    assert [math.sqrt(row[index]) for index, row in enumerate(model["covariance"])] == pytest.approx(
        [model["steering"][name.removeprefix("steering.")]["std"] for name in model["parameters"]]
    )


def test_the_same_call_gives_the_same_answer_but_for_the_date(
    steering: tuple[Result, Path, bool], logs: Path
) -> None:
    _, out, _ = steering
    before = reads_strictly((out / "steering.json").read_text(encoding="utf-8"))
    again = reads_strictly(call("steering", str(logs), "--out", str(out), "--json").stdout)
    assert before["provenance"].pop("date")
    assert again["provenance"].pop("date")
    assert again == before


def test_info_joins_the_report_of_the_same_folder(steering: tuple[Result, Path, bool], logs: Path) -> None:
    _, out, _ = steering
    ended = call("info", str(logs), "--out", str(out), "--json", "--quiet")
    assert ended.exit_code == 0
    assert ended.stderr == ""
    result = reads_strictly(ended.stdout)
    check_schema("info", result)
    assert [run["name"] for run in result["runs"]] == ["steering_pulses_a", "steering_pulses_b"]
    assert (out / "steering.json").is_file()


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the planar truck with what is known of it, and a recipe that fits two kinds of tyres."""
    folder = tmp_path_factory.mktemp("turning")
    shutil.copytree(SAMPLES / "planar" / "planar_a", folder / "planar_a")
    vehicle = (SAMPLES / "planar" / "vehicle.yaml").read_text(encoding="utf-8")
    (folder / "vehicle.yaml").write_text(vehicle.replace("12500 kg", "12500 kg +- 125 kg"), encoding="utf-8")
    (folder / "recipe.yaml").write_text("tyres: {kinds: [linear, brush]}\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def tyres(turning: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path, bool]:
    """What `ident tyres LOGS --recipe RECIPE --out OUT` gave, OUT, and whether the logs are as they were."""
    before = fingerprint(turning)
    out = tmp_path_factory.mktemp("outputs") / "out"
    ended = call("tyres", str(turning), "--recipe", str(turning / "recipe.yaml"), "--out", str(out))
    return ended, out, fingerprint(turning) == before


def test_tyres_leave_every_output_and_the_logs_as_they_were(tyres: tuple[Result, Path, bool]) -> None:
    ended, out, unchanged = tyres
    assert ended.exit_code == 0, ended.output
    assert "front Cα" in ended.stdout
    assert ended.stdout.rstrip().endswith(f"Report: {out / 'index.html'}")
    written = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert written == {
        *(".ident/tyres.json", ".ident/recording.json", ".ident/report.json"),
        *("index.html", "tyres.json", "model.yaml", "run.rrd"),
        *("signals/tyres.parquet", "signals/tyre_forces.parquet"),
    }
    assert unchanged


def test_tyres_keep_their_contract(tyres: tuple[Result, Path, bool]) -> None:
    _, out, _ = tyres
    result = reads_strictly((out / "tyres.json").read_text(encoding="utf-8"))
    check_schema("tyres", result)
    model = YAML(typ="safe", pure=True).load((out / "model.yaml").read_text(encoding="utf-8"))
    check_schema("model", model)
    fit = next(fit for fit in result["fits"] if fit["kind"] == result["chosen"])
    assert model["tyres"]["kind"] == result["chosen"]
    for axle in ("front", "rear"):
        for name, value in model["tyres"][axle].items():
            assert value["value"] == fit[axle][name]["value"]
    assert model["vehicle"]["mass"] == {"value": 12500.0, "std": 125.0, "unit": "kg"}
    assert result["fixed"]["mass"]["std"] == 125.0


def test_a_mass_known_to_one_per_cent_leaves_the_stiffness_known_to_no_less(
    tyres: tuple[Result, Path, bool],
) -> None:
    _, out, _ = tyres
    result = reads_strictly((out / "tyres.json").read_text(encoding="utf-8"))
    stiffness = result["fits"][0]["rear"]["cornering_stiffness"]
    assert stiffness["std"] / stiffness["value"] >= 0.0099


def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "notes.mcap").write_text("not a log", encoding="utf-8")
    for command in ("info", "steering", "tyres", "init"):
        ended = call(command, str(tmp_path / "notes.mcap"), "--out", str(tmp_path / "out"), "--quiet")
        assert ended.exit_code == 3
        assert ended.stderr.startswith("ident: ")
        assert len(ended.stderr.splitlines()) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.mcap"]


def test_a_log_without_steering_cannot_answer(tmp_path: Path) -> None:
    shutil.copytree(SAMPLES / "manual_a", tmp_path / "logs" / "manual_a")
    ended = call("steering", str(tmp_path / "logs"), "--out", str(tmp_path / "out"), "--quiet")
    assert ended.exit_code == 4
    assert len(ended.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_log_without_a_turn_cannot_tell_the_tyres(tmp_path: Path) -> None:
    shutil.copytree(SAMPLES / "steering_pulses_a", tmp_path / "logs" / "steering_pulses_a")
    ended = call("tyres", str(tmp_path / "logs"), "--out", str(tmp_path / "out"), "--quiet")
    assert ended.exit_code == 4
    assert len(ended.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()
