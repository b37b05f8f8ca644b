"""The course that a truck can follow along a reference: what its lags make of steady cornering.

The reference holds steady cornering at every point; where the curvature changes, no truck is in it. With the
reference's change over a period T as a known disturbance, the deviation from it obeys

    x̃_(k+1) = A x̃_k + B ũ_k - Γ (x_ref,k+1 - x_ref,k)/T,      Γ = ∫ exp(A t) dt

and the course is the optimal one of a regulator to which steering is cheap, which knows what lies ahead:

    ũ_k = -K x̃_k - Σ_j G_j (x_ref,k+j+1 - x_ref,k+j)/T,   G_j = -(R + BᵀPB)⁻¹ Bᵀ ((A - B K)ᵀ)ʲ P Γ

(Bitmead, Gevers and Wertz, Adaptive Optimal Control, 1990, chapter 2, LQ tracking). It is computed once for a
reference. A feedback that holds the truck on this course has nothing to do where the model is right, whatever
its own weights are, and so need not be strong to follow curves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.targets import Targets
from ident.control.linear import Schedule, held_step, regulator

Array = NDArray[np.float64]

PREVIEW = 3.0  # [s] beyond which what lies ahead does not matter yet
LONGEST = 20000  # periods that a course may last


@dataclass(frozen=True)
class Regulator:
    """A regulator and its model at one speed, or scheduled by it.

    A : (n, n); B : (n,) of one period; push : (n, n) Γ/T
    state : (n,) K; ahead : (m, n) G
    """

    A: Array
    B: Array
    push: Array
    state: Array
    ahead: Array


@dataclass(frozen=True)
class Course:
    """Deviation from the reference by arc length: (k,), (k, n) of the states, (k,) of the request [rad]."""

    arc_length: Array
    states: Array
    request: Array

    def at(self, arc_length: float) -> tuple[Array, float]:
        """Deviation of the states (n,) and of the request at one arc length [m]."""
        s = self.arc_length
        k = min(max(int(np.searchsorted(s, arc_length, side="right")) - 1, 0), s.size - 2)
        share = min(max((arc_length - s[k]) / (s[k + 1] - s[k]), 0.0), 1.0)
        states: Array = (1.0 - share) * self.states[k] + share * self.states[k + 1]
        return states, float((1.0 - share) * self.request[k] + share * self.request[k + 1])


def regulator_at(A: Array, B: Array, Q: Array, R: float, period: float) -> Regulator:
    """The regulator of x' = A x + B u at one speed.

    A : (n, n); B : (n, 1); Q : (n, n) and R : weights a period
    """
    size = A.shape[0]
    both = np.hstack([B, np.eye(size)])
    (Ad,), (driven,), _ = held_step(A[None], both[None], np.zeros((1, size)), np.array([period]))
    Bd, push = driven[:, :1], driven[:, 1:] / period
    K, P = regulator(Ad, Bd, Q, np.array([[R]]))
    row = np.linalg.solve(R + Bd.T @ P @ Bd, Bd.T)
    closed, costate, ahead = (Ad - Bd @ K).T, P @ push, []
    for _ in range(round(PREVIEW / period)):
        ahead.append(-(row @ costate)[0])
        costate = closed @ costate
    return Regulator(Ad, Bd[:, 0], push, K[0], np.array(ahead))


class Scheduled:
    """Regulators at rising, evenly spaced speeds."""

    def __init__(self, speeds: Array, regulators: list[Regulator]) -> None:
        self._schedules = {
            name: Schedule(speeds, np.array([getattr(one, name) for one in regulators]))
            for name in ("A", "B", "push", "state", "ahead")
        }

    def at(self, speed: float) -> Regulator:
        """All of it at one speed [m/s]."""
        return Regulator(**{name: schedule.at(speed) for name, schedule in self._schedules.items()})

    def gain(self, speed: float) -> Array:
        """K (n,) at one speed."""
        return self._schedules["state"].at(speed)


def course_along(
    targets: Targets, places: list[int], disturbances: int, regulators: Scheduled, period: float
) -> Course:
    """What a truck can follow of a reference.

    places : of the states that it is told of; disturbances : how many the model has
    """
    arc_length, speed = _places_each_period(targets, period)
    goals = targets.at(arc_length, np.zeros(disturbances))
    changes = np.diff(goals.states[:, places], axis=0)
    turning = np.zeros(arc_length.size)
    turning[:-1] = np.diff(goals.controls[:, 0]) / 2
    states, request = np.zeros((arc_length.size, len(places))), np.zeros(arc_length.size)
    last: tuple[float, Regulator] | None = None
    for k in range(arc_length.size - 1):
        if last is None or abs(speed[k] - last[0]) > 0.1:
            last = speed[k], regulators.at(speed[k])
        law = last[1]
        coming = changes[k : k + law.ahead.shape[0]]
        steering = -law.state @ states[k] - np.sum(law.ahead[: coming.shape[0]] * coming)
        states[k + 1] = law.A @ states[k] + law.B * steering - law.push @ changes[k]
        request[k] = steering + turning[k]
    return Course(arc_length, states, request)


def _places_each_period(targets: Targets, period: float) -> tuple[Array, Array]:
    """Arc length [m] and speed [m/s] of the reference, period after period to its end."""
    reference = targets.reference
    count = min(int((reference.time[-1] - reference.time[0]) / period) + 2, LONGEST)
    arc_length = targets.arc_length(reference.time[0] + period * np.arange(count))
    return arc_length, targets.speed(arc_length)
