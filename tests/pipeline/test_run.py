from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import ident
from ident.errors import BadRecipe, NotIdentifiable, UsageError
from ident.pipeline import run as pipeline
from ident.pipeline.options import RunOptions
from ident.pipeline.recipe import Recipe
from ident.pipeline.run import run_stage
from ident.pipeline.stages import STAGES, Stage
from ident.pipeline.store import Store
from ident.report.page import Page, Text, Verdict
from ident.report.recording import Part
from ident.results import SCHEMA_VERSION, InfoResult, Provenance
from ident.stages.output import Context, StageOutput

VALUE = {"value": 0.1, "std": 0.01, "unit": "s"}
MODEL = {"steering": dict.fromkeys(("gain", "dead_time", "time_constant_1", "time_constant_2"), VALUE)}


@dataclass
class FakeStage:
    """A stage that remembers how it was called; its result is an empty InfoResult."""

    warnings: list[str] = field(default_factory=lambda: ["one <b>warning</b>"])
    name: str = "info"
    error: Exception | None = None
    called: list[tuple[Sequence[Path], Recipe, Context]] = field(default_factory=list)
    recorded: list[tuple[InfoResult, list[str]]] = field(default_factory=list)

    def run(self, logs: Sequence[Path], recipe: Recipe, context: Context, _: Any) -> StageOutput[InfoResult]:
        self.called.append((logs, recipe, context))
        if self.error is not None:
            raise self.error
        made = Provenance(ident.__version__, context.command, context.seed, context.date)
        table = pd.DataFrame({"time": [0.0, 0.1]})
        result = InfoResult(SCHEMA_VERSION, made, [], [], self.warnings)
        return StageOutput(result, {"signals_used": table}, MODEL)

    def page(self, result: InfoResult, tables: Any) -> Page:
        rows = sum(len(table) for table in tables.values())
        return Page(
            "info", "Logs", Verdict("good", result.warnings[0], "good"), [Text(f"{rows} rows were read")]
        )

    def record(self, result: InfoResult, tables: Any) -> Part:
        self.recorded.append((result, list(tables)))
        made, text = result.provenance, f"{len(result.warnings)} warning"
        return Part(self.name, self.name, made, text, [], lambda _: None, lambda _: None)

    def stage(self) -> Stage:
        return Stage(
            self.run,
            lambda result: f"{len(result.warnings)} warning",
            self.page,
            ("signals_used",),
            self.record,
        )


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeStage:
    fake = FakeStage()
    monkeypatch.setitem(STAGES, "info", fake.stage())
    monkeypatch.chdir(tmp_path)
    for folder in ("my_logs", "a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "run.mcap").touch()
    return fake


def second_page(first: FakeStage) -> Callable[[Any, Any], Page]:
    return lambda result, _: replace(first.page(result, {}), name="steering", title="Second")


def go(options: RunOptions | None = None, logs: Sequence[str] = ("my_logs",)) -> pipeline.Outcome:
    return run_stage("info", [Path(log) for log in logs], options or RunOptions(), lambda *_: None)


def test_leaves_every_output_in_one_folder(fake: FakeStage) -> None:
    outcome = go()
    folder = Path("reports/my_logs")
    written = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    assert written == [
        *(f".ident/{name}.json" for name in ("info", "recording", "report")),
        *("index.html", "info.json", "model.yaml", "run.rrd", "signals/signals_used.parquet"),
    ]
    assert outcome == pipeline.Outcome(
        "1 warning", (folder / "info.json").read_text(encoding="utf-8"), folder / "index.html"
    )


def test_the_report_and_the_recording_are_drawn_from_what_is_stored(fake: FakeStage) -> None:
    outcome = go()
    stored = Store(outcome.report.parent).read_result("info")
    assert fake.recorded == [(stored, ["signals_used"])]
    html = outcome.report.read_text(encoding="utf-8")
    assert "2 rows were read" in html
    assert "one &lt;b&gt;warning&lt;/b&gt;" in html
    assert "<b>warning" not in html


def test_the_model_says_what_it_was_made_from(fake: FakeStage) -> None:
    model = Store(go(RunOptions(out=Path("o"))).report.parent).read_model()
    assert model.steering is not None
    assert model.steering.dead_time.value == 0.1
    assert (model.provenance["info"].seed, model.provenance["info"].command) == (
        0,
        "ident info my_logs --out o",
    )


def test_two_runs_differ_in_nothing_but_the_date(fake: FakeStage) -> None:
    texts = []
    for out in ("out_1", "out_2"):
        data = json.loads(go(RunOptions(out=Path(out))).json)
        data["provenance"] |= {"date": None, "command": data["provenance"]["command"].replace(out, "")}
        texts.append(data)
    assert texts[0] == texts[1]


def test_a_second_stage_joins_the_report_of_the_first(
    fake: FakeStage, monkeypatch: pytest.MonkeyPatch
) -> None:
    go()
    second = FakeStage(warnings=["of the second"])
    monkeypatch.setitem(STAGES, "steering", Stage(second.run, str, second_page(fake)))
    monkeypatch.setitem(ident.pipeline.store.RESULTS, "steering", InfoResult)
    outcome = run_stage("steering", [Path("my_logs")], RunOptions(), lambda *_: None)
    html = outcome.report.read_text(encoding="utf-8")
    assert "one &lt;b&gt;warning" in html
    assert "of the second" in html
    assert len(fake.recorded) == 1


def test_the_recording_holds_every_stage_and_opens_at_the_one_that_was_run(
    fake: FakeStage, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[tuple[list[str], str]] = []
    monkeypatch.setattr(
        "ident.report.recording.write_recording",
        lambda path, parts, shown: (
            path.write_bytes(b"recording"),
            written.append(([part.stage for part in parts], shown)),
        ),
    )
    second = FakeStage(name="steering")
    go()
    monkeypatch.setitem(STAGES, "steering", replace(second.stage(), page=second_page(fake)))
    monkeypatch.setitem(ident.pipeline.store.RESULTS, "steering", InfoResult)
    run_stage("steering", [Path("my_logs")], RunOptions(), lambda *_: None)
    assert written == [(["info"], "info"), (["info", "steering"], "steering")]


def test_a_stage_that_refuses_leaves_nothing_behind(fake: FakeStage, tmp_path: Path) -> None:
    fake.error = NotIdentifiable("no steps")
    with pytest.raises(NotIdentifiable):
        go()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "my_logs"]


def test_a_wrong_recipe_is_found_before_any_log_is_read(fake: FakeStage, tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text("sed: 1", encoding="utf-8")
    with pytest.raises(BadRecipe):
        go(RunOptions(recipe=recipe))
    with pytest.raises(UsageError):
        go(RunOptions(out=recipe))
    assert fake.called == []


def test_the_stage_is_told_the_recipe_the_command_and_the_progress(fake: FakeStage, tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text("seed: 5\nalign: {max_gap: 0.5 s}\n", encoding="utf-8")
    told: list[str] = []
    run_stage("info", [Path("a"), Path("b")], RunOptions(recipe=recipe), lambda what, *_: told.append(what))
    logs, given, context = fake.called[0]
    assert logs == [Path("a"), Path("b")]
    assert (given.seed, given.align.max_gap, context.seed) == (5, 0.5, 5)
    assert context.command == f"ident info a b --recipe {recipe}"
    assert list(dict.fromkeys(told)) == ["looking for changes", "drawing the report"]
