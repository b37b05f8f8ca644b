"""A truck with one or several effects, integrated by hand: it shares nothing with the models under test.

Plain Runge-Kutta steps in Python numbers. Inputs run linearly between the points of the grid. The truck is
logged at its centre of gravity, and drives forward faster than it crawls.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Force = Callable[[float], float]

GRAVITY = 9.81


@dataclass(frozen=True)
class EffectTruck:
    """Sizes are zero where there is no effect.

    length : of relaxation [m]; sensitivity, front_share, height_over_track : of the transfer of load
    roll : steady angle per acceleration [rad s²/m], natural frequency [rad/s], damping ratio
    ratio : cubic and quadratic part of the map of the steering, at 0.5 rad; offset [rad]
    scale : logged over true speed, less one; push, tilt : side force that is felt, and that is not [N]
    """

    front: Force
    rear: Force
    mass: float = 12500.0
    inertia: float = 52000.0
    l_f: float = 2.38
    l_r: float = 2.12
    length: float = 0.0
    sensitivity: float = 0.0
    front_share: float = 0.4
    height_over_track: float = 0.55
    roll: tuple[float, float, float] = (0.0, 5.0, 0.3)
    ratio: tuple[float, float] = (0.0, 0.0)
    offset: float = 0.0
    scale: float = 0.0
    push: float = 0.0
    tilt: float = 0.0

    def wheel(self, angle: float) -> float:
        cubic, quadratic = self.ratio
        return angle + quadratic * angle**2 / 0.5 + cubic * angle**3 / 0.25 + self.offset

    def static(self, state: list[float], angle: float, speed: float) -> tuple[float, float]:
        """Static forces of the axles; the shift of load is found by iteration."""
        across, turn = state[0], state[1]
        slips = (
            angle - math.atan((across + self.l_f * turn) / speed),
            -math.atan((across - self.l_r * turn) / speed),
        )
        shifted = (self.front(slips[0]), self.rear(slips[1]))
        for _ in range(30 if self.sensitivity else 1):
            now = tuple(state[5:7]) if self.length else shifted
            felt = (now[0] * math.cos(angle) + now[1]) / self.mass
            shifted = tuple(self._wheels(axle, slips[axle], felt) for axle in (0, 1))
        return shifted

    def _wheels(self, axle: int, slip: float, felt: float) -> float:
        """Both wheels of an axle [N]: friction goes by the load of each, stiffness by c_1 F_z - c_2 F_z²."""
        share = self.front_share if axle == 0 else 1 - self.front_share
        distance = self.l_r if axle == 0 else self.l_f
        side = self.mass * GRAVITY * distance / (self.l_f + self.l_r) / 2
        moved = share * self.mass * felt * self.height_over_track
        moved = max(-side, min(side, moved))
        curvature = self.sensitivity / (1 + self.sensitivity) / side  # c_2/c_1
        curve, force = (self.front, self.rear)[axle], 0.0
        for load in (side + moved, side - moved):
            steeper = (
                (load - curvature * load**2) / (side - curvature * side**2) / (load / side) if load else 0.0
            )
            force += load / side / 2 * curve(steeper * slip)
        return force

    def motion(self, state: list[float], angle: float, logged: float) -> tuple[list[float], float]:
        """Rates of the states, and the felt acceleration."""
        across, turn, heading = state[:3]
        speed, wheel = logged / (1 + self.scale), self.wheel(angle)
        static = self.static(state, wheel, speed)
        front, rear = state[5:7] if self.length else static
        late = [
            speed / self.length * (s - f) if self.length else 0.0
            for s, f in zip(static, state[5:7], strict=True)
        ]
        pushed = front * math.cos(wheel)
        felt = (pushed + rear + self.push) / self.mass
        turning = (self.l_f * pushed - self.l_r * rear) / self.inertia
        gain, frequency, damping = self.roll
        rolling = frequency**2 * (gain * felt - state[7]) - 2 * damping * frequency * state[8]
        cosine, sine = math.cos(heading), math.sin(heading)
        return [
            felt + self.tilt / self.mass - speed * turn,
            turning,
            turn,
            speed * cosine - across * sine,
            speed * sine + across * cosine,
            *late,
            state[8],
            rolling,
        ], felt

    def drive(self, angle: Array, speed: Array, step: float, substeps: int = 2) -> dict[str, Array]:
        """Drive from rest, straight ahead; states and what the sensors read, without noise."""
        inputs = np.column_stack([angle, speed])
        states = [[0.0] * 9]
        if self.length:
            states[0][5:7] = self.static(states[0], self.wheel(float(angle[0])), float(speed[0]))
        h = step / substeps
        for before, after in pairwise(inputs):
            state = states[-1]
            for k in range(substeps):
                at = [before + (after - before) * (k + part) / substeps for part in (0.0, 0.5, 1.0)]
                one, _ = self.motion(state, *at[0])
                two, _ = self.motion(_ahead(state, one, h / 2), *at[1])
                three, _ = self.motion(_ahead(state, two, h / 2), *at[1])
                four, _ = self.motion(_ahead(state, three, h), *at[2])
                slopes = [
                    (a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(one, two, three, four, strict=True)
                ]
                state = _ahead(state, slopes, h)
            states.append(state)
        felt = [self.motion(s, *u)[1] for s, u in zip(states, inputs, strict=True)]
        columns = np.array(states).T
        names = ("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")
        return {
            **dict(zip(names, columns[:5], strict=True)),
            "lateral_acceleration": np.array(felt) + GRAVITY * np.sin(columns[7]),
            "roll_angle": columns[7],
            "roll_rate": columns[8],
        }


def _ahead(state: list[float], slope: list[float], step: float) -> list[float]:
    return [x + step * dx for x, dx in zip(state, slope, strict=True)]


def magic(stiffness: float, peak: float = 4.5e4, shape: float = 1.35, curvature: float = -0.4) -> Force:
    """Axle force of the Magic Formula."""

    def force(slip: float) -> float:
        x = stiffness / (shape * peak) * slip
        return peak * math.sin(shape * math.atan(x - curvature * (x - math.atan(x))))

    return force
