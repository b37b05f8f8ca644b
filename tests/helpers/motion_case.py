"""Layers of the motion over runs of a plane truck, and points of their problems for tests of derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from plane_truck import BODY, INERTIA, NOISE, PlaneTruck, inputs, magic

from ident.estimation.motion_layer import MotionLayer
from ident.estimation.noise import AutoRegression, NoiseModel
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_problem import VehicleProblem
from ident.estimation.vehicle_records import MotionRecord

Array = NDArray[np.float64]

AXLES = {"front": (328e3, 45e3, 1.35, -0.4), "rear": (417e3, 51e3, 1.35, -0.5)}
TRUCK = PlaneTruck(magic(*AXLES["front"]), magic(*AXLES["rear"]))
NAMES = ("cornering_stiffness", "peak_force", "shape", "curvature")
TRUE = {
    **{
        f"{axle}.{name}": value
        for axle, values in AXLES.items()
        for name, value in zip(NAMES, values, strict=True)
    },
    "yaw_inertia": INERTIA,
}
FLOOR = dict.fromkeys([*NOISE, "position_along", "position_across"], 1e-6)
COLOUR = {  # of the noise: correlation of successive samples, standard deviation
    "yaw_rate": (0.5, 0.0015),
    "lateral_acceleration": (0.8, 0.04),
    "lateral_velocity": (0.0, 0.012),
    "heading": (0.6, 0.001),
    "position_along": (0.9, 0.01),
    "position_across": (0.3, 0.01),
}


def records(
    *,
    truck: PlaneTruck = TRUCK,
    seconds: float = 16.0,
    count: int = 2,
    noisy: bool = True,
    most: float = 0.09,
) -> list[MotionRecord]:
    return [
        truck.drive(
            *inputs(seconds, seed=run, most=most),
            run=run,
            seed=run if noisy else None,
            pose=(0.4 + 2 * run, 30.0, -80.0),
        )
        for run in range(count)
    ]


def layer_of(given: Sequence[MotionRecord], start: Mapping[str, float] = TRUE) -> MotionLayer:
    runs = [f"run_{number}" for number in range(max(one.run for one in given) + 1)]
    return MotionLayer(given, runs, BODY, start, FLOOR, height_over_track=0.55)


def coloured(problem: VehicleProblem) -> dict[str, NoiseModel]:
    """Known noise with colour of its own for each compared signal."""
    made = {}
    for name in problem.compared:
        shape, size = COLOUR[name]
        made[name] = NoiseModel(AutoRegression(np.array([shape] if shape else [])), size)
    return made


def point_at(
    problem: VehicleProblem, values: Mapping[str, float] = TRUE, *, seed: int | None = None
) -> VehiclePoint:
    """The problem at parameters; with a seed, terms of the runs and initial states off their usual values."""
    shared = np.array([one.coordinate(values[one.name]) for one in problem.coordinates])
    of_runs, local = np.zeros((problem.windows.runs, len(problem.run_terms))), problem.initial_local
    if seed is not None:
        random = np.random.default_rng(seed)
        of_runs = 0.3 * problem.run_std * random.standard_normal(of_runs.shape)
        local = local + 0.02 * random.standard_normal(local.shape)
    return VehiclePoint(problem, shared, of_runs, local, coloured(problem))
