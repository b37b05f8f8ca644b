"""The colour of the noise under a fit, by restricted maximum likelihood.

The residual of a fit is not the noise: fitting has removed what the m fitted columns could follow, and a
noise model taken from it is biased towards white, so that intervals come out too narrow. The restricted
likelihood (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545), of the part of the data that the
columns cannot reach, has no such bias. With J the columns, V sigma² the covariance of the noise, and
M = [J e]' V^-1 [J e]

    -2 log L_R = (n - m) log RSS + log det(J' V^-1 J) + constant,   RSS = Schur complement of e in M

For AR(p), given the first p samples of each block, M is the quadratic form sum_ij phi_i phi_j G_ij in
phi = (1, -a) with G_ij the lagged products of the columns, computed once; objective and exact gradient
then cost no pass over the data. Columns that only one record has ("local") are eliminated record by record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize, minimize_scalar

from ident.estimation.noise import AutoRegression, ContinuousAr1, Linearised, NoiseShape

Array = NDArray[np.float64]

HIGHEST_ORDER = 6
PATIENCE = 2  # orders without a better criterion after which the search ends
RIDGE = 1e-12
FLAT = 1e-3  # slope of -2 log L at which the search ends
SHORTEST_CORRELATION = 0.05  # of the median sampling interval: white
LONGEST_CORRELATION = 500.0  # of the median sampling interval


@dataclass(frozen=True)
class _Products:
    """Lagged products of one record's columns: (p + 1, p + 1, c, c), with rows after the first p."""

    lagged: Array
    local: int
    ridge: Array


def _lagged_products(record: Linearised, order: int) -> tuple[_Products, int]:
    columns = record.columns()
    width = columns.shape[1]
    lagged = np.zeros((order + 1, order + 1, width, width))
    rows = 0
    for begin, end in record.blocks():
        block = columns[begin:end]
        if len(block) <= order:
            continue
        rows += len(block) - order
        stacked = np.column_stack([block[order - i : len(block) - i] for i in range(order + 1)])
        product = stacked.T @ stacked
        lagged += product.reshape(order + 1, width, order + 1, width).transpose(0, 2, 1, 3)
    local = record.local.shape[1]
    diagonal = np.diag(lagged[0, 0])[:local]
    return _Products(lagged, local, RIDGE * diagonal + np.finfo(float).tiny), rows


class _RestrictedLikelihood:
    """-2 log of the restricted likelihood of AR(p) noise, and its gradient to the coefficients."""

    def __init__(self, products: Sequence[_Products], rows: int, shared: int) -> None:
        """Take the lagged products, which hold rows after the first p of each block only."""
        self.products = products
        self.freedom = max(1, rows - shared - sum(p.local for p in products))

    def __call__(self, coefficients: Array) -> tuple[float, Array]:
        phi = np.concatenate([[1.0], -coefficients])
        order = coefficients.size
        logdet = 0.0
        slope = np.zeros(order)
        reduced: Array | float = 0.0
        reduced_slopes: list[Array | float] = [0.0] * order
        for product in self.products:
            matrix = np.einsum("i,j,ijab->ab", phi, phi, product.lagged)
            slopes = [-(half + half.T) for half in np.einsum("j,ijab->iab", phi, product.lagged[1:])]
            cut = product.local
            if cut:
                matrix[range(cut), range(cut)] += product.ridge
                factor = cho_factor(matrix[:cut, :cut], lower=True)
                across = -cho_solve(factor, matrix[:cut, cut:])
                lift = np.vstack([across, np.eye(matrix.shape[0] - cut)])
                logdet += 2 * float(np.log(np.diag(factor[0])).sum())
                for i, d in enumerate(slopes):
                    slope[i] += float(np.trace(cho_solve(factor, d[:cut, :cut])))
                    reduced_slopes[i] = reduced_slopes[i] + lift.T @ d @ lift
                reduced = reduced + matrix[cut:, cut:] + matrix[cut:, :cut] @ across
            else:
                reduced = reduced + matrix
                for i, d in enumerate(slopes):
                    reduced_slopes[i] = reduced_slopes[i] + d
        return self._finish(np.asarray(reduced), reduced_slopes, logdet, slope)

    def _finish(
        self, reduced: Array, reduced_slopes: Sequence[Array | float], logdet: float, slope: Array
    ) -> tuple[float, Array]:
        """Eliminate the shared columns; what is left is the residual sum of squares."""
        cut = reduced.shape[0] - 1
        inner = reduced[:cut, :cut] + np.diag(RIDGE * np.diag(reduced)[:cut] + np.finfo(float).tiny)
        factor = cho_factor(inner, lower=True)
        solution = cho_solve(factor, reduced[:cut, cut])
        rss = float(reduced[cut, cut] - reduced[cut, :cut] @ solution)
        rss = max(rss, np.finfo(float).tiny)
        logdet += 2 * float(np.log(np.diag(factor[0])).sum())
        lift = np.concatenate([-solution, [1.0]])
        for i, d in enumerate(reduced_slopes):
            matrix = np.asarray(d)
            slope[i] += float(np.trace(cho_solve(factor, matrix[:cut, :cut])))
            slope[i] += self.freedom / rss * float(lift @ matrix @ lift)
        return self.freedom * np.log(rss) + logdet, slope


