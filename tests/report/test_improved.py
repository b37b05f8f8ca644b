from dataclasses import replace

import improve_case as improvement
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ident.report import improved
from ident.report.mathml import equation
from ident.report.page import Code, Equation
from ident.results import ErrorComparison, ErrorRange


def test_an_effect_of_a_signal_is_named_with_it():
    assert improved.effect_name("tyre_relaxation") == "tyre relaxation"
    assert improved.effect_name("sensor_bias yaw_rate") == "sensor bias of the yaw rate"
    assert improved.effect_name("yaw_moment: step") == "yaw moment: step"
    assert improved.parameter_name("tyre_relaxation.length_front") == "length front"


def test_what_is_gone_is_counted_above_the_noise(improve_cases):
    result = improve_cases["named"][0]
    sizes = [ErrorRange(value, None, None, "rad/s") for value in (0.005, 0.004, 0.002)]

    def gone(before, after, noise):
        error = ErrorComparison({"yaw_rate": before}, {"yaw_rate": after}, {"yaw_rate": noise}, "run")
        return improved.taken(replace(result, error=error), "yaw_rate")

    assert gone(sizes[0], sizes[0], 0.003) == 0.0
    assert gone(sizes[0], sizes[1], 0.003) == pytest.approx(1 - np.sqrt(7) / 4)
    assert gone(sizes[0], sizes[2], 0.003) == 1.0
    assert gone(sizes[2], sizes[2], 0.003) is None
    assert gone(sizes[1], sizes[0], 0.003) < 0


@given(st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10)), min_size=1, max_size=200))
def test_means_of_bins_hold_every_sample_once(points):
    x, y = np.array(points).T
    at, mean = improved.binned_means(x, y, 8)
    assert at.size == mean.size <= max(8, np.unique(x).size)
    assert np.all(np.diff(at) >= 0)
    if np.unique(x).size <= 8:
        expected = [y[x == value].mean() for value in np.unique(x)]
        np.testing.assert_allclose(mean, expected, atol=1e-12)
    assert y.min() - 1e-9 <= mean.min() <= mean.max() <= y.max() + 1e-9


def test_bins_hold_equally_many_samples():
    x = np.random.default_rng(1).normal(size=1000)
    at, mean = improved.binned_means(x, 3 * x, 10)
    assert at.size == 10
    np.testing.assert_allclose(mean, 3 * at)
    np.testing.assert_allclose(at, np.sort(x).reshape(10, 100).mean(axis=1), atol=0.02)


def test_nothing_has_no_means():
    at, mean = improved.binned_means(np.empty(0), np.empty(0))
    assert at.size == mean.size == 0


def test_layers_with_times_of_their_own_share_a_run():
    motion = pd.DataFrame(
        {
            "run": "a",
            "time": [0.0, 0.1, 0.2],
            "layer": "motion",
            "yaw_rate_measured": [1.0, np.nan, 3.0],
            "yaw_rate_before": [1.5, 1.5, 1.5],
            "yaw_rate_after": [1.0, 1.0, 2.0],
        }
    )
    actuator = pd.DataFrame(
        {
            "run": "a",
            "time": [0.05, 0.15],
            "layer": "actuator",
            "steering_wheel_angle_measured": [1.0, 2.0],
            "steering_wheel_angle_before": [0.0, 0.0],
            "steering_wheel_angle_after": [1.0, 1.0],
        }
    )
    rows = improved.runs_in({"improve": pd.concat([actuator, motion], ignore_index=True)})["a"]
    assert set(improved.compared_signals(rows)) == {"yaw_rate", "steering_wheel_angle"}
    assert improved.residual_of(rows, "yaw_rate", "after").value.tolist() == [0.0, 1.0]
    assert improved.residual_of(rows, "steering_wheel_angle", "after").time.tolist() == [0.05, 0.15]
    assert improved.activity_of(rows).time.size == 0


