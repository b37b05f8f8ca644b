"""One sensor against what others make expect of it: scale, bias and lag, with errors that hold in any colour.

    y(t) = f(t - lag) + sum_j c_j x_j(t - lag) + e(t)

by Gauss-Newton in the lag, whose column is minus the derivative of what is modelled. The expected side holds
noise, too, which would pull its coefficient to zero; where an instrument z_j is there (another signal that
moves with x_j and shares no noise with it, of any unit) the normal equations are Z'(y - X c) = 0 and
the pull is gone (instrumental variables; Söderström and Stoica 1983). Without one, the two regressions of y
on x and of x on y hold the truth between them (Frisch 1934), and the interval covers both.

Standard errors: jackknife over blocks that are longer than the colour of what is left (Cameron and Miller
2015, doi:10.3368/jhr.50.2.317), with Student's t at the number of blocks that carry the coefficient. Where
what the blocks of a run say together scatters more from run to run than the blocks do (a bias that is another
one after each start), the runs take the place of the blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Array = NDArray[np.float64]
Series = NDArray[np.inexact[Any]]
Index = NDArray[np.intp]

EVERY = 5  # samples of the grid between two rows of the regression
BLOCK, COLOURS = 5.0, 4.0  # [s] at least, and in times the correlation time of what is left
FEWEST_BLOCKS, AIMED_BLOCKS = 6, 10
LARGEST_LAG, SCAN = 1.6, 0.1  # [s]
ROUNDS, STEP, ENOUGH = 12, 0.3, 1e-5  # Gauss-Newton in the lag [s]
UNEVEN, FEWEST_RUNS = 0.01, 1.8  # p-value; runs that carry a coefficient
STRONG = 0.5  # correlation of an instrument with what it stands for


@dataclass(frozen=True)
class Comparison:
    """One run: a sensor and what the others make expect of it, on one uniform grid, NaN where unknown.

    measured, fixed : (n,) real, or complex for the two parts of a vector; fixed has the coefficient one
    columns : (n, c) with unknown coefficients; instruments : (n, c), a column of its own where none is better
    """

    time: Array
    measured: Series
    fixed: Series
    columns: Series
    instruments: Series


@dataclass(frozen=True)
class SensorFit:
    """What a comparison gives.

    coefficients : (c,); lag : [s]
    std, freedom : (c + 1,) standard errors, the last of the lag, and degrees of freedom
    uneven : (c + 1,) whether it is not the same in all runs
    apart : (c,) half the distance of the two regressions that hold the coefficient between them
    correlation : of measured and expected, each without its mean; rest : standard deviation of what is left
    blocks : how many blocks of independent noise there are; seconds : compared
    """

    coefficients: Array
    lag: float
    std: Array
    freedom: Array
    uneven: NDArray[np.bool_]
    apart: Array
    correlation: float
    rest: float
    blocks: int
    seconds: float


@dataclass(frozen=True)
class _Prepared:
    """A run with its derivatives, on the grid time (n,); at (m,): the instants of the rows.

    known, change : (n, 1 + 2 c) fixed part, columns and instruments, and their derivatives; measured : (m,)
    """

    time: Array
    at: Array
    measured: Series
    known: Series
    change: Series


@dataclass(frozen=True)
class _Rows:
    """Rows of the regression: y (r,), X and Z (r, k), when (r,) [s], run (r,)."""

    y: Array
    x: Array
    z: Array
    time: Array
    run: Index


def fit_sensor(runs: Sequence[Comparison], *, with_lag: bool = True, reverse: int | None = None) -> SensorFit:
    """Fit all runs together.

    Parameters
    ----------
    with_lag : False: the lag is zero
    reverse : column that is noisy and has no instrument: its coefficient is bounded by both regressions
    """
    ahead = _fitted(runs, with_lag=with_lag)
    if reverse is None or not np.isfinite(ahead.std).all():
        return ahead
    back = _fitted([_with_measured(run, reverse) for run in runs], with_lag=with_lag)
    if not np.isfinite(back.std).all():
        return ahead
    return replace(
        ahead,
        coefficients=(ahead.coefficients + back.coefficients) / 2,
        apart=np.abs(ahead.coefficients - back.coefficients) / 2,
        std=np.maximum(ahead.std, back.std),
        freedom=np.minimum(ahead.freedom, back.freedom),
    )


def is_instrument(runs: Sequence[Comparison], column: int) -> bool:
    """Whether the instrument of a column moves with it."""
    pairs = [(run.columns[::EVERY, column], run.instruments[::EVERY, column]) for run in runs]
    x, z = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
    both = np.isfinite(x) & np.isfinite(z)
    if np.count_nonzero(both) < 10 or np.ptp(x[both]) == 0 or np.ptp(z[both]) == 0:
        return False
    return bool(abs(np.corrcoef(x[both].real, z[both].real)[0, 1]) > STRONG)


def _with_measured(run: Comparison, column: int) -> Comparison:
    """Use the measured side as the instrument: the regression of x on y."""
    instruments = run.instruments.copy()
    instruments[:, column] = run.measured
    return replace(run, instruments=instruments)


def _fitted(runs: Sequence[Comparison], *, with_lag: bool) -> SensorFit:
    count = runs[0].columns.shape[1] if runs else 0
    ready = [_prepared(run) for run in runs]
    lag = _scan(ready) if with_lag else 0.0
    coefficients = _solved(_rows(ready, lag, None))
    for _ in range(ROUNDS if with_lag else 0):
        found = _solved(_rows(ready, lag, coefficients))
        step = float(np.clip(found[-1], -STEP, STEP))
        coefficients = found[:-1]
        lag = float(np.clip(lag + step, -LARGEST_LAG, LARGEST_LAG))
        if abs(step) < ENOUGH:
            break
    rows = _rows(ready, lag, coefficients if with_lag else None)
    found = _solved(rows)
    rest = rows.y - rows.x @ found
    block = _blocks(rows, rest)
    std, freedom, uneven = _jackknife(rows, block)
    if not with_lag:
        std, freedom, uneven = np.append(std, np.inf), np.append(freedom, 1.0), np.append(uneven, False)
    return SensorFit(
        coefficients=found[:count],
        lag=lag,
        std=std,
        freedom=freedom,
        uneven=uneven,
        apart=np.zeros(count),
        correlation=_correlation(rows.y, rows.x @ found),
        rest=float(np.std(rest)) if rest.size else np.nan,
        blocks=int(block.max(initial=-1)) + 1,
        seconds=_seconds(runs, rows),
    )


def _seconds(runs: Sequence[Comparison], rows: _Rows) -> float:
    """How long was compared [s]; a vector has two rows for each instant."""
    if not runs or runs[0].time.size < 2:
        return 0.0
    parts = 2 if np.iscomplexobj(runs[0].measured) else 1
    return rows.time.size * EVERY * float(runs[0].time[1] - runs[0].time[0]) / parts


def _scan(runs: Sequence[_Prepared]) -> float:
    """Lag on a coarse grid that leaves least; zero unless another is clearly better."""
    lags = np.round(np.arange(-LARGEST_LAG + SCAN, LARGEST_LAG - SCAN / 2, SCAN), 9)
    left = []
    for lag in lags.tolist():
        rows = _rows(runs, lag, None)
        rest = rows.y - rows.x @ _least_squares(rows.x, rows.y)
        left.append(float(np.mean(rest**2)) if rest.size else np.inf)
    best, zero = int(np.argmin(left)), int(np.argmin(np.abs(lags)))
    return float(lags[best]) if left[best] < 0.9 * left[zero] else 0.0


def _prepared(run: Comparison) -> _Prepared:
    known = np.column_stack([run.fixed, run.columns, run.instruments])
    change = np.gradient(known, run.time, axis=0) if run.time.size > 1 else np.zeros_like(known)
    return _Prepared(run.time, run.time[::EVERY], run.measured[::EVERY], known, change)


def _rows(runs: Sequence[_Prepared], lag: float, coefficients: Array | None) -> _Rows:
    """Rows at a lag; with coefficients (c,), the last column is that of the lag."""
    made = [_rows_of(run, number, lag, coefficients) for number, run in enumerate(runs)]
    return _Rows(*(np.concatenate([getattr(one, name) for one in made]) for name in _Rows.__annotations__))


def _rows_of(run: _Prepared, number: int, lag: float, coefficients: Array | None) -> _Rows:
    count = run.known.shape[1] // 2
    fixed, x, z = np.split(_at(run, run.known, lag), [1, 1 + count], axis=1)
    y = np.asarray(run.measured - fixed[:, 0])
    if coefficients is not None:
        fixed_change, x_change, z_change = np.split(_at(run, run.change, lag), [1, 1 + count], axis=1)
        sized = _sized(x, z, coefficients)
        x = np.column_stack([x, -fixed_change[:, 0] - x_change @ coefficients])
        z = np.column_stack([z, -fixed_change[:, 0] - z_change @ sized])
    rows = np.isfinite(y) & np.isfinite(x).all(axis=1) & np.isfinite(z).all(axis=1)
    y, x, z, time = y[rows], x[rows], z[rows], run.at[rows]
    if np.iscomplexobj(run.measured):
        y, x, z = (np.concatenate([one.real, one.imag]) for one in (y, x, z))
        time = np.concatenate([time, time])
    return _Rows(y.real, x.real, z.real, time, np.full(time.size, number, dtype=np.intp))


def _at(run: _Prepared, series: Series, lag: float) -> Series:
    """Series (n, k) later by ``lag`` at the instants of the rows, NaN where unknown."""
    if lag == 0:
        return np.asarray(series[::EVERY])
    at = run.at - lag
    made = [np.interp(at, run.time, column, left=np.nan, right=np.nan) for column in series.T]
    return np.column_stack(made)


def _sized(x: Series, z: Series, coefficients: Array) -> Array:
    """Coefficients with the unit of the instruments, so that their sum moves like the modelled."""
    both = np.isfinite(x).all(axis=1) & np.isfinite(z).all(axis=1)
    if not both.any():
        return coefficients
    size = np.linalg.norm(x[both], axis=0) / np.maximum(np.linalg.norm(z[both], axis=0), 1e-300)
    return np.asarray(coefficients * size)


# --- least squares --------------------------------------------------------------------------------


def _least_squares(x: Array, y: Array) -> Array:
    scale = np.maximum(np.linalg.norm(x, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(x / scale, y, rcond=1e-10)[0] / scale)


def _solved(rows: _Rows) -> Array:
    """Coefficients (k,) of Z'(y - X c) = 0."""
    moments, right = rows.z.T @ rows.x, rows.z.T @ rows.y
    return _least_squares(moments, right)


