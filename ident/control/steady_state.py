"""Steady cornering: the road-wheel angle, the turn and the drift of a truck on a circle.

On a circle of curvature k a tracked point moves with the velocity (v_x, v_P) of the vehicle, its yaw rate is
that of the circle, and all that moves in the model has come to rest:

    f_i(x, δ) = 0 for all states but the pose,      r = k (v_x² + v_P²)^½,      e_ψ = -atan(v_P/v_x)

so that ė_y = v_x sin e_ψ + v_P cos e_ψ = 0 and ė_ψ = r - k ṡ = 0. Solved for the model's own ``System`` by
Newton's method with its exact Jacobians, at all points at once, from straight driving on in even parts of the
curvature. For linear tyres, small angles and the centre of gravity it is the textbook's δ = k (L + K_us v²).

A solution counts only on the branch that comes from straight driving: the determinant of the equations keeps
its sign along that branch and is zero at its end, where the tyres give no more. Beyond, a larger angle gives
less turn, and a controller would have nothing to stand on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.control.simulated import effects_of, engine_of, parameter_names
from ident.control.truck import Truck
from ident.dynamics.bicycle import MOUNTING
from ident.dynamics.engine import Engine
from ident.errors import BadRecipe

Array = NDArray[np.float64]

POSE = ("heading", "position_x", "position_y")
PARTS = 10  # of the curvature, one after another
ROUNDS = 12  # of Newton's method in each part
SMALL_STEP = 1e-10  # of a Newton step, relative to the size of the unknown
CLOSE_TO_SINGULAR = 1e-6  # share of the determinant of straight driving below which the branch has ended
SMALLEST = 1e-6  # size of an unknown below which a step is judged absolutely


@dataclass(frozen=True)
class SteadyCornering:
    """road_wheel_angle, yaw_rate, lateral_velocity, heading_error : (n,) as in ``Reference``; SI."""

    road_wheel_angle: Array
    yaw_rate: Array
    lateral_velocity: Array
    heading_error: Array


def steady_cornering(
    truck: Truck, curvature: Array, speed: Array, *, tracked_x: float = 0.0
) -> SteadyCornering:
    """Steady cornering at each pair of a curvature and a speed.

    Parameters
    ----------
    curvature : (n,) of the tracked point's circle [1/m]; speed : (n,) longitudinal, positive [m/s]
    tracked_x : of the tracked point, forward of the centre of gravity [m]

    Raises
    ------
    BadRecipe
        If the tyres cannot hold the truck on such a circle, or the wheels do not turn that far.
    """
    pairs, places = np.unique(np.stack([curvature, speed], axis=1), axis=0, return_inverse=True)
    curves, speeds = pairs.T
    equations = _Equations(truck, speeds, tracked_x)
    unknowns = equations.solved(curves)
    _refuse_sharp(truck, unknowns[:, -1], curves, speeds)
    turn, drift = equations.motion(unknowns)
    found = np.stack([unknowns[:, -1], turn, drift, -np.arctan2(drift, speeds)])[:, places.ravel()]
    return SteadyCornering(*found)


class _Equations:
    """The equations above for one truck at (n,) speeds.

    Unknowns are the states but the pose, in the model's order, then the road-wheel angle.
    """

    def __init__(self, truck: Truck, speeds: Array, tracked_x: float) -> None:
        effects = effects_of(truck)
        self.engine: Engine = engine_of(truck.model, tuple(effects))
        values = {name: float(truck.parameters[name]) for name in parameter_names(truck.model)}
        values |= {**dict.fromkeys(MOUNTING, 0.0), "reference_x": tracked_x}
        for own in effects.values():
            values |= own
        self._parameters = self.engine.vector(values)
        self._speeds = speeds
        names = self.engine.states
        self._moving = [i for i, name in enumerate(names) if name not in POSE]
        self._heading = names.index("heading")
        self._drift = self.engine.outputs.index("lateral_velocity")
        self._angle = self.engine.inputs.index("road_wheel_angle")
        self._model = truck.model

    def solved(self, curves: Array) -> Array:
        """(n, m) unknowns on the branch that comes from straight driving."""
        unknowns = np.zeros((curves.size, len(self._moving) + 1))
        unknowns, _ = self._newton(unknowns, np.zeros_like(curves))
        straight = np.linalg.det(self._jacobian(unknowns, np.zeros_like(curves)))
        reached, before = np.zeros(curves.size), unknowns
        for share in np.arange(1, PARTS + 1) / PARTS:
            now = share * curves
            found, converged = self._newton(2.0 * unknowns - before, now)
            determinant = np.linalg.det(self._jacobian(found, now))
            holds = converged & (determinant / straight > CLOSE_TO_SINGULAR) & (share - reached < 1.5 / PARTS)
            reached = np.where(holds, share, reached)
            before, unknowns = unknowns, np.where(holds[:, None], found, unknowns)
        self._refuse_sliding(reached, curves)
        return unknowns

    def motion(self, unknowns: Array) -> tuple[Array, Array]:
        """Yaw rate [rad/s], and lateral velocity of the tracked point [m/s]."""
        x, u = self._arguments(unknowns)
        turn = self.engine.rates(x, u, self._parameters)[:, self._heading]
        return turn, self.engine.outputs_of(x, u, self._parameters)[:, self._drift]

    def _newton(self, unknowns: Array, curves: Array) -> tuple[Array, NDArray[np.bool_]]:
        for _ in range(ROUNDS):
            jacobian = self._jacobian(unknowns, curves)
            solvable = np.isfinite(jacobian).all(axis=(1, 2)) & (np.linalg.det(np.nan_to_num(jacobian)) != 0)
            jacobian[~solvable] = np.eye(jacobian.shape[-1])
            step = np.linalg.solve(jacobian, self._residual(unknowns, curves)[..., None])[..., 0]
            unknowns = unknowns - step
            sizes = np.maximum(np.abs(unknowns), SMALLEST)
            converged = solvable & (np.abs(step) <= SMALL_STEP * sizes).all(axis=1)
            if converged.all():
                break
        return unknowns, converged

    def _arguments(self, unknowns: Array) -> tuple[Array, Array]:
        x = np.zeros((unknowns.shape[0], len(self.engine.states)))
        x[:, self._moving] = unknowns[:, :-1]
        u = np.zeros((unknowns.shape[0], len(self.engine.inputs)))
        u[:, self._angle] = unknowns[:, -1]
        u[:, self.engine.inputs.index("longitudinal_velocity")] = self._speeds
        return x, u

    def _residual(self, unknowns: Array, curves: Array) -> Array:
        x, u = self._arguments(unknowns)
        rates = self.engine.rates(x, u, self._parameters)
        turn, drift = self.motion(unknowns)
        circle = turn - curves * np.hypot(self._speeds, drift)
        return np.concatenate([rates[:, self._moving], circle[:, None]], axis=1)

    def _jacobian(self, unknowns: Array, curves: Array) -> Array:
        """(n, m, m), from the Jacobians of the model."""
        x, u = self._arguments(unknowns)
        of_rates = self._columns(*self.engine.jacobians(x, u, self._parameters)[:2])
        of_outputs = self._columns(*self.engine.output_jacobians(x, u, self._parameters)[:2])
        drift = self.motion(unknowns)[1]
        share = curves * drift / np.hypot(self._speeds, drift)
        circle = of_rates[:, self._heading] - share[:, None] * of_outputs[:, self._drift]
        return np.concatenate([of_rates[:, self._moving], circle[:, None, :]], axis=1)

    def _columns(self, to_states: Array, to_inputs: Array) -> Array:
        """Derivatives to the unknowns."""
        angle = to_inputs[..., self._angle][..., None]
        return np.concatenate([to_states[..., self._moving], angle], axis=-1)

    def _refuse_sliding(self, reached: Array, curves: Array) -> None:
        """Refuse if not all shares of the curvatures were reached that were asked for."""
        if (reached == 1).all():
            return
        demand = np.abs(curves) * self._speeds**2
        worst = int(np.argmax(np.where(reached < 1, demand, 0.0)))
        raise BadRecipe(
            f"no steady cornering of the {self._model} model at a curvature of {curves[worst]:.3g} 1/m and "
            f"{self._speeds[worst]:.3g} m/s, {demand[worst]:.2f} m/s² across: it holds at "
            f"{reached[worst] * demand[worst]:.2f} m/s²; lower the lateral acceleration of the speed profile"
        )


def _refuse_sharp(truck: Truck, angles: Array, curves: Array, speeds: Array) -> None:
    worst = int(np.argmax(np.abs(angles)))
    if abs(angles[worst]) > truck.highest_angle:
        raise BadRecipe(
            f"a curvature of {curves[worst]:.3g} 1/m at {speeds[worst]:.3g} m/s needs "
            f"{abs(angles[worst]):.3g} rad at the road wheels, they reach "
            f"{truck.highest_angle:.3g} rad: take a wider path"
        )
