"""Prediction over the commands on their way, and disturbances found, against integrations by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench_case import BODY, RATIO, STEERING, STIFFNESS, truck
from scipy.integrate import solve_ivp

from ident.control.controllers.controller import Command, Measured
from ident.control.estimator import Estimator, Sent
from ident.control.plant import Plant, Start
from ident.control.prediction import Prediction

M, J, LF, LR = BODY.values()
CF, CR = STIFFNESS.values()
PERIOD = 0.05
DRIVE = truck().drive


def rates(t, x, steering, acceleration):
    """x, v_y, r, y, heading, angle, rate, v_x, a of the truck of ``bench_case``, the CG tracked."""
    _, v_y, r, _, psi, angle, rate, v_x, a = x
    delta = angle / RATIO
    front = CF * (delta - np.arctan((v_y + LF * r) / v_x)) * np.cos(delta)
    rear = -CR * np.arctan((v_y - LR * r) / v_x)
    first, second = STEERING.time_constant_1, STEERING.time_constant_2
    return [
        v_x * np.cos(psi) - v_y * np.sin(psi),
        (front + rear) / M - v_x * r,
        (LF * front - LR * rear) / J,
        v_x * np.sin(psi) + v_y * np.cos(psi),
        r,
        rate,
        (STEERING.gain * steering - angle - (first + second) * rate) / (first * second),
        a,
        (acceleration - a) / DRIVE.lag,
    ]


def by_hand(start, begin, end, sent):
    """Integrate from one instant at which a command takes effect to the next."""
    arrivals = [(time + STEERING.dead_time, 0, s) for time, s, _ in sent]
    arrivals += [(time + DRIVE.dead_time, 1, a) for time, _, a in sent]
    force = [0.0, 0.0]
    state, now = start, begin
    for at, which, value in [*sorted(arrivals), (end, None, 0.0)]:
        if min(at, end) > now:
            state = solve_ivp(rates, (now, min(at, end)), state, args=tuple(force), rtol=1e-10, atol=1e-12)
            state, now = state.y[:, -1], min(at, end)
        if which is not None and at < end:
            force[which] = value
    return state


def measured(state, time=0.0):
    x, v_y, r, y, psi, angle, rate, v_x, a = state
    return Measured(time, x, y, psi, v_x, v_y, r, a, angle, rate)


def test_the_prediction_is_what_the_commands_on_their_way_do():
    start = np.array([0.0, 0.1, 0.02, 0.3, 0.05, 0.4, 0.5, 20.0, 0.2])
    sent = [(-0.11, 0.8, 0.5), (-0.06, 1.2, -0.5), (-0.013, -0.6, 0.1)]
    estimator = Estimator(Prediction(truck(), "time"), PERIOD)
    estimator.update(measured(start), 0.0)
    estimator.sent.begin(-1.0, (0.0, 0.0))
    for time, steering, acceleration in sent:
        estimator.sent.add(time, (steering, acceleration))
    ahead = estimator.ahead(STEERING.dead_time, 0.0)
    expected = by_hand(start, 0.0, STEERING.dead_time, sent)
    np.testing.assert_allclose(ahead, expected, rtol=2e-5, atol=5e-5)
    without = by_hand(start, 0.0, STEERING.dead_time, [])
    assert abs(expected[5] - without[5]) > 0.05


def test_a_command_takes_effect_at_its_dead_time_and_not_before():
    sent = Sent(truck())
    sent.begin(0.0, (1.0, 0.1))
    sent.add(0.0, (2.0, 0.2))
    sent.add(0.05, (3.0, 0.3))
    times, requests = sent.between(0.0, 0.2)
    arrivals = [0.0, DRIVE.dead_time, 0.12, 0.05 + DRIVE.dead_time, 0.17, 0.2]
    np.testing.assert_allclose(times, arrivals, atol=1e-12)
    np.testing.assert_allclose(requests[:, 0], [1.0, 1.0, 2.0, 2.0, 3.0, 3.0])
    np.testing.assert_allclose(requests[:, 1], [0.1, 0.2, 0.2, 0.3, 0.3, 0.3])


def test_old_commands_are_forgotten_but_for_those_in_force():
    sent = Sent(truck())
    sent.begin(0.0, (1.0, 0.0))
    for k in range(400):
        sent.add(k * PERIOD, (float(k), 0.0))
    times, _ = sent.steering()
    assert times.size < 40
    _, requests = sent.between(20.0, 20.01)
    assert requests[0, 0] == 397.0  # sent at 19.85 s: the last one 0.12 s before


def estimated(simulated, tracked_x=0.0, seconds=12.0, steer=0.3):
    """The estimator of the truck of ``bench_case`` after a drive of another one."""
    estimator = Estimator(Prediction(truck(), "time"), PERIOD)
    ride = Plant(simulated).begin(Start(20.0))
    for k in range(round(seconds / PERIOD)):
        estimator.update(ride.measured(), tracked_x)
        requests = steer * np.sin(0.3 * k * PERIOD), 0.0
        estimator.sent.add(ride.time, requests)
        ride.advance(Command(*requests), PERIOD * (k + 1))
    return dict(zip(estimator.prediction.disturbances, estimator.disturbance, strict=True))


def test_no_disturbance_is_found_where_there_is_none():
    found = estimated(truck())
    assert max(map(abs, found.values())) < 1e-5


def test_a_bank_is_found_as_lateral_acceleration():
    bank = replace(truck(), effects={"road_bank": {"bank_cos": 0.03, "bank_sin": 0.0}})
    found = estimated(bank, steer=0.0)
    assert found["lateral_disturbance"] == pytest.approx(-0.03 * 9.81, rel=0.02)
    assert abs(found["yaw_disturbance"]) < 0.002


def test_a_wrong_gain_of_the_steering_is_found_in_its_request():
    wrong = truck(gain=0.9 * STEERING.gain)
    found = estimated(wrong, steer=0.0, seconds=1.0)
    assert abs(found["steering_disturbance"]) < 1e-9
    estimator = Estimator(Prediction(truck(), "time"), PERIOD)
    ride = Plant(wrong).begin(Start(20.0))
    for k in range(300):
        estimator.update(ride.measured(), 0.0)
        estimator.sent.add(ride.time, (0.5, 0.0))
        ride.advance(Command(0.5, 0.0), PERIOD * (k + 1))
    assert estimator.disturbance[0] == pytest.approx(-0.05, rel=0.01)


def test_nothing_is_kept_over_a_reset():
    estimator = Estimator(Prediction(truck(), "time"), PERIOD)
    fresh = measured(np.array([0.0, 0.1, 0.02, 0.3, 0.05, 0.4, 0.5, 20.0, 0.2]))
    estimator.update(fresh, 0.0)
    estimator.sent.add(0.0, (3.0, 1.0))
    estimator.update(replace(fresh, time=0.05, lateral_velocity=2.0), 0.0)
    estimator.reset()
    estimator.update(fresh, 0.0)
    assert not estimator.disturbance.any()
    np.testing.assert_allclose(estimator.state, [0.0, 0.1, 0.02, 0.3, 0.05, 0.4, 0.5, 20.0, 0.2])
    assert estimator.sent.last == pytest.approx((0.4 / STEERING.gain, 0.2))
