"""Whitening against exact covariance matrices."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov, toeplitz
from scipy.signal import lfilter

from ident.estimation.noise import (
    LARGEST_POLE,
    AutoRegression,
    ContinuousAr1,
    Linearised,
    NoiseModel,
    NoiseShape,
)

Array = NDArray[np.float64]

PROCESSES = {
    "white": np.zeros(0),
    "AR(1)": np.array([0.9]),
    "AR(1), alternating": np.array([-0.6]),
    "AR(2), complex poles": np.array([1.5, -0.8]),
    "AR(3)": np.array([0.5, 0.2, 0.1]),
}
ANY = pytest.mark.parametrize("coefficients", PROCESSES.values(), ids=PROCESSES.keys())


def record(times: Array, starts: tuple[int, ...] = (0,)) -> Linearised:
    empty = np.zeros((times.size, 0))
    return Linearised(
        times, np.zeros(times.size), empty, empty, np.array(starts, dtype=np.intp), np.zeros(0), np.zeros(0)
    )


def autocovariance(coefficients: Array, lags: int) -> Array:
    """(lags,) of the process with innovations of variance one, from its impulse response."""
    impulse = np.zeros(4000)
    impulse[0] = 1.0
    response = lfilter([1.0], np.concatenate([[1.0], -coefficients]), impulse)
    return np.array([response[: 4000 - k] @ response[k:] for k in range(lags)])


def filter_matrix(shape: NoiseShape, one: Linearised) -> Array:
    return shape.whiten(np.eye(one.times.size), one)


@ANY
def test_whitened_samples_have_unit_covariance(coefficients: Array) -> None:
    one = record(np.arange(40) * 0.01)
    covariance = toeplitz(autocovariance(coefficients, 40))
    white = filter_matrix(AutoRegression(coefficients), one)
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(40), rtol=0, atol=1e-9)


@ANY
def test_the_noise_restarts_after_an_interruption(coefficients: Array) -> None:
    one = record(np.arange(20) * 0.01, (0, 1, 3, 12))
    covariance = np.zeros((20, 20))
    for begin, end in one.blocks():
        covariance[begin:end, begin:end] = toeplitz(autocovariance(coefficients, end - begin))
    white = filter_matrix(AutoRegression(coefficients), one)
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(20), rtol=0, atol=1e-9)


@ANY
def test_the_size_of_the_noise_follows_from_that_of_its_innovations(coefficients: Array) -> None:
    shape = AutoRegression(coefficients)
    total = np.sqrt(autocovariance(coefficients, 1)[0])
    assert shape.total_over_innovations() == pytest.approx(total, rel=1e-9)
    assert NoiseModel(shape, 0.02).total_std == pytest.approx(0.02 * total, rel=1e-9)


def test_continuous_noise_is_whitened_on_uneven_stamps_and_across_interruptions() -> None:
    times = np.cumsum(np.random.default_rng(2).uniform(0.001, 0.08, 30))
    times[20:] += 0.4
    covariance = np.exp(-np.abs(times[:, None] - times) / 0.05)
    white = filter_matrix(ContinuousAr1(0.05), record(times, (0, 11, 20)))
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(30), rtol=0, atol=1e-12)


def test_evenly_sampled_continuous_noise_is_AR1() -> None:  # noqa: N802
    one = record(np.arange(30) * 0.01)
    a = np.exp(-0.01 / 0.05)
    by_time = filter_matrix(ContinuousAr1(0.05), one)
    by_index = filter_matrix(AutoRegression(np.array([a])), one)
    np.testing.assert_allclose(by_time * np.sqrt(1 - a**2), by_index, rtol=0, atol=1e-12)


@pytest.mark.parametrize("coefficients", [np.array([1.2]), np.array([1.0]), np.array([2.0, -1.0001])])
def test_a_process_that_is_not_stationary_is_drawn_to_the_border(coefficients: Array) -> None:
    drawn = AutoRegression(coefficients).made_stationary()
    assert drawn.largest_pole() < LARGEST_POLE
    assert drawn.largest_pole() == pytest.approx(LARGEST_POLE, abs=2e-3)
    assert np.isfinite(drawn.total_over_innovations())


@ANY
def test_the_first_samples_have_the_determinant_of_their_covariance(coefficients: Array) -> None:
    order = coefficients.size
    if order == 0:
        assert AutoRegression(coefficients).log_determinant() == 0.0
        return
    companion = np.vstack([coefficients, np.eye(order)[:-1]])
    covariance = solve_discrete_lyapunov(companion, np.outer(np.eye(order)[0], np.eye(order)[0]))
    assert AutoRegression(coefficients).log_determinant() == pytest.approx(np.linalg.slogdet(covariance)[1])


def test_poles_that_crowd_at_the_border_leave_the_first_samples_exactly_predicted() -> None:
    poles = [0.998, 0.9893 * np.exp(0.01j), 0.9893 * np.exp(-0.01j), 0.9757, -0.1365]
    shape = AutoRegression(-np.real(np.poly(poles))[1:])
    with localcontext() as context:
        context.prec = 60
        own, variance, expected = [Decimal(float(a)) for a in shape.coefficients], Decimal(1), []
        for k in range(4, -1, -1):
            last = own[k]
            own = [(own[i] + last * own[k - 1 - i]) / (1 - last * last) for i in range(k)]
            variance /= 1 - last * last
            expected.append([float(-a / variance.sqrt()) for a in own[::-1]] + [float(1 / variance.sqrt())])
    white = filter_matrix(shape, record(np.arange(12.0)))
    for k, row in enumerate(expected[::-1]):
        np.testing.assert_allclose(white[k, : k + 1], row, rtol=1e-5)


def test_a_stationary_process_is_left_alone() -> None:
    shape = AutoRegression(np.array([1.5, -0.8]))
    assert shape.made_stationary() is shape
    assert shape.largest_pole() == pytest.approx(np.sqrt(0.8))


def test_correlation_lasts_until_the_slowest_pole_has_decayed() -> None:
    assert AutoRegression(np.array([np.exp(-1 / 25)])).correlation_samples() == pytest.approx(25)
    assert AutoRegression(np.zeros(0)).correlation_samples() == 0


def test_shapes_that_differ_in_kind_or_order_are_not_close() -> None:
    one = AutoRegression(np.array([0.5]))
    assert one.close_to(AutoRegression(np.array([0.5004])))
    assert not one.close_to(AutoRegression(np.array([0.502])))
    assert not one.close_to(AutoRegression(np.array([0.5, 0.0])))
    assert not one.close_to(ContinuousAr1(0.5))
    assert ContinuousAr1(0.5).close_to(ContinuousAr1(0.5001))
    assert not ContinuousAr1(0.5).close_to(one)
