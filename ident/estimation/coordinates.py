"""What a fit of a vehicle changes: parameters that all runs share, and terms that each run has for itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Coordinate:
    """One parameter as it is fitted.

    name : of the model's parameter
    logarithmic : whether its logarithm is fitted; the rest of the fields then are of the logarithm
    low, high : where it may lie
    prior_mean, prior_std : Gaussian prior; infinite std where there is none
    """

    name: str
    logarithmic: bool = True
    low: float = -np.inf
    high: float = np.inf
    prior_mean: float = 0.0
    prior_std: float = np.inf

    def value(self, coordinate: float) -> float:
        """Give the parameter at a coordinate."""
        return float(np.exp(coordinate)) if self.logarithmic else float(coordinate)

    def coordinate(self, value: float) -> float:
        """Give the coordinate of a value of the parameter."""
        return float(np.log(value)) if self.logarithmic else float(value)

    def slope(self, coordinate: float) -> float:
        """Derivative of the parameter to its coordinate."""
        return float(np.exp(coordinate)) if self.logarithmic else 1.0


@dataclass(frozen=True)
class RunTerm:
    """A parameter that each run has for itself, with the std of its prior around zero.

    name : of the measured signal to which it is added (a bias), or of a parameter of the model
    only : runs that have it, None: all; in the others it is zero
    by_speed_to : measured signal to which it is added times the speed, None: as ``name`` says
    """

    name: str
    prior_std: float
    only: frozenset[int] | None = None
    by_speed_to: str | None = None
