"""The regulator's gains against a bicycle written by hand and scipy's Riccati equation."""

from __future__ import annotations

import numpy as np
import pytest
from bench_case import BODY, RATIO, STEERING, STIFFNESS, circle, truck
from scipy.linalg import expm, solve_discrete_are

from ident.control import prediction
from ident.control.controllers.lqr import LQR
from ident.control.controllers.steady import angle_per_curvature
from ident.control.controllers.weights import ACCEPTABLE, weight
from ident.control.estimator import SPEEDS
from ident.control.prediction import Prediction

M, J, LF, LR = BODY.values()
CF, CR = STIFFNESS.values()
L = LF + LR
PERIOD = 0.05
SPEED = float(SPEEDS[9])
STATES = ("lateral_velocity", "yaw_rate", "lateral_error", "heading_error")


def bicycle(v):
    """x' = A x + B δ of [v_y, r, e_y, e_ψ] on a straight road (Rajamani, 2012, section 2.5)."""
    A = np.array(
        [
            [-(CF + CR) / (M * v), -v - (LF * CF - LR * CR) / (M * v), 0, 0],
            [-(LF * CF - LR * CR) / (J * v), -(LF**2 * CF + LR**2 * CR) / (J * v), 0, 0],
            [1, 0, 0, v],
            [0, 1, 0, 0],
        ]
    )
    return A, np.array([[CF / M], [LF * CF / J], [0], [0]])


def with_lags(v):
    A, B = bicycle(v)
    first, second = STEERING.time_constant_1, STEERING.time_constant_2
    full, drive = np.zeros((6, 6)), np.zeros((6, 1))
    full[:4, :4], full[:4, 4] = A, B[:, 0] / RATIO
    full[4, 5] = 1
    full[5, 4], full[5, 5] = -1 / (first * second), -(first + second) / (first * second)
    drive[5] = STEERING.gain / (first * second)
    return full, drive


def gain_by_scipy(A, B, Q, R):
    size, inputs = B.shape
    joint = np.zeros((size + inputs, size + inputs))
    joint[:size, :size], joint[:size, size:] = A, B
    step = expm(joint * PERIOD)
    Ad, Bd = step[:size, :size], step[:size, size:]
    P = solve_discrete_are(Ad, Bd, Q, R)
    return np.linalg.solve(R + Bd.T @ P @ Bd, Bd.T @ P @ Ad)[0], Ad, Bd


def test_the_gain_is_that_of_the_bicycle_with_its_lags_and_holds_it():
    gain = LQR(truck(), PERIOD).law(0.0).gain(SPEED)
    weights = [weight(ACCEPTABLE, name) for name in STATES]
    Q = np.diag([*weights, 0.0, weight(ACCEPTABLE, "steering_rate") / RATIO**2])
    R = np.array([[weight(ACCEPTABLE, "steering_request") / RATIO**2]])
    expected, Ad, Bd = gain_by_scipy(*with_lags(SPEED), Q, R)
    np.testing.assert_allclose(gain, expected, rtol=1e-8)
    assert np.abs(np.linalg.eigvals(Ad - Bd @ gain[None])).max() < 0.99


def test_with_vanishing_lags_the_gain_is_that_of_the_bicycle_alone(monkeypatch):
    monkeypatch.setattr(prediction, "SHORTEST_LAG", 1e-4)
    at_once = truck(time_constant_1=1e-4, time_constant_2=1e-4, gain=1.0)
    weights = {"lateral_error": 1.0, "heading_error": 0.2, "steering_request": 0.02}
    gain = LQR(at_once, PERIOD, weights).law(0.0).gain(SPEED)
    Q = np.diag([weight(weights, name) for name in STATES])
    expected, *_ = gain_by_scipy(*bicycle(SPEED), Q, np.array([[weight(weights, "steering_request")]]))
    np.testing.assert_allclose(gain[:4] / RATIO, expected, rtol=0.01)


@pytest.mark.parametrize("speed", [2.0, 8.0, 15.0, 24.0, 33.0])
def test_the_gains_between_the_speeds_they_were_made_for_hold_the_truck(speed):
    gain = LQR(truck(), PERIOD).law(0.0).gain(speed)
    A, B = with_lags(speed)
    _, Ad, Bd = gain_by_scipy(A, B, np.eye(6), np.eye(1))
    assert np.abs(np.linalg.eigvals(Ad - Bd @ gain[None])).max() < 1.0


def test_a_point_ahead_of_the_centre_of_gravity_is_held_by_other_gains():
    lqr = LQR(truck(), PERIOD)
    assert not np.allclose(lqr.law(2.0).gain(SPEED), lqr.law(0.0).gain(SPEED), rtol=0.01)


def test_the_angle_for_a_curvature_is_that_of_the_understeer_gradient():
    gradient = M / L * (LR / CF - LF / CR)
    found = angle_per_curvature(Prediction(truck(), "time"), SPEED, 0.0)
    assert found == pytest.approx(L + gradient * SPEED**2, rel=1e-6)
    kinematic = angle_per_curvature(Prediction(truck("kinematic"), "time"), SPEED, 0.0)
    assert kinematic == pytest.approx(L, rel=1e-9)


def test_the_course_along_a_circle_is_the_steady_cornering_itself():
    lqr = LQR(truck(), PERIOD)
    _, course = lqr._along(circle(0.004, 20.0, 300.0))
    middle = course.arc_length < 200.0
    assert np.abs(course.states[middle]).max() < 1e-6
    assert np.abs(course.request[middle]).max() < 1e-9
