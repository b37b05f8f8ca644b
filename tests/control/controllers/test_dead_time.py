"""With a dead time beside the estimate no controller of the common base loses a lane change at 80 km/h."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest
from bench_case import STEERING, truck

from ident.control.closed_loop import Disturbance, Settings, run
from ident.control.controllers import CONTROLLERS
from ident.control.plant import Plant
from ident.control.scenarios import scenario
from ident.control.speed_profile import SpeedLimits

PERIOD, LANE = 0.05, 1.75
ROAD = scenario("single_lane_change", truck(), SpeedLimits(80 / 3.6))
START = Disturbance(lateral_error=0.5, heading_error=radians(3.0))
LATE = Plant(truck(dead_time=STEERING.dead_time + 0.1))


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_usual_start_with_a_dead_time_beside_the_estimate_is_caught(name):
    controller = CONTROLLERS[name](truck(), PERIOD)
    loop = run(LATE, controller, ROAD, START, Settings(lateral_limit=LANE))
    assert loop.completed
    assert np.abs(loop.lateral_error[loop.times > loop.times[-1] - 1.0]).max() < 0.2
    assert all(told.solved for told in loop.diagnostics)
