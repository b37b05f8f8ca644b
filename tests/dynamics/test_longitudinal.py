"""The driven bicycle: coasting in closed form, energy, slopes, and the planar bicycle inside it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from vehicle_values import MOUNTED, TILTED, segments, truck

from ident.dynamics.bicycle import bicycle, substeps_for
from ident.dynamics.engine import Engine, compiled
from ident.dynamics.longitudinal import COMING_TO_REST, driven_bicycle

Array = NDArray[np.float64]

MASS = 12500.0
ROLLING, DRAG = 0.006, 3.6
RESISTANCE = {"rolling_resistance": ROLLING, "drag": DRAG}


def made() -> Engine:
    return compiled(driven_bicycle("linear", "linear"))


def straight(
    speed: float, seconds: float, values: dict[str, float], force: float = 0.0, grade: float = 0.0
) -> tuple[Array, dict[str, Array]]:
    engine, step = made(), 0.02
    count = round(seconds / step) + 1
    inputs = np.tile([0.0, force, grade], (count, 1))
    p = engine.vector(truck("linear") | RESISTANCE | values)
    states, outputs = engine.simulate([[speed, 0, 0, 0, 0, 0]], inputs, np.full(count, step), [0, count], p)
    return states, dict(zip(engine.outputs, outputs.T, strict=True))


def test_coasting_slows_as_the_closed_form_says() -> None:
    states, _ = straight(20.0, 60.0, {})
    rolling = ROLLING * MASS * 9.81
    time = 0.02 * np.arange(len(states))
    rate = math.sqrt(rolling * DRAG) / MASS
    scale = math.sqrt(rolling / DRAG)
    expected = scale * np.tan(math.atan(20.0 / scale) - rate * time)
    assert states[:, 0] == pytest.approx(expected, rel=1e-10)


def test_coasting_loses_the_work_of_the_resistances() -> None:
    states, _ = straight(20.0, 60.0, {})
    speed, way = states[:, 0], states[-1, 4]
    rolling = ROLLING * MASS * 9.81
    force = rolling + DRAG * speed**2
    # The way follows from m v dv = -(R + C v²) dx.
    assert way == pytest.approx(MASS / (2 * DRAG) * math.log(force[0] / force[-1]), rel=1e-9)
    lost = MASS / 2 * (speed[0] ** 2 - speed[-1] ** 2)
    assert lost == pytest.approx(rolling * way + DRAG * np.trapezoid(speed**3, dx=0.02), rel=1e-7)


def test_a_truck_that_rolls_out_comes_to_rest() -> None:
    states, _ = straight(1.0, 60.0, {})
    assert np.all(np.diff(states[:, 0]) <= 0)
    assert 0 <= states[-1, 0] < 1e-9


@pytest.mark.parametrize(("road", "creep"), [({}, 1e-6), (TILTED, 0.05)], ids=["level", "bank"])
def test_a_truck_that_rolls_out_and_is_steered_at_standstill_stays(
    road: dict[str, float], creep: float
) -> None:
    engine, count = made(), 4000
    inputs = np.stack([0.6 * np.sin(0.02 * np.arange(count)), np.zeros(count), np.zeros(count)], axis=1)
    values = truck("linear", road) | RESISTANCE
    steps = np.full(count, 0.02)
    p, parts = engine.vector(values), substeps_for(values, np.zeros(count), steps)
    states, _ = engine.simulate([[2.0, 0, 0, 0, 0, 0]], inputs, steps, [0, count], p, substeps=parts)
    assert np.max(np.abs(states[:100, 0])) > 1.5
    assert np.max(np.abs(states[-1000:, :3])) < creep


def test_rolling_resistance_and_drag_act_against_the_motion_in_reverse() -> None:
    forward, _ = straight(10.0, 20.0, {})
    backward, _ = straight(-10.0, 20.0, {})
    assert backward[:, 0] == pytest.approx(-forward[:, 0], rel=1e-12)


def test_a_slope_pulls_and_the_accelerometer_does_not_feel_it() -> None:
    no_resistance = {"rolling_resistance": 0.0, "drag": 0.0}
    states, drive = straight(5.0, 2.0, no_resistance, grade=0.05)
    assert states[-1, 0] == pytest.approx(5.0 - 9.81 * math.sin(0.05) * 2.0, rel=1e-12)
    assert np.max(np.abs(drive["longitudinal_acceleration"])) < 1e-12
    held, drive = straight(5.0, 2.0, no_resistance, force=MASS * 9.81 * math.sin(0.05), grade=0.05)
    assert held[-1, 0] == pytest.approx(5.0, rel=1e-12)
    assert drive["longitudinal_acceleration"] == pytest.approx(9.81 * math.sin(0.05), rel=1e-12)


def test_rolling_resistance_is_whole_above_the_speed_of_coming_to_rest() -> None:
    engine = made()
    p = engine.vector(truck("linear") | {"rolling_resistance": ROLLING, "drag": 0.0})
    speeds = np.array([1.0, 0.5, -1.0, -0.5]) * COMING_TO_REST * 1.001
    states = np.zeros((4, 6))
    states[:, 0] = speeds
    rates = engine.rates(states, np.zeros(3), p)[:, 0]
    full = ROLLING * 9.81
    assert rates == pytest.approx([-full, -0.5005 * full, full, 0.5005 * full], rel=1e-12)


def test_with_the_speed_it_drives_it_turns_as_the_planar_bicycle_does() -> None:
    planar, engine = compiled(bicycle("linear", "linear")), made()
    _, inputs, _, _ = segments(5, [200], 0.01)
    values = truck("linear", MOUNTED, TILTED)
    random = np.random.default_rng(4)
    states = random.normal(size=(200, 5)) * 0.2
    driven = np.concatenate([inputs[:, 1:], states], axis=1)
    forces = np.stack([inputs[:, 0], random.normal(size=200) * 1e4, np.zeros(200)], axis=1)
    arguments = (driven, forces, engine.vector(values | RESISTANCE))
    expected = (states, inputs, planar.vector(values))
    assert engine.rates(*arguments)[:, 1:] == pytest.approx(planar.rates(*expected), rel=1e-12)
    assert engine.outputs_of(*arguments)[:, 2:] == pytest.approx(planar.outputs_of(*expected), rel=1e-12)


def test_cornering_slows_the_truck_by_what_its_tyres_lose() -> None:
    engine = made()
    values = truck("linear") | {"rolling_resistance": 0.0, "drag": 0.0}
    random = np.random.default_rng(2)
    states = random.normal(size=(50, 6)) * [0, 0.8, 0.3, 1, 1, 1] + [12, 0, 0, 0, 0, 0]
    angle = random.uniform(-0.3, 0.3, 50)
    inputs = np.stack([angle, np.zeros(50), np.zeros(50)], axis=1)
    p = engine.vector(values)
    rates = engine.rates(states, inputs, p)
    out = dict(zip(engine.outputs, engine.outputs_of(states, inputs, p).T, strict=True))
    v_x, v_y, r = states[:, 0], states[:, 1], states[:, 2]
    power = MASS * (v_x * rates[:, 0] + v_y * rates[:, 1]) + 52000.0 * r * rates[:, 2]
    slide_f = (v_y + 2.38 * r) * np.cos(angle) - v_x * np.sin(angle)
    lost = out["front_lateral_force"] * slide_f + out["rear_lateral_force"] * (v_y - 2.12 * r)
    assert power == pytest.approx(lost, rel=1e-10, abs=1e-6)
