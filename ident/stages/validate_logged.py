"""The model against runs in which a logged controller followed a path, level by level.

0. measured steering -> vehicle;  1. request -> actuator and vehicle;
2. shadow: our controllers on the logged states, their requests compared with the logged ones;
3. our controllers and the model in a closed loop on the logged path.

At levels 0 and 1 the model runs free over windows of ``WINDOW`` seconds, each from its logged state. It
agrees where the rms error of every signal is at most

    sqrt(acceptable² + noise² + spread²):

what the engineer accepts, the noise of the sensor, and how far the error bars of the parameters let the
prediction differ (rms over trucks drawn from their covariance). Each level is only looked at where the one
before agrees: a closed loop hides what is wrong below it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ident.control.truck import Truck
from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import compiled
from ident.estimation.evaluation import Candidate, Prediction, Segments, from_many_starts, predict
from ident.estimation.tyre_fit import BANK
from ident.results import LoggedLevel
from ident.stages.evaluate_data import by_request
from ident.stages.validate_logged_data import FollowedRun
from ident.stages.validate_truck import OFFSET, Believed

Array = NDArray[np.float64]

WINDOW, EVERY = 2.0, 0.5  # [s]
ANGLE = "road_wheel_angle"
NAMES = {0: "measured steering -> vehicle", 1: "request -> actuator and vehicle"}


def open_levels(
    followed: FollowedRun, truck: Believed, drawn: Sequence[Truck], acceptable: Mapping[str, float]
) -> list[LoggedLevel]:
    """Levels 0 and 1 of a run; level 1 has no answer where level 0 does not agree."""
    segments = from_many_starts(followed.records, WINDOW, EVERY, followed.rear_arm)
    first = _level(0, followed, segments, truck, drawn, acceptable)
    if not first.agrees:
        why = f"level 0 does not agree: {_beyond(first)}"
        return [first, LoggedLevel(followed.run.name, 1, None, {}, {}, reason=why)]
    driven, angles = by_request(followed.driver, segments)
    second = _level(1, followed, driven, truck, drawn, acceptable, angles)
    return [first, second]


def candidate(truck: Truck, offset: float) -> Candidate:
    """The vehicle of a truck, on a level road."""
    parameters = {**truck.parameters, **dict.fromkeys(BANK, 0.0), OFFSET: offset}
    return Candidate(truck.model, compiled(bicycle(truck.model, truck.model)), parameters)


def _level(
    number: int,
    followed: FollowedRun,
    segments: Segments,
    truck: Believed,
    drawn: Sequence[Truck],
    acceptable: Mapping[str, float],
    angles: Sequence[Array] | None = None,
) -> LoggedLevel:
    found = predict(candidate(truck.truck, truck.offset), segments)
    errors = dict(found.errors)
    if angles is not None:
        errors[ANGLE] = np.concatenate(angles) - segments.windows.inputs[:, 0]
    spread = _spread(found, [predict(candidate(one, truck.offset), segments) for one in drawn])
    rms = {name: _rms(values) for name, values in errors.items() if values.size and name in acceptable}
    noise = {ANGLE: truck.angle_noise, **truck.noise}
    allowed = {
        name: float(np.sqrt(acceptable[name] ** 2 + noise.get(name, 0.0) ** 2 + spread.get(name, 0.0) ** 2))
        for name in rms
    }
    made = LoggedLevel(followed.run.name, number, _agree(rms, allowed), rms, allowed)  # type: ignore[arg-type]
    if made.agrees:
        return made
    return LoggedLevel(made.run, made.level, made.agrees, rms, allowed, reason=_beyond(made))


def _spread(found: Prediction, others: Sequence[Prediction]) -> dict[str, float]:
    """How far the error bars of the parameters let each signal differ: rms over draws and samples."""
    if not others:
        return {}
    return {
        name: _rms(np.concatenate([other.errors[name] - errors for other in others]))
        for name, errors in found.errors.items()
    }


def _agree(rms: Mapping[str, float], allowed: Mapping[str, float]) -> bool:
    return all(value <= allowed[name] for name, value in rms.items())


def _beyond(level: LoggedLevel) -> str:
    """What does not agree, the worst first."""
    over = {name: level.rms[name] / level.allowed[name] for name in level.rms}
    worst = sorted((name for name in over if over[name] > 1), key=lambda name: -over[name])
    return ", ".join(
        f"{name.replace('_', ' ')} rms {level.rms[name]:.3g}, allowed {level.allowed[name]:.3g}"
        for name in worst
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
