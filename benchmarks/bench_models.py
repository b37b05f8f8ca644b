"""Nanoseconds a step of each model, and how long it takes until it is ready: cold and warm.

    python benchmarks/bench_models.py

Each model runs in two processes of its own with a cache of its own: *cold* derives its Jacobians and compiles
it, *warm* finds both on disk. Ready is the time from an imported package to the first step. A step is one
RK4 step of 10 ms with inputs that run linearly; with sensitivities, to the initial state and to the active
parameters. *First* is the first pass over the data, *repeated* the fastest of several.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

SEGMENTS, POINTS, STEP = 10, 2001, 0.01  # runs, grid points of each, [s]
PASSES = 9
VALUES = {
    "mass": 12500.0,
    "yaw_inertia": 52000.0,
    "cg_to_front_axle": 2.38,
    "cg_to_rear_axle": 2.12,
    "cornering_stiffness": 3.5e5,
    "peak_force": 5e4,
    "shape": 1.35,
    "curvature": -0.5,
    "saturation_slip": 0.13,
    "reference_x": -2.12,
    "imu_x": 0.6,
    "rolling_resistance": 0.007,
    "drag": 3.0,
    "gain": 1.0,
    "time_constant_1": 0.26,
    "time_constant_2": 0.08,
}
INPUTS = {
    "road_wheel_angle": (0.0, 0.03),
    "rear_wheel_angle": (0.0, 0.003),
    "longitudinal_velocity": (12.0, 2.0),
    "drive_force": (1000.0, 500.0),
    "grade": (0.0, 0.01),
    "steering_wheel_request": (0.0, 0.5),
}  # middle and size of a slow sine
BODY_AND_MOUNTING = {"mass", "cg_to_front_axle", "cg_to_rear_axle", "reference_x", "imu_x", "imu_y"}


def models() -> dict[str, Callable[[], Any]]:
    """Every model, as something that builds its system."""
    from ident.dynamics.actuator import actuator  # noqa: PLC0415
    from ident.dynamics.bicycle import bicycle  # noqa: PLC0415
    from ident.dynamics.kinematic import kinematic  # noqa: PLC0415
    from ident.dynamics.longitudinal import driven_bicycle  # noqa: PLC0415
    from ident.dynamics.tyres import TYRES  # noqa: PLC0415

    made: dict[str, Callable[[], Any]] = {
        "actuator": actuator,
        "kinematic": kinematic,
        "kinematic, rear steer": lambda: kinematic(rear_steer=True),
    }
    for kind in TYRES:
        made[f"bicycle, {kind}"] = lambda kind=kind: bicycle(kind, kind)
    made["driven bicycle, magic_formula"] = lambda: driven_bicycle("magic_formula", "magic_formula")
    return made


@dataclass(frozen=True)
class Timing:
    """What one process measured; steps in [ns], of one model."""

    ready: float
    derived: bool
    active: int
    first: float
    repeated: float
    sensitivities_first: float
    sensitivities_repeated: float


def measure(name: str) -> Timing:
    """Build a model in this process and time it."""
    import numpy as np  # noqa: PLC0415

    from ident.dynamics.engine import compiled  # noqa: PLC0415

    began = perf_counter()
    engine = compiled(models()[name]())
    ready = perf_counter() - began
    count = SEGMENTS * POINTS
    time = np.arange(count) * STEP
    sizes = [INPUTS[each] for each in engine.inputs]
    inputs = np.column_stack([middle + size * np.sin(0.9 * time) for middle, size in sizes])
    parameters = [VALUES.get(each.rpartition(".")[2], 0.0) for each in engine.parameters]
    active = [each for each in engine.parameters if each not in BODY_AND_MOUNTING]
    starts = np.zeros((SEGMENTS, len(engine.states)))
    if "longitudinal_velocity" in engine.states:
        starts[:, engine.states.index("longitudinal_velocity")] = 12.0
    steps, offsets = np.full(count, STEP), np.arange(SEGMENTS + 1) * POINTS
    arguments = (starts, inputs, steps, offsets, parameters)
    states, _ = engine.simulate(*arguments)
    if not np.all(np.isfinite(states)):
        raise RuntimeError(f"{name} has blown up")
    plain = _passes(lambda: engine.simulate(*arguments), count)
    exact = _passes(lambda: engine.sensitivities(*arguments, active=active), count)
    return Timing(ready, engine.derived, len(active), plain[0], min(plain), exact[0], min(exact))


def _passes(run: Callable[[], object], steps: int) -> list[float]:
    """Nanoseconds a step of each pass."""
    made = []
    for _ in range(PASSES):
        began = perf_counter()
        run()
        made.append(1e9 * (perf_counter() - began) / steps)
    return made


def in_process(name: str, environment: Mapping[str, str]) -> Timing:
    """Measure a model in a process of its own."""
    command = [sys.executable, __file__, "--model", name]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)  # noqa: S603
    return Timing(**json.loads(done.stdout))


def main() -> None:
    """Time one model, or all of them and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--model", help="time this one in this process and print JSON")
    options = parser.parse_args()
    if options.model:
        print(json.dumps(measure(options.model).__dict__))
        return
    print(
        f"{'':32}{'ready [s]':>18}{'simulate [ns/step]':>22}{'sensitivities [ns/step]':>28}{'active':>8}\n"
        f"{'':32}{'cold':>9}{'warm':>9}{'first':>11}{'repeated':>11}{'first':>14}{'repeated':>14}"
    )
    for name in models():
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "IDENT_CACHE": cache}
            cold, warm = in_process(name, environment), in_process(name, environment)
        if not cold.derived or warm.derived:
            raise RuntimeError(f"{name}: the disk cache did not work as it should")
        print(
            f"{name:32}{cold.ready:>9.2f}{warm.ready:>9.2f}{warm.first:>11.0f}{warm.repeated:>11.0f}"
            f"{warm.sensitivities_first:>14.0f}{warm.sensitivities_repeated:>14.0f}{warm.active:>8}",
            flush=True,
        )


if __name__ == "__main__":
    main()
