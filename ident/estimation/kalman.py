"""Kalman filter and fixed-interval smoother of a linear system that changes with time, compiled.

    x_k = Φ_k x_(k-1) + d_k + w_k,  w_k ~ (0, Q_k)          y_k = C_k x_k + c_k + v_k,  v_k ~ (0, diag R_k)

Measurements are taken one number at a time, which is the same as all at once where their noise is
independent, and NaN is one that is missing. The smoother is that of Bryson and Frazier (Bierman 1973,
doi:10.1016/0005-1098(73)90104-3): it runs backwards through the innovations and gives the numbers of Rauch,
Tung and Striebel's without the inverse of a covariance, which is nearly singular where a state is driven
through others only.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinearSystem:
    """One uninterrupted record of n states, m outputs, at k instants.

    transition, drift : (k, n, n), (k, n) from the instant before; the first are not used
    driven : (k, n, n) Q for a driving noise of size one
    measuring, offset : (k, m, n), (k, m)
    noise : (m,) variances R; measured : (k, m), NaN where missing
    start, start_covariance : (n,), (n, n) before the first measurement
    """

    transition: Array
    drift: Array
    driven: Array
    measuring: Array
    offset: Array
    noise: Array
    measured: Array
    start: Array
    start_covariance: Array

    def __post_init__(self) -> None:
        for each in fields(self):
            value = np.require(getattr(self, each.name), dtype=np.float64, requirements=["C", "W"])
            object.__setattr__(self, each.name, value)


@dataclass(frozen=True)
class Filtered:
    """What the filter leaves for the smoother; (k, ...) after the measurements of each instant.

    gains : (k, m, n); innovations, variances : (k, m), NaN where nothing was measured
    """

    states: Array
    covariances: Array
    gains: Array
    innovations: Array
    variances: Array

    @property
    def log_likelihood(self) -> float:
        """Of all innovations."""
        seen = np.isfinite(self.innovations)
        own = self.variances[seen]
        return float(-0.5 * np.sum(np.log(2 * np.pi * own) + self.innovations[seen] ** 2 / own))


def filtered(system: LinearSystem, driving: float) -> Filtered:
    """Run the filter; ``driving`` is the variance by which Q is multiplied."""
    count, outputs = system.measured.shape
    states = system.start.size
    found = Filtered(
        np.empty((count, states)),
        np.empty((count, states, states)),
        np.zeros((count, outputs, states)),
        np.full((count, outputs), np.nan),
        np.full((count, outputs), np.nan),
    )
    _filter(
        system.transition,
        system.drift,
        system.driven,
        system.measuring,
        system.offset,
        system.noise,
        system.measured,
        system.start,
        system.start_covariance,
        driving,
        found.states,
        found.covariances,
        found.gains,
        found.innovations,
        found.variances,
    )
    return found


def smoothed(system: LinearSystem, found: Filtered) -> tuple[Array, Array]:
    """States (k, n) and their covariances (k, n, n), given all measurements, before and after."""
    states, covariances = np.empty_like(found.states), np.empty_like(found.covariances)
    _smooth(
        system.transition,
        system.measuring,
        found.states,
        found.covariances,
        found.gains,
        found.innovations,
        found.variances,
        states,
        covariances,
    )
    return states, covariances


@numba.njit(
    "void(float64[::1], float64[:,::1], float64[:,::1], float64[::1], float64[:,::1], float64)",
    cache=True,
    error_model="numpy",
)
def _ahead(x: Array, p: Array, transition: Array, drift: Array, driven: Array, driving: float) -> None:
    """Move state and covariance to the next instant, in place."""
    n = x.size
    moved, half = drift.copy(), np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            moved[i] += transition[i, j] * x[j]
            for a in range(n):
                half[i, j] += transition[i, a] * p[a, j]
    for i in range(n):
        x[i] = moved[i]
        for j in range(i + 1):
            value = driving * driven[i, j]
            for a in range(n):
                value += half[i, a] * transition[j, a]
            p[i, j] = value
            p[j, i] = value


@numba.njit(
    "UniTuple(float64, 2)(float64[::1], float64[:,::1], float64[::1], float64, float64, float64[::1])",
    cache=True,
    error_model="numpy",
)
def _taken(x: Array, p: Array, row: Array, value: float, noise: float, gain: Array) -> tuple[float, float]:
    """Take one measured number into state and covariance, in place: innovation and its variance."""
    n = x.size
    turned = np.zeros(n)
    innovation, variance = value, noise
    for i in range(n):
        innovation -= row[i] * x[i]
        for j in range(n):
            turned[i] += p[i, j] * row[j]
        variance += row[i] * turned[i]
    for i in range(n):
        gain[i] = turned[i] / variance
        x[i] += gain[i] * innovation
        for j in range(n):
            p[i, j] -= turned[i] * turned[j] / variance
    return innovation, variance


@numba.njit(
    "void(float64[:,:,::1], float64[:,::1], float64[:,:,::1], float64[:,:,::1], float64[:,::1], float64[::1],"
    " float64[:,::1], float64[::1], float64[:,::1], float64, float64[:,::1], float64[:,:,::1],"
    " float64[:,:,::1], float64[:,::1], float64[:,::1])",
    cache=True,
    error_model="numpy",
)
def _filter(
    transition: Array,
    drift: Array,
    driven: Array,
    measuring: Array,
    offset: Array,
    noise: Array,
    measured: Array,
    start: Array,
    start_covariance: Array,
    driving: float,
    states: Array,
    covariances: Array,
    gains: Array,
    innovations: Array,
    variances: Array,
) -> None:
    x, p = start.copy(), start_covariance.copy()
    for k in range(measured.shape[0]):
        if k > 0:
            _ahead(x, p, transition[k], drift[k], driven[k], driving)
        for m in range(noise.size):
            if not np.isnan(measured[k, m]):
                value = measured[k, m] - offset[k, m]
                innovations[k, m], variances[k, m] = _taken(
                    x, p, measuring[k, m], value, noise[m], gains[k, m]
                )
        states[k] = x
        covariances[k] = p


@numba.njit(
    "void(float64[::1], float64[:,::1], float64[:,::1])",
    cache=True,
    error_model="numpy",
)
def _back(pull: Array, grip: Array, through: Array) -> None:
    """Pull and grip of what comes later, moved back through a linear step: T' λ and T' Λ T, in place."""
    n = pull.size
    moved, half = np.zeros(n), np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            moved[i] += through[j, i] * pull[j]
            for a in range(n):
                half[i, j] += grip[i, a] * through[a, j]
    for i in range(n):
        pull[i] = moved[i]
        for j in range(n):
            value = 0.0
            for a in range(n):
                value += through[a, i] * half[a, j]
            grip[i, j] = value


@numba.njit(
    "void(float64[::1], float64[:,::1], float64[:,::1], float64[::1], float64[:,::1])",
    cache=True,
    error_model="numpy",
)
def _back_out(pull: Array, grip: Array, own: Array, state: Array, covariance: Array) -> None:
    """Let what comes later correct a state and its covariance: x - P λ and P - P Λ P, in place."""
    n = pull.size
    half = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            state[i] -= own[i, j] * pull[j]
            for a in range(n):
                half[i, j] += grip[i, a] * own[a, j]
    for i in range(n):
        for j in range(n):
            for a in range(n):
                covariance[i, j] -= own[i, a] * half[a, j]


@numba.njit(
    "void(float64[:,:,::1], float64[:,:,::1], float64[:,::1], float64[:,:,::1], float64[:,:,::1],"
    " float64[:,::1], float64[:,::1], float64[:,::1], float64[:,:,::1])",
    cache=True,
    error_model="numpy",
)
def _smooth(
    transition: Array,
    measuring: Array,
    states: Array,
    covariances: Array,
    gains: Array,
    innovations: Array,
    variances: Array,
    states_after: Array,
    covariances_after: Array,
) -> None:
    n = states.shape[1]
    pull, grip = np.zeros(n), np.zeros((n, n))
    for k in range(states.shape[0] - 1, -1, -1):
        own = covariances[k]
        states_after[k] = states[k]
        covariances_after[k] = own
        _back_out(pull, grip, own, states_after[k], covariances_after[k])
        for m in range(innovations.shape[1] - 1, -1, -1):
            if np.isnan(innovations[k, m]):
                continue
            row, gain = measuring[k, m], gains[k, m]
            kept = np.empty((n, n))
            for i in range(n):
                for j in range(n):
                    kept[i, j] = (1.0 if i == j else 0.0) - gain[i] * row[j]
            _back(pull, grip, kept)
            for i in range(n):
                pull[i] -= row[i] * innovations[k, m] / variances[k, m]
                for j in range(n):
                    grip[i, j] += row[i] * row[j] / variances[k, m]
        _back(pull, grip, transition[k])
