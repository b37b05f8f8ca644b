"""The weights of all controllers, by one rule, and the numbers that the rule was given.

**The rule** (Bryson and Ho, Applied Optimal Control, 1975, section 5.2): each quantity is weighted by one
over the square of its acceptable deviation, so that all are counted in the same unit:

    J = Σ (e_y/0.25 m)² + (e_ψ/0.05 rad)² + (δ̇/0.1 rad/s)² + ((δ - δ_ref)/0.03 rad)² + ...

A controller that minimises a cost (LQR, MPC) takes these weights as they are. One that has gains instead
(PID, pure pursuit, Stanley) takes those that cost least by the same rule. Two MPCs accept less than others:

- on the kinematic model, which does not see the lag of the tyres and would swing, less of a heading error:
  the largest of a series by half powers of two with which it costs no more, on the tuning scenarios, than the
  MPC that knows the tyres
- with a limit of the steering's rate, less of that rate, a quarter of the limit: a plan that turns at the
  limit for long is lost where the steering answers 0.1 s later than believed

**The numbers.** A quarter of a metre and 0.05 rad (3°) are what a truck in a lane of 3.5 m has to spare. Of
the steering's deviations the largest were taken with which the LQR keeps a lane change of 3 m at 25 m/s
with 0.25 s more dead time than it knows of. The gains were searched in ``studies/controller_weights.py`` on
lane changes of 2 m at 15 m/s and of 3 m at 25 m/s, on trucks with and without mismatch: none of them is a
scenario of the validation. Its results lie beside it.
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
    "acceleration_request_rate": 2.0,  # [m/s³]
}

OF_LQR = ("lateral_error", "heading_error", "steering_rate", "steering_request")
"""What the LQR weighs: its speed is held beside it."""
OF_MPC = (
    *("lateral_error", "heading_error", "steering_rate", "steering_request_rate"),
    *("longitudinal_velocity", "time", "acceleration_request", "acceleration_request_rate"),
)
"""What a predictive controller weighs: how the steering request changes, not how far it is from a goal."""


def weight(acceptable: Mapping[str, float], name: str) -> float:
    """One over the square of the acceptable deviation; zero where there is none."""
    return 1.0 / acceptable[name] ** 2 if name in acceptable else 0.0


PID_GAINS: Mapping[str, float] = {
    "lead": 0.2,  # [s]
    "frequency": 1.3,  # [rad/s]
    "damping": 1.2,
    "look_ahead_time": 0.0,  # [s]
    "integral_time": 30.0,  # [s]
}
PURE_PURSUIT_GAINS: Mapping[str, float] = {
    "lead": 0.22,  # [s]
    "look_ahead_time": 0.87,  # [s]
    "shortest_look_ahead": 5.0,  # [m]
}
STANLEY_GAINS: Mapping[str, float] = {
    "lead": 0.19,  # [s]
    "error_gain": 0.29,  # [1/s]
    "softening_speed": 1.0,  # [m/s]
    "heading_gain": 0.81,
    "yaw_rate_gain": 0.09,  # [s]
}

KINEMATIC_HEADING = ACCEPTABLE["heading_error"] / 2.0**1.5  # [rad] acceptable, of the MPC without tyres
LIMITED_RATE = 0.05  # [rad/s] acceptable, of the request of the MPC that keeps a limit of 0.2 rad/s

WEIGHTS: Mapping[str, Mapping[str, float]] = {
    "pid": PID_GAINS,
    "pure_pursuit": PURE_PURSUIT_GAINS,
    "stanley": STANLEY_GAINS,
    "lqr": {name: ACCEPTABLE[name] for name in OF_LQR},
    "mpc_time_kinematic": {name: ACCEPTABLE[name] for name in OF_MPC} | {"heading_error": KINEMATIC_HEADING},
    "mpc_spatial_rate": {name: ACCEPTABLE[name] for name in OF_MPC} | {"steering_request_rate": LIMITED_RATE},
}


def weights_of(controller: str) -> dict[str, float]:
    """What a controller is made with: gains of its own, or those acceptable deviations that it weighs."""
    return dict(WEIGHTS.get(controller) or {name: ACCEPTABLE[name] for name in OF_MPC})
