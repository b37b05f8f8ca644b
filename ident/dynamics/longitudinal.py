"""Dynamic bicycle that is driven: its longitudinal velocity is a state (2.3).

    m (v̇_x - v_y r) = F_x - F_f sin δ - C_r1 N sgn v_x - C_a v_x |v_x| - m g sin θ,      N = m g cos θ

with F_x the drive force less the brake force (at the rear wheels), θ the grade (positive uphill), C_r1 the
coefficient of rolling resistance and C_a = ½ ρ c_d A that of drag. The source writes C_r1 |v_x|: N and the
sign are restored here. The rest is the planar bicycle.

Rolling resistance falls to zero in a straight line below ``COMING_TO_REST``, so that a truck that rolls out
comes to rest; on a slope a brake has to hold it, which is a part of F_x.
"""

from __future__ import annotations

from functools import cache

import sympy
from sympy import Expr

from ident.dynamics.bicycle import (
    BODY,
    MOUNTING,
    Lateral,
    lateral_dynamics,
    measurements,
    planar_motion,
    reference_and_imu,
    tyre_parameters,
)
from ident.dynamics.bicycle import STATES as PLANAR_STATES
from ident.dynamics.constants import GRAVITY
from ident.dynamics.effects import ROAD_BANK, STEERING_OFFSET, Effect, Ports
from ident.dynamics.effects.effect import known_symbols
from ident.dynamics.reference_point import CG, moved_acceleration
from ident.dynamics.symbols import absolute, soft_sign
from ident.dynamics.system import System

COMING_TO_REST = 0.05  # [m/s] speed below which rolling resistance is not whole
STATES = ("longitudinal_velocity", *PLANAR_STATES)
INPUTS = ("road_wheel_angle", "drive_force", "grade")
RESISTANCE = ("rolling_resistance", "drag")


@cache
def driven_bicycle(
    front: str, rear: str, effects: tuple[Effect, ...] = (STEERING_OFFSET, ROAD_BANK)
) -> System:
    """Bicycle driven by a force, on a road with a grade.

    Parameters
    ----------
    front, rear : kinds of tyres, names in ``TYRES``
    effects : what enters at its ports; beside those of the planar bicycle there is longitudinal_force

    Returns
    -------
    System with the parameters of ``bicycle`` and rolling_resistance C_r1 [-], drag C_a [kg/m]; its outputs
    have longitudinal_velocity and longitudinal_acceleration as well
    """
    tyres = tyre_parameters(front, rear)
    ports = Ports(known_symbols(STATES, INPUTS, BODY, RESISTANCE, MOUNTING, tyres), effects)
    lateral = lateral_dynamics(ports, front, rear)
    known = ports.known
    along, mass = known["longitudinal_velocity"], known["mass"]
    felt = ports.through("longitudinal_force", _contact_force(ports, lateral)) / mass
    downhill = GRAVITY * sympy.sin(known["grade"])
    _, imu = reference_and_imu(known)
    measured, _ = moved_acceleration(felt, 0, known["yaw_rate"], lateral.turning, CG, imu)
    outputs = {
        "longitudinal_velocity": along,
        "longitudinal_acceleration": ports.through("measured_longitudinal_acceleration", measured),
        **measurements(ports, lateral),
        **ports.outputs(),
    }
    states = {
        "longitudinal_velocity": felt - downhill + known["lateral_velocity"] * known["yaw_rate"],
        **planar_motion(known, lateral),
        **ports.states(),
    }
    parameters = (*BODY, *RESISTANCE, *tyres, *MOUNTING, *ports.parameter_names())
    name = f"driven_bicycle_{front}_{rear}"
    inputs = (*INPUTS, *ports.inputs)
    return System(name, states, inputs, parameters, outputs, ports.intermediates)


def _contact_force(ports: Ports, lateral: Lateral) -> Expr:
    """Force along the vehicle from tyres and air [N]: all but gravity."""
    known = ports.known
    along = known["longitudinal_velocity"]
    load = known["mass"] * GRAVITY * sympy.cos(known["grade"])
    rolling = known["rolling_resistance"] * load * soft_sign(along, COMING_TO_REST)
    drag = known["drag"] * along * absolute(along)
    return known["drive_force"] - lateral.axle_forces[0] * sympy.sin(lateral.angle) - rolling - drag
