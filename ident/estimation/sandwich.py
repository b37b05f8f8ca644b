"""Least squares with standard errors that hold whatever the colour of what is left.

The sandwich over blocks (cluster-robust covariance; Cameron and Miller 2015, doi:10.3368/jhr.50.2.317): what
is left may be correlated within a block in any way, but not between blocks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def coefficient(
    values: Array, columns: Array, block: NDArray[np.intp], wanted: int
) -> tuple[float, Array, int]:
    """One coefficient of a least-squares fit.

    Parameters
    ----------
    values, columns : (n,), (n, c); block : (n,) which block each row belongs to
    wanted : which column

    Returns
    -------
    coefficient
    influence : (highest block + 1,) what each block adds to its error; the norm is the standard error
    degrees of freedom : blocks less columns, at least 1
    """
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    inverse = np.linalg.pinv(columns / scale)
    solution = inverse @ values
    rest = values - columns / scale @ solution
    count = np.unique(block).size
    freedom = max(1, count - columns.shape[1])
    influence = np.bincount(block, inverse[wanted] * rest) * np.sqrt(count / freedom) / scale[wanted]
    return float(solution[wanted] / scale[wanted]), np.asarray(influence), freedom
