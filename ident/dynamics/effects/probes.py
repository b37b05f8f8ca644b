"""Probes: inputs that are zero in use, at each place where something that the model lacks may act.

What a small unknown p(t) at a port does to every output is the derivative to that input along p, which the
compiled model propagates exactly (``Engine.sensitivities``, ``input_derivatives``). So candidates are looked
at without compiling anything for them.

A probe of an axle's force acts before the lag of the tyre, as everything does that changes its curve. The
accelerometer feels ``probe.lateral_force``, as it feels wind, and not ``probe.bank_force``, as it does not
feel a bank. Give the probes last, after all other effects.
"""

from __future__ import annotations

from collections.abc import Callable

from sympy import Expr

from ident.dynamics.effects.effect import Change, Effect, Known

PORTS = {  # input -> port to which it is added
    "probe.road_wheel_angle": "road_wheel_angle",
    "probe.front_slip_angle": "front_working_slip",
    "probe.rear_slip_angle": "rear_working_slip",
    "probe.front_lateral_force": "front_lateral_force",
    "probe.rear_lateral_force": "rear_lateral_force",
    "probe.lateral_force": "felt_force",
    "probe.bank_force": "lateral_force",
    "probe.yaw_moment": "yaw_moment",
}
READ = {  # output -> name of what the model knows: what candidates are made of, beside its own outputs
    "steered_angle": "road_wheel_angle",
    "front_static_force": "front_lateral_force",
    "rear_static_force": "rear_lateral_force",
    "felt_acceleration": "felt_acceleration",
    "yaw_acceleration": "yaw_acceleration",
}


def _added(name: str) -> Change:
    return lambda value, known: value + known[name]


def _read(name: str) -> Callable[[Known], Expr]:
    return lambda known: known[name]


PROBES = Effect(
    "probes",
    "Y",
    (),
    {port: _added(name) for name, port in PORTS.items()},
    inputs=tuple(PORTS),
    outputs={name: _read(known) for name, known in READ.items()},
)
