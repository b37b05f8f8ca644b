"""``tyre_relaxation``: a tyre has to roll a length before its force is there.

    (σ/|v|) Ḟ + F = F_static(α)

for the force F of each axle, with one length σ for both. Where the truck crawls |v| is kept from zero as in
the slip angle (``bicycle.CRAWL``), so that a force does not stay for ever at standstill.

The base model is the limit σ -> 0, which no step of a grid can carry: the force decays by |v|/σ a second, and
Runge-Kutta's method needs ``shortest_length``.
"""

from __future__ import annotations

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray
from sympy import Expr

from ident.dynamics.effects.effect import Change, Effect, Known
from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import guarded, symbol
from ident.glossary import AXLES

CRAWL = 1.0  # [m/s] as in the slip angle
LARGEST_DECAY = 1.0  # |v| h/σ above which a Runge-Kutta step of h is more than 2 % wrong in what decays
LENGTH = Parameter(
    "tyre_relaxation.length", "m", 0.02, 5.0, 0.5, "way that a tyre rolls until 63 % of its force"
)


def shortest_length(speed: ArrayLike, step: float) -> float:
    """Least relaxation length [m] that a step of the grid carries at these speeds.

    speed : any shape [m/s]; step : [s]
    """
    fastest = float(np.max(np.abs(np.asarray(speed, dtype=np.float64)), initial=CRAWL))
    return fastest * step / LARGEST_DECAY


def rolling_rate(speed: ArrayLike, length: float) -> NDArray[np.float64]:
    """Share of what is missing of a force that rolls in per second, |v|/σ [1/s].

    speed : any shape [m/s]; length : [m]
    """
    slow = np.abs(np.asarray(speed, dtype=np.float64))
    return np.asarray(np.where(slow > CRAWL, slow, (slow**2 + CRAWL**2) / (2 * CRAWL)) / length)


def _state(axle: str) -> str:
    return f"{axle}_relaxed_force"


def _replaced(axle: str) -> Change:
    return lambda _, known: known[_state(axle)]


def _rate(known: Known, axle: str) -> Expr:
    along = guarded(known["longitudinal_velocity"], CRAWL)
    return along / symbol(LENGTH.name) * (known[f"{axle}_lateral_force"] - known[_state(axle)])


def _equation() -> sympy.Basic:
    length, speed, force, rate, static = sympy.symbols("sigma v F Ḟ F_static")
    return sympy.Eq(length / speed * rate + force, static, evaluate=False)


TYRE_RELAXATION = Effect(
    "tyre_relaxation",
    "T",
    (LENGTH,),
    {f"{axle}_tyre_force": _replaced(axle) for axle in AXLES},
    needs=("yaw_rate",),
    states={
        _state("front"): lambda known: _rate(known, "front"),
        _state("rear"): lambda known: _rate(known, "rear"),
    },
    begins={_state(axle): f"{axle}_static_force" for axle in AXLES},
    outputs={
        "front_static_force": lambda known: known["front_lateral_force"],
        "rear_static_force": lambda known: known["rear_lateral_force"],
    },
    equation=_equation(),
    meaning="The force of a tyre follows its slip angle only after the tyre has rolled the length sigma.",
)
