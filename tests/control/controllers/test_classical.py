"""The controllers without an optimisation in the closed loop of the bench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench_case import STEERING, truck

from ident.control.closed_loop import Disturbance, run
from ident.control.controllers import CONTROLLERS
from ident.control.paths import lane_change_length, mirrored, single_lane_change
from ident.control.plant import Plant
from ident.control.scenarios import reference
from ident.control.speed_profile import SpeedLimits
from ident.results.validate import ControllerName

PERIOD = 0.05
SPEED = 80 / 3.6
CLASSICAL = ("pid", "pure_pursuit", "stanley", "lqr")
LIMITS = SpeedLimits(set_speed=SPEED)


@pytest.fixture(scope="module")
def controllers():
    """Made once: each is reset before a run."""
    return {name: CONTROLLERS[name](truck(), PERIOD) for name in CLASSICAL}


def lane_change(run_out=4.0):
    sharpest = LIMITS.lateral_acceleration / SPEED**2
    return single_lane_change(lane_change_length(sharpest), lead_in=10.0, run_out=run_out * SPEED)


@pytest.fixture(scope="module")
def road():
    return reference(lane_change(), truck(), LIMITS)


def bend(curvature):
    """A long one, in which what a constant disturbance does has settled in the end."""
    s = np.arange(0.0, 300.0, 0.5)
    angle = curvature * s
    x, y = s, np.zeros(s.size)
    if curvature:
        x, y = np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature
    full = np.full(s.size, curvature)
    path = replace(lane_change(), arc_length=s, position_x=x, position_y=y, heading=angle, curvature=full)
    return reference(path, truck(), SpeedLimits(set_speed=20.0))


BANKED = {"steering_offset": {"angle": 0.004}, "road_bank": {"bank_cos": -0.02, "bank_sin": 0.0}}
CONSTANT = {
    "a bank and a steering offset": (0.0, {}, BANKED),
    "a wrong gain in a curve": (0.003, {"gain": 0.85 * STEERING.gain}, {}),
}


def late(seconds):
    return Plant(truck(dead_time=STEERING.dead_time + seconds))


def test_every_name_of_the_results_has_a_controller():
    assert set(CONTROLLERS) == set(ControllerName.__args__)


@pytest.mark.parametrize("name", CLASSICAL)
def test_without_mismatch_the_path_is_kept(controllers, road, name):
    loop = run(late(0.0), controllers[name], road)
    allowed = {"lqr": 0.05, "pid": 0.3, "pure_pursuit": 0.35, "stanley": 0.35}
    assert loop.completed
    assert np.abs(loop.lateral_error).max() < allowed[name]
    assert abs(loop.arrival_time - road.time[-1]) < 0.02
    assert loop.controller == name


@pytest.mark.parametrize("seconds", [0.1, -0.1])
@pytest.mark.parametrize("name", CLASSICAL)
def test_a_dead_time_beside_the_estimate_does_not_lose_the_path(controllers, road, name, seconds):
    loop = run(late(seconds), controllers[name], road)
    assert loop.completed
    assert np.abs(loop.lateral_error).max() < 0.5
    settled = loop.lateral_error[loop.times > loop.times[-1] - 0.5]
    assert np.abs(settled).max() < 0.1


@pytest.mark.parametrize("name", CLASSICAL)
def test_the_mirror_image_of_a_path_is_steered_in_mirror_image(controllers, road, name):
    start = Disturbance(lateral_error=0.3, heading_error=0.02)
    other = Disturbance(lateral_error=-0.3, heading_error=-0.02)
    left = run(late(0.05), controllers[name], road, start)
    image = reference(mirrored(lane_change()), truck(), LIMITS)
    right = run(late(0.05), controllers[name], image, other)
    requests = [np.array([c.steering_request for c in loop.commands]) for loop in (left, right)]
    assert np.abs(requests[0]).max() > 0.1
    np.testing.assert_allclose(requests[0], -requests[1], atol=1e-6)


@pytest.mark.parametrize("what", CONSTANT)
@pytest.mark.parametrize("name", CLASSICAL)
def test_what_is_constant_leaves_no_offset(controllers, name, what):
    curvature, steering, effects = CONSTANT[what]
    loop = run(Plant(replace(truck(**steering), effects=effects)), controllers[name], bend(curvature))
    settled = loop.lateral_error[(loop.arc_length > 240.0) & (loop.arc_length < 260.0)]
    assert loop.completed
    assert np.abs(loop.lateral_error).max() > 0.03
    assert np.abs(settled).max() < 0.01


def test_a_bent_ratio_map_is_steered_through(road):
    bent = np.array([[-12.0, -0.7], [0.0, 0.0], [0.4, 0.03], [12.0, 0.5]])
    pid = CONTROLLERS["pid"](truck(ratio=bent), PERIOD)
    loop = run(Plant(truck(ratio=bent)), pid, road)
    assert np.abs(loop.lateral_error).max() < 0.3


@pytest.mark.parametrize("name", CLASSICAL)
def test_a_run_is_the_same_after_another_one(controllers, road, name):
    first = run(late(0.0), controllers[name], road)
    run(late(0.1), controllers[name], road, Disturbance(speed=-1.0))
    again = run(late(0.0), controllers[name], road)
    assert [c.steering_request for c in first.commands] == [c.steering_request for c in again.commands]
