"""The fit with scipy: `solve_ivp` for every simulation, derivatives by finite differences.

The minimiser is that of the others: `scipy.optimize.least_squares` follows the narrow valley between
stiffness, peak and shape in short steps and needs several times more simulations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import atan, cos, sin

import numpy as np
from fit_problem import OUTPUTS, RATE, BenchRun, FitProblem
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

# RK45 with two steps between points of the grid and no others: few cross a kink of the inputs, which leaves
# errors of 1e-5 of the noise, and nothing jumps, so that differences may be small. LSODA and RK45 with free
# steps need rtol 1e-9 for the same, and are slower.
STEP = 0.5 / RATE  # [s]
ACCURACY = {"method": "RK45", "first_step": STEP, "max_step": STEP, "rtol": 1e-3, "atol": 1e-3}
DIFFERENCE = 1e-6  # step of each coordinate; from 1e-4 on, their curvature keeps the fit from converging


def magic_formula(slip: float, stiffness: float, peak: float, shape: float, curvature: float) -> float:
    """D sin(C atan(B x - E (B x - atan(B x)))) with B = stiffness/(C D)."""
    x = stiffness / (shape * peak) * slip
    return peak * sin(shape * atan(x - curvature * (x - atan(x))))


@dataclass
class ScipyFit:
    """Residuals of all runs; counts how often they were computed."""

    problem: FitProblem
    evaluations: int = field(default=0)

    def residual(self, coordinates: Array) -> Array:
        """(n,) weighted, measured minus modelled."""
        p = list(self.problem.values(coordinates).values())
        seen = np.concatenate([self._outputs(run, p) for run in self.problem.runs])
        self.evaluations += 1
        return ((self.problem.measured - seen) * self.problem.weights).ravel()

    def rows(self, coordinates: Array) -> Array:
        """(n, 9) derivative of the model by forward differences, residual."""
        left = self.residual(coordinates)
        moved = [self.residual(coordinates + step) for step in DIFFERENCE * np.eye(len(coordinates))]
        return np.column_stack([*((left - other) / DIFFERENCE for other in moved), left])

    def _outputs(self, run: BenchRun, p: list[float]) -> Array:
        time = np.arange(len(run.inputs)) / RATE
        solved = solve_ivp(self._rates(run, p), (0.0, time[-1]), run.start, t_eval=time, **ACCURACY)
        if not solved.success:
            raise RuntimeError(solved.message)
        return self._seen(run, solved.y, p)

    def _rates(self, run: BenchRun, p: list[float]) -> Callable[[float, Array], list[float]]:
        body, (front, rear) = self.problem.truck.body, (self.problem.truck.front, self.problem.truck.rear)
        mass, l_f, l_r = body.mass, body.cg_to_front_axle, body.cg_to_rear_axle
        steer, speed = run.inputs.T.tolist()
        last = len(steer) - 2

        def rates(time: float, state: Array) -> list[float]:
            v_y, r, heading, _, _ = state.tolist()
            k = min(int(time * RATE), last)
            part = time * RATE - k
            delta = steer[k] + part * (steer[k + 1] - steer[k]) + p[7]
            v_x = speed[k] + part * (speed[k + 1] - speed[k])
            of_front = magic_formula(delta - atan((v_y + l_f * r) / v_x), p[0], p[1], p[2], front.curvature)
            of_rear = magic_formula(-atan((v_y - l_r * r) / v_x), p[3], p[4], p[5], rear.curvature)
            across, c, s = of_front * cos(delta), cos(heading), sin(heading)
            return [
                (across + of_rear) / mass - v_x * r,
                (l_f * across - l_r * of_rear) / p[6],
                r,
                v_x * c - v_y * s,
                v_x * s + v_y * c,
            ]

        return rates

    def _seen(self, run: BenchRun, states: Array, p: list[float]) -> Array:
        """(n, 6) outputs from (5, n) states."""
        l_r, forward, left = self.problem.truck.body.cg_to_rear_axle, *self.problem.truck.imu_position[:2]
        v_y, r, heading, east, north = states
        rates = self._rates(run, p)
        moving = np.array([rates(k / RATE, state) for k, state in enumerate(states.T)])
        across = moving[:, 0] + run.inputs[:, 1] * r
        outputs = {
            "yaw_rate": r,
            "lateral_acceleration": across + forward * moving[:, 1] - left * r**2,
            "lateral_velocity": v_y - l_r * r,
            "heading": heading,
            "position_x": east - l_r * np.cos(heading),
            "position_y": north - l_r * np.sin(heading),
        }
        return np.column_stack([outputs[name] for name in OUTPUTS])
