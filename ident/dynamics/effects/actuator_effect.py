"""An effect of the steering actuator: between the request and the measured angle.

The actuator is one nonlinear model that is solved exactly (``ident.dynamics.actuator_nonlinear``). An effect
enters it at one of three places: it changes the request before the gain (a static map, with its derivative),
it limits the rate inside the second lag, or it gives the column play. All sizes are in the unit of the
steering signal that is measured; the bounds and usual values of the parameters are those at the road wheels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from sympy import Expr

from ident.dynamics.parameter import Parameter

Array = NDArray[np.float64]
RequestMap = Callable[[Array, float], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Excitation:
    """How hard the actuator was driven, in the unit of the steering signal.

    noise : standard deviation of the measured angle's noise
    amplitude : half of the range of the modelled angle; request : largest size of the request
    rate : largest rate of the modelled angle [.../s]; samples : how many
    """

    noise: float
    amplitude: float
    request: float
    rate: float
    samples: int


@dataclass(frozen=True, eq=False)
class ActuatorEffect:
    """A term that the linear actuator lacks.

    name : its identifier in code, JSON and reports
    size : its only parameter, positive
    place : of the model that it changes: "request", "rate" or "width"
    request : where that is "request": (request, size) -> changed request, derivatives to size and request
    sizes : that a screen tries, from how hard the actuator was driven, the likeliest first
    impossible : (size, excitation) -> why no actuator has that size here, None where one may have
    equation : of the changed term; meaning : of it and its size, in one sentence
    shown_by : the run that shows it
    """

    name: str
    size: Parameter
    place: Literal["request", "rate", "width"]
    sizes: Callable[[Excitation], list[float]]
    impossible: Callable[[float, Excitation], str | None]
    equation: Expr
    meaning: str
    shown_by: str
    request: RequestMap | None = None


def geometric(low: float, high: float, count: int) -> list[float]:
    """Sizes from low to high with a constant ratio; the lower end alone where there is no range."""
    return np.geomspace(low, high, count).tolist() if high > low > 0 else [max(low, 1e-12)]
