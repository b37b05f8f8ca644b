"""The fit with the engine of `ident`: the model in SymPy, generated code, RK4 with exact sensitivities."""

from __future__ import annotations

import numpy as np
from fit_problem import FITTED, OUTPUTS, RATE, STATES, FitProblem
from numpy.typing import NDArray

from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import Engine, compiled

Array = NDArray[np.float64]


def engine() -> Engine:
    """Derive and compile the model, or load it where that was done before."""
    return compiled(bicycle("magic_formula", "magic_formula"))


class IdentFit:
    """Residuals and derivatives of all runs."""

    def __init__(self, problem: FitProblem, made: Engine) -> None:
        truck, body = problem.truck, problem.truck.body
        self.problem, self.engine = problem, made
        self.fixed = dict.fromkeys(made.parameters, 0.0) | {
            "mass": body.mass,
            "cg_to_front_axle": body.cg_to_front_axle,
            "cg_to_rear_axle": body.cg_to_rear_axle,
            "front.curvature": truck.front.curvature,
            "rear.curvature": truck.rear.curvature,
            "reference_x": -body.cg_to_rear_axle,
            "imu_x": truck.imu_position[0],
            "imu_y": truck.imu_position[1],
        }
        order = [STATES.index(name) for name in made.states]
        self.starts = np.array([run.start[order] for run in problem.runs])
        self.inputs = np.concatenate([run.inputs for run in problem.runs])
        self.steps = np.full(len(self.inputs), 1.0 / RATE)
        self.offsets = np.cumsum([0, *(len(run.inputs) for run in problem.runs)])
        self.columns = [made.outputs.index(name) for name in OUTPUTS]

    def _arguments(self, coordinates: Array) -> tuple[Array, ...]:
        parameters = self.engine.vector(self.fixed | self.problem.values(coordinates))
        return self.starts, self.inputs, self.steps, self.offsets, parameters

    def rows(self, coordinates: Array) -> Array:
        """(n, 9) derivative of the model, residual."""
        _, outputs, slopes = self.engine.sensitivities(
            *self._arguments(coordinates), active=FITTED, wanted=OUTPUTS
        )
        weights = self.problem.weights
        made = np.empty((len(OUTPUTS), len(outputs), len(FITTED) + 1))
        scale = weights[:, None, None] * self.problem.slopes(coordinates)
        np.multiply(slopes[:, :, len(STATES) :], scale, out=made[:, :, :-1])
        made[:, :, -1] = ((self.problem.measured - outputs[:, self.columns]) * weights).T
        return made.reshape(-1, len(FITTED) + 1)
