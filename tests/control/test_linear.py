"""Exact steps and Riccati gains against scipy and against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from ident.control.linear import Schedule, held_step, held_step_once, observer, regulator, spectral_radius


def random_model(seed, size=6, inputs=2, scale=3.0):
    random = np.random.default_rng(seed)
    return scale * random.normal(size=(size, size)), random.normal(size=(size, inputs))


@pytest.mark.parametrize("step", [1e-4, 0.05, 1.0])
def test_a_held_step_is_the_exponential_of_the_joint_matrix(step):
    A, B = random_model(1)
    g = np.arange(6.0)
    joint = np.zeros((9, 9))
    joint[:6, :6], joint[:6, 6:8], joint[:6, 8] = A, B, g
    exact = expm(joint * step)
    (Ad,), (Bd,), (cd,) = held_step(A[None], B[None], g[None], np.array([step]))
    size = np.abs(exact).max()
    np.testing.assert_allclose(Ad, exact[:6, :6], atol=1e-12 * size)
    np.testing.assert_allclose(Bd, exact[:6, 6:8], atol=1e-12 * size)
    np.testing.assert_allclose(cd, exact[:6, 8], atol=1e-12 * size)


def test_a_stiff_and_a_singular_model_are_stepped_exactly_too():
    A = np.array([[-2000.0, 1000.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    Ad, Bd = held_step_once(A, np.array([[0.0], [0.0], [1.0]]), 0.05)
    np.testing.assert_allclose(Ad, expm(A * 0.05), atol=1e-12)
    assert Bd[1, 0] == pytest.approx(0.05**2 / 2, rel=1e-12)


def test_each_stage_has_its_own_step():
    A, B = random_model(2)
    steps = np.array([0.01, 0.2])
    both, _, _ = held_step(np.stack([A, A]), np.stack([B, B]), np.zeros((2, 6)), steps)
    for k, step in enumerate(steps):
        np.testing.assert_allclose(both[k], expm(A * step), rtol=1e-10, atol=1e-12)


def test_the_regulator_of_a_scalar_is_that_of_the_book():
    # p = a² p - (a b p)²/(r + b² p) + q with a = b = q = r = 1 is the golden ratio.
    K, P = regulator(*(np.ones((1, 1)) for _ in range(4)))
    golden = (1 + 5**0.5) / 2
    assert P[0, 0] == pytest.approx(golden, rel=1e-12)
    assert K[0, 0] == pytest.approx(golden / (1 + golden), rel=1e-12)


def test_no_other_gain_costs_less_than_that_of_the_regulator():
    A, B = random_model(3, size=3, inputs=1, scale=0.7)
    Q, R = np.diag([1.0, 2.0, 0.5]), np.array([[0.3]])
    K, P = regulator(A, B, Q, R)

    def cost(gain, x):
        total = 0.0
        for _ in range(400):
            u = -gain @ x
            total += x @ Q @ x + u @ R @ u
            x = A @ x + B @ u
        return total

    start = np.array([1.0, -1.0, 0.5])
    assert cost(K, start) == pytest.approx(start @ P @ start, rel=1e-9)
    random = np.random.default_rng(4)
    others = [cost(K + 0.02 * random.normal(size=K.shape), start) for _ in range(10)]
    assert min(others) > cost(K, start)


def test_the_observer_is_what_the_riccati_recursion_comes_to():
    A, _ = random_model(5, size=4, scale=0.4)
    C = np.eye(2, 4)
    Q, R = np.diag([1.0, 2.0, 3.0, 0.1]), np.diag([0.5, 2.0])
    P = np.eye(4)
    for _ in range(2000):
        gain = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        P = A @ (P - gain @ C @ P) @ A.T + Q
    np.testing.assert_allclose(observer(A, C, Q, R), gain, rtol=1e-8, atol=1e-10)


def test_a_schedule_is_linear_between_its_speeds_and_held_beyond():
    schedule = Schedule(np.array([1.0, 3.0, 5.0]), np.array([[0.0, 1.0], [2.0, 1.0], [10.0, 0.0]]))
    np.testing.assert_allclose(schedule.at(2.0), [1.0, 1.0])
    np.testing.assert_allclose(schedule.at(4.5), [8.0, 0.25])
    np.testing.assert_allclose(schedule.at(0.0), [0.0, 1.0])
    np.testing.assert_allclose(schedule.at(99.0), [10.0, 0.0])


def test_the_spectral_radius_counts_complex_eigenvalues_by_magnitude():
    assert spectral_radius(np.array([[0.0, -3.0], [3.0, 0.0]])) == pytest.approx(3.0)
