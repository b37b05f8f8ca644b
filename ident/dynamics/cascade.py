"""The whole truck, from the steering request to its motion (figure 2.2.1).

    request -> dead time -> two lags -> ratio map -> bicycle

The request is a held command with its own time stamps; dead time and lags are solved exactly for it
(``second_order``), the road-wheel angle then runs linearly between the points of the grid, and the bicycle is
integrated on that grid. Derivatives to the steering parameters pass through the ratio map into the bicycle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ident.dynamics.blocks import ratio_map
from ident.dynamics.engine import Engine
from ident.dynamics.second_order import held_response

Array = NDArray[np.float64]

STEERING = ("gain", "dead_time", "sum_of_lags", "product_of_lags")


@dataclass(frozen=True)
class Request:
    """A held command: ``values`` (m,) [rad], each sent at ``times`` (m,), strictly increasing [s]."""

    times: Array
    values: Array


@dataclass(frozen=True)
class Steering:
    """The steering actuator and linkage.

    gain : K [-]; dead_time : L [s]; sum_of_lags : T1 + T2 [s]; product_of_lags : T1 T2 [s²]
    ratio : (k, 2) steering-wheel angle, rising, and road-wheel angle [rad]
    """

    gain: float
    dead_time: float
    sum_of_lags: float
    product_of_lags: float
    ratio: Array


@dataclass(frozen=True)
class SteeringResponse:
    """What the steering does at the points of a grid.

    steering_wheel_angle, steering_wheel_rate, road_wheel_angle : (n,) [rad], [rad/s], [rad]
    derivatives : (n, 4) of the road-wheel angle to ``STEERING``, at a fixed initial angle and rate
    """

    steering_wheel_angle: Array
    steering_wheel_rate: Array
    road_wheel_angle: Array
    derivatives: Array


@dataclass(frozen=True)
class Course:
    """One stretch to simulate.

    times : (n,) grid, strictly increasing [s]
    speed : (n,) longitudinal velocity at the grid [m/s]
    start : (nx,) state of the vehicle at the first point
    wheel : angle [rad] and rate [rad/s] of the steering wheel at the first point
    substeps : (n,) RK4 steps in each step of the grid, one where None
    """

    times: Array
    speed: Array
    start: Array
    wheel: tuple[float, float] = (0.0, 0.0)
    substeps: ArrayLike | None = None


def steer(request: Request, steering: Steering, times: Array, wheel: tuple[float, float]) -> SteeringResponse:
    """Response of the steering to a held request.

    times : (n,) grid [s]
    wheel : angle [rad] and rate [rad/s] of the steering wheel at the first point
    """
    lags = (steering.dead_time, steering.sum_of_lags, steering.product_of_lags)
    driven = steering.gain * request.values
    start = {"initial_angle": wheel[0], "initial_rate": wheel[1]}
    angle, rate, to_sum, to_product = held_response(*lags, request.times, driven, times, **start).T
    before = np.searchsorted(request.times + steering.dead_time, times[0], side="right") - 1
    first = slice(max(int(before), 0), max(int(before), 0) + 1)
    # What the command at the first point alone would do: it does not move with the dead time.
    _, unmoved, *_ = held_response(*lags, request.times[first], driven[first], times, **start).T
    at_rest = {"initial_angle": 0.0, "initial_rate": 0.0}
    to_gain = held_response(*lags, request.times, request.values, times, **at_rest)[:, 0]
    road, slope = ratio_map(steering.ratio, angle)
    derivatives = slope[:, None] * np.stack([to_gain, unmoved - rate, to_sum, to_product], axis=1)
    return SteeringResponse(angle, rate, road, derivatives)


def simulate(
    engine: Engine, request: Request, steering: Steering, course: Course, parameters: ArrayLike
) -> tuple[Array, Array]:
    """Motion of the truck that a request causes.

    Parameters
    ----------
    engine : of a model with the inputs road_wheel_angle and longitudinal_velocity
    parameters : (np,) of that model

    Returns
    -------
    states : (n, nx)
    outputs : (n, ny)
    """
    response = steer(request, steering, course.times, course.wheel)
    return engine.simulate(*_arguments(course, response), parameters, substeps=course.substeps)


def sensitivities(
    engine: Engine,
    request: Request,
    steering: Steering,
    course: Course,
    parameters: ArrayLike,
    *,
    active: Sequence[str],
) -> tuple[Array, Array, Array]:
    """As ``simulate``, with derivatives to initial states and ``active`` parameters.

    active : names of parameters of the model and of ``STEERING``, in the order of the last axis

    Returns
    -------
    states : (n, nx)
    outputs : (n, ny)
    derivatives : (ny, n, nx + len(active))
    """
    response = steer(request, steering, course.times, course.wheel)
    chain = np.zeros((course.times.size, len(engine.inputs), len(active)))
    for column, name in enumerate(active):
        if name in STEERING:
            place = engine.inputs.index("road_wheel_angle")
            chain[:, place, column] = response.derivatives[:, STEERING.index(name)]
    return engine.sensitivities(
        *_arguments(course, response),
        parameters,
        active=active,
        substeps=course.substeps,
        input_derivatives=chain,
    )


def _arguments(course: Course, response: SteeringResponse) -> tuple[Array, Array, Array, list[int]]:
    """Starts, inputs, steps and offsets of one segment."""
    inputs = np.stack([response.road_wheel_angle, course.speed], axis=1)
    steps = np.append(np.diff(course.times), 0.0)
    return course.start[None, :], inputs, steps, [0, course.times.size]
