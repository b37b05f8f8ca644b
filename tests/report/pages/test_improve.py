import json
from dataclasses import replace

import improve_case as improvement
import numpy as np
import plotly.graph_objects as go
import pytest

from ident.report.html import _plain, render, table_json
from ident.report.improved import signals_of, taken
from ident.report.page import Code, Columns, Details, Equation, Facts, Figure, Lines, Table
from ident.report.pages.improve import improve_page
from ident.report.summary import describe_improve
from ident.results import Confirmation, ErrorComparison, ErrorRange, Refusal

VERDICTS = ("named", "equivalent", "unexplained", "adequate", "actuator", "sensors")


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


def one(blocks, kind):
    (found,) = [block for block in blocks if isinstance(block, kind)]
    return found


def traces(figure, axis):
    """The traces of a figure on the axes x and y of this number, by name."""
    return {trace["name"]: trace for trace in figure.spec["data"] if trace["xaxis"] == axis}


@pytest.fixture(scope="module")
def page(improve_cases):
    return improve_page(*improve_cases["named"])


@pytest.mark.parametrize(
    ("case", "badge", "tone"),
    [
        ("named", "named", "good"),
        ("equivalent", "one of several", "caution"),
        ("unexplained", "unexplained", "bad"),
        ("adequate", "adequate", "good"),
        ("actuator", "named, not confirmed", "caution"),
        ("sensors", "only sensors tested", "caution"),
    ],
)
def test_the_badge_says_what_was_found(improve_cases, case, badge, tone):
    result, tables = improve_cases[case]
    verdict = improve_page(result, tables).verdict
    assert (verdict.badge, verdict.tone, verdict.text) == (badge, tone, result.told)


def test_what_no_model_was_tested_on_is_never_called_adequate(improve_cases):
    result, tables = improve_cases["sensors"]
    assert result.verdict == "adequate"
    page = improve_page(result, tables)
    shown = render([page])
    assert page.verdict.badge != "adequate"
    assert "No model could be compared with these data" in shown
    assert "do not tell that the model lacks anything" not in shown


def test_the_first_table_gives_the_errors_before_and_after_beside_the_noise(page, improve_cases):
    result = improve_cases["named"][0]
    table = one(page.lead[0].blocks[0], Table)
    first = table.rows[0]
    before, after = result.error.before["yaw_rate"].value, result.error.after["yaw_rate"].value
    assert first[0].text == "yaw rate [mrad/s]"
    assert (first[1].raw, first[2].raw) == (1e3 * before, 1e3 * after)
    assert first[1].detail == f"{930 * before:.3g} … {1080 * before:.3g}"
    assert first[3].text == "1.50"
    assert first[4].raw == pytest.approx(after / 0.0015)
    gone = 1 - np.sqrt(after**2 - 0.0015**2) / np.sqrt(before**2 - 0.0015**2)
    assert first[5].raw == pytest.approx(gone)
    assert [row[4].tone for row in table.rows] == ["caution", "caution", "good"]


def test_the_download_of_the_errors_is_in_si_units_with_intervals(page, improve_cases):
    result = improve_cases["named"][0]
    records = json.loads(table_json(one(page.lead[0].blocks[0], Table)))
    error = result.error.before["yaw_rate"]
    assert records[0]["signal"] == "yaw_rate"
    assert [records[0][key] for key in ("before", "before_low", "before_high", "noise", "unit")] == [
        *(error.value, error.low, error.high, 0.0015, "rad/s")
    ]


def test_key_figures_tell_the_effect_its_size_and_the_sensors(page):
    told = dict(one(page.lead[0].blocks[1], Facts).cells())
    assert told["added"].text == "tyre relaxation"
    assert told["added"].detail == "length 0.560 (0.501 … 0.619) m; p < 0.001"
    assert told["confirmed"].text == "yes"
    assert told["confirmed"].detail == "2 of 3 runs gain; leave one run out"
    assert told["sensors"].text == "1 differs, 1 agrees, 1 not testable"
    assert told["sensors"].detail == "position speed against wheel speed: scale"


def test_the_first_figure_draws_errors_over_noise_with_their_intervals(page, improve_cases):
    result = improve_cases["named"][0]
    figure = one(page.lead, Figure)
    drawn = traces(figure, "x")
    for way, errors in (("before", result.error.before), ("after", result.error.after)):
        ratio = errors["yaw_rate"].value / 0.0015
        assert drawn[way]["x"][0] == pytest.approx(ratio)
        assert drawn[way]["error_x"]["array"][0] == pytest.approx(0.08 * ratio)
        assert drawn[way]["error_x"]["arrayminus"][0] == pytest.approx(0.07 * ratio)
    assert figure.spec["layout"]["xaxis"]["type"] == "log"


