"""What the actuator may lack, as directions: the change of the modelled angle that goes with one size of it.

Effects of the catalogue are tried at several sizes, because a play or a limit is no small term but another
shape at each size: the direction is the whole difference that it makes. The generic basis is added to the
request, and then goes through the actuator, and to the measured angle itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.effects.actuator_effect import ActuatorEffect, Excitation
from ident.estimation.actuator_effects import EffectsProblem, with_effects
from ident.estimation.actuator_likelihood import ActuatorRecord
from ident.estimation.output_error import Fit
from ident.estimation.vehicle_records import Samples

Array = NDArray[np.float64]
Term = Callable[[Array, Array], Array]

NEVER = 1e9  # times the largest rate: a limit that is none
STEP_EVERY = 2.0  # [s]
MOST_STEPS = 60
RESTING = 1e-3  # of the largest rate: no sign

# Of a value and its rate, both over their largest size.
BASIS: dict[str, Term] = {
    "|u|": lambda u, _: np.abs(u),
    "u|u|": lambda u, _: u * np.abs(u),
    "u^3": lambda u, _: u**3,
    "sgn u'": lambda _, rate: np.where(np.abs(rate) > RESTING, np.sign(rate), 0.0),
    "|u'| u": lambda u, rate: np.abs(rate) * u,
    "u'|u'|": lambda _, rate: rate * np.abs(rate),
}


@dataclass(frozen=True)
class Direction:
    """One direction.

    key : of the candidate; effect : its name in the catalogue, None of the generic basis
    values : one (n,) array a record, change of the modelled angle
    at : parameters that it holds; size : of the effect that one unit of it stands for
    """

    key: str
    effect: str | None
    values: list[Array]
    at: Mapping[str, float] = field(default_factory=dict)
    size: float = 1.0


def effect_directions(
    problem: EffectsProblem, fit: Fit, effect: ActuatorEffect, seen: Excitation
) -> Iterator[Direction]:
    """An effect that is not in the fit, at several sizes; a limit within either of the lags."""
    added = EffectsProblem(problem.records, problem.runs, (*problem.effects, effect), scale=problem.scale)
    own = list(problem.sizes(fit.shared).values())
    base = fit.shared[: problem.first_size]
    sides = (1.0, -1.0) if effect.place == "rate" else (1.0,)
    for side in sides:

        def angles(size: float, side: float = side) -> list[Array]:
            shared = with_effects(base, added, [*own, size], skewed=problem.limited, side=side)
            pairs = zip(added.records, fit.local, strict=True)
            return [added.respond(record, shared, local).angle for record, local in pairs]

        without = angles(NEVER * seen.rate if effect.place == "rate" else 0.0)
        for size in effect.sizes(seen):
            values = [a - b for a, b in zip(angles(size), without, strict=True)]
            yield Direction(effect.name, effect.name, values, {effect.size.name: size}, size)


def basis_directions(
    problem: EffectsProblem, fit: Fit, speed: Sequence[Samples | None]
) -> Iterator[Direction]:
    """The generic basis, added to the request and to the angle.

    speed : of the run of each record [m/s], None where not known
    """
    requests = [(r.command_times, r.command_values) for r in problem.records]
    added = _terms(problem.records, requests, speed)
    columns = [np.column_stack(list(terms)) for terms in zip(*added.values(), strict=True)]
    triples = list(zip(problem.records, fit.local, columns, strict=True))
    answers = [problem.respond(record, fit.shared, local, extra) for record, local, extra in triples]
    for number, name in enumerate(added):
        yield Direction(f"request: {name}", None, [answer.extra[:, number] for answer in answers])
    angles = [(r.times, a.column) for r, a in zip(problem.records, answers, strict=True)]
    for name, values in _terms(problem.records, angles, speed).items():
        yield Direction(f"angle: {name}", None, values)
    yield from _steps(problem.records)


def _terms(
    records: Sequence[ActuatorRecord],
    signals: Sequence[tuple[Array, Array]],
    speed: Sequence[Samples | None],
) -> dict[str, list[Array]]:
    """Each term of the basis, for a signal (times, values) of each record."""
    rates = [np.gradient(values, times) for times, values in signals]
    largest = max(float(np.abs(values).max()) for _, values in signals) or 1.0
    fastest = max(float(np.abs(rate).max()) for rate in rates) or 1.0
    scaled = [(v / largest, rate / fastest) for (_, v), rate in zip(signals, rates, strict=True)]
    made = {name: [term(*one) for one in scaled] for name, term in BASIS.items()}
    end = max(float(record.times[-1]) for record in records)
    made["t"] = [times / end for times, _ in signals]
    if all(one is not None for one in speed):
        made["v u"] = [
            values * np.interp(times, one.times, one.values)
            for (times, _), (values, _), one in zip(signals, scaled, speed, strict=True)
            if one is not None
        ]
    return made


def _steps(records: Sequence[ActuatorRecord]) -> Iterator[Direction]:
    """A step of the angle at each time, which stays until the end of the run."""
    ends = {record.run: float(record.times[-1]) for record in records}
    begins = {record.run: float(record.times[0]) for record in reversed(records)}
    total = sum(ends[run] - begins[run] for run in ends)
    every = max(STEP_EVERY, total / MOST_STEPS)
    for run, end in ends.items():
        for time in np.arange(begins[run] + every, end - every / 2, every).tolist():
            values = [((r.run == run) & (r.times >= time)).astype(np.float64) for r in records]
            yield Direction("angle: step", None, values, {"run": float(run), "time": time})
