"""Pure pursuit: turn on the circle that leads to a point on the path ahead.

    κ = 2 sin α/l_a,      l_a = max(l_min, t_a v)

with α the direction of the point on the path that lies l_a of arc length ahead, seen from the course of the
tracked point (Coulter, CMU-RI-TR-92-01, 1992). The course, and not the heading, is the tangent of the circle:
at speed a truck drifts. The heading less the steady heading error of the reference stands for it. What is
steered is the reference's angle and that for the curvature beside it, so that the law is exact on every
circle.
"""

from __future__ import annotations

import math

import numpy as np

from ident.control.controllers.controller import Command, Diagnostics, Measured
from ident.control.controllers.steady import Deviation, SteeredBeside
from ident.control.controllers.weights import PURE_PURSUIT_GAINS
from ident.control.reference import Reference


class PurePursuit(SteeredBeside):
    """Steers by pure pursuit; the speed is held beside it.

    weights : look_ahead_time t_a [s], shortest_look_ahead l_min [m]
    """

    name = "pure_pursuit"
    gains = PURE_PURSUIT_GAINS

    def step(self, measured: Measured, reference: Reference) -> tuple[Command, Diagnostics]:
        """Return the command for the period that begins now."""
        deviation = self.cornering.begin(measured, reference)
        gains = self.weights
        reach = max(gains["shortest_look_ahead"], gains["look_ahead_time"] * deviation.speed)
        followed = self.base.road(reference)
        here = float(deviation.situation.state[0])
        curvature = self._curvature(deviation, reach)
        of_the_path = float(followed.at(here, "curvature"))
        angle = self.cornering.angle_for(curvature - of_the_path, deviation)
        return self.cornering.command(deviation, angle)

    def _curvature(self, deviation: Deviation, reach: float) -> float:
        """Of the circle to the point ahead [1/m]."""
        here = float(deviation.situation.state[0])
        x, y, _ = deviation.situation.pose
        ahead = deviation.targets.positions(np.array([here + reach]), np.zeros(1))[0]
        beyond = max(here + reach - self.base.road(deviation.reference).length, 0.0)
        heading = float(self.base.road(deviation.reference).at(here, "heading"))
        end = float(deviation.reference.heading[-1])
        course = heading + deviation.heading_error
        dx, dy = ahead[0] + beyond * math.cos(end) - x, ahead[1] + beyond * math.sin(end) - y
        distance = math.hypot(dx, dy)
        return 2.0 * math.sin(math.atan2(dy, dx) - course) / distance
