"""Damped Gauss-Newton on the parameters that all records share; the damping is Levenberg's.

What is minimised is a sum of squares in which all parameters but the shared ones are eliminated: a point
gives its rows [shared | residual], and where it comes to lie after a step, its own parameters adapted.

The rows promise a gain to every step. The damping follows the part of the promise that is kept (Marquardt
1963; Nielsen 1999, report IMM-REP-1999-05), and where even the undamped step promises nothing, the minimum is
reached.
"""

from __future__ import annotations

from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from ident.estimation.elimination import damped_solution

Array = NDArray[np.float64]

MAX_ITERATIONS = 30
MAX_DAMPINGS = 12
MILD = 1e-2  # damping below which a small step means the end and not a short leash
IDLE = 4  # small steps in a row that mean the end however short the leash
NEGLIGIBLE = 1e-5  # gain of 2 log likelihood that is no gain
CRAWL = 0.05  # gain of 2 log likelihood in half of the iterations: along a kink, and near enough its end
CONVERGED = 1e-4  # step in standard deviations
KEPT, BROKEN = 0.75, 0.25  # parts of the promised gain, above and below which the damping changes
LEAST_DAMPING = 1e-5


class Point(Protocol):
    """Where the iterations are."""

    @property
    def shared(self) -> Array:
        """(s,) parameters."""
        ...

    @property
    def value(self) -> float:
        """Sum of squares."""
        ...

    @property
    def smooth(self) -> bool:
        """Whether the rows are finite, so that a step leads on from there."""
        ...

    @property
    def std(self) -> float:
        """Size of the noise in it."""
        ...

    def triangle(self) -> Array:
        """(k, s + 1) upper triangle of [shared | residual], all other parameters eliminated."""
        ...

    def moved(self, step: Array) -> Self:
        """Where a step of the shared parameters leads, the others adapted."""
        ...

    def inside(self, shared: Array) -> Array:
        """The nearest parameters that the model allows."""
        ...


P = TypeVar("P", bound=Point)


def minimise(
    point: P, iterations: int = MAX_ITERATIONS, *, negligible: float = NEGLIGIBLE
) -> tuple[P, Array, bool]:
    """Minimise from a point on.

    Parameters
    ----------
    negligible : gain of 2 log likelihood that is no gain

    Returns
    -------
    the last point, (s, s) triangle of its rows before the last step, whether it has converged
    """
    damping, idle, halfway, size = 0.0, 0, point.value, point.shared.size
    triangle = np.zeros((0, size))
    for number in range(iterations):
        halfway = point.value if number == iterations // 2 else halfway
        rows = point.triangle()
        triangle = rows[:size, :-1]
        if _promised(point, rows, _bounded_step(point, rows, 0.0)) < negligible * point.std**2:
            return point, triangle, True
        tried, promised, damping = _tried(point, rows, damping)
        if tried is None:
            return point, triangle, damping > 1
        step = float(np.linalg.norm(triangle @ (tried.shared - point.shared)))
        gained, point = point.value - tried.value, tried
        done = step < CONVERGED * point.std or gained < negligible * point.std**2
        idle = idle + 1 if done else 0
        if done and (damping <= MILD or idle >= IDLE):
            return point, triangle, True
        damping = _followed(damping, gained, promised)
    return point, triangle, halfway - point.value < max(CRAWL, iterations * negligible) * point.std**2


def _promised(point: Point, rows: Array, step: Array) -> float:
    """Gain that a step would have if the model were linear, all other parameters at their best."""
    size = point.shared.size
    left = rows[:size, -1] - rows[:size, :-1] @ step
    rest = float(rows[size, -1]) ** 2 if len(rows) > size else 0.0
    return point.value - rest - float(left @ left)


def _tried(point: P, rows: Array, damping: float) -> tuple[P | None, float, float]:
    """Return the first point not worse than this one at a rising damping, its promise, and that damping."""
    for _ in range(MAX_DAMPINGS):
        step = _bounded_step(point, rows, damping)
        tried = point.moved(step)
        if tried.value <= point.value * (1 + 1e-12) and tried.smooth:
            return tried, _promised(point, rows, step), damping
        damping = max(damping * 8, 1e-4)
    return None, 0.0, damping


def _followed(damping: float, gained: float, promised: float) -> float:
    """Damping of the next step: less where the promise was kept, more where it was broken."""
    if gained > KEPT * promised:
        return damping / 8 if damping > LEAST_DAMPING else 0.0
    return max(4 * damping, LEAST_DAMPING) if gained < BROKEN * promised else damping


def _bounded_step(point: Point, rows: Array, damping: float) -> Array:
    """Damped step to the best point in the region (bounded-variable least squares, Stark and Parker 1995)."""
    size = point.shared.size
    triangle, target = rows[:size, :-1], rows[:size, -1]
    step = damped_solution(triangle, target, damping)
    if np.array_equal(point.inside(point.shared + step), point.shared + step):
        return step
    scale = np.linalg.norm(triangle, axis=0)
    scale[scale == 0] = 1.0
    low, high = ((point.inside(np.full(size, end)) - point.shared) * scale for end in (-np.inf, np.inf))
    padded = np.vstack([triangle / scale, np.sqrt(damping) * np.eye(size)])
    free = low < high
    ends = (low[free], high[free])
    step = np.zeros(size)
    step[free] = lsq_linear(padded[:, free], np.append(target, np.zeros(size)), ends, method="bvls").x
    return point.inside(point.shared + step / scale) - point.shared
