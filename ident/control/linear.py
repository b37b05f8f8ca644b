r"""Exact discretisation of linear models with held inputs, and gains from the algebraic Riccati equation.

.. math:: \dot x = A x + B u + g: \quad
    A_d = e^{A h}, \quad B_d = \Gamma B, \quad c_d = \Gamma g, \quad \Gamma = \int_0^h e^{A t} dt

Γ and the exponential come from one Taylor series with scaling and doubling:
Γ(2h) = (I + e^{Ah}) Γ(h), e^{2Ah} = e^{Ah} e^{Ah} (Higham, Functions of Matrices, 2008, section 10.7).
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

Array = NDArray[np.float64]

TERMS = 14  # of the Taylor series; with |A h| <= HALF the rest is below 1e-16
HALF = 0.5


@numba.njit("void(float64[:, ::1], float64[:, ::1], float64[:, ::1])", cache=True, error_model="numpy")
def _product(a: Array, b: Array, out: Array) -> None:
    """Fill ``out`` with a b, of square matrices with many zeros."""
    n = a.shape[0]
    out[:] = 0.0
    for i in range(n):
        for k in range(n):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(n):
                    out[i, j] += factor * b[k, j]


@numba.njit("float64(float64[:, ::1])", cache=True, error_model="numpy")
def _norm(a: Array) -> float:
    """Largest sum of magnitudes of a row."""
    largest = 0.0
    for i in range(a.shape[0]):
        row = 0.0
        for j in range(a.shape[1]):
            row += abs(a[i, j])
        largest = max(largest, row)
    return largest


@numba.njit(
    "void(float64[:, ::1], float64, float64[:, ::1], float64[:, ::1])", cache=True, error_model="numpy"
)
def _series(a: Array, h: float, power: Array, integral: Array) -> None:
    """Fill exp(a h) and its integral over the step from their Taylor series; |a h| is small."""
    n = a.shape[0]
    term, work = np.eye(n), np.empty((n, n))
    power[:] = term
    integral[:] = h * term
    for order in range(1, TERMS + 1):
        _product(term, a, work)
        for i in range(n):
            for j in range(n):
                term[i, j] = work[i, j] * h / order
                power[i, j] += term[i, j]
                integral[i, j] += term[i, j] * h / (order + 1)


@numba.njit(
    "void(float64[:, :, ::1], float64[::1], float64[:, :, ::1], float64[:, :, ::1])",
    cache=True,
    error_model="numpy",
)
def _exponentials(matrices: Array, steps: Array, powers: Array, integrals: Array) -> None:
    """Fill exp(A h) and its integral for every stage."""
    n = matrices.shape[1]
    work = np.empty((n, n))
    for stage in range(matrices.shape[0]):
        power, integral, h = powers[stage], integrals[stage], steps[stage]
        norm, doublings = _norm(matrices[stage]), 0
        while norm * abs(h) > HALF and doublings < 60:
            h *= 0.5
            doublings += 1
        _series(matrices[stage], h, power, integral)
        for _ in range(doublings):
            _product(power, integral, work)
            integral += work
            _product(power, power, work)
            power[:] = work


def held_step(A: Array, B: Array, g: Array, steps: Array) -> tuple[Array, Array, Array]:
    """x(h) = A_d x + B_d u + c_d of x' = A x + B u + g with u and g held over the step.

    Parameters
    ----------
    A : (N, nx, nx); B : (N, nx, nu); g : (N, nx); steps : (N,)

    Returns
    -------
    A_d : (N, nx, nx); B_d : (N, nx, nu); c_d : (N, nx)
    """
    powers, integrals = np.empty_like(A), np.empty_like(A)
    _exponentials(np.ascontiguousarray(A), np.ascontiguousarray(steps, dtype=np.float64), powers, integrals)
    with np.errstate(all="ignore"):  # what blows up is not finite, which no program is made from
        driven: Array = np.matmul(integrals, B)
        pushed: Array = np.matmul(integrals, g[:, :, None])[:, :, 0]
    return powers, driven, pushed


def held_step_once(A: Array, B: Array, step: float) -> tuple[Array, Array]:
    """A_d (nx, nx) and B_d (nx, nu) of one model."""
    powers, inputs, _ = held_step(A[None], B[None], np.zeros((1, A.shape[0])), np.array([step]))
    return powers[0], inputs[0]


def regulator(A: Array, B: Array, Q: Array, R: Array) -> tuple[Array, Array]:
    """Gain K of u = -K x and the cost P of the infinite horizon, x_(k+1) = A x + B u.

    A : (nx, nx); B : (nx, nu); Q : (nx, nx); R : (nu, nu) -> K (nu, nx), P (nx, nx)

    Raises
    ------
    numpy.linalg.LinAlgError
        If the pair is not stabilisable.
    """
    P: Array = np.asarray(solve_discrete_are(A, B, Q, R), dtype=np.float64)
    gain: Array = np.asarray(np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A), dtype=np.float64)
    return gain, P


def observer(A: Array, C: Array, process: Array, measurement: Array) -> Array:
    """Gain L of the stationary Kalman filter, x += L (y - C x) after the measurement y: (nx, ny).

    A : (nx, nx); C : (ny, nx); process : (nx, nx) covariance a step; measurement : (ny, ny)
    """
    P: Array = np.asarray(solve_discrete_are(A.T, C.T, process, measurement), dtype=np.float64)
    gain = np.linalg.solve(C @ P @ C.T + measurement, C @ P)
    return np.ascontiguousarray(gain.T, dtype=np.float64)


def spectral_radius(A: Array) -> float:
    """Largest magnitude of an eigenvalue."""
    return float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0))


class Schedule:
    """A matrix that depends on speed: linear between the speeds it was made for, held beyond them.

    speeds : (m,) rising, evenly spaced [m/s]; values : (m, ...)
    """

    def __init__(self, speeds: Array, values: Array) -> None:
        self._first, self._step = float(speeds[0]), float(speeds[1] - speeds[0])
        self._values = np.asarray(values, dtype=np.float64)

    def at(self, speed: float) -> Array:
        """Value at a speed [m/s]."""
        last = self._values.shape[0] - 1
        place = min(max((speed - self._first) / self._step, 0.0), float(last))
        before = min(math.floor(place), last - 1)
        share = place - before
        value: Array = (1.0 - share) * self._values[before] + share * self._values[before + 1]
        return value
