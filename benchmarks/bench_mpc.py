"""The predictive controllers against their period, and their programs in piqp, OSQP and daqp.

    python benchmarks/bench_mpc.py [--kind linear]

Each controller drives a single lane change at 80 km/h from a start beside the path, horizon 40, period 50 ms;
the simulated truck has 0.05 s more dead time than the controller believes. A step is all that the controller
does in a cycle: estimate, prediction over the commands on their way, linearisation, program, plan. Times are
processor time of one core, so that others on the machine do not matter much; wall time is told beside it.

The same programs, in their order, are then solved by piqp (as the controller does: updated, no warm start),
OSQP (updated, started from the last solution; to two tolerances) and daqp (dense, after the states have been
taken out; with and without the time for that). The last columns tell who is right: how far the first steering
request is from that of piqp to 1e-11, in parts of the largest request, and how many programs were not solved.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, thread_time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE)]

import daqp  # noqa: E402
import numpy as np  # noqa: E402
import osqp  # noqa: E402
import piqp  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from qp_peers import Osqp, condensed, run_daqp  # noqa: E402

from ident.control.closed_loop import Disturbance, run  # noqa: E402
from ident.control.controllers.controller import Command, Diagnostics, Measured  # noqa: E402
from ident.control.controllers.mpc_controller import Mpc  # noqa: E402
from ident.control.controllers.mpc_robust import mpc_robust  # noqa: E402
from ident.control.controllers.mpc_spatial import mpc_spatial, mpc_spatial_rate  # noqa: E402
from ident.control.controllers.mpc_time import mpc_time, mpc_time_kinematic  # noqa: E402
from ident.control.plant import Plant  # noqa: E402
from ident.control.qp import QuadraticProgram, Solver  # noqa: E402
from ident.control.reference import Reference  # noqa: E402
from ident.control.scenarios import scenario  # noqa: E402
from ident.control.speed_profile import SpeedLimits  # noqa: E402
from ident.control.truck import SteeringActuator, Truck  # noqa: E402

Array = NDArray[np.float64]

PERIOD, GOAL = 0.05, 0.005  # [s]
SPEED = 80 / 3.6  # [m/s]
LATER = 0.05  # [s] dead time of the simulated truck beyond the believed one
START = Disturbance(lateral_error=0.5, heading_error=0.017, speed=-1.0)
MAKERS = {
    "mpc_time_kinematic": mpc_time_kinematic,
    "mpc_time": mpc_time,
    "mpc_spatial": mpc_spatial,
    "mpc_spatial_rate": mpc_spatial_rate,
    "mpc_robust": mpc_robust,
}
TYRES = {
    "linear": {},
    "magic_formula": {"peak_force": 5e4, "shape": 1.35, "curvature": -0.5},
}


def truck(kind: str) -> Truck:
    """A truck as a fit would give it."""
    body = {"mass": 12500.0, "yaw_inertia": 52000.0, "cg_to_front_axle": 2.38, "cg_to_rear_axle": 2.12}
    for axle, stiffness in (("front", 2.6e5), ("rear", 4.2e5)):
        body[f"{axle}.cornering_stiffness"] = stiffness
        body |= {f"{axle}.{name}": value for name, value in TYRES[kind].items()}
    ratio = np.array([[-12.0, -12.0 / 20.5], [12.0, 12.0 / 20.5]])
    return Truck(kind, body, SteeringActuator(0.986, 0.117, 0.1, 0.05, ratio))


class Timed:
    """A controller whose steps are timed by the processor's clock."""

    def __init__(self, controller: Mpc) -> None:
        self._controller = controller
        self.name, self.period = controller.name, controller.period
        self.processor: list[float] = []
        self.wall: list[float] = []

    def reset(self) -> None:
        """Forget all runs before, and their times."""
        self._controller.reset()
        self.processor, self.wall = [], []

    def step(self, measured: Measured, reference: Reference) -> tuple[Command, Diagnostics]:
        """One step of the controller."""
        on_wall, began = perf_counter(), thread_time()
        answer = self._controller.step(measured, reference)
        self.processor.append(thread_time() - began)
        self.wall.append(perf_counter() - on_wall)
        return answer


def driven(name: str, kind: str) -> tuple[Timed, list[QuadraticProgram], int]:
    """Steps of a second run, when all is compiled and designed; its programs; how many had no solution."""
    believed = truck(kind)
    programs: list[QuadraticProgram] = []
    controller = MAKERS[name](believed, PERIOD, keep=programs.append)
    timed = Timed(controller)
    road = scenario("single_lane_change", believed, SpeedLimits(SPEED))
    steering = replace(believed.steering, dead_time=believed.steering.dead_time + LATER)
    plant = Plant(replace(believed, steering=steering))
    run(plant, timed, road, START)
    programs.clear()
    run(plant, timed, road, START)
    return timed, list(programs), controller.failures