def test_the_residual_hangs_on_its_variable_before_and_no_longer_after(page, improve_cases):
    table = improve_cases["named"][1]["improve"]
    figure = one(page.lead, Figure)
    slopes = {}
    for way, axis in (("before", "x2"), ("after", "x3")):
        mean = traces(figure, axis)["mean"]
        slopes[way] = np.polyfit(mean["x"], mean["y"], 1)[0]
        left = 1e3 * (table["yaw_rate_measured"] - table[f"yaw_rate_{way}"])
        assert slopes[way] == pytest.approx(np.polyfit(table["regressor"], left, 1)[0], rel=0.15)
    assert abs(slopes["after"]) < 0.1 * abs(slopes["before"])
    assert figure.spec["layout"]["xaxis2"]["title"]["text"] == "rate of the lateral acceleration [m/s³]"
    assert figure.spec["layout"]["yaxis2"]["range"] == figure.spec["layout"]["yaxis3"]["range"]


@pytest.mark.parametrize(
    ("p_value", "said"),
    [
        (2e-4, "the runs contradict each other"),
        (0.02, "the runs differ somewhat, less than it takes to doubt the effect"),
        (0.5, "the runs agree on its size"),
    ],
)
def test_the_page_says_of_single_runs_what_the_verdict_makes_of_them(improve_cases, p_value, said):
    result, *tables = improve_cases["named"]
    effects = [replace(one, same_in_runs_p=p_value) for one in result.effects]
    blocks = section(improve_page(replace(result, effects=effects), *tables), "effect")
    told = [text for block in blocks if isinstance(block, Lines) for head, text in block.items]
    assert any(text.startswith(f"{said} (p") for text in told)


def test_the_effect_is_typeset_with_its_parameters_and_their_meaning(page):
    blocks = section(page, "effect")
    equation = one(blocks, Equation)
    assert equation.mathml.startswith('<math display="block"><mfrac><mi>σ</mi>')
    assert "<mo>(</mo><mi>α</mi><mo>)</mo>" in equation.mathml
    row = one(blocks, Table).rows[0]
    assert [cell.text for cell in row] == [
        *("length", "0.560", "0.501 … 0.619", "m", "identified"),
        "distance rolled until 63 % of a new force is there",
    ]
    own, after = (block for block in blocks if isinstance(block, Lines))
    told = dict(own.items) | dict(after.items)
    assert told["Run by run:"] == "the runs agree on its size (p = 0.34)."
    assert told["Takes away, of the error above the noise:"].startswith("yaw rate 90\u00a0%")
    assert not any("cannot tell it from" in head for head in told)


def test_each_step_has_its_gate_its_place_and_its_candidates(page):
    first, second = section(page, "evidence")
    assert first.summary == "Step 1 of 2: p < 0.001, added tyre relaxation"
    assert second.summary == "Step 2 of 2: p = 0.41, added nothing"
    gate = dict(one(first.blocks, Facts).cells())["gate"]
    assert gate.text == "something is left, p < 0.001"
    assert gate.detail.startswith("214 directions together at 5\u00a0%")
    assert dict(one(second.blocks, Facts).cells())["gate"].tone == "good"
    figure = one(first.blocks, Figure)
    share = traces(figure, "x")["share"]
    assert share["x"].tolist() == pytest.approx([88, 74, 60, 55, 21, 4])
    assert figure.spec["layout"]["yaxis"]["ticktext"][0] == "front tyre"
    assert [trace["name"] for trace in figure.spec["data"][1:]] == ["score", "full fit"]


def test_every_runner_up_says_why_it_lost(page):
    table = one(section(page, "evidence")[0].blocks, Table)
    whys = {row[0].text: row[7].text for row in table.rows}
    assert list(whys) == [
        *("tyre relaxation", "sensor latency of the yaw rate", "body roll", "steering linkage play"),
        "load transfer",
    ]
    assert whys["tyre relaxation"] == "added"
    assert whys["body roll"] == "fits worse by 1247"
    assert all(whys.values())


def test_the_gain_of_each_run_is_drawn_and_a_run_that_lost_is_marked(page, improve_cases):
    blocks = section(page, "confirmation")
    (bars,) = one(blocks, Figure).spec["data"]
    assert bars["orientation"] == "h"
    assert bars["x"].tolist() == [0.4, 0.35, -0.02]
    assert "its interval lies above zero (leave one run out)" in one(blocks, Lines).items[0][1]
    result, tables = improve_cases["named"]
    worse = tables["improve_held_out"].rename(columns={"before": "after", "after": "before"})
    swapped = improve_page(result, {**tables, "improve_held_out": worse})
    for shown, mark in ((page, False), (swapped, True)):
        row = one(section(shown, "confirmation"), Table).rows[0]
        assert row[1].text.startswith("✗") is mark


