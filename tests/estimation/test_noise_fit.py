"""The restricted likelihood against dense matrices, and what it recovers from noise of known colour."""

from __future__ import annotations

import numpy as np
import pytest
from actuator_truth import ar1_noise
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from ident.estimation.noise import AutoRegression, Linearised
from ident.estimation.noise_fit import (
    _all_products,
    _continuous_objective,
    _RestrictedLikelihood,
    fit_autoregression,
    fit_continuous_ar1,
)

Array = NDArray[np.float64]


def record(
    residual: Array,
    *,
    shared: Array | None = None,
    local: Array | None = None,
    starts: tuple[int, ...] = (0,),
) -> Linearised:
    n = residual.size
    times = np.arange(n) * 0.01
    shared = np.ones((n, 1)) if shared is None else shared
    local = np.zeros((n, 0)) if local is None else local
    unknown = np.full(local.shape[1], np.inf)
    return Linearised(
        times, residual, shared, local, np.array(starts, dtype=np.intp), unknown, np.zeros_like(unknown)
    )


def autocovariance(coefficients: Array, lags: int) -> Array:
    impulse = np.zeros(4000)
    impulse[0] = 1.0
    response = lfilter([1.0], np.concatenate([[1.0], -coefficients]), impulse)
    return np.array([response[: 4000 - k] @ response[k:] for k in range(lags)])


def some_records(seed: int = 4) -> list[Linearised]:
    """Two records of different widths, one of them interrupted."""
    random = np.random.default_rng(seed)
    t = np.linspace(0, 1, 70)
    trend = np.column_stack([np.ones(70), t])
    fading = np.column_stack([np.exp(-5 * t), t * np.exp(-5 * t)])
    first = record(ar1_noise(70, 1.0, 0.7, random), shared=trend, local=fading, starts=(0, 31))
    second = record(ar1_noise(50, 1.0, 0.7, random), shared=trend[:50], local=fading[:50, :1])
    return [first, second]


def dense(records: list[Linearised], coefficients: Array) -> float:
    """-2 log L_R by whole covariance matrices."""
    shared = records[0].shared.shape[1]
    widths = [r.local.shape[1] for r in records]
    inside = np.zeros((shared + sum(widths) + 1,) * 2)
    logdet, rows = 0.0, 0
    for number, one in enumerate(records):
        columns = np.zeros((one.residual.size, shared + sum(widths) + 1))
        columns[:, :shared] = one.shared
        before = shared + sum(widths[:number])
        columns[:, before : before + widths[number]] = np.linalg.qr(one.local)[0]
        columns[:, -1] = one.residual
        for begin, end in one.blocks():
            covariance = toeplitz(autocovariance(coefficients, end - begin))
            inside += columns[begin:end].T @ np.linalg.solve(covariance, columns[begin:end])
            logdet += np.linalg.slogdet(covariance)[1]
            rows += end - begin
    J, e = inside[:-1, :-1], inside[:-1, -1]
    left = inside[-1, -1] - e @ np.linalg.solve(J, e)
    return float((rows - e.size) * np.log(left) + np.linalg.slogdet(J)[1] + logdet)


COLOURS = pytest.mark.parametrize("coefficients", [[0.7], [1.2, -0.5], [-0.3, 0.1, 0.4]], ids=["1", "2", "3"])


@COLOURS
def test_the_restricted_likelihood_is_that_of_dense_matrices(coefficients: list[float]) -> None:
    records, phi = some_records(), np.array(coefficients)
    objective = _RestrictedLikelihood(*_all_products(records, phi.size))
    reference = np.zeros(phi.size)
    ours = objective(phi)[0] - objective(reference)[0]
    assert ours == pytest.approx(dense(records, phi) - dense(records, reference), abs=1e-6)


