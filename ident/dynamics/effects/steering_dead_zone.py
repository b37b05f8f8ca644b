"""``steering_dead_zone``: a request smaller than d is not answered, and d is missing from every larger one.

u -> sgn(u) max(|u| - d, 0)
"""

from __future__ import annotations

import numpy as np
import sympy
from numpy.typing import NDArray

from ident.dynamics.effects.actuator_effect import ActuatorEffect, Excitation, geometric
from ident.dynamics.parameter import Parameter

Array = NDArray[np.float64]

COUNT = 6
SMALLEST = 0.5  # of the noise
LARGEST = 0.5  # of the largest request
WIDTH = Parameter("width", "rad", 1e-9, 0.1, 3e-3, "largest request that is not answered")


def dead_zone(request: Array, width: float) -> tuple[Array, Array, Array]:
    """(m,) request that is acted on, (m,) and (m,) its derivatives to the width and to the request."""
    beyond = np.abs(request) > width
    side = np.where(beyond, np.sign(request), 0.0)
    return np.where(beyond, request - side * width, 0.0), -side, np.abs(side)


def _sizes(seen: Excitation) -> list[float]:
    return geometric(min(SMALLEST * seen.noise, 0.1 * seen.request), LARGEST * seen.request, COUNT)


def _impossible(width: float, seen: Excitation) -> str | None:
    if width > seen.request:
        return f"a dead zone of {width:.3g} would hide every request (largest {seen.request:.3g})"
    return None


def _equation() -> sympy.Expr:
    u, d = sympy.symbols("u d")
    return sympy.sign(u) * sympy.Max(sympy.Abs(u) - d, 0)


STEERING_DEAD_ZONE = ActuatorEffect(
    "steering_dead_zone",
    WIDTH,
    "request",
    _sizes,
    _impossible,
    _equation(),
    "A request smaller than d is not answered, and d is missing from every larger one, on both sides.",
    "a staircase of requests from very small to large, on both sides",
    request=dead_zone,
)
