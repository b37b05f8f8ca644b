from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from ident.report import responses
from ident.results import Experiment


def tables(values, request, *, part=0, run="a"):
    time = np.arange(values.size) * 0.01
    measured = pd.DataFrame(
        {
            "run": run,
            "part": part,
            "time": time,
            "measured": values,
            "modelled": values - 0.5,
            "residual": 0.5,
        }
    )
    sent = np.arange(request.size) * 0.02
    return measured, pd.DataFrame({"run": run, "part": part, "time": sent, "request": request})


@pytest.fixture
def ramp():
    """A run in which the angle is the time and the request counts its samples."""
    return responses.signals_of(*tables(np.arange(1000) * 0.01, np.arange(500.0)))


def step(start, amplitude, **fields):
    return Experiment(
        "a", "step", start, start + 2.0, level_before=1.0, amplitude=amplitude, used_by=["x"], **fields
    )


def test_a_held_request_keeps_the_value_from_before_the_cut(ramp):
    cut = responses.cut_out(ramp["a"], 1.011, 1.05, zero=1.0)
    np.testing.assert_allclose(cut.request.time, [0.011, 0.02, 0.04, 0.05], atol=1e-12)
    assert cut.request.value.tolist() == [50.0, 51.0, 52.0, 52.0]


def test_a_request_is_not_held_across_a_gap():
    measured, request = tables(np.zeros(1000), np.arange(500.0))
    request = request[(request["time"] < 2.0) | (request["time"] > 6.0)]
    runs = responses.signals_of(measured, request)
    cut = responses.cut_out(runs["a"], 4.0, 7.0, zero=0.0)
    assert cut.request.time[0] == pytest.approx(6.02)


def test_the_measured_line_breaks_where_the_log_has_a_gap():
    measured, request = tables(np.arange(1000) * 0.01, np.zeros(500))
    measured = measured[(measured["time"] < 3.0) | (measured["time"] > 4.0)]
    cut = responses.cut_out(responses.signals_of(measured, request)["a"], 2.9, 4.2, zero=0.0)
    assert np.isnan(cut.measured.value).sum() == 1
    assert np.isnan(cut.modelled.value).sum() == 1


def test_the_residual_is_measured_minus_modelled(ramp):
    cut = responses.cut_out(ramp["a"], 1.0, 2.0, zero=0.0)
    np.testing.assert_allclose(cut.residual.value, 0.5)


def test_a_negative_step_is_mirrored_about_the_level_before_it(ramp):
    (group,) = responses.step_groups([step(2.0, -0.5)], ramp, total_lag=0.2)
    response = group.responses[0]
    at_start = np.argmin(np.abs(response.measured.time))
    assert response.measured.value[at_start] == pytest.approx(-(2.0 - 1.0))
    assert response.residual.value[at_start] == pytest.approx(-0.5)
    assert group.size == 0.5


def test_shows_five_total_lags_and_a_little_before(ramp):
    (group,) = responses.step_groups([step(2.0, 0.5)], ramp, total_lag=0.2)
    time = group.responses[0].measured.time
    assert group.length == pytest.approx(1.0)
    assert time[0] == pytest.approx(-0.15, abs=0.011)
    assert time[-1] == pytest.approx(1.0, abs=0.011)


def test_a_step_ends_where_the_next_begins_and_what_is_sent_there_is_not_drawn(ramp):
    (group,) = responses.step_groups([replace(step(2.0, 0.5), end=2.2)], ramp, total_lag=0.2)
    (response,) = group.responses
    assert response.measured.time[-1] == pytest.approx(0.2)
    assert response.request.time[-1] == pytest.approx(0.2)
    assert response.request.value[-1] == 109.0 - 1.0


