"""A truck on a plane that shares nothing with the models under test: any axle force, bank, mass and sensors.

Plain Runge-Kutta steps of the bicycle, in Python numbers. Inputs run linearly between the points of the grid,
so that what a fit sees of them is exact; every sensor is sampled on the grid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord, Samples

Array = NDArray[np.float64]
Force = Callable[[float], float]

STEP = 0.01  # [s]
SUBSTEPS = 2
GRAVITY = 9.81
BODY = Body(12500.0, 2.38, 2.12)
INERTIA = 52000.0
REFERENCE_X, IMU = -2.12, (0.6, 0.15)
NOISE = {  # standard deviation of white noise
    "yaw_rate": 0.0015,
    "lateral_acceleration": 0.04,
    "lateral_velocity": 0.012,
    "heading": 0.001,
    "position_x": 0.01,
    "position_y": 0.01,
}


def linear(stiffness: float) -> Force:
    return lambda slip: stiffness * slip


def piecewise(stiffness: float, most: float) -> Force:
    return lambda slip: stiffness * max(-most, min(most, slip))


def magic(stiffness: float, peak: float, shape: float, curvature: float) -> Force:
    def force(slip: float) -> float:
        x = stiffness / (shape * peak) * slip
        return peak * math.sin(shape * math.atan(x - curvature * (x - math.atan(x))))

    return force


def brush(stiffness: float, peak: float) -> Force:
    def force(slip: float) -> float:
        left = max(0.0, 1.0 - stiffness * abs(math.tan(slip)) / (3.0 * peak))
        return math.copysign(peak * (1.0 - left**3), slip)

    return force


@dataclass(frozen=True, eq=False)
class PlaneTruck:
    """What the truck is; ``bank``: sine of the bank where the heading is 0 and where it is 90 degrees."""

    front: Force
    rear: Force
    mass: float = BODY.mass
    inertia: float = INERTIA
    bank: tuple[float, float] = (0.0, 0.0)
    offset: float = 0.0
    biases: Mapping[str, float] = field(default_factory=dict)

    def accelerations(self, state: tuple[float, ...], angle: float, speed: float) -> tuple[float, float]:
        """Tyre force over mass [m/s²], yaw acceleration [rad/s²]."""
        across, turn = state[0], state[1]
        wheel = angle + self.offset
        front = self.front(wheel - math.atan((across + BODY.cg_to_front_axle * turn) / speed))
        rear = self.rear(-math.atan((across - BODY.cg_to_rear_axle * turn) / speed))
        pushed = front * math.cos(wheel)
        turning = (BODY.cg_to_front_axle * pushed - BODY.cg_to_rear_axle * rear) / self.inertia
        return (pushed + rear) / self.mass, turning

    def rates(self, state: tuple[float, ...], angle: float, speed: float) -> tuple[float, ...]:
        across, turn, heading = state[:3]
        felt, turning = self.accelerations(state, angle, speed)
        down = GRAVITY * (self.bank[0] * math.cos(heading) + self.bank[1] * math.sin(heading))
        cosine, sine = math.cos(heading), math.sin(heading)
        moved = (speed * cosine - across * sine, speed * sine + across * cosine)
        return felt - down - speed * turn, turning, turn, *moved

    def stepped(self, state: tuple[float, ...], before: Array, after: Array) -> tuple[float, ...]:
        """One step of the grid, the inputs (angle, speed) linear in it."""
        h = STEP / SUBSTEPS
        for k in range(SUBSTEPS):
            at = [before + (after - before) * (k + half) / SUBSTEPS for half in (0.0, 0.5, 1.0)]
            one = self.rates(state, *at[0])
            two = self.rates(_ahead(state, one, h / 2), *at[1])
            three = self.rates(_ahead(state, two, h / 2), *at[1])
            four = self.rates(_ahead(state, three, h), *at[2])
            slopes = (a + 2 * b + 2 * c + d for a, b, c, d in zip(one, two, three, four, strict=True))
            state = tuple(x + h / 6 * slope for x, slope in zip(state, slopes, strict=True))
        return state

    def drive(
        self,
        angle: Array,
        speed: Array,
        *,
        run: int = 0,
        seed: int | None = None,
        pose: tuple[float, float, float] = (0.3, 40.0, -25.0),
        noise: Mapping[str, float] = NOISE,
        colour: float = 0.0,
    ) -> MotionRecord:
        """Drive and measure, without noise unless a seed is given.

        pose : heading and place of the CG at first; colour : correlation of successive samples of the noise
        """
        inputs = np.column_stack([angle, speed])
        states = [(0.0, 0.0, *pose)]
        for before, after in pairwise(inputs):
            states.append(self.stepped(states[-1], before, after))
        felt = np.array([self.accelerations(s, *u) for s, u in zip(states, inputs, strict=True)])
        times = STEP * np.arange(len(states))
        random = np.random.default_rng(seed)
        measured = {}
        for name, values in _sensed(np.array(states), felt).items():
            error = np.zeros(times.size)
            if seed is not None:
                error = noise.get(name, 0.0) * _correlated(random.standard_normal(times.size), colour)
            measured[name] = Samples(times, values + error + self.biases.get(name, 0.0))
        return MotionRecord(
            run, times, inputs[:, 0], inputs[:, 1], measured, reference_x=REFERENCE_X, imu=IMU
        )


def _ahead(state: tuple[float, ...], slope: tuple[float, ...], step: float) -> tuple[float, ...]:
    return tuple(x + step * dx for x, dx in zip(state, slope, strict=True))


def _correlated(white: Array, colour: float) -> Array:
    """Stationary noise of standard deviation one from white numbers."""
    made = white.copy()
    for k in range(1, white.size):
        made[k] = colour * made[k - 1] + math.sqrt(1 - colour**2) * white[k]
    return made


def _sensed(states: Array, felt: Array) -> dict[str, Array]:
    across, turn, heading, x, y = states.T
    return {
        "yaw_rate": turn,
        "lateral_acceleration": felt[:, 0] + IMU[0] * felt[:, 1] - IMU[1] * turn**2,
        "lateral_velocity": across + REFERENCE_X * turn,
        "heading": heading,
        "position_x": x + REFERENCE_X * np.cos(heading),
        "position_y": y + REFERENCE_X * np.sin(heading),
    }


def inputs(
    seconds: float, *, most: float = 0.09, seed: int = 0, speed: float = 12.0, mean: float = 0.0
) -> tuple[Array, Array]:
    """Road-wheel angle [rad] of a few sines up to ``most`` around a mean, a speed that varies by 2 m/s."""
    random = np.random.default_rng([seed, 77])
    times = STEP * np.arange(round(seconds / STEP) + 1)
    angle = np.zeros(times.size)
    for frequency, share in ((0.11, 0.35), (0.27, 0.35), (0.63, 0.2), (1.1, 0.1)):
        angle += share * np.sin(2 * np.pi * frequency * times + random.uniform(0, 2 * np.pi))
    return mean + most * angle, speed + 2.0 * np.sin(2 * np.pi * 0.07 * times + random.uniform(0, 2 * np.pi))
