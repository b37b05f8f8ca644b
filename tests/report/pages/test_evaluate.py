import json
from dataclasses import replace

import evaluate_case as evaluation
import numpy as np
import plotly.graph_objects as go
import pytest

from ident.report import evaluated
from ident.report.html import _plain, render, table_csv, table_json
from ident.report.page import Columns, Details, Facts, Figure
from ident.report.pages.evaluate import evaluate_page
from ident.report.pages.evaluate_figures import coverage_of, log_ticks
from ident.results import Comparison, Requirement


def blocks_of(page):
    waiting = [*page.lead, *(block for section in page.sections for block in section.blocks)]
    while waiting:
        block = waiting.pop(0)
        yield block
        if isinstance(block, Columns):
            waiting += [inner for column in block.blocks for inner in column]
        if isinstance(block, Details):
            waiting += block.blocks


def figures_of(page):
    return [block for block in blocks_of(page) if isinstance(block, Figure)]


def section(page, name):
    return next(part for part in page.sections if part.name == name).blocks


@pytest.fixture(scope="module")
def page(evaluate_case):
    return evaluate_page(*evaluate_case)


def with_checks(result, *verdicts):
    checks = [replace(result.checks[0], verdict=verdict) for verdict in verdicts]
    return replace(result, checks=checks, requirements=[])


REQUIRED = Requirement("yaw_rate", 0.02, 0.03, "rad/s", met=False)


@pytest.mark.parametrize(
    ("change", "badge", "tone"),
    [
        (lambda result: with_checks(result, "fine"), "usable", "good"),
        (lambda result: with_checks(result, "warning", "fine"), "usable, see the checks", "caution"),
        (lambda result: with_checks(result, "fine", "refused"), "not to be believed", "bad"),
        (lambda result: result, "requirement not measured", "caution"),
        (lambda result: replace(result, requirements=[REQUIRED]), "requirement not met", "bad"),
        (lambda result: replace(result, chosen=None), "no model is good enough", "bad"),
        (lambda result: replace(with_checks(result, "fine"), split_by="none"), "not held out", "caution"),
    ],
)
def test_the_badge_says_whether_a_model_may_be_used(evaluate_case, change, badge, tone):
    result, tables = evaluate_case
    verdict = evaluate_page(change(result), tables).verdict
    assert (verdict.badge, verdict.tone, verdict.text) == (badge, tone, result.verdict)


def test_the_first_table_holds_every_model_with_what_is_acceptable_on_top(page, evaluate_case):
    table = page.lead[0].blocks[0][0]
    assert [row[0].text for row in table.rows] == [
        *("acceptable", "kinematic", "linear", "piecewise linear", "brush", "Magic Formula", "brush")
    ]
    assert table.rows[0][1].text == "≤\u00a04.00"
    assert table.rows[4][0].detail == "chosen"
    assert table.rows[6][0].detail == "chosen, on the request"
    assert [column.head for column in table.columns][1] == "yaw rate [mrad/s]"
    assert not any("road-wheel" in column.head for column in table.columns)
    brush = evaluated.shown_model(evaluate_case[0])
    cell = table.rows[4][1]
    assert cell.raw == 1e3 * brush.windows["2 s"]["yaw_rate"].value
    assert cell.detail == f"{1e3 * brush.rms['yaw_rate'].value:.3g}"


def test_cells_are_coloured_by_the_acceptable_size_and_marked_for_those_who_see_no_colour(page):
    rows = {row[0].text: row for row in page.lead[0].blocks[0][0].rows[1:6]}
    acceleration = {name: row[2] for name, row in rows.items()}
    assert {name: cell.tone for name, cell in acceleration.items()} == {
        "kinematic": "bad",
        "linear": "caution",
        "piecewise linear": "caution",
        "brush": "good",
        "Magic Formula": "good",
    }
    assert acceleration["kinematic"].text.startswith("✗")
    assert acceleration["linear"].text.startswith("≈")
    assert acceleration["brush"].text[0].isdigit()


def test_the_download_holds_every_error_of_every_model_in_si_units(page, evaluate_case):
    result = evaluate_case[0]
    table = page.lead[0].blocks[0][0]
    records = json.loads(table_json(table))
    assert len(records) == sum(
        len(errors) for model in result.models for errors in (*model.windows.values(), model.rms)
    )
    (found,) = [
        record
        for record in records
        if (record["model"], record["input"], record["over"], record["signal"])
        == ("linear", "measured", "whole run", "heading")
    ]
    error = result.models[1].rms["heading"]
    assert (found["rms"], found["low"], found["high"]) == (error.value, error.low, error.high)
    assert (found["unit"], found["acceptable"]) == ("rad", 0.012)
    assert len(table_csv(table).splitlines()) == len(records) + 1


def test_key_figures_tell_the_choice_and_what_it_rests_on(page, evaluate_case):
    facts = page.lead[0].blocks[1][0]
    assert isinstance(facts, Facts)
    told = dict(facts.cells())
    assert (told["chosen"].text, told["chosen"].detail) == ("brush", evaluate_case[0].why)
    assert told["held out"].text == "3 runs, whole runs"
    assert (told["requirements"].text, told["requirements"].tone) == ("1 of 2 met", "caution")
    assert (told["checks"].text, told["checks"].tone) == ("1 warning, 3 fine", "caution")


