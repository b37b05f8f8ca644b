"""Output error on small problems whose answer is known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from actuator_truth import ar1_covariance, ar1_noise
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.optimize import least_squares, lsq_linear

from ident.estimation.noise import AutoRegression, Linearised, NoiseShape
from ident.estimation.noise_fit import fit_autoregression
from ident.estimation.output_error import (
    WHITE,
    Fit,
    fit_least_squares,
    fit_output_error,
    linear_score,
)

Array = NDArray[np.float64]
Identify = Callable[[Sequence[Linearised], NoiseShape | None], NoiseShape]


def known(shape: NoiseShape) -> Identify:
    return lambda _records, _like: shape


@dataclass(frozen=True)
class Data:
    measured: Array
    shared: Array
    local: Array
    prior: Array


@dataclass(frozen=True)
class Linear:
    """y_i = S_i theta + Q_i lambda_i + noise."""

    data: Sequence[Data]
    low: Array = field(default_factory=lambda: np.full(2, -np.inf))
    high: Array = field(default_factory=lambda: np.full(2, np.inf))

    def linearise(self, shared: Array, local: Sequence[Array]) -> list[Linearised]:
        return [
            Linearised(
                times=np.arange(one.measured.size) * 0.01,
                residual=one.measured - one.shared @ shared - one.local @ own,
                shared=one.shared,
                local=one.local,
                starts=np.zeros(1, dtype=np.intp),
                prior=one.prior,
                prior_residual=np.where(np.isfinite(one.prior), -own, 0.0),
            )
            for one, own in zip(self.data, local, strict=True)
        ]

    def inside(self, shared: Array) -> Array:
        return np.clip(shared, self.low, self.high)


def some_data(correlation: float = 0.0, prior: float = np.inf, count: int = 3, n: int = 80) -> list[Data]:
    random = np.random.default_rng(8)
    made = []
    for _ in range(count):
        t = np.linspace(0, 1, n)
        shared = np.column_stack([t, np.sin(7 * t + random.uniform(0, 6))])
        local = np.column_stack([np.exp(-5 * t), t * np.exp(-3 * t)])
        own = random.normal(0, 1, 2)
        noise = ar1_noise(n, 0.1, correlation, random)
        made.append(
            Data(shared @ [2.0, -1.0] + local @ own + noise, shared, local, np.array([np.inf, prior]))
        )
    return made


def whole(data: Sequence[Data]) -> tuple[Array, Array]:
    """Columns of (theta, all lambdas) and the answers."""
    local = block_diag(*[one.local for one in data])
    columns = np.column_stack([np.vstack([one.shared for one in data]), local])
    return columns, np.concatenate([one.measured for one in data])


def fitted(problem: Linear, identify: Identify, start: tuple[float, float] = (0.0, 0.0)) -> Fit:
    nothing = [np.zeros(2) for _ in problem.data]
    return fit_output_error(problem, np.array(start), nothing, identify_noise=identify)


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_a_linear_problem_is_solved_by_generalised_least_squares(correlation: float) -> None:
    data = some_data(correlation)
    columns, answers = whole(data)
    inverse = np.linalg.inv(block_diag(*[ar1_covariance(80, 1.0, correlation)] * 3))
    information = columns.T @ inverse @ columns
    expected = np.linalg.solve(information, columns.T @ inverse @ answers)
    shape = AutoRegression(np.array([correlation])) if correlation else WHITE
    fit = fitted(Linear(data), known(shape))
    np.testing.assert_allclose(fit.shared, expected[:2], rtol=0, atol=1e-8)
    np.testing.assert_allclose(np.concatenate(fit.local), expected[2:], rtol=0, atol=1e-7)
    left = answers - columns @ expected
    np.testing.assert_allclose(np.concatenate(fit.residuals), left, rtol=0, atol=1e-8)
    variance = left @ inverse @ left / (240 - 8)
    np.testing.assert_allclose(fit.covariance, variance * np.linalg.inv(information)[:2, :2], rtol=1e-6)
    assert fit.freedom == 240 - 8
    assert fit.noise.total_std == pytest.approx(np.sqrt(variance), rel=1e-6)
    assert fit.converged


def test_a_prior_of_a_local_parameter_weighs_as_bayes_says() -> None:
    data = some_data(prior=0.3)
    columns, answers = whole(data)
    fit = fitted(Linear(data), known(WHITE))
    prior = np.zeros(8)
    prior[[3, 5, 7]] = (fit.noise.std / 0.3) ** 2
    information = columns.T @ columns + np.diag(prior)
    expected = np.linalg.solve(information, columns.T @ answers)
    np.testing.assert_allclose(fit.shared, expected[:2], rtol=0, atol=1e-5)
    np.testing.assert_allclose(
        np.concatenate(fit.local), expected[2:], rtol=1e-3
    )  # the size of the noise is settled to that
    np.testing.assert_allclose(
        fit.covariance, fit.noise.std**2 * np.linalg.inv(information)[:2, :2], rtol=2e-3
    )


def test_local_columns_that_say_the_same_do_no_harm() -> None:
    data = some_data()
    twice = [
        Data(
            d.measured, d.shared, np.column_stack([d.local, d.local[:, 0], np.zeros(80)]), np.full(4, np.inf)
        )
        for d in data
    ]
    once = fitted(Linear(data), known(WHITE))
    again = fit_output_error(Linear(twice), np.zeros(2), [np.zeros(4)] * 3, identify_noise=known(WHITE))
    np.testing.assert_allclose(again.shared, once.shared, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again.covariance, once.covariance, rtol=1e-6)
    assert again.freedom == once.freedom


def test_the_colour_of_the_noise_is_identified_beside_the_parameters() -> None:
    data = some_data(0.8, count=4, n=2000)
    fit = fitted(Linear(data), fit_autoregression)
    assert isinstance(fit.noise.shape, AutoRegression)
    np.testing.assert_allclose(fit.noise.shape.coefficients, [0.8], rtol=0, atol=4 * 0.6 / np.sqrt(8000))
    assert fit.noise.total_std == pytest.approx(0.1, rel=0.1)
    np.testing.assert_array_less(np.abs(fit.shared - [2.0, -1.0]), 4 * np.sqrt(np.diag(fit.covariance)))


def test_a_parameter_at_its_border_leaves_the_best_to_the_others() -> None:
    data = some_data()
    bounded = Linear(data, low=np.array([-np.inf, -0.5]), high=np.array([np.inf, 5.0]))
    fit = fitted(bounded, known(WHITE), start=(0.0, 0.0))
    columns, answers = whole(data)
    low, high = np.full(8, -np.inf), np.full(8, np.inf)
    low[1], high[1] = -0.5, 5.0
    expected = lsq_linear(columns, answers, (low, high), tol=1e-14).x
    assert fit.shared[1] == -0.5
    assert fit.shared[0] == pytest.approx(expected[0], abs=1e-6)
    assert fit.converged


def test_what_the_data_do_not_tell_has_no_error_that_is_small() -> None:
    """Two shared columns of which only the sum is seen, and one that is not seen at all."""
    random = np.random.default_rng(2)
    t = np.linspace(0, 1, 200)
    columns = np.column_stack([t, t, np.zeros(200)])
    data = Data(3 * t + 0.1 * random.standard_normal(200), columns, np.zeros((200, 0)), np.zeros(0))
    problem = Linear([data], low=np.full(3, -np.inf), high=np.full(3, np.inf))
    fit = fit_output_error(problem, np.zeros(3), [np.zeros(0)], identify_noise=known(WHITE))
    assert np.all(np.diag(fit.covariance) > 1e6)
    both = np.array([1.0, 1.0, 0.0])
    assert np.sqrt(both @ fit.covariance @ both) < 1.0
    assert fit.shared[0] + fit.shared[1] == pytest.approx(3.0, abs=0.1)


def test_the_score_of_some_columns_is_that_of_least_squares() -> None:
    data = some_data()
    records = Linear(data).linearise(np.array([2.0, 0.0]), [np.zeros(2)] * 3)
    columns, _ = whole(data)
    answers = np.concatenate([r.residual for r in records])
    kept = columns[:, 1:]
    expected = np.linalg.lstsq(kept, answers, rcond=None)[0]
    score, change = linear_score(records, [1])
    assert score == pytest.approx(float(np.square(answers - kept @ expected).sum()), rel=1e-9)
    np.testing.assert_allclose(change, expected[:1], rtol=0, atol=1e-10)


@dataclass(frozen=True)
class Decay:
    """y = exp(-t / tau) with offsets: a nonlinear problem with a far start."""

    measured: Array
    times: Array

    def linearise(self, shared: Array, local: Sequence[Array]) -> list[Linearised]:
        tau, size = shared
        shape = np.exp(-self.times / tau)
        columns = np.column_stack([size * shape * self.times / tau**2, shape])
        offset = np.ones((self.times.size, 1))
        residual = self.measured - size * shape - local[0][0]
        zero = np.zeros(1)
        starts = np.zeros(1, dtype=np.intp)
        return [Linearised(self.times, residual, columns, offset, starts, np.array([np.inf]), zero)]

    def inside(self, shared: Array) -> Array:
        return np.clip(shared, [0.01, -np.inf], [100.0, np.inf])


@pytest.mark.parametrize("start", [(0.05, 0.1), (8.0, 0.1), (0.5, -3.0)])
def test_a_nonlinear_problem_is_solved_from_afar(start: tuple[float, float]) -> None:
    times = np.linspace(0, 5, 300)
    random = np.random.default_rng(4)
    measured = 1.5 * np.exp(-times / 0.7) + 0.2 + 0.01 * random.standard_normal(300)
    problem = Decay(measured, times)
    fit = fit_output_error(problem, np.array(start), [np.zeros(1)], identify_noise=known(WHITE))
    reference = least_squares(
        lambda x: measured - x[1] * np.exp(-times / x[0]) - x[2], [0.7, 1.5, 0.2], xtol=1e-14, ftol=1e-14
    )
    np.testing.assert_allclose([*fit.shared, fit.local[0][0]], reference.x, rtol=1e-5)
    variance = 2 * reference.cost / (300 - 3)
    expected = variance * np.linalg.inv(reference.jac.T @ reference.jac)[:2, :2]
    np.testing.assert_allclose(fit.covariance, expected, rtol=1e-3)
    assert fit.converged


def test_least_squares_takes_its_errors_from_the_scores_where_the_residual_is_coloured() -> None:
    random = np.random.default_rng(11)
    t = np.arange(1500) * 0.01
    columns = np.column_stack([np.sin(1.3 * t), np.cos(0.7 * t)])
    nothing = np.zeros((1500, 0))
    values, reported = [], []
    for _ in range(60):
        measured = columns @ [2.0, -1.0] + ar1_noise(1500, 0.1, 0.97, random)
        fit = fit_least_squares(
            Linear([Data(measured, columns, nothing, np.zeros(0))]), np.zeros(2), [np.zeros(0)]
        )
        values.append(fit.shared)
        reported.append(np.sqrt(np.diag(fit.covariance)))
        assert fit.noise.shape is WHITE
    spread, mean = np.std(values, axis=0), np.mean(reported, axis=0)
    white = 0.1 / np.sqrt(750)
    assert np.all(spread > 4 * white)  # what errors of white noise would hide
    # A spread of 60 is known to 9 %; Bartlett's weights cut the tail of the correlation.
    np.testing.assert_allclose(mean / spread, 1.0, atol=0.3)
