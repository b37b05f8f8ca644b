"""Quadratic programs of optimal control: structure built once, values filled in each cycle, solved by piqp.

    min  Σ_k ½ (x_k - g_k)' Q_k (x_k - g_k) + ½ (u_k - w_k)' R_k (u_k - w_k) + Σ ρ₁ s + ½ ρ₂ s²
    s.t. x_(k+1) = A_k x_k + B_k u_k + c_k,   x_0 given
         u_low <= u_k <= u_high,   x_low - s <= x_k <= x_high + s,   s >= 0

The states stay variables and the dynamics stay equalities, so that the matrix of the optimality conditions
is banded by blocks: the work grows with the horizon and not with its cube. Only the states that are named as
``softened`` have a slack s, one for both of their limits; ρ₁ makes the penalty exact: where the limits can be
kept and ρ₁ is above the largest multiplier, the slack is zero (Kerrigan and Maciejowski, "Soft constraints
and exact penalty functions in model predictive control", 2000).

piqp is an interior-point method with a proximal term (Schwan, Jiang, Kuhn, Jones, "PIQP: A proximal
interior-point quadratic programming solver", CDC 2023): no warm start, but few and nearly constant
iterations.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

TOLERANCE = 1e-8  # absolute and relative, of residuals and duality gap
MOST_ITERATIONS = 60  # a program of this size takes 8 to 20


@dataclass(frozen=True, eq=False)
class QuadraticProgram:
    """min ½ z'Pz + c'z  subject to  A z = b,  h_low <= G z <= h_high,  z_low <= z <= z_high.

    P (n, n) symmetric, A (m, n), G (p, n) : compressed by columns, with a structure that does not change
    dependent : (m,) columns that follow from the others by A z = b: the states
    """

    P: sp.csc_matrix
    c: Array
    A: sp.csc_matrix
    b: Array
    G: sp.csc_matrix
    h_low: Array
    h_high: Array
    z_low: Array
    z_high: Array
    dependent: Integers

    @property
    def vectors(self) -> tuple[Array, ...]:
        """All that is no matrix."""
        return self.c, self.b, self.h_low, self.h_high, self.z_low, self.z_high

    def is_finite(self) -> bool:
        """Whether a solver can be given this: no value is missing, only limits may be infinite."""
        values = (self.P.data, self.A.data, self.G.data, self.c, self.b)
        limits = (self.h_low, self.h_high, self.z_low, self.z_high)
        return all(np.isfinite(v).all() for v in values) and not any(np.isnan(v).any() for v in limits)

    def cost(self, z: Array) -> float:
        """½ z'Pz + c'z."""
        return float(0.5 * z @ (self.P @ z) + self.c @ z)

    def violation(self, z: Array) -> float:
        """Largest violation of any constraint."""
        inside = self.G @ z
        gaps = (self.h_low - inside, inside - self.h_high, self.z_low - z, z - self.z_high)
        return float(max(np.abs(self.A @ z - self.b).max(initial=0.0), *(g.max(initial=0.0) for g in gaps)))


@dataclass(frozen=True)
class Solution:
    """What a solver said.

    solved : whether z is the optimum to the tolerance; status : in one word, why not where it is not
    z : (n,), None where not solved; iterations; solve_time : of update and solve [s]
    """

    solved: bool
    status: str
    z: Array | None
    iterations: int
    solve_time: float


class Solver:
    """piqp, set up at the first program and updated with each that follows.

    tolerance : absolute and relative, of residuals and duality gap

    A copy, also one that went to another process, begins anew with its first program.
    """

    def __init__(self, tolerance: float = TOLERANCE) -> None:
        self._tolerance = tolerance
        self._solver: Any = None
        self._structure: tuple[int, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        return {"_tolerance": self._tolerance, "_solver": None, "_structure": ()}

    def solve(self, program: QuadraticProgram) -> Solution:
        """Solve one program; a failure is a value, not an error.

        Raises
        ------
        ValueError
            If the structure is not that of the programs before.
        """
        began = perf_counter()
        if not program.is_finite():
            return Solution(False, "not_finite", None, 0, perf_counter() - began)
        self._load(program)
        status = self._solver.solve()
        result = self._solver.result
        solved = status.name == "PIQP_SOLVED" and bool(np.isfinite(result.x).all())
        name = status.name.removeprefix("PIQP_").lower()
        z = np.array(result.x, dtype=np.float64) if solved else None
        return Solution(solved, name, z, int(result.info.iter), perf_counter() - began)

    def _load(self, program: QuadraticProgram) -> None:
        structure = (program.P.nnz, program.A.nnz, program.G.nnz, *program.A.shape, program.G.shape[0])
        values = {"P": program.P, "c": program.c, "A": program.A, "b": program.b, "G": program.G}
        values |= {"h_l": program.h_low, "h_u": program.h_high, "x_l": program.z_low, "x_u": program.z_high}
        if self._solver is None:
            self._solver = _piqp(self._tolerance)
            self._solver.setup(**values)
            self._structure = structure
        elif structure != self._structure:
            raise ValueError(f"a program of structure {structure}, need {self._structure} as before")
        else:
            self._solver.update(**{name: value for name, value in values.items() if name != "G"})


def _piqp(tolerance: float) -> Any:
    import piqp  # noqa: PLC0415 - a compiled package that only a controller with a program needs

    solver = piqp.SparseSolver()
    settings = solver.settings
    settings.kkt_solver = piqp.KKTSolver.sparse_multistage
    settings.eps_abs = settings.eps_rel = tolerance
    settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = tolerance
    settings.max_iter = MOST_ITERATIONS
    return solver


@dataclass(frozen=True)
class Layout:
    """The size of a problem in stages.

    horizon : N; states : nx; inputs : nu
    softened : indices of the states whose limits may be exceeded at a price
    """

    horizon: int
    states: int
    inputs: int
    softened: tuple[int, ...] = ()

    @property
    def stride(self) -> int:
        """Variables of a stage: u_k, x_(k+1), and the slacks of x_(k+1)."""
        return self.inputs + self.states + len(self.softened)


@dataclass(frozen=True)
class Stages:
    """The values of a problem in stages; arrays of states are those of x_1 ... x_N.

    start : (nx,) x_0
    A (N, nx, nx), B (N, nx, nu), c (N, nx) : dynamics
    state_weights (N - 1, nx) : diagonals of Q_1 ... Q_(N-1); terminal_weight (nx, nx) : Q_N
    input_weights (N, nu) : diagonals of R; state_goals (N, nx), input_goals (N, nu) : g, w
    state_low, state_high (N, nx); input_low, input_high (N, nu) : limits, infinite where there is none
    soft_linear, soft_quadratic : (ns,) ρ₁, ρ₂ of the softened states
    """

    start: Array
    A: Array
    B: Array
    c: Array
    state_weights: Array
    terminal_weight: Array
    input_weights: Array
    state_goals: Array
    input_goals: Array
    state_low: Array
    state_high: Array
    input_low: Array
    input_high: Array
    soft_linear: Array = field(default_factory=lambda: np.empty(0))
    soft_quadratic: Array = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Plan:
    """What was found: inputs (N, nu), states (N + 1, nx) from x_0 on, slacks (N, ns)."""

    inputs: Array
    states: Array
    slacks: Array


class StagedProgram:
    """Fills the values of stages into a quadratic program whose structure was built once."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        count, nx, nu, stride = layout.horizon, layout.states, layout.inputs, layout.stride
        size = count * stride
        first = np.arange(count)[:, None] * stride
        self._u = first + np.arange(nu)
        self._x = first + nu + np.arange(nx)
        self._s = first + nu + nx + np.arange(len(layout.softened))
        self._P, self._P_order = _structure([*self._cost_places()], (size, size))
        self._A, self._A_order = _structure([*self._dynamics_places()], (count * nx, size))
        self._G = self._soft_rows(size)

    def _cost_places(self) -> list[tuple[Integers, Integers]]:
        u, x, final = self._u, self._x[:-1], self._x[-1]
        return [(u, u), (x, x), (final[:, None], final[None, :]), (self._s, self._s)]

    def _dynamics_places(self) -> list[tuple[Integers, Integers]]:
        rows = np.arange(self.layout.horizon * self.layout.states).reshape(self._x.shape)
        identity = (rows, self._x)
        return [
            identity,
            (rows[1:, :, None], self._x[:-1, None, :]),
            (rows[:, :, None], self._u[:, None, :]),
        ]

    def _soft_rows(self, size: int) -> sp.csc_matrix:
        """What h_low and h_high bound: x - s, then x + s."""
        x, s = self._x[:, list(self.layout.softened)].ravel(), self._s.ravel()
        rows = np.arange(x.size)
        ones = np.ones(x.size)
        entries = np.concatenate([ones, -ones, ones, ones])
        places = np.concatenate([rows, rows, rows + x.size, rows + x.size]), np.concatenate([x, s, x, s])
        return sp.csc_matrix((entries, places), shape=(2 * x.size, size))

    def filled(self, stages: Stages) -> QuadraticProgram:
        """The program of these values; what was returned before keeps its own."""
        curvature = np.broadcast_to(stages.soft_quadratic, self._s.shape)
        weights = (stages.input_weights, stages.state_weights, stages.terminal_weight, curvature)
        P = _filled(self._P, self._P_order, *weights)
        A = _filled(self._A, self._A_order, np.ones(self._x.shape), -stages.A[1:], -stages.B)
        b = stages.c.copy()
        b[0] += stages.A[0] @ stages.start
        h_low, h_high = self._soft_limits(stages)
        z_low, z_high = self._limits(stages)
        c = self._gradient(stages)
        return QuadraticProgram(
            P, c, A, b.ravel(), self._G, h_low, h_high, z_low, z_high, dependent=self._x.ravel()
        )

    def _gradient(self, stages: Stages) -> Array:
        c = np.zeros(self._P.shape[0])
        c[self._u] = -stages.input_weights * stages.input_goals
        c[self._x[:-1]] = -stages.state_weights * stages.state_goals[:-1]
        c[self._x[-1]] = -stages.terminal_weight @ stages.state_goals[-1]
        c[self._s] = stages.soft_linear
        return c

    def _soft_limits(self, stages: Stages) -> tuple[Array, Array]:
        soft = list(self.layout.softened)
        low, high = stages.state_low[:, soft].ravel(), stages.state_high[:, soft].ravel()
        none = np.full(low.size, np.inf)
        return np.concatenate([-none, low]), np.concatenate([high, none])

    def _limits(self, stages: Stages) -> tuple[Array, Array]:
        low = np.full(self._P.shape[0], -np.inf)
        high = np.full(self._P.shape[0], np.inf)
        low[self._u], high[self._u] = stages.input_low, stages.input_high
        low[self._x], high[self._x] = stages.state_low, stages.state_high
        soft = self._x[:, list(self.layout.softened)]
        low[soft], high[soft] = -np.inf, np.inf
        low[self._s] = 0.0
        return low, high

    def plan(self, z: Array, start: Array) -> Plan:
        """Inputs, states and slacks of a solution."""
        return Plan(z[self._u], np.vstack([start, z[self._x]]), z[self._s])


def _structure(
    places: list[tuple[Integers, Integers]], shape: tuple[int, int]
) -> tuple[sp.csc_matrix, Integers]:
    """An empty matrix with entries at these places, and in which order it takes their values."""
    pairs = [np.broadcast_arrays(rows, columns) for rows, columns in places]
    rows = np.concatenate([pair[0].ravel() for pair in pairs])
    columns = np.concatenate([pair[1].ravel() for pair in pairs])
    numbered = sp.csc_matrix((np.arange(1.0, rows.size + 1), (rows, columns)), shape=shape)
    numbered.sort_indices()
    return numbered, numbered.data.astype(np.int64) - 1


def _filled(structure: sp.csc_matrix, order: Integers, *values: Array) -> sp.csc_matrix:
    flat = np.concatenate([part.ravel() for part in values])[order]
    return sp.csc_matrix((flat, structure.indices, structure.indptr), shape=structure.shape)
