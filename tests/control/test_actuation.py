"""Steering and drive for held commands, against Euler's method with tiny steps and loops written by hand."""

from __future__ import annotations

import numpy as np
import pytest
from bench_case import STEERING, truck

from ident.control.actuation import LOWEST_SPEED, DriveMotion, SteeringMotion
from ident.control.truck import Drive

PERIOD = 0.05


def moved(actuator, requests, *, start=0.0, linkage_play=0.0, points=11):
    """Angle, rate and road-wheel angle on an even grid, sent period by period."""
    motion = SteeringMotion(actuator, 0.6, linkage_play, start)
    parts = []
    for k, request in enumerate(requests):
        motion.send(k * PERIOD, float(request))
        parts.append(np.stack(motion.advance(np.linspace(k * PERIOD, (k + 1) * PERIOD, points))))
    return np.concatenate([parts[0][:, :1], *(part[:, 1:] for part in parts)], axis=1)


def by_euler(requests, rate, step=1e-5):
    """x' = (u - x)/T1, y' = clip((x - y)/T2): the angle every 5 ms."""
    t1, t2 = STEERING.time_constant_1, STEERING.time_constant_2
    u = STEERING.gain * np.repeat(requests, round(PERIOD / step))
    late = round(STEERING.dead_time / step)
    u = np.concatenate([np.zeros(late), u])[: u.size]
    x = y = 0.0
    angles = np.empty(u.size + 1)
    for i, value in enumerate(u.tolist()):
        angles[i] = y
        x, y = x + step * (value - x) / t1, y + step * min(max((x - y) / t2, -rate), rate)
    angles[-1] = y
    return angles[:: round(0.005 / step)]


def test_a_limited_rate_is_kept_over_the_borders_of_the_periods():
    limit = 1.5
    requests = np.repeat([1.0, -0.6, 0.2], 8)
    actuator = truck(rate_limit=limit).steering
    angle, rate, _ = moved(actuator, requests)
    assert np.max(np.abs(rate)) == pytest.approx(limit, rel=1e-12)
    np.testing.assert_allclose(angle, by_euler(requests, limit), atol=3e-5)
    free, free_rate, _ = moved(truck().steering, requests)
    assert np.max(np.abs(free_rate)) > 2 * limit
    assert np.max(np.abs(free - angle)) > 0.1


def test_splitting_the_time_otherwise_changes_nothing():
    actuator = truck(rate_limit=1.5, play=0.05).steering
    requests = np.repeat([1.0, -0.6, 0.2], 8)
    coarse, fine = moved(actuator, requests, points=2), moved(actuator, requests, points=11)
    np.testing.assert_allclose(coarse, fine[:, ::10], atol=1e-10)


def test_what_the_sensor_sees_stands_within_the_play():
    width = 0.06
    requests = np.repeat([0.5, 0.2, 0.5], 16)
    column, _, _ = moved(truck().steering, requests)
    angle, rate, _ = moved(truck(play=width).steering, requests)
    by_hand, z = [], 0.0
    for y in column.tolist():
        z = min(max(z, y - width / 2), y + width / 2)
        by_hand.append(z)
    np.testing.assert_allclose(angle, by_hand, atol=2e-4)  # the loop misses the turn between its points
    stands = np.diff(angle) == 0
    assert 5 < np.count_nonzero(stands) < angle.size - 5
    assert np.all(rate[1:][stands] == 0)
    assert np.max(np.abs(rate[1:][~stands])) > 0.1


def test_a_play_in_the_linkage_is_between_the_sensor_and_the_wheels():
    requests = np.repeat([0.5, 0.2, 0.5], 16)
    angle, _, road = moved(truck().steering, requests, linkage_play=0.004)
    straight = angle / 20.0
    assert np.max(np.abs(road - straight)) == pytest.approx(0.002, rel=1e-9)
    assert np.all(np.diff(road)[np.abs(road - straight)[1:] < 0.0019] == 0)


def test_small_requests_are_lost_in_the_dead_zone():
    actuator = truck(dead_zone=0.1).steering
    assert np.all(moved(actuator, np.full(20, 0.099))[0] == 0.0)
    end = moved(actuator, np.full(60, -0.3))[0, -1]
    assert end == pytest.approx(-STEERING.gain * 0.2, rel=1e-6)


@pytest.mark.parametrize("lag", [0.0, 0.3])
def test_drive_follows_its_request_late_lagging_and_clipped(lag):
    drive = Drive(lag=lag, dead_time=0.11, lowest=-2.0, highest=1.0)
    motion = DriveMotion(drive, 15.0)
    requests = np.repeat([3.0, -5.0, 0.4], 10)
    step = 1e-4
    u = np.clip(np.repeat(requests, round(PERIOD / step)), -2.0, 1.0)
    u = np.concatenate([np.zeros(round(0.11 / step)), u])[: u.size]
    a, v = 0.0, 15.0
    for value in u.tolist():
        before, a = a, value if lag == 0 else value + (a - value) * np.exp(-step / lag)
        v += step * (a if lag == 0 else (before + a) / 2)
    for k, request in enumerate(requests.tolist()):
        motion.send(k * PERIOD, request)
        speed, acceleration = motion.advance(np.array([k * PERIOD, k * PERIOD + 0.02, (k + 1) * PERIOD]))
    assert speed[-1] == pytest.approx(v, abs=1e-6)
    assert acceleration[-1] == pytest.approx(a, abs=1e-6)


def test_speed_never_falls_below_the_least_and_rises_at_once_after():
    motion = DriveMotion(Drive(lag=0.0, dead_time=0.0), 1.0)
    motion.send(0.0, -2.0)
    speed, acceleration = motion.advance(np.linspace(0.0, 1.0, 101))
    expected = np.maximum(1.0 - 2.0 * np.linspace(0.0, 1.0, 101), LOWEST_SPEED)
    np.testing.assert_allclose(speed, expected, atol=1e-12)
    assert np.all(acceleration[speed <= LOWEST_SPEED] == 0.0)
    motion.send(1.0, 0.5)
    speed, _ = motion.advance(np.array([1.0, 1.5, 2.0]))
    np.testing.assert_allclose(speed, LOWEST_SPEED + 0.5 * np.array([0.0, 0.5, 1.0]), atol=1e-12)
