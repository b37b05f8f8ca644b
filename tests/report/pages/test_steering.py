import re
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest

from ident.report.html import _plain, render
from ident.report.page import Columns, Details, Figure, Table
from ident.report.pages.steering import steering_page
from ident.report.pages.steering_figures import choose_first
from ident.report.responses import Group
from ident.results import Estimate, Experiment, Noise, SteeringModel

UNKNOWN = Estimate(None, None, None, None, "s", "not_identifiable", "the step is too small")


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


def table_with(page, head):
    return next(
        block
        for block in blocks_of(page)
        if isinstance(block, Table) and head in [column.head for column in block.columns]
    )


@pytest.fixture(scope="module")
def page(steering_case):
    return steering_page(*steering_case)


def test_the_verdict_comes_first_in_its_colour(page, steering_case):
    assert (page.verdict.tone, page.verdict.text) == ("good", steering_case[0].verdict)
    doubtful = steering_page(replace(steering_case[0], adequate=False), steering_case[1])
    assert (doubtful.verdict.tone, doubtful.verdict.badge) == ("caution", "not adequate")


def test_the_first_screen_holds_parameters_figure_and_the_command(page, steering_case):
    assert isinstance(page.lead[0], Columns)
    assert isinstance(page.lead[1], Figure)
    parameters = page.lead[0].blocks[0][0]
    assert [row[0].text for row in parameters.rows] == ["K", "L", "T₁", "T₂", "L + T₁ + T₂", "ωₙ", "ζ"]
    assert page.lead[0].blocks[0][1].text == steering_case[0].provenance.command


def test_parameters_are_downloaded_unrounded(page, steering_case):
    parameters = page.lead[0].blocks[0][0]
    assert parameters.rows[1][2].raw == steering_case[0].model.dead_time.value


def test_the_first_figure_draws_the_signals_that_are_in_the_tables(page, steering_case):
    spec = page.lead[1].spec
    first = {trace["name"]: trace for trace in reversed(spec["data"]) if trace["xaxis"] == "x"}
    rows = steering_case[1]["steering"]
    start = min(e.start for e in steering_case[0].experiments if e.amplitude == pytest.approx(np.pi / 4))
    run = rows[rows["run"] == "day 1/steering_pulses_a"]
    at = run.iloc[(run["time"] - start - 1.0).abs().argmin()]
    drawn = first["measured"]
    index = np.nanargmin(np.abs(drawn["x"] - (at["time"] - start)))
    assert drawn["y"][index] == pytest.approx(at["measured"])
    assert first["requested"]["line"]["shape"] == "hv"


def test_every_figure_is_accepted_by_plotly_and_has_units(page):
    found = figures_of(page)
    assert len(found) >= 5
    for figure in found.values():
        go.Figure(_plain(figure.spec))
        axes = [axis for name, axis in figure.spec["layout"].items() if name.startswith(("xaxis", "yaxis"))]
        titles = [
            axis["title"]["text"]
            for axis in axes
            if axis.get("showticklabels", True) and "ticktext" not in axis
        ]
        assert all("[" in title for title in titles if title not in {"gain", ""})


def test_no_figure_carries_more_points_than_a_screen_can_show(steering_case):
    result, tables = steering_case
    steering = tables["steering"]
    last = steering["run"] == "steering_sines_a"
    long = steering[last].sample(200_000, replace=True, random_state=1).reset_index(drop=True)
    long["time"] = np.arange(200_000) * 0.01
    page = steering_page(replace(result, experiments=[]), {**tables, "steering": long})
    figure = figures_of(page)["From end to end"]
    assert sum(len(trace["x"]) for trace in figure.spec["data"]) < 30_000
    assert "no extreme is lost" in figure.caption
    residual = figure.spec["data"][-1]
    assert np.nanmax(residual["y"]) == pytest.approx(1e3 * (long["measured"] - long["modelled"]).max())


def test_experiments_stand_with_what_uses_them_and_why_not(page, steering_case):
    table = table_with(page, "left out")
    assert len(table.rows) == len(steering_case[0].experiments)
    assert "Harriott: response not settled" in table.rows[4][7].text


def test_step_methods_stand_beside_the_likelihood(page):
    table = table_with(page, "RMS error of the steps [mrad]")
    assert [row[0].text for row in table.rows] == [
        "maximum likelihood, all runs",
        "63.2 % point, one lag (2.15–2.16)",
        "modified Harriott (2.20–2.23)",
    ]
    assert (table.rows[2][3].text, table.rows[2][3].detail) == ("0.1310", "± 0.0090")
    assert table.rows[1][5].text == "–"


