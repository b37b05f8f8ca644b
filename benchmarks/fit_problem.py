"""One fit, the same for all that are timed: eight parameters of a bicycle with Magic Formula tyres.

Data: eight runs of the planar truck of the sample logs, driven harder than there (7 m/s² in the driver's
mind), so that they tell all eight parameters. Inputs are exact at 100 Hz and run linearly between; outputs
have white noise of known size, and the state at the start is known, so that nothing but the simulation and
its derivatives is compared. The curvature of both tyres is given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from generator.motion import HEADING, V_Y, YAW_RATE, X, Y, drive, imu_signals, rear_axle_signals
from generator.runs import Trip, drivers_inputs
from generator.sensors import generator
from generator.truth import Planar, load_truth
from numpy.typing import NDArray

from ident.estimation.elimination import triangle_of
from ident.estimation.gauss_newton import minimise

Array = NDArray[np.float64]

RUNS, SECONDS, RATE, PEAK = 8, 20.0, 100.0, 7.0
FITTED = (
    "front.cornering_stiffness",
    "front.peak_force",
    "front.shape",
    "rear.cornering_stiffness",
    "rear.peak_force",
    "rear.shape",
    "yaw_inertia",
    "steering_offset",
)
TRUE_OFFSET = 0.004  # [rad] at the road wheel
OFFSET_UNIT = 0.01  # [rad] of one step of its coordinate
START = {
    "front.cornering_stiffness": 0.85,
    "front.peak_force": 1.2,
    "front.shape": 1.1,
    "rear.cornering_stiffness": 1.2,
    "rear.peak_force": 0.9,
    "rear.shape": 0.9,
    "yaw_inertia": 1.2,
}  # over the truth
NOISE = {
    "yaw_rate": 0.0014,
    "lateral_acceleration": 0.045,
    "lateral_velocity": 0.013,
    "heading": 0.001,
    "position_x": 0.012,
    "position_y": 0.012,
}
OUTPUTS = tuple(NOISE)
STATES = ("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")
OF_STATE = (V_Y, YAW_RATE, HEADING, X, Y)


@dataclass(frozen=True)
class BenchRun:
    """One run on a grid of (n,) points.

    start : (5,) state of the CG; inputs : (n, 2) road-wheel angle without offset [rad], speed [m/s]
    measured : (n, 6) in the order of ``OUTPUTS``
    """

    start: Array
    inputs: Array
    measured: Array


@dataclass(frozen=True)
class FitProblem:
    """The runs, the truck that made them, and the coordinates of the fit: logarithms, but for the offset."""

    runs: list[BenchRun]
    truck: Planar

    @cached_property
    def truth(self) -> dict[str, float]:
        """True values of ``FITTED``."""
        values = {"yaw_inertia": self.truck.body.yaw_inertia, "steering_offset": TRUE_OFFSET}
        for axle in ("front", "rear"):
            tyre = getattr(self.truck, axle)
            values[f"{axle}.cornering_stiffness"] = tyre.stiffness * tyre.shape * tyre.peak
            values[f"{axle}.peak_force"] = tyre.peak
            values[f"{axle}.shape"] = tyre.shape
        return values

    @property
    def start(self) -> Array:
        """Where every fit begins, in coordinates."""
        values = {name: START[name] * self.truth[name] for name in START}
        return np.array([np.log(values[name]) if name in values else 0.0 for name in FITTED])

    def values(self, coordinates: Sequence[float]) -> dict[str, float]:
        """Parameters at coordinates."""
        return {
            name: float(OFFSET_UNIT * at if name == "steering_offset" else np.exp(at))
            for name, at in zip(FITTED, coordinates, strict=True)
        }

    def slopes(self, coordinates: Sequence[float]) -> Array:
        """(8,) derivative of each parameter to its coordinate."""
        values = self.values(coordinates)
        return np.array([OFFSET_UNIT if name == "steering_offset" else values[name] for name in FITTED])

    @cached_property
    def measured(self) -> Array:
        """(N, 6) of all runs."""
        return np.concatenate([run.measured for run in self.runs])

    @property
    def weights(self) -> Array:
        """(6,) one over the noise."""
        return 1.0 / np.array(list(NOISE.values()))


def make_problem(seed: int = 1) -> FitProblem:
    """Drive the runs."""
    truck = load_truth().planar
    return FitProblem([_run(truck, seed, f"bench_{number}") for number in range(RUNS)], truck)


def _run(truck: Planar, seed: int, name: str) -> BenchRun:
    random = generator(seed, name)
    truth = load_truth()
    wheel, speed, pose = drivers_inputs(Trip("planar", PEAK, SECONDS), truth, random)
    offset = truck.steering_ratio * TRUE_OFFSET
    motion = drive(truck, wheel, speed, SECONDS, pose)
    time = np.arange(round(SECONDS * RATE) + 1) / RATE
    rear, imu = rear_axle_signals(truck, motion), imu_signals(truck, motion)
    true = np.column_stack(
        [imu["yaw_rate"](time), imu["lateral_acceleration"](time)]
        + [rear[signal](time) for signal in ("lateral_velocity", "heading", "x", "y")]
    )
    noise = np.array(list(NOISE.values())) * random.standard_normal(true.shape)
    inputs = np.column_stack([(wheel(time) - offset) / truck.steering_ratio, speed(time)])
    return BenchRun(motion.states[0, list(OF_STATE)], inputs, true + noise)


# --- the minimiser, the same for all that have derivatives --------------------------------------

Residual = Callable[[Array], Array]
Rows = Callable[[Array], Array]


@dataclass(frozen=True)
class Point:
    """Where the iterations of ``ident.estimation.gauss_newton`` are.

    rows : coordinates -> (n, 9) derivative of the model and residual, measured minus modelled
    residual : coordinates -> (n,) for a trial step; None where the rows cost hardly more
    """

    shared: Array
    rows: Rows
    residual: Residual | None
    std: float = 1.0

    @cached_property
    def made(self) -> Array:
        """Derivatives and residual here."""
        return self.rows(self.shared)

    @cached_property
    def value(self) -> float:
        """Sum of squares."""
        left = self.made[:, -1] if self.residual is None else self.residual(self.shared)
        return float(left @ left)

    def triangle(self) -> Array:
        """Triangle of [derivatives | residual]."""
        return triangle_of(self.made)

    def moved(self, step: Array) -> Point:
        """Where a step leads."""
        return replace(self, shared=self.shared + step)

    def inside(self, shared: Array) -> Array:
        """Keep everything."""
        return shared


@dataclass(frozen=True)
class Fitted:
    """Estimates (8,), their standard deviations (8,) in coordinates, and what is left over."""

    coordinates: Array
    std: Array
    cost: float


def fit(start: Array, rows: Rows, residual: Residual | None) -> Fitted:
    """Minimise from a start on."""
    point, triangle, converged = minimise(Point(start, rows, residual))
    if not converged:
        raise RuntimeError("the fit has not converged")
    inverse = np.linalg.inv(triangle)
    return Fitted(point.shared, np.sqrt(np.sum(inverse**2, axis=1)), point.value)