def test_held_out_errors_of_each_run_are_those_of_its_samples(page, improve_cases):
    rows = improve_cases["named"][1]["improve"].query("run == @improvement.RUNS[0]")
    records = json.loads(table_json(one(section(page, "confirmation"), Table)))
    (found,) = [r for r in records if (r["run"], r["signal"]) == (improvement.RUNS[0], "lateral_velocity")]
    for way in ("before", "after"):
        left = rows["lateral_velocity_measured"] - rows[f"lateral_velocity_{way}"]
        assert found[way] == pytest.approx(float(np.sqrt((left**2).mean())))


def test_a_class_is_named_whole_with_the_run_that_separates_it(improve_cases):
    page = improve_page(*improve_cases["equivalent"])
    told = dict(one(section(page, "separate"), Lines).items)
    assert told["Cannot be told apart here:"] == "tyre relaxation, sensor latency of the yaw rate."
    assert told["Drive next:"] == page.verdict.next_step == "a sine sweep to 2 Hz at 4 m/s"
    table = one(section(page, "evidence")[0].blocks, Table)
    alike = [row[0].text for row in table.rows if row[0].detail]
    assert alike == ["tyre relaxation", "sensor latency of the yaw rate"]


def test_a_discovered_term_is_told_with_its_equation_and_without_a_name(improve_cases):
    page = improve_page(*improve_cases["unexplained"])
    facts = dict(one(page.lead[0].blocks[1], Facts).cells())
    assert facts["without a name"].text == "r|r| in the yaw moment"
    assert "added" not in facts
    blocks = section(page, "effect")
    assert "<msub><mi>I</mi><mi>z</mi></msub>" in one(blocks, Equation).mathml
    told = dict(next(block for block in blocks if isinstance(block, Lines)).items)
    assert told["Coefficient:"] == "−91000 (−98840 … −83160) N m s²/rad², p < 0.001."
    assert told["Chosen in half-samples:"] == "96\u00a0% of them."


def test_unexplained_without_a_term_says_that_something_is_missing(improve_cases):
    result, tables = improve_cases["unexplained"]
    page = improve_page(replace(result, discovered=None, regressor=None), tables)
    (text,) = section(page, "effect")
    assert text.text == "Nothing was added: the model lacks something, but no effect and no term explains it."


def test_detectable_sizes_stand_beside_typical_ones_the_surest_first(page):
    table, missing = section(page, "detectable")
    assert [row[0].text for row in table.rows] == [
        *("sensor bias of the yaw rate", "sensor latency of the yaw rate"),
        *("steering linkage play", "load transfer"),
    ]
    assert [cell.text for cell in table.rows[2]] == [
        *("steering linkage play", "1.10", "4.00", "mrad", "0.275", "a typical one would show")
    ]
    assert table.rows[3][5].text == "a typical one may hide here"
    assert [[cell.text for cell in row] for row in missing.rows] == [
        ["grade", "no drive or brake signal in the logs"],
        ["trailer", "not built yet"],
    ]


def test_adequate_draws_what_would_have_shown(improve_cases):
    page = improve_page(*improve_cases["adequate"])
    figure = one(page.lead, Figure)
    shown = traces(figure, "x2")["smallest size shown"]
    np.testing.assert_allclose(shown["x"], [0.1, 0.15, 0.275, 2.2])
    assert figure.spec["layout"]["yaxis2"]["ticktext"][0] == "sensor bias of the yaw rate"
    assert one(section(page, "confirmation"), object).text.startswith("Nothing was added")


def test_the_run_in_which_the_effect_acts_most_is_open(improve_cases):
    result, tables = improve_cases["named"]
    mean = tables["improve"].groupby("run")["activity"].mean()
    page = improve_page(result, tables)
    blocks = section(page, "runs")
    assert [block.open for block in blocks] == [True, False, False]
    assert blocks[0].summary.startswith(f"{mean.idxmax()}: ")
    flipped = tables["improve"].assign(activity=1.0 - tables["improve"]["activity"])
    other = section(improve_page(result, {"improve": flipped}), "runs")
    assert other[0].summary.startswith(f"{mean.idxmin()}: ")
    drawn = one(blocks[0].blocks, Figure)
    assert {trace["name"] for trace in drawn.spec["data"]} == {"measured", "before", "after", "effect acts"}


