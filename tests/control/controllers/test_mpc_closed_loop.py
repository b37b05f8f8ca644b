"""The predictive controllers in the closed loop of the bench."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from bench_case import STEERING, straight, truck

from ident.control.closed_loop import Disturbance, run
from ident.control.controllers import CONTROLLERS
from ident.control.controllers.mpc_spatial import mpc_spatial_rate
from ident.control.controllers.weights import weights_of
from ident.control.paths import lane_change_length, single_lane_change
from ident.control.plant import Plant
from ident.control.scenarios import reference
from ident.control.speed_profile import SpeedLimits

PERIOD = 0.05
SPEED = 80 / 3.6
DYNAMIC = ("mpc_time", "mpc_spatial", "mpc_spatial_rate", "mpc_robust")
LIMITS = SpeedLimits(set_speed=SPEED)


@pytest.fixture(scope="module")
def controllers():
    """Made once: each is reset before a run."""
    return {name: CONTROLLERS[name](truck(), PERIOD) for name in (*DYNAMIC, "mpc_time_kinematic")}


@pytest.fixture(scope="module")
def road():
    length = lane_change_length(LIMITS.lateral_acceleration / SPEED**2)
    return reference(single_lane_change(length, lead_in=5.0, run_out=35.0), truck(), LIMITS)


def late(seconds, **changes):
    return Plant(truck(dead_time=STEERING.dead_time + seconds, **changes))


@pytest.mark.parametrize("name", ["mpc_time", "mpc_spatial_rate", "mpc_robust"])
def test_without_mismatch_the_path_is_kept_within_centimetres(controllers, road, name):
    loop = run(late(0.0), controllers[name], road)
    assert loop.completed
    assert np.abs(loop.lateral_error).max() < (0.15 if name == "mpc_spatial_rate" else 0.07)
    assert np.abs(loop.lateral_error[-20:]).max() < 0.03
    assert abs(loop.arrival_time - road.time[-1]) < 0.02
    assert all(told.solved for told in loop.diagnostics)


@pytest.mark.parametrize("name", [*DYNAMIC, "mpc_time_kinematic"])
def test_a_dead_time_beside_the_estimate_does_not_lose_the_path(controllers, road, name):
    loop = run(late(0.1), controllers[name], road)
    allowed = 0.6 if name == "mpc_time_kinematic" else 0.25
    assert loop.completed
    assert np.abs(loop.lateral_error).max() < allowed
    assert all(told.solved for told in loop.diagnostics)


def test_without_tyres_in_its_model_it_does_not_swing_about_the_path(controllers):
    start = Disturbance(lateral_error=0.5, heading_error=0.05)
    long = straight(SPEED, 300.0)
    as_the_others = CONTROLLERS["mpc_time_kinematic"](truck(), PERIOD, weights_of("mpc_time"))
    left = []
    for controller in (controllers["mpc_time_kinematic"], as_the_others):
        loop = run(late(0.0), controller, long, start)
        left.append(np.abs(loop.lateral_error[loop.arc_length > 200.0]).max())
    assert left[0] < 0.12, left
    assert left[0] < 0.33 * left[1], left


@pytest.mark.parametrize("name", ["mpc_time", "mpc_spatial"])
def test_what_is_constant_leaves_no_offset(controllers, name):
    effects = {"steering_offset": {"angle": 0.004}, "road_bank": {"bank_cos": -0.02, "bank_sin": 0.0}}
    loop = run(Plant(replace(truck(), effects=effects)), controllers[name], straight(20.0, 240.0))
    assert np.abs(loop.lateral_error).max() > 0.03
    settled = loop.lateral_error[(loop.arc_length > 205.0) & (loop.arc_length < 225.0)]
    assert np.abs(settled).max() < 0.01


def test_a_truck_that_starts_slow_and_aside_comes_back_and_arrives_on_time(controllers):
    road, start = straight(SPEED, 260.0), Disturbance(lateral_error=0.5, heading_error=0.017, speed=-1.0)
    loop = run(late(0.0), controllers["mpc_spatial"], road, start)
    assert loop.completed
    assert np.abs(loop.lateral_error[-20:]).max() < 0.02
    assert abs(loop.arrival_time - road.time[-1]) < 0.1
    slowly = 260.0 / (SPEED - 1.0) - 260.0 / SPEED
    assert slowly > 0.5  # what it would be late without doing anything


def test_the_rate_limit_is_kept_in_the_closed_loop_while_the_speed_changes():
    rate = 0.06
    controller = mpc_spatial_rate(truck(), PERIOD, steering_rate=rate)
    start = Disturbance(lateral_error=1.0, speed=-2.0)
    loop = run(late(0.0), controller, straight(SPEED, 120.0), start)
    requests = np.array([command.steering_request for command in loop.commands])
    slope = STEERING.gain * (STEERING.ratio[1, 1] - STEERING.ratio[0, 1]) / np.ptp(STEERING.ratio[:, 0])
    rates = np.abs(np.diff(requests)) * slope / PERIOD
    assert rates.max() <= rate * 1.001
    assert rates.max() > 0.95 * rate
    assert loop.completed


def test_the_simulated_truck_does_not_reach_the_controller(controllers):
    controller = controllers["mpc_time"]
    before = copy.deepcopy(controller.base.truck)
    parameters = controller.prediction.parameters(0.0).copy()
    heavy = replace(truck(), parameters={**truck().parameters, "mass": 16000.0})
    run(Plant(heavy), controller, straight(20.0, 40.0))
    assert controller.base.truck.parameters == before.parameters
    assert controller.base.truck.drive == before.drive
    assert np.array_equal(controller.base.truck.steering.ratio, before.steering.ratio)
    assert np.array_equal(controller.prediction.parameters(0.0), parameters)
