from dataclasses import replace
from typing import get_args

import numpy as np
import pandas as pd
import pytest
import validated_case as validation
from hypothesis import given
from hypothesis import strategies as st

from ident.glossary import CONTROLLERS, controller_name
from ident.report import validated, validated_runs
from ident.report.validate_summary import describe_validate
from ident.results.validate import Cell, Claim, ControllerName, Score


@pytest.fixture(scope="module")
def result():
    return validation.case()[0]


@pytest.fixture(scope="module")
def tables():
    return validation.case()[1]


def test_every_controller_and_scenario_of_the_contract_has_a_name_and_a_style():
    names = get_args(ControllerName)
    assert list(CONTROLLERS) == list(names)
    assert len(set(CONTROLLERS.values())) == len(names)
    for name in names:
        assert controller_name(name) != name
        assert validated.style_of(name) == validated.STYLES[name]
    assert list(validated.SHORT_SCENARIOS) == list(validated.SCENARIOS)
    assert len(set(validated.STYLES.values())) == len(names)


def test_what_is_not_known_keeps_its_own_name():
    assert controller_name("my_law") == "my law"
    assert validated.scenario_name("u_turn") == "u turn"
    assert validated.mismatch_name("front.stiffness") == "front, stiffness"
    assert validated.style_of("my_law") == ("muted", "dot")
    assert validated.measure_of("roll_rate_max", "rad/s").head == "roll rate max [mrad/s]"
    assert validated.measure_of("roll_rate_max", "rad/s").shown(0.25) == "250"


def test_a_model_is_named_with_its_effects():
    assert validated.simulated_name("magic_formula") == "Magic Formula"
    named = validated.simulated_name("linear+tyre_relaxation+sensor_bias yaw_rate")
    assert named == "linear + tyre relaxation + sensor bias of the yaw rate"


@pytest.mark.parametrize(
    ("value", "places", "text"),
    [
        (0.28913, 3, "0.289"),
        (0.000015, 1, "0.0"),
        (0.0144, 2, "0.01"),
        (99.24, 2, "99.2"),
        (-24.91, 1, "−24.9"),
    ],
)
def test_a_number_is_rounded_to_what_can_be_seen(value, places, text):
    assert validated.rounded(value, places) == text


@given(st.floats(-1e5, 1e5), st.integers(1, 3))
def test_rounding_never_moves_a_number_by_more_than_its_last_digit(value, places):
    text = validated.rounded(value, places).replace("−", "-")
    assert abs(float(text) - value) <= max(0.5 * 10.0**-places, abs(value) * 0.005) * (1 + 1e-9)


def test_an_interval_that_cannot_be_seen_is_not_shown():
    shown = validated.shown_range
    assert shown(Score("lateral_error_max", 0.3, 0.2, 0.4, "m")) == "0.200 … 0.400"
    assert shown(Score("lateral_error_max", 0.3, 0.30001, 0.30002, "m")) is None
    assert shown(Score("lateral_error_max", 0.3, None, None, "m")) is None
    assert shown(None) is None


def test_a_score_that_is_no_number_is_none():
    cell = Cell("pid", "logged", 1, 0, [Score("lateral_error_max", float("nan"), None, None, "m")])
    assert validated.score_of(cell, "lateral_error_max") is None
    assert validated.score_of(None, "lateral_error_max") is None
    assert validated.shown_score(None) == "–"


def test_nobody_is_best_where_too_few_starts_give_no_interval():
    sizes = [Score("lateral_error_rms", 0.3, None, None, "m"), Score("lateral_error_max", 0.3, 0.2, 0.4, "m")]
    cell = Cell("pid", "logged", 2, 2, sizes, ["lateral_error_rms", "lateral_error_max", "braking_work"])
    assert not validated.is_best(cell, "lateral_error_rms")
    assert validated.is_best(cell, "lateral_error_max")
    assert not validated.is_best(cell, "braking_work")


@pytest.mark.parametrize(
    ("runs", "completed", "text"),
    [(5, 5, "all 5"), (1, 1, "yes"), (5, 4, "✗\u00a01 of 5 lost"), (5, 0, "✗\u00a0all 5 lost")],
)
def test_lost_runs_are_counted(runs, completed, text):
    assert validated.completed_text(Cell("pid", "logged", runs, completed, [])) == text


