"""Errors of a driven path from its reference, as the bench sees them: for many points at once.

    e_y = (y - y_r) cos ψ_r - (x - x_r) sin ψ_r,     at the s where (x - x_r) cos ψ_r + (y - y_r) sin ψ_r = 0

Between its samples the path is a cubic (Hermite) through positions and tangents, with heading and curvature
that run linearly; beyond its ends it runs straight on. Found by Newton's method from where the truck was,
so a path may cross itself.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from ident.control.reference import Reference

Array = NDArray[np.float64]

ROUNDS = 20
CLOSE = 1e-10  # [m]
LEAST_STRETCH = 0.1  # of 1 - κ e_y, which is zero at the centre of the curve


@numba.njit(
    "UniTuple(float64, 4)(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64)",
    cache=True,
    error_model="numpy",
)
def _point(
    grid: Array, xs: Array, ys: Array, headings: Array, curvatures: Array, s: float
) -> tuple[float, float, float, float]:
    """x, y, heading and curvature of the path at one arc length."""
    end = grid.size - 1
    if s < grid[0] or s > grid[end]:
        k = 0 if s < grid[0] else end
        beyond = s - grid[k]
        heading = headings[k]
        return xs[k] + beyond * math.cos(heading), ys[k] + beyond * math.sin(heading), heading, 0.0
    k = min(int(np.searchsorted(grid, s, side="right")), end) - 1
    step = grid[k + 1] - grid[k]
    t = (s - grid[k]) / step
    left = 1.0 - t
    from_begin, from_end = (1.0 + 2.0 * t) * left * left, t * t * (3.0 - 2.0 * t)
    leaving, coming = step * t * left * left, -step * t * t * left
    x = from_begin * xs[k] + from_end * xs[k + 1]
    y = from_begin * ys[k] + from_end * ys[k + 1]
    x += leaving * math.cos(headings[k]) + coming * math.cos(headings[k + 1])
    y += leaving * math.sin(headings[k]) + coming * math.sin(headings[k + 1])
    heading = left * headings[k] + t * headings[k + 1]
    return x, y, heading, left * curvatures[k] + t * curvatures[k + 1]


@numba.njit(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[:, ::1])",
    cache=True,
    error_model="numpy",
)
def _project(
    grid: Array, xs: Array, ys: Array, headings: Array, curvatures: Array, x: Array, y: Array, out: Array
) -> None:
    """Fill ``out`` with s, e_y, heading and curvature of the path; its first column holds where to begin."""
    for i in range(x.size):
        s, left, heading, curvature = out[i, 0], 0.0, 0.0, 0.0
        for _ in range(ROUNDS):
            path_x, path_y, heading, curvature = _point(grid, xs, ys, headings, curvatures, s)
            cosine, sine = math.cos(heading), math.sin(heading)
            ahead = (x[i] - path_x) * cosine + (y[i] - path_y) * sine
            left = (y[i] - path_y) * cosine - (x[i] - path_x) * sine
            if not abs(ahead) > CLOSE:
                break
            s += ahead / max(1.0 - curvature * left, LEAST_STRETCH)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = s, left, heading, curvature


def project(reference: Reference, x: Array, y: Array, near: Array) -> tuple[Array, Array, Array, Array]:
    """Where on the path points are, and how far from it.

    Parameters
    ----------
    x, y : (n,) of the tracked point [m]
    near : (n,) arc lengths to begin from [m]

    Returns
    -------
    arc_length, lateral_error : (n,) [m], the error left positive
    heading, curvature : (n,) of the path there [rad], [1/m]
    """
    out = np.empty((x.size, 4))
    out[:, 0] = near
    table = (
        reference.arc_length,
        reference.position_x,
        reference.position_y,
        reference.heading,
        reference.curvature,
    )
    grid, xs, ys, angles, bends = (np.ascontiguousarray(column, dtype=np.float64) for column in table)
    at_x, at_y = np.ascontiguousarray(x), np.ascontiguousarray(y)
    _project(grid, xs, ys, angles, bends, at_x, at_y, out)
    return out[:, 0], out[:, 1], out[:, 2], out[:, 3]
