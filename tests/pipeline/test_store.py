from __future__ import annotations

import json
import math
import os
import stat
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from ident.errors import BadRecipe, UsageError
from ident.model_file import Model
from ident.pipeline.store import Store, atomic, name_of, output_folder, plain
from ident.results import SCHEMA_VERSION, Damage, Gap, InfoResult, Provenance, Refusal, RunHealth, TopicHealth

PROVENANCE = Provenance("0.1.0", "ident info logs", 1, "2026-01-02T03:04:05+00:00")


def an_info(**changes: Any) -> InfoResult:
    topic = TopicHealth("/v", "T", 3, 50.0, 0.01, [Gap(1.0, 0.5)], 25, "header")
    run = RunHealth(
        "run",
        "mcap",
        "2026-01-01",
        2.0,
        "built-in",
        "none",
        [topic],
        {},
        ["speed"],
        damage=[Damage("cut", 3)],
    )
    return replace(InfoResult(SCHEMA_VERSION, PROVENANCE, [run], [Refusal("b", "empty")], []), **changes)


def a_part(dead_time: float) -> dict[str, Any]:
    value = {"value": dead_time, "std": 0.001, "unit": "s"}
    names = ("gain", "dead_time", "time_constant_1", "time_constant_2")
    return {
        "steering": dict.fromkeys(names, value),
        "parameters": ["steering.dead_time"],
        "covariance": [[1e-6]],
    }


def test_reads_a_result_back_into_its_class(tmp_path: Path) -> None:
    store = Store(tmp_path / "new" / "folder")
    path = store.write_result("info", an_info())
    assert path == tmp_path / "new" / "folder" / "info.json"
    assert store.read_result("info") == an_info()


def test_json_holds_what_is_missing_as_null_and_keeps_the_order_of_the_class(tmp_path: Path) -> None:
    path = Store(tmp_path).write_result("info", an_info())
    data = json.loads(path.read_text(encoding="utf-8"))
    assert list(data) == ["schema_version", "provenance", "runs", "unreadable", "warnings"]
    assert data["runs"][0]["damage"] == [
        {"what": "cut", "messages_lost": 3, "seconds_lost": None, "bytes_lost": None}
    ]


def test_equal_results_are_equal_files(tmp_path: Path) -> None:
    first = Store(tmp_path / "a").write_result("info", an_info()).read_bytes()
    assert Store(tmp_path / "b").write_result("info", an_info()).read_bytes() == first


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_refuses_a_number_that_json_does_not_have_and_names_its_place(tmp_path: Path, bad: float) -> None:
    run = replace(an_info().runs[0], duration=bad)
    with pytest.raises(ValueError, match=r"^runs\[0\]\.duration is -?(nan|inf), need a finite number"):
        Store(tmp_path).write_result("info", an_info(runs=[run]))
    assert list(tmp_path.iterdir()) == []


