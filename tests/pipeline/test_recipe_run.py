"""`ident run`: which stages are computed and which are skipped, on stages that only count their calls."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

import ident
from ident.errors import BadRecipe, NotIdentifiable, RequirementNotMet, UnusableLog, UsageError
from ident.pipeline.lock import locked
from ident.pipeline.options import RunOptions
from ident.pipeline.recipe import Recipe
from ident.pipeline.run import Outcome, run_recipe, run_stage
from ident.pipeline.stages import STAGES, Stage
from ident.pipeline.store import RESULTS, Store
from ident.report.page import Page, Verdict
from ident.results import SCHEMA_VERSION, ErrorComparison, ImproveResult, InfoResult, Provenance
from ident.stages.inputs import SplitSettings
from ident.stages.output import Context, StageOutput

OUT = Path("out")


@dataclass
class Fake:
    """A stage whose answer names what it was given; it refuses where ``refuses`` says why."""

    name: str
    refuses: str | None = None
    calls: list[tuple[Recipe, dict[str, Any]]] = field(default_factory=list)
    unmet: list[str] = field(default_factory=list)

    def run(
        self, _: Sequence[Path], recipe: Recipe, context: Context, results: Any
    ) -> StageOutput[InfoResult]:
        self.calls.append((recipe, dict(results)))
        if self.refuses:
            raise NotIdentifiable(self.refuses)
        made = Provenance(ident.__version__, context.command, context.seed, context.date)
        told = [f"{self.name} of {name}" for name, result in results.items() if result is not None]
        return StageOutput(InfoResult(SCHEMA_VERSION, made, [], [], told))

    def page(self, result: InfoResult, _: Any) -> Page:
        return Page(self.name, self.name.title(), Verdict("good", " ".join(result.warnings), "good"), [])


@pytest.fixture
def fakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Fake]:
    """Stages as there are, in their order, with a recipe and logs."""
    made = {name: Fake(name) for name in STAGES}
    for name, fake in made.items():
        true = STAGES[name]
        stage = Stage(
            fake.run,
            lambda result: f"warnings {len(result.warnings)}",
            fake.page,
            title=true.title,
            needs=true.needs,
            helped_by=true.helped_by,
            takes=true.takes,
            given=true.given,
            settings=true.settings,
            reads=true.reads,
            identifies=true.identifies,
            unmet=lambda _, fake=fake: fake.unmet,
        )
        monkeypatch.setitem(STAGES, name, stage)
        monkeypatch.setitem(RESULTS, name, InfoResult)
    monkeypatch.setattr("ident.stages.split.drawn_split", lambda *_: SplitSettings(held_out=["run_b"]))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IDENT_CACHE", str(tmp_path / "cache"))
    (tmp_path / "logs").mkdir()
    for name in ("run_a", "run_b"):
        (tmp_path / "logs" / f"{name}.mcap").write_text(name, encoding="utf-8")
    recipe("{}")
    return made


def recipe(text: str) -> None:
    Path("recipe.yaml").write_text(text, encoding="utf-8")


def go(**options: Any) -> Outcome:
    return run_recipe(Path("recipe.yaml"), [Path("logs")], RunOptions(out=OUT, **options), lambda *_: None)


def states(outcome: Outcome) -> dict[str, str]:
    return {step["stage"]: step["state"] for step in json.loads(outcome.json)["stages"]}


def computed(fakes: dict[str, Fake]) -> list[str]:
    """Names of the stages that were computed since the last call."""
    made = [name for name, fake in fakes.items() if fake.calls]
    for fake in fakes.values():
        fake.calls.clear()
    return made


def test_all_stages_run_in_their_order_and_then_none(fakes: dict[str, Fake]) -> None:
    first = go()
    assert set(states(first).values()) == {"done"}
    assert list(states(first)) == computed(fakes) == list(STAGES)
    before = {path: path.read_bytes() for path in OUT.rglob("*") if path.is_file()}
    second = go()
    assert set(states(second).values()) == {"up to date"}
    assert computed(fakes) == []
    assert second.summary.splitlines()[:2] == ["info: up to date", "steering: up to date"]
    assert "report: up to date" in second.summary
    assert {path: path.read_bytes() for path in OUT.rglob("*") if path.is_file()} == before


def test_a_stage_is_given_the_results_that_it_needs(fakes: dict[str, Fake]) -> None:
    go()
    given = fakes["evaluate"].calls[0][1]
    assert given == {name: Store(OUT).read_result(name) for name in ("tyres", "steering")}
    assert fakes["steering"].calls[0][1] == {}


def test_settings_of_one_stage_run_that_stage_and_those_that_use_it(fakes: dict[str, Fake]) -> None:
    go()
    computed(fakes)
    recipe("tyres: {least_speed: 4 m/s}")
    assert "tyres: done, the settings changed" in go().summary
    assert computed(fakes) == ["tyres", "evaluate", "validate"]
    recipe("tyres: {least_speed: 4 m/s}\nevaluate: {tolerance: 0.2}")
    assert "evaluate: done, the settings changed" in go().summary
    assert computed(fakes) == ["evaluate"]
    recipe("tyres: {least_speed: 4 m/s}\nevaluate: {tolerance: 0.2}\nimprove: {most_effects: 2}")
    assert "improve: done, the settings changed" in go().summary
    assert computed(fakes) == ["improve", "validate"]
    go(seed=7)
    assert computed(fakes) == list(STAGES)


def test_a_log_that_changes_runs_all_again(fakes: dict[str, Fake]) -> None:
    go()
    computed(fakes)
    Path("logs/run_b.mcap").write_text("other", encoding="utf-8")
    assert "steering: done, the logs or what applies to them changed" in go().summary
    assert computed(fakes) == list(STAGES)
    Path("logs/run_c.mcap").write_text("new", encoding="utf-8")
    go()
    assert computed(fakes) == list(STAGES)


def test_other_runs_in_the_recipe_run_all_again_and_a_log_that_it_does_not_name_runs_nothing(
    fakes: dict[str, Fake],
) -> None:
    go()
    computed(fakes)
    recipe("runs: [run_*]")
    assert "steering: done, the settings changed" in go().summary
    assert computed(fakes) == list(STAGES)
    Path("logs/trailer.mcap").write_text("new", encoding="utf-8")
    go()
    assert computed(fakes) == []
    recipe("runs: [run_b, trailer]")
    go()
    assert computed(fakes) == list(STAGES)


def test_a_recipe_that_names_no_run_is_refused_before_anything_is_computed(fakes: dict[str, Fake]) -> None:
    recipe("runs: [manual_*]")
    with pytest.raises(BadRecipe, match=r"runs: manual_[*] names no run: the runs are run_a, run_b"):
        go()
    assert computed(fakes) == []


def test_what_is_held_out_is_one_of_the_runs_that_are_read(fakes: dict[str, Fake]) -> None:
    recipe("runs: [run_a]\nsplit: {held_out: [run_b]}")
    with pytest.raises(BadRecipe, match="split: run_b names no run: the runs are run_a"):
        go()
    assert computed(fakes) == []


@pytest.mark.parametrize("name", ["vehicle.yaml", "channels.yaml", "types.idl"])
def test_what_applies_to_the_logs_belongs_to_them(fakes: dict[str, Fake], name: str) -> None:
    go()
    computed(fakes)
    (Path("logs") / name).write_text("{}", encoding="utf-8")
    go()
    assert computed(fakes) == list(STAGES)


def test_another_version_of_the_code_runs_all_again(
    fakes: dict[str, Fake], monkeypatch: pytest.MonkeyPatch
) -> None:
    go()
    computed(fakes)
    monkeypatch.setattr("ident.pipeline.job.code_version", lambda **_: "other")
    assert "info: done, the code changed" in go().summary
    assert computed(fakes) == list(STAGES)


def test_a_model_that_is_compared_is_looked_into(fakes: dict[str, Fake]) -> None:
    Path("old.yaml").write_text("reference_point: cg", encoding="utf-8")
    go(against=Path("old.yaml"))
    computed(fakes)
    go(against=Path("old.yaml"))
    assert computed(fakes) == []
    Path("old.yaml").write_text("reference_point: rear_axle", encoding="utf-8")
    go(against=Path("old.yaml"))
    assert computed(fakes) == ["evaluate"]


@pytest.mark.parametrize("name", ["steering.json", ".ident/steering.json"])
@pytest.mark.parametrize("how", ["edited", "removed"])
def test_what_is_not_as_it_was_written_is_made_again(fakes: dict[str, Fake], name: str, how: str) -> None:
    go()
    computed(fakes)
    if how == "edited":
        (OUT / name).write_text((OUT / name).read_text(encoding="utf-8") + " ", encoding="utf-8")
    else:
        (OUT / name).unlink()
    go()
    assert computed(fakes) == ([] if (name, how) == (".ident/steering.json", "edited") else ["steering"])
    assert Store(OUT).read_result("steering") is not None


@pytest.mark.parametrize("name", ["index.html", ".ident/report.json"])
def test_a_report_that_is_gone_or_edited_is_drawn_again_and_nothing_is_computed(
    fakes: dict[str, Fake], name: str
) -> None:
    go()
    computed(fakes)
    html = (OUT / "index.html").read_bytes()
    for spoil in (lambda path: path.unlink(), lambda path: path.write_text("x", encoding="utf-8")):
        spoil(OUT / name)
        assert "report: done" in go().summary
        assert (OUT / "index.html").read_bytes() == html
    assert computed(fakes) == []


def test_a_stage_that_cannot_answer_stops_no_other_and_is_remembered(fakes: dict[str, Fake]) -> None:
    fakes["steering"].refuses = "no steps: drive <b>steps</b>"
    for _ in range(2):
        outcome = go()
        assert outcome.error is None
        assert states(outcome)["steering"] == "refused"
        assert "steering: no answer: no steps" in outcome.summary
    assert len(fakes["steering"].calls) == 1
    assert fakes["evaluate"].calls[0][1]["steering"] is None
    html = outcome.report.read_text(encoding="utf-8")
    assert "no steps: drive &lt;b&gt;steps&lt;/b&gt;" in html


def test_what_needs_a_stage_that_cannot_answer_cannot_either(fakes: dict[str, Fake]) -> None:
    fakes["tyres"].refuses = "the vehicle drives straight"
    outcome = go()
    assert states(outcome)["evaluate"] == "refused"
    assert "evaluate: no answer: needs `ident tyres`, which cannot answer: the vehicle" in outcome.summary
    assert fakes["evaluate"].calls == []
    assert outcome.error is None


def test_the_improvement_fits_for_itself_and_answers_where_no_other_stage_does(
    fakes: dict[str, Fake],
) -> None:
    for name in ("steering", "tyres", "evaluate"):
        fakes[name].refuses = "no motion"
    outcome = go()
    assert states(outcome)["improve"] == "done"
    assert fakes["improve"].calls[0][1] == {}
    assert outcome.error is None


def test_the_improvement_alone_computes_no_other_stage(fakes: dict[str, Fake]) -> None:
    outcome = run_stage("improve", [Path("logs")], RunOptions(out=OUT), lambda *_: None)
    assert computed(fakes) == ["improve"]
    assert outcome.report == OUT / "index.html"


def test_the_line_that_is_told_of_the_improvement_is_its_own(
    fakes: dict[str, Fake], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = Provenance(ident.__version__, "ident run", 0, "2025-10-09T12:00:00+00:00")
    told = "Adequate: nothing is left that these data tell (p = 0.41)."
    result = ImproveResult(
        *(SCHEMA_VERSION, made, "adequate", told, "linear tyres", ["motion"], [], [], None, [], [], {}, None),
        *(ErrorComparison({}, {}, {}, "none"), None, [], [], [], []),
    )
    monkeypatch.setitem(RESULTS, "improve", ImproveResult)
    monkeypatch.setattr(fakes["improve"], "run", lambda *_: StageOutput(result))
    monkeypatch.setitem(STAGES, "improve", replace(STAGES["improve"], run=fakes["improve"].run))
    assert f"Improvement: {told}" in go().summary


def test_where_nothing_is_identified_the_end_is_4_and_what_can_be_said_is_shown(
    fakes: dict[str, Fake],
) -> None:
    for name in ("steering", "tyres", "improve"):
        fakes[name].refuses = "no motion"
    outcome = go()
    assert isinstance(outcome.error, NotIdentifiable)
    assert outcome.report.is_file()
    assert states(outcome)["info"] == "done"


def test_an_answer_that_is_gone_leaves_nothing_of_the_older_one(fakes: dict[str, Fake]) -> None:
    go()
    fakes["steering"].refuses = "no steps"
    Path("logs/run_b.mcap").write_text("other", encoding="utf-8")
    go()
    assert not (OUT / "steering.json").exists()


def test_a_requirement_is_told_after_all_is_stored_also_where_nothing_is_computed(
    fakes: dict[str, Fake],
) -> None:
    fakes["evaluate"].unmet = ["yaw rate rms is 0.03", "heading rms is 0.2"]
    for _ in range(2):
        outcome = go()
        assert isinstance(outcome.error, RequirementNotMet)
        assert outcome.error.lines == ["yaw rate rms is 0.03", "heading rms is 0.2"]
        assert outcome.report.is_file()
    assert len(fakes["evaluate"].calls) == 1


def test_a_drawn_split_is_the_same_for_all_stages_and_drawn_once(
    fakes: dict[str, Fake], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[int] = []
    split = SplitSettings().model_copy(update={"blocks": {"run_a": (1.0, 2.5)}})
    monkeypatch.setattr("ident.stages.split.drawn_split", lambda *_: (drawn.append(1), split)[1])
    go()
    assert [fakes[name].calls[0][0].split for name in ("tyres", "evaluate")] == [split, split]
    computed(fakes)
    go()
    assert (drawn, computed(fakes)) == ([1], [])
    (OUT / "tyres.json").unlink()
    go()
    assert fakes["tyres"].calls[0][0].split == split
    assert drawn == [1]


def test_a_split_of_the_recipe_is_taken_as_it_stands(fakes: dict[str, Fake]) -> None:
    recipe('split: {held_out: ["*_a"]}')
    go()
    assert fakes["tyres"].calls[0][0].split.held_out == ["*_a"]
    assert not (OUT / ".ident" / "split.json").exists()


def test_a_split_that_names_no_run_is_refused_before_any_log_is_opened(fakes: dict[str, Fake]) -> None:
    recipe('split: {held_out: ["*_c"], blocks: {run_d: [1 s, 2 s]}}')
    with pytest.raises(BadRecipe, match=r"split: \*_c, run_d names no run: the runs are run_a, run_b"):
        go()
    options = RunOptions(recipe=Path("recipe.yaml"), out=OUT)
    with pytest.raises(BadRecipe, match="names no run"):
        run_stage("tyres", [Path("logs")], options, lambda *_: None)
    run_stage("steering", [Path("logs")], options, lambda *_: None)
    assert computed(fakes) == ["steering"]


def test_one_stage_alone_takes_what_it_needs_from_the_store(fakes: dict[str, Fake]) -> None:
    go()
    computed(fakes)
    options = RunOptions(recipe=Path("recipe.yaml"), out=OUT)
    outcome = run_stage("evaluate", [Path("logs")], options, lambda *_: None)
    assert computed(fakes) == ["evaluate"]
    assert outcome.summary.splitlines() == ["steering: up to date", "tyres: up to date", "", "warnings 2"]
    (OUT / "tyres.json").unlink()
    run_stage("evaluate", [Path("logs")], options, lambda *_: None)
    assert computed(fakes) == ["tyres", "evaluate"]


def test_one_stage_alone_runs_what_it_needs_and_stops_where_that_cannot_answer(
    fakes: dict[str, Fake],
) -> None:
    fakes["steering"].refuses = "no steps"
    run_stage("evaluate", [Path("logs")], RunOptions(out=OUT), lambda *_: None)
    assert computed(fakes) == ["steering", "tyres", "evaluate"]
    fakes["tyres"].refuses = "straight"
    with pytest.raises(NotIdentifiable, match="needs `ident tyres`, which cannot answer: straight"):
        run_stage("evaluate", [Path("logs")], RunOptions(out=OUT, seed=3), lambda *_: None)


def test_one_stage_alone_says_what_it_leaves_out_of_the_report(fakes: dict[str, Fake]) -> None:
    go()
    (OUT / "tyres.json").write_text("{}", encoding="utf-8")
    outcome = run_stage("steering", [Path("logs")], RunOptions(out=OUT), lambda *_: None)
    assert outcome.summary.splitlines()[0].startswith("tyres: left out of the report, what was stored is not")
    assert "Tyres" not in outcome.report.read_text(encoding="utf-8")


def test_a_wrong_recipe_is_found_before_any_log_is_looked_at(fakes: dict[str, Fake]) -> None:
    recipe("steerin: {}")
    with pytest.raises(BadRecipe, match="unknown key 'steerin': did you mean 'steering'"):
        run_recipe(Path("recipe.yaml"), [Path("absent")], RunOptions(out=OUT), lambda *_: None)
    recipe("{}")
    with pytest.raises(UnusableLog):
        run_recipe(Path("recipe.yaml"), [Path("absent")], RunOptions(out=OUT), lambda *_: None)
    assert not OUT.exists()


def test_a_model_that_cannot_be_read_is_found_before_any_log_is_looked_at(fakes: dict[str, Fake]) -> None:
    Path("old.yaml").write_text("tyre: {}", encoding="utf-8")
    with pytest.raises(BadRecipe, match="unknown key 'tyre': did you mean 'tyres'"):
        go(against=Path("old.yaml"))
    recipe("evaluate: {against: absent.yaml}")
    with pytest.raises(BadRecipe, match=r"absent\.yaml: cannot be read"):
        go()
    assert computed(fakes) == []


def test_two_runs_at_once_on_one_folder_are_refused(fakes: dict[str, Fake]) -> None:
    with locked(OUT), pytest.raises(UsageError, match="another run is writing to out"):
        go()
    assert computed(fakes) == []


def test_the_validation_alone_takes_the_improvement_only_where_it_is_there(fakes: dict[str, Fake]) -> None:
    run_stage("validate", [Path("logs")], RunOptions(out=OUT), lambda *_: None)
    assert list(fakes["validate"].calls[0][1]) == ["steering", "tyres"]
    assert computed(fakes) == ["steering", "tyres", "validate"]
    assert "improve changed" in go().summary
    assert list(fakes["validate"].calls[0][1]) == ["steering", "tyres", "improve"]


def test_with_a_model_nothing_is_identified_and_no_logs_are_needed(fakes: dict[str, Fake]) -> None:
    Path("other.yaml").write_text("schema: ident.model/1\n", encoding="utf-8")
    options = RunOptions(out=OUT, model=Path("other.yaml"))
    run_stage("validate", [], options, lambda *_: None)
    assert computed(fakes) == ["validate"]
    with pytest.raises(UsageError, match="ident validate without LOGS: name logs, or a model"):
        run_stage("validate", [], RunOptions(out=OUT), lambda *_: None)
    with pytest.raises(UsageError, match="ident tyres without LOGS"):
        run_stage("tyres", [], options, lambda *_: None)
