"""What a controller predicts with: the bicycle of ``dynamics``, its steering, its drive and the road.

Composed of the Systems that are fitted to the logs, so that nothing about the truck is written twice:

    request -> two lags -> ratio map -> bicycle or kinematic -> errors from the road (METHODS section 5)

    ṡ = (v_x cos e_ψ - v_y sin e_ψ)/(1 - k e_y),   ė_y = v_x sin e_ψ + v_y cos e_ψ,   ė_ψ = r - k ṡ

with v_y that of the tracked point. In space every rate is divided by ṡ, and time is a state in the place of
the arc length: dx/ds = ẋ/ṡ, dt/ds = 1/ṡ. Valid while 1 - k e_y > 0 and ṡ > 0.

With curvature zero the road is the x axis: arc length, lateral error and heading error are then x, y and
heading, which is how commands on their way are predicted over (``estimator``).

Dead times are not part of the model: a request is one that takes effect now. Disturbances are inputs that are
held: what the truck does and the model does not know, estimated in ``estimator``.

Effects of the truck with states of their own (relaxation, roll), with a heading (bank) and of sensors are
left out: their constant part is found as a disturbance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray
from sympy import Expr

from ident.control.linear import held_step
from ident.control.many_points import ManyPoints
from ident.control.truck import Truck
from ident.dynamics.actuator import actuator
from ident.dynamics.bicycle import bicycle
from ident.dynamics.blocks import ratio_map
from ident.dynamics.effects import LOAD_TRANSFER, STEERING_OFFSET, STEERING_RATIO_NONLINEARITY, Effect
from ident.dynamics.engine import Engine, compiled
from ident.dynamics.kinematic import kinematic
from ident.dynamics.symbols import symbol
from ident.dynamics.system import System

Array = NDArray[np.float64]
Domain = Literal["time", "space"]

KINEMATIC = "kinematic"
EFFECTS = (STEERING_OFFSET, STEERING_RATIO_NONLINEARITY, LOAD_TRANSFER)
SHORTEST_LAG = 0.005  # [s] of steering and drive; a shorter one is as good as none
CONTROLS = ("steering_request", "acceleration_request")
SURROUNDINGS = ("curvature", "ratio_slope", "ratio_offset")
DISTURBANCES = {
    "steering_disturbance": "added to the steering request [rad]",
    "drive_disturbance": "added to the acceleration request [m/s²]",
    "lateral_disturbance": "lateral acceleration beside that of the tyres [m/s²]",
    "yaw_disturbance": "yaw acceleration beside that of the tyres [rad/s²]",
    "drift": "lateral velocity of the tracked point beside that of the model [m/s]",
    "turn_drift": "rate of the heading beside the yaw rate [rad/s]",
}
OF_BICYCLE = ("lateral_disturbance", "yaw_disturbance")
PARAMETERS = ("gain", "time_constant_1", "time_constant_2", "drive_lag")


def in_time(model: str, effects: tuple[Effect, ...] = ()) -> System:
    """Rates to time of [arc_length, (lateral_velocity, yaw_rate,) lateral_error, heading_error,
    steering_angle, steering_rate, longitudinal_velocity, longitudinal_acceleration].

    Parameters
    ----------
    model : kinematic, or the kind of the tyres of both axles
    effects : of ``EFFECTS``

    Returns
    -------
    System with the inputs ``CONTROLS``, ``SURROUNDINGS`` and those of ``DISTURBANCES`` that the model has;
    its parameter reference_x is the tracked point, forward of the centre of gravity [m]
    """
    return _composed(model, effects, "time")


def in_space(model: str, effects: tuple[Effect, ...] = ()) -> System:
    """As ``in_time``, rates to arc length; the first state is the time."""
    return _composed(model, effects, "space")


@cache
def _composed(model: str, effects: tuple[Effect, ...], domain: Domain) -> System:
    is_kinematic = model == KINEMATIC
    vehicle = kinematic(effects=effects) if is_kinematic else bicycle(model, model, effects)
    disturbances = [name for name in DISTURBANCES if not (is_kinematic and name in OF_BICYCLE)]
    motion = {} if is_kinematic else _disturbed_motion(vehicle)
    drift = {"at.drifting": vehicle.outputs["lateral_velocity"] + symbol("drift")}
    turning = {"at.turning": vehicle.outputs["yaw_rate"] + symbol("turn_drift")}
    progress, errors = _errors(symbol("at.drifting"), symbol("at.turning"))
    states = {"arc_length": symbol("at.progress"), **motion, **errors, **_steering(), **_drive()}
    angle = symbol("ratio_offset") + symbol("ratio_slope") * symbol("steering_angle")
    known = {"road_wheel_angle": angle, **vehicle.intermediates, **drift, **turning, "at.progress": progress}
    if domain == "space":
        others = list(states.items())[1:]
        states = {"time": 1 / symbol("at.progress")} | {n: rate / symbol("at.progress") for n, rate in others}
    inputs = (*CONTROLS, *SURROUNDINGS, *disturbances)
    outputs = {"road_wheel_angle": symbol("road_wheel_angle"), "progress": symbol("at.progress")}
    known = _needed(known, states)
    parameters = (*PARAMETERS, *vehicle.parameters)
    return System(f"{vehicle.name}_in_{domain}", states, inputs, parameters, outputs, known)


def _disturbed_motion(vehicle: System) -> dict[str, Expr]:
    return {
        "lateral_velocity": vehicle.states["lateral_velocity"] + symbol("lateral_disturbance"),
        "yaw_rate": vehicle.states["yaw_rate"] + symbol("yaw_disturbance"),
    }


def _errors(drifting: Expr, turning: Expr) -> tuple[Expr, dict[str, Expr]]:
    """ṡ, and the rates of both errors.

    drifting, turning : lateral velocity of the tracked point, and yaw rate
    """
    along, curvature, aside, heading = (
        symbol(name) for name in ("longitudinal_velocity", "curvature", "lateral_error", "heading_error")
    )
    cosine, sine = sympy.cos(heading), sympy.sin(heading)
    progress = (along * cosine - drifting * sine) / (1 - curvature * aside)
    rates = {
        "lateral_error": along * sine + drifting * cosine,
        "heading_error": turning - curvature * symbol("at.progress"),
    }
    return progress, rates


def _steering() -> dict[str, Expr]:
    """Rates of the steering, in the names of a truck whose request may be one of the road wheels."""
    lags = actuator()
    names = {
        symbol("steering_wheel_angle"): symbol("steering_angle"),
        symbol("steering_wheel_rate"): symbol("steering_rate"),
        symbol("steering_wheel_request"): symbol("steering_request") + symbol("steering_disturbance"),
    }
    angle, rate = (lags.states[n].xreplace(names) for n in ("steering_wheel_angle", "steering_wheel_rate"))
    return {"steering_angle": angle, "steering_rate": rate}


def _drive() -> dict[str, Expr]:
    reached = symbol("longitudinal_acceleration")
    asked = symbol("acceleration_request") + symbol("drive_disturbance")
    return {
        "longitudinal_velocity": reached,
        "longitudinal_acceleration": (asked - reached) / symbol("drive_lag"),
    }


def _needed(known: dict[str, Expr], states: dict[str, Expr]) -> dict[str, Expr]:
    """The values on the way that the rates use, directly or through another."""
    used = set().union(*(sympy.sympify(rate).free_symbols for rate in states.values()))
    kept: dict[str, Expr] = {}
    for name, value in reversed(known.items()):
        if symbol(name) in used:
            kept[name] = value
            used |= value.free_symbols
    return dict(reversed(kept.items()))


@dataclass(frozen=True)
class Stages:
    """x_(k+1) = A_k x_k + B_k u_k + c_k about a course, exact for requests that are held.

    A : (N, nx, nx); B : (N, nx, 2), to ``CONTROLS``; c : (N, nx)
    """

    A: Array
    B: Array
    c: Array


class Prediction:
    """A truck as it is believed to be, ready to be predicted and linearised.

    states, disturbances : names, in the order of every array
    index : name of a state -> its place
    mean_ratio : angle of the road wheels by that of the steering, over the whole table [-]
    """

    def __init__(self, truck: Truck, domain: Domain) -> None:
        effects = tuple(effect for effect in EFFECTS if effect.name in truck.effects)
        kind = KINEMATIC if truck.model == KINEMATIC else truck.model
        system = in_time(kind, effects) if domain == "time" else in_space(kind, effects)
        self.truck = truck
        self.engine: Engine = compiled(system)
        self._points = ManyPoints(self.engine)
        self.states = self.engine.states
        self.disturbances = self.engine.inputs[len(CONTROLS) + len(SURROUNDINGS) :]
        self.index = {name: place for place, name in enumerate(self.states)}
        self._values = self.engine.vector(_parameters(truck, effects, self.engine.parameters))
        self._tracked = self.engine.parameters.index("reference_x")
        table = np.asarray(truck.steering.ratio, dtype=np.float64)
        slopes = np.diff(table[:, 1]) / np.diff(table[:, 0])
        self.mean_ratio = float((table[-1, 1] - table[0, 1]) / (table[-1, 0] - table[0, 0]))
        self.is_ratio_bent = bool(np.ptp(slopes) > 0)
        self._ratio = table
        self._line = float(slopes[0]), float(table[0, 1] - slopes[0] * table[0, 0])

    def parameters(self, tracked_x: float) -> Array:
        """(np,) of the model that tracks a point this far forward of the centre of gravity [m]."""
        values = self._values.copy()
        values[self._tracked] = tracked_x
        return values

    def inputs(self, controls: ArrayLike, curvature: ArrayLike, angle: Array, disturbance: Array) -> Array:
        """Rows of inputs, with the ratio map as it is at a steering angle.

        Parameters
        ----------
        controls : (..., 2) requests [rad], [m/s²], which take effect at once
        curvature : (...,) [1/m]
        angle : (...,) before the ratio map [rad]
        disturbance : (nd,) in the order of ``disturbances``

        Returns
        -------
        (..., nu)
        """
        rows = np.empty((*np.shape(angle), len(self.engine.inputs)))
        rows[..., :2] = controls
        rows[..., 2] = curvature
        rows[..., 3], rows[..., 4] = self._line
        if self.is_ratio_bent:
            value, slope = ratio_map(self._ratio, angle)
            rows[..., 3], rows[..., 4] = slope, value - slope * angle
        rows[..., 5:] = disturbance
        return rows

    def rates(self, states: Array, inputs: Array, tracked_x: float) -> Array:
        """Rates of the states, to time or to arc length: (..., nx), (..., nu) -> (..., nx)."""
        return self.engine.rates(states, inputs, self.parameters(tracked_x))

    def jacobians(self, states: Array, inputs: Array, tracked_x: float) -> tuple[Array, Array, Array]:
        """Rates (..., nx) and their exact derivatives to states (..., nx, nx) and inputs (..., nx, nu)."""
        values = self.parameters(tracked_x)
        if states.ndim == 2:
            return self._points.jacobians(states, inputs, values)
        to_states, to_inputs, _ = self.engine.jacobians(states, inputs, values)
        return self.engine.rates(states, inputs, values), to_states, to_inputs

    def linearised(self, states: Array, inputs: Array, steps: Array, tracked_x: float) -> Stages:
        """The model about a course, discretised exactly.

        Parameters
        ----------
        states : (N, nx) at which to linearise; inputs : (N, nu), see ``inputs``
        steps : (N,) [s], or [m] in space
        tracked_x : of the tracked point, forward of the centre of gravity [m]
        """
        rates, A, to_inputs = self.jacobians(states, inputs, tracked_x)
        B = np.ascontiguousarray(to_inputs[..., :2])
        rest = rates - np.einsum("kij,kj->ki", A, states) - np.einsum("kij,kj->ki", B, inputs[:, :2])
        return Stages(*held_step(A, B, rest, steps))


def _parameters(truck: Truck, effects: tuple[Effect, ...], wanted: tuple[str, ...]) -> dict[str, float]:
    """All parameters of the model, by name; where the sensors are does not matter to it."""
    steering = truck.steering
    values = {
        **dict.fromkeys(("reference_x", "imu_x", "imu_y"), 0.0),
        **truck.parameters,
        "gain": steering.gain,
        "time_constant_1": max(steering.time_constant_1, SHORTEST_LAG),
        "time_constant_2": max(steering.time_constant_2, SHORTEST_LAG),
        "drive_lag": max(truck.drive.lag, SHORTEST_LAG),
    }
    for effect in effects:
        given = dict(truck.effects[effect.name])
        if effect is STEERING_OFFSET and "angle" in given:
            given[STEERING_OFFSET.parameter_names[0]] = given["angle"]
        for parameter in (*effect.parameters, *effect.given):
            known = [name for name in (parameter.name, parameter.name.rpartition(".")[2]) if name in given]
            values[parameter.name] = given[known[0]] if known else parameter.typical
    return {name: values[name] for name in wanted}
