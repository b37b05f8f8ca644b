"""What is known of a parameter before any data."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """One parameter of a tyre or of an effect.

    name : as in the JSON
    unit : SI, as text
    low, high : bounds beyond which the value makes no sense for any road vehicle
    typical : a usual size for a heavy truck
    meaning : one line
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    meaning: str
