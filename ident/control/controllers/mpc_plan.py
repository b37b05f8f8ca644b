"""The problem of a predictive controller: a grid ahead, the course to linearise about, and its values.

The model is linearised about the last plan, moved on to the new grid (LTV); where there is none, and beyond
its end, about the goals. The goals are steady states one after another; their steering moves from each to the
next, and their requests lead it by the lags. All values of the program are deviations ζ = ξ - goal, so that
neither the arc length of a long path nor the time of day enters the arithmetic:

    ζ_(k+1) = A_k ζ_k + B_k (Δu_k - Δw_k) + [A_k g_k + B_k Δw_k + c_k - g_(k+1)],  w: requests of the goals

In time the grid is even in time, and the arc length is a state; in space it is even in arc length, and time
is a state: the first state is what the other domain measures progress by, and its goal is the stipulated one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.mpc_model import Augmented, augmented
from ident.control.controllers.targets import Targets
from ident.control.prediction import Domain, Prediction

Array = NDArray[np.float64]

SLOWEST = 1.0  # [m/s] for which a step in space is made


@dataclass(frozen=True)
class Outlook:
    """What is planned from.

    time : at which the first request takes effect [s]; arc_length : then [m]
    state : (nx,) then, in the order of ``Prediction.states`` of the planner's own domain
    previous : (2,) requests in force before; disturbance : (nd,)
    """

    time: float
    arc_length: float
    state: Array
    previous: Array
    disturbance: Array


@dataclass(frozen=True)
class Course:
    """States along a grid: what is linearised about, or what was planned.

    grid : (N + 1,) time [s] or arc length [m]
    states : (N + 1, nx); controls : (N, 2) requests
    """

    grid: Array
    states: Array
    controls: Array


@dataclass(frozen=True)
class Ahead:
    """The linear model along a course, with its goals.

    steps : (N,) in the unit of the grid; durations : (N,) [s] by the course
    arc_lengths : (N + 1,) of the course [m]
    goals : (N + 1, n) of ξ; changes : (N, 2) of the requests of the goals
    model : of ζ; start : (n,) ζ_0
    """

    course: Course
    steps: Array
    durations: Array
    arc_lengths: Array
    goals: Array
    changes: Array
    model: Augmented
    start: Array


class Planner:
    """Grid, course and linear model of one controller.

    duration : of a step [s]; in space a step is as long as the truck takes this for at its speed now
    """

    def __init__(self, prediction: Prediction, domain: Domain, horizon: int, duration: float) -> None:
        self.prediction, self.domain = prediction, domain
        self.horizon, self.duration = horizon, duration
        self._speed = prediction.index["longitudinal_velocity"]

    def ahead(self, outlook: Outlook, targets: Targets, last: Course | None) -> Ahead:
        """All that the program of this cycle needs."""
        grid = self._grid(outlook)
        arc_lengths = self._arc_lengths(grid, outlook, last)
        middles = 0.5 * (arc_lengths[:-1] + arc_lengths[1:])
        points = np.append(arc_lengths, middles)
        disturbance = outlook.disturbance + targets.missing(points)
        goals = targets.at(points, disturbance)
        count = self.horizon + 1
        wanted = np.hstack([goals.states[:count], goals.controls[:count]])
        wanted[:, 0] = targets.time(grid) if self.domain == "space" else targets.arc_length(grid)
        self._lead(wanted, np.diff(arc_lengths))
        course = self._course(grid, outlook, wanted, arc_lengths, last)
        steps = np.diff(grid)
        angle = course.states[:-1, self.prediction.index["steering_angle"]]
        inputs = self.prediction.inputs(course.controls, goals.curvature[count:], angle, disturbance[count:])
        tracked_x = targets.reference.tracked_x
        stages = self.prediction.linearised(course.states[:-1], inputs, steps, tracked_x)
        return self._deviations(course, arc_lengths, wanted, augmented(stages.A, stages.B, stages.c), outlook)

    def _grid(self, outlook: Outlook) -> Array:
        counts = np.arange(self.horizon + 1)
        if self.domain == "time":
            return np.asarray(outlook.time + self.duration * counts)
        step = self.duration * max(float(outlook.state[self._speed]), SLOWEST)
        return np.asarray(outlook.arc_length + step * counts)

    def _arc_lengths(self, grid: Array, outlook: Outlook, last: Course | None) -> Array:
        if self.domain == "space":
            return grid
        if last is None:
            straight: Array = outlook.arc_length + float(outlook.state[self._speed]) * (grid - grid[0])
            return straight
        planned = np.interp(grid, last.grid, last.states[:, 0])
        beyond = np.maximum(grid - last.grid[-1], 0.0) * last.states[-1, self._speed]
        found: Array = planned + beyond + outlook.arc_length - planned[0]
        return found

    def _lead(self, wanted: Array, ways: Array) -> None:
        """Let the steering of the goals move: its rate, and the requests ahead of it by the lags.

        wanted : (N + 1, n) steady states and requests, changed in place; ways : (N,) between them [m]
        """
        place, steering = self.prediction.index, self.prediction.truck.steering
        speed = np.maximum(wanted[:, self._speed], SLOWEST)
        passed = np.concatenate([[0.0], np.cumsum(ways / (0.5 * (speed[:-1] + speed[1:])))])
        if np.any(np.diff(passed) <= 0.0):
            return
        rate = np.gradient(wanted[:, place["steering_angle"]], passed)
        wanted[:, place["steering_rate"]] = rate
        size = len(self.prediction.states)
        wanted[:, size] += (steering.time_constant_1 + steering.time_constant_2) / steering.gain * rate
        wanted[:-1, size:] = 0.5 * (wanted[:-1, size:] + wanted[1:, size:])

    def _course(
        self, grid: Array, outlook: Outlook, wanted: Array, arc_lengths: Array, last: Course | None
    ) -> Course:
        """What is linearised about: the last plan on the new grid, the goals where there is none."""
        size = len(self.prediction.states)
        states, controls = wanted[:, :size].copy(), wanted[:-1, size:].copy()
        if last is not None:
            known = grid <= last.grid[-1]
            states[known] = _on_grid(grid[known], last.grid, last.states)
            middles = 0.5 * (grid[:-1] + grid[1:])
            held = np.clip(np.searchsorted(last.grid, middles) - 1, 0, self.horizon - 1)
            within = middles <= last.grid[-1]
            controls[within] = last.controls[held[within]]
        if self.domain == "time":
            states[:, 0] = arc_lengths
        states[0] = outlook.state
        return Course(grid, states, controls)

    def _deviations(
        self, course: Course, arc_lengths: Array, wanted: Array, model: Augmented, outlook: Outlook
    ) -> Ahead:
        """Goals and model of ζ; the requests that a goal holds are those in force before its point."""
        size = len(self.prediction.states)
        goals = wanted.copy()
        goals[1:, size:] = wanted[:-1, size:]
        goals[0, size:] = 2.0 * wanted[0, size:] - wanted[1, size:]
        changes = np.diff(goals[:, size:], axis=0)
        carried = np.einsum("kij,kj->ki", model.A, goals[:-1]) + np.einsum("kij,kj->ki", model.B, changes)
        rest = carried + model.c - goals[1:]
        start = np.concatenate([outlook.state, outlook.previous]) - goals[0]
        steps = np.diff(course.grid)
        durations = steps if self.domain == "time" else self._durations(course, steps)
        linear = Augmented(model.A, model.B, rest)
        return Ahead(course, steps, durations, arc_lengths, goals, changes, linear, start)

    def _durations(self, course: Course, steps: Array) -> Array:
        """(N,) what the course takes for its steps in space [s]; the first is a step of time itself."""
        speed = course.states[:, self._speed]
        durations = steps / np.maximum(0.5 * (speed[:-1] + speed[1:]), SLOWEST)
        durations[0] = self.duration
        return durations

    def planned(self, ahead: Ahead, deviations: Array, changes: Array) -> Course:
        """The plan as a course: ζ (N + 1, n) and Δu - Δw (N, 2) turned back."""
        size = len(self.prediction.states)
        found = deviations + ahead.goals
        controls = found[0, size:] + np.cumsum(changes + ahead.changes, axis=0)
        return Course(ahead.course.grid, found[:, :size], controls)

    def reached(self, last: Course, outlook: Outlook) -> tuple[Array, Array, Array]:
        """Where a plan has come to by now.

        Returns
        -------
        state : (nx,) of the plan
        before, from_now_on : (2,) its requests before this moment and after it
        """
        here = outlook.time if self.domain == "time" else outlook.arc_length
        step = last.grid[1] - last.grid[0]
        place = min(max(round(float((here - last.grid[0]) / step)), 0), self.horizon - 1)
        state = _on_grid(np.array([here]), last.grid, last.states)[0]
        return state, last.controls[max(place - 1, 0)], last.controls[place]


def _on_grid(grid: Array, known: Array, values: Array) -> Array:
    """Rows of a table (n, m) between its points, held before the first."""
    place = np.clip(np.searchsorted(known, grid, side="right") - 1, 0, known.size - 2)
    share = np.clip((grid - known[place]) / (known[place + 1] - known[place]), 0.0, 1.0)[:, None]
    found: Array = (1.0 - share) * values[place] + share * values[place + 1]
    return found