def test_a_sensor_that_differs_stands_first_with_what_it_would_be(page):
    table = one(section(page, "sensors"), Table)
    assert [row[0].text for row in table.rows] == ["differs", "agrees", "not testable"]
    first = table.rows[0]
    assert (first[1].detail, first[2].text, first[5].text) == ("wheel speed scale", "0.9780", "1.00")


@pytest.mark.parametrize("case", VERDICTS)
def test_every_figure_is_accepted_by_plotly_and_has_units(improve_cases, case):
    page = improve_page(*improve_cases[case])
    found = figures_of(page)
    assert len(found) >= {"sensors": 0, "adequate": 4}.get(case, 5)
    for figure in found:
        go.Figure(_plain(figure.spec))
        titles = [
            axis["title"]["text"]
            for name, axis in figure.spec["layout"].items()
            if name.startswith(("xaxis", "yaxis")) and axis["title"]["text"]
        ]
        assert titles
        assert all("[" in title for title in titles)


@pytest.mark.parametrize("case", VERDICTS)
def test_nothing_of_a_log_becomes_markup(improve_cases, case):
    text = render([improve_page(*improve_cases[case])]).split("<main>")[1].split("</main>")[0]
    assert "<img" not in text
    assert "&lt;img src=x" in text


def test_an_equation_that_is_no_equation_is_shown_as_text(improve_cases):
    result, tables = improve_cases["named"]
    hostile = replace(result.effects[0], equation="<math><script>window.injected=4</script></math>")
    page = improve_page(replace(result, effects=[hostile]), tables)
    assert one(section(page, "effect"), Code).text == hostile.equation
    assert "<script>window.injected" not in render([page]).split("<main>")[1]


def test_no_figure_carries_more_points_than_a_screen_can_show(improve_cases):
    result, tables = improve_cases["named"]
    rows = tables["improve"].query("run == @improvement.RUNS[0]")
    long = rows.sample(60_000, replace=True, random_state=1).reset_index(drop=True)
    long["time"] = np.arange(60_000) * 0.01
    for figure in figures_of(improve_page(result, {"improve": long})):
        assert sum(np.size(trace.get("x", ())) for trace in figure.spec["data"]) < 40_000, figure.title


def test_signals_without_a_noise_floor_are_told_and_left_out_of_the_figure(improve_cases):
    result = improve_cases["named"][0]
    error = ErrorComparison(
        {"yaw_rate": ErrorRange(0.01, None, None, "rad/s")},
        {"yaw_rate": ErrorRange(0.004, None, None, "rad/s")},
        {},
        "none",
    )
    page = improve_page(replace(result, error=error), {})
    row = one(page.lead[0].blocks[0], Table).rows[0]
    assert [cell.text for cell in row[1:]] == ["10.0", "4.00", "–", "–", "–"]
    assert "Error over noise floor" not in str(one(page.lead, Figure).spec)
    assert dict(one(page.lead[0].blocks[1], Facts).cells())["held out"].text.startswith("nothing")


def test_a_noise_floor_that_is_a_lower_limit_is_told_as_one(improve_cases):
    result, tables = improve_cases["named"]
    signal = next(name for name in signals_of(result) if taken(result, name) is not None)
    limit = replace(result, error=replace(result.error, at_least=[signal]))
    plain, told = (one(improve_page(each, tables).lead[0].blocks[0], Table) for each in (result, limit))
    place = signals_of(result).index(signal)
    for number, (before, after) in enumerate(zip(plain.rows[place], told.rows[place], strict=True)):
        sign = {3: "≥\u00a0", 4: "≤\u00a0", 5: "≥\u00a0"}.get(number, "")
        assert after.text == sign + before.text
    assert told.rows[place][4].tone != "caution"
    assert [row for n, row in enumerate(told.rows) if n != place] == [
        row for n, row in enumerate(plain.rows) if n != place
    ]
    assert len(told.notes) == len(plain.notes) + 1
    assert "≥ " in describe_improve(limit)
    assert "≥" not in describe_improve(result)


def test_many_runs_are_drawn_in_part_and_that_is_said(improve_cases):
    result, tables = improve_cases["named"]
    gains = {f"run_{number:03}": 1.0 - 0.01 * number for number in range(80)}
    confirmed = Confirmation(result.confirmation.gain, gains, True, "leave one run out")
    many = replace(result, confirmation=confirmed, not_testable=[Refusal(f"x{n}", "y") for n in range(40)])
    figure = one(section(improve_page(many, tables), "confirmation"), Figure)
    assert len(figure.spec["data"][0]["x"]) == 30
    assert figure.caption.startswith("50 runs between the best and the worst")
