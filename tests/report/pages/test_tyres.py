import re
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest
import tyre_case

from ident.report.html import _plain, render
from ident.report.page import Columns, Details, Facts, Figure, Lines, Table
from ident.report.pages.tyre_curves import strongest
from ident.report.pages.tyres import tyres_page
from ident.report.tyre_parameters import displayed, full_name
from ident.report.tyre_signals import by_agreement
from ident.results import Estimate

UNKNOWN = Estimate(None, None, None, None, "N/rad", "not_identifiable", "no cornering in the logs")


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
    return {block.title: block for block in blocks_of(page) if isinstance(block, Figure)}


def tables_with(page, head):
    return [
        block
        for block in blocks_of(page)
        if isinstance(block, Table) and head in [column.head for column in block.columns]
    ]


def section(page, name):
    return next(part for part in page.sections if part.name == name)


def panel_traces(figure, axes):
    return [trace for trace in figure.spec["data"] if trace["xaxis"] == axes]


@pytest.fixture(scope="module")
def page(tyres_case):
    return tyres_page(*tyres_case)


def only(result, kind):
    return replace(result, chosen=kind, fits=[fit for fit in result.fits if fit.kind == kind])


def with_fit(result, **changes):
    fits = [replace(fit, **changes) if fit.kind == result.chosen else fit for fit in result.fits]
    return replace(result, fits=fits)


def with_colour(result):
    first = next(iter(result.noise))
    return replace(result, noise=result.noise | {first: replace(result.noise[first], coloured_beyond=True)})


@pytest.mark.parametrize(
    ("change", "badge", "tone"),
    [
        (lambda result: result, "identified in part", "caution"),
        (lambda result: only(result, "linear"), "identified", "good"),
        (lambda result: with_fit(result, converged=False), "not converged", "bad"),
        (with_colour, "model lacks something", "caution"),
    ],
)
def test_the_badge_says_whether_the_data_pin_the_model_down(tyres_case, change, badge, tone):
    result, tables = tyres_case
    verdict = tyres_page(change(result), tables).verdict
    assert (verdict.badge, verdict.tone, verdict.text) == (badge, tone, result.verdict)


def test_the_first_screen_holds_parameters_key_figures_and_force_curves(page):
    parameters = page.lead[0].blocks[0][0]
    assert [row[1].text for row in parameters.rows] == [
        *(f"front {name}" for name in ("cornering stiffness", "peak force", "shape", "curvature")),
        *(f"rear {name}" for name in ("cornering stiffness", "peak force", "shape", "curvature")),
        *("yaw inertia", "understeer gradient", "characteristic speed"),
    ]
    facts = page.lead[0].blocks[1][0]
    assert isinstance(facts, Facts)
    told = dict(facts.cells())
    assert told["tyres"].text == "Magic Formula"
    assert told["mass, taken as given"].text == "12500\u00a0kg ± 300\u00a0kg (2.4 %)"
    assert page.lead[1].title == "Lateral force against slip angle"


def test_a_parameter_stands_in_its_unit_and_is_downloaded_in_it_unrounded(page, tyres_case):
    stiffness = page.lead[0].blocks[0][0].rows[0]
    assert [cell.text for cell in stiffness[2:]] == ["334.0", "328.8 … 339.2", "kN/rad", "identified"]
    assert stiffness[2].raw == 1e-3 * tyres_case[0].fits[-1].front["cornering_stiffness"].value


def test_what_is_not_identifiable_stands_with_what_to_drive(page):
    parameters = page.lead[0].blocks[0][0]
    row = parameters.rows[3]
    assert (row[3].text, row[5].text, row[5].tone) == ("–", "not identifiable", "bad")
    why = page.lead[0].blocks[0][1]
    assert why.summary == "Why 4 parameters are not known better, and what to drive"
    assert why.blocks[0].items == [("front C, front E, rear C, rear E:", f"{tyre_case.NO_PEAK}.")]


def test_curves_are_solid_where_excited_and_dashed_beyond(page, tyres_case):
    low, high = tyres_case[0].excited["front"]
    bold = [trace for trace in panel_traces(page.lead[1], "x") if trace["name"] == "Magic Formula"]
    inside, outside = (np.array(trace["x"])[np.isfinite(trace["y"])] / 1e3 for trace in bold)
    assert [trace["line"]["dash"] for trace in bold] == ["solid", "7px,5px"]
    assert (inside.min(), inside.max()) == pytest.approx((low, high))
    assert np.all((outside <= low + 1e-12) | (outside >= high - 1e-12))
    assert outside.max() > 1.5 * high
    assert bold[0]["line"]["width"] > max(
        trace["line"]["width"] for trace in page.lead[1].spec["data"] if trace["name"] == "linear"
    )


def test_a_drawn_curve_is_that_of_the_result_in_kilonewtons(page, tyres_case):
    curve = tyres_case[0].fits[-1].curves["rear"]
    solid = next(trace for trace in panel_traces(page.lead[1], "x2") if trace["name"] == "Magic Formula")
    there = np.isfinite(solid["y"])
    expected = np.interp(solid["x"][there] / 1e3, curve.slip_angle, curve.force) / 1e3
    np.testing.assert_allclose(solid["y"][there], expected)


