"""What all controllers share: projection, limits, the inverse of the steering, the clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench_case import STEERING, circle, straight, truck

from ident.control.controllers.base import Base
from ident.control.controllers.controller import Measured
from ident.control.controllers.followed import Followed
from ident.control.controllers.speed_control import DISTANCE_TIME, acceleration_for
from ident.control.truck import Drive

PERIOD = 0.05
BENT = np.array([[-10.0, -0.6], [0.0, 0.0], [10.0, 0.4]])


def measured(time=0.0, x=0.0, y=0.0, heading=0.0, speed=20.0, **others):
    rest = {
        "lateral_velocity": 0.0,
        "yaw_rate": 0.0,
        "longitudinal_acceleration": 0.0,
        "steering_angle": 0.0,
        "steering_rate": 0.0,
    }
    return Measured(time, x, y, heading, speed, **(rest | others))


@pytest.mark.parametrize("seed", range(5))
def test_the_projection_is_the_nearest_point_of_a_circle(seed):
    random = np.random.default_rng(seed)
    radius, angle, left = 80.0, random.uniform(0.2, 1.5), random.uniform(-3.0, 3.0)
    followed = Followed(circle(1 / radius, 20.0, 200.0, step=1.0))
    x, y = (radius - left) * np.sin(angle), radius - (radius - left) * np.cos(angle)
    found = followed.project(x, y, angle + 0.1)
    assert found.arc_length == pytest.approx(radius * angle, abs=1e-4)
    assert found.lateral_error == pytest.approx(left, abs=1e-5)
    assert found.heading_error == pytest.approx(0.1, abs=1e-4)


def test_where_a_path_crosses_itself_the_truck_stays_on_its_way():
    length = 2 * np.pi * 30.0
    followed = Followed(circle(1 / 30.0, 10.0, 1.5 * length))
    for s in np.arange(0.0, 1.4 * length, 1.0):
        found = followed.project(30.0 * np.sin(s / 30.0), 30.0 * (1 - np.cos(s / 30.0)), s / 30.0)
        assert found.arc_length == pytest.approx(s, abs=0.01)


def test_beyond_its_ends_a_path_runs_straight_on():
    followed = Followed(straight(20.0, 50.0))
    assert followed.project(57.0, 1.0, 0.0).arc_length == pytest.approx(57.0)
    assert followed.time(60.0) == pytest.approx(3.0)
    assert followed.time(-10.0) == pytest.approx(-0.5)


def test_a_situation_lies_a_dead_time_ahead():
    base = Base(truck(), PERIOD)
    situation = base.begin(measured(y=0.4), straight(20.0, 100.0))
    assert situation.effective == pytest.approx(STEERING.dead_time)
    assert situation.state[0] == pytest.approx(20.0 * STEERING.dead_time)
    assert situation.arc_length == pytest.approx(0.0, abs=1e-9)
    assert situation.lateral_error == pytest.approx(0.4)
    further = Base(truck(), PERIOD, further=0.3).begin(measured(y=0.4), straight(20.0, 100.0))
    assert further.state[0] == pytest.approx(20.0 * (STEERING.dead_time + 0.3))


@pytest.mark.parametrize("angle", [-0.7, -0.3, 0.0, 0.05, 0.5])
def test_the_request_for_an_angle_gives_that_angle(angle):
    base = Base(truck(ratio=BENT, gain=0.9), PERIOD)
    request = base.request_for(angle)
    slope = 0.04 if angle > 0 else 0.06
    assert 0.9 * request * slope == pytest.approx(angle, abs=1e-12)


def test_a_ratio_that_turns_the_wheels_the_other_way_is_inverted_too():
    base = Base(truck(ratio=BENT * [1.0, -1.0], gain=0.9), PERIOD)
    assert 0.9 * base.request_for(0.3) * -0.06 == pytest.approx(0.3, abs=1e-12)
    assert base.lowest_request < 0 < base.highest_request


def test_requests_stay_within_the_angle_the_rate_and_the_drive():
    limited = replace(
        truck(rate_limit=2.0, gain=0.8), highest_angle=0.02, drive=Drive(lowest=-2.0, highest=0.5)
    )
    base = Base(limited, PERIOD)
    sent = []
    for k in range(12):
        situation = base.begin(measured(time=k * PERIOD, x=k), straight(20.0, 100.0))
        command, _ = base.command(situation, 99.0, 99.0)
        sent.append(command.steering_request)
        assert command.acceleration_request == 0.5
    assert np.diff(sent).max() == pytest.approx(2.0 * PERIOD / 0.8)
    assert sent[-1] == pytest.approx(0.02 * 20.0 / 0.8)
    situation = base.begin(measured(time=0.6, x=12.0), straight(20.0, 100.0))
    assert base.command(situation, -99.0, -99.0)[0].acceleration_request == -2.0


def test_diagnostics_tell_where_the_truck_is_and_how_long_it_took():
    base = Base(truck(), PERIOD)
    situation = base.begin(measured(y=-0.3, heading=0.02), straight(20.0, 100.0))
    _, diagnostics = base.command(situation, 0.0, 0.0, violation=0.5)
    assert diagnostics.lateral_error == pytest.approx(-0.3)
    assert diagnostics.heading_error == pytest.approx(0.02)
    assert 0 < diagnostics.solve_time < 1.0
    assert diagnostics.violation == 0.5
    assert diagnostics.solved


def test_the_clock_starts_with_the_first_cycle_wherever_that_is():
    base = Base(truck(), PERIOD)
    road = straight(20.0, 100.0)
    assert base.begin(measured(time=7.0, x=40.0), road).lateness == pytest.approx(0.0, abs=1e-9)
    late = base.begin(measured(time=7.5, x=44.0), road)
    assert late.lateness == pytest.approx(0.5 - 4.0 / 20.0, abs=1e-6)
    base.reset()
    assert base.begin(measured(time=9.0, x=0.0), road).lateness == pytest.approx(0.0, abs=1e-9)


def test_the_speed_is_held_by_what_is_missing_and_the_distance_behind():
    drive = Drive(lowest=-3.0, highest=1.0)
    assert acceleration_for(drive, (20.0, 0.2), 20.0, 0.0, 0.05) == pytest.approx(0.15)
    assert acceleration_for(drive, (20.0, 0.0), 19.5, 0.0, 0.0) == pytest.approx(0.5)
    assert acceleration_for(drive, (20.0, 0.0), 20.0, 0.1, 0.0) == pytest.approx(2.0 / DISTANCE_TIME**2)


def test_a_great_distance_behind_asks_for_no_more_than_half_of_what_the_drive_has():
    drive = Drive(lowest=-3.0, highest=1.0)
    assert acceleration_for(drive, (20.0, 0.0), 20.0, 99.0, 0.0) == pytest.approx(0.5)
    assert acceleration_for(drive, (20.0, 0.0), 20.0, -99.0, 0.0) == pytest.approx(-1.5)