def test_a_step_that_began_before_the_log_or_in_a_gap_is_left_out():
    measured, request = tables(np.zeros(1000), np.zeros(500))
    request = request[request["time"] > 1.0].reset_index(drop=True)
    request["part"] = (request["time"] > 5.0).astype(int)
    runs = responses.signals_of(measured, request)
    first, gapped, logged = 1.02, request["time"][request["part"] == 1].iloc[0], 3.0
    steps = [step(start, 0.5) for start in (first, gapped, logged)]
    assert [group.found for group in responses.step_groups(steps, runs, total_lag=0.2)] == [1]


def test_a_request_that_was_only_assumed_is_not_drawn():
    measured, request = tables(np.zeros(1000), np.arange(500.0))
    request["lost"] = request["time"] == request["time"][100]
    signals = responses.signals_of(measured, request)["a"]
    assert signals.request.size == 499
    assert 100.0 not in signals.request


def test_groups_steps_of_equal_size_whatever_their_sign(ramp):
    steps = [step(1.0, 0.5), step(2.0, -0.51), step(3.0, 1.0), step(4.0, 0.2)]
    groups = responses.step_groups(steps, ramp, total_lag=0.2)
    assert [round(group.size, 3) for group in groups] == [0.2, 0.505, 1.0]
    assert [group.found for group in groups] == [1, 2, 1]


def test_draws_no_more_than_it_should_and_says_how_many_there_are(ramp):
    (group,) = responses.step_groups(
        [step(1.0 + 0.1 * i, 0.5) for i in range(40)], ramp, total_lag=0.2, most=5
    )
    assert (group.found, len(group.responses)) == (40, 5)


def test_draws_the_steps_that_most_methods_use_and_the_longest_of_them(ramp):
    short = [replace(step(1.0 + 0.1 * i, 0.5), end=1.2 + 0.1 * i) for i in range(5)]
    settled = replace(step(2.0, 0.5), used_by=["likelihood", "modified_harriott"])
    (group,) = responses.step_groups([*short, step(4.0, 0.5), settled], ramp, total_lag=0.4, most=2)
    assert [round(response.measured.time[-1], 1) for response in group.responses] == [2.0, 2.0]
    assert group.responses[0].measured.value[-1] == pytest.approx(4.0 - 1.0)


def test_unused_steps_are_left_out_unless_there_are_no_others(ramp):
    unused = replace(step(1.0, 0.5), used_by=[])
    assert [g.found for g in responses.step_groups([unused, step(2.0, 0.5)], ramp, total_lag=0.2)] == [1]
    assert [g.found for g in responses.step_groups([unused], ramp, total_lag=0.2)] == [1]


def test_a_step_whose_level_before_is_not_known_takes_it_from_the_one_after(ramp):
    known = replace(step(2.0, 0.5), level_before=None, level_after=1.5)
    unknown = replace(step(2.0, 0.5), level_before=None)
    (group,) = responses.step_groups([known, unknown], ramp, total_lag=0.2)
    assert group.found == 1
    at_start = np.argmin(np.abs(group.responses[0].measured.time))
    assert group.responses[0].measured.value[at_start] == pytest.approx(2.0 - 1.0)


def test_shows_three_periods_from_the_middle_of_a_sine(ramp):
    sine = Experiment("a", "sine", 1.0, 9.0, amplitude=0.4, frequency=2 * np.pi, used_by=["x"])
    (group,) = responses.sine_groups([sine], ramp)
    time = group.responses[0].measured.time
    assert time[0] == pytest.approx(2.5, abs=0.011)
    assert time[-1] == pytest.approx(5.5, abs=0.011)


def test_experiments_of_a_run_without_samples_are_left_out(ramp):
    assert responses.step_groups([replace(step(1.0, 0.5), run="b")], ramp, total_lag=None) == []
    assert responses.other_groups([Experiment("b", "other", 0.0, 5.0)], ramp) == []


def test_a_whole_run_holds_every_sample(ramp):
    cut = responses.whole_run(ramp["a"])
    assert cut.measured.time.size == 1000
    assert cut.request.time.size == 501
