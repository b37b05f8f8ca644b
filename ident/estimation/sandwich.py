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
) -> tuple[float, float, int]:
    """One coefficient of a least-squares fit.

    Parameters
    ----------
    values, columns : (n,), (n, c); block : (n,) which block each row belongs to
    wanted : which column

    Returns
    -------
    coefficient, its standard error, and the degrees of freedom: blocks less columns, at least 1
    """
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    inverse = np.linalg.pinv(columns / scale)
    solution = inverse @ values
    rest = values - columns / scale @ solution
    _, own = np.unique(block, return_inverse=True)
    count = int(own.max()) + 1
    influence = np.bincount(own, inverse[wanted] * rest, count)
    freedom = max(1, count - columns.shape[1])
    std = float(np.sqrt(influence @ influence * count / freedom))
    return float(solution[wanted] / scale[wanted]), std / float(scale[wanted]), freedom
