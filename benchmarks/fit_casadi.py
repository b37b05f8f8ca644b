"""The fit in CasADi: the bicycle in SX, RK4, exact derivatives, as its virtual machine runs it or as C.

Derivatives come two ways: CasADi's own through ``mapaccum`` (``own_derivatives``), and the recursion
S' = A S + P with the Jacobians of the step, written out as part of the step (in ``functions``).
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from fit_problem import FITTED, OUTPUTS, RATE, FitProblem
from numpy.typing import NDArray

Array = NDArray[np.float64]


def magic_formula(slip: Any, stiffness: Any, peak: Any, shape: Any, curvature: float) -> Any:
    """D sin(C atan(B x - E (B x - atan(B x)))) with B = stiffness/(C D)."""
    x = stiffness / (shape * peak) * slip
    return peak * ca.sin(shape * ca.atan(x - curvature * (x - ca.atan(x))))


def model(problem: FitProblem) -> Callable[..., tuple[Any, Any]]:
    """Derivatives of (v_y, r, ψ, x, y) and the outputs, from state, input and ``FITTED``."""
    truck, body = problem.truck, problem.truck.body
    l_f, l_r, mass = body.cg_to_front_axle, body.cg_to_rear_axle, body.mass
    forward, left, _ = truck.imu_position

    def at(x: Any, u: Any, p: Any) -> tuple[Any, Any]:
        v_y, r, heading, east, north = (x[i] for i in range(5))
        steer, v_x = u[0] + p[7], u[1]
        front = magic_formula(steer - ca.atan((v_y + l_f * r) / v_x), p[0], p[1], p[2], truck.front.curvature)
        rear = magic_formula(-ca.atan((v_y - l_r * r) / v_x), p[3], p[4], p[5], truck.rear.curvature)
        across = front * ca.cos(steer)
        force, turning = (across + rear) / mass, (l_f * across - l_r * rear) / p[6]
        c, s = ca.cos(heading), ca.sin(heading)
        rates = ca.vertcat(force - v_x * r, turning, r, v_x * c - v_y * s, v_x * s + v_y * c)
        sensed = force + forward * turning - left * r**2
        return rates, ca.vertcat(r, sensed, v_y - l_r * r, heading, east - l_r * c, north - l_r * s)

    return at


def functions(problem: FitProblem) -> tuple[ca.Function, ca.Function]:
    """Simulation (x0, inputs (2, n), p) -> outputs (6, n), and the same with derivatives (48, n)."""
    at, step, n = model(problem), 1.0 / RATE, len(problem.runs[0].inputs)
    x, p = ca.SX.sym("x", 5), ca.SX.sym("p", len(FITTED))
    now, after = ca.SX.sym("u0", 2), ca.SX.sym("u1", 2)
    half = (now + after) / 2
    k1 = at(x, now, p)[0]
    k2 = at(x + step / 2 * k1, half, p)[0]
    k3 = at(x + step / 2 * k2, half, p)[0]
    k4 = at(x + step * k3, after, p)[0]
    moved = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    seen = at(x, now, p)[1]
    plain = _chain("plain", x, moved, (now, after, p), seen, n)
    sens = ca.SX.sym("S", 5, len(FITTED))
    both = ca.vertcat(x, ca.vec(sens))
    moved_sens = ca.jacobian(moved, x) @ sens + ca.jacobian(moved, p)
    seen_sens = ca.jacobian(seen, x) @ sens + ca.jacobian(seen, p)
    moved_both, seen_both = ca.vertcat(moved, ca.vec(moved_sens)), ca.vertcat(seen, ca.vec(seen_sens))
    return plain, _chain("exact", both, moved_both, (now, after, p), seen_both, n)


def own_derivatives(problem: FitProblem, plain: ca.Function) -> ca.Function:
    """Outputs and derivatives (54, n) as CasADi differentiates the simulation."""
    n = len(problem.runs[0].inputs)
    start, u, p = ca.MX.sym("x0", 5), ca.MX.sym("u", 2, n), ca.MX.sym("p", len(FITTED))
    seen = plain(start, u, p)
    slopes = ca.jacobian(seen, p)
    rows = [ca.reshape(slopes[:, i], len(OUTPUTS), n) for i in range(len(FITTED))]
    return ca.Function("own", [start, u, p], [ca.vertcat(seen, *rows)])


def _chain(name: str, state: Any, moved: Any, inputs: tuple[Any, Any, Any], seen: Any, n: int) -> ca.Function:
    """Outputs at all n points of a run, from the state at the first."""
    advance = ca.Function("advance", [state, *inputs], ca.cse([moved]))
    look = ca.Function("look", [state, inputs[0], inputs[2]], ca.cse([seen]))
    start, u, p = ca.MX.sym("x0", state.numel()), ca.MX.sym("u", 2, n), ca.MX.sym("p", len(FITTED))
    later = advance.mapaccum(n - 1)(start, u[:, :-1], u[:, 1:], ca.repmat(p, 1, n - 1))
    states = ca.horzcat(start, later)
    return ca.Function(name, [start, u, p], [look.map(n)(states, u, ca.repmat(p, 1, n))])


def compiled(*made: ca.Function) -> tuple[ca.Function, ...]:
    """Return the same functions as C, by the system's compiler, for this machine."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "fit.c"
        library = source.with_suffix(".so")
        generator = ca.CodeGenerator(source.name)
        for function in made:
            generator.add(function)
        generator.generate(folder + "/")
        command = ["cc", "-O3", "-march=native", "-shared", "-fPIC", str(source), "-o", str(library)]
        subprocess.run(command, check=True)  # noqa: S603
        return tuple(ca.external(function.name(), str(library)) for function in made)


class CasadiFit:
    """Residuals and derivatives of all runs."""

    def __init__(self, problem: FitProblem, plain: ca.Function, exact: ca.Function) -> None:
        self.problem, self.plain, self.exact = problem, plain, exact
        self.inputs = [ca.DM(run.inputs.T) for run in problem.runs]

    def residual(self, coordinates: Array) -> Array:
        """(n,) weighted, measured minus modelled."""
        p = list(self.problem.values(coordinates).values())
        seen = [
            self.plain(run.start, u, p).full().T
            for run, u in zip(self.problem.runs, self.inputs, strict=True)
        ]
        return ((self.problem.measured - np.concatenate(seen)) * self.problem.weights).ravel()

    def rows(self, coordinates: Array) -> Array:
        """(n, 9) derivative of the model, residual."""
        p = list(self.problem.values(coordinates).values())
        nothing = np.zeros(self.exact.numel_in(0) - 5)
        seen = np.concatenate(
            [
                self.exact(np.concatenate([run.start, nothing]), u, p).full().T
                for run, u in zip(self.problem.runs, self.inputs, strict=True)
            ]
        )
        outputs, weights = len(OUTPUTS), self.problem.weights
        made = np.empty((len(seen), outputs, len(FITTED) + 1))
        slopes = seen[:, outputs:].reshape(-1, len(FITTED), outputs).swapaxes(1, 2)
        made[:, :, :-1] = slopes * (weights[:, None] * self.problem.slopes(coordinates))
        made[:, :, -1] = (self.problem.measured - seen[:, :outputs]) * weights
        return made.reshape(-1, len(FITTED) + 1)
