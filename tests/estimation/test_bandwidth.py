"""The three bandwidths against the -3 dB frequency of the simulated actuator, which is known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from generator.commands import Sine, sines, sines_end
from generator.steering import SteeringTest, steering_signals
from generator.truth import Actuator, load_truth
from scipy.optimize import brentq
from scipy.stats import binom

from ident.estimation.actuator_runs import RunRecords, RunsFit, fit_together
from ident.estimation.bandwidth import (
    bode_bandwidth,
    check_bandwidth,
    compare,
    half_power_frequency,
    measured_bandwidth,
    model_response,
    pooled,
    sine_cutoff,
)
from ident.estimation.frequency_response import Plant
from ident.estimation.noise import NoiseModel
from ident.estimation.output_error import WHITE, Fit
from ident.experiments.find import find_experiments
from ident.experiments.steering_data import SteeringRun
from ident.experiments.stretches import find_stretches, jitter_of
from ident.results import Cutoff, Estimate, FrequencyPoint
from ident.signals.signal import Signal
from ident.stages.steering import actuator_record
from ident.stages.steering_frequency import frequency_points, plant_of

TRUTH = load_truth().steering
SEEDS = 8
HALF = 2**-0.5


def transfer(frequency, actuator=TRUTH.actuator):
    s = 1j * frequency
    lags = (1 + s * actuator.time_constant_1) * (1 + s * actuator.time_constant_2)
    return actuator.gain * np.exp(-s * actuator.dead_time) / lags


def true_bandwidth(actuator=TRUTH.actuator):
    return brentq(lambda w: abs(transfer(w, actuator)) - HALF * actuator.gain, 0.01, 1000.0, xtol=1e-13)


def fit_of(gain, dead_time, total, ratio, stds=(1e-4, 1e-3, 1e-3, 1e-3)):
    return Fit(
        shared=np.array([gain, dead_time, total, ratio, 0.0]),
        covariance=np.diag([*np.square(stds), 1e-8]),
        local=[],
        noise=NoiseModel(WHITE, 1e-3),
        residuals=[],
        white_sum=0.0,
        freedom=1000,
        converged=True,
    )


def point(frequency, gain, std=1e-3, method="sine"):
    return FrequencyPoint("run", method, 0.0, 1.0, frequency, 0.4, gain, std, -1.0, 1e-3)


PLANT = Plant(1.0, 0.1, 0.34, 0.02)


def exact_points(frequencies, std=1e-4, method="sine", scale=1.0):
    return [point(w, scale * float(abs(PLANT.response(w))), std, method) for w in frequencies]


# --- of the model ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("total", "product"), [(0.34, 0.02), (0.5, 0.0625), (0.2, 0.04), (0.4, 4e-6), (0.05, 0.02)]
)
def test_python_control_finds_the_root_of_the_quadratic(total, product):
    """(1 - a2 x)² + a1² x = 2 in x = w², from over- through critically to underdamped."""
    linear = total**2 - 2 * product
    square = (-linear + np.sqrt(linear**2 + 4 * product**2)) / (2 * product**2)
    assert half_power_frequency(total, product) == pytest.approx(np.sqrt(square), rel=1e-6)


def test_the_bandwidth_of_one_lag_is_its_inverse():
    assert half_power_frequency(0.5, 1e-9) == pytest.approx(2.0, rel=1e-6)


def test_the_bandwidth_of_a_butterworth_actuator_is_its_natural_frequency():
    """zeta = 1/sqrt 2: half of the power at w_n."""
    assert half_power_frequency(np.sqrt(2) / 7.0, 1 / 49.0) == pytest.approx(7.0, rel=1e-9)


@pytest.mark.parametrize("ratio", [0.01, 0.18, 0.25, 0.8])
def test_the_error_of_the_bandwidth_is_that_of_draws_from_the_covariance(ratio):
    fit = fit_of(1.0, 0.1, 0.34, ratio, stds=(1e-4, 1e-3, 2e-3, 2e-3))
    rng = np.random.default_rng(3)
    total = rng.normal(0.34, 2e-3, 400)
    drawn = np.maximum(rng.normal(ratio, 2e-3, 400), 1e-6)
    linear, product = total**2 * (1 - 2 * drawn), drawn * total**2
    values = np.sqrt((np.sqrt(linear**2 + 4 * product**2) - linear) / 2) / product
    found = bode_bandwidth(fit)
    assert found.std == pytest.approx(values.std(), rel=0.12)  # 400 draws give it to 3.5 %
    assert found.low < found.value < found.high
    assert found.status == "identified"


def test_a_bandwidth_known_to_half_of_itself_is_not_called_identified():
    found = bode_bandwidth(fit_of(1.0, 0.1, 0.34, 0.2, stds=(1e-4, 1e-3, 0.2, 1e-3)))
    assert found.status == "not_identifiable"


def test_the_error_of_the_curve_is_that_of_draws_from_the_covariance():
    stds = np.array([2e-3, 1e-3, 3e-3, 4e-3])
    values = np.array([0.98, 0.12, 0.34, 0.18])
    fit = fit_of(*values, stds=stds)
    w = np.array([0.1, 1.0, 4.0, 20.0])
    curve = model_response(fit, w)
    drawn = values + stds * np.random.default_rng(2).standard_normal((2000, 4))
    answers = np.array([Plant(k, d, a, r * a * a).response(w) for k, d, a, r in drawn])
    nominal = Plant(0.98, 0.12, 0.34, 0.18 * 0.34**2).response(w)
    assert np.allclose(curve.gain, abs(nominal))
    assert np.allclose(np.exp(1j * np.array(curve.phase)), nominal / abs(nominal))
    assert np.allclose(curve.gain_std, abs(answers).std(axis=0), rtol=0.07)
    assert np.allclose(curve.phase_std, np.angle(answers / nominal).std(axis=0), rtol=0.07)


# --- of the measurement ---------------------------------------------------------------------------


def test_the_measured_crossing_has_no_bias_between_points_far_apart():
    exact = half_power_frequency(PLANT.sum_of_lags, PLANT.product_of_lags)
    found = measured_bandwidth(pooled(exact_points([0.5, 2.0, 7.0])), PLANT, 0.0)
    assert found.value == pytest.approx(exact, rel=1e-6)


def test_the_measured_crossing_is_that_of_the_points_and_not_of_the_model():
    """All gains 3 % higher: the crossing is where the model has 1/1.03 of the limit."""
    target = HALF / 1.03
    exact = brentq(lambda w: abs(PLANT.response(w)) - target, 0.1, 50.0)
    points = exact_points([0.5, 1.0, 2.0, 3.0, 5.0, 7.0], scale=1.03)
    assert measured_bandwidth(pooled(points), PLANT, 0.0).value == pytest.approx(exact, rel=1e-6)


def test_the_interval_of_the_measured_crossing_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(5)
    exact = half_power_frequency(PLANT.sum_of_lags, PLANT.product_of_lags)
    frequencies, covered, trials = np.array([1.0, 2.0, 3.0, 5.0, 7.0]), 0, 300
    for _ in range(trials):
        gains = abs(PLANT.response(frequencies)) + rng.normal(0, 0.01, frequencies.size)
        found = measured_bandwidth(
            pooled([point(w, g, 0.01) for w, g in zip(frequencies, gains, strict=True)]), PLANT, 0.0
        )
        covered += found.low <= exact <= found.high
    low, high = binom.ppf([0.0005, 0.9995], trials, 0.95)
    assert low <= covered <= high


def test_points_that_scatter_by_more_than_their_errors_widen_the_interval():
    still = exact_points([2.0, 2.5, 3.0, 4.5, 5.0], std=1e-4)
    shaken = [replace(p, gain=p.gain * (1 + s)) for p, s in zip(still, (2e-2, -2e-2) * 3, strict=False)]
    quiet = measured_bandwidth(pooled(still), PLANT, 0.0)
    loud = measured_bandwidth(pooled(shaken), PLANT, 0.0)
    assert loud.std > 20 * quiet.std


def test_the_error_of_the_dc_gain_is_in_the_interval():
    points = pooled(exact_points([1.0, 3.0, 5.0], std=1e-6))
    around = half_power_frequency(PLANT.sum_of_lags, PLANT.product_of_lags) * np.array([0.99, 1.01])
    slope = -np.diff(np.log(abs(PLANT.response(around))))[0] / np.diff(np.log(around))[0]
    found = measured_bandwidth(points, PLANT, 0.02)
    assert found.std / found.value == pytest.approx(0.02 / slope, rel=0.01)


def test_repeated_sines_count_as_one_frequency():
    levels = pooled([point(2.0, 0.80, 0.01), point(2.001, 0.84, 0.01), point(5.0, 0.5, 0.01)])
    assert levels.frequency == pytest.approx([2.0005, 5.0])
    assert levels.gain == pytest.approx([0.82, 0.5])
    assert levels.std[0] == pytest.approx(0.01 / np.sqrt(2))


def test_says_that_the_sines_ended_below_the_bandwidth():
    found = measured_bandwidth(pooled(exact_points([0.5, 1.0, 2.0])), PLANT, 0.0)
    assert found.value is None
    assert found.status == "not_identifiable"
    assert "at 2 rad/s, the highest measured" in found.reason


def test_says_that_the_sines_began_above_the_bandwidth():
    found = measured_bandwidth(pooled(exact_points([7.0, 10.0])), PLANT, 0.0)
    assert found.value is None
    assert "slower sines" in found.reason


# --- of the sines ---------------------------------------------------------------------------------


def test_the_sine_cutoff_lies_between_the_sines_on_either_side_of_half_power():
    assert sine_cutoff(pooled(exact_points([0.5, 2.0, 3.0, 5.0, 10.0])), PLANT, 0.0) == Cutoff(
        3.0, 5.0, "rad/s"
    )


def test_a_sine_at_half_power_within_its_error_still_counts():
    at = [point(2.0, 0.9, 1e-3), point(3.0, HALF - 0.015, 0.01), point(4.0, HALF - 0.03, 0.01)]
    assert sine_cutoff(pooled(at), PLANT, 0.0) == Cutoff(3.0, 4.0, "rad/s")


def test_an_answer_within_its_noise_is_no_change_however_large():
    faint = [point(2.0, 0.9, 1e-3), point(4.0, 0.8, 0.4)]
    assert sine_cutoff(pooled(faint), PLANT, 0.0) == Cutoff(2.0, 4.0, "rad/s")


def test_the_sine_cutoff_is_open_where_all_sines_change_the_output():
    assert sine_cutoff(pooled(exact_points([0.5, 1.0, 2.0])), PLANT, 0.0) == Cutoff(2.0, None, "rad/s")


def test_the_sine_cutoff_begins_at_zero_where_no_sine_changes_the_output():
    assert sine_cutoff(pooled(exact_points([8.0, 9.0])), PLANT, 0.0) == Cutoff(0.0, 8.0, "rad/s")


def test_without_sines_there_is_no_cutoff():
    assert sine_cutoff(pooled([]), PLANT, 0.0) is None


# --- together -------------------------------------------------------------------------------------


def around(value, half=0.05):
    return Estimate(value, half / 2, value - half, value + half, "rad/s")


@pytest.mark.parametrize(
    ("measured", "cutoff", "overlap", "told"),
    [
        (around(3.52), Cutoff(3.0, 5.0, "rad/s"), True, "overlaps with"),
        (around(4.0), Cutoff(3.0, 5.0, "rad/s"), False, "does not overlap with the measured crossing:"),
        (around(3.52), Cutoff(5.0, 7.0, "rad/s"), False, "does not overlap with the sine cut-off:"),
        (around(3.52), None, True, "there are no sines"),
    ],
)
def test_the_check_says_what_overlaps_and_what_does_not(measured, cutoff, overlap, told):
    found, reason = compare(around(3.5), measured, cutoff, 3.0)
    assert found is overlap
    assert told in reason


def test_a_measurement_that_ends_below_the_bandwidth_is_no_answer():
    short = measured_bandwidth(pooled(exact_points([0.5, 2.0])), PLANT, 0.0)
    found, reason = compare(around(3.5), short, Cutoff(2.0, None, "rad/s"), 2.0)
    assert found is None
    assert "was not reached" in reason
    assert "\n" not in reason


def test_gains_that_stay_up_beyond_the_model_s_bandwidth_contradict_it():
    short = measured_bandwidth(pooled(exact_points([0.5, 2.0], scale=1.2)), PLANT, 0.0)
    found, reason = compare(around(1.0), short, Cutoff(2.0, None, "rad/s"), 2.0)
    assert found is False
    assert "does not overlap" in reason


def test_the_same_with_a_spectrum_alone():
    short = measured_bandwidth(pooled(exact_points([0.5, 2.0], method="h1")), PLANT, 0.0)
    assert compare(around(1.0), short, None, 2.0)[0] is False
    assert compare(around(3.5), short, None, 2.0)[0] is None


# --- from simulated logs --------------------------------------------------------------------------


def run_of(name, signals):
    stretches = find_stretches(signals.request_time, signals.request, signals.angle_time, signals.angle)
    measured = Signal("steering_wheel_angle", signals.angle_time, signals.angle, "rad")
    request = Signal("steering_wheel_request", signals.request_time, signals.request, "rad")
    return SteeringRun(name, request, measured, stretches, [find_experiments(one) for one in stretches])


def checked(tests, truth, seed):
    """Points, the check and the fit of runs that are simulated with this seed."""
    data = [run_of(name, steering_signals(test, truth, seed)) for name, test in tests.items()]
    records = [
        RunRecords(
            run.name,
            [actuator_record(run.stretches[i]) for i in run.excited],
            jitter_of(run.measured.time),
        )
        for run in data
    ]
    common, places, hidden = fit_together(records)
    fit = RunsFit(common, [run.name for run in data], places, {}, {}, hidden)
    points = frequency_points(data, fit)[0]
    return points, check_bandwidth(points, common.fit, plant_of(common.fit))


@pytest.fixture(scope="module")
def sample_checks():
    return [checked({"sines": "steering_sines_b"}, TRUTH, seed) for seed in range(SEEDS)]


def test_the_intervals_of_the_sample_sines_cover_the_true_bandwidth(sample_checks):
    exact = true_bandwidth()
    bode = sum(check.bode.low <= exact <= check.bode.high for _, check in sample_checks)
    measured = sum(check.measured.low <= exact <= check.measured.high for _, check in sample_checks)
    # Of eight intervals of 95 %, fewer than six hold the truth once in 170 times.
    assert bode >= 6
    assert measured >= 6


def test_the_bandwidth_of_the_sample_sines_is_known_to_half_a_per_cent(sample_checks):
    for _, check in sample_checks:
        assert check.bode.std < 0.005 * check.bode.value
        assert check.measured.std < 0.005 * check.measured.value


def test_the_three_bandwidths_of_the_sample_sines_overlap(sample_checks):
    for _, check in sample_checks:
        assert check.overlap is True
        assert check.sine_cutoff.low == pytest.approx(3.0, rel=1e-3)
        assert check.sine_cutoff.high == pytest.approx(5.0, rel=1e-3)


def test_slow_sines_alone_do_not_reach_the_bandwidth():
    segments = [Sine(0.5, 0.4, 2.5), Sine(1.0, 0.4, 4.0), Sine(2.0, 0.4, 5.0)]
    test = SteeringTest(sines(2.0, segments, 1.0), sines_end(2.0, segments, 1.0))
    points, check = checked({"slow": test}, TRUTH, 1)
    assert [p.method for p in points] == ["sine"] * 3
    assert check.measured.value is None
    assert check.sine_cutoff.high is None
    assert check.overlap is None
    assert check.bode.low < true_bandwidth() < check.bode.high


def test_a_fast_actuator_keeps_its_bandwidth_out_of_reach_of_ten_rad_per_s():
    fast = replace(TRUTH, actuator=Actuator(0.99, 0.03, 0.03, 0.01))
    _, check = checked({"sines": "steering_sines_b"}, fast, 2)
    assert check.overlap is None
    assert check.sine_cutoff.high is None
    assert true_bandwidth(fast.actuator) > 25.0
