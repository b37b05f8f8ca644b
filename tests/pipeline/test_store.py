from __future__ import annotations

import json
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from ident.errors import BadRecipe
from ident.model_file import Model
from ident.pipeline.seal import MadeFrom
from ident.pipeline.store import Store
from ident.results import SCHEMA_VERSION, Damage, Gap, InfoResult, Provenance, Refusal, RunHealth, TopicHealth
from ident.stages.output import StageOutput

PROVENANCE = Provenance("0.1.0", "ident info logs", 1, "2026-01-02T03:04:05+00:00")
MADE_FROM = MadeFrom("0.1.0 abc", {"run: a.mcap": "12"}, {"seed": 1}, {"tyres": None})


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


def save(folder: Path, result: InfoResult | None = None, stage: str = "info", **more: Any) -> Store:
    store = Store(folder)
    store.save(stage, StageOutput(result or an_info(), **more), MADE_FROM)
    return store


def names(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_reads_a_result_back_into_its_class(tmp_path: Path) -> None:
    store = save(tmp_path / "new" / "folder")
    assert store.result_path("info") == tmp_path / "new" / "folder" / "info.json"
    assert store.read_result("info") == an_info()
    seal = store.seals.read("info")
    assert seal is not None
    assert seal.made_from == MADE_FROM


def test_json_holds_what_is_missing_as_null_and_keeps_the_order_of_the_class(tmp_path: Path) -> None:
    path = save(tmp_path).result_path("info")
    data = json.loads(path.read_text(encoding="utf-8"))
    assert list(data) == ["schema_version", "provenance", "runs", "unreadable", "warnings"]
    assert data["runs"][0]["damage"] == [
        {"what": "cut", "messages_lost": 3, "seconds_lost": None, "bytes_lost": None}
    ]


def test_equal_results_are_equal_files(tmp_path: Path) -> None:
    first, second = (save(tmp_path / name) for name in "ab")
    assert first.result_path("info").read_bytes() == second.result_path("info").read_bytes()
    assert first.seals.digest("info") == second.seals.digest("info") is not None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_refuses_a_number_that_json_does_not_have_and_names_its_place(tmp_path: Path, bad: float) -> None:
    run = replace(an_info().runs[0], duration=bad)
    with pytest.raises(ValueError, match=r"^runs\[0\]\.duration is -?(nan|inf), need a finite number"):
        save(tmp_path, an_info(runs=[run]))
    assert list(tmp_path.iterdir()) == []


def test_writes_text_that_is_not_unicode_so_that_it_can_be_read(tmp_path: Path) -> None:
    store = save(tmp_path, an_info(warnings=[os.fsdecode(b"run_\xff"), "winkel µ°"]))
    read = store.read_result("info")
    assert read is not None
    assert read.warnings == ["run_\\udcff", "winkel µ°"]


def test_has_no_result_before_one_is_written_nor_of_another_version(tmp_path: Path) -> None:
    assert Store(tmp_path).read_result("info") is None
    assert save(tmp_path, an_info(schema_version="0")).read_result("info") is None


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema_version": "1"}'])
def test_what_was_changed_afterwards_is_no_result(tmp_path: Path, text: str) -> None:
    store = save(tmp_path)
    store.result_path("info").write_text(text, encoding="utf-8")
    assert store.read_result("info") is None
    assert store.seals.is_broken("info")


def test_a_result_that_nothing_seals_is_none(tmp_path: Path) -> None:
    store = save(tmp_path)
    store.seals.remove("info")
    assert store.result_path("info").is_file()
    assert store.read_result("info") is None
    assert not store.seals.is_broken("info")


def test_reads_tables_back(tmp_path: Path) -> None:
    table = pd.DataFrame({"run": ["a", "<b>"], "time": [0.0, math.nan], "used": [True, False]})
    store = save(tmp_path, tables={"steering": table})
    assert names(tmp_path) == [".ident/info.json", "info.json", "signals/steering.parquet"]
    read = store.read_tables("info", ["steering", "absent"])
    assert list(read) == ["steering"]
    pd.testing.assert_frame_equal(read["steering"], table)


def test_a_table_that_was_changed_takes_its_result_with_it(tmp_path: Path) -> None:
    store = save(tmp_path, tables={"steering": pd.DataFrame({"time": [0.0]})})
    store.table_path("steering").unlink()
    assert store.read_result("info") is None


def test_a_table_that_is_not_made_again_is_removed_and_a_foreign_one_is_not_read(tmp_path: Path) -> None:
    table = pd.DataFrame({"time": [0.0]})
    save(tmp_path, tables={"old": table})
    store = save(tmp_path, tables={"new": table})
    table.to_parquet(store.table_path("foreign"))
    assert list(store.read_tables("info", ["old", "new", "foreign"])) == ["new"]
    assert names(tmp_path / "signals") == ["foreign.parquet", "new.parquet"]


def test_refuses_a_table_name_that_could_leave_the_folder(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"table name '\.\./x'"):
        save(tmp_path, tables={"../x": pd.DataFrame()})
    assert list(tmp_path.iterdir()) == []


def test_the_model_is_put_together_from_what_is_sealed(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.read_model() == Model()
    save(tmp_path, stage="steering", model=a_part(0.1))
    save(tmp_path, model={"noise": {"yaw_rate": {"std": 0.01}}})
    save(tmp_path, an_info(provenance=replace(PROVENANCE, seed=2)), stage="steering", model=a_part(0.2))
    model = store.read_model()
    assert model.steering is not None
    assert model.steering.dead_time.value == 0.2
    assert model.noise["yaw_rate"].std == 0.01
    assert {stage: written.seed for stage, written in model.provenance.items()} == {"info": 1, "steering": 2}


def test_the_model_does_not_depend_on_the_order_in_which_stages_were_run(tmp_path: Path) -> None:
    tyres = {"noise": {"yaw_rate": {"std": 0.01}}, "parameters": ["a"], "covariance": [[1.0]]}
    stages = {"steering": a_part(0.1), "tyres": tyres}
    for folder, order in (("a", list(stages)), ("b", list(reversed(stages)))):
        for stage in order:
            save(tmp_path / folder, stage=stage, model=stages[stage])
    assert (tmp_path / "a" / "model.yaml").read_bytes() == (tmp_path / "b" / "model.yaml").read_bytes()


def test_a_model_that_was_edited_is_put_together_again(tmp_path: Path) -> None:
    store = save(tmp_path, stage="steering", model=a_part(0.1))
    written = store.model_path.read_bytes()
    store.model_path.write_text("edited: true", encoding="utf-8")
    store.write_model()
    assert store.model_path.read_bytes() == written


def test_refuses_to_write_a_model_that_could_not_be_read(tmp_path: Path) -> None:
    with pytest.raises(BadRecipe, match="model of steering: covariance has rows"):
        save(tmp_path, stage="steering", model=a_part(0.1) | {"parameters": []})
    with pytest.raises(ValueError, match=r"steering\.gain\.value is nan"):
        save(tmp_path, stage="steering", model=a_part(math.nan))
    assert list(tmp_path.iterdir()) == []


def test_a_refusal_is_kept_and_removes_what_was_made_of_other_data(tmp_path: Path) -> None:
    store = save(
        tmp_path, stage="steering", model=a_part(0.1), tables={"steering": pd.DataFrame({"time": [0.0]})}
    )
    store.refuse("steering", "no steps", MADE_FROM)
    assert names(tmp_path) == [".ident/steering.json"]
    assert store.read_result("steering") is None
    seal = store.seals.read("steering")
    assert seal is not None
    assert seal.refused == "no steps"


def test_a_seal_never_reaches_out_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "precious.json").write_text("{}", encoding="utf-8")
    store = save(tmp_path / "out")
    path = store.seals.path("info")
    path.write_text(
        path.read_text(encoding="utf-8").replace("info.json", "../precious.json"), encoding="utf-8"
    )
    assert store.seals.files("info") == []
    store.refuse("info", "no", MADE_FROM)
    assert (tmp_path / "precious.json").is_file()