@pytest.mark.parametrize(
    ("completed", "text"), [(1.0, ""), (0.999, "1\u00a0% lost"), (0.8, "20\u00a0% lost"), (0.0, "all lost")]
)
def test_a_share_that_was_lost_is_never_rounded_away(completed, text):
    assert validated.lost_share(completed) == text


def test_a_run_is_named_by_what_was_disturbed(result):
    run = replace(
        result.runs[0],
        disturbance={
            "heading_error": np.deg2rad(-3.0),
            "mass": 0.3,
            "dead_time": 0.1,
            "friction": 0.4,
            "speed": 0.0,
        },
        simulation_model="linear",
    )
    title = validated.run_title(run).replace("\u00a0", " ")
    assert title == (
        "PID, single lane change at 80 km/h, heading error at the start −3.0°, mass +30 %, "
        "dead time +0.10 s, friction 0.40, simulated as linear"
    )
    assert "undisturbed" in validated.run_title(replace(run, disturbance={}))


def test_the_best_is_told_first_and_nobody_is_left_out(result):
    names = validated.controllers_of(replace(result, ranking=["lqr", "pid"]))
    assert names[:2] == ["lqr", "pid"]
    assert sorted(names) == sorted(validation.LAWS)


@pytest.mark.parametrize(
    ("change", "badge"),
    [
        ({}, "holds"),
        ({"ranking": ["stanley"]}, "path lost"),
        ({"ranking": ["pid"]}, "margin lost"),
        ({"ranking": ["pid"], "margins": []}, "holds, within limits"),
        ({"reached": 2}, "holds in simulation"),
        ({"reached": None}, "holds in simulation"),
        ({"ranking": []}, "nothing ranked"),
    ],
)
def test_the_badge_is_that_of_the_best_controller(result, change, badge):
    assert validated.verdict_badge(replace(result, **change))[0] == badge


def test_undecided_claims_come_last():
    claims = [Claim("a", "undecided", ""), Claim("b", "no", ""), Claim("c", "yes", "")]
    assert [one.claim for one in validated.by_claim(claims)] == ["b", "c", "a"]


def test_levels_are_told_run_by_run_from_below(result):
    found = validated.levels_by_run(result.logged[::-1])
    assert list(found) == validation.LOGGED_RUNS[::-1]
    assert [one.level for one in found["day 1/path_a"]] == [0, 1, 2, 2, 3]


def test_the_worst_run_is_opened_first_and_runs_from_one_start_stand_together(result, tables):
    found = validated_runs.opened(result, tables)
    assert next(iter(found)) == result.worst
    starts = validated_runs.starts(result, found)
    assert [len(one.runs) for one in starts] == [9, 9]
    assert result.worst in starts[0].runs
    for one in starts:
        assert len({tuple(result.runs[index].disturbance.items()) for index in one.runs}) == 1


def test_runs_that_the_result_does_not_know_are_left_out(result, tables):
    strange = {
        "validate": pd.concat([tables["validate"].assign(run=10_000), tables["validate"].assign(run=-1)])
    }
    assert validated_runs.opened(result, strange) == {}
    assert validated_runs.opened(result, {}) == {}


def test_the_reference_is_that_of_scenario_speed_and_logged_run(result, tables):
    run = result.runs[result.worst]
    path = validated_runs.reference_of(tables, run)
    s, x, y, _, _ = validation.path_of(run.scenario)
    np.testing.assert_allclose(path.arc_length, s)
    np.testing.assert_allclose((path.x, path.y), (x, y))
    assert validated_runs.reference_of(tables, replace(run, speed=run.speed + 1.0)) is None
    assert validated_runs.reference_of({}, run) is None
    other = tables["validate_reference"].query("scenario == @run.scenario").assign(scenario="logged", run="b")
    logged = {
        "validate_reference": pd.concat([tables["validate_reference"], other.assign(run="a", x=0.0), other])
    }
    own = replace(run, scenario="logged", scenario_run="b", speed=3.0)
    np.testing.assert_allclose(validated_runs.reference_of(logged, own).x, x)


def test_the_lane_is_as_wide_everywhere_across_the_path():
    heading = np.linspace(0.0, np.pi, 40)
    circle = validated_runs.Path(
        20.0 * np.sin(heading), -20.0 * np.cos(heading), heading, 20.0 * heading, 0 * heading
    )
    left, right = validated_runs.lane_edges(circle, 1.75)
    np.testing.assert_allclose(np.hypot(*left.T), 18.25)
    np.testing.assert_allclose(np.hypot(*right.T), 21.75)
    x, y = validated_runs.lane_outline(circle, 1.75)
    assert (x[0], y[0]) == (x[-1], y[-1])


