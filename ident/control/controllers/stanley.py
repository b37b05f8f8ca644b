"""Stanley: steer the wheels back to the path by the heading error and by the angle that the error asks for.

    δ = δ_ref - k_ψ e_ψ - atan(k e_y/(v_s + v)) - k_r (r - r_ref)

(Hoffmann, Tomlin, Montemerlo and Thrun, American Control Conference 2007, with its steady-state heading and
its damping by the yaw rate). δ_ref and the heading and yaw rate that the errors are counted from are those of
steady cornering. The source steers by the heading error with gain one; k_ψ is there because a truck's
steering lags far more than that of the car it was made for.
"""

from __future__ import annotations

import math

from ident.control.controllers.controller import Command, Diagnostics, Measured
from ident.control.controllers.steady import SteeredBeside
from ident.control.controllers.weights import STANLEY_GAINS
from ident.control.reference import Reference


class Stanley(SteeredBeside):
    """Steers by Stanley's law; the speed is held beside it.

    weights : error_gain k [1/s], softening_speed v_s [m/s], heading_gain k_ψ, yaw_rate_gain k_r [s]
    """

    name = "stanley"
    gains = STANLEY_GAINS

    def step(self, measured: Measured, reference: Reference) -> tuple[Command, Diagnostics]:
        """Return the command for the period that begins now."""
        deviation = self.cornering.begin(measured, reference)
        gains = self.weights
        softened = gains["softening_speed"] + deviation.speed
        angle = -gains["heading_gain"] * deviation.heading_error
        angle -= math.atan(gains["error_gain"] * deviation.lateral_error / softened)
        angle -= gains["yaw_rate_gain"] * deviation.yaw_rate
        return self.cornering.command(deviation, angle)
