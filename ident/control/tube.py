"""A set that the error of a disturbed linear system never leaves, and by how much it tightens limits.

    e⁺ = A_K e + w,  |w_i| <= w̄_i:   F(α, s) = (1 - α)⁻¹ ⊕_(i<s) A_K^i W,  where A_K^s W ⊆ α W

F is robust positively invariant: A_K F ⊕ W ⊆ F, and at most α/(1 - α) larger than the smallest such set
(Raković, Kerrigan, Kouramas and Mayne, IEEE TAC 50, 2005, theorem 1). W is a box, so F is a zonotope, and how
far it reaches along any direction is a sum: no vertices are ever counted. A limit η'x <= b that holds for the
nominal system with b - h_F(η) holds for every disturbed one (Mayne, Seron and Raković, Automatica 41, 2005).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.control.linear import spectral_radius

Array = NDArray[np.float64]

ALPHA = 0.05  # the set is at most this much larger than the smallest, give or take
MOST_POWERS = 2000
WIDENED = 1e-3  # of what a state can reach, by which W is widened where no disturbance enters
SIGMAS = 3.0  # of the residuals, taken as their bound
RESIDUAL_OF = {
    "lateral_velocity": ("lateral_velocity",),
    "yaw_rate": ("yaw_rate",),
    "lateral_error": ("position_across", "position_y"),
    "heading_error": ("heading",),
    "steering_angle": ("steering_wheel_angle", "road_wheel_angle"),
}
"""State -> signals of a log whose residual is that of the state's sensor; the first that is known counts."""


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


def bounds_of_corrections(noise: Mapping[str, float], names: Sequence[str], gain: Array) -> dict[str, float]:
    """Bound the error of one period's prediction by what an estimator corrects, by state.

        w_i = (L ν)_i,   w̄_i = SIGMAS (Σ_j (L_ij σ_j)²)^½

    with ν what was measured less what was predicted, and σ its size by the residuals of the identified model:
    noise of the sensors, and what the model misses while they are listened to.

    Parameters
    ----------
    noise : signal of a log -> σ, in its SI unit
    names : of the states, in the order of ``gain``; each is measured
    gain : (n, n) L of the states

    Returns
    -------
    state -> bound, of the states of which σ is known
    """
    sizes = np.array([next((noise[o] for o in RESIDUAL_OF.get(n, ()) if o in noise), 0.0) for n in names])
    found = SIGMAS * np.sqrt(np.sum((gain * sizes) ** 2, axis=1))
    return {name: float(bound) for name, bound, size in zip(names, found, sizes, strict=True) if size > 0}
