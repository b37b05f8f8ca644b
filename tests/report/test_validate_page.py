import json
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest
import validated_case as validation
from pydantic import TypeAdapter

from ident.report.html import _plain, render, table_json
from ident.report.page import Columns, Details, Facts, Figure, Lines, Table, Text
from ident.report.pages import validate_conclusions, validate_figures
from ident.report.pages.validate import validate_page
from ident.report.palette import LIGHT
from ident.results.validate import MismatchCurve, ModelPair, Score, ValidateResult

SECTIONS = [
    *("scenarios", "claims", "worst", "pairs", "mismatch", "margins", "times", "logged"),
    *("settings", "refused", "health", "provenance"),
]


def blocks_of(blocks):
    waiting = list(blocks)
    while waiting:
        block = waiting.pop(0)
        yield block
        if isinstance(block, Columns):
            waiting += [inner for column in block.blocks for inner in column]
        if isinstance(block, Details):
            waiting += block.blocks


def every(page):
    return list(blocks_of([*page.lead, *(block for part in page.sections for block in part.blocks)]))


def section(page, name):
    return list(blocks_of(next(part for part in page.sections if part.name == name).blocks))


def of(blocks, kind):
    return [block for block in blocks if isinstance(block, kind)]


def entries(table, row):
    return [cell.text for cell in table.cells()[row]]


@pytest.fixture(scope="module")
def result():
    return validation.case()[0]


@pytest.fixture(scope="module")
def page():
    return validate_page(*validation.case())


def test_the_page_answers_first_and_holds_every_section(page, result):
    assert (page.verdict.badge, page.verdict.tone) == ("holds", "good")
    assert page.verdict.text == result.verdict
    assert page.verdict.next_step == result.next_step
    assert [part.name for part in page.sections] == SECTIONS


def test_the_first_table_is_scenario_by_controller_best_first(page, result):
    table = of(blocks_of(page.lead), Table)[0]
    assert [column.head for column in table.columns] == [
        *("controller", "single lane change", "ISO 3888-1", "double, scaled", "slalom", "step p99 [ms]")
    ]
    assert [row[0].text for row in table.cells()][:2] == ["1. LQR with feed-forward", "2. spatial MPC"]
    stanley = next(row for row in table.cells() if row[0].text.endswith("Stanley"))
    assert (stanley[2].text, stanley[2].tone, stanley[2].detail) == (
        "✗\u00a0lost",
        "bad",
        "✗\u00a0all 5 lost",
    )
    best = table.cells()[1][1]
    assert best.text == "★\u00a00.112"
    assert best.detail == "0.091 … 0.132"
    robust = next(row for row in table.cells() if "robust" in row[0].text)
    assert (robust[-1].text, robust[-1].tone) == ("✗\u00a099", "bad")
    records = json.loads(table_json(table))
    assert len(records) == sum(len(cell.scores) for cell in result.cells)
    assert records[0]["value"] == result.cells[0].scores[0].value


def test_the_best_is_marked_by_more_than_its_colour(page):
    for table in of(section(page, "scenarios"), Table):
        for row in table.cells():
            for cell in row[2:]:
                assert cell.text.startswith("★") == (cell.tone == "good")
            assert (row[1].tone == "bad") == row[1].text.startswith("✗")


def test_each_scenario_has_all_its_measures_with_units(page):
    tables = of(section(page, "scenarios"), Table)
    assert len(tables) == 4
    heads = [column.head for column in tables[0].columns]
    assert heads[2:] == [
        *("e_y RMS [m]", "|e_y| max [m]", "|e_y| settled [mm]", "|arrival error| [s]"),
        *("braking [J/kg]", "steering rate [mrad/s]", "step p99 [ms]"),
    ]
    folded = [block for block in section(page, "scenarios") if isinstance(block, Details)]
    assert [one.open for one in folded] == [True, False, False, False]
    assert folded[1].summary == "Double lane change (ISO 3888-1): 45 runs, 11 lost"


def test_numbers_of_the_tables_are_those_of_the_result(page, result):
    table = of(section(page, "scenarios"), Table)[0]
    records = json.loads(table_json(table))
    cell = next(
        one for one in result.cells if (one.controller, one.scenario) == ("lqr", "single_lane_change")
    )
    raw = {score.measure: score.value for score in cell.scores}
    assert records[0]["steering rate [mrad/s]"] == raw["steering_rate_rms"]
    assert records[0]["|e_y| max [m]"] == raw["lateral_error_max"]


def test_measures_that_are_seldom_asked_for_stand_behind_a_line(result):
    cell = replace(
        result.cells[0], scores=[*result.cells[0].scores, Score("drive_switches", 0.0, 0.0, 1.0, "1")]
    )
    page = validate_page(replace(result, cells=[cell]), {})
    inner = [block for block in section(page, "scenarios") if isinstance(block, Details)][-1]
    assert inner.summary == "Other measures"
    (table,) = inner.blocks
    assert [column.head for column in table.columns][2:] == ["drive switches [–]"]
    assert table.cells()[0][2].detail == "0 … 1.0"