@dataclass(frozen=True)
class Solved:
    """One solver on all programs: processor time of each [s], and the solutions, None where there is none."""

    name: str
    seconds: Array
    solutions: list[Array | None]


def solved_by(
    name: str, solve: Callable[[Any], Array | None], programs: list[Any], *, repeats: int = 3
) -> Solved:
    """The fastest of several passes over all programs, each pass in their order."""
    times = np.full(len(programs), np.inf)
    solutions: list[Array | None] = []
    for _ in range(repeats):
        solutions = []
        for k, program in enumerate(programs):
            began = thread_time()
            solutions.append(solve(program))
            times[k] = min(times[k], thread_time() - began)
    return Solved(name, times, solutions)


def solvers(programs: list[QuadraticProgram]) -> list[Solved]:
    """Every way of solving, the controller's own first."""
    kept, exact, rough = Solver(), Osqp(1e-6), Osqp(1e-3)
    dense = [condensed(program) for program in programs]
    return [
        solved_by("piqp", lambda p: kept.solve(p).z, programs),
        solved_by("OSQP 1e-6", lambda p: exact.solve(p)[0], programs),
        solved_by("OSQP 1e-3", lambda p: rough.solve(p)[0], programs),
        solved_by("daqp", run_daqp, dense),
        solved_by("daqp, condensing", lambda p: run_daqp(condensed(p)), programs),
    ]


def percentiles(seconds: list[float] | Array) -> tuple[float, float]:
    """p50 and p99 [ms]."""
    p50, p99 = np.quantile(np.asarray(seconds) * 1e3, [0.5, 0.99])
    return float(p50), float(p99)


def print_steps(name: str, timed: Timed, failures: int) -> None:
    """The whole step against the period."""
    p50, p99 = percentiles(timed.processor)
    wall50, wall99 = percentiles(timed.wall)
    verdict = "met" if p99 <= GOAL * 1e3 else "not met"
    print(
        f"{name:20s} {len(timed.processor):5d} {p50:7.2f} {p99:7.2f} {p99 / PERIOD / 10:7.1f} %"
        f" {verdict:>9s} {wall50:8.2f} {wall99:7.2f} {failures:9d}"
    )


def print_solvers(name: str, found: list[Solved], programs: list[QuadraticProgram]) -> None:
    """Each solver's time as a ratio to that of piqp, and how right it is."""
    first = np.array([Solver(1e-11).solve(program).z[0] for program in programs])
    largest = max(np.abs(first).max(), 1e-12)
    base = found[0].seconds
    for solved in found:
        p50, p99 = percentiles(solved.seconds)
        missing = sum(z is None for z in solved.solutions)
        off = [abs(z[0] - f) for z, f in zip(solved.solutions, first, strict=True) if z is not None]
        ratio = np.median(solved.seconds) / np.median(base)
        worst = f"{max(off) / largest:9.1e}" if off else "      ---"
        print(f"{name:20s} {solved.name:18s} {p50:7.2f} {p99:7.2f} {ratio:8.2f} {worst} {missing:9d}")
        name = ""


def main() -> None:
    """Run all and print two tables."""
    parser = argparse.ArgumentParser(description="The predictive controllers against their period.")
    parser.add_argument("--kind", choices=sorted(TYRES), default="magic_formula", help="tyres of the model")
    kind = parser.parse_args().kind
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}, tyres {kind},")
    versions = {"piqp": piqp, "osqp": osqp, "daqp": daqp}
    told = [f"{n} {getattr(m, '__version__', 'of unknown version')}" for n, m in versions.items()]
    print(", ".join(told), "\n")
    print(f"{'':26s}{'step [ms]':>15s} {'p99 of':>9s} {'p99 below':>9s} {'wall [ms]':>16s} {'no':>9s}")
    heads = ("steps", 5), ("p50", 7), ("p99", 7), ("period", 9), ("5 ms", 9), ("p50", 8), ("p99", 7)
    print(f"{'controller':20s}", *(f"{head:>{width}s}" for head, width in heads), f"{'solution':>9s}")
    runs = {}
    for name in MAKERS:
        timed, programs, failures = driven(name, kind)
        runs[name] = programs
        print_steps(name, timed, failures)
    print(f"\n{'':40s}{'QP [ms]':>13s} {'p50 by':>9s} {'farthest':>9s} {'no':>9s}")
    columns = ("p50", 7), ("p99", 7), ("piqp", 8), ("off", 9), ("solution", 9)
    print(f"{'programs of':20s} {'solver':18s}", *(f"{head:>{width}s}" for head, width in columns))
    for name, programs in runs.items():
        print_solvers(name, solvers(programs), programs)


if __name__ == "__main__":
    main()
