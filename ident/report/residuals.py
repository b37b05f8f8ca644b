"""What the residual looks like: its distribution, its autocorrelation, and that of its innovations.

The noise model says y_k = sum a_i y_(k-i) + e_k (or exp(-dt/τ) in place of a_1 where stamps jitter). If the
model explains the data, the residual has the autocorrelation of the noise, and what is left of it after
the noise model has predicted each sample, e_k, has none: 95 % of its values lie inside ±1.96/√n.
Everything restarts at gaps and where another experiment begins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ident.report.condense import Array, contiguous
from ident.results import Noise

MOST_LAGS = 200
SHORTEST_BLOCK = 10
"""Shorter stretches tell nothing of correlation and are left out."""
PERIODS_MISSING = 1.8
"""A sample is missing where the next comes later than so many periods."""
IMPULSE_LENGTH = 20_000


@dataclass(frozen=True)
class Block:
    """A stretch of residual without gaps: (n,) time [s] and (n,) residual [rad]."""

    time: Array
    residual: Array


@dataclass(frozen=True)
class Correlation:
    """Autocorrelations over (m,) lags [s], from lag zero on.

    bound : 1.96/√n, what white noise stays inside at 95 % of the lags
    """

    lag: Array
    residual: Array
    noise: Array
    innovation: Array
    bound: float


def residual_blocks(steering: pd.DataFrame, noise: Noise) -> list[Block]:
    """Cut the residual of the samples used into stretches without gaps, each of one experiment.

    Where the noise model counts samples, one missing sample is a gap.
    """
    used = steering[steering["used"].astype(bool) & steering["residual"].notna()]
    blocks = []
    for _, rows in used.groupby(["run", "part", "experiment"], sort=False):
        time = rows["time"].to_numpy(dtype=np.float64)
        values = rows["residual"].to_numpy(dtype=np.float64)
        blocks += [
            Block(time[stretch], values[stretch])
            for stretch in contiguous(time, limit=_longest_pause(time, noise))
            if stretch.stop - stretch.start >= SHORTEST_BLOCK
        ]
    return blocks


def _longest_pause(time: Array, noise: Noise) -> float | None:
    if noise.kind == "ar" and time.size > 1:
        return PERIODS_MISSING * float(np.median(np.diff(time)))
    return None


def correlation(blocks: list[Block], noise: Noise) -> Correlation | None:
    """Compute all three autocorrelations, None where there are too few samples.

    Parameters
    ----------
    blocks : as ``residual_blocks`` gives them
    noise : the noise model that the fit assumed
    """
    longest = max((block.residual.size for block in blocks), default=0)
    lags = min(MOST_LAGS, longest // 2)
    if lags < SHORTEST_BLOCK // 2:
        return None
    period = float(np.median(np.concatenate([np.diff(block.time) for block in blocks])))
    lag = np.arange(lags + 1, dtype=np.float64) * period
    left = innovations(blocks, noise)
    return Correlation(
        lag=lag,
        residual=autocorrelation([block.residual for block in blocks], lags),
        noise=noise_autocorrelation(noise, lag),
        innovation=autocorrelation(left, lags),
        bound=1.96 / np.sqrt(max(1, sum(values.size for values in left))),
    )


def autocorrelation(blocks: list[Array], lags: int) -> Array:
    """Pool the autocorrelation of blocks about their common mean, no product across a boundary.

    Returns
    -------
    (lags + 1,) ; zero where no block is long enough for a lag
    """
    mean = float(np.mean(np.concatenate(blocks)))
    total, number = np.zeros(lags + 1), np.zeros(lags + 1)
    for block in blocks:
        values = block - mean
        length = 1 << (2 * values.size - 1).bit_length()
        spectrum = np.abs(np.fft.rfft(values, length)) ** 2
        reach = min(lags + 1, values.size)
        total[:reach] += np.fft.irfft(spectrum, length)[:reach]
        number[:reach] += values.size - np.arange(reach)
    covariance = np.divide(total, number, out=np.zeros(lags + 1), where=number > 0)
    return covariance / covariance[0] if covariance[0] > 0 else np.zeros(lags + 1)


def noise_autocorrelation(noise: Noise, lag: Array) -> Array:
    """Give the autocorrelation that the noise model says, at (m,) evenly spaced lags [s]."""
    if noise.kind == "continuous_ar1":
        return (
            np.asarray(np.exp(-lag / noise.correlation_time)) if noise.correlation_time else _white(lag.size)
        )
    impulse = np.zeros(IMPULSE_LENGTH)
    impulse[0] = 1.0
    for index in range(1, IMPULSE_LENGTH):
        reach = min(len(noise.ar), index)
        impulse[index] = sum(noise.ar[i] * impulse[index - 1 - i] for i in range(reach))
        if index > lag.size and np.abs(impulse[index - len(noise.ar) : index + 1]).max() < 1e-9:
            break
    covariance = np.array([impulse[: impulse.size - k] @ impulse[k:] for k in range(lag.size)])
    return np.asarray(covariance / covariance[0])


def _white(size: int) -> Array:
    correlation = np.zeros(size)
    correlation[0] = 1.0
    return correlation


def innovations(blocks: list[Block], noise: Noise) -> list[Array]:
    """Take from each sample what the noise model predicts of it from the ones before.

    The first samples of a block, which have no full past, are left out. With ``continuous_ar1`` each
    value is divided by √(1 - exp(-2 dt/τ)), so that all have the same variance.
    """
    if noise.kind == "continuous_ar1":
        return [_continuous(block, noise.correlation_time) for block in blocks if block.residual.size > 1]
    order = len(noise.ar)
    found = []
    for block in blocks:
        if block.residual.size <= order:
            continue
        left = block.residual[order:].copy()
        for index, coefficient in enumerate(noise.ar):
            left -= coefficient * block.residual[order - 1 - index : block.residual.size - 1 - index]
        found.append(left)
    return found


def _continuous(block: Block, correlation_time: float | None) -> Array:
    if not correlation_time:
        return block.residual
    decay = np.exp(-np.diff(block.time) / correlation_time)
    spread = np.sqrt(np.maximum(1 - decay**2, 1e-12))
    return np.asarray((block.residual[1:] - decay * block.residual[:-1]) / spread)


def density(blocks: list[Block], bins: int = 61) -> tuple[Array, Array, float]:
    """Count the residual in bins: (k,) centres [rad], (k,) density [1/rad], share of samples outside.

    The bins span 4.5 robust standard deviations to either side of the median.
    """
    values = np.concatenate([block.residual for block in blocks])
    middle = float(np.median(values))
    low, high = np.percentile(values, [15.9, 84.1])
    reach = 4.5 * max((high - low) / 2, 1e-9)
    edges = np.linspace(middle - reach, middle + reach, bins + 1)
    counts, _ = np.histogram(values, edges)
    width = edges[1] - edges[0]
    return (edges[:-1] + edges[1:]) / 2, counts / (values.size * width), 1 - counts.sum() / values.size