def test_claims_are_told_with_evidence_and_each_difference_with_whom(page):
    claims, differences = of(section(page, "claims"), Table)
    assert [row[0].text for row in claims.cells()] == ["in part", "holds", "does not hold", "undecided"]
    assert all(row[2].text for row in claims.cells())
    effort = "steering effort, RMS rate"
    assert entries(differences, 0)[1:6] == [effort, "PID", "−12.4", "−16.3 … −8.5", "mrad/s"]
    assert entries(differences, 1)[1:3] == [effort, "LQR with feed-forward"]
    assert entries(differences, 2)[1:3] == ["–", "–"]


def test_the_worst_run_is_drawn_in_its_lane_with_horizons_and_signals(page, result):
    path, signals, *compared = of(section(page, "worst"), Figure)
    traces = {trace["name"]: trace for trace in path.spec["data"]}
    assert list(traces) == ["lane", "reference", "predicted horizons", "truck (CG)"]
    rows = validation.case()[1]["validate"].query("run == @result.worst")
    np.testing.assert_allclose(traces["truck (CG)"]["y"], rows["y"])
    assert len(signals.spec["data"]) == 7
    error = signals.spec["data"][0]
    np.testing.assert_allclose(np.abs(error["y"]).max(), result.runs[result.worst].lateral_error_max)
    assert sum(shape["line"]["color"] == LIGHT["bad_line"] for shape in signals.spec["layout"]["shapes"]) == 2
    assert len(compared) == 2
    assert len({trace["name"] for trace in compared[0].spec["data"]}) == 9


def test_a_path_that_turns_is_drawn_to_scale(result):
    tables = dict(validation.case()[1])
    turned = tables["validate"].copy()
    turned["y"] = 0.5 * turned["x"]
    figure = of(section(validate_page(result, {**tables, "validate": turned}), "worst"), Figure)[0]
    assert figure.spec["layout"]["yaxis"]["scaleanchor"] == "x"
    assert figure.caption.startswith("To scale")


def test_measures_are_drawn_from_zero_so_that_small_differences_stay_small(result):
    figure = validate_figures.measures_figure(result)
    for number in range(5):
        low, high = figure.spec["layout"][f"xaxis{number + 1 if number else ''}"]["range"]
        own = [trace for trace in figure.spec["data"] if trace["xaxis"] == f"x{number + 1 if number else ''}"]
        ends = np.concatenate([trace["x"] + trace["error_x"]["array"] for trace in own])
        assert low == 0.0
        assert ends.max() < high <= 1.1 * ends.max()


def test_lost_pairs_are_told_as_such_and_shaded_apart(result):
    figure = validate_figures.pairs_figure(result)
    trace = figure.spec["data"][0]
    assert len(figure.spec["data"]) == 3
    assert trace["text"][0] == ["0.51", "0.51", "✗ all lost"]
    assert trace["text"][1][2] == "0.32<br>✗ 20\u00a0% lost"
    shade = np.array(trace["z"])
    assert (shade[0, 2], shade[1, 2]) == (2.0, 2.0)
    np.testing.assert_allclose(shade[2], [0.21, 0.21, 0.32])
    assert figure.spec["layout"]["xaxis"]["ticktext"][2] == (
        "Magic Formula<br>+ tyre relaxation<br>+ actuator rate limit"
    )


def test_a_pair_that_was_not_driven_stays_blank(result):
    pairs = [
        ModelPair("lqr", "linear", "linear", 1.0, 0.1, 0.2),
        ModelPair("lqr", "kinematic", "x", 1.0, 0.1, 9.0),
    ]
    trace = validate_figures.pairs_figure(replace(result, pairs=pairs)).spec["data"][0]
    assert np.isnan(trace["z"][0][1])
    assert np.isnan(trace["z"][1][0])
    assert trace["z"][1][1] == 1.0
    assert trace["text"][0][1] == ""


def test_a_curve_ends_in_a_cross_where_the_path_was_lost(result):
    lost = MismatchCurve("pid", "logged", "dead_time", "s", [0.2, 0.0, 0.1], [None, 0.1, 0.3])
    (figure,) = validate_figures.mismatch_figures(replace(result, mismatch=[lost]))
    line, cross = figure.spec["data"]
    np.testing.assert_allclose(line["x"], [0.0, 0.1, 0.2])
    np.testing.assert_allclose(line["y"], [0.1, 0.3, np.nan])
    assert (cross["x"].tolist(), cross["marker"]["symbol"]) == ([0.2], "x")
    low, high = figure.spec["layout"]["yaxis"]["range"]
    assert low < cross["y"][0] < high
    assert cross["y"][0] > result.lane_half_width


