"""One full fit of eight parameters on eight runs of 20 s at 100 Hz: `ident`, CasADi and scipy.

    python benchmarks/bench_fit.py [--without-scipy]

The same objective, start, model and minimiser (see ``fit_problem.py``). `ident` and CasADi have exact
derivatives, scipy has ``solve_ivp`` and finite differences. Deriving and compiling is timed apart; fits are
timed in processor time of one core, so that others on the machine do not matter much. Estimates are compared,
so that nobody is fast by being wrong: the table tells the largest relative difference from `ident` of any of
the eight parameters, and in standard errors.

CasADi is timed four times: with its own derivatives of the simulation or with the recursion of the
sensitivities written out by hand, each on its virtual machine and as C compiled for this machine.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

import casadi  # noqa: E402
import fit_casadi  # noqa: E402
import numpy as np  # noqa: E402
import scipy  # noqa: E402
from fit_ident import IdentFit, engine  # noqa: E402
from fit_problem import FITTED, FitProblem, Fitted, fit, make_problem  # noqa: E402
from fit_scipy import ScipyFit  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

Array = NDArray[np.float64]

REPEATS = 5


@dataclass(frozen=True)
class Result:
    """One way of fitting: preparation and fit [s], and the estimates in coordinates."""

    name: str
    preparation: float
    seconds: float
    coordinates: Array
    note: str = ""


def timed(run: Callable[[], Fitted], repeats: int = REPEATS) -> tuple[float, Fitted]:
    """Processor time of the fastest of several fits [s], and its result; all run on one core."""
    seconds = []
    for _ in range(repeats):
        began = process_time()
        done = run()
        seconds.append(process_time() - began)
    return min(seconds), done


def by_ident(problem: FitProblem) -> tuple[Result, Fitted]:
    """Fit with the engine of `ident`."""
    began = perf_counter()
    own = IdentFit(problem, made := engine())
    ready = perf_counter() - began
    seconds, done = timed(lambda: fit(problem.start, own.rows, None))
    note = "derived and compiled now" if made.derived else "loaded from its cache"
    return Result("ident", ready, seconds, done.coordinates, note), done


def by_casadi(problem: FitProblem, *, own: bool, as_c: bool) -> Result:
    """Fit with CasADi, its own derivatives or the recursion, on its virtual machine or as C."""
    began = perf_counter()
    plain, exact = fit_casadi.functions(problem)
    if own:
        exact = fit_casadi.own_derivatives(problem, plain)
    if as_c:
        plain, exact = fit_casadi.compiled(plain, exact)
    ready = perf_counter() - began
    made = fit_casadi.CasadiFit(problem, plain, exact)
    seconds, done = timed(lambda: fit(problem.start, made.rows, made.residual))
    name = f"CasADi, {'own derivatives' if own else 'recursion by hand'}, {'C' if as_c else 'VM'}"
    return Result(name, ready, seconds, done.coordinates)


def by_scipy(problem: FitProblem) -> Result:
    """Fit with scipy, once."""
    made = ScipyFit(problem)
    seconds, done = timed(lambda: fit(problem.start, made.rows, made.residual), repeats=1)
    note = f"{made.evaluations} simulations of all runs"
    return Result("scipy, solve_ivp, finite differences", 0.0, seconds, done.coordinates, note)


def row(problem: FitProblem, one: Result, ident: Result, std: Array) -> str:
    """A line of the table."""
    values, reference = (list(problem.values(r.coordinates).values()) for r in (one, ident))
    relative = max(abs(a - b) / abs(b) for a, b in zip(values, reference, strict=True))
    in_std = float(np.max(np.abs(one.coordinates - ident.coordinates) / std))
    return (
        f"{one.name:36}{one.preparation:>10.2f}{one.seconds:>10.3f}{one.seconds / ident.seconds:>9.1f}"
        f"{relative:>12.1e}{in_std:>12.1e}  {one.note}"
    )


def main() -> None:
    """Fit with everything and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--without-scipy", action="store_true", help="leave out the slow one")
    options = parser.parse_args()
    problem = make_problem()
    print(
        f"Python {platform.python_version()}, CasADi {casadi.__version__}, scipy {scipy.__version__}, "
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; {len(problem.measured)} points, "
        f"{len(FITTED)} parameters"
    )
    print(f"{'':36}{'ready [s]':>10}{'fit [s]':>10}{'ratio':>9}{'difference':>12}{'in std':>12}", flush=True)
    ident, done = by_ident(problem)
    print(row(problem, ident, ident, done.std), flush=True)
    for own, as_c in ((True, False), (False, False), (True, True), (False, True)):
        print(row(problem, by_casadi(problem, own=own, as_c=as_c), ident, done.std), flush=True)
    if not options.without_scipy:
        print(row(problem, by_scipy(problem), ident, done.std), flush=True)


if __name__ == "__main__":
    main()
