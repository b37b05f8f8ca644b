"""Sets taken through the loop: what is counted as found, named and wrong, and one of each for real."""

import json

import pytest
from improve_power import (
    ACTUATOR,
    ALONE,
    FACTORS,
    OUTSIDE,
    TYPICAL,
    cells,
    holds,
    one_set,
    summary,
    wrong_names,
)

RUNS = ["there_and_back", "sweep_fast", "steps"]


def row(cell, **other):
    name = cell[1]
    made = {
        "cell": cell,
        "truth": {name: {"length": 0.5}},
        "verdict": "named",
        "p_first": 1e-4,
        "added": [name],
        "members": {name: [name]},
        "estimates": {name: {"length": [0.51, 0.02, 0.47, 0.55]}},
    }
    return made | other


def line_of(told, name):
    return next(one for one in told.splitlines() if one.startswith(name)).split()


def test_all_effects_are_asked_for_in_all_sizes():
    made = list(cells(list(FACTORS), 2))
    assert len({json.dumps(cell) for cell in made}) == len(made)
    alone = len(ALONE) * len(set(TYPICAL) - set(ACTUATOR))
    assert len(made) == 2 * (3 * len(TYPICAL) + 2 * len(OUTSIDE) + alone + 2)
    assert {cell[3] for cell in made[: len(made) // 2]} == {1}
    assert len(list(cells(["inside"], 1, ["body_roll"]))) == 3
    assert len(list(cells(["few"], 1, ["body_roll"]))) == len(ALONE)


def test_the_table_counts_what_is_found_named_and_held():
    cell = ["inside", "tyre_relaxation", 1.0, 1]
    other = {"sensor_latency yaw_rate": ["sensor_latency yaw_rate", "tyre_relaxation"]}
    rows = [
        row(cell),
        row(cell, verdict="equivalent", added=["sensor_latency yaw_rate"], members=other, estimates={}),
        row(cell, verdict="adequate", added=[], members={}, estimates={}, p_first=0.3),
        row(cell, verdict="unexplained", estimates={"tyre_relaxation": {"length": [0.6, 0.02, 0.56, 0.64]}}),
    ]
    _, factor, n, found, top, inside, size, *verdicts, covers = line_of(summary(rows), "tyre_relaxation")
    assert (factor, n, found, top, inside, size) == ("1", "4", "3", "2", "3", "1.0")
    assert verdicts == ["1", "1", "1", "1"]
    assert covers == "1/2"


def test_a_name_for_what_is_outside_is_wrong_unless_it_has_one():
    friction = row(["outside", "steering_friction", 1.0, 1], added=["steering_column_play"])
    friction["members"] = {"steering_column_play": ["steering_column_play"]}
    bank = row(["outside", "road_bank", 1.0, 1])
    unexplained = row(["outside", "slosh", 1.0, 1], verdict="unexplained", added=[], members={})
    twice = row(["outside", "road_bank", 3.0, 1], added=["road_bank", "wheel_speed_scale"])
    twice["members"] = {"road_bank": ["road_bank"], "wheel_speed_scale": ["wheel_speed_scale"]}
    assert wrong_names(twice) == ["wheel_speed_scale"]
    told = summary([friction, bank, unexplained])
    assert line_of(told, "steering_friction") == [
        *("steering_friction", "1", "1", "1", "0", "1", "0", "steering_column_play"),
    ]
    assert line_of(told, "road_bank") == ["road_bank", "1", "1", "1", "0", "0", "0"]
    assert line_of(told, "slosh") == ["slosh", "1", "1", "1", "0", "0", "1"]


def test_a_single_name_in_one_run_is_right_or_wrong():
    cell = ["few", "tyre_relaxation in weave", 1.0, 1]
    truth = {"tyre_relaxation": {"length": 0.5}}
    late = ["sensor_latency yaw_rate"]
    both = {late[0]: [*late, "tyre_relaxation"]}
    rows = [
        row(cell, truth=truth, added=["tyre_relaxation"], members={"tyre_relaxation": ["tyre_relaxation"]}),
        row(cell, truth=truth, added=late, members={late[0]: late}),
        row(cell, truth=truth, verdict="equivalent", added=late, members=both),
        row(cell, truth=truth, verdict="adequate", added=[], members={}, p_first=0.4),
    ]
    assert wrong_names(rows[0]) == []
    second = row(cell, truth=truth, members={"tyre_relaxation": ["tyre_relaxation"], late[0]: late})
    assert wrong_names(second) == late, "a second name is a wrong one beside a right one, too"
    told = line_of(summary(rows), "weave")
    assert told[:7] == ["weave", "4", "3", "2", "2", "1", "2"]
    assert told[7:] == ["tyre_relaxation", "as", "sensor_latency", "yaw_rate"]


def test_a_set_that_failed_is_told():
    told = summary([{"cell": ["inside", "body_roll", 1.0, 1], "error": "ValueError: no"}])
    assert "1 sets failed" in told
    assert "ValueError: no" in told


def test_an_interval_holds_or_not():
    cell = ["inside", "tyre_relaxation", 1.0, 1]
    assert holds(row(cell)) is True
    assert holds(row(cell, estimates={"tyre_relaxation": {"length": [0.7, 0.02, 0.66, 0.74]}})) is False
    assert holds(row(cell, estimates={})) is None


def test_a_dead_zone_is_found_and_measured():
    (found,) = one_set(["inside", "steering_dead_zone", 1.0, 2], ["steps"])
    assert found["verdict"] == "named"
    assert found["added"] == ["steering_dead_zone"]
    value, std, low, high = found["estimates"]["steering_dead_zone"]["width"]
    assert value == pytest.approx(0.06, abs=4 * std)
    assert std < 5e-4
    assert low < value < high
    json.dumps(found)


def test_the_actuator_of_a_sound_truck_is_let_be():
    (found,) = one_set(["none", "actuator", 0.0, 2], RUNS)
    assert found["verdict"] == "adequate"
    assert found["added"] == []
    assert found["p_first"] > 0.05