@pytest.mark.parametrize(
    ("what", "unit", "sizes", "expected"),
    [
        ("mass", "1", [-0.4, 0.3], (100.0, "mass, change [%]")),
        ("friction", "1", [0.3, 1.0], (1.0, "friction [–]")),
        ("friction", "1", [-0.3, 0.0], (100.0, "friction, change [%]")),
        ("dead_time", "s", [0.1], (1.0, "dead time, change [s]")),
        ("heading_error", "rad", [0.1], (1e3, "heading error at the start [mrad]")),
        ("<b>", "1", [0.1], (100.0, "&lt;b&gt;, change [%]")),
    ],
)
def test_a_mismatch_has_its_unit(what, unit, sizes, expected):
    curve = MismatchCurve("pid", "logged", what, unit, sizes, [None] * len(sizes))
    assert validate_figures.mismatch_axis(curve) == expected


def test_margins_that_are_lost_come_first(page):
    (table,) = of(section(page, "margins"), Table)
    assert entries(table, 0)[:2] == ["✗\u00a0lost", "PID"]
    assert entries(table, 0)[4:6] == ["100", "✗\u00a060"]
    assert {row[0].text for row in table.cells()[1:]} == {"kept"}


def test_times_are_set_against_the_period(page, result):
    blocks = section(page, "times")
    (figure,), (table,) = of(blocks, Figure), of(blocks, Table)
    shape = next(one for one in figure.spec["layout"]["shapes"] if one["line"]["color"] == LIGHT["bad_line"])
    assert shape["x0"] == pytest.approx(1e3 * result.period)
    robust = next(row for row in table.cells() if "robust" in row[0].text)
    assert [cell.text for cell in robust[1:7]] == ["62.0", "86.8", "99.2", "198", "✗\u00a0800", "✗\u00a020"]


def test_levels_say_what_differs_by_how_much_and_where_it_stops(page):
    (table,) = of(section(page, "logged"), Table)
    texts = [entries(table, row) for row in range(7)]
    assert texts[0][3] == "yaw rate 4.0\u00a0mrad/s (6.0); lateral error 0.050\u00a0m (0.10)"
    assert texts[3][2:4] == ["✗\u00a0differs", "✗\u00a0steering request 400\u00a0mrad (60)"]
    assert texts[6][2:] == ["not reached", "–", "level 0 does not agree"]
    figures = of(section(page, "logged"), Figure)
    assert [figure.title[:7] for figure in figures[:4]] == [f"Level {level}" for level in range(4)]


def test_a_level_without_a_known_unit_has_none():
    assert validate_conclusions.level_text("effort", 0.25, None) == "effort 0.25"
    assert validate_conclusions.level_text("effort", 0.25, 0.1) == "✗\u00a0effort 0.25 (0.10)"


@pytest.mark.parametrize("kind", [validation.bare, validation.nothing])
@pytest.mark.parametrize("stored", [True, False])
def test_partial_results_are_told_without_empty_figures(result, kind, stored):
    tables = validation.case()[1] if stored else {}
    page = validate_page(kind(result), tables)
    for part in page.sections:
        assert list(part.blocks), part.name
    for block in every(page):
        if isinstance(block, Figure):
            assert block.spec["data"]
        if isinstance(block, Table):
            assert len(block.cells())
    assert render([page])


def test_nothing_driven_is_said_where_the_table_would_be(result):
    page = validate_page(validation.nothing(result), {})
    assert (page.verdict.badge, page.verdict.tone) == ("nothing ranked", "caution")
    assert any("No closed loop was scored" in block.text for block in of(blocks_of(page.lead), Text))


def test_every_number_has_a_place_in_the_key_figures(page):
    (facts,) = of(blocks_of(page.lead), Facts)
    told = {label: cell.text for label, cell in facts.cells()}
    assert told["closed loops"] == "180 runs"
    assert told["speed"] == "50 … 80\u00a0km/h"
    assert told["period"] == "50\u00a0ms"


def test_refusals_and_warnings_are_listed(page, result):
    told = [item for block in of(section(page, "refused"), Lines) for item in block.items]
    assert ("path_c:", result.refused[0].reason) in told
    assert ("Warning:", result.warnings[0]) in told


def test_every_figure_is_one_that_plotly_knows(page):
    figures = of(every(page), Figure)
    assert figures
    for figure in figures:
        assert go.Figure(_plain(figure.spec)).data


def test_the_same_page_comes_from_what_was_written_as_json(result):
    adapter = TypeAdapter(ValidateResult)
    again = adapter.validate_json(adapter.dump_json(result))
    assert again == result
    assert render([validate_page(again, validation.case()[1])]) == render([validate_page(*validation.case())])


def test_names_from_a_log_are_text_never_markup(result):
    hostile = validation.HOSTILE
    runs = [replace(run, scenario="logged", scenario_run=hostile) for run in result.runs]
    changed = replace(result, runs=runs, verdict=hostile, next_step=hostile, settings={hostile: hostile})
    changed = replace(changed, weights={hostile: {hostile: 1.0}}, model=hostile)
    text = render([validate_page(changed, validation.case()[1])])
    assert "<img" not in text
    assert "onerror=&#34;" in text
