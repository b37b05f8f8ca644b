from itertools import pairwise

import numpy as np
import plotly.graph_objects as go
import pytest

from ident.report import figures
from ident.report.condense import Line
from ident.report.html import _plain
from ident.report.pages.steering_figures import shown_range
from ident.report.palette import DARK, LIGHT, dark_of_light

LINE = Line(np.arange(3.0), np.array([0.0, np.nan, 1.0]))


def panel(title="a", **fields):
    return figures.Panel(
        title, [figures.line(LINE, "measured", "measured")], x="time [s]", y="angle [rad]", **fields
    )


def test_a_label_from_a_log_cannot_hold_markup_or_a_template():
    text = figures.label('<img src=x onerror="a()">&lt;%{y}\n</script>')
    assert text == '&lt;img src=x onerror="a()"&gt;&amp;lt;% {y} &lt;/script&gt;'


def test_a_long_label_is_cut_before_it_is_escaped():
    assert figures.label("<" * 100, 5) == "&lt;&lt;…&lt;&lt;"


@pytest.mark.parametrize("count", [1, 4, 5, 9])
def test_every_figure_is_one_that_plotly_accepts(count):
    marks = [figures.band(0.0, 1.0, "band"), figures.level(0.5, "modelled", along="y")]
    panels = [panel(marks=marks) for _ in range(count)]
    spec, height = figures.grid(panels, figures.Layout(columns=4, row_height=200, share_x=True))
    figure = go.Figure(_plain(spec))
    assert len(figure.data) == count
    assert figure.layout.height == height


def test_panels_fill_their_rows_without_overlap():
    spec, _ = figures.grid([panel() for _ in range(6)], figures.Layout(columns=3, row_height=200))
    layout = spec["layout"]
    domains = [(layout[f"xaxis{i}"]["domain"], layout[f"yaxis{i}"]["domain"]) for i in ["", 2, 3, 4, 5, 6]]
    for (left, _), (right, _) in pairwise(domains[:3]):
        assert left[1] < right[0]
    assert domains[2][0][1] == pytest.approx(1.0)
    assert all(0 <= low < high <= 1 for _, (low, high) in domains)
    assert domains[3][1][1] < domains[0][1][0]


def test_a_panel_below_moves_with_the_one_above_it():
    spec, _ = figures.grid(
        [panel() for _ in range(4)], figures.Layout(columns=2, row_height=200, share_x=True)
    )
    assert "matches" not in spec["layout"]["xaxis"]
    assert spec["layout"]["xaxis3"]["matches"] == "x"
    assert spec["layout"]["xaxis4"]["matches"] == "x2"


def test_no_panel_has_two_scales():
    spec, _ = figures.grid([panel() for _ in range(4)], figures.Layout(columns=2, row_height=200))
    assert all("overlaying" not in axis for name, axis in spec["layout"].items() if name.startswith("yaxis"))


def test_the_legend_names_each_line_once():
    spec, _ = figures.grid([panel() for _ in range(3)], figures.Layout(columns=3, row_height=200))
    assert [trace["showlegend"] for trace in spec["data"]] == [True, False, False]


def test_a_place_can_be_left_free():
    spec, _ = figures.grid([panel(), figures.EMPTY, panel()], figures.Layout(columns=2, row_height=200))
    assert [trace["xaxis"] for trace in spec["data"]] == ["x", "x3"]


def test_every_colour_has_its_counterpart_in_the_dark():
    assert LIGHT.keys() == DARK.keys()
    assert len(dark_of_light()) == len(LIGHT)


def test_one_huge_interval_does_not_hide_the_others():
    intervals = np.array([[1.0, 0.9, 1.1], [1.05, 0.95, 1.15], [1.02, -50.0, 60.0], [np.nan] * 3])
    low, high = shown_range(intervals)
    assert low == pytest.approx(1.02 - 0.4, abs=0.06)
    assert high == pytest.approx(1.02 + 0.4, abs=0.06)
    assert shown_range(np.full((2, 3), np.nan)) is None
