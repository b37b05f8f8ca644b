"""Quadratic programs in stages against other solvers, the Riccati recursion and scipy."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray
from qp_peers import Osqp, condensed, run_daqp
from scipy.optimize import Bounds, LinearConstraint, minimize

from ident.control.qp import Layout, QuadraticProgram, Solver, StagedProgram, Stages
from ident.control.qp_store import keeper, load, solve_alone, store
from ident.errors import UnusableLog

Array = NDArray[np.float64]


def stages_of(seed: int, layout: Layout, size: float = 1.0) -> Stages:
    """A random problem that changes along its stages, stable enough to be looked at."""
    random = np.random.default_rng(seed)
    count, nx, nu, soft = layout.horizon, layout.states, layout.inputs, len(layout.softened)
    drift = np.eye(nx) + 0.1 * random.standard_normal((count, nx, nx))
    weights = np.tile(random.uniform(0.5, 2.0, nx), (count, 1))
    wide = np.full((count, nx), np.inf)
    return Stages(
        start=size * random.standard_normal(nx),
        A=drift,
        B=random.standard_normal((count, nx, nu)),
        c=0.1 * random.standard_normal((count, nx)),
        state_weights=weights[1:],
        terminal_weight=np.diag(weights[0]) + 0.1,
        state_goals=0.2 * random.standard_normal((count, nx)),
        input_weights=np.tile(random.uniform(0.5, 2.0, nu), (count, 1)),
        input_goals=0.1 * random.standard_normal((count, nu)),
        state_low=-wide,
        state_high=wide,
        input_low=np.full((count, nu), -np.inf),
        input_high=np.full((count, nu), np.inf),
        soft_linear=np.full(soft, 50.0),
        soft_quadratic=np.full(soft, 10.0),
    )


def bounded(stages: Stages, *, inputs: float, states: float) -> Stages:
    return replace(
        stages,
        input_low=np.full_like(stages.input_low, -inputs),
        input_high=np.full_like(stages.input_high, inputs),
        state_low=np.full_like(stages.state_low, -states),
        state_high=np.full_like(stages.state_high, states),
    )


def solved(program: QuadraticProgram) -> Array:
    solution = Solver(1e-11).solve(program)
    assert solution.solved, solution.status
    assert solution.z is not None
    return solution.z


SOFT = Layout(horizon=12, states=4, inputs=2, softened=(0, 1, 2, 3))


def soft_program(seed: int) -> QuadraticProgram:
    return StagedProgram(SOFT).filled(bounded(stages_of(seed, SOFT), inputs=0.6, states=0.8))


def test_the_plan_obeys_the_dynamics_and_costs_what_the_stages_say() -> None:
    layout = Layout(horizon=7, states=3, inputs=2, softened=(1,))
    stages = bounded(stages_of(1, layout), inputs=0.5, states=0.4)
    staged = StagedProgram(layout)
    hard_free = replace(stages, state_low=stages.state_low * [np.inf, 1, np.inf])
    hard_free = replace(hard_free, state_high=stages.state_high * [np.inf, 1, np.inf])
    program = staged.filled(hard_free)
    z = solved(program)
    plan = staged.plan(z, stages.start)
    cost = 0.0
    for k in range(7):
        x = stages.A[k] @ plan.states[k] + stages.B[k] @ plan.inputs[k] + stages.c[k]
        assert plan.states[k + 1] == pytest.approx(x, abs=1e-7)
        Q = stages.terminal_weight if k == 6 else np.diag(stages.state_weights[k])
        for value, goal, weight in (
            (plan.states[k + 1], stages.state_goals[k], Q),
            (plan.inputs[k], stages.input_goals[k], np.diag(stages.input_weights[k])),
        ):
            cost += 0.5 * (value - goal) @ weight @ (value - goal) - 0.5 * goal @ weight @ goal
        over = max(abs(plan.states[k + 1, 1]) - 0.4, 0.0)
        assert plan.slacks[k, 0] == pytest.approx(over, abs=1e-6)
        cost += 50.0 * plan.slacks[k, 0] + 5.0 * plan.slacks[k, 0] ** 2
    assert program.cost(z) == pytest.approx(cost, abs=1e-7)
    assert np.abs(plan.inputs).max() <= 0.5 + 1e-7


def test_without_limits_the_first_input_is_that_of_the_riccati_recursion() -> None:
    layout = Layout(horizon=15, states=3, inputs=1)
    stages = stages_of(2, layout)
    zero = np.zeros_like
    stages = replace(
        stages,
        c=zero(stages.c),
        state_goals=zero(stages.state_goals),
        input_goals=zero(stages.input_goals),
    )
    P = stages.terminal_weight
    for k in range(14, -1, -1):
        A, B, R = stages.A[k], stages.B[k], np.diag(stages.input_weights[k])
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        Q = np.diag(stages.state_weights[k - 1]) if k else np.zeros((3, 3))
        P = Q + A.T @ P @ (A - B @ K)
    staged = StagedProgram(layout)
    plan = staged.plan(solved(staged.filled(stages)), stages.start)
    assert plan.inputs[0] == pytest.approx(-K @ stages.start, abs=1e-6)


def test_with_the_terminal_cost_of_the_are_the_horizon_does_not_matter() -> None:
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    Q, R = np.diag([1.0, 0.2]), np.array([[0.5]])
    P = scipy.linalg.solve_discrete_are(A, B, Q, R)
    K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    start = np.array([0.7, -0.3])
    for horizon in (2, 25):
        layout = Layout(horizon=horizon, states=2, inputs=1)
        stages = replace(
            stages_of(0, layout),
            start=start,
            A=np.stack([A] * horizon),
            B=np.stack([B] * horizon),
            c=np.zeros((horizon, 2)),
            state_weights=np.tile(np.diag(Q), (horizon - 1, 1)),
            terminal_weight=P,
            state_goals=np.zeros((horizon, 2)),
            input_weights=np.tile(np.diag(R), (horizon, 1)),
            input_goals=np.zeros((horizon, 1)),
        )
        staged = StagedProgram(layout)
        plan = staged.plan(solved(staged.filled(stages)), start)
        assert plan.inputs[0] == pytest.approx(-K @ start, abs=1e-7)


def test_a_small_program_has_the_optimum_that_scipy_finds() -> None:
    layout = Layout(horizon=3, states=2, inputs=1, softened=(0,))
    program = StagedProgram(layout).filled(bounded(stages_of(3, layout), inputs=0.3, states=0.9))
    program.z_low[program.dependent], program.z_high[program.dependent] = -np.inf, np.inf
    found = minimize(
        program.cost,
        np.zeros(program.c.size),
        jac=lambda z: program.P @ z + program.c,
        hess=lambda _: program.P.toarray(),
        method="trust-constr",
        bounds=Bounds(program.z_low, program.z_high),
        constraints=[
            LinearConstraint(program.A.toarray(), program.b, program.b),
            LinearConstraint(program.G.toarray(), program.h_low, program.h_high),
        ],
        options={"gtol": 1e-10, "xtol": 1e-13, "barrier_tol": 1e-11, "maxiter": 2000},
    )
    z = solved(program)
    assert program.violation(z) < 1e-7
    assert z == pytest.approx(found.x, abs=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_osqp_and_daqp_find_the_same_plan(seed: int) -> None:
    program = soft_program(seed)
    z = solved(program)
    by_osqp, _ = Osqp(1e-10, 200_000).solve(program)
    by_daqp = run_daqp(condensed(program), 1e-11)
    assert by_osqp is not None
    assert by_daqp is not None
    assert z == pytest.approx(by_osqp, abs=1e-6)
    assert z == pytest.approx(by_daqp, abs=1e-6)


def test_an_updated_solver_gives_what_a_new_one_gives() -> None:
    kept = Solver(1e-11)
    for seed in range(6):
        stages = bounded(stages_of(seed, SOFT), inputs=0.6 + 0.1 * seed, states=0.8)
        if seed % 2:  # limits come and go
            stages = replace(stages, input_high=np.full_like(stages.input_high, np.inf))
        program = StagedProgram(SOFT).filled(stages)
        again = kept.solve(program)
        assert again.solved
        assert again.z == pytest.approx(solved(program), abs=1e-6)


def test_a_softened_limit_is_kept_where_it_can_be() -> None:
    layout = Layout(horizon=10, states=2, inputs=1, softened=(0,))
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.0], [0.1]])
    stages = replace(
        stages_of(0, layout),
        start=np.array([0.0, 0.0]),
        A=np.stack([A] * 10),
        B=np.stack([B] * 10),
        c=np.zeros((10, 2)),
        state_goals=np.tile([1.0, 0.0], (10, 1)),
        input_goals=np.zeros((10, 1)),
        state_high=np.tile([0.05, np.inf], (10, 1)),
    )
    staged = StagedProgram(layout)
    plan = staged.plan(solved(staged.filled(stages)), stages.start)
    assert plan.states[:, 0].max() == pytest.approx(0.05, abs=1e-6)
    assert plan.slacks.max() < 1e-6


def test_programs_filled_before_are_not_changed_by_those_after() -> None:
    staged = StagedProgram(SOFT)
    first = staged.filled(bounded(stages_of(0, SOFT), inputs=0.6, states=0.8))
    before = copy.deepcopy(first)
    staged.filled(bounded(stages_of(1, SOFT), inputs=0.2, states=0.1))
    for now, then in zip(first.vectors, before.vectors, strict=True):
        assert np.array_equal(now, then)
    assert np.array_equal(first.P.toarray(), before.P.toarray())
    assert np.array_equal(first.A.toarray(), before.A.toarray())


def test_a_program_that_cannot_be_met_is_told_and_the_next_is_solved() -> None:
    layout = Layout(horizon=5, states=2, inputs=1)
    stages = bounded(stages_of(4, layout), inputs=1e-3, states=1e-3)
    staged, solver = StagedProgram(layout), Solver()
    failed = solver.solve(staged.filled(stages))
    assert not failed.solved
    assert failed.status in {"primal_infeasible", "max_iter_reached"}
    assert failed.z is None
    assert solver.solve(staged.filled(stages_of(4, layout))).solved


def test_a_value_that_is_missing_is_told_not_solved() -> None:
    stages = stages_of(5, SOFT)
    stages.start[1] = np.nan
    assert Solver().solve(StagedProgram(SOFT).filled(stages)).status == "not_finite"


def test_a_program_of_another_structure_is_refused() -> None:
    solver = Solver()
    solver.solve(soft_program(0))
    other = Layout(horizon=5, states=2, inputs=1)
    with pytest.raises(ValueError, match="structure"):
        solver.solve(StagedProgram(other).filled(stages_of(0, other)))


def test_a_copied_solver_begins_anew() -> None:
    solver = Solver()
    solver.solve(soft_program(0))
    for copied in (copy.deepcopy(solver), pickle.loads(pickle.dumps(solver))):
        assert copied.solve(soft_program(1)).solved


def test_a_stored_program_is_solved_again_alone_to_the_last_digit(tmp_path: Path) -> None:
    program = soft_program(6)
    store(program, tmp_path / "one.npz")
    read, solution = solve_alone(tmp_path / "one.npz")
    assert np.array_equal(solution.z, Solver().solve(program).z)
    assert np.array_equal(read.dependent, program.dependent)
    assert read.violation(solution.z) < 1e-6


def test_a_keeper_writes_a_file_for_each_program(tmp_path: Path) -> None:
    keep = keeper(tmp_path / "programs", "mpc_time")
    for seed in range(3):
        keep(soft_program(seed))
    names = sorted(path.name for path in (tmp_path / "programs").iterdir())
    assert names == [f"mpc_time_0000{i}.npz" for i in range(3)]
    assert np.array_equal(load(tmp_path / "programs" / names[2]).c, soft_program(2).c)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nonsense", b"no archive"])
def test_a_file_that_is_no_program_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.npz"
    path.write_bytes(content)
    with pytest.raises(UnusableLog, match="not a stored quadratic program"):
        load(path)
