"""Which experiments give sines, which a spectrum, and what is said of them."""

from dataclasses import replace

import numpy as np
import pytest
from generator.commands import Sine, sines, sines_end
from generator.steering import SteeringTest, steering_signals
from generator.truth import load_truth

from ident.estimation.actuator_runs import RunRecords, RunsFit, fit_together
from ident.experiments.find import find_experiments
from ident.experiments.steering_data import SteeringRun
from ident.experiments.stretches import find_stretches, jitter_of
from ident.results import Estimate, Experiment, Provenance, SteeringModel, SteeringResult
from ident.signals.signal import Signal
from ident.stages.steering import actuator_record
from ident.stages.steering_frequency import with_frequency_response

TRUTH = load_truth().steering


def chirp(t, slow=0.3, fast=15.0, duration=60.0):
    rate = np.log(fast / slow) / duration
    x = np.clip(t - 2.0, 0.0, duration)
    inside = (t >= 2.0) & (t < 2.0 + duration)
    return np.where(inside, 0.4 * np.sin(slow / rate * np.expm1(rate * x)), 0.0)


def run_of(name, test):
    signals = steering_signals(test, TRUTH, 1)
    request = Signal("steering_wheel_request", signals.request_time, signals.request, "rad")
    measured = Signal("steering_wheel_angle", signals.angle_time, signals.angle, "rad")
    stretches = find_stretches(request.time, request.values, measured.time, measured.values)
    return SteeringRun(name, request, measured, stretches, [find_experiments(one) for one in stretches])


def fitted(data, excluded=()):
    records = [
        RunRecords(
            run.name, [actuator_record(run.stretches[i]) for i in run.excited], jitter_of(run.measured.time)
        )
        for run in data
        if run.name not in excluded
    ]
    common, places, hidden = fit_together(records)
    reasons = dict.fromkeys(excluded, "no linear model follows it")
    return RunsFit(common, [one.name for one in records], places, {}, reasons, hidden)


def result_of(data, *, adequate=True):
    """A result that holds the experiments of the runs and little else."""
    nothing = Estimate(1.0, None, None, None, "1")
    experiments = [
        Experiment(run.name, one.kind, one.start, one.end_time)
        for run in data
        for found in run.experiments
        for one in found
    ]
    return SteeringResult(
        schema_version="1",
        provenance=Provenance("0", "", 0, ""),
        verdict="",
        next_step=None,
        pair="steering_wheel",
        model=SteeringModel(*[nothing] * 7),
        classification="overdamped",
        classification_reason="",
        adequate=adequate,
        agreement_p=None,
        rms_error=0.0,
        vaf=1.0,
        samples=1,
        noise=None,
        step_methods=[],
        by_run=[],
        experiments=experiments,
        runs=[],
        refused=[],
        warnings=[],
    )


@pytest.fixture(scope="module")
def chirp_case():
    data = [run_of("chirp", SteeringTest(chirp, 66.0))]
    return data, fitted(data)


def test_a_chirp_of_which_pieces_look_like_sines_gives_one_spectrum(chirp_case):
    data, fit = chirp_case
    assert any(one.kind == "sine" for one in data[0].experiments[0])
    result = with_frequency_response(result_of(data), data, fit)
    assert {(p.method, round(p.start), round(p.end)) for p in result.frequency_response} == {("h1", 2, 62)}
    assert all("frequency_response" in one.used_by for one in result.experiments)


def test_points_come_in_the_order_of_frequency_and_the_curve_spans_them(chirp_case):
    data, fit = chirp_case
    result = with_frequency_response(result_of(data), data, fit)
    measured = [p.frequency for p in result.frequency_response]
    assert measured == sorted(measured)
    curve = result.model_response.frequency
    assert curve[0] < measured[0]
    assert curve[-1] > measured[-1]


def test_a_chirp_alone_gives_the_bandwidth_check_without_a_sine_cutoff(chirp_case):
    data, fit = chirp_case
    bandwidth = with_frequency_response(result_of(data), data, fit).bandwidth
    assert bandwidth.overlap is True
    assert bandwidth.sine_cutoff is None
    assert bandwidth.bode.status == "identified"


def test_the_bandwidth_of_an_inadequate_model_is_weak(chirp_case):
    data, fit = chirp_case
    bode = with_frequency_response(result_of(data, adequate=False), data, fit).bandwidth.bode
    assert bode.status == "weak"
    assert bode.reason


def test_sines_side_by_side_stay_sines_and_a_run_left_out_is_told():
    segments = [Sine(w, 0.4, 4.0) for w in (1.0, 3.0, 6.0)]
    test = SteeringTest(sines(2.0, segments, 0.0), sines_end(2.0, segments, 0.0) + 1.0)
    data = [run_of("kept", test), run_of("foreign", test)]
    fit = fitted(data, excluded=("foreign",))
    result = with_frequency_response(result_of(data), data, fit)
    assert [p.run for p in result.frequency_response] == ["kept"] * 3
    assert [p.frequency for p in result.frequency_response] == pytest.approx([1.0, 3.0, 6.0], rel=1e-3)
    told = {one.run: one.rejected.get("frequency_response") for one in result.experiments}
    assert told == {"kept": None, "foreign": "no linear model follows it"}


def test_what_is_too_short_for_a_spectrum_says_so():
    def wiggle(t):
        return np.where((t > 2) & (t < 6), 0.3 * np.sin((t - 2) ** 2) + 0.05 * t, 0.0)

    data = [run_of("short", SteeringTest(wiggle, 9.0))]
    result = with_frequency_response(result_of(data), data, fitted(data))
    assert result.frequency_response == []
    assert any("needed for a spectrum" in one.rejected["frequency_response"] for one in result.experiments)
    assert result.bandwidth.overlap is None
    assert "no gain was measured" in result.bandwidth.reason


def test_without_any_excitation_left_the_model_s_bandwidth_is_given_alone(chirp_case):
    data, fit = chirp_case
    empty = [replace(data[0], experiments=[[]])]
    result = with_frequency_response(result_of(empty), empty, fit)
    assert result.frequency_response == []
    assert result.bandwidth.measured.value is None
    assert result.bandwidth.bode.value is not None
    assert len(result.model_response.frequency) == len(result.model_response.gain_std)
