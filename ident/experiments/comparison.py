"""Comparing two signals of a run that must agree, and what a wrong factor between them means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST = 25
CERTAIN = 0.8
KMH = 3.6
FACTORS = (
    (57.29578, "degrees taken as radians"),
    (9.80665, "g taken as m/s², or the reverse"),
    (KMH, "km/h taken as m/s"),
)
FACTOR_TOLERANCE = 1.25
FIX = "check unit and sign (left positive; invert: true turns it)"
POSITION = ("position_x", "position_y")

Verdict = Literal["fine", "warning", "refused"]


@dataclass(frozen=True)
class Finding:
    """What the comparison of two signals gives.

    check : what was compared
    verdict : "refused" where one of them is certainly wrong
    signals : what should not be used, or is doubted; empty where all is well
    ratio : measured over expected; correlation : of the two; for an angle ``ratio`` is the difference [rad]
    text : one line, with the measured and the needed value and what to do
    """

    check: str
    verdict: Verdict
    signals: tuple[str, ...]
    ratio: float
    correlation: float
    text: str


@dataclass(frozen=True)
class Pair:
    """Ratio and correlation of two series."""

    ratio: float
    correlation: float

    @property
    def certain(self) -> bool:
        """Whether the correlation is high enough to believe the ratio."""
        return abs(self.correlation) > CERTAIN

    def off(self, low: float, high: float) -> bool:
        """Whether the ratio is certainly no number between these, as far as the correlation tells."""
        return self.certain and not low <= self.ratio <= high


@dataclass(frozen=True)
class Scene:
    """The signals of a run on one grid, where the vehicle moves; NaN elsewhere."""

    series: Mapping[str, Array]
    wheelbase: float | None
    arm: float | None  # from the IMU forward to the point of the lateral velocity [m]

    def get(self, *names: str) -> list[Array] | None:
        """Series of these names, None where one is missing."""
        found = [self.series[name] for name in names if name in self.series]
        return found if len(found) == len(names) else None


def refused(findings: list[Finding]) -> dict[str, str]:
    """Signal -> why it is not to be used."""
    return {name: each.text for each in findings if each.verdict == "refused" for name in each.signals}


def compare(measured: Array, expected: Array, least: float) -> Pair | None:
    """Ratio of two series, None where both vary by less than ``least`` (a standard deviation)."""
    both = np.isfinite(measured) & np.isfinite(expected)
    if np.count_nonzero(both) < FEWEST:
        return None
    x, y = expected[both], measured[both]
    wide, high = float(np.std(x)), float(np.std(y))
    if max(wide, high) < least or min(wide, high) == 0:
        return None
    correlation = float(np.corrcoef(x, y)[0, 1])
    return Pair(float(np.copysign(high / wide, correlation)), correlation)


def meaning(ratio: float, name: str = "") -> str:
    """What a factor looks like, in words."""
    size = max(abs(ratio), 1 / abs(ratio)) if ratio else np.inf
    if size < 2 and ratio < 0:
        return ", the sign is turned"
    known = [what for factor, what in FACTORS if factor / FACTOR_TOLERANCE < size < factor * FACTOR_TOLERANCE]
    if name == "road_wheel_angle" and 8 < ratio < 35:
        known = ["a steering-wheel angle taken as that of the road wheel, or a wrong steering ratio"]
    turned = ", and the sign is turned" if ratio < 0 else ""
    return f", as of {known[0]}{turned}" if known else turned
