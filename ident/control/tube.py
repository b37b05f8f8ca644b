"""A set that the error of a disturbed linear system never leaves, and by how much it tightens limits.

    e⁺ = A_K e + w,  |w_i| <= w̄_i:   F(α, s) = (1 - α)⁻¹ ⊕_(i<s) A_K^i W,  where A_K^s W ⊆ α W

F is robust positively invariant: A_K F ⊕ W ⊆ F, and at most α/(1 - α) larger than the smallest such set
(Raković, Kerrigan, Kouramas and Mayne, IEEE TAC 50, 2005, theorem 1). W is a box, so F is a zonotope, and how
far it reaches along any direction is a sum: no vertices are ever counted. A limit η'x <= b that holds for the
nominal system with b - h_F(η) holds for every disturbed one (Mayne, Seron and Raković, Automatica 41, 2005).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.control.linear import spectral_radius
from ident.model_file import SignalNoise

Array = NDArray[np.float64]

ALPHA = 0.05  # the set is at most this much larger than the smallest, give or take
MOST_POWERS = 2000
WIDENED = 1e-3  # of what a state can reach, by which W is widened where no disturbance enters
SIGMAS = 3.0  # of the residuals, taken as their bound


@dataclass(frozen=True)
class Tube:
    """{Σ_j g_j ξ_j : |ξ_j| <= 1}, a zonotope about zero.

    generators : (m, n) its g_j
    """

    generators: Array

    def reach(self, directions: Array) -> Array:
        """(d,) largest value of each direction (d, n) over the set, its support function."""
        found: Array = np.abs(directions @ self.generators.T).sum(axis=1)
        return found

    @property
    def box(self) -> Array:
        """(n,) half widths of the smallest box about the set."""
        found: Array = np.abs(self.generators).sum(axis=0)
        return found


def invariant_tube(closed: Array, bounds: Array) -> Tube:
    """A set that e⁺ = A_K e + w does not leave.

    Parameters
    ----------
    closed : (n, n) A_K
    bounds : (n,) w̄, not negative, in the units of the states, of one step

    Raises
    ------
    ValueError
        If A_K is not stable: then there is no such set.
    """
    if (radius := spectral_radius(closed)) >= 1.0:
        raise ValueError(f"the closed loop has an eigenvalue of size {radius:.4f}, need below 1")
    bounds = _widened(closed, np.asarray(bounds, dtype=np.float64))
    powers, power = [], np.eye(closed.shape[0])
    for _ in range(MOST_POWERS):
        powers.append(power)
        power = power @ closed
        shrunk = np.abs(power) @ bounds
        if np.all(shrunk <= ALPHA * bounds):
            break
    alpha = float(np.max(shrunk / np.maximum(bounds, np.finfo(float).tiny)))
    if alpha >= 1.0:
        raise ValueError(
            f"after {MOST_POWERS} steps a disturbance has not died out ({alpha:.2f} of it is left)"
        )
    generators = np.concatenate([(power * bounds).T for power in powers]) / (1.0 - alpha)
    return Tube(generators)


def _widened(closed: Array, bounds: Array) -> Array:
    """Bounds with a little in every state that a disturbance comes to, so that W is a set with an inside."""
    size = bounds.size
    reached, power = np.zeros(size), np.eye(size)
    for _ in range(MOST_POWERS):
        step = np.abs(power) @ bounds
        reached += step
        if np.all(step <= WIDENED * reached):
            break
        power = power @ closed
    return np.maximum(bounds, WIDENED * reached)


def bounds_of_residuals(noise: Mapping[str, SignalNoise], period: float) -> dict[str, float]:
    """What the residuals of a fitted model say of the error of one period's prediction, by state.

    Parameters
    ----------
    noise : signal -> its identified noise, as in ``model.yaml``
    period : of the controller [s]

    Returns
    -------
    state -> bound of its disturbance in one period, in the state's unit: ``SIGMAS`` times the innovations
    that add up in a period; a residual of the lateral acceleration is one of the lateral velocity's rate.
    States of signals without an identified noise are not in it.

    Notes
    -----
    The residuals hold the noise of the sensors too, so the bound is on the safe side.
    """
    signals = {
        "yaw_rate": "yaw_rate",
        "lateral_velocity": "lateral_velocity",
        "heading_error": "heading",
        "steering_angle": "steering_wheel_angle",
    }
    found = {s: _within(noise[name], period) for s, name in signals.items() if name in noise}
    if "lateral_velocity" not in found and "lateral_acceleration" in noise:
        found["lateral_velocity"] = SIGMAS * noise["lateral_acceleration"].std * period
    return found


def _within(noise: SignalNoise, period: float) -> float:
    """Innovations of one period, independent from sample to sample."""
    samples = period / noise.sample_period if noise.sample_period else 1.0
    return SIGMAS * noise.std * float(np.sqrt(max(samples, 1.0)))