def fit_autoregression(
    records: Sequence[Linearised], like: NoiseShape | None = None, *, highest_order: int = HIGHEST_ORDER
) -> AutoRegression:
    """AR(p) of the noise under a fit, its order by the Bayesian information criterion.

    All orders are compared on the same rows. Blocks too short to give rows lower the highest order.

    Parameters
    ----------
    records : the linearised problem at the present parameters
    like : where it is an autoregression, its order is kept and its coefficients are the start
    """
    if isinstance(like, AutoRegression):
        return _refitted(records, like)
    highest = _affordable_order(records, highest_order)
    pairs = [_lagged_products(record, highest) for record in records]
    rows = sum(count for _, count in pairs)
    best = start = np.zeros(0)
    best_criterion = np.inf
    for order in range(highest + 1):
        cut = [replace(p, lagged=p.lagged[: order + 1, : order + 1]) for p, _ in pairs]
        objective = _RestrictedLikelihood(cut, rows, records[0].shared.shape[1])
        start, value = _minimised(objective, np.append(start, 0.0) if order else start)
        criterion = value + order * np.log(max(rows, 2))
        if criterion < best_criterion:
            best, best_criterion = start, criterion
        elif order - best.size >= PATIENCE:
            break
    return AutoRegression(best).made_stationary()


def _refitted(records: Sequence[Linearised], like: AutoRegression) -> AutoRegression:
    pairs = [_lagged_products(record, like.coefficients.size) for record in records]
    rows = sum(count for _, count in pairs)
    objective = _RestrictedLikelihood([p for p, _ in pairs], rows, records[0].shared.shape[1])
    return AutoRegression(_minimised(objective, like.coefficients)[0]).made_stationary()


def _minimised(objective: _RestrictedLikelihood, start: Array) -> tuple[Array, float]:
    if start.size == 0:
        return start, objective(start)[0]
    found = minimize(objective, start, jac=True, method="BFGS", options={"gtol": FLAT})
    return np.asarray(found.x, dtype=np.float64), float(found.fun)


def _affordable_order(records: Sequence[Linearised], highest: int) -> int:
    """Largest order that still leaves 90 % of the rows after dropping the head of each block."""
    rows = sum(len(record.residual) for record in records)
    blocks = sum(len(record.starts) for record in records)
    return int(max(0, min(highest, 0.1 * rows // max(blocks, 1))))


def fit_continuous_ar1(records: Sequence[Linearised], like: NoiseShape | None = None) -> ContinuousAr1:
    """Correlation time of continuous-time AR(1) noise under a fit, for stamps that jitter.

    records : the linearised problem at the present parameters
    like : not used, there is only one structure
    """
    del like
    interval = float(np.median(np.concatenate([np.diff(r.times) for r in records])))
    low, high = np.log(SHORTEST_CORRELATION * interval), np.log(LONGEST_CORRELATION * interval)
    found = minimize_scalar(
        lambda x: _continuous_objective(records, float(np.exp(x))), bounds=(low, high), method="bounded"
    )
    return ContinuousAr1(float(np.exp(found.x)))


def _continuous_objective(records: Sequence[Linearised], correlation_time: float) -> float:
    """-2 log of the restricted likelihood, and of the Jacobian of the whitening, which is not one here."""
    shape = ContinuousAr1(correlation_time)
    products, logdet, rows = [], 0.0, 0
    for record in records:
        white = shape.whiten(record.columns(), record)
        local = record.local.shape[1]
        gram = white.T @ white
        products.append(
            _Products(gram[None, None], local, RIDGE * np.diag(gram)[:local] + np.finfo(float).tiny)
        )
        correlation = np.exp(-np.diff(record.times) / correlation_time)
        correlation[record.starts[1:] - 1] = 0.0
        logdet += float(np.log1p(-(correlation**2)).sum())
        rows += len(record.residual)
    objective = _RestrictedLikelihood(products, rows, records[0].shared.shape[1])
    return objective(np.zeros(0))[0] + logdet
