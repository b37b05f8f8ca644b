"""Levels 2 and 3: our controllers beside a logged one.

Level 2, shadow: a controller is given the logged states, cycle by cycle, and told that the logged request
was sent, not its own. It agrees where it asks for what the logged one asked for: the difference of the
requests is at most ``SAME_REQUEST`` of the size of the logged ones (rms about their mean), and the rms of its
rate, the effort, within ``SAME_EFFORT`` of theirs. A controller that prices changes of its request stays near
the last one, which is the logged one: it agrees more easily here than one without memory, and level 3 has to
tell.

Level 3: the controller drives the simulated truck along the logged path, from where the log began. Lateral
error and request are compared with the logged ones by arc length: the error within the root of the sum of the
squares of what is acceptable and of the noise, the request as above. Only a controller that agrees at level 2
is like the logged one: of another, the difference says nothing of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.control.closed_loop import ClosedLoop, Disturbance, Settings, run
from ident.control.controllers.base import Base
from ident.control.controllers.controller import Controller
from ident.control.plant import Plant
from ident.results import ControllerName, LoggedLevel
from ident.stages.validate_stretch import LoggedStretch

Array = NDArray[np.float64]

SAME_REQUEST = 0.1
SAME_EFFORT = 0.25
LATERAL_LIMIT = 5.0  # [m]: the path of a log may be left further than a lane
SMALL = 1e-9
REQUEST, EFFORT, ERROR = "steering_request", "steering_wheel_rate", "lateral_error"


@dataclass(frozen=True)
class Shadow:
    """What one controller asks for on the states of a stretch.

    request : (m,) [rad]
    """

    controller: ControllerName
    stretch: LoggedStretch
    request: Array

    def level(self) -> LoggedLevel:
        """Level 2."""
        logged, period = self.stretch.request, float(self.stretch.cycles[1] - self.stretch.cycles[0])
        efforts = [_rms(np.diff(values) / period) for values in (self.request, logged)]
        rms = {REQUEST: _rms(self.request - logged), EFFORT: abs(efforts[0] - efforts[1])}
        allowed = {REQUEST: SAME_REQUEST * float(np.std(logged)), EFFORT: SAME_EFFORT * efforts[1]}
        agrees = all(rms[name] <= allowed[name] for name in rms)
        reason = None
        if not agrees:
            reason = (
                f"its request differs by {100 * self.share:.0f} % of the size of the logged one, allowed "
                f"{100 * SAME_REQUEST:.0f} %; its effort is {efforts[0] / max(efforts[1], SMALL):.2f} times"
            )
        return LoggedLevel(self.stretch.run, 2, agrees, rms, allowed, self.controller, reason)

    @property
    def share(self) -> float:
        """Difference of the requests over the size of the logged ones."""
        logged = self.stretch.request
        return _rms(self.request - logged) / max(float(np.std(logged)), SMALL)


def shadow(name: ControllerName, controller: Controller, stretch: LoggedStretch) -> Shadow:
    """Let a controller look on while another one drives."""
    base: Base = getattr(controller, "base")  # noqa: B009 -- no part of the face that all controllers share
    controller.reset()
    made = []
    for k, measured in enumerate(stretch.measured):
        command, _ = controller.step(measured, stretch.reference)
        made.append(command.steering_request)
        sent = float(stretch.request[k]), float(stretch.acceleration[k])
        base.estimator.sent.add(measured.time, sent)
    return Shadow(name, stretch, np.array(made))


def closed(controller: Controller, plant: Plant, stretch: LoggedStretch, seed: int) -> ClosedLoop:
    """Drive the logged path, from where the log began."""
    first, reference = stretch.measured[0], stretch.reference
    start = Disturbance(
        float(stretch.lateral_error[0]),
        float(stretch.heading_error[0]),
        first.longitudinal_velocity - float(reference.speed[0]),
    )
    return run(plant, controller, reference, start, Settings(lateral_limit=LATERAL_LIMIT, seed=seed))


def closed_level(
    name: ControllerName, course: ClosedLoop, stretch: LoggedStretch, acceptable: float, noise: float
) -> LoggedLevel:
    """Level 3, by arc length."""
    simulated = np.interp(stretch.arc_length, course.arc_length, course.lateral_error)
    requests = [one.steering_request for one in course.commands]
    places = np.interp(course.cycles, course.times, course.arc_length)
    asked = np.interp(stretch.arc_length, places, requests)
    rms = {ERROR: _rms(simulated - stretch.lateral_error), REQUEST: _rms(asked - stretch.request)}
    allowed = {
        ERROR: float(np.hypot(acceptable, noise)),
        REQUEST: SAME_REQUEST * float(np.std(stretch.request)),
    }
    agrees = course.completed and all(rms[key] <= allowed[key] for key in rms)
    reason = None
    if not course.completed:
        reason = "it did not come to the end of the logged path"
    elif not agrees:
        told = {
            key: f"{key.replace('_', ' ')} differs by {rms[key]:.3g}, allowed {allowed[key]:.3g}"
            for key in rms
        }
        reason = "; ".join(text for key, text in told.items() if rms[key] > allowed[key])
    return LoggedLevel(stretch.run, 3, agrees, rms, allowed, name, reason)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
