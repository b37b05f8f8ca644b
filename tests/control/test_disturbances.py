"""Disturbed starts, and trucks that are not as believed."""

from __future__ import annotations

import numpy as np
import pytest
from bench_case import truck

from ident.control.disturbances import (
    SWEEPS,
    UNCHANGED,
    UNITS,
    changed,
    differences,
    monte_carlo,
    one_at_a_time,
)
from ident.control.plant import Plant
from ident.dynamics.tyres import axle_force
from ident.errors import BadRecipe


def test_the_grid_holds_every_start_once():
    grid = one_at_a_time()
    assert len(set(grid)) == len(grid) == 17
    assert {round(np.degrees(one.heading_error)) for one in grid} == {-5, -3, -1, 0, 1, 3, 5}
    mirrored = {(-one.lateral_error, -one.heading_error, one.speed) for one in grid}
    assert mirrored == {(one.lateral_error, one.heading_error, one.speed) for one in grid}


def test_drawn_starts_fill_the_box_and_the_first_do_not_change_with_their_number():
    many = monte_carlo(2000, 5)
    assert monte_carlo(20, 5) == many[:20]
    assert monte_carlo(20, 6) != many[:20]
    drawn = np.array([(one.lateral_error, one.heading_error, one.speed) for one in many])
    half = np.array([1.0, np.radians(5.0), 2.0])
    assert np.all(np.abs(drawn) <= half)
    np.testing.assert_allclose(np.std(drawn, axis=0), half / np.sqrt(3), rtol=0.05)
    assert np.max(np.abs(np.corrcoef(drawn.T) - np.eye(3))) < 0.07
    with pytest.raises(BadRecipe, match="need 1 or more"):
        monte_carlo(0, 1)


@pytest.mark.parametrize("model", ["linear", "piecewise_linear", "magic_formula", "brush"])
def test_every_sweep_is_a_truck_and_no_change_is_none(model):
    one = truck(model, dead_time=0.25)
    for what, sizes in SWEEPS.items():
        if (model, what) == ("linear", "friction"):
            continue
        for size in sizes:
            Plant(changed(one, {what: size}))
        assert UNCHANGED[what] in sizes
        assert differences(one, changed(one, {what: UNCHANGED[what]})) == {}
    assert set(SWEEPS) == set(UNITS) == set(UNCHANGED)


def test_mass_takes_the_inertia_with_it_and_leaves_the_truck_that_it_was():
    one = truck("magic_formula")
    heavier = changed(one, {"mass": 0.3, "stiffness": -0.2, "ratio": 0.05, "time_constant": 0.5})
    found = differences(one, heavier)
    factors = {name: after / before for name, (before, after) in found.items()}
    expected = {"mass": 1.3, "yaw_inertia": 1.3, "steering.ratio": 1.05}
    expected |= {f"{axle}.cornering_stiffness": 0.8 for axle in ("front", "rear")}
    expected |= {f"steering.time_constant_{n}": 1.5 for n in (1, 2)}
    assert factors == pytest.approx(expected)
    assert one.parameters["mass"] == 12500.0
    assert one.steering.ratio[1, 1] == 0.6


@pytest.mark.parametrize("model", ["piecewise_linear", "magic_formula", "brush"])
def test_friction_scales_the_largest_force_and_not_the_stiffness(model):
    one = truck(model)
    slippery = changed(one, {"friction": 0.4})
    slip = np.linspace(0.0, 1.2, 4001)
    for axle in ("front", "rear"):
        forces = [
            axle_force(
                model,
                slip,
                {
                    name.partition(".")[2]: value
                    for name, value in made.parameters.items()
                    if name.startswith(axle)
                },
            )[0]
            for made in (one, slippery)
        ]
        assert np.max(forces[1]) == pytest.approx(0.4 * np.max(forces[0]), rel=1e-4)
        assert forces[1][1] == pytest.approx(forces[0][1], rel=2e-3)


@pytest.mark.parametrize(
    ("model", "mismatch", "message"),
    [
        ("linear", {"friction": 0.5}, "linear tyres have no largest force"),
        ("kinematic", {"mass": 0.1}, "kinematic truck has no mass"),
        ("linear", {"dead_time": -0.2}, "is -0.08 s, need 0 s or more"),
        ("linear", {"mass": -1.0}, "mass of the simulated truck is 0, need more than 0"),
        ("magic_formula", {"friction": 0.0}, "peak_force of the simulated truck is 0"),
        ("linear", {"wind": 1.0}, "no mismatch wind: need one of mass"),
        ("linear", {"mass": float("nan")}, "mismatch of mass is nan"),
        ("linear", {"ratio": -1.0}, "need more than -1"),
    ],
)
def test_refuses_a_mismatch_that_no_truck_has(model, mismatch, message):
    with pytest.raises(BadRecipe) as found:
        changed(truck(model), mismatch)
    assert message in str(found.value)
    assert "\n" not in str(found.value)
