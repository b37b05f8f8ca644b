"""The weights that are told of a controller are those that it decides by."""

from __future__ import annotations

from dataclasses import asdict

import bench_case as case
import numpy as np
import pytest

from ident.control.controllers import CONTROLLERS
from ident.control.controllers.controller import Measured
from ident.control.controllers.weights import ACCEPTABLE, WEIGHTS, weights_of

PERIOD = 0.05
SPEEDS = (4.0, 20.0)  # [m/s]: below and above where the shortest look-ahead holds
TRUCK = case.truck()


def commands(name, weights):
    """Requests while the truck is beside a straight road, turned a little, and slower than it should be."""
    made = []
    for speed in SPEEDS:
        controller = CONTROLLERS[name](TRUCK, PERIOD, weights)
        road = case.straight(speed, 400.0)
        for number in range(4):
            time = PERIOD * number
            seen = Measured(time, 5.0 + speed * time, 0.05, 0.004, 0.9 * speed, 0.0, 0.01, 0.2, 0.1, 0.05)
            command, _ = controller.step(seen, road)
            made += asdict(command).values()
    return np.array(made)


@pytest.mark.parametrize("name", ["pid", "pure_pursuit", "stanley", "lqr", "mpc_time", "mpc_spatial"])
def test_every_weight_that_is_told_is_one_that_it_decides_by(name):
    told = weights_of(name)
    as_they_are = commands(name, None)
    np.testing.assert_allclose(commands(name, told), as_they_are, rtol=0, atol=1e-6)
    for one, size in told.items():
        changed = commands(name, told | {one: 1.5 * size + 0.01})
        assert np.abs(changed - as_they_are).max() > 1e-4, one


@pytest.mark.parametrize("name", ["lqr", "mpc_time"])
def test_what_is_not_told_changes_nothing(name):
    told = weights_of(name)
    others = {one: 3.0 * size for one, size in ACCEPTABLE.items() if one not in told}
    assert others
    np.testing.assert_allclose(commands(name, told | others), commands(name, None), rtol=0, atol=1e-6)


def test_every_controller_has_weights():
    for name in CONTROLLERS:
        assert weights_of(name)
    assert set(WEIGHTS) <= set(CONTROLLERS)
