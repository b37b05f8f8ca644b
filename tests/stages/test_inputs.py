"""The settings that every stage shares."""

from pathlib import Path

import pytest

from ident.errors import BadRecipe
from ident.logs import RunPath
from ident.stages.input_files import input_files
from ident.stages.inputs import InputSettings, load, named_runs
from ident.stages.output import Context
from ident.yaml_file import check


def read(**settings):
    return check(InputSettings, settings, "recipe")


def test_what_is_not_said_has_its_default():
    settings = read()
    assert (settings.channels, settings.vehicle, settings.seed) == ("auto", None, 0)
    assert (settings.align.rate, settings.align.max_gap, settings.align.latency) == (100.0, 0.2, {})


def test_quantities_are_read_with_their_units():
    settings = read(align={"rate": "50 Hz", "max_gap": "300 ms", "latency": {"yaw_rate": "0.32 s"}})
    assert (settings.align.rate, settings.align.max_gap) == (50.0, 0.3)
    assert settings.align.latency == {"yaw_rate": 0.32}


@pytest.mark.parametrize("channels", ["auto", Path("a.yaml"), [Path("a.yaml"), Path("b.yaml")]])
def test_channels_are_auto_or_files(channels):
    assert read(channels=channels).channels == channels


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"align": {"rate": "100 m"}}, "unit 'm' does not fit, need a unit of 'Hz'"),
        ({"align": {"rate": 100}}, "no quantity with a unit"),
        ({"align": {"rate": "0 Hz"}}, "is not positive"),
        ({"align": {"max_gap": "-1 s"}}, "is not positive"),
        ({"align": {"max_gaps": "1 s"}}, "did you mean 'max_gap'?"),
        ({"align": {"latency": {"yawrate": "1 s"}}}, "unknown signal 'yawrate': did you mean 'yaw_rate'?"),
        ({"channel": "auto"}, "did you mean 'channels'?"),
        ({"seed": "x"}, "seed"),
        ({"runs": []}, "runs"),
        ({"runs": "manual_*"}, "runs"),
    ],
)
def test_refuses_what_is_wrong_in_one_line(settings, reason):
    with pytest.raises(BadRecipe) as caught:
        read(**settings)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


# --- which runs are read --------------------------------------------------------------------------


def paths(*names):
    return [RunPath(name, Path(name), Path()) for name in names]


def test_all_runs_are_read_unless_some_are_named():
    found = paths("a", "day/b")
    assert named_runs(found, None) == found


def test_a_glob_names_a_run_by_its_whole_name_or_the_last_part_of_it():
    found = paths("a_1", "day/a_2", "day/b")
    assert [run.name for run in named_runs(found, ["a_*"])] == ["a_1", "day/a_2"]
    assert [run.name for run in named_runs(found, ["day/*"])] == ["day/a_2", "day/b"]


def test_globs_that_name_no_run_are_refused_with_the_runs_that_there_are():
    with pytest.raises(BadRecipe) as caught:
        named_runs(paths(*(f"run_{number}" for number in range(12))), ["manual_*", "x"])
    names = ", ".join(f"run_{number}" for number in range(8))
    assert str(caught.value) == f"runs: manual_*, x names no run: the runs are {names} and 4 more"


@pytest.fixture
def three_logs(tmp_path):
    for name in ("good", "other", "third"):
        (tmp_path / f"{name}.csv").write_text("time,value\n0,1\n1,2\n", encoding="utf-8")
    (tmp_path / "other.csv").write_bytes(b"")
    return tmp_path


def test_what_is_not_named_is_not_opened_and_that_is_said(three_logs):
    context = Context(command="test", date="2026-01-01T00:00:00Z")
    some, everything = InputSettings(runs=["good", "t*"]), InputSettings()
    chosen = load([three_logs], some, context)
    assert [run.name for run in chosen.runs] == ["good", "third"]
    assert chosen.unreadable == []
    assert [file.path for file in chosen.files] == ["good.csv", "third.csv"]
    assert chosen.warnings == ["only the runs that the recipe names were read: good, t*"]
    assert [one.what for one in load([three_logs], everything, context).unreadable] == ["other"]


def test_only_the_files_of_the_named_runs_decide_on_a_result(three_logs):
    assert [one.name for one in input_files([three_logs], InputSettings(runs=["third"]))] == ["third.csv"]
    with pytest.raises(BadRecipe, match="runs: fourth names no run"):
        input_files([three_logs], InputSettings(runs=["fourth"]))
