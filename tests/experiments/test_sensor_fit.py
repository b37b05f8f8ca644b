"""Scale, bias and lag with known truth: noise does not pull them, and intervals hold in coloured noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import t

from ident.experiments.sensor_fit import Comparison, fit_sensor, is_instrument

STEP = 0.02


def motion(seconds: float, random: np.random.Generator, lag: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Time, and a sum of sines up to 0.5 Hz, later by ``lag``."""
    time = STEP * np.arange(round(seconds / STEP))
    phases = random.uniform(0, 2 * np.pi, 4)
    parts = [
        np.sin(2 * np.pi * f * (time - lag) + p) for f, p in zip((0.05, 0.13, 0.29, 0.5), phases, strict=True)
    ]
    return time, np.sum(parts, axis=0) / 4


def coloured(random: np.random.Generator, count: int, correlation_time: float) -> np.ndarray:
    """Stationary noise of standard deviation one."""
    a = np.exp(-STEP / correlation_time)
    return lfilter([np.sqrt(1 - a * a)], [1.0, -a], random.standard_normal(count + 2000))[2000:]


def compared(
    seed: int,
    *,
    scale: float = 1.0,
    bias: float = 0.0,
    lag: float = 0.0,
    noise: float = 0.05,
    noise_of_expected: float = 0.0,
    instrument_noise: float | None = None,
    seconds: float = 150.0,
    colour: float = 0.5,
) -> Comparison:
    random = np.random.default_rng(seed)
    time, true = motion(seconds, random)
    late = np.interp(time - lag, time, true)
    measured = scale * late + bias + noise * coloured(random, time.size, colour)
    expected = true + noise_of_expected * coloured(random, time.size, colour)
    one = np.ones(time.size)
    instrument = expected
    if instrument_noise is not None:
        instrument = 7.0 * true + instrument_noise * coloured(random, time.size, colour)
    return Comparison(
        time,
        measured,
        np.zeros(time.size),
        np.column_stack([expected, one]),
        np.column_stack([instrument, one]),
    )


def test_scale_bias_and_lag_are_found_together() -> None:
    fit = fit_sensor([compared(1, scale=1.07, bias=-0.2, lag=0.34)])
    assert fit.coefficients == pytest.approx([1.07, -0.2], abs=0.03)
    assert fit.lag == pytest.approx(0.34, abs=0.02)
    assert np.all(fit.std[:2] < 0.03)


@pytest.mark.parametrize("lag", [-1.2, -0.05, 0.6, 1.4])
def test_without_noise_the_lag_is_exact(lag: float) -> None:
    fit = fit_sensor([compared(2, lag=lag, noise=1e-9)])
    assert fit.lag == pytest.approx(lag, abs=1e-4)
    assert fit.coefficients[0] == pytest.approx(1.0, abs=1e-3)


def test_noise_of_what_is_expected_does_not_pull_the_scale_to_zero() -> None:
    runs = [compared(seed, noise_of_expected=0.12, instrument_noise=0.5) for seed in range(8)]
    assert is_instrument(runs, 0)
    own = [Comparison(run.time, run.measured, run.fixed, run.columns, run.columns) for run in runs]
    pulled, kept = fit_sensor(own), fit_sensor(runs)
    assert pulled.coefficients[0] < 0.95
    assert kept.coefficients[0] == pytest.approx(1.0, abs=3 * kept.std[0])
    assert kept.std[0] < 0.01


def test_without_an_instrument_both_regressions_hold_the_truth_between_them() -> None:
    fit = fit_sensor([compared(seed, noise_of_expected=0.12, noise=0.05) for seed in range(8)], reverse=0)
    assert fit.apart[0] > 0.02
    assert abs(fit.coefficients[0] - 1.0) < fit.apart[0] + 2 * fit.std[0]


def test_another_signal_is_no_instrument() -> None:
    run = compared(3)
    other = np.random.default_rng(9).standard_normal(run.time.size)
    stranger = Comparison(
        run.time, run.measured, run.fixed, run.columns, np.column_stack([other, run.columns[:, 1]])
    )
    assert not is_instrument([stranger], 0)


@pytest.mark.parametrize("colour", [0.05, 0.5, 2.0])
def test_a_perfect_sensor_lies_in_its_interval(colour: float) -> None:
    """Of 120 seeds at least 93 % hold the truth, scale, bias and lag alike."""
    count, held = 120, np.zeros(3)
    for seed in range(count):
        given = compared(
            seed, colour=colour, noise=0.1, noise_of_expected=0.1, instrument_noise=0.5, seconds=120.0
        )
        fit = fit_sensor([given])
        off = np.array([*(fit.coefficients - [1.0, 0.0]), fit.lag])
        from_student = np.array([_half(freedom) for freedom in fit.freedom])
        held += np.abs(off) <= from_student * fit.std
    assert np.all(held >= 0.93 * count), held / count


def _half(freedom: float) -> float:
    return float(t.ppf(0.975, freedom))


def test_a_bias_that_changes_from_run_to_run_has_the_error_of_the_runs() -> None:
    same = [compared(seed, bias=0.1) for seed in range(6)]
    other = [compared(seed, bias=0.1 * (-1) ** seed) for seed in range(6)]
    assert not fit_sensor(same).uneven.any()
    fit = fit_sensor(other)
    assert fit.uneven[1]
    assert fit.std[1] == pytest.approx(0.1 / np.sqrt(6), rel=0.5)
    assert fit.freedom[1] < 6


def test_too_short_a_run_tells_nothing() -> None:
    fit = fit_sensor([compared(4, seconds=20.0)])
    assert fit.blocks < 6
    assert np.isinf(fit.std).all()


def test_what_does_not_vary_cannot_be_told_apart() -> None:
    run = compared(5)
    constant = np.column_stack([np.full(run.time.size, 2.0), np.ones(run.time.size)])
    fit = fit_sensor([Comparison(run.time, run.measured, run.fixed, constant, constant)], with_lag=False)
    assert np.isinf(fit.std).all()


def test_both_parts_of_a_vector_are_fitted_with_one_angle() -> None:
    random = np.random.default_rng(6)
    time, true = motion(120.0, random)
    arrow = (8.0 + true) * np.exp(1j * np.cumsum(0.1 * true) * STEP)
    noise = 0.02 * (coloured(random, time.size, 0.3) + 1j * coloured(random, time.size, 0.3))
    columns = np.column_stack([arrow, 1j * arrow])
    measured = (1.01 + 0.005j) * np.interp(time - 0.08, time, arrow) + noise
    fit = fit_sensor([Comparison(time, measured, np.zeros(time.size), columns, columns)])
    assert fit.coefficients == pytest.approx([1.01, 0.005], abs=1e-3)
    assert fit.lag == pytest.approx(0.08, abs=0.01)
