"""One row of the catalogue of effects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import sympy

BuiltIn = Literal["actuator", "motion", "sensors"]


@dataclass(frozen=True)
class Usual:
    """A parameter of an effect, as in the JSON, and its usual range for a heavy truck.

    unit : SI, as text; low, high : usual sizes, those of a steering effect at the road wheels
    """

    name: str
    unit: str
    low: float
    high: float

    @property
    def typical(self) -> float:
        """Middle of the range, geometric where it is of one sign."""
        if self.low * self.high > 0:
            return float(self.low / abs(self.low) * (self.low * self.high) ** 0.5)
        return max(abs(self.low), abs(self.high)) / 2


@dataclass(frozen=True)
class Entry:
    """What is known of an effect before any data.

    enters : actuator A, linkage G, tyre T, lateral force Y, yaw moment R, longitudinal X, measurement M
    parameters : the first is its size
    meaning : in one sentence; shown_by : the run that shows it
    confusable : effects, or parameters of the base model in words, that look like it
    built : the parts of the loop that can tell it; empty where none can yet
    equation : where it is built
    """

    name: str
    enters: str
    parameters: tuple[Usual, ...]
    meaning: str
    shown_by: str
    confusable: tuple[str, ...] = ()
    built: tuple[BuiltIn, ...] = ()
    equation: sympy.Basic | None = None
