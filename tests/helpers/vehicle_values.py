"""Values of a heavy truck for tests of the models, and inputs to drive it with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BODY = {"mass": 12500.0, "yaw_inertia": 52000.0, "cg_to_front_axle": 2.38, "cg_to_rear_axle": 2.12}
AT_CG = {"reference_x": 0.0, "imu_x": 0.0, "imu_y": 0.0}
LEVEL = {"steering_offset": 0.0, "bank_cos": 0.0, "bank_sin": 0.0}
MOUNTED = {"reference_x": -2.12, "imu_x": 0.6, "imu_y": 0.15}
TILTED = {"steering_offset": 0.004, "bank_cos": 0.02, "bank_sin": -0.03}
TYRES = {
    "linear": {"cornering_stiffness": 3.3e5},
    "piecewise_linear": {"cornering_stiffness": 3.3e5, "saturation_slip": 0.05},
    "magic_formula": {"cornering_stiffness": 3.3e5, "peak_force": 4.5e4, "shape": 1.35, "curvature": -0.4},
    "brush": {"cornering_stiffness": 3.3e5, "peak_force": 2e4},
}
KINDS = tuple(TYRES)


def tyres(front: str, rear: str) -> dict[str, float]:
    """The rear axle 20 % stiffer than the front one."""
    values = {f"front.{name}": value for name, value in TYRES[front].items()}
    rear_values = {f"rear.{name}": value for name, value in TYRES[rear].items()}
    return values | rear_values | {"rear.cornering_stiffness": 4e5}


def truck(kind: str, *others: dict[str, float]) -> dict[str, float]:
    """All parameters of the planar bicycle; on level ground and logged at the CG unless said otherwise."""
    values = BODY | tyres(kind, kind) | AT_CG | LEVEL
    for other in others:
        values |= other
    return values


def segments(count: int, sizes: Sequence[int], step: float, seed: int = 1) -> tuple[Array, ...]:
    """Starts, inputs, steps, offsets of several segments with steering to 0.12 rad at 6 to 15 m/s."""
    random = np.random.default_rng(seed)
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    time = step * np.arange(offsets[-1])
    angle = 0.08 * np.sin(1.7 * time + random.uniform(0, 6)) + 0.04 * np.sin(5.1 * time)
    speed = 10.5 + 4.5 * np.sin(0.4 * time + random.uniform(0, 6))
    starts = random.normal(size=(len(sizes), count)) * 0.1
    return starts, np.stack([angle, speed], axis=1), np.full(time.size, step), offsets
