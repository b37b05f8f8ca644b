from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.errors import BadRecipe, NotIdentifiable
from ident.experiments.motion import Measurement, MotionRun, MotionWindow
from ident.experiments.splits import GUARD
from ident.results import TyresResult
from ident.signals.run import LoadedLogs, Run, Signal
from ident.stages.inputs import AlignSettings, InputSettings, SplitSettings, load, named
from ident.stages.output import Context
from ident.stages.split import drawn_split
from ident.stages.split_motion import Side, split_motion, takes_part
from ident.stages.tyre_data import TyreData, tyre_data
from ident.stages.tyre_settings import TyresSettings
from ident.stages.tyres import tyres
from ident.yaml_file import check

PLANAR = Path(__file__).parents[2] / "sample_logs" / "planar"
SHORTEST = 3.0


def context() -> Context:
    return Context("test", "2026-01-01T00:00:00Z", 1)


@pytest.fixture(scope="module")
def loaded() -> LoadedLogs:
    return load([PLANAR], InputSettings(), context())


def gathered(loaded: LoadedLogs, split: SplitSettings, side: Side = "training") -> TyreData:
    return tyre_data(loaded, AlignSettings(), None, SHORTEST, split=split, side=side)


def spans(data: TyreData) -> list[tuple[float, float]]:
    return [(float(record.times[0]), float(record.times[-1])) for record in data.records]


# --- what is said ----------------------------------------------------------------------------------


def test_a_recipe_names_runs_by_globs_and_blocks_by_quantities() -> None:
    split = check(SplitSettings, {"held_out": ["*_c"], "blocks": {"a": ["1 s", "0.5 min"]}}, "recipe")
    assert split.holds_out("day/planar_c")
    assert not split.holds_out("planar_a")
    assert split.block_of("a") == (1.0, 30.0)
    assert split.is_stated
    assert not SplitSettings().is_stated


@pytest.mark.parametrize(
    ("bad", "told"),
    [
        ({"held_out": []}, "held_out: list should have at least 1 item"),
        ({"share": 0}, "share: input should be greater than 0"),
        ({"share": 1}, "share: input should be less than 1"),
        ({"blocks": {"a": [1, 2]}}, "blocks.a.0: '1' is no quantity with a unit"),
        ({"held": ["a"]}, "unknown key 'held': did you mean 'held_out'"),
    ],
)
def test_refuses_a_split_without_meaning(bad: dict[str, object], told: str) -> None:
    with pytest.raises(BadRecipe, match=re.escape(told)):
        check(SplitSettings, bad, "recipe")


def test_says_how_it_splits() -> None:
    assert SplitSettings().by == "none"
    assert SplitSettings(held_out=["a"]).by == "run"
    assert (
        SplitSettings.from_stored({"held_out": None, "blocks": {"a": [1.0, 2.0]}, "share": 0.3}).by == "block"
    )


def test_what_was_stored_is_the_same_split() -> None:
    split = SplitSettings().model_copy(update={"blocks": {"a": (1.0, 2.5)}})
    assert SplitSettings.from_stored(split.model_dump(mode="json")) == split


def test_globs_match_a_name_or_its_last_part() -> None:
    assert named("day/run_a", ["run_?"])
    assert named("day/run_a", ["day/*"])
    assert not named("day/run_a", ["day"])


# --- what lies on which side -------------------------------------------------------------------------


def a_run(name: str = "run") -> MotionRun:
    times = np.arange(3001) / 100
    turn = Measurement("yaw_rate", times[::5] + 0.001, 2 * (times[::5] + 0.001))
    return MotionRun(
        name, [MotionWindow(times, times, times + 10, {"yaw_rate": turn})], 0.0, (0.0, 0.0), [], "s", "v"
    )


@pytest.mark.parametrize("block", [(20.0, 30.0), (10.0, 15.0), (0.0, 8.0)])
def test_a_block_and_its_guard_take_no_part_in_the_training(block: tuple[float, float]) -> None:
    split = SplitSettings().model_copy(update={"blocks": {"run": block}})
    held_out = split_motion(a_run(), split, "held_out", SHORTEST).windows
    training = split_motion(a_run(), split, "training", SHORTEST).windows
    assert [(one.times[0], one.times[-1]) for one in held_out] == [pytest.approx(block)]
    for window in training:
        assert window.times[-1] <= block[0] - GUARD or window.times[0] >= block[1] + GUARD
        assert window.times[-1] - window.times[0] >= SHORTEST
    seconds = sum(one.times[-1] - one.times[0] for one in training)
    assert seconds == pytest.approx(30 - (block[1] - block[0]) - GUARD * (2 if 0 < block[0] < 20 else 1))


def test_measurements_stay_within_the_grid_of_their_window() -> None:
    split = SplitSettings().model_copy(update={"blocks": {"run": (10.0, 20.0)}})
    for side in ("training", "held_out"):
        for window in split_motion(a_run(), split, side, SHORTEST).windows:
            turn = window.measurements["yaw_rate"]
            assert window.times[0] <= turn.times[0] <= turn.times[-1] <= window.times[-1]
            np.testing.assert_array_equal(turn.values, 2 * turn.times)
            np.testing.assert_array_equal(window.speed, window.times + 10)


