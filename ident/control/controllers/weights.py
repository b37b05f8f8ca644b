"""The weights of all controllers, by one rule, and the numbers that the rule was given.

**The rule** (Bryson and Ho, Applied Optimal Control, 1975, section 5.2): each quantity is weighted by one
over the square of its acceptable deviation, so that all are counted in the same unit:

    J = Σ (e_y/0.25 m)² + (e_ψ/0.05 rad)² + (δ̇/0.1 rad/s)² + ((δ - δ_ref)/0.03 rad)² + ...

A controller that minimises a cost (LQR, MPC) takes these weights as they are. One that has gains instead
(PID, pure pursuit, Stanley) takes those that minimise the same cost.
"""

from __future__ import annotations

from collections.abc import Mapping

# Acceptable deviations; steering in units of the road wheels.
ACCEPTABLE: Mapping[str, float] = {
    "lateral_error": 0.25,  # [m]
    "heading_error": 0.05,  # [rad]
    "steering_rate": 0.1,  # [rad/s]
    "steering_request": 0.03,  # [rad] from that of the reference
    "steering_request_rate": 0.2,  # [rad/s]
    "longitudinal_velocity": 1.0,  # [m/s]
    "time": 0.5,  # [s]
    "acceleration_request": 1.0,  # [m/s²]
}


def weight(acceptable: Mapping[str, float], name: str) -> float:
    """One over the square of the acceptable deviation; zero where there is none."""
    return 1.0 / acceptable[name] ** 2 if name in acceptable else 0.0


PID_GAINS: Mapping[str, float] = {
    "lead": 0.2,  # [s]
    "frequency": 1.3,
    "damping": 2.0,
    "look_ahead_time": 0.0,
    "integral_time": 8.0,
}
PURE_PURSUIT_GAINS: Mapping[str, float] = {"look_ahead_time": 0.65, "shortest_look_ahead": 5.0, "lead": 0.2}
STANLEY_GAINS: Mapping[str, float] = {
    "lead": 0.2,  # [s]
    "error_gain": 0.8,
    "softening_speed": 1.0,
    "heading_gain": 0.5,
    "yaw_rate_gain": 0.1,
}
