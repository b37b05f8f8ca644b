"""What a run of the closed loop is judged by (METHODS section 5).

All means are over time, each step of the integration by its length. Lateral acceleration is what tyres give
at the centre of gravity, F_y/m; jerk and the rate of the road wheels are difference quotients
on the grid of the integration. Counts have a band, so that noise does not count:

- a switch of the drive is a change between braking and accelerating by more than ``DRIVE_BAND``
- a reversal of the steering is a turn of the road wheels back by more than ``REVERSAL_BAND`` after one forth
  by more than that (the gap of SAE J2944's steering reversal rate)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ident.control.closed_loop import ClosedLoop, Outcome
from ident.control.truck import Truck
from ident.results.validate import ClosedLoopRun, ControllerName, Measures, ScenarioName

Array = NDArray[np.float64]

SETTLED = 1.0  # [s] at the end, over which the settled error is the mean
DRIVE_BAND = 0.05  # [m/s²]
REVERSAL_BAND = 0.002  # [rad] of the road wheels
VIOLATED = 1e-6  # of a limit, beyond which a planned violation counts
QUANTILES = (0.5, 0.95, 0.99)


@dataclass(frozen=True)
class Limits:
    """What a run should keep to; None where it does not matter.

    lateral_error : of the tracked point [m]; lateral_acceleration : [m/s²]
    steering_rate : of the road wheels [rad/s]
    """

    lateral_error: float | None = None
    lateral_acceleration: float | None = None
    steering_rate: float | None = None


@dataclass(frozen=True)
class Label:
    """What a run is a run of, for the results.

    speed : of the scenario [m/s]
    prediction_model, simulation_model : see ``model_name``; mismatch : of the simulated truck, as changed
    scenario_run : the logged run whose path was followed; seed : of the draw
    """

    scenario: ScenarioName
    speed: float
    prediction_model: str
    simulation_model: str
    mismatch: Mapping[str, float] | None = None
    scenario_run: str | None = None
    seed: int | None = None


def model_name(truck: Truck) -> str:
    """Kind of tyres, or kinematic, "+" and the effects."""
    return "+".join([truck.model, *truck.effects])


LOST: dict[Outcome, str] = {
    "left_the_lane": "left the lane",
    "folded": "came to the centre of the path's curvature",
    "blew_up": "its motion is no longer one of a truck",
    "too_late": "took far longer than stipulated",
    "no_command": "the command is no number",
}
"""Outcome of a run that did not come to the end of the path -> how it is told."""


def told(loop: ClosedLoop, label: Label, limits: Limits | None = None) -> ClosedLoopRun:
    """A run as the results tell it; the start is told only where it was disturbed."""
    start = {name: getattr(loop.disturbance, name) for name in loop.disturbance.__dataclass_fields__}
    disturbance = {name: size for name, size in start.items() if size != 0.0} | dict(label.mismatch or {})
    return ClosedLoopRun(
        controller=cast("ControllerName", loop.controller),
        scenario=label.scenario,
        speed=label.speed,
        disturbance=disturbance,
        prediction_model=label.prediction_model,
        simulation_model=label.simulation_model,
        scenario_run=label.scenario_run,
        seed=label.seed,
        lost=LOST.get(loop.outcome),
        **asdict(measure(loop, limits)),
    )


def measure(loop: ClosedLoop, limits: Limits | None = None) -> Measures:
    """All measures of a run; of one that blew up, those of what came before."""
    loop_states = np.array([*loop.states.values(), loop.lateral_error, loop.heading_error])
    bad = np.flatnonzero(~np.all(np.isfinite(loop_states), axis=0))
    count = int(bad[0]) if bad.size else loop.times.size
    times, left = loop.times[:count], loop.lateral_error[:count]
    values = {name: column[:count] for name, column in loop.states.items()}
    rate = quotient(times, values["road_wheel_angle"])
    jerk = quotient(times, values["lateral_acceleration"])
    braking, driving = works(times, values["longitudinal_acceleration"], values["longitudinal_velocity"])
    duration = float(times[-1] - times[0])
    reversals = turns(values["road_wheel_angle"], REVERSAL_BAND)
    solve = [one.solve_time for one in loop.diagnostics]
    p50, p95, p99 = (float(one) for one in np.quantile(solve, QUANTILES))
    stipulated = float(loop.reference.time[-1])
    return Measures(
        completed=loop.completed,
        lateral_error_rms=rms(times, left),
        lateral_error_p95=quantile(times, np.abs(left), 0.95),
        lateral_error_max=float(np.max(np.abs(left))),
        lateral_error_settled=settled(times, left),
        heading_error_rms=rms(times, loop.heading_error[:count]),
        arrival_time_error=None if loop.arrival_time is None else loop.arrival_time - stipulated,
        braking_work=braking,
        acceleration_work=driving,
        drive_switches=switches(values["longitudinal_acceleration"], DRIVE_BAND),
        lateral_acceleration_max=float(np.max(np.abs(values["lateral_acceleration"]))),
        lateral_jerk_rms=rms_of_steps(times, jerk),
        steering_rate_rms=rms_of_steps(times, rate),
        steering_rate_max=float(np.max(np.abs(rate), initial=0.0)),
        steering_reversals=reversals / duration if duration > 0 else 0.0,
        violations=violations(loop, limits or Limits(), times, left, values, rate),
        infeasible=sum(not one.solved for one in loop.diagnostics),
        solve_time_p50=p50,
        solve_time_p95=p95,
        solve_time_p99=p99,
        deadline_misses=sum(time > loop.period for time in solve),
    )


def mean(times: Array, values: Array) -> float:
    """Mean over time, linear between the points: times (n,) [s], values (n,)."""
    duration = times[-1] - times[0]
    return float(np.trapezoid(values, times) / duration) if duration > 0 else float(values[-1])


def rms(times: Array, values: Array) -> float:
    """Root of the mean square over time, of values that run linearly between the points."""
    duration = times[-1] - times[0]
    if duration <= 0:
        return float(abs(values[-1]))
    first, last = values[:-1], values[1:]
    return float(np.sqrt(np.sum(np.diff(times) * (first**2 + first * last + last**2) / 3) / duration))


def rms_of_steps(times: Array, values: Array) -> float:
    """Root of the mean square of values (n - 1,) that hold from one of the times (n,) to the next."""
    duration = times[-1] - times[0]
    return float(np.sqrt(np.sum(np.diff(times) * values**2) / duration)) if duration > 0 else 0.0


def quantile(times: Array, values: Array, share: float) -> float:
    """The value that is not exceeded during a share of the time; each step counts by its middle value."""
    if values.size < 2:
        return float(values[-1])
    middle = (values[:-1] + values[1:]) / 2
    order = np.argsort(middle)
    spent = np.cumsum(np.diff(times)[order])
    return float(middle[order][np.searchsorted(spent, share * spent[-1])])


def settled(times: Array, values: Array) -> float:
    """Mean over the last ``SETTLED`` seconds, or all where there are less; it keeps its sign."""
    begin = max(times[-1] - SETTLED, times[0])
    kept = times > begin
    first = float(np.interp(begin, times, values))
    return mean(np.append(begin, times[kept]), np.append(first, values[kept]))


def quotient(times: Array, values: Array) -> Array:
    """(n - 1,) rate of change from each point to the next."""
    return np.asarray(np.diff(values) / np.diff(times))


def works(times: Array, acceleration: Array, speed: Array) -> tuple[float, float]:
    """Work of braking and of accelerating per mass, ∫ |a| v dt over the time of each [J/kg]."""
    power = acceleration * speed
    braking = np.trapezoid(np.maximum(-power, 0.0), times)
    return float(braking), float(np.trapezoid(np.maximum(power, 0.0), times))


def switches(values: Array, band: float) -> int:
    """Changes of sign of what is beyond the band on either side."""
    side = np.sign(values[np.abs(values) > band])
    return int(np.count_nonzero(np.diff(side)))


def turns(values: Array, band: float) -> int:
    """Turning points of a signal, those of less than the band left out."""
    if not values.size:
        return 0
    count, direction, extreme, low, high = 0, 0, values[0], values[0], values[0]
    for value in values.tolist():
        if direction == 0:
            low, high = min(low, value), max(high, value)
            if high - low > band:
                direction, extreme = (1, high) if value == high else (-1, low)
        elif (value - extreme) * direction > 0:
            extreme = value
        elif (extreme - value) * direction > band:
            count, direction, extreme = count + 1, -direction, value
    return count


def violations(
    loop: ClosedLoop, limits: Limits, times: Array, left: Array, values: Mapping[str, Array], rate: Array
) -> int:
    """Cycles in which a limit was exceeded, or in which the plan of the controller says that it will be."""
    beyond = np.zeros(times.size, dtype=bool)
    if limits.lateral_error is not None:
        beyond |= np.abs(left) > limits.lateral_error
    if limits.lateral_acceleration is not None:
        beyond |= np.abs(values["lateral_acceleration"]) > limits.lateral_acceleration
    if limits.steering_rate is not None:
        beyond[1:] |= np.abs(rate) > limits.steering_rate
    cycle = np.clip(np.searchsorted(loop.cycles, times, side="left") - 1, 0, loop.cycles.size - 1)
    found = np.array([one.violation > VIOLATED for one in loop.diagnostics])
    found[cycle[beyond]] = True
    return int(np.count_nonzero(found))