def test_points_are_shaded_by_lateral_acceleration_on_one_scale_for_both_axles(page, tyres_case):
    drawn = [trace for trace in page.lead[1].spec["data"] if trace["name"] == "from the motion"]
    rows = tyres_case[1]["tyre_forces"]
    for trace, axle in zip(drawn, ("front", "rear"), strict=True):
        own = rows[rows["axle"] == axle]
        at = int(np.argmax(trace["x"]))
        match = own.iloc[(own["slip_angle"] * 1e3 - trace["x"][at]).abs().argmin()]
        assert trace["marker"]["color"][at] == pytest.approx(abs(match["lateral_acceleration"]))
    scales = [(trace["marker"]["cmin"], trace["marker"]["cmax"]) for trace in drawn]
    assert scales[0] == scales[1]
    assert [trace["marker"]["showscale"] for trace in drawn] == [False, True]


def test_measured_wheel_forces_are_drawn_where_there_are_any(tyres_case):
    result, tables = tyres_case
    forces = tables["tyre_forces"].assign(measured_force=lambda rows: 0.87 * rows["force"])
    page = tyres_page(
        replace(result, measured_forces=[tyre_case.wheel_forces()]), {**tables, "tyre_forces": forces}
    )
    assert "measured at the wheels" in {trace["name"] for trace in page.lead[1].spec["data"]}
    row = section(page, "wheels").blocks[0].rows[0]
    assert (row[1].text, row[1].detail) == ("290.0", "287.7 … 292.3")
    assert "scale error" in row[5].text


def test_every_figure_is_accepted_by_plotly_and_has_units(page):
    found = figures_of(page)
    assert len(found) >= 5
    for figure in found.values():
        go.Figure(_plain(figure.spec))
        titles = [
            axis["title"]["text"]
            for name, axis in figure.spec["layout"].items()
            if name.startswith(("xaxis", "yaxis")) and axis["title"]["text"]
        ]
        assert all("[" in title for title in titles)


def test_the_worst_run_is_open_and_drawn_first(page, tyres_case):
    result, tables = tyres_case
    ranked = by_agreement(result, tyre_case.RUNS)
    assert sorted(ranked) == sorted(tyre_case.RUNS)
    details = section(page, "signals").blocks
    assert details[0].open
    assert details[0].summary.startswith(ranked[-1])
    assert [block.open for block in details[1:]] == [False, False]
    figure = details[0].blocks[0]
    measured = next(t for t in figure.spec["data"] if t["name"] == "measured")
    rows = tables["tyres"][tables["tyres"]["run"] == ranked[-1]]
    np.testing.assert_allclose(measured["y"], np.interp(measured["x"], rows["time"], rows["yaw_rate"]))
    assert np.max(measured["y"]) == rows["yaw_rate"].max()


def test_runs_are_ranked_by_their_errors_over_the_common_ones(tyres_case):
    result = tyres_case[0]
    errors = {"yaw_rate": 0.01, "heading": 0.5}
    common = with_fit(result, rms=errors)
    runs = [
        replace(result.by_run[0], run="a", rms={"yaw_rate": 0.02, "heading": 0.5}),
        replace(result.by_run[0], run="b", rms={"yaw_rate": 0.01, "heading": 0.6}),
        replace(result.by_run[0], run="c", used=False),
    ]
    assert by_agreement(replace(common, by_run=runs), ["a", "b", "c", "d"]) == ["b", "a"]


def test_a_line_of_the_model_is_broken_where_it_begins_anew(page, tyres_case):
    worst = by_agreement(tyres_case[0], tyre_case.RUNS)[-1]
    tyres = tyres_case[1]["tyres"]
    rows = tyres[tyres["run"] == worst]
    figure = section(page, "signals").blocks[0].blocks[0]
    modelled = next(trace for trace in figure.spec["data"] if trace["name"] == "modelled")
    assert np.isnan(modelled["y"]).sum() == rows["window"].nunique() - 1


def test_positions_are_drawn_from_where_the_run_begins(page):
    figure = section(page, "signals").blocks[0].blocks[1]
    position = next(t for t in figure.spec["data"] if t["xaxis"] == "x4" and t["name"] == "measured")
    assert position["y"][0] == 0
    assert np.nanmax(np.abs(position["y"])) < 1000


def test_no_figure_carries_more_points_than_a_screen_can_show(tyres_case):
    result, tables = tyres_case
    run = tables["tyres"][tables["tyres"]["run"] == tyre_case.RUNS[0]]
    long = run.sample(150_000, replace=True, random_state=1).reset_index(drop=True)
    long["time"] = np.arange(150_000) * 0.01
    long["window"] = long["time"] // 10
    forces = tables["tyre_forces"].sample(100_000, replace=True, random_state=2).sort_values(["run", "time"])
    page = tyres_page(result, {"tyres": long, "tyre_forces": forces})
    for figure in figures_of(page).values():
        points = sum(np.size(trace.get("x", ())) for trace in figure.spec["data"])
        assert points < 30_000, figure.title
    assert "points drawn of" in page.lead[1].caption


