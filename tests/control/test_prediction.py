"""The prediction model against equations written by hand, its derivatives by complex steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy
from bench_case import BODY, RATIO, STEERING, STIFFNESS, truck
from scipy.integrate import solve_ivp

from ident.control.prediction import Prediction, in_time
from ident.dynamics.effects import STEERING_OFFSET
from ident.dynamics.symbols import symbol

M, J, LF, LR = BODY.values()
CF, CR = STIFFNESS.values()
L = LF + LR
TRACKED = -LR
STATE = np.array([12.0, 0.4, 0.08, 0.6, -0.05, 1.1, -0.7, 17.0, 0.3])
KINEMATIC_STATE = np.delete(STATE, [1, 2])
REQUESTS = np.array([1.6, -0.4])
CURVATURE = 0.01
DISTURBED = np.array([0.02, 0.1, 0.3, -0.05, 0.07, 0.004])


def road(v_x, v_y, r, e_y, e_psi, drift, turn):
    """ṡ, ė_y and ė_ψ of METHODS section 5 for the point that is tracked."""
    beside = v_y + TRACKED * r + drift
    progress = (v_x * np.cos(e_psi) - beside * np.sin(e_psi)) / (1 - CURVATURE * e_y)
    return progress, v_x * np.sin(e_psi) + beside * np.cos(e_psi), r + turn - CURVATURE * progress


def lags(angle, rate, request):
    first, second = STEERING.time_constant_1, STEERING.time_constant_2
    return (STEERING.gain * request - angle - (first + second) * rate) / (first * second)


def bicycle_by_hand(x, u, d):
    """Rates to time of the truck of ``bench_case`` on linear tyres."""
    _, v_y, r, e_y, e_psi, angle, rate, v_x, a = x
    delta = angle / RATIO
    slip_f = -np.arctan(
        ((v_y + LF * r) * np.cos(delta) - v_x * np.sin(delta))
        / (v_x * np.cos(delta) + (v_y + LF * r) * np.sin(delta))
    )
    slip_r = -np.arctan((v_y - LR * r) / v_x)
    front, rear = CF * slip_f * np.cos(delta), CR * slip_r
    s, aside, turned = road(v_x, v_y, r, e_y, e_psi, d[4], d[5])
    return np.array(
        [
            s,
            (front + rear) / M - v_x * r + d[2],
            (LF * front - LR * rear) / J + d[3],
            aside,
            turned,
            rate,
            lags(angle, rate, u[0] + d[0]),
            a,
            (u[1] + d[1] - a) / 0.3,
        ]
    )


def kinematic_by_hand(x, u, d):
    _, e_y, e_psi, angle, rate, v_x, a = x
    r = v_x * np.tan(angle / RATIO) / L
    s, aside, turned = road(v_x, LR * r, r, e_y, e_psi, d[2], d[3])
    return np.array([s, aside, turned, rate, lags(angle, rate, u[0] + d[0]), a, (u[1] + d[1] - a) / 0.3])


CASES = {
    "linear": (bicycle_by_hand, STATE, DISTURBED),
    "kinematic": (kinematic_by_hand, KINEMATIC_STATE, np.delete(DISTURBED, [2, 3])),
}


def in_space(by_hand):
    def rates(x, u, d):
        to_time = by_hand(x, u, d)
        return np.concatenate([[1.0 / to_time[0]], to_time[1:] / to_time[0]])

    return rates


def complex_step(function, at):
    columns = []
    for k in range(at.size):
        moved = at.astype(complex)
        moved[k] += 1e-30j
        columns.append(function(moved).imag / 1e-30)
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("domain", ["time", "space"])
@pytest.mark.parametrize("model", ["linear", "kinematic"])
def test_rates_and_derivatives_are_those_of_the_equations(model, domain):
    by_hand, state, disturbance = CASES[model]
    if domain == "space":
        by_hand = in_space(by_hand)
    prediction = Prediction(truck(model), domain)
    inputs = prediction.inputs(REQUESTS, CURVATURE, state[prediction.index["steering_angle"]], disturbance)
    rates, A, B = prediction.jacobians(state, inputs, TRACKED)
    np.testing.assert_allclose(rates, by_hand(state, REQUESTS, disturbance), rtol=1e-12, atol=1e-13)
    to_states = complex_step(lambda x: by_hand(x, REQUESTS, disturbance), state)
    to_requests = complex_step(lambda u: by_hand(state, u, disturbance), REQUESTS)
    to_disturbances = complex_step(lambda d: by_hand(state, REQUESTS, d), disturbance)
    np.testing.assert_allclose(A, to_states, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(B[:, :2], to_requests, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(B[:, 5:], to_disturbances, rtol=1e-10, atol=1e-12)


def test_the_first_state_is_the_arc_length_or_the_time():
    assert Prediction(truck(), "time").states[0] == "arc_length"
    assert Prediction(truck(), "space").states[0] == "time"


def test_a_stage_holds_the_requests_as_an_integration_of_the_linear_model_does():
    prediction = Prediction(truck(), "time")
    inputs = prediction.inputs(REQUESTS, CURVATURE, STATE[5], DISTURBED)
    stages = prediction.linearised(STATE[None], inputs[None], np.array([0.05]), TRACKED)
    rates, A, B = prediction.jacobians(STATE, inputs, TRACKED)
    begin, requests = STATE + 0.01, REQUESTS + 0.1

    def linear(_, x):
        return rates + A @ (x - STATE) + B[:, :2] @ (requests - REQUESTS)

    ended = solve_ivp(linear, (0.0, 0.05), begin, rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(stages.A[0] @ begin + stages.B[0] @ requests + stages.c[0], ended, rtol=1e-9)


def test_a_course_of_many_points_is_linearised_as_each_alone():
    prediction = Prediction(truck(), "space")
    states = STATE + 0.01 * np.arange(5)[:, None]
    inputs = prediction.inputs(np.tile(REQUESTS, (5, 1)), CURVATURE, states[:, 5], DISTURBED)
    steps = np.linspace(0.5, 1.5, 5)
    together = prediction.linearised(states, inputs, steps, TRACKED)
    for k in range(5):
        alone = prediction.linearised(states[k : k + 1], inputs[k : k + 1], steps[k : k + 1], TRACKED)
        for name in ("A", "B", "c"):
            np.testing.assert_allclose(getattr(together, name)[k], getattr(alone, name)[0], rtol=1e-12)


def test_a_bent_ratio_map_is_read_at_the_angle():
    bent = np.array([[-10.0, -0.6], [0.0, 0.0], [10.0, 0.4]])
    prediction = Prediction(truck(ratio=bent), "time")
    angles = np.array([-3.0, 5.0])
    rows = prediction.inputs(np.zeros((2, 2)), 0.0, angles, np.zeros(6))
    slope, offset = rows[:, 3], rows[:, 4]
    np.testing.assert_allclose(slope, [0.06, 0.04])
    np.testing.assert_allclose(slope * angles + offset, [-0.18, 0.2])


def test_a_steering_offset_that_is_believed_turns_the_wheels():
    system = in_time("linear", (STEERING_OFFSET,))
    offset, angle = symbol("steering_offset"), symbol("at.road_wheel_angle")
    assert sympy.diff(system.intermediates["at.road_wheel_angle"], offset) == 1
    slip = [value for value in system.intermediates.values() if angle in value.free_symbols]
    assert slip, "nothing depends on the angle of the wheels"
    assert not any(symbol("road_wheel_angle") in value.free_symbols for value in slip)


def test_effects_that_cannot_be_predicted_with_are_left_out():
    bank = replace(truck(), effects={"road_bank": {"bank_cos": 0.02, "bank_sin": 0.0}})
    assert Prediction(bank, "time").engine is Prediction(truck(), "time").engine


def test_a_mirrored_state_has_mirrored_rates():
    prediction = Prediction(truck(), "time")
    sides = np.array([1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 1.0, 1.0])
    disturbed = np.array([-1.0, 1.0, -1.0, -1.0, -1.0, -1.0]) * DISTURBED
    there = prediction.inputs(REQUESTS, CURVATURE, STATE[5], DISTURBED)
    here = prediction.inputs(REQUESTS * [-1.0, 1.0], -CURVATURE, -STATE[5], disturbed)
    rates = prediction.rates(STATE, there, TRACKED)
    np.testing.assert_allclose(prediction.rates(sides * STATE, here, TRACKED), sides * rates, atol=1e-12)
