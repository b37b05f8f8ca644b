"""Filter and smoother against the joint normal distribution of a whole record, written down at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from ident.estimation.kalman import LinearSystem, filtered, smoothed

Array = NDArray[np.float64]

COUNT, STATES, OUTPUTS = 12, 3, 2
DRIVING = 0.7


def made(seed: int) -> LinearSystem:
    """Any system; a third of the numbers is missing, and one whole instant."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(COUNT, STATES, STATES))
    measured = random.normal(size=(COUNT, OUTPUTS))
    measured[random.uniform(size=measured.shape) < 0.3] = np.nan
    measured[4] = np.nan
    return LinearSystem(
        transition=np.eye(STATES) + 0.3 * random.normal(size=(COUNT, STATES, STATES)),
        drift=random.normal(size=(COUNT, STATES)),
        driven=root @ root.swapaxes(1, 2),
        measuring=random.normal(size=(COUNT, OUTPUTS, STATES)),
        offset=random.normal(size=(COUNT, OUTPUTS)),
        noise=random.uniform(0.2, 2.0, OUTPUTS),
        measured=measured,
        start=random.normal(size=STATES),
        start_covariance=np.diag(random.uniform(0.5, 2.0, STATES)),
    )


def joint(system: LinearSystem) -> tuple[Array, Array]:
    """Mean (k n,) and covariance (k n, k n) of all states before anything is measured."""
    means, blocks = [system.start], np.zeros((COUNT, COUNT, STATES, STATES))
    blocks[0, 0] = system.start_covariance
    for k in range(1, COUNT):
        turn = system.transition[k]
        means.append(turn @ means[-1] + system.drift[k])
        for j in range(k):
            blocks[k, j] = turn @ blocks[k - 1, j]
            blocks[j, k] = blocks[k, j].T
        blocks[k, k] = turn @ blocks[k - 1, k - 1] @ turn.T + DRIVING * system.driven[k]
    return np.concatenate(means), blocks.transpose(0, 2, 1, 3).reshape(COUNT * STATES, COUNT * STATES)


def conditioned(system: LinearSystem) -> tuple[Array, Array, float]:
    """Mean and covariance of all states given all that was measured, and the log density of that."""
    mean, covariance = joint(system)
    seen = np.isfinite(system.measured).ravel()
    rows = np.zeros((COUNT * OUTPUTS, COUNT * STATES))
    for k in range(COUNT):
        rows[k * OUTPUTS : (k + 1) * OUTPUTS, k * STATES : (k + 1) * STATES] = system.measuring[k]
    rows = rows[seen]
    expected = rows @ mean + system.offset.ravel()[seen]
    spread = rows @ covariance @ rows.T + np.diag(np.tile(system.noise, COUNT)[seen])
    measured = system.measured.ravel()[seen]
    gain = np.linalg.solve(spread, rows @ covariance).T
    density = float(multivariate_normal(expected, spread).logpdf(measured))
    return mean + gain @ (measured - expected), covariance - gain @ rows @ covariance, density


@pytest.mark.parametrize("seed", range(3))
def test_the_smoother_gives_what_all_measurements_say_together(seed: int) -> None:
    system = made(seed)
    states, covariances = smoothed(system, filtered(system, DRIVING))
    mean, covariance, _ = conditioned(system)
    assert states.ravel() == pytest.approx(mean, rel=1e-7, abs=1e-8)
    for k in range(COUNT):
        own = slice(k * STATES, (k + 1) * STATES)
        assert covariances[k] == pytest.approx(covariance[own, own], rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_innovations_hold_the_likelihood_of_the_record(seed: int) -> None:
    system = made(seed)
    assert filtered(system, DRIVING).log_likelihood == pytest.approx(conditioned(system)[2], rel=1e-9)


def test_the_filter_knows_the_past_only() -> None:
    system = made(5)
    changed = system.measured.copy()
    changed[8:] += 3.0
    before, after = filtered(system, DRIVING), filtered(replace(system, measured=changed), DRIVING)
    assert np.array_equal(before.states[:8], after.states[:8])
    assert np.abs(before.states[8:] - after.states[8:]).max() > 0.1
    past = smoothed(system, before)[0] - smoothed(system, after)[0]
    assert np.abs(past[:8]).max() > 1e-3