def test_writes_text_that_is_not_unicode_so_that_it_can_be_read(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.write_result("info", an_info(warnings=[os.fsdecode(b"run_\xff"), "winkel µ°"]))
    read = store.read_result("info")
    assert read is not None
    assert read.warnings == ["run_\\udcff", "winkel µ°"]


def test_has_no_result_before_one_is_written_nor_of_another_version(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.read_result("info") is None
    store.write_result("info", an_info(schema_version="0"))
    assert store.read_result("info") is None


@pytest.mark.parametrize("text", ["{", "[]", '{"schema_version": "1"}'])
def test_refuses_a_result_that_is_not_whole(tmp_path: Path, text: str) -> None:
    (tmp_path / "info.json").write_text(text, encoding="utf-8")
    with pytest.raises(BadRecipe, match=r"info\.json: is not a result of ident: remove it"):
        Store(tmp_path).read_result("info")


def test_reads_tables_back(tmp_path: Path) -> None:
    table = pd.DataFrame({"run": ["a", "<b>"], "time": [0.0, math.nan], "used": [True, False]})
    store = Store(tmp_path)
    store.write_tables({"steering": table})
    assert sorted(path.name for path in (tmp_path / "signals").iterdir()) == ["steering.parquet"]
    read = store.read_tables(["steering", "absent"])
    assert list(read) == ["steering"]
    pd.testing.assert_frame_equal(read["steering"], table)


def test_refuses_a_table_name_that_could_leave_the_folder(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"table name '\.\./x'"):
        Store(tmp_path).write_tables({"../x": pd.DataFrame()})


def test_the_model_keeps_what_another_stage_wrote(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.read_model() == Model()
    store.write_model("other", {"noise": {"yaw_rate": {"std": 0.01}}}, PROVENANCE)
    store.write_model("steering", a_part(0.1), PROVENANCE)
    store.write_model("steering", a_part(0.2), replace(PROVENANCE, seed=2))
    model = store.read_model()
    assert model.steering is not None
    assert model.steering.dead_time.value == 0.2
    assert model.noise["yaw_rate"].std == 0.01
    assert {stage: written.seed for stage, written in model.provenance.items()} == {"other": 1, "steering": 2}


def test_parameters_of_other_parts_stay_beside_those_of_a_stage(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.write_model("steering", a_part(0.1) | {"noise": {"steering_wheel_angle": {"std": 0.1}}}, PROVENANCE)
    before = store.read_model()
    value = {"value": 1.0, "std": 2.0, "unit": "1"}
    tyres = {
        "tyres": {"kind": "linear", "front": {"a": value}, "rear": {"b": value}},
        "parameters": ["tyres.front.a", "tyres.rear.b"],
        "covariance": [[4.0, 1.0], [1.0, 4.0]],
        "noise": {"yaw_rate": {"std": 0.01}},
    }
    for part in (tyres | {"parameters": ["tyres.front.old"], "covariance": [[9.0]]}, tyres):
        store.write_model("tyres", part, PROVENANCE)
    model = store.read_model()
    assert model.steering == before.steering
    assert list(model.noise) == ["steering_wheel_angle", "yaw_rate"]
    assert model.parameters == [*before.parameters, "tyres.front.a", "tyres.rear.b"]
    size = len(before.parameters)
    assert [row[:size] for row in model.covariance[:size]] == before.covariance
    assert [row[size:] for row in model.covariance[size:]] == [[4.0, 1.0], [1.0, 4.0]]
    assert [row[size:] for row in model.covariance[:size]] == [[0.0, 0.0]] * size
    store.write_model("steering", a_part(0.2), PROVENANCE)
    assert store.read_model().parameters == ["tyres.front.a", "tyres.rear.b", *before.parameters]


def test_refuses_to_write_a_model_that_could_not_be_read(tmp_path: Path) -> None:
    with pytest.raises(BadRecipe, match="model of steering: covariance has rows"):
        Store(tmp_path).write_model("steering", a_part(0.1) | {"parameters": []}, PROVENANCE)
    with pytest.raises(ValueError, match=r"steering\.gain\.value is nan"):
        Store(tmp_path).write_model("steering", a_part(math.nan), PROVENANCE)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("old", encoding="utf-8")

    def write_half() -> None:
        with atomic(path) as temporary:
            temporary.write_text("ne", encoding="utf-8")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_written_file_has_the_usual_permissions(tmp_path: Path) -> None:
    (tmp_path / "usual").touch()
    usual = stat.S_IMODE((tmp_path / "usual").stat().st_mode)
    path = Store(tmp_path).write_result("info", an_info())
    assert stat.S_IMODE(path.stat().st_mode) == usual


def test_says_why_a_folder_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match=r"cannot write .*info\.json: File exists: give another folder"):
        Store(tmp_path / "file").write_result("info", an_info())


def test_plain_gives_only_what_json_has() -> None:
    assert plain({"a": (1, 2.5, None, True, Gap(0.0, 1.0))}) == {
        "a": [1, 2.5, None, True, {"start": 0.0, "seconds": 1.0}]
    }


# --- where the outputs go ----------------------------------------------------------------------------


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "my.logs"
    (folder / "run_a").mkdir(parents=True)
    (folder / "run_a" / "metadata.yaml").touch()
    (folder / "run_a" / "run_a_0.mcap").touch()
    (folder / "single.mcap").touch()
    monkeypatch.chdir(tmp_path)
    return folder


def test_outputs_are_named_after_the_logs(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert output_folder(None, [logs]) == Path("reports/my.logs")
    assert output_folder(None, [logs / "single.mcap"]) == Path("reports/single")
    assert output_folder(None, [logs / "run_a", logs / "single.mcap"]) == Path("reports/run_a_and_1_more")
    assert name_of([Path("/")]) == "logs"
    monkeypatch.chdir(logs)
    assert output_folder(None, [Path()]) == Path("reports/my.logs")


@pytest.mark.parametrize("out", ["my.logs", "my.logs/run_a", "my.logs/../my.logs"])
def test_refuses_to_write_beside_the_logs(logs: Path, out: str) -> None:
    for given in ([logs], [logs / "run_a"], [logs / "single.mcap"]):
        with pytest.raises(UsageError, match="would lie beside the logs in"):
            output_folder(Path(out), given)


def test_refuses_to_write_into_a_log(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="lies inside the log run_a: name another folder with --out"):
        output_folder(logs / "run_a" / "deep" / "report", [logs])
    monkeypatch.chdir(logs / "run_a")
    with pytest.raises(UsageError, match="lies inside the log run_a"):
        output_folder(None, [Path()])


def test_refuses_to_replace_what_it_has_not_written(logs: Path) -> None:
    site = logs.parent / "site"
    site.mkdir()
    (site / "index.html").touch()
    with pytest.raises(UsageError, match=r"holds another index\.html: name a new or empty folder"):
        output_folder(site, [logs])
    (site / "info.json").touch()
    assert output_folder(site, [logs]) == site


def test_refuses_a_file_as_folder(logs: Path) -> None:
    (logs.parent / "notes").touch()
    with pytest.raises(UsageError, match="is a file: name a folder"):
        output_folder(Path("notes"), [logs])
