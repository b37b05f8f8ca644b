"""The kinematic bicycle: circles of the textbook, and the limit of the dynamic one at low speed."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy
from vehicle_values import AT_CG, BODY, MOUNTED, truck

from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import compiled
from ident.dynamics.kinematic import kinematic
from ident.dynamics.symbols import symbol
from ident.dynamics.system import System

DISTANCES = {name: BODY[name] for name in ("cg_to_front_axle", "cg_to_rear_axle")}
L_F, L_R = DISTANCES.values()
WHEELBASE = L_F + L_R
VALUES = DISTANCES | AT_CG | {"steering_offset": 0.0}


def test_the_rear_axle_drives_a_circle_of_wheelbase_over_tangent() -> None:
    engine = compiled(kinematic(rear_steer=True))
    angle, speed, step = 0.3, 2.0, 0.01
    radius = WHEELBASE / math.tan(angle)
    count = round(2 * math.pi * radius / speed / step)
    inputs = np.tile([angle, 0.0, speed], (count, 1))
    p = engine.vector(VALUES | {"reference_x": -L_R})
    _, outputs = engine.simulate([[0.0, L_R, 0.0]], inputs, np.full(count, step), [0, count], p)
    drive = dict(zip(engine.outputs, outputs.T, strict=True))
    distance = np.hypot(drive["position_x"], drive["position_y"] - radius)
    assert np.max(np.abs(distance - radius)) < 1e-6
    assert drive["yaw_rate"] == pytest.approx(speed / radius)
    assert drive["lateral_velocity"] == pytest.approx(0.0, abs=1e-12)


def test_yaw_rate_and_side_slip_are_those_of_the_source() -> None:
    engine = compiled(kinematic(rear_steer=True))
    front, rear, speed = 0.2, -0.07, 3.0
    slip = math.atan((L_F * math.tan(rear) + L_R * math.tan(front)) / WHEELBASE)
    along = speed * math.cos(slip)
    inputs, p = [front, rear, along], engine.vector(VALUES)
    assert engine.inputs == ("road_wheel_angle", "rear_wheel_angle", "longitudinal_velocity")
    rates = engine.rates([0.5, 0, 0], inputs, p)
    expected = speed * math.cos(slip) / WHEELBASE * (math.tan(front) - math.tan(rear))
    assert rates == pytest.approx([expected, speed * math.cos(0.5 + slip), speed * math.sin(0.5 + slip)])
    outputs = dict(zip(engine.outputs, engine.outputs_of([0.5, 0, 0], inputs, p), strict=True))
    assert outputs["lateral_velocity"] == pytest.approx(speed * math.sin(slip))
    assert outputs["lateral_acceleration"] == pytest.approx(along * expected)


def test_all_wheels_turned_alike_move_the_truck_sideways_without_turning() -> None:
    engine = compiled(kinematic(rear_steer=True))
    rates = engine.rates([0, 0, 0], [0.1, 0.1, 2.0], engine.vector(VALUES))
    assert rates == pytest.approx([0.0, 2.0, 2.0 * math.tan(0.1)])


def test_the_dynamic_bicycle_comes_closer_with_the_square_of_the_speed() -> None:
    dynamic, engine = compiled(bicycle("linear", "linear")), compiled(kinematic(rear_steer=True))
    values = truck("linear", MOUNTED)
    gaps = []
    for speed in (2.0, 1.0):
        inputs, steps = np.tile([0.02, speed], (2000, 1)), np.full(2000, 0.005)
        arguments = (inputs, steps, [0, 2000])
        slipping = dynamic.simulate(np.zeros((1, 5)), *arguments, dynamic.vector(values))[1][-1, 0]
        p = engine.vector({name: values[name] for name in engine.parameters})
        steered = np.insert(inputs, 1, 0.0, axis=1)
        rolling = engine.simulate(np.zeros((1, 3)), steered, *arguments[1:], p)[1][-1, 0]
        gaps.append(1 - slipping / rolling)
    assert 0 < gaps[1] < 1e-3
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.06)


def test_without_rear_steer_it_is_the_same_with_straight_rear_wheels() -> None:
    front, both = kinematic(), kinematic(rear_steer=True)
    assert front.inputs == ("road_wheel_angle", "longitudinal_velocity")
    straight = {symbol("at.rear_wheel_angle"): 0, symbol("rear_wheel_angle"): 0}
    for expressions, others in ((front.states, both.states), (front.outputs, both.outputs)):
        for name, expression in expressions.items():
            written = sympy.sympify(others[name]).subs(straight)
            assert sympy.simplify(unfolded(front, expression) - unfolded(both, written)) == 0


def unfolded(system: System, expression: sympy.Expr) -> sympy.Expr:
    for name, value in reversed(list(system.intermediates.items())):
        expression = sympy.sympify(expression).subs(symbol(name), value)
    return expression.subs(symbol("rear_wheel_angle"), 0)
