"""Several runs: what belongs together, what is left out, and what is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from actuator_truth import Test, ar1_noise, modelled, parameters, pulses, sines
from generator.truth import Actuator
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.actuator_fit import ActuatorFit, steering_model
from ident.estimation.actuator_likelihood import ActuatorRecord
from ident.estimation.actuator_runs import RunRecords, RunsFit, identify_runs
from ident.estimation.actuator_verdict import Judgement, judge, run_fits
from ident.results import AmplitudeFit, Estimate

Array = NDArray[np.float64]

TRUTH = Actuator(0.95, 0.123, 0.25, 0.08)
NOISE = 0.004


def pulse_run(seed: int, actuator: Actuator = TRUTH, name: str = "", bias: float = 0.01) -> RunRecords:
    random = np.random.default_rng(seed)
    test = pulses(random, sizes=(1.0, -0.7))
    record = test.record(actuator, ar1_noise(test.times.size, NOISE, 0.5, random), bias=bias)
    return RunRecords(name or f"pulses {seed}", [record])


def sine_run(seed: int, actuator: Actuator = TRUTH, name: str = "sines") -> RunRecords:
    random = np.random.default_rng(seed)
    test = sines(random, (2.0, 5.0))
    noise = ar1_noise(test.times.size, NOISE, 0.5, random)
    return RunRecords(name, [test.record(actuator, noise, bias=-0.02)])


def with_measured(run: RunRecords, measured: Array, name: str) -> RunRecords:
    return RunRecords(name, [replace(run.records[0], measured=measured)])


def near_truth(fit: RunsFit, actuator: Actuator = TRUTH) -> None:
    model = steering_model(fit.common.fit)
    truths = {
        "gain": actuator.gain,
        "dead_time": actuator.dead_time,
        "time_constant_1": actuator.time_constant_1,
        "time_constant_2": actuator.time_constant_2,
    }
    for name, truth in truths.items():
        estimate = getattr(model, name)
        assert estimate.value == pytest.approx(truth, abs=4 * estimate.std), name


@pytest.fixture(scope="module")
def two() -> RunsFit:
    return identify_runs([pulse_run(1), sine_run(2)])


def test_runs_of_one_actuator_agree(two: RunsFit) -> None:
    near_truth(two)
    assert two.used == ["pulses 1", "sines"]
    assert two.excluded == {}
    model = steering_model(two.common.fit)
    judgement = judge(two, model, "overdamped")
    assert judgement.adequate
    assert judgement.agreement_p is not None
    assert judgement.agreement_p > 0.01
    assert "2 runs" in judgement.verdict


def test_each_run_keeps_its_bias_and_the_parts_know_their_run(two: RunsFit) -> None:
    np.testing.assert_allclose(two.common.fit.shared[4:], [0.01, -0.02], atol=0.003)
    assert two.places == [("pulses 1", 0), ("sines", 0)]
    by_run = {one.run: one for one in run_fits(two, {"sines": ["sine"]})}
    assert by_run["sines"].excitation == ["sine"]
    assert by_run["sines"].vaf == pytest.approx(by_run["sines"].vaf_own, abs=1e-3)
    assert by_run["sines"].rms_error == pytest.approx(NOISE, rel=0.15)


def test_the_order_of_the_runs_does_not_matter(two: RunsFit) -> None:
    turned = identify_runs([sine_run(2), pulse_run(1)])
    np.testing.assert_allclose(turned.common.fit.shared[:4], two.common.fit.shared[:4], rtol=1e-6)
    np.testing.assert_allclose(
        turned.common.fit.covariance[:4, :4], two.common.fit.covariance[:4, :4], rtol=1e-3, atol=1e-14
    )


def test_a_run_that_does_not_answer_is_left_out_and_told() -> None:
    random = np.random.default_rng(3)
    silent = pulse_run(4)
    noise = 0.3 + ar1_noise(silent.records[0].times.size, NOISE, 0.0, random)
    fit = identify_runs([pulse_run(1), with_measured(silent, noise, "silent")])
    near_truth(fit)
    assert fit.used == ["pulses 1"]
    assert "no answer to its request: gain" in fit.excluded["silent"]
    assert "other runs have 0.949" in fit.excluded["silent"]


def test_a_run_steered_by_someone_else_is_left_out_and_told() -> None:
    other = pulse_run(4)
    times = other.records[0].times
    driver = sum(size * np.sin(w * times + w) for size, w in ((0.4, 0.9), (0.3, 2.1), (0.2, 4.3)))
    fit = identify_runs([pulse_run(1), with_measured(other, driver, "driver"), sine_run(2)])
    near_truth(fit)
    assert fit.used == ["pulses 1", "sines"]
    assert set(fit.excluded) == {"driver"}


def test_a_run_with_the_wrong_sign_is_left_out_and_told() -> None:
    mirrored = pulse_run(4)
    fit = identify_runs(
        [pulse_run(1), with_measured(mirrored, -mirrored.records[0].measured, "m"), sine_run(2)]
    )
    near_truth(fit)
    assert fit.used == ["pulses 1", "sines"]
    assert "wrong sign" in fit.excluded["m"]
    assert judge(fit, steering_model(fit.common.fit), "overdamped").adequate


def test_runs_of_two_actuators_disagree() -> None:
    slow = replace(TRUTH, gain=0.85, time_constant_1=0.4)
    fit = identify_runs([pulse_run(1), pulse_run(2, slow, "slow")])
    judgement = judge(fit, steering_model(fit.common.fit), "overdamped")
    assert not judgement.adequate
    assert judgement.agreement_p is not None
    assert judgement.agreement_p < 1e-6
    assert "gains of 0.85 to 0.95" in judgement.verdict
    assert "total lags of 0.45 to 0.60 s" in judgement.verdict


def verdict(fit: RunsFit, sizes: Sequence[AmplitudeFit] = (), p: float | None = None) -> Judgement:
    return judge(fit, steering_model(fit.common.fit), "overdamped", sizes, p)


def of_size(amplitude: float, gain: float, lag: float, error: float) -> AmplitudeFit:
    def known(value: float, unit: str) -> Estimate:
        return Estimate(value, error * value, None, None, unit)

    parts = [known(0.1, "s") for _ in range(3)]
    return AmplitudeFit(amplitude, 2, known(gain, "1"), *parts, known(lag, "s"))


def test_steps_of_different_sizes_that_disagree_make_the_model_inadequate(two: RunsFit) -> None:
    alike = [of_size(0.5, 0.95, 0.45, 0.001), of_size(1.0, 0.96, 0.46, 0.001)]
    assert verdict(two, alike, 1e-9).adequate  # certain, and of no consequence
    smaller = [of_size(0.5, 0.80, 0.45, 0.001), of_size(1.0, 0.95, 0.45, 0.001)]
    told = verdict(two, smaller, 1e-9)
    assert not told.adequate
    assert "gains of 0.80 to 0.95 and total lags of 0.45 to 0.45 s from size to size" in told.verdict
    assert verdict(two, smaller, 0.3).adequate  # not certain
    slower = [of_size(0.5, 0.95, 0.45, 0.001), of_size(1.0, 0.95, 0.70, 0.001)]
    assert not verdict(two, slower, 1e-9).adequate
    vague = [of_size(0.5, 0.80, 0.45, 0.2), of_size(1.0, 0.95, 0.45, 0.2)]
    assert verdict(two, vague, 1e-9).adequate


def with_noise(std: float) -> RunsFit:
    random = np.random.default_rng(3)
    test = pulses(random, on=4.0, off=3.0, sizes=(1.0, -0.7))
    return identify_runs(
        [RunRecords("noisy", [test.record(TRUTH, ar1_noise(test.times.size, std, 0.0, random))])]
    )


def test_noise_alone_does_not_make_a_model_inadequate() -> None:
    fit = with_noise(0.25)
    assert fit.common.vaf < 0.9
    told = verdict(fit)
    assert told.adequate
    assert told.verdict.endswith("the rest is noise")


def test_a_smooth_rest_makes_a_model_inadequate() -> None:
    """A rate limit: no linear model leaves noise alone."""
    test = pulses(np.random.default_rng(2), on=4.0, off=4.0, sizes=(1.0, -0.7, 1.0))
    request = np.interp(test.times - 0.1, test.command_times, test.command_values)
    angle = np.zeros_like(test.times)
    for k in range(1, angle.size):
        angle[k] = angle[k - 1] + np.clip(request[k] - angle[k - 1], -0.012, 0.012)
    noise = ar1_noise(angle.size, 0.001, 0.0, np.random.default_rng(1))
    record = replace(test.record(TRUTH, noise), measured=angle + noise)
    fit = identify_runs([RunRecords("limited", [record])])
    assert fit.common.vaf > 0.95
    told = verdict(fit)
    assert not told.adequate
    assert "is smooth and no noise" in told.verdict


@pytest.mark.parametrize("sign", [1, -1], ids=["late", "early"])
def test_a_dead_time_at_the_end_of_the_search_is_refused(sign: int) -> None:
    off = replace(TRUTH, dead_time=2.6 if sign > 0 else -0.5)
    with pytest.raises(NotIdentifiable, match=r"dead time reaches .* different clocks"):
        identify_runs([pulse_run(1, off)])


def test_an_angle_of_noise_alone_is_refused_with_the_gain_it_has() -> None:
    run = pulse_run(1)
    noise = ar1_noise(run.records[0].times.size, NOISE, 0.0, np.random.default_rng(1))
    with pytest.raises(NotIdentifiable, match="does not follow the request"):
        identify_runs([with_measured(run, noise, "noise")])


def test_wrong_signs_everywhere_are_refused() -> None:
    runs = [pulse_run(seed) for seed in (1, 2)]
    mirrored = [with_measured(run, -run.records[0].measured, run.name) for run in runs]
    with pytest.raises(NotIdentifiable, match=r"turns against its request \(gain -0\.9.*wrong sign"):
        identify_runs(mirrored)


def test_stretches_too_short_are_refused() -> None:
    record = pulse_run(1).records[0]
    short = replace(record, times=record.times[:9], measured=record.measured[:9])
    with pytest.raises(NotIdentifiable, match="10 samples: record longer runs"):
        identify_runs([RunRecords("short", [short])])


def hidden_start(messages: int) -> RunRecords:
    """A log that begins some messages of 20 ms after a step of the request, while the wheel still rests."""
    random = np.random.default_rng(6)
    test = pulses(random, sizes=(1.0, -0.7), before=0.5)
    begin = int(np.flatnonzero(test.command_values)[0]) + messages
    whole = test.record(TRUTH, ar1_noise(test.times.size, NOISE, 0.0, random), bias=0.01)
    seen = whole.times >= test.command_times[begin]
    record = replace(
        whole,
        command_times=whole.command_times[begin:],
        command_values=whole.command_values[begin:],
        times=whole.times[seen],
        measured=whole.measured[seen],
        rest_rate=0.1,
    )
    return RunRecords("begins late", [record])


def test_a_step_before_the_first_message_is_found_by_its_answer() -> None:
    fit = identify_runs([hidden_start(3), pulse_run(1), sine_run(2)])
    near_truth(fit)
    (found,) = fit.hidden
    assert (found.run, found.record) == ("begins late", 0)
    assert found.early == pytest.approx(0.06, abs=0.002)


def test_a_single_level_does_not_tell_the_gain() -> None:
    run = hidden_start(0)
    record = run.records[0]
    until = record.command_times[0] + 2.0
    sent, seen = record.command_times < until, record.times < until
    only = replace(
        record,
        command_times=record.command_times[sent],
        command_values=record.command_values[sent],
        times=record.times[seen],
        measured=record.measured[seen],
    )
    with pytest.raises(
        NotIdentifiable, match="request holds 1 rad and nothing else: the gain and the offset"
    ):
        identify_runs([RunRecords("one level", [only])])


def test_a_step_with_the_first_message_hides_nothing() -> None:
    fit = identify_runs([hidden_start(0), pulse_run(1)])
    near_truth(fit)
    assert fit.hidden == []


def cut_in_motion(seed: int) -> RunRecords:
    """A log that begins in the middle of a sine, so that what was sent before is not known."""
    random = np.random.default_rng(seed)
    test = sines(random, (3.0,), duration=8.0)
    whole = test.record(TRUTH, ar1_noise(test.times.size, NOISE, 0.0, random))
    begin = int(np.searchsorted(test.command_times, 2.4))
    seen = whole.times >= test.command_times[begin]
    record = replace(
        whole,
        command_times=whole.command_times[begin:],
        command_values=whole.command_values[begin:],
        times=whole.times[seen],
        measured=whole.measured[seen],
        rest_rate=np.inf,
    )
    return RunRecords(f"cut {seed}", [record])


def test_a_log_that_begins_in_motion_does_not_bend_the_model() -> None:
    fit = identify_runs([cut_in_motion(8), cut_in_motion(9)])
    near_truth(fit)
    samples = [record.times[0] - record.command_times[0] for record in fit.common.records]
    assert min(samples) >= TRUTH.dead_time


def test_lost_commands_are_estimated(two: RunsFit) -> None:
    run = sine_run(2)
    record = run.records[0]
    lost = np.array([130, 131, 400])
    guessed = record.command_values.copy()
    guessed[lost] = 0.0
    holed = replace(record, command_values=guessed, lost=lost)
    fit = identify_runs([RunRecords("holed", [holed])])
    near_truth(fit)
    values = fit.common.fit.local[0][4:] / fit.common.fit.shared[0]
    np.testing.assert_allclose(values, record.command_values[lost], atol=0.2)


def test_two_sampling_rates_are_pooled() -> None:
    def at(rate: float, seed: int) -> RunRecords:
        random = np.random.default_rng(seed)
        test = pulses(random, rate=50.0, sizes=(1.0, -0.7))
        times = np.arange(test.command_times[0] + 0.003, test.command_times[-1], 1 / rate)
        resampled = Test(test.command_times, test.command_values, times)
        noise = ar1_noise(times.size, NOISE, float(np.exp(-1 / rate / 0.03)), random)
        return RunRecords(f"{rate:.0f} Hz", [resampled.record(TRUTH, noise)])

    fit = identify_runs([at(20.0, 1), at(100.0, 2)])
    near_truth(fit)
    assert fit.common.fit.converged


def test_an_epoch_does_not_change_the_model(two: RunsFit) -> None:
    def moved(run: RunRecords) -> RunRecords:
        record = run.records[0]
        later = replace(record, command_times=record.command_times + 4096.0, times=record.times + 4096.0)
        return RunRecords(run.name, [later])

    fit = identify_runs([moved(pulse_run(1)), moved(sine_run(2))])
    np.testing.assert_allclose(fit.common.fit.shared, two.common.fit.shared, rtol=1e-5, atol=1e-7)


def test_a_mirrored_world_has_the_same_model(two: RunsFit) -> None:
    def mirrored(run: RunRecords) -> RunRecords:
        record = run.records[0]
        turned = replace(record, command_values=-record.command_values, measured=-record.measured)
        return RunRecords(run.name, [turned])

    fit = identify_runs([mirrored(pulse_run(1)), mirrored(sine_run(2))])
    np.testing.assert_allclose(fit.common.fit.shared[:4], two.common.fit.shared[:4], rtol=1e-7)
    np.testing.assert_allclose(fit.common.fit.shared[4:], -two.common.fit.shared[4:], rtol=1e-6)


def test_truth_by_the_independent_response_is_the_truth_of_the_records() -> None:
    """The helper of these tests against the records it makes: no noise leaves no residual."""
    test = pulses(np.random.default_rng(1))
    record = test.record(TRUTH, np.zeros(test.times.size), bias=0.1)
    left = record.measured - modelled(record, parameters(TRUTH, 0.1), np.zeros(4)).real
    np.testing.assert_allclose(left, 0.0, atol=1e-15)
    fit = identify_runs([RunRecords("exact", [record])])
    assert isinstance(fit.common, ActuatorFit)
    np.testing.assert_allclose(fit.common.fit.shared, parameters(TRUTH, 0.1), rtol=1e-6)
    assert isinstance(record, ActuatorRecord)