def test_horizons_are_those_of_the_run_in_time(result, tables):
    shuffled = {"validate_horizon": tables["validate_horizon"].sample(frac=1.0, random_state=1)}
    found = validated_runs.horizons(shuffled, result.worst)
    assert list(found) == sorted(found)
    steps = tables["validate_horizon"].query("time == 1.0")
    np.testing.assert_allclose(found[1.0], steps[["x", "y"]])
    assert validated_runs.horizons(tables, result.worst + 1) == {}
    drawn = validated_runs.some_horizons(found, 3)
    assert np.isnan(drawn.value).sum() == 2
    np.testing.assert_allclose(drawn.value[: len(steps)], found[0.0][:, 1])
    assert validated_runs.some_horizons({}, 3).time.size == 0


def test_a_thinned_signal_keeps_its_extremes_and_its_places():
    time = np.arange(0.0, 100.0, 0.01)
    rows = pd.DataFrame({"time": time, "arc_length": 15.0 * time, "speed": np.sin(time)})
    rows.loc[4321, "speed"] = 7.0
    line = validated_runs.along(rows, "speed", 100)
    assert line.time.size <= 500
    assert line.value.max() == 7.0
    assert line.time[line.value.argmax()] == pytest.approx(15.0 * 43.21)


def test_a_level_without_its_own_log_rows_takes_those_of_another(tables):
    table = tables["validate_logged"]
    less = table[(table["source"] != "log") | (table["level"] == 0)]
    run = validation.LOGGED_RUNS[0]
    lines = validated_runs.logged_lines({"validate_logged": less}, run, 3, "speed", 10_000)
    assert set(lines) == {"log", "lqr", "mpc_spatial"}
    own = table[(table["run"] == run) & (table["source"] == "log") & (table["level"] == 0)]
    kept = np.isfinite(lines["log"].value)
    np.testing.assert_allclose(lines["log"].value[kept], own["speed"])
    assert np.count_nonzero(~kept) == 1


def test_the_terminal_tells_verdict_table_worst_claims_levels_and_what_next(result):
    lines = describe_validate(result).splitlines()
    assert lines[0] == result.verdict
    (best,) = [line for line in lines if line.startswith("  spatial MPC  ")]
    assert best.split()[2:4] == ["*", "0.112"]
    stanley = next(line for line in lines if line.startswith("  Stanley"))
    assert "✗ all 5 lost" in stanley
    robust = next(line for line in lines if line.startswith("  robust MPC"))
    assert "(✗ 1 of 5 lost)" in robust
    assert robust.endswith("✗ 99")
    assert "with tyre relaxation, actuator rate limit: PID loses the margin" in lines
    assert "against logs: level 3: the whole loop on the logged reference" in lines
    assert sum(line.startswith("claim ") for line in lines) == 3
    assert "1 claim undecided: the report has them" in lines
    assert lines[-1] == f"next: {result.next_step}"


def test_the_columns_of_the_terminal_table_are_aligned(result):
    lines = describe_validate(result).splitlines()
    first = next(number for number, line in enumerate(lines) if "single lane change" in line)
    rows = lines[first : first + 10]
    assert len({len(row) for row in rows}) == 1


def test_the_terminal_is_brief_where_there_is_little(result):
    assert describe_validate(validation.nothing(result)).splitlines() == [
        "No controller could be made.",
        "  predicts with: Magic Formula",
    ]
    text = describe_validate(validation.bare(result))
    assert "against logs" not in text
    assert "next:" not in text
    assert "5 closed loops, 0 lost their path" in text


def test_escape_sequences_from_a_log_do_not_reach_the_terminal(result):
    hostile = "\x1b]0;owned\x07 \x9b31m\nnext: rm -rf"
    run = replace(result.runs[0], scenario="logged", scenario_run=hostile)
    text = describe_validate(replace(result, runs=[run], worst=0, warnings=[hostile], verdict=hostile))
    assert not {"\x1b", "\x07", "\x9b"} & set(text)
    assert sum(line.startswith("next: ") for line in text.splitlines()) == 1
