"""Steps of tyre parameters that are taken in the forces.

Peak, shape and curvature of an axle's force make up for one another along a bent valley, which a straight
step leaves at once: its promise holds for the forces, not for the parameters. So a step is read as the change
that it means for the force at each slip angle that is reached, and those parameters are sought whose curve
changes like that. For small steps this is the same step; a long one keeps its promise for longer, since only
the bend of the parameters is taken out, not that of the model (parameter-effects curvature, Bates and Watts
1980).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ident.dynamics.tyres import Tyre, evaluate
from ident.estimation.coordinates import Coordinate

Array = NDArray[np.float64]

SLIPS = np.linspace(0.05, 1.0, 40)  # of the largest that is reached
PULL = 1e-4  # towards the straight step, in coordinates, against the force over its largest
EVALUATIONS = 30
INSIDE = 1e-9  # of the border, where the search may begin


@dataclass(frozen=True)
class FittedAxle:
    """An axle whose tyre has parameters that are fitted.

    load : static [N]; held : parameters that are not fitted -> value
    places : parameter -> place of its coordinate among those of the fit
    """

    tyre: Tyre
    load: float
    held: Mapping[str, float]
    places: Mapping[str, int]

    def moved(self, coordinates: Sequence[Coordinate], at: Array, step: Array, largest_slip: float) -> Array:
        """(s,) the step, its part of this axle taken in the forces.

        Parameters
        ----------
        coordinates : of the fit; at, step : (s,) where they are and the straight step
        largest_slip : that is reached [rad]
        """
        places = list(self.places.values())
        own = [coordinates[place] for place in places]
        begin, straight = at[places], at[places] + step[places]
        slips = SLIPS * largest_slip
        force, slope = self._curve(own, begin, slips)
        change = slope @ step[places]
        size = float(np.abs(change).max())
        if not (size > 0.0 and np.isfinite(slope).all()):
            return step
        wanted, pull = force + change, PULL * float(np.abs(force).max()) / size

        def left(x: Array) -> Array:
            return np.append((self._curve(own, x, slips)[0] - wanted) / size, pull * (x - straight))

        def by_coordinate(x: Array) -> Array:
            return np.vstack([self._curve(own, x, slips)[1] / size, pull * np.eye(x.size)])

        ends = np.array([[one.low, one.high] for one in own]).T
        made = step.copy()
        starts = [np.clip(one, ends[0] + INSIDE, ends[1] - INSIDE) for one in (straight, begin)]
        start = min(starts, key=lambda x: float(np.square(left(x)).sum()))
        found = least_squares(left, start, by_coordinate, bounds=tuple(ends), max_nfev=EVALUATIONS)
        made[places] = found.x - begin
        return made

    def _curve(self, own: Sequence[Coordinate], at: Array, slips: Array) -> tuple[Array, Array]:
        """(n,) force and (n, k) its derivatives to the coordinates."""
        values = {name: one.value(x) for name, one, x in zip(self.places, own, at, strict=True)}
        force, _, derivative = evaluate(self.tyre, slips, {**self.held, **values}, self.load)
        order = [self.tyre.names.index(name) for name in self.places]
        return force, derivative[:, order] * [one.slope(x) for one, x in zip(own, at, strict=True)]
