"""The linear system by which axle forces are observed: one record of motion, matrix by matrix.

States: lateral velocity and yaw rate of the CG, the force of each axle and its rate of change. With the
inputs known the motion is linear in them. Between two stamps the matrix A is that of the inputs half-way;
forces move the yaw rate, that moves the lateral velocity, and nothing comes back, so that

    Φ = I + A h + A² h²/2 + A³ h³/6,      Q = ∫ Φ(s) G Gᵀ Φ(s)ᵀ ds over a step

end there: the first is exact, and so is the second by the quadrature used.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.bicycle import MOUNTING, bicycle
from ident.dynamics.effects.free_forces import FORCES, FREE_FORCES, RATES
from ident.dynamics.engine import Engine, compiled
from ident.estimation.kalman import LinearSystem
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord, Samples

Array = NDArray[np.float64]
Index = NDArray[np.intp]

STATES = ("lateral_velocity", "yaw_rate", *FORCES, *RATES)
SLIPS = ("front_slip_angle", "rear_slip_angle")
MEASURED = ("yaw_rate", "lateral_acceleration", "lateral_velocity")
START_STD = (3.0, 1.0)  # of lateral velocity [m/s] and yaw rate [rad/s]
FORCE_STD, RATE_STD = 1.0, 3.0  # of a force over the load of its axle, of its rate [1/s]
SAME_TIME = 1e-6  # [s]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)  # exact up to the power 7 of the step
NOTHING = Samples(np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class ForceProblem:
    """The filter of one record.

    stamps : (k,) all those of its grid and its samples [s]
    system : at the stamps, states in the order of ``STATES``
    grid : (m,) place of each grid point among them
    slips : whether a lateral velocity was measured, so that slip angles can be told
    inputs, parameters : (m, nu), (np,) of the model at the grid points
    """

    stamps: Array
    system: LinearSystem
    grid: Index
    slips: bool
    inputs: Array
    parameters: Array

    def slip_angles(self, states: Array) -> tuple[Array, Array]:
        """Slip angles (m, 2) at states (m, n) on the grid [rad], and their gradients (m, 2, n)."""
        engine = _engine()
        full = _full(engine, states)
        rows = [engine.outputs.index(name) for name in SLIPS]
        slips = engine.outputs_of(full, self.inputs, self.parameters)[:, rows]
        slopes = engine.output_jacobians(full, self.inputs, self.parameters)[0][:, rows]
        return slips, slopes[:, :, _places(engine)]


@dataclass(frozen=True)
class ForceVehicle:
    """What all records share.

    bias : as in ``observe_forces``
    variances : per sample of the white noise of each signal in use, yaw rate first
    """

    body: Body
    yaw_inertia: float
    bias: Mapping[int, Mapping[str, float]]
    variances: Mapping[str, float]

    def problem(self, record: MotionRecord) -> ForceProblem:
        """Set up the filter of a record whose yaw rate was measured."""
        engine = _engine()
        own = [record.measured.get(name, NOTHING).times for name in self.variances]
        stamps = _stamps([record.times, *own])
        inputs = self._inputs(record, stamps)
        measured = np.column_stack([self._at(record, name, stamps, inputs[:, 1]) for name in self.variances])
        along = np.zeros((stamps.size, len(STATES)))
        along[:, 1] = _filled(stamps, measured[:, 0])
        p = self._parameters(engine, record)
        transition, driven = self._transition(engine, along, inputs, p, np.diff(stamps, prepend=stamps[0]))
        measuring, offset = self._measuring(engine, along, inputs, p)
        spread = np.concatenate([START_STD, FORCE_STD * self._loads(), RATE_STD * self._loads()])
        system = LinearSystem(
            transition=transition,
            drift=np.zeros_like(along),
            driven=driven,
            measuring=measuring,
            offset=offset,
            noise=np.array(list(self.variances.values())),
            measured=measured,
            start=np.zeros(len(STATES)),
            start_covariance=np.diag(spread**2),
        )
        grid = np.searchsorted(stamps, record.times - SAME_TIME)
        slips = "lateral_velocity" in self.variances and is_measured(record, "lateral_velocity")
        return ForceProblem(stamps, system, grid.astype(np.intp), slips, inputs[grid], p)

    def _loads(self) -> Array:
        return np.array([self.body.load("front"), self.body.load("rear")])

    def _inputs(self, record: MotionRecord, stamps: Array) -> Array:
        """(k, 2) road-wheel angle and speed."""
        angle = record.road_wheel_angle + self._bias(record, "steering_offset")
        return np.column_stack([np.interp(stamps, record.times, each) for each in (angle, record.speed)])

    def _at(self, record: MotionRecord, name: str, stamps: Array, speed: Array) -> Array:
        """(k,) samples of a signal without its bias, NaN where there is none."""
        samples = record.measured.get(name, NOTHING)
        values = np.full(stamps.size, np.nan)
        place = np.searchsorted(stamps, samples.times - SAME_TIME)
        values[place] = samples.values - self._bias(record, name)
        return values - self._bias(record, f"{name}_by_speed") * speed

    def _bias(self, record: MotionRecord, name: str) -> float:
        return self.bias.get(record.run, {}).get(name, 0.0)

    def _parameters(self, engine: Engine, record: MotionRecord) -> Array:
        body = self.body
        mounting = dict(zip(MOUNTING, (record.reference_x, *record.imu), strict=True))
        known = {
            "mass": body.mass,
            "yaw_inertia": self.yaw_inertia,
            "cg_to_front_axle": body.cg_to_front_axle,
            "cg_to_rear_axle": body.cg_to_rear_axle,
            "front.cornering_stiffness": 0.0,
            "rear.cornering_stiffness": 0.0,
        }
        return engine.vector(known | mounting)

    def _transition(
        self, engine: Engine, along: Array, inputs: Array, p: Array, steps: Array
    ) -> tuple[Array, Array]:
        middle = np.vstack([inputs[:1], (inputs[1:] + inputs[:-1]) / 2])
        places = _places(engine)
        matrices = engine.jacobians(_full(engine, along), middle, p)[0][:, places][:, :, places]
        push = np.zeros((len(STATES), 2))
        push[4:] = np.diag(self._loads())
        driven = np.zeros_like(matrices)
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            carried = _carried(matrices, steps * (node + 1) / 2) @ push
            driven += weight / 2 * steps[:, None, None] * carried @ carried.swapaxes(1, 2)
        return _carried(matrices, steps), driven

    def _measuring(self, engine: Engine, along: Array, inputs: Array, p: Array) -> tuple[Array, Array]:
        """Matrices (k, m, n) and offsets (k, m) of the outputs, linear about ``along``."""
        full = _full(engine, along)
        rows = [engine.outputs.index(name) for name in self.variances]
        slopes = engine.output_jacobians(full, inputs, p)[0][:, rows][:, :, _places(engine)]
        read = engine.outputs_of(full, inputs, p)[:, rows]
        return slopes, read - np.einsum("kij,kj->ki", slopes, along)


def is_measured(record: MotionRecord, name: str) -> bool:
    """Whether a record holds more than one sample of a signal."""
    return record.measured.get(name, NOTHING).times.size > 1


def _engine() -> Engine:
    return compiled(bicycle("linear", "linear", (FREE_FORCES,)))


def _places(engine: Engine) -> list[int]:
    return [engine.states.index(name) for name in STATES]


def _full(engine: Engine, states: Array) -> Array:
    """States of the model (k, nx) from those of the filter (k, n); heading and position are zero."""
    full = np.zeros((len(states), len(engine.states)))
    full[:, _places(engine)] = states
    return full


def _stamps(all_times: Iterable[Array]) -> Array:
    """Every time once; what lies within ``SAME_TIME`` is one."""
    times = np.sort(np.concatenate(list(all_times)))
    return times[np.diff(times, prepend=-np.inf) > SAME_TIME]


def _filled(stamps: Array, values: Array) -> Array:
    known = np.isfinite(values)
    return np.interp(stamps, stamps[known], values[known])


def _carried(matrices: Array, steps: Array) -> Array:
    """exp(A h) of nilpotent matrices (k, n, n): the series ends at the third power."""
    h = steps[:, None, None]
    square = matrices @ matrices
    return np.eye(len(STATES)) + matrices * h + square * h**2 / 2 + square @ matrices * h**3 / 6
