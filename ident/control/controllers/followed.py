"""The reference as a controller reads it: projected on, and looked up by arc length, cycle after cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ident.control.reference import Reference
from ident.control.tracking import project

Array = NDArray[np.float64]

BEHIND, BEYOND = 10.0, 40.0  # [m] about the last arc length in which the nearest point is looked for
COLUMNS = (
    "heading",
    "curvature",
    "speed",
    "time",
    "acceleration",
    "road_wheel_angle",
    "yaw_rate",
    "lateral_velocity",
    "heading_error",
    "position_x",
    "position_y",
)


@dataclass(frozen=True)
class Projected:
    """A pose on the road: arc length [m], lateral error, left positive [m], and heading error [rad]."""

    arc_length: float
    lateral_error: float
    heading_error: float


class Followed:
    """A reference with the place on it where the truck was last."""

    def __init__(self, reference: Reference) -> None:
        self.reference = reference
        self._table = {name: np.asarray(getattr(reference, name), dtype=np.float64) for name in COLUMNS}
        self._s = np.asarray(reference.arc_length, dtype=np.float64)
        self._last: float | None = None

    @property
    def length(self) -> float:
        """Arc length of the end [m]."""
        return float(self._s[-1])

    def at(self, arc_length: ArrayLike, name: str) -> Array:
        """A column of the reference by arc length, its ends held."""
        found: Array = np.interp(np.asarray(arc_length, dtype=np.float64), self._s, self._table[name])
        return found

    def time(self, arc_length: float) -> float:
        """Stipulated time at an arc length; before and beyond the path the speed of its ends holds [s]."""
        inside = min(max(arc_length, float(self._s[0])), self.length)
        row = self.row(inside)
        return row["time"] + (arc_length - inside) / row["speed"]

    def row(self, arc_length: float) -> dict[str, float]:
        """All columns at one arc length."""
        s = self._s
        k = min(max(int(np.searchsorted(s, arc_length, side="right")) - 1, 0), s.size - 2)
        share = min(max((arc_length - s[k]) / (s[k + 1] - s[k]), 0.0), 1.0)
        return {name: float(t[k] + share * (t[k + 1] - t[k])) for name, t in self._table.items()}

    def project(self, x: float, y: float, heading: float, *, near: float | None = None) -> Projected:
        """The nearest point of the path, near to where the truck was last.

        Beyond its ends the path runs straight on. Without ``near`` the place found is kept for the next time.

        x, y [m], heading [rad] : of the tracked point; near : arc length to begin from [m]
        """
        begin = self._nearest_sample(x, y, self._last if near is None else near)
        found = project(self.reference, np.array([x]), np.array([y]), np.array([begin]))
        s, across, along, _ = (float(part[0]) for part in found)
        if near is None:
            self._last = s
        return Projected(s, across, heading - along)

    def _nearest_sample(self, x: float, y: float, near: float | None) -> float:
        low, high = 0, self._s.size
        if near is not None:
            low, high = np.searchsorted(self._s, (near - BEHIND, near + BEYOND))
            low, high = min(max(low - 1, 0), self._s.size - 2), min(high + 1, self._s.size)
        xs, ys = self._table["position_x"][low:high], self._table["position_y"][low:high]
        away = (xs - x) ** 2 + (ys - y) ** 2
        return float(self._s[low + int(np.argmin(away))])
