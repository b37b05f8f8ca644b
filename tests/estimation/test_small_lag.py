"""Actuators of first order, or nearly so: classified, and with errors that hold what is not known of T2."""

from __future__ import annotations

import numpy as np
import pytest
from actuator_truth import ar1_noise, parameters, pulses, sines
from generator.truth import Actuator

from ident.estimation.actuator_fit import ActuatorFit, classify, fit_actuator, steering_model
from ident.estimation.actuator_likelihood import DEAD_TIME, RATIO

NOISE = 0.005


def fitted(T2: float, seed: int) -> ActuatorFit:
    random = np.random.default_rng(seed)
    actuator = Actuator(0.95, 0.123, 0.3, T2)
    test = pulses(random, sizes=(1.0, -0.7, 0.5)) if seed % 2 else sines(random, (1.5, 4.0, 9.0))
    record = test.record(actuator, ar1_noise(test.times.size, NOISE, 0.0, random), bias=0.03)
    return fit_actuator([record], start=parameters(actuator) + np.array([0, 0, 0, 0.01, 0]))


@pytest.fixture(scope="module")
def first_order() -> list[ActuatorFit]:
    return [fitted(1e-6, seed) for seed in range(10)]


def test_a_first_order_actuator_is_classified_as_one(first_order: list[ActuatorFit]) -> None:
    shapes = [classify(fit.fit)[0] for fit in first_order]
    assert shapes.count("first_order") >= 9  # 1 % each is not: two of ten would happen once in 200


def test_its_dead_time_is_known_to_milliseconds_though_the_second_lag_is_not(
    first_order: list[ActuatorFit],
) -> None:
    for fit in first_order:
        model = steering_model(fit.fit)
        assert model.dead_time.status == "identified"
        assert model.dead_time.std is not None
        assert model.dead_time.std < 0.015
        assert model.time_constant_1.value == pytest.approx(0.3, abs=0.02)
        assert model.total_lag.std == pytest.approx(0.0003, abs=0.0002)


def test_its_second_lag_is_refused_with_an_upper_end(first_order: list[ActuatorFit]) -> None:
    for fit in first_order:
        if classify(fit.fit)[0] != "first_order":
            continue
        T2 = steering_model(fit.fit).time_constant_2
        assert (T2.value, T2.status) == (None, "not_identifiable")
        assert T2.reason is not None
        assert "at most 50 % needed" in T2.reason
        assert T2.low == 0
        assert T2.high is not None
        assert 0.0005 < T2.high < 0.025


@pytest.mark.parametrize("T2", [0.002, 0.006])
def test_intervals_hold_a_second_lag_too_small_to_be_seen(T2: float) -> None:
    inside = np.zeros(4)
    for seed in range(8):
        model = steering_model(fitted(T2, seed).fit)
        truths = ((model.dead_time, 0.123), (model.time_constant_1, 0.3), (model.time_constant_2, T2))
        for index, (estimate, truth) in enumerate((*truths, (model.total_lag, 0.423 + T2))):
            assert estimate.low is not None
            assert estimate.high is not None
            inside[index] += estimate.low <= truth <= estimate.high
    assert np.all(inside >= 6)  # of a true 95 %, fewer happen once in 175


def test_a_second_lag_that_is_seen_stays_in_the_model() -> None:
    for seed in range(4):
        fit = fitted(0.04, seed).fit
        assert classify(fit)[0] == "overdamped"
        T2 = steering_model(fit).time_constant_2
        assert T2.value == pytest.approx(0.04, abs=4 * (T2.std or 0))
        assert T2.status == "identified"


def test_the_dead_time_and_the_second_lag_trade_off_in_the_covariance(first_order: list[ActuatorFit]) -> None:
    covariance = first_order[0].fit.covariance
    correlation = covariance[DEAD_TIME, RATIO] / np.sqrt(
        covariance[DEAD_TIME, DEAD_TIME] * covariance[RATIO, RATIO]
    )
    assert correlation < -0.9
    assert np.all(np.linalg.eigvalsh(covariance) >= -1e-12)
