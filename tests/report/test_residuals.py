import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from ident.report import residuals
from ident.report.residuals import Block
from ident.results import Noise


def ar_noise(coefficients, size, seed=0, std=1e-3):
    shocks = np.random.default_rng(seed).normal(0, std, size + 500)
    return lfilter([1.0], [1.0, *(-np.array(coefficients))], shocks)[500:]


def noise(ar=(), **fields):
    values = {
        "kind": "ar",
        "std": 1e-3,
        "total_std": 1e-3,
        "correlation_time": None,
        "quantisation": None,
        **fields,
    }
    return Noise(ar=list(ar), **values)


def blocks_of(values, pieces=4, period=0.01):
    return [Block(np.arange(part.size) * period, part) for part in np.array_split(values, pieces)]


def test_the_noise_model_of_order_one_decays_as_its_coefficient():
    lag = np.arange(8) * 0.01
    np.testing.assert_allclose(
        residuals.noise_autocorrelation(noise([0.7]), lag), 0.7 ** np.arange(8), atol=1e-9
    )


def test_the_noise_model_of_order_two_fulfils_the_yule_walker_equations():
    a1, a2 = 1.2, -0.5
    rho = residuals.noise_autocorrelation(noise([a1, a2]), np.arange(20) * 0.01)
    assert rho[1] == pytest.approx(a1 / (1 - a2), abs=1e-9)
    np.testing.assert_allclose(rho[2:], a1 * rho[1:-1] + a2 * rho[:-2], atol=1e-9)


def test_white_noise_and_continuous_noise():
    lag = np.arange(5) * 0.01
    np.testing.assert_array_equal(residuals.noise_autocorrelation(noise(), lag), [1, 0, 0, 0, 0])
    continuous = noise(kind="continuous_ar1", correlation_time=0.05)
    np.testing.assert_allclose(residuals.noise_autocorrelation(continuous, lag), np.exp(-lag / 0.05))


def test_the_pooled_autocorrelation_is_the_sum_over_pairs_inside_blocks():
    blocks = [np.array([1.0, -2.0, 4.0]), np.array([0.0, -3.0])]
    rho = residuals.autocorrelation(blocks, 2)
    covariance = [(1 + 4 + 16 + 0 + 9) / 5, (-2 - 8 + 0) / 3, 4 / 1]
    np.testing.assert_allclose(rho, np.array(covariance) / covariance[0], atol=1e-12)


def test_innovations_of_the_true_noise_model_are_the_shocks():
    values = ar_noise([0.5, 0.2], 4000, std=2e-3)
    left = np.concatenate(residuals.innovations(blocks_of(values), noise([0.5, 0.2])))
    assert left.size == 4000 - 4 * 2
    assert left.std() == pytest.approx(2e-3, rel=0.05)


def test_innovations_on_uneven_stamps_have_one_variance():
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.002, 0.05, 6000))
    values = np.zeros(6000)
    for index in range(1, 6000):
        decay = np.exp(-(time[index] - time[index - 1]) / 0.03)
        values[index] = decay * values[index - 1] + np.sqrt(1 - decay**2) * rng.normal()
    model = noise(kind="continuous_ar1", correlation_time=0.03)
    (left,) = residuals.innovations([Block(time, values)], model)
    short = np.diff(time) < 0.02
    assert left[short].std() == pytest.approx(1.0, rel=0.05)
    assert left[~short].std() == pytest.approx(1.0, rel=0.05)


def test_true_noise_stays_inside_the_bound_and_a_wrong_model_does_not():
    blocks = blocks_of(ar_noise([0.8], 20_000))
    right = residuals.correlation(blocks, noise([0.8]))
    wrong = residuals.correlation(blocks, noise([0.3]))
    assert np.mean(np.abs(right.innovation[1:]) > right.bound) < 0.1
    assert np.mean(np.abs(wrong.innovation[1:6]) > wrong.bound) == 1.0
    np.testing.assert_allclose(right.residual[:10], right.noise[:10], atol=0.05)
    np.testing.assert_allclose(right.lag[1], 0.01)


def test_too_few_samples_say_nothing():
    assert residuals.correlation([], noise()) is None
    assert residuals.correlation([Block(np.arange(8.0), np.zeros(8))], noise()) is None


def residual_table(time, **columns):
    return pd.DataFrame(
        {"run": "a", "part": 0, "time": time, "residual": 1.0, "experiment": 0, "used": True, **columns}
    )


def test_blocks_end_where_another_experiment_begins_and_where_samples_are_not_used():
    frame = residual_table(np.arange(200) * 0.01, experiment=np.repeat([0, 0, 1, 1], 50))
    frame.loc[150:, "used"] = False
    assert [block.residual.size for block in residuals.residual_blocks(frame, noise())] == [100, 50]


def test_one_missing_sample_ends_a_block_where_the_noise_model_counts_samples():
    frame = residual_table(np.arange(200) * 0.01)
    frame.loc[80, "residual"] = np.nan
    assert [block.residual.size for block in residuals.residual_blocks(frame, noise())] == [80, 119]
    uneven = noise(kind="continuous_ar1", correlation_time=0.05)
    assert [block.residual.size for block in residuals.residual_blocks(frame, uneven)] == [199]


def test_the_density_integrates_to_the_share_inside():
    values = np.random.default_rng(0).normal(0, 2e-3, 50_000)
    values[:500] = 1.0
    centre, height, outside = residuals.density(blocks_of(values))
    assert outside == pytest.approx(0.01, abs=5e-4)
    assert height.sum() * (centre[1] - centre[0]) == pytest.approx(1 - outside)
    assert height.max() == pytest.approx(0.99 / (2e-3 * np.sqrt(2 * np.pi)), rel=0.08)