def test_what_is_left_of_a_window_is_dropped_where_it_is_short() -> None:
    split = SplitSettings().model_copy(update={"blocks": {"run": (4.0, 29.0)}})
    assert split_motion(a_run(), split, "training", SHORTEST).windows == []


def test_runs_without_a_block_are_on_one_side_whole() -> None:
    split = SplitSettings(held_out=["b"])
    assert [takes_part(name, split, "training") for name in "ab"] == [True, False]
    assert [takes_part(name, split, "held_out") for name in "ab"] == [False, True]
    one = a_run()
    assert split_motion(one, split, "training", SHORTEST) is one


# --- on logs -------------------------------------------------------------------------------------------


def test_the_fit_sees_no_run_that_is_held_out(loaded: LoadedLogs) -> None:
    data = gathered(loaded, SplitSettings(held_out=["*_b"]))
    assert [run.name for run in data.runs] == ["planar_a", "planar_c"]
    assert ("planar_b", "held out for the evaluation") in [(one.what, one.reason) for one in data.left_out]
    assert [run.name for run in gathered(loaded, SplitSettings(held_out=["*_b"]), "held_out").runs] == [
        "planar_b"
    ]


def test_both_sides_of_blocks_hold_all_of_a_run_but_the_guard(loaded: LoadedLogs) -> None:
    split = SplitSettings().model_copy(update={"blocks": {"planar_a": (40.0, 60.0)}})
    whole = spans(gathered(loaded, SplitSettings()))
    training, held_out = (spans(gathered(loaded, split, side)) for side in ("training", "held_out"))
    assert len(held_out) == 1
    assert held_out[0][0] == pytest.approx(40.0)
    assert training[0][1] == pytest.approx(40.0 - GUARD)
    assert training[1:] == whole[1:]


def test_refuses_a_split_that_leaves_nothing_to_fit(loaded: LoadedLogs) -> None:
    with pytest.raises(NotIdentifiable, match="the split leaves no run: each is held out for the evaluation"):
        gathered(loaded, SplitSettings(held_out=["*"]))


def test_draws_one_of_three_repeats_by_the_seed() -> None:
    drawn = {
        tuple(drawn_split([PLANAR], InputSettings(seed=seed), TyresSettings(), context()).held_out or [])
        for seed in range(4)
    }
    assert all(len(names) == 1 and names[0].startswith("planar_") for names in drawn)
    assert len(drawn) > 1


def test_draws_among_the_runs_that_the_tyres_use() -> None:
    settings = TyresSettings(runs=["planar_[ab]"])
    split = drawn_split([PLANAR], InputSettings(), settings, context())
    assert split.held_out is None
    assert sorted(split.blocks or {}) == ["planar_a", "planar_b"]


def test_few_runs_are_split_in_time(tmp_path: Path) -> None:
    shutil.copytree(PLANAR / "planar_a", tmp_path / "[odd] name")
    shutil.copy(PLANAR / "vehicle.yaml", tmp_path)
    shutil.copy(PLANAR.parent / "channels.yaml", tmp_path)
    split = drawn_split([tmp_path], InputSettings(), TyresSettings(), context())
    assert split.by == "block"
    begin, end = split.block_of("[odd] name") or (0.0, 0.0)
    assert end - begin == pytest.approx(20.0, abs=0.2)


def test_a_run_that_drives_straight_is_never_what_a_model_is_judged_by(
    loaded: LoadedLogs, monkeypatch: pytest.MonkeyPatch
) -> None:
    straight = "planar_b"
    turns = [replace(run, signals=_without_turn(run)) if run.name == straight else run for run in loaded.runs]
    monkeypatch.setattr("ident.stages.split.load", lambda *_: replace(loaded, runs=turns))
    split = drawn_split([PLANAR], InputSettings(), TyresSettings(), context())
    assert sorted(split.blocks or {}) == ["planar_a", "planar_c"]


def _without_turn(run: Run) -> dict[str, Signal]:
    speed = run.signals["speed"]
    rate = run.signals["yaw_rate"]
    angle = {n: one for n, one in run.signals.items() if n.endswith("_angle")}
    still = {name: replace(one, values=0 * one.values) for name, one in angle.items()}
    return {"speed": speed, "yaw_rate": replace(rate, values=1e-3 * np.sin(rate.time)), **still}


def test_nothing_is_drawn_where_nothing_turns() -> None:
    steering = PLANAR.parent / "steering_pulses_a"
    assert not drawn_split([steering], InputSettings(), TyresSettings(), context()).is_stated


def test_the_tyre_stage_keeps_to_the_split() -> None:
    inputs = InputSettings(split=SplitSettings(held_out=["planar_a"]))
    result: TyresResult = tyres([PLANAR], inputs, TyresSettings(kinds=["linear"]), context()).result
    assert [run.run for run in result.by_run if run.used] == ["planar_b", "planar_c"]
    assert "held out for the evaluation" in {one.reason for one in result.refused if one.what == "planar_a"}
