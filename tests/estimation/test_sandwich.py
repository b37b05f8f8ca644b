"""Standard errors over blocks hold for noise of any colour within them."""

from __future__ import annotations

import numpy as np
import pytest

from ident.estimation.sandwich import coefficient


def draw(random: np.random.Generator) -> tuple[float, float]:
    """Estimate of a slope of 2 under noise that is the same all through each block, and its error."""
    block = np.repeat(np.arange(40), 25).astype(np.intp)
    x = np.repeat(random.standard_normal(40), 25) + 0.2 * random.standard_normal(block.size)
    values = 1.0 + 2.0 * x + np.repeat(random.standard_normal(40), 25)
    slope, influence, freedom = coefficient(values, np.column_stack([np.ones(x.size), x]), block, 1)
    assert freedom == 38
    assert influence.shape == (40,)
    return slope, float(np.linalg.norm(influence))


def test_the_error_of_a_slope_under_coloured_noise_is_its_spread() -> None:
    random = np.random.default_rng(1)
    slopes, errors = np.array([draw(random) for _ in range(400)]).T
    assert np.mean(slopes) == pytest.approx(2.0, abs=0.03)
    assert np.sqrt(np.mean(((slopes - 2.0) / errors) ** 2)) == pytest.approx(1.0, abs=0.15)


def test_columns_may_be_of_any_size() -> None:
    random = np.random.default_rng(2)
    columns = np.column_stack([np.ones(300), 1e6 * random.standard_normal(300)])
    block = (np.arange(300) // 10).astype(np.intp)
    slope, influence, _ = coefficient(3.0 + 5e-6 * columns[:, 1], columns, block, 1)
    assert slope == pytest.approx(5e-6, rel=1e-9)
    assert np.linalg.norm(influence) < 1e-12
