"""PID on the lateral error a look-ahead in front of the truck, with the derivative from the heading error.

    κ = -(ω² e_a + 2 ζ ω v e_ψ + (ω²/T_i) ∫ e_a dt)/v²,      e_a = e_y + v t_a e_ψ

in curvature beside that of the reference: with ë_y = v² κ the gains are a frequency ω and a damping ratio ζ
at every speed. The derivative of e_y is v e_ψ, so that no measured error is differentiated. The integral
stands still where the error is beyond ``INTEGRAL_ZONE`` or the steering at a limit: it is there for what
stays, not for what a disturbed start or the estimate of a disturbance leaves on the way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from ident.control.controllers.controller import Command, Diagnostics, Measured
from ident.control.controllers.steady import SLOWEST, SteeredBeside
from ident.control.controllers.weights import PID_GAINS
from ident.control.reference import Reference
from ident.control.truck import Truck

INTEGRAL_ZONE = 0.1  # [m]


class PID(SteeredBeside):
    """Steers by PID; the speed is held beside it.

    weights : frequency ω [rad/s], damping ζ, look_ahead_time t_a [s], integral_time T_i [s]
    """

    name = "pid"
    gains = PID_GAINS

    def __init__(self, truck: Truck, period: float, weights: Mapping[str, float] | None = None) -> None:
        super().__init__(truck, period, weights)
        self._integral = 0.0

    def reset(self) -> None:
        """Forget all runs before."""
        super().reset()
        self._integral = 0.0

    def step(self, measured: Measured, reference: Reference) -> tuple[Command, Diagnostics]:
        """Return the command for the period that begins now."""
        deviation = self.cornering.begin(measured, reference)
        gains = self.weights
        speed, heading = max(deviation.speed, SLOWEST), math.sin(deviation.heading_error)
        error = deviation.lateral_error + speed * gains["look_ahead_time"] * heading
        square = gains["frequency"] ** 2
        wanted = square * (error + self._integral / gains["integral_time"])
        wanted += 2 * gains["damping"] * gains["frequency"] * speed * heading
        angle = self.cornering.angle_for(-wanted / speed**2, deviation)
        command, diagnostics = self.cornering.command(deviation, angle)
        if abs(error) < INTEGRAL_ZONE and not self.cornering.is_limited(deviation, command):
            self._integral += error * self.period
        return command, diagnostics
