"""The same quadratic programs by OSQP (sparse, first order, warm start) and by daqp (dense, active set).

daqp is given the condensed program: the states, which follow from the inputs, are taken out of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import daqp
import numpy as np
import osqp
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from ident.control.qp import QuadraticProgram

Array = NDArray[np.float64]


class Osqp:
    """OSQP, set up at the first program, updated with each that follows, started from the last solution."""

    def __init__(self, tolerance: float, most_iterations: int = 4000) -> None:
        self._settings = {
            "eps_abs": tolerance,
            "eps_rel": tolerance,
            "max_iter": most_iterations,
            "polishing": tolerance < 1e-6,
            "verbose": False,
            "warm_starting": True,
        }
        self._solver: Any = None

    def solve(self, program: QuadraticProgram) -> tuple[Array | None, int]:
        """The solution, None where there is none, and the iterations."""
        upper, rows = sp.triu(program.P, format="csc"), _rows(program)
        low = np.concatenate([program.b, program.h_low, program.z_low])
        high = np.concatenate([program.b, program.h_high, program.z_high])
        if self._solver is None:
            self._solver = osqp.OSQP()
            self._solver.setup(upper, program.c, rows, low, high, **self._settings)
        else:
            self._solver.update(q=program.c, l=low, u=high, Px=upper.data, Ax=rows.data)
        found = self._solver.solve(raise_error=False)
        return (found.x if found.info.status_val == 1 else None), int(found.info.iter)


def _rows(program: QuadraticProgram) -> sp.csc_matrix:
    size = program.P.shape[0]
    return sp.vstack([program.A, program.G, sp.identity(size)], format="csc")


@dataclass(frozen=True)
class Condensed:
    """min ½ w'Hw + f'w, low <= M w <= high with the limits of w itself first; z = S w + offset."""

    H: Array
    f: Array
    M: Array
    low: Array
    high: Array
    S: Array
    offset: Array


def condensed(program: QuadraticProgram) -> Condensed:
    """The program in the variables that are free."""
    size = program.P.shape[0]
    free = np.setdiff1d(np.arange(size), program.dependent)
    factor = splu(program.A[:, program.dependent].tocsc())
    S, offset = np.zeros((size, free.size)), np.zeros(size)
    S[free, np.arange(free.size)] = 1.0
    S[program.dependent] = -factor.solve(program.A[:, free].toarray())
    offset[program.dependent] = factor.solve(program.b)
    states = program.dependent[
        np.isfinite(program.z_low[program.dependent]) | np.isfinite(program.z_high[program.dependent])
    ]
    low = [program.z_low[free], program.z_low[states] - offset[states], program.h_low - program.G @ offset]
    high = [
        program.z_high[free],
        program.z_high[states] - offset[states],
        program.h_high - program.G @ offset,
    ]
    return Condensed(
        H=S.T @ (program.P @ S),
        f=S.T @ (program.c + program.P @ offset),
        M=np.vstack([S[states], program.G @ S]),
        low=np.concatenate(low),
        high=np.concatenate(high),
        S=S,
        offset=offset,
    )


def run_daqp(dense: Condensed, tolerance: float = 1e-9) -> Array | None:
    """The solution by daqp with all variables, None where there is none."""
    sense = np.zeros(dense.low.size, dtype=np.int32)
    limits = np.minimum(dense.high, 1e30), np.maximum(dense.low, -1e30)
    settings = {"primal_tol": tolerance, "dual_tol": tolerance}
    w, _, flag, _ = daqp.solve(dense.H, dense.f, np.ascontiguousarray(dense.M), *limits, sense, **settings)
    return dense.S @ w + dense.offset if flag == 1 else None
