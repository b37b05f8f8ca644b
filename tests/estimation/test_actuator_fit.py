"""The fit of the actuator against the bound, over known actuators, and what it says of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from actuator_truth import (
    Test,
    ar1_covariance,
    ar1_noise,
    bound,
    derivatives,
    parameters,
    pulses,
    sines,
    time_constant_map,
)
from generator.truth import Actuator
from numpy.typing import NDArray
from scipy.stats import binom, chi2

from ident.errors import NotIdentifiable
from ident.estimation.actuator_fit import (
    ActuatorFit,
    agreement,
    classify,
    doubted,
    estimate,
    fit_actuator,
    fit_roughly,
    joint_covariance,
    search_start,
    steering_model,
    thinned,
)
from ident.estimation.actuator_likelihood import BIAS, ActuatorProblem, ActuatorRecord
from ident.estimation.noise import AutoRegression, ContinuousAr1, NoiseModel
from ident.estimation.output_error import Fit
from ident.results import Estimate

Array = NDArray[np.float64]

REFERENCE = Actuator(1.0, 0.12, 0.25, 0.08)


def a_fit(values: tuple[float, ...], covariance: Array, freedom: int = 1000) -> Fit:
    """A fit with these parameters (K, L, a1, rho) and no data."""
    shared = np.append(values, 0.0)
    whole = np.zeros((5, 5))
    whole[:4, :4] = covariance
    noise = NoiseModel(AutoRegression(np.zeros(0)), 0.01)
    return Fit(shared, whole, [], noise, [], 0.0, freedom, converged=True)


# --- the bound ------------------------------------------------------------------------------------


def reference_step() -> ActuatorRecord:
    """One step at time zero, 50 Hz, 3 s."""
    times = np.arange(150) * 0.02 + 1e-9
    sent, values = np.array([-1.0, 0.0]), np.array([0.0, 1.0])
    return ActuatorRecord(0, sent, values, times, np.zeros(150), np.zeros(1, dtype=np.intp))


@pytest.mark.parametrize(
    ("noise", "dead_time", "first", "second"), [(0.005, 2.1, 1.1, 4.7), (0.02, 8.4, 4.4, 19.0)]
)
def test_the_information_of_one_step_is_that_of_the_table(
    noise: float, dead_time: float, first: float, second: float
) -> None:
    record = reference_step()
    truth = parameters(REFERENCE)
    linear = ActuatorProblem([record]).linearise(truth, [np.zeros(4)])[0]
    columns = linear.shared[:, :4] @ time_constant_map(REFERENCE)
    std = noise * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    assert 1e3 * std[1] == pytest.approx(dead_time, abs=0.05)
    assert 100 * std[2] / 0.25 == pytest.approx(first, abs=0.05)
    assert 100 * std[3] / 0.08 == pytest.approx(second, abs=0.25)
    expected = bound(record, REFERENCE, noise**2 * np.eye(150))
    np.testing.assert_allclose(std, np.sqrt(np.diag(expected)), rtol=1e-6)


@dataclass(frozen=True)
class Repeated:
    """Fits of many records of one actuator; one row a fit of (K, L, T1, T2, total lag).

    errors : estimate minus truth over the bound's standard deviation
    stds : standard error over the bound's
    inside : whether the interval holds the truth
    """

    errors: Array
    stds: Array
    inside: Array


def repeated(count: int, correlation: float, seed: int) -> Repeated:
    random = np.random.default_rng(seed)
    truth = np.array([1.0, 0.12, 0.25, 0.08, 0.45])
    sums = np.vstack([np.eye(4), [0, 1, 1, 1]])
    errors, stds, inside = [], [], []
    for _ in range(count):
        test = pulses(random)
        n = test.times.size
        record = test.record(REFERENCE, ar1_noise(n, 0.005, correlation, random), bias=0.03)
        best = sums @ bound(record, REFERENCE, ar1_covariance(n, 0.005, correlation), np.zeros(4)) @ sums.T
        model = steering_model(fit_actuator([record], start=parameters(REFERENCE)).fit)
        names = ("gain", "dead_time", "time_constant_1", "time_constant_2", "total_lag")
        found: list[Estimate] = [getattr(model, name) for name in names]
        scale = np.sqrt(np.diag(best))
        errors.append(
            [(one.value - true) / size for one, true, size in zip(found, truth, scale, strict=True)]
        )
        stds.append([one.std / size for one, size in zip(found, scale, strict=True)])
        inside.append([one.low <= true <= one.high for one, true in zip(found, truth, strict=True)])
    return Repeated(np.array(errors), np.array(stds), np.array(inside))


COUNT = 60


@pytest.fixture(scope="module", params=[0.0, 0.9], ids=["white", "AR1"])
def repeated_fits(request: pytest.FixtureRequest) -> Repeated:
    return repeated(COUNT, request.param, 12)


def test_the_spread_of_fits_is_that_of_the_bound(repeated_fits: Repeated) -> None:
    spread = np.sum(repeated_fits.errors**2, axis=0)
    low, high = chi2.ppf([0.0005, 0.9995], COUNT)
    assert np.all(spread > low), spread
    assert np.all(spread < high * 1.2), spread  # the noise is estimated too: 1.2 on the variance


def test_fits_have_no_bias_to_speak_of(repeated_fits: Repeated) -> None:
    assert np.all(np.abs(repeated_fits.errors.mean(axis=0)) < 3.3 / np.sqrt(COUNT))


def test_standard_errors_are_those_of_the_bound(repeated_fits: Repeated) -> None:
    np.testing.assert_allclose(np.median(repeated_fits.stds, axis=0), 1.0, atol=0.1)


def test_intervals_hold_the_truth_as_often_as_they_say(repeated_fits: Repeated) -> None:
    fewest = binom.ppf(0.0005, COUNT, 0.93)
    assert np.all(repeated_fits.inside.sum(axis=0) >= fewest), repeated_fits.inside.sum(axis=0)


# --- the start ------------------------------------------------------------------------------------

SHAPES = {
    "fast": (0.03, 0.005),
    "equal": (0.05, 0.05),
    "usual": (0.3, 0.1),
    "slow": (1.0, 0.3),
    "slow and fast": (1.0, 0.02),
    "ringing": (20.0, 0.3),
    "slowly ringing": (3.0, 0.5),
    "hardly damped": (8.0, 0.15),
}
UNDERDAMPED = {"ringing", "slowly ringing", "hardly damped"}


def actuator_of(name: str, dead_time: float) -> Actuator:
    if name in UNDERDAMPED:
        return Actuator.from_damping(0.9, dead_time, *SHAPES[name])
    return Actuator(0.9, dead_time, *SHAPES[name])


@pytest.mark.parametrize("dead_time", [0.0, 0.13, 0.6])
@pytest.mark.parametrize("name", SHAPES)
def test_the_best_fit_is_found_from_the_data_alone(name: str, dead_time: float) -> None:
    actuator = actuator_of(name, dead_time)
    random = np.random.default_rng([7, int(100 * dead_time), len(name)])
    for test in (pulses(random, on=5.0, off=4.0, sizes=(1.0, -0.7)), sines(random, (1.5, 4.0, 9.0))):
        noise = ar1_noise(test.times.size, 0.005, 0.0, random)
        record = test.record(actuator, noise, bias=0.01)
        fit = fit_actuator([record])
        assert fit.fit.converged
        assert fit.rms < 1.02 * np.sqrt(np.mean(noise**2))  # no worse than the truth is
        assert fit.fit.shared[0] == pytest.approx(0.9, abs=0.02)


def test_the_search_thins_long_records_and_keeps_the_runs_apart() -> None:
    random = np.random.default_rng(3)
    test = pulses(random, sizes=(1.0,) * 30)
    one = test.record(REFERENCE, ar1_noise(test.times.size, 0.01, 0.0, random), bias=0.2)
    two = test.record(REFERENCE, ar1_noise(test.times.size, 0.01, 0.0, random), bias=-0.1, run=1)
    few = thinned([one, two])
    assert sum(record.times.size for record in few) < 4000
    assert [record.run for record in few] == [0, 1]
    np.testing.assert_allclose(search_start([one, two])[BIAS:], [0.2, -0.1], atol=0.01)


def test_many_records_are_thinned_to_some_that_are_spread() -> None:
    test = pulses(np.random.default_rng(3))
    record = test.record(REFERENCE, np.zeros(test.times.size))
    runs = [
        record.run for record in thinned([ActuatorRecord(**{**vars(record), "run": i}) for i in range(90)])
    ]
    assert len(runs) <= 24
    assert (runs[0], runs[-1]) == (0, 89)


# --- shapes ---------------------------------------------------------------------------------------


def fitted(actuator: Actuator, seed: int = 1, noise: float = 0.004, bias: float = 0.02) -> ActuatorFit:
    random = np.random.default_rng(seed)
    test = pulses(random, on=4.0, off=3.0, sizes=(1.0, -0.7))
    record = test.record(actuator, ar1_noise(test.times.size, noise, 0.0, random), bias=bias)
    return fit_actuator([record])


@pytest.mark.parametrize("gain", [1.0, 0.6, 1.4])
@pytest.mark.parametrize(
    ("actuator", "shape"),
    [
        (Actuator(1.0, 0.1, 0.3, 0.06), "overdamped"),
        (Actuator(1.0, 0.1, 0.15, 0.15), "critically_damped"),
        (Actuator.from_damping(1.0, 0.1, 8.0, 0.5), "underdamped"),
        (Actuator(1.0, 0.1, 0.3, 1e-6), "first_order"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_the_shape_is_told_whatever_the_gain(actuator: Actuator, shape: str, gain: float) -> None:
    found = fitted(Actuator(gain, actuator.dead_time, actuator.time_constant_1, actuator.time_constant_2))
    name, why = classify(found.fit)
    assert name == shape
    assert "T1 T2/(T1 + T2)² is" in why
    model = steering_model(found.fit)
    assert model.gain.value == pytest.approx(gain, abs=5 * model.gain.std)


def test_an_underdamped_response_has_a_frequency_and_a_damping_and_no_time_constants() -> None:
    model = steering_model(fitted(Actuator.from_damping(1.0, 0.1, 8.0, 0.5)).fit)
    assert model.natural_frequency.value == pytest.approx(8.0, abs=4 * model.natural_frequency.std)
    assert model.damping_ratio.value == pytest.approx(0.5, abs=4 * model.damping_ratio.std)
    assert model.damping_ratio.std < 0.01
    for constant in (model.time_constant_1, model.time_constant_2):
        assert constant.value is None
        assert "complex poles" in constant.reason
    # T1 + T2 is the denominator's a1 = 2 zeta / omega, real whatever the poles are.
    assert model.total_lag.value == pytest.approx(0.1 + 2 * 0.5 / 8.0, abs=4 * model.total_lag.std)


def test_a_first_order_response_has_no_second_pole_to_tell() -> None:
    model = steering_model(fitted(Actuator(1.0, 0.1, 0.3, 1e-6)).fit)
    assert model.natural_frequency.value is None
    assert model.damping_ratio.value is None
    assert "first order" in model.damping_ratio.reason


# --- what is said of a fit ------------------------------------------------------------------------


def test_a_second_lag_is_refused_above_half_its_value() -> None:
    covariance = np.diag([1e-8, 1e-8, 1e-8, 0.02**2])
    refused = steering_model(a_fit((1.0, 0.1, 0.3, 0.05), covariance * 4)).time_constant_2
    assert (refused.value, refused.status) == (None, "not_identifiable")
    assert refused.high is not None
    weak = steering_model(a_fit((1.0, 0.1, 0.3, 0.05), covariance)).time_constant_2
    assert weak.status == "weak"
    assert weak.value is not None
    assert "above 20 %" in weak.reason
    known = steering_model(a_fit((1.0, 0.1, 0.3, 0.05), covariance / 100)).time_constant_2
    assert (known.status, known.reason) == ("identified", None)


def test_the_errors_of_time_constants_follow_from_those_of_the_denominator() -> None:
    T1, T2 = 0.25, 0.08
    truth = Actuator(1.0, 0.12, T1, T2)
    to = np.linalg.inv(time_constant_map(truth))
    root = np.array([[1, 0, 0, 0], [0.2, 1, 0, 0], [0.1, -0.8, 1, 0], [0, 0.9, -0.5, 1]]) * 1e-4
    covariance = root @ root.T
    expected = np.sqrt(np.diag(to @ covariance @ to.T))
    model = steering_model(a_fit(tuple(parameters(truth)[:4]), covariance))
    for name, value, std in (
        ("gain", 1.0, expected[0]),
        ("dead_time", 0.12, expected[1]),
        ("time_constant_1", T1, expected[2]),
        ("time_constant_2", T2, expected[3]),
    ):
        found = getattr(model, name)
        assert found.value == pytest.approx(value, rel=1e-9)
        assert found.std == pytest.approx(std, rel=1e-2)
        assert found.high - found.low == pytest.approx(2 * 1.96 * std, rel=2e-2)
    assert model.total_lag.std == pytest.approx(np.sqrt([0, 1, 1, 0] @ covariance @ [0, 1, 1, 0]), rel=1e-9)
    names, joint = joint_covariance(a_fit(tuple(parameters(truth)[:4]), covariance))
    assert names == [f"steering.{n}" for n in ("gain", "dead_time", "time_constant_1", "time_constant_2")]
    np.testing.assert_allclose(joint, to @ covariance @ to.T, rtol=2e-2, atol=1e-12)


def test_near_critical_damping_the_time_constants_keep_their_order() -> None:
    fit = a_fit((1.0, 0.1, 0.3, 0.2499), np.diag([1e-8, 1e-8, 1e-8, 0.01**2]))
    model = steering_model(fit)
    assert classify(fit)[0] == "critically_damped"
    assert model.time_constant_1.low >= 0.15 - 1e-3
    assert model.time_constant_2.high <= 0.15 + 1e-3


def test_the_joint_covariance_of_an_underdamped_response_is_of_frequency_and_damping() -> None:
    omega, zeta = 8.0, 0.5
    covariance = np.diag([1e-8, 1e-8, 1e-8, 1e-6])
    names, joint = joint_covariance(a_fit((1.0, 0.1, 2 * zeta / omega, 1.0), covariance))
    assert names[2:] == ["steering.natural_frequency", "steering.damping_ratio"]
    by_rho = np.array([-omega / 2, -zeta / 2])  # at rho = 1
    by_sum = np.array([-omega / 0.125, 0.0])
    expected = 1e-6 * np.outer(by_rho, by_rho) + 1e-8 * np.outer(by_sum, by_sum)
    np.testing.assert_allclose(joint[2:, 2:], expected, rtol=2e-2, atol=1e-9)


def test_an_interval_is_students() -> None:
    assert estimate(2.0, 0.1, "1", 5).high == pytest.approx(2.0 + 2.5706 * 0.1, abs=1e-4)
    assert estimate(2.0, 0.1, "1", 10**6).low == pytest.approx(2.0 - 1.96 * 0.1, abs=1e-4)


@pytest.mark.parametrize(("std", "status"), [(0.1, "identified"), (0.3, "weak"), (0.6, "not_identifiable")])
def test_the_status_goes_by_the_relative_error(std: float, status: str) -> None:
    one = estimate(1.0, std, "s", 100)
    assert one.status == status
    assert (one.reason is None) == (status == "identified")
    assert estimate(0.01, std, "s", 100, scale=1.0).status == status


def test_a_model_of_wrong_data_is_doubted() -> None:
    model = doubted(steering_model(a_fit((1.0, 0.1, 0.3, 0.15), np.diag([1e-8, 1e-8, 1e-8, 1e-8]))))
    assert {getattr(model, name).status for name in vars(model)} == {"weak"}


def test_fits_that_agree_have_a_uniform_p_value() -> None:
    random = np.random.default_rng(1)
    root = np.array([[1, 0, 0, 0], [0.2, 1, 0, 0], [0.1, -0.8, 1, 0], [0, 0.9, -0.5, 1]]) * 1e-3
    found = []
    for _ in range(300):
        fits = []
        for scale in (1.0, 2.0, 0.5):
            values = np.array([1.0, 0.1, 0.3, 0.15]) + scale * root @ random.standard_normal(4)
            fits.append(ActuatorFit(a_fit(tuple(values), scale**2 * root @ root.T), [], 1.0, 0.0))
        found.append(agreement(fits))
    assert np.mean(np.array(found) < 0.05) == pytest.approx(0.05, abs=3.3 * np.sqrt(0.05 * 0.95 / 300))
    assert np.mean(found) == pytest.approx(0.5, abs=3.3 / np.sqrt(12 * 300))
    assert agreement(fits[:1]) is None


# --- noise and rates ------------------------------------------------------------------------------


def test_jittered_stamps_are_taken_for_continuous_noise() -> None:
    random = np.random.default_rng(5)
    test = pulses(random, sizes=(1.0, -0.7, 0.5))
    jittered = Test(
        test.command_times,
        test.command_values,
        np.sort(test.times + random.uniform(-0.009, 0.009, test.times.size)),
    )
    white = ar1_noise(test.times.size, 0.004, 0.0, random)
    fit = fit_actuator([jittered.record(REFERENCE, white)], jitter=0.5)
    assert isinstance(fit.fit.noise.shape, ContinuousAr1)
    assert fit.fit.noise.total_std == pytest.approx(0.004, rel=0.1)
    np.testing.assert_array_less(
        np.abs(fit.fit.shared - parameters(REFERENCE)), 4 * np.sqrt(np.diag(fit.fit.covariance))
    )


@pytest.mark.parametrize(("request_rate", "rate"), [(100, 20), (20, 100), (10, 200), (100, 10)])
def test_request_and_answer_may_have_very_different_rates(request_rate: int, rate: int) -> None:
    random = np.random.default_rng(request_rate)
    test = pulses(random, rate=request_rate, sizes=(1.0, -0.7))
    times = np.arange(test.command_times[0] + 0.003, test.command_times[-1], 1 / rate)
    sampled = Test(test.command_times, test.command_values, times)
    record = sampled.record(REFERENCE, ar1_noise(times.size, 0.003, 0.0, random), bias=-0.05)
    fit = fit_actuator([record])
    np.testing.assert_array_less(
        np.abs(fit.fit.shared - parameters(REFERENCE, -0.05)), 4 * np.sqrt(np.diag(fit.fit.covariance))
    )
    best = bound(record, REFERENCE, 0.003**2 * np.eye(times.size), np.zeros(4))
    assert np.sqrt(fit.fit.covariance[1, 1] / best[1, 1]) == pytest.approx(1.0, abs=0.25)


def test_data_without_noise_are_fitted_to_rounding() -> None:
    fit = fitted(REFERENCE, noise=0.0)
    np.testing.assert_allclose(fit.fit.shared, parameters(REFERENCE, 0.02), rtol=1e-6)
    assert np.all(np.isfinite(fit.fit.covariance))
    model = steering_model(fit.fit)
    for name in vars(model):
        found = getattr(model, name)
        assert all(x is None or np.isfinite(x) for x in (found.value, found.std, found.low, found.high))


def test_an_angle_that_leads_its_request_has_a_negative_dead_time() -> None:
    model = steering_model(fitted(Actuator(1.0, -0.08, 0.25, 0.08)).fit)
    assert model.dead_time.value == pytest.approx(-0.08, abs=4 * model.dead_time.std)


def test_a_wrong_sign_is_named() -> None:
    random = np.random.default_rng(1)
    test = pulses(random)
    record = test.record(Actuator(-1.0, 0.12, 0.25, 0.08), ar1_noise(test.times.size, 0.004, 0.0, random))
    with pytest.raises(NotIdentifiable, match=r"gain -[01]\.\d+\): one of the two has the wrong sign"):
        search_start([record])


def rate_limited() -> ActuatorRecord:
    """An answer that no linear model gives: its rate is limited to 0.5 rad/s."""
    test = pulses(np.random.default_rng(2), on=4.0, off=4.0, sizes=(1.0, -0.2, 0.6))
    request = np.interp(test.times - 0.1, test.command_times, test.command_values)
    angle = np.zeros_like(test.times)
    for k in range(1, angle.size):
        angle[k] = angle[k - 1] + np.clip(request[k] - angle[k - 1], -0.01, 0.01)
    record = test.record(REFERENCE, np.zeros(test.times.size))
    return ActuatorRecord(**{**vars(record), "measured": angle})


def test_a_wrong_model_is_fitted_no_worse_than_by_least_squares() -> None:
    plain, likely = fit_roughly([rate_limited()]), fit_actuator([rate_limited()])
    assert plain.misfit
    assert likely.rms <= 1.1 * plain.rms or likely.vaf >= plain.vaf - 0.02


def test_derivatives_of_the_bound_are_those_of_the_likelihood() -> None:
    """The two independent derivatives agree where the bound of these tests uses them."""
    test = pulses(np.random.default_rng(1))
    record = test.record(REFERENCE, np.zeros(test.times.size))
    linear = ActuatorProblem([record]).linearise(parameters(REFERENCE), [np.zeros(4)])[0]
    shared, local = derivatives(record, parameters(REFERENCE), np.zeros(4))
    np.testing.assert_allclose(linear.shared, shared, rtol=0, atol=1e-9)
    np.testing.assert_allclose(linear.local, local, rtol=0, atol=1e-9)
