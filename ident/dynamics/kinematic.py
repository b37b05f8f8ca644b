"""Kinematic bicycle (2.1-2.2) at the centre of gravity (CG), with front and optional rear steer.

No tyre slips, so geometry alone decides:

    r = v_x (tan δ_f - tan δ_r)/L,      v_y = v_x (l_r tan δ_f + l_f tan δ_r)/L = v_x tan β

The source gives them by the speed over ground v = v_x/cos β: r = v cos β (tan δ_f - tan δ_r)/L. Good at low
speed; the error grows with the lateral acceleration, because real tyres slip.

The lateral acceleration is that of steady cornering, v_x r, at the place of the IMU: the parts that come from
how fast the angle and the speed change are left out, since a kinematic model has no inputs for them.
"""

from __future__ import annotations

from functools import cache

import sympy

from ident.dynamics.bicycle import MOUNTING, reference_and_imu
from ident.dynamics.effects import STEERING_OFFSET, Effect, Ports
from ident.dynamics.effects.effect import known_symbols
from ident.dynamics.reference_point import CG, moved_acceleration, moved_position, moved_velocity
from ident.dynamics.system import System

STATES = ("heading", "position_x", "position_y")
DISTANCES = ("cg_to_front_axle", "cg_to_rear_axle")


@cache
def kinematic(*, rear_steer: bool = False, effects: tuple[Effect, ...] = (STEERING_OFFSET,)) -> System:
    """Kinematic bicycle with the outputs of the dynamic one that it has.

    rear_steer : whether the rear wheels steer; their angle is then the input ``rear_wheel_angle``
    effects : what enters at its ports (those angles, longitudinal_velocity, measured_<signal>)
    """
    steered = ("road_wheel_angle", "rear_wheel_angle") if rear_steer else ("road_wheel_angle",)
    inputs = (*steered, "longitudinal_velocity")
    ports = Ports(known_symbols(STATES, inputs, DISTANCES, MOUNTING), effects)
    known = ports.known
    angles = [ports.through(name, known[name]) for name in steered]
    front = sympy.tan(angles[0])
    rear = sympy.tan(angles[1]) if rear_steer else sympy.Integer(0)
    l_f, l_r = known["cg_to_front_axle"], known["cg_to_rear_axle"]
    along, heading = ports.through("longitudinal_velocity", known["longitudinal_velocity"]), known["heading"]
    turn = along * (front - rear) / (l_f + l_r)
    across = along * (l_r * front + l_f * rear) / (l_f + l_r)
    cosine, sine = sympy.cos(heading), sympy.sin(heading)
    states = {
        "heading": turn,
        "position_x": along * cosine - across * sine,
        "position_y": along * sine + across * cosine,
    }
    point, imu = reference_and_imu(known)
    steady = ports.named("felt_acceleration", along * turn)
    _, felt = moved_acceleration(0, steady, turn, 0, CG, imu)
    _, drift = moved_velocity(along, across, turn, CG, point)
    x, y = moved_position((known["position_x"], known["position_y"]), cosine, sine, CG, point)
    names = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")
    read = dict(zip(names, (turn, felt, drift, heading, x, y), strict=True))
    outputs = {name: ports.through(f"measured_{name}", value) for name, value in read.items()}
    parameters = (*DISTANCES, *MOUNTING, *ports.parameter_names())
    name = "kinematic_rear_steer" if rear_steer else "kinematic"
    outputs, states = outputs | ports.outputs(), states | ports.states()
    return System(name, states, (*inputs, *ports.inputs), parameters, outputs, ports.intermediates)
