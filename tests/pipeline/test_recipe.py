from __future__ import annotations

from pathlib import Path

import pytest

from ident.errors import BadRecipe, UsageError
from ident.logs import find_runs
from ident.pipeline.options import RunOptions
from ident.pipeline.recipe import Recipe, recipe_for
from ident.signals.applied import nearest_file
from ident.stages.inputs import InputSettings, named_runs

ROOT = Path(__file__).parents[2]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "truck").mkdir()
    return tmp_path


def read(folder: Path, text: str, **options: object) -> Recipe:
    path = folder / "truck" / "recipe.yaml"
    path.write_text(text, encoding="utf-8")
    return recipe_for(RunOptions(recipe=path, **options))


def problem(folder: Path, text: str) -> str:
    with pytest.raises(BadRecipe) as raised:
        read(folder, text)
    message = str(raised.value)
    assert message.startswith(f"{folder / 'truck' / 'recipe.yaml'}: ")
    assert "\n" not in message
    return message.partition("recipe.yaml: ")[2]


def test_without_a_recipe_all_is_as_the_stages_have_it() -> None:
    assert recipe_for(RunOptions()) == Recipe()
    assert recipe_for(RunOptions()).inputs() == InputSettings()


def test_paths_are_relative_to_the_recipe(folder: Path) -> None:
    recipe = read(folder, "vehicle: v.yaml\nchannels: ../c.yaml\n")
    assert recipe.vehicle == folder / "truck" / "v.yaml"
    assert recipe.channels == folder / "truck" / "../c.yaml"
    listed = read(folder, f"channels: [a.yaml, {folder / 'b.yaml'}]\n")
    assert listed.channels == [folder / "truck" / "a.yaml", folder / "b.yaml"]
    assert read(folder, "channels: auto\n").channels == "auto"


def test_options_come_before_the_recipe_and_their_paths_are_relative_to_the_current_folder(
    folder: Path,
) -> None:
    text = "vehicle: v.yaml\nchannels: c.yaml\nseed: 1\nalign: {rate: 50 Hz}\n"
    recipe = read(folder, text, vehicle=Path("w.yaml"), channels=("d.yaml", "e.yaml"))
    assert recipe.vehicle == Path("w.yaml")
    assert recipe.channels == [Path("d.yaml"), Path("e.yaml")]
    assert (recipe.seed, recipe.align.rate) == (1, 50.0)
    assert read(folder, text, channels=("auto",)).channels == "auto"
    with pytest.raises(UsageError, match="--channels auto with 1 more"):
        recipe_for(RunOptions(channels=("auto", "c.yaml")))


def test_the_inputs_are_those_of_the_recipe(folder: Path) -> None:
    text = "seed: 3\nalign: {max_gap: 100 ms, latency: {yaw_rate: 0.3 s}}\n"
    inputs = read(folder, text).inputs()
    assert type(inputs) is InputSettings
    assert (inputs.seed, inputs.align.max_gap, inputs.align.latency) == (3, 0.1, {"yaw_rate": 0.3})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("sede: 1", "unknown key 'sede': did you mean 'seed'?"),
        ("align: {rat: 1 Hz}", "unknown key 'align.rat': did you mean 'rate'?"),
        ("steering: {nonsense: 1}", "unknown key 'steering.nonsense': "),
        ("align: {rate: 1 s}", "align.rate: unit 's' does not fit"),
        ("align: {rate: 100}", "align.rate: '100' is no quantity with a unit, need such as '1 Hz'"),
        (
            "improve: {effects: [tyre_relaxatoin]}",
            "improve.effects: unknown effect 'tyre_relaxatoin': did you mean 'tyre_relaxation'?",
        ),
        (
            "improve: {level: 0.001, draws: 500}",
            "improve: level 0.001 with 500 draws: no p-value can be below 1/501, need draws: 1000 or more",
        ),
        ("seed: one", "seed: input should be a valid integer"),
        ("steering: 5", "steering: input should be"),
        ("channels: 5", "channels: input should be"),
        ("vehicle: [a]", "vehicle: input is not a valid path"),
        ("seed: 1\nseed: 2", "line 2: is not YAML: found duplicate key"),
    ],
)
def test_says_where_a_recipe_is_wrong_and_what_is_needed(folder: Path, text: str, expected: str) -> None:
    assert problem(folder, text).startswith(expected)


def test_a_recipe_that_does_not_exist_is_a_bad_recipe() -> None:
    with pytest.raises(BadRecipe, match=r"none\.yaml: cannot be read: No such file"):
        recipe_for(RunOptions(recipe=Path("none.yaml")))


def test_the_recipe_of_the_sample_logs_is_right_and_its_files_exist() -> None:
    recipe = recipe_for(RunOptions(recipe=ROOT / "pipelines" / "truck.yaml"))
    assert isinstance(recipe.channels, Path)
    assert recipe.channels.is_file()
    assert recipe.vehicle is not None
    assert recipe.vehicle.is_file()


def test_the_recipe_of_the_sample_logs_reads_the_runs_of_one_truck_all_of_them() -> None:
    """Its vehicle file is taken for that of every run, so no run may have another."""
    recipe = recipe_for(RunOptions(recipe=ROOT / "pipelines" / "truck.yaml"))
    found = find_runs([ROOT / "sample_logs"])
    chosen = named_runs(found, recipe.runs)
    assert {nearest_file(run, "vehicle.yaml") for run in chosen} == {ROOT / "sample_logs" / "vehicle.yaml"}
    others = [run for run in found if run not in chosen]
    assert {run.name.partition("/")[0] for run in others} == {"planar", "undeclared"}
    assert all(nearest_file(run, "vehicle.yaml").parent.name != "sample_logs" for run in others)
