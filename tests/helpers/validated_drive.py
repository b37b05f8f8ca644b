"""Closed loops of a truck that shares nothing with ident: what the case of a validation is made of.

The truck is a kinematic bicycle behind a first-order steering lag; each "controller" is the same proportional
law on the path a while ahead, with gains of its own.
"""

import math

import numpy as np
import pandas as pd

from ident.results.validate import ClosedLoopRun

PERIOD, WHEELBASE, LANE = 0.05, 4.5, 1.0
LAWS = {
    "pid": (0.010, 0.30, 0.4),
    "pure_pursuit": (0.020, 0.60, 0.8),
    "stanley": (0.022, 0.50, 0.6),
    "lqr": (0.030, 0.90, 0.5),
    "mpc_time_kinematic": (0.026, 0.80, 0.5),
    "mpc_time": (0.032, 0.95, 0.5),
    "mpc_spatial": (0.034, 1.00, 0.5),
    "mpc_spatial_rate": (0.031, 0.98, 0.5),
    "mpc_robust": (0.024, 0.90, 0.6),
}
"""Controller -> gain on the lateral error [rad/m], on the heading error [-], how far it looks ahead [s]."""
STEP_TIMES = dict(zip(LAWS, (4e-5, 6e-5, 5e-5, 9e-5, 2.1e-3, 2.4e-3, 2.6e-3, 3.1e-3, 6.2e-2), strict=True))
SCENARIOS = {
    "single_lane_change": (80 / 3.6, 3.5, 60.0, None),
    "double_lane_change": (60 / 3.6, 3.5, 30.0, 95.0),
    "double_lane_change_scaled": (80 / 3.6, 3.0, 50.0, 130.0),
    "truncated_slalom": (50 / 3.6, 2.0, 40.0, 90.0),
}
"""Scenario -> speed [m/s], how far aside [m], length of the change [m], where it comes back [m]."""
STARTS = (-0.5, -0.25, 0.0, 0.25, 0.5)


def rise(s, begin, length):
    part = np.clip((np.asarray(s, dtype=float) - begin) / length, 0.0, 1.0)
    return part**3 * (10 - 15 * part + 6 * part**2)


def path_of(scenario):
    """Give points of a path: arc length, x, y, heading, curvature [SI]."""
    _, aside, length, back = SCENARIOS[scenario]
    x = np.arange(0.0, 260.0, 1.0)
    y = aside * (rise(x, 30.0, length) - (rise(x, 30.0 + back, length) if back else 0.0))
    heading = np.arctan(np.gradient(y, x))
    s = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    return s, x, y, heading, np.gradient(heading, s)


def drive(scenario, controller, offset):
    """Give the rows of one run that starts ``offset`` beside the path, and its predicted horizons."""
    speed = SCENARIOS[scenario][0]
    s, xs, ys, headings, curvatures = path_of(scenario)
    on_error, on_heading, ahead = LAWS[controller]
    x, y, heading, angle, v = 0.0, offset, 0.0, 0.0, speed - 0.5
    rows, predicted = [], []
    for cycle in range(int(230.0 / speed / PERIOD)):
        foot = int(np.argmin((xs - x) ** 2 + (ys - y) ** 2))
        error = math.cos(headings[foot]) * (y - ys[foot]) - math.sin(headings[foot]) * (x - xs[foot])
        turned = heading - headings[foot]
        target = min(foot + round(ahead * v), s.size - 1)
        request = WHEELBASE * curvatures[target] - on_error * error - on_heading * turned
        rows.append(
            {
                "time": cycle * PERIOD,
                "arc_length": s[foot],
                "x": x,
                "y": y,
                "heading": heading,
                "lateral_error": error,
                "heading_error": turned,
                "speed": v,
                "reference_speed": speed,
                "steering_request": 20.0 * request,
                "steering_angle": 20.0 * angle,
                "road_wheel_angle": angle,
                "acceleration_request": 0.8 * (speed - v),
                "acceleration": 0.7 * (speed - v),
                "solve_time": STEP_TIMES[controller],
                "solved": cycle % 97 != 5,
            }
        )
        reach = np.arange(0.0, 1.6, 0.1) * v
        predicted.append(np.column_stack([x + reach * math.cos(heading), y + reach * math.sin(heading)]))
        angle += PERIOD / 0.2 * (request - angle)
        x, y = x + PERIOD * v * math.cos(heading), y + PERIOD * v * math.sin(heading)
        heading += PERIOD * v * math.tan(angle) / WHEELBASE
        v += PERIOD * 0.7 * (speed - v)
    return pd.DataFrame(rows), predicted


def run_of(rows, scenario, controller, offset):
    """Measure one run as the stage would."""
    error, angle = rows["lateral_error"].to_numpy(), rows["road_wheel_angle"].to_numpy()
    rate = np.gradient(angle, PERIOD)
    completed = bool(np.abs(error).max() < LANE)
    return ClosedLoopRun(
        controller=controller,
        scenario=scenario,
        speed=SCENARIOS[scenario][0],
        disturbance={"lateral_error": offset, "mass": 0.1 if offset > 0 else 0.0},
        prediction_model="magic_formula",
        simulation_model="magic_formula",
        completed=completed,
        lateral_error_rms=float(np.sqrt(np.mean(error**2))),
        lateral_error_p95=float(np.quantile(np.abs(error), 0.95)),
        lateral_error_max=float(np.abs(error).max()),
        lateral_error_settled=float(error[-20:].mean()),
        heading_error_rms=float(np.sqrt(np.mean(rows["heading_error"] ** 2))),
        arrival_time_error=0.12 if completed else None,
        braking_work=float(1.5 + offset),
        acceleration_work=4.2,
        drive_switches=3,
        lateral_acceleration_max=1.9,
        lateral_jerk_rms=0.8,
        steering_rate_rms=float(np.sqrt(np.mean(rate**2))),
        steering_rate_max=float(np.abs(rate).max()),
        steering_reversals=0.7,
        violations=2 if not completed else 0,
        infeasible=1 if controller == "mpc_robust" else 0,
        solve_time_p50=STEP_TIMES[controller],
        solve_time_p95=1.4 * STEP_TIMES[controller],
        solve_time_p99=1.6 * STEP_TIMES[controller],
        deadline_misses=40 if controller == "mpc_robust" else 0,
    )
