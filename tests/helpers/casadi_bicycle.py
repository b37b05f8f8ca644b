"""The planar bicycle written a second time, in CasADi, whose automatic differentiation is independent."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81


def tyre(kind: str, slip: ca.SX, values: dict[str, ca.SX]) -> ca.SX:
    """Axle force from the textbook's form of each kind."""
    stiffness = values["cornering_stiffness"]
    if kind == "linear":
        return stiffness * slip
    if kind == "piecewise_linear":
        edge = values["saturation_slip"]
        return ca.if_else(ca.fabs(slip) < edge, stiffness * slip, stiffness * edge * ca.sign(slip))
    peak = values["peak_force"]
    if kind == "brush":
        z = stiffness * ca.tan(slip) / (3 * peak)
        sliding = peak * ca.sign(z)
        return ca.if_else(ca.fabs(z) < 1, peak * ca.sign(z) * (1 - (1 - ca.fabs(z)) ** 3), sliding)
    shape, curvature = values["shape"], values["curvature"]
    b = stiffness / (shape * peak)
    return peak * ca.sin(shape * ca.atan(b * slip - curvature * (b * slip - ca.atan(b * slip))))


def _axle(kind: str, axle: str, slip: ca.SX, p: dict[str, ca.SX]) -> ca.SX:
    return tyre(kind, slip, {name.split(".")[1]: p[name] for name in p if name.startswith(axle)})


def model(kind: str, names: tuple[str, ...]) -> tuple[ca.Function, ca.Function]:
    """x' and the first ten outputs, valid at forward speeds above 1 m/s."""
    x, u, vector = ca.SX.sym("x", 5), ca.SX.sym("u", 2), ca.SX.sym("p", len(names))
    p = {name: vector[place] for place, name in enumerate(names)}
    v_y, r, heading = x[0], x[1], x[2]
    steer, v_x = u[0] + p["steering_offset"], u[1]
    l_f, l_r = p["cg_to_front_axle"], p["cg_to_rear_axle"]
    slip_f = steer - ca.atan((v_y + l_f * r) / v_x)
    slip_r = -ca.atan((v_y - l_r * r) / v_x)
    front, rear = _axle(kind, "front", slip_f, p), _axle(kind, "rear", slip_r, p)
    bank = p["bank_cos"] * ca.cos(heading) + p["bank_sin"] * ca.sin(heading)
    across = (front * ca.cos(steer) + rear) / p["mass"]
    turning = (l_f * front * ca.cos(steer) - l_r * rear) / p["yaw_inertia"]
    rates = ca.vertcat(
        across - GRAVITY * bank - v_x * r,
        turning,
        r,
        v_x * ca.cos(heading) - v_y * ca.sin(heading),
        v_x * ca.sin(heading) + v_y * ca.cos(heading),
    )
    outputs = ca.vertcat(
        r,
        across + p["imu_x"] * turning - p["imu_y"] * r**2,
        v_y + p["reference_x"] * r,
        heading,
        x[3] + p["reference_x"] * ca.cos(heading),
        x[4] + p["reference_x"] * ca.sin(heading),
        slip_f,
        slip_r,
        front,
        rear,
    )
    return ca.Function("f", [x, u, vector], [rates]), ca.Function("h", [x, u, vector], [outputs])


def simulate(
    kind: str, names: tuple[str, ...], start: Array, inputs: Array, step: float, p: Array
) -> tuple[Array, Array]:
    """Outputs (N, 10) of RK4 with linear inputs; derivatives (10, N, 5 + np) to start and parameters."""
    rates, outputs = model(kind, names)
    x, u, v, vector = (ca.SX.sym(n, size) for n, size in zip("xuvp", (5, 2, 2, len(names)), strict=True))
    k1 = rates(x, u, vector)
    k2 = rates(x + step / 2 * k1, (u + v) / 2, vector)
    k3 = rates(x + step / 2 * k2, (u + v) / 2, vector)
    k4 = rates(x + step * k3, v, vector)
    once = ca.Function("once", [x, u, v, vector], [x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    start_and_p = ca.MX.sym("z", 5 + len(names))
    state, found = start_and_p[:5], []
    for at in range(len(inputs)):
        found.append(outputs(state, inputs[at], start_and_p[5:]))
        if at + 1 < len(inputs):
            state = once(state, inputs[at], inputs[at + 1], start_and_p[5:])
    everything = ca.vertcat(*found)
    function = ca.Function("all", [start_and_p], [everything, ca.jacobian(everything, start_and_p)])
    values, slopes = function(np.concatenate([start, p]))
    count = len(inputs)
    return (
        np.asarray(values).reshape(count, 10),
        np.asarray(slopes.full()).reshape(count, 10, -1).transpose(1, 0, 2),
    )