def test_accuracy_stands_against_cost_in_parts_of_what_is_acceptable(page, evaluate_case):
    result = evaluate_case[0]
    drawn = [
        trace for trace in page.lead[1].spec["data"] if trace["xaxis"] == "x" and trace["mode"] == "markers"
    ]
    assert len(drawn) == len(result.models)
    for trace, model in zip(drawn, result.models, strict=True):
        shares = [error.value / result.acceptable[name].value for name, error in model.windows["2 s"].items()]
        assert (trace["x"], trace["y"]) == ([model.cost_ns_per_step], [pytest.approx(max(shares))])
        assert trace["marker"]["symbol"] == ("circle" if model.input == "measured" else "circle-open")
    axes = page.lead[1].spec["layout"]
    assert (axes["xaxis"]["type"], axes["yaxis"]["type"]) == ("log", "log")


def test_coverage_is_shown_with_what_only_the_training_has(page, evaluate_case):
    held, training = coverage_of(evaluate_case[0])
    drawn = [trace for trace in page.lead[1].spec["data"] if trace["xaxis"] == "x2"]
    heat, crosses = drawn
    np.testing.assert_allclose(np.nan_to_num(heat["z"]), held.T)
    only = np.argwhere((training > 0) & (held == 0))
    assert len(only) > 0
    speeds, accelerations = (np.array(evaluate_case[0].speed_edges), evaluate_case[0].acceleration_edges)
    assert crosses["x"].tolist() == [(speeds[i] + speeds[i + 1]) / 2 for i, _ in only]
    assert crosses["y"].tolist() == [(accelerations[j] + accelerations[j + 1]) / 2 for _, j in only]


def test_coverage_that_is_not_told_apart_counts_as_held_out(evaluate_case):
    cells = evaluate_case[0].coverage["held_out"]
    held, training = coverage_of(replace(evaluate_case[0], coverage={"seconds": cells}))
    assert held.tolist() == cells
    assert not training.any()
    held, _ = coverage_of(replace(evaluate_case[0], coverage={"seconds": [[1.0]]}))
    assert not held.any()


def test_the_best_and_the_worst_run_are_drawn_with_the_chosen_model(page, evaluate_case):
    result, tables = evaluate_case
    ranked = evaluated.by_agreement(result, evaluation.RUNS)
    for axis, run in (("x3", ranked[0]), ("x4", ranked[-1])):
        seen, simulated = [trace for trace in page.lead[1].spec["data"] if trace["xaxis"] == axis]
        rows = tables["evaluate"][tables["evaluate"]["run"] == run]
        assert np.max(seen["y"]) == rows["yaw_rate"].max()
        assert np.max(simulated["y"]) == rows["yaw_rate__brush"].max()
        assert simulated["name"] == "brush"


def test_errors_by_band_have_their_intervals_and_the_acceptable_size(page, evaluate_case):
    figure = section(page, "bands")[0]
    model = evaluate_case[0].models[0]
    trace = next(t for t in figure.spec["data"] if t["name"] == "kinematic" and t["xaxis"] == "x")
    errors = [band.rms["yaw_rate"] for band in model.by_lateral_acceleration]
    assert trace["x"].tolist() == [0.5, 1.5, 2.5, 3.5, 4.5]
    np.testing.assert_allclose(trace["y"], [1e3 * error.value for error in errors])
    np.testing.assert_allclose(trace["y"] + trace["error_y"]["array"], [1e3 * error.high for error in errors])
    levels = [shape["y0"] for shape in figure.spec["layout"]["shapes"] if shape["yref"] == "y"]
    assert levels == [pytest.approx(4.0)]


def test_errors_by_length_of_the_windows_are_over_seconds(page, evaluate_case):
    figure = section(page, "windows")[0]
    trace = next(t for t in figure.spec["data"] if t["name"] == "linear" and t["xaxis"] == "x2")
    assert trace["x"].tolist() == [1.0, 2.0, 5.0]
    windows = evaluate_case[0].models[1].windows
    expected = [windows[length]["lateral_acceleration"].value for length in ("1 s", "2 s", "5 s")]
    np.testing.assert_allclose(trace["y"], expected)


def test_the_worst_run_is_open_with_the_residuals_of_all_models(page, evaluate_case):
    result, tables = evaluate_case
    worst = evaluated.by_agreement(result, evaluation.RUNS)[-1]
    first, *others = section(page, "runs")
    assert first.open
    assert first.summary.startswith(worst)
    assert not any(block.open for block in others)
    path, signals = first.blocks
    assert path.spec["layout"]["yaxis"]["scaleanchor"] == "x"
    residuals = [trace for trace in signals.spec["data"] if trace["xaxis"] == "x2"]
    assert {trace["name"] for trace in residuals} == {
        *("kinematic", "linear", "piecewise linear", "brush", "Magic Formula", "brush, on the request")
    }
    rows = tables["evaluate"].query("run == @worst")
    kinematic = next(trace for trace in residuals if trace["name"] == "kinematic")
    assert np.max(kinematic["y"]) == pytest.approx(
        1e3 * (rows["yaw_rate"] - rows["yaw_rate__kinematic"]).max()
    )


