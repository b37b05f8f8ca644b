"""Elimination in blocks gives what dense least squares gives, whatever the rank."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag

from ident.estimation.elimination import (
    damped_solution,
    eliminate,
    inverse_of,
    stacked,
    triangle_of,
    with_priors,
)

OWN, REST = 3, 4


def parts(seed, count=3, rows=40):
    """Rows [own | rest | residual] of several parts, badly scaled as states and stiffnesses are."""
    random = np.random.default_rng(seed)
    scale = np.array([1e-3, 1.0, 1e4, 1e-5, 1.0, 1e3, 1.0, 1.0])
    return [random.standard_normal((rows, OWN + REST + 1)) * scale for _ in range(count)]


def dense(given):
    """Columns of all own parameters and the rest, and the target."""
    own = block_diag(*[one[:, :OWN] for one in given])
    columns = np.hstack([own, np.vstack([one[:, OWN:-1] for one in given])])
    return columns, np.concatenate([one[:, -1] for one in given])


def minimum_of(columns, target):
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    solution = np.linalg.lstsq(columns / scale, target, rcond=None)[0] / scale
    return solution, float(np.sum((target - columns @ solution) ** 2))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_rest_and_own_parameters_are_those_of_dense_least_squares(seed):
    given_parts = parts(seed)
    columns, target = dense(given_parts)
    expected, left = minimum_of(columns, target)
    eliminated = [eliminate(one, OWN) for one in given_parts]
    triangle = stacked(eliminated)
    rest = damped_solution(triangle[:REST, :-1], triangle[:REST, -1], 0.0)
    assert rest == pytest.approx(expected[-REST:], rel=1e-8)
    own = np.concatenate([one.step(rest) for one in eliminated])
    assert own == pytest.approx(expected[:-REST], rel=1e-8)
    assert triangle[REST, -1] ** 2 == pytest.approx(left, rel=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_covariances_are_blocks_of_the_dense_inverse(seed):
    given_parts = parts(seed)
    columns, _ = dense(given_parts)
    scale = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.inv((columns / scale).T @ (columns / scale)) / np.outer(scale, scale)
    eliminated = [eliminate(one, OWN) for one in given_parts]
    back = inverse_of(stacked(eliminated)[:REST, :-1])
    of_rest = back @ back.T
    size = np.sqrt(np.diag(inverse))
    normed = np.outer(size, size)
    assert of_rest / normed[-REST:, -REST:] == pytest.approx((inverse / normed)[-REST:, -REST:], abs=1e-9)
    for number, one in enumerate(eliminated):
        at = slice(number * OWN, (number + 1) * OWN)
        own = one.own_covariance(of_rest)
        assert own / normed[at, at] == pytest.approx((inverse / normed)[at, at], abs=1e-9)


@pytest.mark.parametrize("kind", ["zero column", "twice the same", "sum of both others"])
def test_own_columns_that_the_rows_cannot_tell_apart_do_no_harm(kind):
    given_parts = parts(5)
    for one in given_parts:
        one[:, 2] = {"zero column": 0.0 * one[:, 0], "twice the same": one[:, 1]}.get(
            kind, one[:, 0] + one[:, 1]
        )
    columns, target = dense(given_parts)
    expected, left = minimum_of(columns, target)
    eliminated = [eliminate(one, OWN) for one in given_parts]
    assert [one.rank for one in eliminated] == [OWN - 1] * 3
    triangle = stacked(eliminated)
    rest = damped_solution(triangle[:REST, :-1], triangle[:REST, -1], 0.0)
    assert rest == pytest.approx(expected[-REST:], rel=1e-8)
    own = np.concatenate([one.step(rest) for one in eliminated])
    assert np.sum((target - columns @ np.concatenate([own, rest])) ** 2) == pytest.approx(left, rel=1e-9)
    unknown = np.isinf(np.diag(eliminated[0].own_covariance(np.eye(REST))))
    assert np.count_nonzero(unknown) == 1


def test_fewer_rows_than_own_parameters_leave_nothing_to_the_rest():
    (one,) = parts(2, count=1, rows=2)
    found = eliminate(one, OWN)
    assert found.rank == 2
    assert np.abs(found.rows).max() < 1e-9 * np.abs(one).max()


def test_a_part_without_rows_tells_nothing():
    whole = parts(3)
    nothing = eliminate(np.zeros((0, OWN + REST + 1)), OWN)
    assert nothing.rank == 0
    assert nothing.step(np.ones(REST)) == pytest.approx(np.zeros(OWN))
    assert np.isinf(np.diag(nothing.own_covariance(np.eye(REST)))).all()
    eliminated = [eliminate(one, OWN) for one in whole]
    with_it, without = stacked([*eliminated, nothing]), stacked(eliminated)
    assert with_it.T @ with_it == pytest.approx(without.T @ without, rel=1e-9)


def test_priors_weigh_as_bayes_says():
    (one,) = parts(4, count=1)
    std, mean = np.array([0.2, np.inf, 3e-4]), np.array([0.1, 0.0, -1e-4])
    found = eliminate(with_priors(one, std, mean), OWN)
    precision = np.where(np.isfinite(std), 1 / std**2, 0.0)
    normal = one[:, :-1].T @ one[:, :-1]
    normal[:OWN, :OWN] += np.diag(precision)
    right = one[:, :-1].T @ one[:, -1]
    right[:OWN] += precision * mean
    scale = np.sqrt(np.diag(normal))
    expected = np.linalg.solve(normal / np.outer(scale, scale), right / scale) / scale
    triangle = triangle_of(found.rows)[:REST]
    rest = damped_solution(triangle[:, :-1], triangle[:, -1], 0.0)
    assert rest == pytest.approx(expected[OWN:], rel=1e-7)
    assert found.step(rest) == pytest.approx(expected[:OWN], rel=1e-7)


@pytest.mark.parametrize("rows", [5, 255, 256, 512, 700])
def test_the_triangle_holds_all_that_the_rows_say(rows):
    whole = np.random.default_rng(rows).standard_normal((rows, 7))
    triangle = triangle_of(whole)
    assert triangle.shape == (min(rows, 7), 7)
    assert triangle.T @ triangle == pytest.approx(whole.T @ whole, rel=1e-9, abs=1e-9)
    assert np.tril(triangle, -1) == pytest.approx(np.zeros_like(triangle))


def test_damping_shortens_the_step_relative_to_the_columns():
    random = np.random.default_rng(1)
    rows = random.standard_normal((30, 3)) * [1e-4, 1.0, 1e5]
    target = random.standard_normal(30)
    norms = np.linalg.norm(rows, axis=0)
    lengths = [np.linalg.norm(damped_solution(rows, target, d) * norms) for d in (0.0, 0.1, 10.0, 1e4)]
    assert lengths == sorted(lengths, reverse=True)
    expected = np.linalg.solve(rows.T @ rows + 0.1 * np.diag(norms**2), rows.T @ target)
    assert damped_solution(rows, target, 0.1) == pytest.approx(expected, rel=1e-8)


def test_a_direction_that_is_not_told_has_a_huge_variance_and_the_others_theirs():
    random = np.random.default_rng(8)
    rows = random.standard_normal((30, 3))
    rows[:, 2] = 0.0
    triangle = np.linalg.qr(rows, mode="r")
    inverse = inverse_of(triangle)
    variance = np.diag(inverse @ inverse.T)
    assert variance[2] > 1e9
    assert variance[:2] == pytest.approx(np.diag(np.linalg.inv(rows[:, :2].T @ rows[:, :2])), rel=1e-9)