def test_the_strongest_correlation_is_named(tyres_case):
    fit = tyres_case[0].fits[0]
    assert fit.parameters == ["front.cornering_stiffness", "rear.cornering_stiffness", "yaw_inertia"]
    values = [[1.0, 0.2, -0.93], [0.2, 1.0, 0.1], [-0.93, 0.1, 1.0]]
    assert "Strongest: front Cα and Iz (−0.93)." in strongest(replace(fit, correlation=values))


def test_the_reader_is_told_what_a_wrong_mass_does(page, tyres_case):
    lines = section(page, "fixed").blocks[0]
    assert isinstance(lines, Lines)
    (about, told), *others = lines.items
    assert about == "mass 3 % larger:"
    assert told.startswith("front Cα +3.0\u00a0%, front D +3.0\u00a0%, rear Cα +3.0\u00a0%")
    assert "front E" not in told
    assert told.endswith("its stated standard deviation is in the intervals.")
    assert others == []
    unstated = replace(tyres_case[0].fixed["mass"], std=None)
    result = replace(tyres_case[0], fixed={"mass": unstated})
    told = section(tyres_page(result, tyres_case[1]), "fixed").blocks[0].items[0][1]
    assert "does not say how well it is known" in told


def test_the_kinds_stand_side_by_side_with_the_chosen_one_marked(page, tyres_case):
    rows = tables_with(page, "criterion (BIC)")[0].rows
    assert [row[0].text for row in rows] == ["linear", "piecewise linear", "Magic Formula"]
    assert [row[0].detail for row in rows] == [None, None, "chosen"]
    assert [row[7].text for row in rows] == ["+3500", "+800", "least"]
    assert rows[0][1].raw == 1e3 * tyres_case[0].fits[0].rms["yaw_rate"]


def test_offsets_and_runs_left_out_stand_with_their_reasons(page):
    effects = tables_with(page, "needed")[0].rows
    assert [row[7].text for row in effects] == ["yes (p < 0.001)", "no (p = 0.17)"]
    runs = tables_with(page, "agrees")[0].rows
    assert (runs[3][0].detail, runs[3][-1].text) == ("stands still <b>always</b>", "left out")


def test_names_from_logs_are_text(tyres_case):
    shown = render([tyres_page(*tyres_case)])
    assert "<img" not in shown.split("<main>")[1].split("<script>")[0]
    assert "<b>always" not in shown


def test_numbers_and_names_are_shown_for_people():
    gradient = displayed(Estimate(0.0015, 1e-5, 0.00148, 0.00152, "rad s^2/m"))
    assert (gradient.value, gradient.unit) == (pytest.approx(1.5), "mrad/(m/s²)")
    assert displayed(UNKNOWN).value is None
    assert full_name("front.cornering_stiffness") == "front cornering stiffness"
    assert full_name("rear.some_new_thing") == "rear some new thing"


# --- poor results still make a page --------------------------------------------------------------------


def nothing_identified(result, tables):
    fit = result.fits[0]
    none = dict.fromkeys(fit.front, UNKNOWN)
    empty = replace(
        fit, front=none, rear=none, yaw_inertia=UNKNOWN, curves={}, excited={}, to_fixed={}, rms={}
    )
    unknown = {"understeer_gradient": UNKNOWN, "characteristic_speed": UNKNOWN, "excited": {}}
    return replace(result, chosen="linear", fits=[empty], agreement_p=None, next_step=None, **unknown), tables


def without_points(result, tables):
    return result, {**tables, "tyre_forces": tables["tyre_forces"].iloc[:0]}


def without_samples(result, tables):
    return replace(result, by_run=[], runs=[]), {name: table.iloc[:0] for name, table in tables.items()}


def only_yaw_rate(result, tables):
    kept = ("run", "window", "time", "yaw_rate", "yaw_rate_model", "road_wheel_angle", "speed")
    return with_fit(result, rms={"yaw_rate": 0.004}), {**tables, "tyres": tables["tyres"][[*kept]]}


def nothing_else(result, tables):
    return (
        replace(result, nuisance=[], fixed={}, noise={}, refused=[], warnings=[], speed=[], samples=0),
        tables,
    )


def one_parameter(result, tables):
    return with_fit(result, parameters=["yaw_inertia"], correlation=[[1.0]]), tables


def unstated_mass(result, tables):
    return replace(result, fixed={"mass": replace(result.fixed["mass"], std=None, value=0.0)}), tables


@pytest.mark.parametrize(
    "case",
    [
        nothing_identified,
        without_points,
        without_samples,
        only_yaw_rate,
        nothing_else,
        one_parameter,
        unstated_mass,
    ],
)
def test_a_poor_result_still_makes_a_page(case, tyres_case):
    page = tyres_page(*case(*tyres_case))
    for figure in figures_of(page).values():
        go.Figure(_plain(figure.spec))
    shown = re.sub(r"<script.*?</script>", "", render([page]).split("<main>")[1], flags=re.DOTALL)
    assert re.search(r"\b(nan|None|inf)\b", shown) is None