@COLOURS
def test_its_gradient_is_exact(coefficients: list[float]) -> None:
    phi = np.array(coefficients)
    objective = _RestrictedLikelihood(*_all_products(some_records(), phi.size))
    step = 1e-6
    expected = [(objective(phi + d)[0] - objective(phi - d)[0]) / (2 * step) for d in step * np.eye(phi.size)]
    np.testing.assert_allclose(objective(phi)[1], expected, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("outside", [[1.0], [-1.3], [2.0, -1.01], [0.9, 0.3], [1.1, 0.3, -1.0]])
def test_noise_that_is_not_stationary_has_no_likelihood(outside: list[float]) -> None:
    phi = np.array(outside)
    objective = _RestrictedLikelihood(*_all_products(some_records(), phi.size))
    assert objective(phi)[0] > 1e9
    assert objective(phi / 10)[0] < 1e9


@pytest.mark.parametrize(
    "coefficients", [[], [0.8], [1.5, -0.8], [0.5, 0.0, 0.3]], ids=["white", "AR1", "AR2", "AR3"]
)
def test_order_and_coefficients_are_recovered(coefficients: list[float]) -> None:
    random = np.random.default_rng(1)
    n, order = 6000, len(coefficients)
    noise = lfilter([1.0], np.concatenate([[1.0], -np.array(coefficients)]), random.standard_normal(n + 500))
    found = fit_autoregression([record(noise[500:])]).coefficients
    assert found.size == order
    # Standard errors are about sqrt(1/n), those of AR(2) near its poles less.
    np.testing.assert_allclose(found, coefficients, rtol=0, atol=4 / np.sqrt(n))


def test_a_known_order_is_kept() -> None:
    random = np.random.default_rng(2)
    noise = ar1_noise(3000, 1.0, 0.6, random)
    again = fit_autoregression([record(noise)], AutoRegression(np.array([0.1, 0.0]))).coefficients
    assert again.size == 2
    np.testing.assert_allclose(again, [0.6, 0.0], rtol=0, atol=0.08)


def test_short_blocks_do_not_ask_for_more_order_than_they_can_tell() -> None:
    noise = np.random.default_rng(3).standard_normal(60)
    for length in (1, 2):
        found = fit_autoregression([record(noise, starts=tuple(range(0, 60, length)))])
        assert found.coefficients.size == 0


def test_many_short_blocks_tell_the_colour_as_one_long_one_does() -> None:
    random = np.random.default_rng(5)
    blocks = np.concatenate([ar1_noise(12, 1.0, 0.7, random) for _ in range(400)])
    found = fit_autoregression([record(blocks, starts=tuple(range(0, blocks.size, 12)))]).coefficients
    np.testing.assert_allclose(found, [0.7], rtol=0, atol=3 * np.sqrt((1 - 0.49) / blocks.size))


def test_the_restricted_likelihood_is_less_biased_than_the_plain_one_on_short_records() -> None:
    random = np.random.default_rng(7)
    t = np.linspace(-1, 1, 60)
    followed = np.column_stack([t**k for k in range(6)])
    restricted, plain = [], []
    for _ in range(120):
        noise = ar1_noise(60, 1.0, 0.8, random)
        residual = noise - followed @ np.linalg.lstsq(followed, noise, rcond=None)[0]
        restricted.append(
            fit_autoregression(
                [record(residual, shared=followed)], AutoRegression(np.array([0.5]))
            ).coefficients[0]
        )
        plain.append(residual[1:] @ residual[:-1] / (residual[:-1] @ residual[:-1]))
    assert np.mean(plain) < 0.6  # the bias is there to be removed
    # What the exact restricted likelihood of dense matrices gives on these very sets.
    assert np.mean(restricted) == pytest.approx(0.7655, abs=0.001)


def jittered(correlation_time: float, seed: int, count: int = 4000) -> Linearised:
    random = np.random.default_rng(seed)
    times = np.arange(count) * 0.02 + random.uniform(-0.008, 0.008, count)
    noise = np.empty(count)
    noise[0] = random.standard_normal()
    for k in range(1, count):
        a = np.exp(-(times[k] - times[k - 1]) / correlation_time)
        noise[k] = a * noise[k - 1] + np.sqrt(1 - a**2) * random.standard_normal()
    empty = np.zeros((count, 0))
    starts = np.zeros(1, dtype=np.intp)
    return Linearised(times, noise, np.ones((count, 1)), empty, starts, np.zeros(0), np.zeros(0))


@pytest.mark.parametrize("correlation_time", [0.05, 0.3])
def test_continuous_noise_on_jittered_stamps_gives_its_correlation_time_back(correlation_time: float) -> None:
    found = [fit_continuous_ar1([jittered(correlation_time, seed)]).correlation_time for seed in range(3)]
    # Relative standard error sqrt(2 tau / T), with T = 80 s.
    allowed = 3 * np.sqrt(2 * correlation_time / 80)
    np.testing.assert_allclose(found, correlation_time, rtol=allowed)


def test_white_noise_has_no_correlation_time_to_speak_of() -> None:
    white = jittered(1e-4, 5)
    assert fit_continuous_ar1([white]).correlation_time < 0.01


def test_the_continuous_objective_is_that_of_dense_matrices() -> None:
    one = jittered(0.1, 6, count=80)
    J, e = one.shared, one.residual

    def expected(tau: float) -> float:
        covariance = np.exp(-np.abs(one.times[:, None] - one.times) / tau)
        inverse = np.linalg.inv(covariance)
        inside = J.T @ inverse @ J
        left = e @ inverse @ e - (J.T @ inverse @ e) @ np.linalg.solve(inside, J.T @ inverse @ e)
        dets = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inside)[1]
        return float((e.size - 1) * np.log(left) + dets)

    ours = _continuous_objective([one], 0.2) - _continuous_objective([one], 0.05)
    assert ours == pytest.approx(expected(0.2) - expected(0.05), abs=1e-6)
