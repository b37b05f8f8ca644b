"""The colour of the noise under a fit, by restricted maximum likelihood.

The residual of a fit is not the noise: fitting has removed what the m fitted columns could follow, and a
noise model taken from it is biased towards white, so that intervals come out too narrow. The restricted
likelihood (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545), of the part of the data that the
columns cannot reach, has no such bias. With J the columns, V sigma² the covariance of the noise, and
M = [J e]' V^-1 [J e]

    -2 log L_R = (n - m) log RSS + log det(J' V^-1 J) + constant,   RSS = Schur complement of e in M

For AR(p), M is the quadratic form sum_ij phi_i phi_j D_ij in phi = (1, -a), with D_ij the lagged products
sum_k x_(i+k) x_(j+k), k = 0 ... n - 1 - i - j (Box and Jenkins, appendix A7.4), computed once; it is exact
for every block of at least 2 p samples, the first p of which count by their stationary covariance. That
adds log det of the latter, once a block, of which the inverse is a quadratic form in phi too (Gohberg and
Semencul). Objective and exact gradient then cost no pass over the data. Columns that only one record has
("local") are eliminated record by record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from ident.estimation.noise import AutoRegression, ContinuousAr1, Linearised, NoiseShape

Array = NDArray[np.float64]

HIGHEST_ORDER = 6
PATIENCE = 2  # orders without a better criterion after which the search ends
ENOUGH_ROWS = 0.9
OUTSIDE = 1e12  # in place of -2 log L where the noise is not stationary
RIDGE = 1e-9  # of each diagonal element of a Gram matrix
ROUNDING = 1e-14
RANK_TOLERANCE = 1e-6
FLAT = 1e-3  # slope of -2 log L at which the search ends, in standard deviations of the coefficients
SHORTEST_CORRELATION = 0.05  # of the median sampling interval: white
LONGEST_CORRELATION = 500.0  # of the median sampling interval


@dataclass(frozen=True)
class _Products:
    """Lagged products of the columns of several records alike in width.

    lagged : (records, p + 1, p + 1, c, c)
    local : how many of the c columns are local
    """

    lagged: Array
    local: int

    def cut(self, order: int) -> _Products:
        """Give the same for a lower order, on the same rows."""
        return _Products(self.lagged[:, : order + 1, : order + 1], self.local)


def _all_products(records: Sequence[Linearised], order: int) -> tuple[list[_Products], int, int]:
    """Products of all records, those of one width together; how many rows and blocks went into them."""
    by_width: dict[int, list[Array]] = {}
    rows = blocks = 0
    for record in records:
        local = _basis(record.local)
        columns = np.column_stack([local, record.shared, record.residual])
        long_enough = [columns[begin:end] for begin, end in record.blocks() if end - begin > 2 * order]
        by_width.setdefault(local.shape[1], []).append(_lagged(long_enough, order, columns.shape[1]))
        rows += sum(len(block) for block in long_enough)
        blocks += len(long_enough)
    return [_Products(np.stack(lagged), local) for local, lagged in by_width.items()], rows, blocks


def _lagged(blocks: Sequence[Array], order: int, width: int) -> Array:
    """(p + 1, p + 1, c, c) sum of x_(i+k) x_(j+k) over k and the blocks."""
    lagged = np.zeros((order + 1, order + 1, width, width))
    for block in blocks:
        n = len(block)
        for i in range(order + 1):
            for j in range(i, order + 1):
                product = block[i : n - j].T @ block[j : n - i]
                lagged[i, j] += product
                if i < j:
                    lagged[j, i] += product.T
    return lagged


def _basis(local: Array) -> Array:
    """(n, r) orthonormal columns that span the same space, without directions that are hardly there."""
    scale = np.linalg.norm(local, axis=0)
    left, size, _ = np.linalg.svd(local[:, scale > 0] / scale[scale > 0], full_matrices=False)
    return np.asarray(left[:, size > RANK_TOLERANCE * size.max(initial=0.0)])


def _head_parts(order: int) -> Array:
    """(p + 1, p + 1, p, p) E_ij of the inverse covariance sum_ij phi_i phi_j E_ij of p successive samples."""
    parts = np.zeros((order + 1, order + 1, order, order))
    below = [np.eye(order, k=-i) for i in range(order + 1)]
    for i in range(order + 1):
        for j in range(order + 1):
            above = below[order - i] @ below[order - j].T if i and j else 0.0
            parts[i, j] = (below[i] @ below[j].T if max(i, j) < order else 0.0) - above
    return parts


def _is_stationary(coefficients: Array) -> bool:
    """Whether all partial correlations are below one, by the recursion of Levinson and Durbin."""
    left = coefficients
    while left.size:
        last = left[-1]
        if not abs(last) < 1:
            return False
        left = (left[:-1] + last * left[:-1][::-1]) / (1 - last**2)
    return True


class _RestrictedLikelihood:
    """-2 log of the restricted likelihood of AR(p) noise, and its gradient to the coefficients."""

    def __init__(self, products: Sequence[_Products], rows: int, blocks: int) -> None:
        """Take the lagged products, and of how many rows and blocks they are."""
        self.products = products
        self.blocks = blocks
        self.shared = products[0].lagged.shape[-1] - products[0].local - 1
        self.freedom = max(1, rows - self.shared - sum(p.local * len(p.lagged) for p in products))
        self.head = _head_parts(products[0].lagged.shape[1] - 1)

    def __call__(self, coefficients: Array) -> tuple[float, Array]:
        if not _is_stationary(coefficients):
            return OUTSIDE, np.zeros(coefficients.size)
        phi = np.concatenate([[1.0], -coefficients])
        own, change = self._of_heads(phi)
        value, slope = self._given_heads(coefficients, phi)
        return value + own, slope + change

    def _of_heads(self, phi: Array) -> tuple[float, Array]:
        """Log determinants of the covariances of the first samples of all blocks."""
        inverse = np.einsum("i,j,ijab->ab", phi, phi, self.head)
        by_phi = 2 * np.einsum("j,ijab,ba->i", phi, self.head[1:], np.linalg.inv(inverse))
        return -self.blocks * float(np.linalg.slogdet(inverse)[1]), self.blocks * by_phi

    def _given_heads(self, coefficients: Array, phi: Array) -> tuple[float, Array]:
        logdet, slope = 0.0, np.zeros(coefficients.size)
        width = self.shared + 1
        reduced, reduced_slopes = np.zeros((width, width)), np.zeros((coefficients.size, width, width))
        for product in self.products:
            matrix, half = _weighted(product.lagged, phi)
            slopes = -(half + half.swapaxes(-1, -2))
            floor = ROUNDING * float(np.abs(phi).sum()) ** 2 * product.lagged[:, 0, 0]
            own, change, schur, lift = _eliminated(matrix, floor, slopes, product.local)
            logdet += own
            slope += change
            reduced += schur.sum(axis=0)
            reduced_slopes += (lift.swapaxes(-1, -2) @ slopes @ lift).sum(axis=1)
        return self._finish(reduced, reduced_slopes, logdet, slope)

    def _finish(
        self, reduced: Array, reduced_slopes: Array, logdet: float, slope: Array
    ) -> tuple[float, Array]:
        """Eliminate the shared columns; what is left is the residual sum of squares."""
        own, change, schur, lift = _eliminated(
            reduced[None], ROUNDING * np.abs(reduced)[None], reduced_slopes[:, None], reduced.shape[0] - 1
        )
        rss = max(float(schur[0, 0, 0]), np.finfo(float).tiny)
        along = (lift[0].T @ reduced_slopes @ lift[0])[:, 0, 0]
        value = self.freedom * np.log(rss) + logdet + own
        return value, slope + change + self.freedom / rss * along


def _weighted(lagged: Array, phi: Array) -> tuple[Array, Array]:
    """Return (r, c, c) sum_ij phi_i phi_j D_ij, and (p, r, c, c) sum_j phi_j D_ij for i from one on."""
    records, size, _, width, _ = lagged.shape
    flat = lagged.reshape(records, size, size, width * width)
    rows = phi @ flat
    matrix = (phi @ rows).reshape(records, width, width)
    return matrix, rows[:, 1:].swapaxes(0, 1).reshape(size - 1, records, width, width)


def _eliminated(matrix: Array, floor: Array, slopes: Array, cut: int) -> tuple[float, Array, Array, Array]:
    """Eliminate the first ``cut`` columns of each Gram matrix.

    matrix : (r, c, c); floor : (r, c, c) of which the diagonal is the rounding error of the matrix's
    slopes : (p, r, c, c) derivatives of the matrices

    Returns
    -------
    log determinants of the first blocks, summed; its p derivatives; the (r, c - cut, c - cut) Schur
    complements; the (r, c, c - cut) maps that take a vector of the rest to the whole
    """
    count, width = matrix.shape[0], matrix.shape[1]
    rest = np.broadcast_to(np.eye(width - cut), (count, width - cut, width - cut))
    if cut == 0:
        return 0.0, np.zeros(len(slopes)), matrix, np.asarray(rest)
    inner = matrix[:, :cut, :cut].copy()
    diagonal = np.arange(cut)
    inner[:, diagonal, diagonal] *= 1 + RIDGE
    inner[:, diagonal, diagonal] += floor[:, diagonal, diagonal] + np.finfo(float).tiny
    logdet = float(np.linalg.slogdet(inner)[1].sum())
    across = -np.linalg.solve(inner, matrix[:, :cut, cut:])
    inverse = np.linalg.inv(inner)
    change = np.einsum("rab,irba->i", inverse, slopes[:, :, :cut, :cut])
    schur = matrix[:, cut:, cut:] + matrix[:, cut:, :cut] @ across
    return logdet, np.asarray(change), schur, np.concatenate([across, rest], axis=1)


def fit_autoregression(
    records: Sequence[Linearised], like: NoiseShape | None = None, *, highest_order: int = HIGHEST_ORDER
) -> AutoRegression:
    """AR(p) of the noise under a fit, its order by the Bayesian information criterion.

    All orders are compared on the same rows. Blocks shorter than twice the order lower the highest one.

    Parameters
    ----------
    records : the linearised problem at the present parameters
    like : where it is an autoregression, its order is kept and its coefficients are the start
    """
    if isinstance(like, AutoRegression):
        return _refitted(records, like)
    highest = _affordable_order(records, highest_order)
    products, rows, blocks = _all_products(records, highest)
    best = start = np.zeros(0)
    best_criterion = np.inf
    for order in range(highest + 1):
        objective = _RestrictedLikelihood([product.cut(order) for product in products], rows, blocks)
        start, value = _minimised(objective, np.append(start, 0.0) if order else start)
        criterion = value + order * np.log(max(rows, 2))
        if criterion < best_criterion:
            best, best_criterion = start, criterion
        elif order - best.size >= PATIENCE:
            break
    return AutoRegression(best).made_stationary()


def _refitted(records: Sequence[Linearised], like: AutoRegression) -> AutoRegression:
    objective = _RestrictedLikelihood(*_all_products(records, like.coefficients.size))
    return AutoRegression(_minimised(objective, like.coefficients)[0]).made_stationary()


def _minimised(objective: _RestrictedLikelihood, start: Array) -> tuple[Array, float]:
    if start.size == 0:
        return start, objective(start)[0]
    flat = FLAT * np.sqrt(objective.freedom)
    with np.errstate(all="ignore"):  # the line search may try poles at the border
        found = minimize(objective, start, jac=True, method="BFGS", options={"gtol": flat})
    return np.asarray(found.x, dtype=np.float64), float(found.fun)


def _affordable_order(records: Sequence[Linearised], highest: int) -> int:
    """Largest order for which at least 90 % of the rows lie in blocks that are long enough."""
    lengths = np.array([end - begin for record in records for begin, end in record.blocks()])
    rows = int(lengths.sum())
    orders = range(1, min(highest, rows // 10) + 1)
    return max((p for p in orders if lengths[lengths > 2 * p].sum() >= ENOUGH_ROWS * rows), default=0)


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
        local = _basis(record.local)
        white = shape.whiten(np.column_stack([local, record.shared, record.residual]), record)
        products.append(_Products((white.T @ white)[None, None, None], local.shape[1]))
        logdet += float(np.log1p(-(shape.of_neighbours(record) ** 2)).sum())
        rows += len(record.residual)
    return _RestrictedLikelihood(products, rows, 0)(np.zeros(0))[0] + logdet