def _blocks(rows: _Rows, rest: Array) -> Index:
    """(r,) number of the block of each row."""
    rate = 1 / float(np.median(np.abs(np.diff(rows.time)))) if rows.time.size > 1 else 1.0
    total = rows.time.size / rate
    length = max(BLOCK, min(COLOURS * _colour(rows, rest), total / AIMED_BLOCKS))
    key = rows.run.astype(np.float64) * 1e7 + np.floor(rows.time / length)
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.intp)


def _colour(rows: _Rows, rest: Array) -> float:
    """Time after which what is left has an autocorrelation below 0.2 [s], at most 8 s."""
    if rest.size < 20:
        return 0.0
    step = float(np.median(np.abs(np.diff(rows.time))))
    size = 1 << int(2 * rest.size - 1).bit_length()
    power = np.abs(np.fft.rfft(rest - rest.mean(), size)) ** 2
    found = np.fft.irfft(power, size)[: min(rest.size // 4, round(8.0 / step))]
    below = np.flatnonzero(found < 0.2 * found[0])
    return float(below[0] if below.size else found.size) * step


def _jackknife(rows: _Rows, block: Index) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Leave out each block in turn: standard errors, degrees of freedom, whether runs differ, (k,) each."""
    width, count = rows.x.shape[1], int(block.max(initial=-1)) + 1
    nothing = np.full(width, np.inf), np.ones(width), np.zeros(width, dtype=np.bool_)
    if count < FEWEST_BLOCKS or rows.y.size <= width:
        return nothing
    size_x, size_z = (np.maximum(np.linalg.norm(one, axis=0), 1e-300) for one in (rows.x, rows.z))
    x, z = rows.x / size_x, rows.z / size_z
    moments, right = np.zeros((count, width, width)), np.zeros((count, width))
    np.add.at(moments, block, z[:, :, None] * x[:, None, :])
    np.add.at(right, block, z * rows.y[:, None])
    whole, left = moments.sum(axis=0), moments.sum(axis=0) - moments
    if max(np.linalg.cond(whole), np.max(np.linalg.cond(left))) > 1e8:
        return nothing
    all_of_it = np.linalg.solve(whole, right.sum(axis=0))
    without = np.linalg.solve(left, (right.sum(axis=0) - right)[..., None])[..., 0]
    influence = np.sqrt((count - 1) / count) * (without - all_of_it) / size_x
    freedom = np.array([_freedom(x, block, column) for column in range(width)])
    run = np.zeros(count, dtype=np.intp)
    run[block] = rows.run
    return _by_run(influence, freedom, run)


def _by_run(influence: Array, freedom: Array, run: Index) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Errors from what blocks (b, k) add, or from what runs add where those scatter more than blocks do."""
    by_block = np.sum(influence**2, axis=0)
    neighbours = 2 * np.sum((influence[1:] * influence[:-1])[run[1:] == run[:-1]], axis=0)
    sums, shares = (np.zeros((int(run.max()) + 1, influence.shape[1])) for _ in range(2))
    np.add.at(sums, run, influence)
    np.add.at(shares, run, influence**2)
    by_run = np.sum(sums**2, axis=0)
    carrying = by_block**2 / np.maximum(np.sum(shares**2, axis=0), 1e-300)  # runs that tell it
    excess = chi2.sf(carrying * by_run / np.maximum(by_block, 1e-300), np.maximum(carrying - 1, 0.5))
    uneven = (excess < UNEVEN) & (carrying > FEWEST_RUNS)
    within = by_block + np.maximum(neighbours, 0.0)  # colour that is longer than a block
    variance = np.where(uneven, by_run * carrying / np.maximum(carrying - 1, 1e-300), within)
    return np.sqrt(variance), np.where(uneven, np.minimum(carrying - 1, freedom), freedom), uneven


def _freedom(x: Array, block: Index, column: int) -> float:
    """Degrees of freedom: blocks that carry a column, beside what the others can take up, less one."""
    others = np.delete(x, column, axis=1)
    own = x[:, column] - others @ _least_squares(others, x[:, column]) if others.shape[1] else x[:, column]
    carried = np.bincount(block, own**2)
    return max(1.0, float(carried.sum() ** 2 / max(np.sum(carried**2), 1e-300)) - 1.0)


def _correlation(measured: Array, expected: Array) -> float:
    if measured.size < 3 or np.std(measured) == 0 or np.std(expected) == 0:
        return 0.0
    return float(np.corrcoef(measured, expected)[0, 1])
