"""Generic terms of the actuator: what may be wrong in one of its equations, whatever the cause.

With u the request, θ the modelled angle, v the speed and (2.25) written as it is solved,

    T1 T2 θ'' + (T1 + T2) θ' + θ = K (u + c f_u(u, v))(t - L) + K c f_l(θ, θ', v),
    measured = θ + c f_a(θ, θ', v) + bias + noise,

a term c f joins in one of three places: the request, "request: |u|"; the lags, "lags: u'|u'|", which is where
a lag that changes, friction and damping act; or what the sensor reads, "angle: |u|". In the names u is the
request or the angle. f is evaluated along a fit and then fixed: it does not depend on what is fitted beside
it, so that the model stays linear in c and the derivative to c exact. All is in SI units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.estimation.actuator_effects import EffectsProblem, Response
from ident.estimation.actuator_likelihood import DEAD_TIME, ActuatorRecord, Push
from ident.estimation.vehicle_records import Samples

Array = NDArray[np.float64]

RESTING = 1e-3  # of the largest rate: no sign
STEP = "angle: step"


@dataclass(frozen=True)
class Along:
    """What terms are functions of, at the commands or at the samples of one record.

    times : [s]; value, rate : of the request or of the angle; speed : [m/s], None where not known
    still : rate below which nothing moves
    """

    times: Array
    value: Array
    rate: Array
    speed: Array | None
    still: float


Term = Callable[[Along], Array]

OF_VALUE: dict[str, Term] = {
    "|u|": lambda one: np.abs(one.value),
    "u|u|": lambda one: one.value * np.abs(one.value),
    "u^3": lambda one: one.value**3,
}
OF_RATE: dict[str, Term] = {
    "sgn u'": lambda one: np.where(np.abs(one.rate) > one.still, np.sign(one.rate), 0.0),
    "|u'| u": lambda one: np.abs(one.rate) * one.value,
    "u'|u'|": lambda one: one.rate * np.abs(one.rate),
}
OF_TIME: dict[str, Term] = {"t": lambda one: one.times}
WITH_SPEED: dict[str, Term] = {"v u": lambda one: _speed(one) * one.value}
RATE_WITH_SPEED: dict[str, Term] = {"v u'": lambda one: _speed(one) * one.rate}

PLACES: dict[str, dict[str, Term]] = {
    "request": {**OF_VALUE, **WITH_SPEED},
    "lags": {**OF_RATE, **RATE_WITH_SPEED},
    "angle": {**OF_VALUE, **OF_RATE, **OF_TIME, **WITH_SPEED},
}
NEEDS_SPEED = ("v u", "v u'")


def _speed(one: Along) -> Array:
    if one.speed is None:
        raise ValueError("no speed is known")
    return one.speed


def pushes(
    problem: EffectsProblem,
    shared: Array,
    local: Sequence[Array],
    speed: Sequence[Samples | None],
) -> dict[str, list[Push]]:
    """All terms but the steps, "place: f", for each record what a unit of it adds there.

    Parameters
    ----------
    shared, local : parameters at which terms of the angle are evaluated
    speed : of the run of each record [m/s], None where not known
    """
    answers = [problem.respond(r, shared, x) for r, x in zip(problem.records, local, strict=True)]
    still = RESTING * max(float(np.abs(answer.rate).max(initial=0.0)) for answer in answers)
    known = all(one is not None for one in speed)
    triples = list(zip(problem.records, answers, speed, strict=True))
    made = {}
    for place, terms in PLACES.items():
        along = [_along(place, *one, float(shared[DEAD_TIME]), still) for one in triples]
        for name, term in terms.items():
            if known or name not in NEEDS_SPEED:
                made[f"{place}: {name}"] = [_push(place, term(one)) for one in along]
    return made


def _push(place: str, values: Array) -> Push:
    return Push(angle=values) if place == "angle" else Push(request=values)


def _along(
    place: str,
    record: ActuatorRecord,
    answer: Response,
    speed: Samples | None,
    dead_time: float,
    still: float,
) -> Along:
    """What terms of a place are functions of; of the lags, when each command arrives."""
    if place == "angle":
        times, value, rate = record.times, answer.column, answer.rate
    elif place == "lags":
        times = record.command_times + dead_time
        value, rate = (np.interp(times, record.times, part) for part in (answer.column, answer.rate))
    else:
        times, value = record.command_times, record.command_values
        rate = np.zeros(value.size)
    fast = None if speed is None else np.interp(times, speed.times, speed.values)
    return Along(times, value, rate, fast, still)


def stepped(records: Sequence[ActuatorRecord], run: int, time: float) -> list[Push]:
    """A step of the angle at some time of one run, which stays until its end."""
    return [Push(angle=((r.run == run) & (r.times >= time)).astype(np.float64)) for r in records]