def test_an_angle_that_drives_a_model_is_compared_on_the_request_alone(page):
    figure = section(page, "runs")[0].blocks[1]
    titles = {
        name: axis["title"]["text"] for name, axis in figure.spec["layout"].items() if name[:5] == "yaxis"
    }
    place = next(name for name, text in titles.items() if text.startswith("road-wheel angle"))
    drawn = [trace["name"] for trace in figure.spec["data"] if trace["yaxis"] == "y" + place[5:]]
    assert drawn == ["measured", "brush, on the request"]
    assert not any("long. velocity" in text for text in titles.values())


def test_pairs_are_compared_in_words(page):
    lines = section(page, "pairs")[0].items
    assert lines[0] == (
        "linear and Magic Formula:",
        "Magic Formula is better on yaw rate (0.540 of its error, 95 % 0.508 … 0.572, p < 0.001).",
    )
    assert lines[1] == (
        "brush and Magic Formula:",
        "the runs do not tell them apart on yaw rate.",
    )


def test_a_model_from_a_file_is_compared_by_its_name(evaluate_case):
    result, tables = evaluate_case
    other = Comparison("old/model.yaml", "brush", "heading", evaluation.known(0.9, 0.01, "1"), 0.001)
    blocks = section(evaluate_page(replace(result, comparisons=[other], against="x"), tables), "pairs")
    assert blocks[0].items[0][0] == "brush and old/model.yaml:"
    assert blocks[0].items[0][1].startswith("old/model.yaml is better on heading (0.9000 of its error")


def test_characteristics_are_in_the_style_of_standards_and_nothing_is_called_compliant(page, evaluate_case):
    text, table = section(page, "characteristics")
    assert "in the style of ISO 14792" in text.text
    assert "complian" not in render([page]).split("<main>")[1].split("</main>")[0].lower()
    row = table.rows[0]
    assert [cell.text for cell in row] == [
        *("understeer gradient", "ISO\u00a014792", "1.480", "✗\u00a01.310", "1.500", "mrad/(m/s²)"),
        "±\u00a010\u00a0%",
    ]
    assert [row[3].tone, row[4].tone] == ["bad", "good"]


def test_a_characteristic_that_was_not_driven_is_named_apart(evaluate_case):
    result, tables = evaluate_case
    first, second = result.characteristics
    unknown = replace(second, measured=replace(second.measured, value=None, low=None, high=None, std=None))
    page = evaluate_page(replace(result, characteristics=[first, unknown]), tables)
    _, table, lacking = section(page, "characteristics")
    assert len(table.rows) == 1
    assert lacking.items == [("The driving does not tell:", "yaw rate gain at 1 rad/s.")]


def test_the_worst_check_stands_first(page):
    (table,) = section(page, "checks")
    assert [row[0].text for row in table.rows] == ["warning", "fine", "fine", "fine"]


def test_every_figure_is_accepted_by_plotly_and_has_units(page):
    found = figures_of(page)
    assert len(found) >= 2 + 2 * len(evaluation.RUNS)
    for figure in found:
        go.Figure(_plain(figure.spec))
        titles = [
            axis["title"]["text"]
            for name, axis in figure.spec["layout"].items()
            if name.startswith(("xaxis", "yaxis")) and axis["title"]["text"]
        ]
        assert all("[" in title for title in titles)


def test_no_figure_carries_more_points_than_a_screen_can_show(evaluate_case):
    result, tables = evaluate_case
    rows = tables["evaluate"].query("run == @evaluation.RUNS[0]")
    long = rows.sample(60_000, replace=True, random_state=1).reset_index(drop=True)
    long["time"] = np.arange(60_000) * 0.02
    for figure in figures_of(evaluate_page(result, {"evaluate": long})):
        assert sum(np.size(trace.get("x", ())) for trace in figure.spec["data"]) < 60_000, figure.title


def test_a_page_without_anything_evaluated_is_still_a_page(evaluate_case):
    bare = replace(
        evaluate_case[0],
        models=[],
        chosen=None,
        acceptable={},
        comparisons=[],
        characteristics=[],
        checks=[],
        requirements=[],
        coverage={},
        speed_edges=[],
        acceleration_edges=[],
        held_out=[],
        split_by="none",
        runs=[],
        refused=[],
        warnings=[],
        repeat_noise={},
    )
    text = render([evaluate_page(bare, {})])
    assert "no model is good enough" in text
    assert "No run was held out" in text


def test_ticks_of_a_logarithmic_axis_are_1_2_and_5_where_there_is_room():
    assert [tick for tick in log_ticks([30.0, 150.0]) if 20 <= tick <= 200] == [20, 50, 100, 200]
    assert [tick for tick in log_ticks([0.01, 1e4]) if 0.01 <= tick <= 1e4] == [
        0.01,
        0.1,
        1,
        10,
        100,
        1e3,
        1e4,
    ]
    assert log_ticks([]) == []
