"""Errors of a driven path from its reference, as the bench sees them: for many points at once.

    e_y = -(x - x_r) sin ψ_r + (y - y_r) cos ψ_r,     at the s where (x - x_r) cos ψ_r + (y - y_r) sin ψ_r = 0

Between its samples the path is a cubic (Hermite) through positions and tangents; beyond its ends it runs
straight on. Found by Newton's method from where the truck was last, so a path may cross itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ident.control.reference import Reference

Array = NDArray[np.float64]

ROUNDS = 20
CLOSE = 1e-10  # [m]
LEAST_STRETCH = 0.1  # of 1 - κ e_y, which is zero at the centre of the curve


def project(reference: Reference, x: Array, y: Array, near: Array) -> tuple[Array, Array]:
    """Arc length and lateral error of points.

    Parameters
    ----------
    x, y : (n,) of the tracked point [m]
    near : (n,) arc lengths to begin from [m]

    Returns
    -------
    arc_length, lateral_error : (n,) [m], the error left positive
    """
    s = np.array(near, dtype=np.float64)
    for _ in range(ROUNDS):
        path_x, path_y, angle, curvature = path_at(reference, s)
        ahead = (x - path_x) * np.cos(angle) + (y - path_y) * np.sin(angle)
        left = (y - path_y) * np.cos(angle) - (x - path_x) * np.sin(angle)
        move = ahead / np.maximum(1.0 - curvature * left, LEAST_STRETCH)
        s += move
        if np.all(np.abs(move) < CLOSE):
            break
    path_x, path_y, angle, _ = path_at(reference, s)
    return s, (y - path_y) * np.cos(angle) - (x - path_x) * np.sin(angle)


def path_at(reference: Reference, s: Array) -> tuple[Array, Array, Array, Array]:
    """Position [m], heading [rad] and curvature [1/m] of the path at arc lengths (n,) [m]."""
    grid = reference.arc_length
    place = np.clip(np.searchsorted(grid, s, side="right") - 1, 0, grid.size - 2)
    step = grid[place + 1] - grid[place]
    t = np.clip((s - grid[place]) / step, 0.0, 1.0)
    angle = np.interp(s, grid, reference.heading)
    beyond = s - np.clip(s, grid[0], grid[-1])
    curvature = np.where(beyond == 0, np.interp(s, grid, reference.curvature), 0.0)
    begin, end = reference.heading[place], reference.heading[place + 1]
    x = _cubic(reference.position_x, place, step, t, (np.cos(begin), np.cos(end)))
    y = _cubic(reference.position_y, place, step, t, (np.sin(begin), np.sin(end)))
    return x + beyond * np.cos(angle), y + beyond * np.sin(angle), angle, curvature


def _cubic(
    values: Array, place: NDArray[np.intp], step: Array, t: Array, slopes: tuple[Array, Array]
) -> Array:
    """Hermite's cubic from a sample to the next, with these slopes at its ends."""
    begin, end = values[place], values[place + 1]
    leaving, coming = step * slopes[0], step * slopes[1]
    left = 1 - t
    return np.asarray(
        (1 + 2 * t) * left**2 * begin
        + t**2 * (3 - 2 * t) * end
        + t * left**2 * leaving
        - t**2 * left * coming
    )