def test_a_parameter_that_is_not_known_says_so_and_why(steering_case):
    result, tables = steering_case
    page = steering_page(replace(result, model=replace(result.model, time_constant_2=UNKNOWN)), tables)
    parameters = page.lead[0].blocks[0][0]
    assert (parameters.rows[3][2].text, parameters.rows[3][5].text) == ("–", "not identifiable")
    assert "T₂: the step is too small." in parameters.notes


def test_intervals_of_a_model_that_does_not_explain_the_data_are_called_too_narrow(page, steering_case):
    doubtful = steering_page(replace(steering_case[0], adequate=False), steering_case[1])
    notes = [" ".join(shown.lead[0].blocks[0][0].notes) for shown in (page, doubtful)]
    assert ["too narrow" in note for note in notes] == [False, True]


def test_runs_that_disagree_are_marked(steering_case):
    result, tables = steering_case
    page = steering_page(replace(result, agreement_p=0.0003), tables)
    agreement = dict(page.lead[0].blocks[1][0].items)["one model for all runs"]
    assert (agreement.text, agreement.tone) == ("rejected at 5 % (p < 0.001)", "caution")


def test_the_first_figure_shows_three_amplitudes_and_the_sine_at_the_corner():
    steps = [Group(f"{size}", "step", size, 1.0, 1, []) for size in (0.1, 0.2, 0.3, 0.4, 0.5)]
    sines = [Group(f"{size}", "sine", size, 1.0, 1, []) for size in (0.1, 1.0, 2.0, 5.0, 10.0)]
    other = Group("drive", "other", None, 1.0, 1, [])
    chosen = choose_first([*steps, *sines, other], 0.45)
    assert [group.size for group in chosen] == [0.1, 0.3, 0.5, 2.0]
    assert [group.size for group in choose_first(sines, 0.45)] == [1.0, 2.0, 5.0, 10.0]
    assert [group.title for group in choose_first([steps[0], other], None)] == ["0.1", "drive"]


def without_experiments(result, tables):
    unused = tables["steering"].assign(experiment=-1, used=False, modelled=np.nan, residual=np.nan)
    return replace(result, experiments=[], by_run=[], samples=0), {**tables, "steering": unused}


def without_samples(result, tables):
    return replace(result, experiments=[], by_run=[], runs=[]), {
        name: t.iloc[:0] for name, t in tables.items()
    }


def underdamped(result, tables):
    model = replace(result.model, time_constant_1=UNKNOWN, time_constant_2=UNKNOWN, total_lag=UNKNOWN)
    fits = [replace(fit, model=model) for fit in result.by_run]
    return replace(result, model=model, by_run=fits, classification="underdamped"), tables


def nothing_identified(result, tables):
    model = SteeringModel(**dict.fromkeys(vars(result.model), UNKNOWN))
    fits = [replace(fit, model=None, vaf_own=None, reason="too short") for fit in result.by_run]
    return replace(result, model=model, by_run=fits, agreement_p=None, adequate=False, next_step=None), tables


def uneven_stamps(result, tables):
    return replace(result, noise=Noise("continuous_ar1", 1e-3, 1.6e-3, [], 0.05, None)), tables


def steps_of_no_method(result, tables):
    none = [
        replace(fit, gain=None, dead_time=None, rms_error=None, steps=0, spread={})
        for fit in result.step_methods
    ]
    return replace(result, step_methods=none, refused=[], warnings=[]), tables


def other_excitation(result, tables):
    found = [Experiment(fit.run, "other", 1.0, 20.0, used_by=["likelihood"]) for fit in result.by_run]
    return replace(result, experiments=found, pair="road_wheel"), tables


def no_request(result, tables):
    return result, {**tables, "steering_request": tables["steering_request"].iloc[:0]}


@pytest.mark.parametrize(
    "case",
    [
        without_experiments,
        without_samples,
        underdamped,
        nothing_identified,
        uneven_stamps,
        steps_of_no_method,
        other_excitation,
        no_request,
    ],
)
def test_a_poor_result_still_makes_a_page(case, steering_case):
    result, tables = case(*steering_case)
    page = steering_page(result, tables)
    for figure in figures_of(page).values():
        go.Figure(_plain(figure.spec))
    shown = re.sub(r"<script.*?</script>", "", render([page]).split("<main>")[1], flags=re.DOTALL)
    assert re.search(r"\b(nan|None|inf)\b", shown) is None
