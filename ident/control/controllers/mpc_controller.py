"""Linear time-varying model predictive control (LTV-MPC) on the prediction model, in time or in space.

Each cycle: where the truck will be when a request takes effect (``base``), the model about the last plan
(``mpc_plan``), one quadratic program (``qp``), the first request of its plan. Angle and acceleration requests
have hard limits, and the rate of the steering where the controller is told to keep one; the lane is a soft
limit of the lateral error, since a truck that is outside must come back and not give up.

Where the program fails, which is counted: the last plan goes on for up to ``PATIENCE`` cycles, after that
the regulator of the terminal cost (an LQR with the feed-forward of the goals) steers; without a finite state
the requests stay as they are.

With a tube the plan is that of a nominal truck whose limits are tightened by what disturbances can do, and
the request holds the truck in the tube about it (Mayne, Seron and Raković, Automatica 41, 2005):

    Δu = Δv_0 - K (ξ - z)

The nominal truck follows its own plan, and begins anew at the truck itself where that has left the tube.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ident.control.controllers.base import Base, Situation
from ident.control.controllers.controller import Command, Diagnostics, Measured
from ident.control.controllers.mpc_model import REQUESTS, Terminal, Weights, terminal
from ident.control.controllers.mpc_plan import Ahead, Course, Outlook, Planner
from ident.control.controllers.mpc_tubes import LEAST_LEFT, Tubes
from ident.control.controllers.targets import Targets
from ident.control.controllers.weights import ACCEPTABLE
from ident.control.prediction import Domain, Prediction
from ident.control.qp import Layout, QuadraticProgram, Solver, StagedProgram, Stages
from ident.control.reference import Reference
from ident.control.truck import Truck

Array = NDArray[np.float64]

DRIFTS = ("drift", "turn_drift")
PATIENCE = 10  # cycles that a plan is followed on without a new one
# Price of a metre beside the lane, a step: about that of the lane's edge itself. Much more and the truck is
# driven back so hard from outside that it swings where its steering answers later than believed.
SLACK_LINEAR, SLACK_QUADRATIC = 1.0, 1.0  # [1/m], [1/m²]; see ``qp``


@dataclass(frozen=True)
class Settings:
    """What distinguishes one predictive controller from another.

    domain : time or space
    horizon : steps ahead; one step is one period, in space the way of one period at the speed of the moment
    lane : half width that the tracked point may use [m]
    steering_rate : limit of the request's rate, as one of the road wheels [rad/s]; None where there is none
    acceptable : deviations, see ``weights``
    slowness : time in which a drift that was estimated is believed [s]
    """

    domain: Domain
    horizon: int = 40
    lane: float = 1.0
    steering_rate: float | None = None
    slowness: float = 0.0
    acceptable: Mapping[str, float] = field(default_factory=lambda: dict(ACCEPTABLE))


class Mpc:
    """One predictive controller.

    truck : as it is believed to be; period : [s]
    tubes : sets of the error about the nominal truck, against speed; None for a controller without
    keep : called with each program before it is solved, such as ``qp_store.keeper``
    failures : programs without a solution since the last reset; program : the last one
    """

    def __init__(
        self,
        name: str,
        truck: Truck,
        period: float,
        settings: Settings,
        *,
        tubes: Callable[[Prediction, Terminal], Tubes] | None = None,
        keep: Callable[[QuadraticProgram], None] | None = None,
    ) -> None:
        self.name, self.period, self.settings, self.keep = name, period, settings, keep
        self.base = Base(truck, period)
        prediction = self.base.prediction if settings.domain == "time" else Prediction(truck, "space")
        self.prediction, self._place = prediction, prediction.index
        self.weights = dict(settings.acceptable)
        self._weights = Weights(prediction, settings.acceptable)
        self._planner = Planner(prediction, settings.domain, settings.horizon, period)
        self._aside = prediction.index["lateral_error"]
        size = len(prediction.states) + REQUESTS
        self._staged = StagedProgram(Layout(settings.horizon, size, REQUESTS, (self._aside,)))
        self._solver = Solver()
        self._make_tubes = tubes
        self._tubes: Tubes | None = None
        self._terminal: Terminal | None = None
        self._tracked_x = np.nan
        self.reset()

    def reset(self) -> None:
        """Forget all runs before."""
        self.base.reset()
        self._targets: Targets | None = None
        self._last: Course | None = None
        self._drifts: Array | None = None
        self._age, self.failures = 0, 0
        self.program: QuadraticProgram | None = None

    def step(self, measured: Measured, reference: Reference) -> tuple[Command, Diagnostics]:
        """Return the command for the period that begins now."""
        targets = self._design(reference)
        situation = self.base.begin(measured, reference)
        outlook = self._outlook(situation, targets)
        if not np.isfinite(np.concatenate([outlook.state, outlook.previous, outlook.disturbance])).all():
            return self._held(situation)
        nominal, told = self._nominal(outlook)
        ahead = self._planner.ahead(nominal, targets, self._last)
        self.program = self._staged.filled(self._stages(ahead, outlook))
        if self.keep is not None:
            self.keep(self.program)
        solution = self._solver.solve(self.program)
        told |= {"iterations": solution.iterations, "qp_time": solution.solve_time, "status": solution.status}
        if solution.z is None:
            return self._fallback(situation, outlook, ahead, told)
        plan = self._staged.plan(solution.z, ahead.start)
        self._last, self._age = self._planner.planned(ahead, plan.states, plan.inputs), 0
        requests = self._last.controls[0] + self._pulled_back(outlook, nominal)
        violation = float(plan.slacks.max(initial=0.0)) / self.settings.lane
        horizon = self._horizon(targets, ahead)
        return self.base.command(
            situation, *map(float, requests), violation=violation, horizon=horizon, extra=told
        )

    def _design(self, reference: Reference) -> Targets:
        """Goals along this reference; the terminal cost is made anew where another point is tracked."""
        if reference.tracked_x != self._tracked_x:
            self._tracked_x = reference.tracked_x
            self._terminal = terminal(self.prediction, self._weights, self.period, self._tracked_x)
            if self._make_tubes is not None:
                self._tubes = self._make_tubes(self.prediction, self._terminal)
        if self._targets is None or self._targets.reference is not reference:
            self._targets, self._last = Targets(self.prediction, reference), None
        return self._targets

    @property
    def _regulator(self) -> Terminal:
        if self._terminal is None:
            raise RuntimeError(f"{self.name}: no reference has been followed yet")
        return self._terminal

    def _outlook(self, situation: Situation, targets: Targets) -> Outlook:
        state = situation.state.copy()
        arc_length = float(state[0])
        time = float(targets.time(np.array([arc_length]))[0]) + situation.lateness
        if self.settings.domain == "space":
            state[0] = time
        disturbance = self._believed(situation.disturbance, targets, arc_length)
        return Outlook(time, arc_length, state, np.array(situation.previous), disturbance)

    def _believed(self, disturbance: Array, targets: Targets, arc_length: float) -> Array:
        """The estimate without what the goals know already, its drifts no faster than ``slowness``."""
        disturbance = disturbance - targets.missing(np.array([arc_length]))[0]
        if self.settings.slowness == 0.0:
            return disturbance
        if self._drifts is None:
            self._drifts = np.zeros(disturbance.size)
        self._drifts += self.period / (self.period + self.settings.slowness) * (disturbance - self._drifts)
        is_drift = [name in DRIFTS for name in self.prediction.disturbances]
        return np.where(is_drift, self._drifts, disturbance)

    def _nominal(self, outlook: Outlook) -> tuple[Outlook, dict[str, Any]]:
        """What is planned from: the truck itself, or where the last plan of a nominal one has come to."""
        if self._tubes is None:
            return outlook, {}
        if self._last is None or self._age:
            return outlook, {"left_tube": False}
        state, previous, _ = self._planner.reached(self._last, outlook)
        error = np.concatenate([outlook.state - state, outlook.previous - previous])
        if not self._tubes.holds(error, self._speed(outlook)):
            return outlook, {"left_tube": True}
        return replace(outlook, state=state, previous=previous), {"left_tube": False}

    def _pulled_back(self, outlook: Outlook, nominal: Outlook) -> Array:
        """What the request has beside that of the nominal truck: its own past, and the pull to the middle."""
        error = np.concatenate([outlook.state - nominal.state, outlook.previous - nominal.previous])
        if not error.any():
            return np.zeros(REQUESTS)
        gain = self._regulator.gain.at(self._speed(outlook))
        pulled: Array = error[-REQUESTS:] - gain @ error
        return pulled

    def _stages(self, ahead: Ahead, outlook: Outlook) -> Stages:
        count, period = self.settings.horizon, self.period
        size = len(self.prediction.states) + REQUESTS
        final = float(ahead.goals[-1, self._place["longitudinal_velocity"]])
        weights = np.tile(self._weights.of_states(max(final, 1.0), period), (count - 1, 1))
        low, high = self._limits_of_states(outlook)
        changes = self._limits_of_changes(ahead, outlook)
        return Stages(
            start=ahead.start,
            A=ahead.model.A,
            B=ahead.model.B,
            c=ahead.model.c,
            state_weights=weights,
            terminal_weight=self._regulator.cost.at(final),
            input_weights=np.tile(self._weights.of_changes(period), (count, 1)),
            state_goals=np.zeros((count, size)),
            input_goals=np.zeros((count, REQUESTS)),
            state_low=low - ahead.goals[1:],
            state_high=high - ahead.goals[1:],
            input_low=-changes - ahead.changes,
            input_high=changes - ahead.changes,
            soft_linear=np.array([SLACK_LINEAR]),
            soft_quadratic=np.array([SLACK_QUADRATIC]),
        )

    def _limits_of_states(self, outlook: Outlook) -> tuple[Array, Array]:
        """(n,) of ξ: lane, requests; less what disturbances can do."""
        size = len(self.prediction.states) + REQUESTS
        high = np.full(size, np.inf)
        low = -high
        drive = self.base.truck.drive
        high[self._aside], low[self._aside] = self.settings.lane, -self.settings.lane
        low[-REQUESTS:] = self.base.lowest_request, drive.lowest
        high[-REQUESTS:] = self.base.highest_request, drive.highest
        if self._tubes is not None:
            low, high = self._tubes.tightened(low, high, self._speed(outlook))
        return low, high

    def _limits_of_changes(self, ahead: Ahead, outlook: Outlook) -> Array:
        """(N, 2) largest change of the requests in each step: a rate limit is one for each metre in space."""
        changes = np.full((self.settings.horizon, REQUESTS), np.inf)
        rate = self.settings.steering_rate
        if rate is not None:
            unit = abs(self.prediction.mean_ratio * self.base.truck.steering.gain)
            changes[:, 0] = rate / unit * ahead.durations
            if self._tubes is not None:
                changes = self._tubes.tightened_changes(changes, self._speed(outlook))
        return changes

    def crowded(self, speed: float) -> str | None:
        """What is to be said of a set too wide for the lane at a speed [m/s], None where there is no such."""
        if self._tubes is None:
            return None
        reach, room = float(self._tubes.box(speed)[self._aside]), (1.0 - LEAST_LEFT) * self.settings.lane
        if reach <= room:
            return None
        return (
            f"at {speed:.1f} m/s the set about its plan reaches {reach:.2f} m to either side, the plan's "
            f"lane of {self.settings.lane:g} m leaves {room:.2g} m: it keeps the steering's limits, "
            "not the lane's"
        )

    def _speed(self, outlook: Outlook) -> float:
        return float(outlook.state[self._place["longitudinal_velocity"]])

    def _horizon(self, targets: Targets, ahead: Ahead) -> Array | None:
        if self._last is None:
            return None
        states = self._last.states
        arc_lengths = states[:, 0] if self.settings.domain == "time" else ahead.arc_lengths
        return targets.positions(arc_lengths, states[:, self._aside])

    def _fallback(
        self, situation: Situation, outlook: Outlook, ahead: Ahead, told: dict[str, Any]
    ) -> tuple[Command, Diagnostics]:
        """What is sent where the program has no solution."""
        self.failures += 1
        self._age += 1
        if self._last is not None and self._age <= PATIENCE:
            *_, requests = self._planner.reached(self._last, outlook)
            name = "last_plan"
        else:
            own = np.concatenate([outlook.state, outlook.previous]) - ahead.goals[0]
            change = ahead.changes[0] - self._regulator.gain.at(self._speed(outlook)) @ own
            requests, name = outlook.previous + change, "lqr"
        return self.base.command(situation, *map(float, requests), solved=False, fallback=name, extra=told)

    def _held(self, situation: Situation) -> tuple[Command, Diagnostics]:
        """Requests as they were: nothing is known of the truck."""
        self.failures += 1
        return self.base.command(
            situation, *situation.previous, solved=False, fallback="held", extra={"status": "not_finite"}
        )