def test_positions_are_counted_from_the_first_one_measured():
    rows = pd.DataFrame(
        {
            "run": "a",
            "time": [0.0, 1.0, 2.0],
            "position_across_measured": [np.nan, 5e6, 5e6 + 2.0],
            "position_across_before": [5e6, 5e6, 5e6],
            "position_across_after": [5e6 - 1.0, 5e6, 5e6 + 1.5],
        }
    )
    assert improved.compared_signals(rows) == ["position_across"]
    assert improved.line_of(rows, "position_across", "measured").value.tolist() == [0.0, 2.0]
    assert improved.line_of(rows, "position_across", "after").value.tolist() == [-1.0, 0.0, 1.5]
    assert improved.residual_of(rows, "position_across", "after").value.tolist() == [0.0, 0.5]
    assert improved.unit_of("position_across") == "m"


def test_a_signal_without_a_known_name_is_not_drawn():
    rows = pd.DataFrame({"run": "a", "time": [0.0], "<b>_measured": [1.0], "<b>_after": [1.0]})
    assert improved.compared_signals(rows) == []


def test_held_out_errors_compare_the_same_samples():
    table = pd.DataFrame(
        {
            "run": ["a", "a", "a"],
            "time": [0.0, 1.0, 2.0],
            "signal": "yaw_rate",
            "measured": [1.0, 1.0, 1.0],
            "before": [0.0, 0.0, 9.0],
            "after": [1.0, 0.0, np.nan],
        }
    )
    assert improved.held_out_rms(table) == {"a": {"yaw_rate": (1.0, pytest.approx(np.sqrt(0.5)))}}


def test_candidates_fitted_in_full_come_before_those_with_a_score_alone():
    keys = [one.key for one in improved.ranked(improvement.CANDIDATES[::-1])]
    assert keys == [one.key for one in improvement.CANDIDATES]


# --- equations -------------------------------------------------------------------------------------------


def test_an_equation_keeps_its_symbols():
    found = equation(
        "<mrow><mi>F</mi><mo>&InvisibleTimes;</mo><mi>&alpha;</mi><mo>&lt;</mo><mn>1</mn></mrow>"
    )
    assert isinstance(found, Equation)
    assert found.mathml == (
        '<math display="block"><mrow><mi>F</mi><mo>\u2062</mo><mi>α</mi><mo>&lt;</mo><mn>1</mn></mrow></math>'
    )
    assert found.text == "F \u2062 α < 1"


def test_a_namespace_and_fences_are_written_as_browsers_draw_them():
    found = equation(
        '<math xmlns="http://www.w3.org/1998/Math/MathML"><mfenced open="[" close="]"><mi>a</mi><mi>b</mi>'
        "</mfenced></math>"
    )
    inside = "<mrow><mo>[</mo><mi>a</mi><mo>,</mo><mi>b</mi><mo>]</mo></mrow>"
    assert found.mathml == f'<math display="block">{inside}</math>'


@pytest.mark.parametrize(
    "text",
    [
        "<math><script>alert(1)</script></math>",
        "<math><mtext><img src='x'/></mtext></math>",
        "<math><annotation-xml/></math>",
        '<!DOCTYPE x [<!ENTITY e "eeee">]><math><mi>&e;</mi></math>',
        "F = <b>",
        "",
    ],
)
def test_what_is_no_equation_is_text(text):
    assert equation(text) == Code(text)


def test_attributes_that_do_something_are_left_out():
    found = equation('<math><mi onclick="x()" href="javascript:1" style="a" mathvariant="bold">v</mi></math>')
    assert found.mathml == '<math display="block"><mi mathvariant="bold">v</mi></math>'


@given(st.text(alphabet="<>/&;mathi nscrp\"='", max_size=60))
def test_no_text_becomes_anything_but_known_elements(text):
    found = equation(f"<mrow>{text}</mrow>")
    if isinstance(found, Equation):
        assert "<script" not in found.mathml
        assert "=" not in "".join(part.partition(">")[0] for part in found.mathml.split("<")[2:])
