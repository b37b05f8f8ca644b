"""Damped Gauss-Newton on the parameters that all records share; the damping is Levenberg's.

What is minimised is a sum of squares in which all parameters but the shared ones are eliminated: a point
gives its rows [shared | residual], and where it comes to lie after a step, its own parameters adapted.
"""

from __future__ import annotations

from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ident.estimation.elimination import damped_solution

Array = NDArray[np.float64]

MAX_ITERATIONS = 30
MAX_DAMPINGS = 12
MILD = 1e-2  # damping below which a small step means the end and not a short leash
IDLE = 4  # small steps in a row that mean the end however short the leash
NEGLIGIBLE = 1e-5  # gain of 2 log likelihood that is no gain
CRAWL = 0.05  # gain of 2 log likelihood in half of the iterations: along a kink, and near enough its end
CONVERGED = 1e-4  # step in standard deviations


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
    damping, idle, halfway = 0.0, 0, point.value
    triangle = np.zeros((0, point.shared.size))
    for number in range(iterations):
        halfway = point.value if number == iterations // 2 else halfway
        rows = point.triangle()[: point.shared.size]
        triangle, target = rows[:, :-1], rows[:, -1]
        tried, damping = _tried(point, triangle, target, damping)
        if tried is None:
            return point, triangle, damping > 1
        size = float(np.linalg.norm(triangle @ (tried.shared - point.shared)))
        gained, point = point.value - tried.value, tried
        done = size < CONVERGED * point.std or gained < negligible * point.std**2
        idle = idle + 1 if done else 0
        if done and (damping <= MILD or idle >= IDLE):
            return point, triangle, True
        damping = 0.0 if damping < 1e-6 else damping / 8
    return point, triangle, halfway - point.value < max(CRAWL, iterations * negligible) * point.std**2


def _tried(point: P, triangle: Array, target: Array, damping: float) -> tuple[P | None, float]:
    """Return the first point not worse than this one at a rising damping, and the damping that led there."""
    for _ in range(MAX_DAMPINGS):
        tried = point.moved(_bounded_step(point, triangle, target, damping))
        if tried.value <= point.value * (1 + 1e-12):
            return tried, damping
        damping = max(damping * 8, 1e-4)
    return None, damping


def _bounded_step(point: Point, triangle: Array, target: Array, damping: float) -> Array:
    """Damped step; parameters that it would take out of the region stop at its border, the rest adapt."""
    step = damped_solution(triangle, target, damping)
    stopped = point.inside(point.shared + step) - point.shared
    held = stopped != step
    if held.any() and not held.all():
        rest = target - triangle[:, held] @ stopped[held]
        step[held] = stopped[held]
        step[~held] = damped_solution(triangle[:, ~held], rest, damping)
    return point.inside(point.shared + step) - point.shared
