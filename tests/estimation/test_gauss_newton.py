"""Damped Gauss-Newton on problems with known minima."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from ident.estimation.gauss_newton import minimise

WIDE = np.array([[-np.inf, np.inf]] * 2)


@dataclass(frozen=True)
class Curve:
    """Residuals r(x) = target - f(x) of two parameters."""

    kind: str
    shared: np.ndarray
    bounds: np.ndarray
    std: float = 1.0

    def residual(self):
        a, b = self.shared
        if self.kind == "rosenbrock":
            return np.array([10 * (a**2 - b), a - 1.0])
        if self.kind == "blows up":
            return np.array([np.inf, np.inf]) if a > 3 else np.array([np.exp(a) - 2.0, b - 1.0])
        return np.array([3.0 - a - 2 * b, 1.0 - a + b, 0.5 - b])

    def jacobian(self):
        a, _ = self.shared
        if self.kind == "rosenbrock":
            return np.array([[20 * a, -10.0], [1.0, 0.0]])
        if self.kind == "blows up":
            return np.array([[np.exp(a), 0.0], [0.0, 1.0]])
        return np.array([[-1.0, -2.0], [-1.0, 1.0], [0.0, -1.0]])

    @property
    def value(self):
        total = float(self.residual() @ self.residual())
        return total if np.isfinite(total) else np.inf

    @property
    def smooth(self):
        return bool(np.isfinite(self.jacobian()).all())

    def triangle(self):
        return np.linalg.qr(np.column_stack([-self.jacobian(), self.residual()]), mode="r")

    def moved(self, step):
        return Curve(self.kind, self.shared + step, self.bounds)

    def inside(self, shared):
        return np.clip(shared, self.bounds[:, 0], self.bounds[:, 1])


def test_a_linear_problem_needs_one_step_to_its_minimum():
    start = Curve("linear", np.array([50.0, -20.0]), WIDE)
    expected = np.linalg.lstsq(-start.jacobian(), start.residual(), rcond=None)[0] + start.shared
    after_one, _, _ = minimise(start, 1)
    assert after_one.shared == pytest.approx(expected, rel=1e-10)
    end, triangle, converged = minimise(start)
    assert converged
    assert end.shared == pytest.approx(expected, rel=1e-10)
    assert triangle.T @ triangle == pytest.approx(start.jacobian().T @ start.jacobian(), rel=1e-10)


@pytest.mark.parametrize("start", [(-1.2, 1.0), (5.0, -3.0), (0.0, 0.0)])
def test_a_bent_valley_is_followed_to_its_end(start):
    end, _, converged = minimise(Curve("rosenbrock", np.array(start), WIDE), 100, negligible=1e-10)
    assert converged
    assert end.shared == pytest.approx([1.0, 1.0], abs=1e-4)


def test_a_step_into_where_the_model_blows_up_is_shortened():
    end, _, converged = minimise(Curve("blows up", np.array([-3.0, 0.0]), WIDE))
    assert converged
    assert end.shared == pytest.approx([np.log(2.0), 1.0], abs=1e-4)


def test_at_a_bound_the_other_parameter_takes_the_best_that_is_left():
    bounds = np.array([[-np.inf, 0.7], [-np.inf, np.inf]])
    end, _, converged = minimise(Curve("linear", np.array([0.0, 0.0]), bounds))
    one = Curve("linear", np.array([0.7, 0.0]), bounds)
    column = -one.jacobian()[:, 1]
    best = column @ one.residual() / (column @ column)
    assert converged
    assert end.shared == pytest.approx([0.7, best], rel=1e-9)


def test_no_step_ever_makes_it_worse():
    point = Curve("rosenbrock", np.array([-1.2, 1.0]), WIDE)
    values = [point.value]
    for _ in range(15):
        point, _, _ = minimise(point, 1)
        values.append(point.value)
    assert all(after <= before * (1 + 1e-9) for before, after in pairwise(values))


def test_too_few_iterations_are_not_called_converged():
    _, _, converged = minimise(Curve("rosenbrock", np.array([-1.2, 1.0]), WIDE), 3)
    assert not converged


def test_two_bounds_that_pull_against_each_other_leave_the_best_point_between_them():
    bounds = np.array([[-10.0, 0.2], [-0.5, 0.4]])
    end, _, converged = minimise(Curve("linear", np.array([0.0, 0.0]), bounds))
    grid = np.meshgrid(np.linspace(-1.0, 0.2, 601), np.linspace(-0.5, 0.4, 451))
    values = [Curve("linear", np.array(at), bounds).value for at in zip(*map(np.ravel, grid), strict=True)]
    assert converged
    assert end.value <= min(values) + 1e-12


def test_where_no_step_promises_anything_none_is_tried():
    end, _, _ = minimise(Curve("linear", np.array([5.0, 5.0]), WIDE))
    moved = []

    class Watched(Curve):
        def moved(self, step):
            moved.append(step)
            return super().moved(step)

    again, _, converged = minimise(Watched("linear", end.shared, WIDE))
    assert converged
    assert moved == []
    assert again.shared is end.shared
