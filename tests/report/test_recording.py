import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import evaluate_case as evaluation
import numpy as np
import pytest
import tyre_case
from rrd import columns, moved, views

from ident.report import evaluated, recording
from ident.report.numbers import shorten
from ident.report.outline import outline, outline_from, outline_of
from ident.report.recording import motion, parts, steering
from ident.report.tyre_signals import by_agreement
from ident.results import Experiment


def write(path, *parts):
    recording.write_recording(path, parts, parts[0].stage)


@pytest.fixture(scope="module")
def written(steering_case, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    write(path, recording.steering_part(*steering_case))
    return path


def test_holds_every_sample_on_the_run_s_own_time(written, steering_case):
    table = steering_case[1]["steering"]
    found = columns(written)
    for run, rows in table.groupby("run"):
        time, values = found[f"{parts.origin('steering', run)}/measured"]
        kept = np.isfinite(values)
        np.testing.assert_allclose(time[kept], rows["time"], atol=1e-9)
        np.testing.assert_allclose(values[kept], rows["measured"])


def test_holds_request_modelled_and_residual_too(written, steering_case):
    tables = steering_case[1]
    found = columns(written)
    assert len(found) == 4 * tables["steering"]["run"].nunique()
    root = parts.origin("steering", "steering_sines_a")
    request = tables["steering_request"].query("run == 'steering_sines_a'")["request"]
    np.testing.assert_allclose(found[f"{root}/request"][1], request)
    rows = tables["steering"].query("run == 'steering_sines_a'")
    for name in ("modelled", "residual"):
        np.testing.assert_allclose(found[f"{root}/{name}"][1], rows[name], equal_nan=True, atol=1e-12)


def test_lifts_the_pen_at_a_gap(written):
    time, values = columns(written)[f"{parts.origin('steering', 'day 1/steering_pulses_a')}/measured"]
    assert time[np.isnan(values)].tolist() == pytest.approx([14.197], abs=0.01)


def test_a_name_from_a_log_is_one_part_of_an_entity_path():
    hostile = "a/b <img>\n\udc80"
    entity = parts.origin("steering", hostile)
    assert entity.count("/") - entity.count("\\/") == 2
    assert parts.origin("tyres", "").removeprefix("/tyres/")


def test_opens_on_the_experiments_steps_and_sines_first(written):
    names = views(written)
    tabs = [name for name in names if name.startswith(("pulse", "sine"))]
    assert len(tabs) == 12
    assert "pulse 0.785 rad at 2.0 s, day 1/steering_pulses_a" in tabs
    assert "sine 3.00 rad/s 0.400 rad at 41.7 s, steering_sines_a" in tabs
    assert {"angle [rad]", "residual [rad]", "result"} <= set(names)


def test_many_experiments_become_tabs_of_their_runs(steering_case, tmp_path):
    result, tables = steering_case
    many = [replace(result.experiments[0], start=2.0 + 0.1 * index) for index in range(50)]
    write(tmp_path / "many.rrd", recording.steering_part(replace(result, experiments=many), tables))
    names = views(tmp_path / "many.rrd")
    assert sum(name.startswith("pulse") for name in names) == parts.MOST_TABS
    assert names.count("whole run") == 1
    assert "steering_sines_a" in names


def test_orders_used_steps_before_sines_before_others():
    kinds = ["other", "sine", "step", "pulse"]
    found = [
        Experiment("a", kind, float(index), index + 1.0, used_by=["x"]) for index, kind in enumerate(kinds)
    ]
    unused = replace(found[2], used_by=[])
    order = [experiment.kind for experiment in steering.ordered([unused, *found])]
    assert order == ["step", "pulse", "sine", "other", "step"]


def test_the_range_shown_holds_all_finite_values():
    assert parts.value_range([np.array([np.nan, 1.0]), np.array([3.0])]) == pytest.approx((0.88, 3.12))
    assert parts.value_range([np.array([np.nan])]) == (-1.0, 1.0)
    low, high = parts.value_range([np.zeros(3)])
    assert low < 0 < high


def test_the_same_run_gives_the_same_recording_name(steering_case):
    provenance = steering_case[0].provenance
    assert recording.recording_id(provenance) == recording.recording_id(
        replace(provenance, date="another day")
    )
    assert recording.recording_id(provenance) != recording.recording_id(replace(provenance, command="other"))


def test_a_result_without_experiments_is_recorded(steering_case, tmp_path):
    result, tables = steering_case
    path = tmp_path / "none.rrd"
    empty = {name: table.iloc[:0] for name, table in tables.items()}
    write(path, recording.steering_part(replace(result, experiments=[]), tables))
    write(tmp_path / "empty.rrd", recording.steering_part(replace(result, experiments=[]), empty))
    assert {"steering_sines_a", "result"} <= set(views(path))
    assert views(tmp_path / "empty.rrd") == ["result"]


# --- tyres -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def driven(tyres_case, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    write(path, recording.tyres_part(*tyres_case))
    return path


def test_the_truck_drives_where_it_was_measured(driven, tyres_case):
    for run, rows in tyres_case[1]["tyres"].groupby("run"):
        known = rows.dropna(subset="position_x")
        start = known.iloc[0]
        time, place, heading = moved(driven, f"{parts.origin('tyres', run)}/truck/measured")
        assert np.diff(time).mean() == pytest.approx(motion.POSE_PERIOD, rel=0.01)
        at = np.searchsorted(known["time"], time)
        for axis, signal in enumerate(("position_x", "position_y")):
            expected = known[signal].to_numpy()[at] - start[signal]
            np.testing.assert_allclose(place[:, axis], expected, atol=1e-4)
        np.testing.assert_allclose(heading, known["heading"].to_numpy()[at], atol=1e-5)


def test_the_truck_stands_at_its_first_known_place_until_then(tyres_case, tmp_path):
    result, tables = tyres_case
    run = tyre_case.RUNS[0]
    table = tables["tyres"].copy()
    table.loc[table["time"] < 3.0, ["position_x", "position_y"]] = np.nan
    write(tmp_path / "late.rrd", recording.tyres_part(result, {"tyres": table}))
    time, place, _ = moved(tmp_path / "late.rrd", f"{parts.origin('tyres', run)}/truck/measured")
    assert time[0] == 0.0
    assert time[1] > 3.0
    assert place[0].tolist() == [0.0, 0.0, 0.0]


def test_windows_are_joined_where_no_position_tells_where_they_begin(tyres_case, tmp_path):
    result, tables = tyres_case
    run = tyre_case.RUNS[0]
    table = tables["tyres"].copy()
    begins = table.groupby(["run", "window"])["position_x_model"].transform("first")
    table = table.assign(
        position_x=np.nan, position_y=np.nan, position_x_model=table["position_x_model"] - begins
    )
    write(tmp_path / "a.rrd", recording.tyres_part(result, {"tyres": table}))
    time, place, _ = moved(tmp_path / "a.rrd", f"{parts.origin('tyres', run)}/truck/modelled")
    steps = np.diff(place[:, 0]) / np.diff(time)
    assert steps.min() > 2.0
    assert steps.max() < 11.0


def test_the_simulated_truck_is_counted_from_the_same_place(driven, tyres_case):
    run = tyre_case.RUNS[0]
    rows = tyres_case[1]["tyres"].query("run == @run")
    _, place, _ = moved(driven, f"{parts.origin('tyres', run)}/truck/modelled")
    first = rows["position_x_model"].iloc[0] - rows["position_x"].dropna().iloc[0]
    assert place[0, 0] == pytest.approx(first, abs=1e-5)


def test_the_front_wheels_turn_with_the_steering_at_their_own_places(driven, tyres_case):
    run = tyre_case.RUNS[0]
    rows = tyres_case[1]["tyres"].query("run == @run")
    time, place, angle = moved(driven, f"{parts.origin('tyres', run)}/truck/measured/front_left")
    np.testing.assert_allclose(angle, np.interp(time, rows["time"], rows["road_wheel_angle"]), atol=1e-5)
    front_of_rear_axle = tyre_case.FRONT + tyre_case.REAR
    np.testing.assert_allclose(place, np.tile([front_of_rear_axle, 1.0, 0.0], (time.size, 1)), atol=1e-5)


def test_every_signal_is_there_measured_simulated_and_what_is_left(driven, tyres_case):
    found = columns(driven)
    for run, rows in tyres_case[1]["tyres"].groupby("run"):
        root = parts.origin("tyres", run)
        known = rows.dropna(subset="lateral_velocity")
        for role, expected in (
            ("measured", known["lateral_velocity"]),
            ("residual", known["lateral_velocity"] - known["lateral_velocity_model"]),
        ):
            values = found[f"{root}/lateral_velocity/{role}"][1]
            np.testing.assert_allclose(values[np.isfinite(values)], expected)
        assert np.isnan(found[f"{root}/yaw_rate/modelled"][1]).sum() == rows["window"].nunique() - 1


def test_opens_on_the_run_that_the_model_follows_worst(driven, tyres_case):
    tabs = [tab.name for tab in recording.tyres_part(*tyres_case).tabs]
    assert tabs == [shorten(run, 40) for run in by_agreement(tyres_case[0], tyre_case.RUNS)[::-1]]
    shown = {*tabs, "path", "truck", "yaw rate [rad/s]", "residual [rad/s]", "result"}
    assert shown <= set(views(driven))


def test_a_log_without_positions_is_recorded_without_a_path(tyres_case, tmp_path):
    result, tables = tyres_case
    kept = ("run", "window", "time", "yaw_rate", "yaw_rate_model", "road_wheel_angle", "speed")
    write(tmp_path / "a.rrd", recording.tyres_part(result, {"tyres": tables["tyres"][[*kept]]}))
    assert "path" not in views(tmp_path / "a.rrd")
    assert "yaw rate [rad/s]" in views(tmp_path / "a.rrd")
    write(tmp_path / "b.rrd", recording.tyres_part(result, {"tyres": tables["tyres"].iloc[:0]}))
    assert views(tmp_path / "b.rrd") == ["result"]


def test_several_stages_have_a_tab_each(steering_case, tyres_case, tmp_path):
    both = [recording.steering_part(*steering_case), recording.tyres_part(*tyres_case)]
    recording.write_recording(tmp_path / "both.rrd", both, "tyres")
    assert {"Steering", "Tyres"} <= set(views(tmp_path / "both.rrd"))
    roots = {entity.split("/")[1] for entity in columns(tmp_path / "both.rrd")}
    assert roots == {"steering", "tyres"}


def test_an_outline_has_its_axles_where_they_are():
    drawn = outline(front=2.4, rear=2.1, reference_x=-2.1)
    assert drawn.front_wheels.tolist() == [[4.5, -1.0], [4.5, 1.0]]
    body, _, right, left = drawn.body
    assert body[:, 0].min() < -0.5
    assert body[:, 0].max() > 5.0
    middles = [(wheel.min(axis=0) + wheel.max(axis=0)) / 2 for wheel in (right, left)]
    np.testing.assert_allclose(middles, [[0.0, -1.0], [0.0, 1.0]], atol=1e-12)


def test_a_car_is_smaller_than_a_truck():
    truck, car = outline(front=2.4, rear=2.1, reference_x=0.0), outline(front=1.3, rear=1.2, reference_x=0.0)
    width, narrow = (np.ptp(drawn.body[0][:, 1]) for drawn in (truck, car))
    assert width == pytest.approx(2.5)
    assert narrow < 1.9


def test_the_outline_stands_about_the_cg_where_nothing_tells_another_point(tyres_case):
    result = replace(tyres_case[0], fixed={}, by_run=[])
    assert outline_of(result, "any").front_wheels[0, 0] == 2.3
    assert outline_of(tyres_case[0], tyre_case.RUNS[0]).front_wheels[0, 0] == pytest.approx(4.5)


# --- evaluation ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def predicted(evaluate_case, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    write(path, recording.evaluate_part(*evaluate_case))
    return path


def test_each_model_has_a_ghost_that_drives_where_it_was_simulated(predicted, evaluate_case):
    run = evaluation.RUNS[0]
    rows = evaluate_case[1]["evaluate"].query("run == @run")
    for way, ending in (
        ("measured", ""),
        ("kinematic", "__kinematic"),
        ("brush__request", "__brush__request"),
    ):
        time, place, heading = moved(predicted, f"{parts.origin('evaluate', run)}/truck/{way}")
        at = np.searchsorted(rows["time"], time - 1e-9)
        for axis, signal in enumerate(("position_x", "position_y")):
            expected = rows[f"{signal}{ending}"].to_numpy()[at] - rows[signal].iloc[0]
            np.testing.assert_allclose(place[:, axis], expected, atol=1e-4)
        np.testing.assert_allclose(heading, rows[f"heading{ending}"].to_numpy()[at], atol=1e-5)


def test_the_residual_of_every_model_is_there(predicted, evaluate_case):
    found = columns(predicted)
    for run, rows in evaluate_case[1]["evaluate"].groupby("run"):
        root = parts.origin("evaluate", run)
        for model in evaluation.MODELS:
            values = found[f"{root}/yaw_rate/residual/{model}"][1]
            np.testing.assert_allclose(values, rows["yaw_rate"] - rows[f"yaw_rate__{model}"])
        assert f"{root}/yaw_rate/brush" in found
        assert f"{root}/road_wheel_angle/residual/linear" not in found


def test_the_evaluation_opens_on_the_run_that_is_followed_worst(predicted, evaluate_case):
    result, tables = evaluate_case
    ranked = evaluated.by_agreement(result, evaluation.RUNS)
    tabs = [tab.name for tab in recording.evaluate_part(result, tables).tabs]
    assert tabs == [shorten(run, 40) for run in ranked[::-1]]
    assert {"path", "truck", "yaw rate [rad/s]", "yaw rate, residual [rad/s]", "result"} <= set(
        views(predicted)
    )


def test_an_evaluation_of_nothing_is_recorded(evaluate_case, tmp_path):
    result, tables = evaluate_case
    write(tmp_path / "a.rrd", recording.evaluate_part(replace(result, models=[], chosen=None), {}))
    assert views(tmp_path / "a.rrd") == ["result"]
    kept = tables["evaluate"][["run", "time", "speed", "yaw_rate", "yaw_rate__linear"]]
    write(tmp_path / "b.rrd", recording.evaluate_part(result, {"evaluate": kept}))
    assert "path" not in views(tmp_path / "b.rrd")
    assert "yaw rate, residual [rad/s]" in views(tmp_path / "b.rrd")


def test_the_truck_of_an_evaluation_has_its_axles_where_they_are():
    known = {"cg_to_front_axle": 2.4, "cg_to_rear_axle": 2.1, "reference_x": -2.1}
    assert outline_from(known).front_wheels[0, 0] == pytest.approx(4.5)
    assert outline_from({}).front_wheels[0, 0] == 2.3


# --- improvement -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bettered(improve_cases, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    write(path, recording.improve_part(*improve_cases["named"]))
    return path


def test_the_residual_is_there_before_and_after_with_when_the_effect_acts(bettered, improve_cases):
    found = columns(bettered)
    for run, rows in improve_cases["named"][1]["improve"].groupby("run"):
        root = parts.origin("improve", run)
        for way in ("before", "after"):
            known = rows.dropna(subset="lateral_velocity_measured")
            values = found[f"{root}/lateral_velocity/residual/{way}"][1]
            expected = known["lateral_velocity_measured"] - known[f"lateral_velocity_{way}"]
            np.testing.assert_allclose(values[np.isfinite(values)], expected)
            np.testing.assert_allclose(found[f"{root}/yaw_rate/{way}"][1], rows[f"yaw_rate_{way}"])
        np.testing.assert_allclose(found[f"{root}/activity"][1], rows["activity"])


def test_the_improvement_opens_on_the_run_in_which_the_effect_acts_most(bettered, improve_cases):
    result, tables = improve_cases["named"]
    mean = tables["improve"].groupby("run")["activity"].mean().sort_values(ascending=False)
    tabs = [tab.name for tab in recording.improve_part(result, tables).tabs]
    assert tabs == [shorten(run, 40) for run in mean.index]
    shown = {*tabs, "yaw rate [rad/s]", "yaw rate, residual [rad/s]", "effect acts [–]", "result"}
    assert shown <= set(views(bettered))


@pytest.mark.parametrize("case", ["adequate", "actuator", "sensors"])
def test_an_improvement_of_little_is_recorded(improve_cases, tmp_path, case):
    write(tmp_path / "a.rrd", recording.improve_part(*improve_cases[case]))
    found = views(tmp_path / "a.rrd")
    assert ("effect acts [–]" in found) is (case == "actuator")
    assert (found == ["result"]) is (case == "sensors")


@pytest.mark.parametrize("name", ["written", "driven", "predicted", "bettered"])
def test_rerun_itself_accepts_the_file(name, request):
    tool = Path(sys.executable).with_name("rerun")
    if not tool.exists():
        pytest.skip(f"the rerun program is not beside {sys.executable}")
    done = subprocess.run(
        [tool, "rrd", "verify", request.getfixturevalue(name)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "1 file verified without error" in done.stdout + done.stderr
