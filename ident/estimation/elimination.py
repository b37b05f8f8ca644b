"""Linear least squares in blocks: parameters that belong to a part of the rows are eliminated with it.

Rows are [own | rest | residual]. A QR factorisation, not normal equations, which would square the condition
number, splits them into rows that fix the own parameters whatever the rest is, and rows free of the own
parameters, which carry all that this part of the data knows of the rest. Eliminated parts are stacked and
eliminated again: windows within a run, runs within a data set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-10
UNKNOWN = 1e-6  # of the largest singular value: below, a direction is not known at all
BLOCK_ROWS = 256


@dataclass(frozen=True)
class Eliminated:
    """Rows after their own parameters are eliminated.

    rows : (k, rest + 1) [rest | residual], free of the own parameters
    basis : (n, rank) orthonormal directions of the own parameters in the rows that were given
    triangle, on_rest : (rank, rank) and (rank, rest + 1): what fixes the own parameters, in pivoted order
    order, scale : (own,) of the own columns; rank : how many of them the rows can tell
    """

    rows: Array
    basis: Array
    triangle: Array
    on_rest: Array
    order: NDArray[np.intp]
    scale: Array

    @property
    def rank(self) -> int:
        """How many own parameters the rows can tell."""
        return len(self.triangle)

    def step(self, rest: Array) -> Array:
        """(own,) change of the own parameters that goes with a change of the rest (rest,)."""
        target = self.on_rest[:, -1] - self.on_rest[:, :-1] @ rest
        step = np.zeros(self.order.size)
        if self.rank:
            step[self.order[: self.rank]] = solve_triangular(self.triangle, target)
        return np.asarray(step / self.scale)

    def own_covariance(self, of_rest: Array) -> Array:
        """(own, own) covariance of the own parameters, given that (rest, rest) of the others."""
        back = np.linalg.inv(self.triangle) if self.rank else np.zeros((0, 0))
        told = self.order[: self.rank]
        moved = np.zeros((self.order.size, of_rest.shape[0]))
        moved[told] = -back @ self.on_rest[:, :-1]
        total = moved @ of_rest @ moved.T
        total[np.ix_(told, told)] += back @ back.T
        unknown = np.setdiff1d(np.arange(self.order.size), told)
        total[unknown, unknown] = np.inf
        return np.asarray(total / np.outer(self.scale, self.scale))


def eliminate(rows: Array, own: int) -> Eliminated:
    """Eliminate the first ``own`` columns of rows (n, own + rest + 1)."""
    scale = np.linalg.norm(rows[:, :own], axis=0)
    scale[scale == 0] = 1.0
    q, upper, order = qr(rows[:, :own] / scale, mode="economic", pivoting=True)
    size = np.abs(np.diag(upper))
    rank = int((size > RANK_TOLERANCE * size.max(initial=0.0)).sum())
    basis = q[:, :rank]
    on_rest = basis.T @ rows[:, own:]
    return Eliminated(
        rows[:, own:] - basis @ on_rest, basis, upper[:rank, :rank], on_rest, order.astype(np.intp), scale
    )


def triangle_of(rows: Array) -> Array:
    """Upper triangle of the QR factorisation of the rows, by blocks that stay in the cache."""
    blocks = len(rows) // BLOCK_ROWS
    if blocks > 1:
        whole = blocks * BLOCK_ROWS
        heads = np.asarray(np.linalg.qr(rows[:whole].reshape(blocks, BLOCK_ROWS, -1), mode="r"))
        rows = np.vstack([heads.reshape(-1, rows.shape[1]), rows[whole:]])
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def with_priors(rows: Array, std: Array, residual: Array, *, first: int = 0) -> Array:
    """Put below the rows one for each parameter that has a Gaussian prior.

    Parameters
    ----------
    rows : (n, m) whose last column is the residual
    std : (p,) of the priors, infinite where there is none, in units of the rows' noise
    residual : (p,) prior mean minus present value
    first : column of the first of these parameters
    """
    known = np.flatnonzero(np.isfinite(std))
    prior = np.zeros((known.size, rows.shape[1]))
    weight = 1 / std[known]
    prior[np.arange(known.size), first + known] = weight
    prior[:, -1] = weight * residual[known]
    return np.vstack([rows, prior])


def damped_solution(rows: Array, target: Array, damping: float) -> Array:
    """Least squares of ``rows @ x = target`` with Levenberg's damping relative to the columns' norms."""
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = 1.0
    if damping == 0.0:
        solution, *_ = np.linalg.lstsq(rows / scale, target, rcond=RANK_TOLERANCE)
    else:
        padded = np.vstack([rows / scale, np.sqrt(damping) * np.eye(scale.size)])
        solution, *_ = np.linalg.lstsq(padded, np.append(target, np.zeros(scale.size)), rcond=None)
    return np.asarray(solution / scale)


def inverse_of(triangle: Array) -> Array:
    """Inverse of the triangle; a direction that it does not hold gets a huge value, and not none."""
    scale = np.linalg.norm(triangle, axis=0)
    scale[scale == 0] = 1.0
    square = np.zeros((scale.size, scale.size))
    square[: len(triangle)] = triangle / scale
    left, size, right = np.linalg.svd(square)
    size = np.maximum(size, UNKNOWN * size.max(initial=1e-300))
    return np.asarray((right.T / size) @ left.T / scale[:, None])


def stacked(parts: Sequence[Eliminated]) -> Array:
    """Triangle of the rows that several parts leave over."""
    return triangle_of(np.vstack([part.rows for part in parts]))
