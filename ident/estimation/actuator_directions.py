"""What the actuator may lack, as directions: the change of the modelled angle that goes with one size of it.

Effects of the catalogue are tried at several sizes, because a play or a limit is no small term but another
shape at each size: the direction is the whole difference that it makes. Beside them stand the generic terms
of :mod:`ident.estimation.actuator_terms` and steps of the angle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.effects.actuator_effect import ActuatorEffect, Excitation
from ident.estimation.actuator_effects import EffectsProblem, with_effects
from ident.estimation.actuator_likelihood import ActuatorRecord, Push
from ident.estimation.actuator_terms import STEP, pushes, stepped
from ident.estimation.output_error import Fit
from ident.estimation.vehicle_records import Samples

Array = NDArray[np.float64]

NEVER = 1e9  # times the largest rate: a limit that is none
STEP_EVERY = 2.0  # [s]
MOST_STEPS = 60


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
    added = problem.with_effect(effect)
    own = problem.sizes(fit.shared)
    base = fit.shared[: problem.first_size]
    sides = (1.0, -1.0) if effect.place == "rate" else (1.0,)
    for side in sides:

        def angles(size: float, side: float = side) -> list[Array]:
            sizes = {**own, effect.name: size}
            shared = with_effects(base, added, sizes, skewed=problem.limited, side=side)
            pairs = zip(added.records, fit.local, strict=True)
            return [added.respond(record, shared, local).angle for record, local in pairs]

        without = angles(NEVER * seen.rate if effect.place == "rate" else 0.0)
        for size in effect.sizes(seen):
            values = [a - b for a, b in zip(angles(size), without, strict=True)]
            yield Direction(effect.name, effect.name, values, {effect.size.name: size}, size)


def basis_directions(
    problem: EffectsProblem, fit: Fit, speed: Sequence[Samples | None]
) -> Iterator[Direction]:
    """The generic terms that are not in the fit, and steps; the size is their coefficient.

    speed : of the run of each record [m/s], None where not known
    """
    known = pushes(problem, fit.shared, fit.local, speed)
    added = {key: parts for key, parts in known.items() if key not in problem.terms}
    driven = {key: [_request(one) for one in parts] for key, parts in added.items() if parts[0].angle is None}
    columns = [np.column_stack(parts) for parts in zip(*driven.values(), strict=True)]
    triples = zip(problem.records, fit.local, columns, strict=True)
    answers = [problem.respond(record, fit.shared, local, extra) for record, local, extra in triples]
    for number, key in enumerate(driven):
        yield Direction(key, None, [answer.extra[:, number] for answer in answers])
    for key, parts in added.items():
        if key not in driven:
            yield Direction(key, None, [_angle(one) for one in parts])
    if STEP not in problem.terms:
        yield from _steps(problem.records)


def _request(one: Push) -> Array:
    return np.zeros(0) if one.request is None else one.request


def _angle(one: Push) -> Array:
    return np.zeros(0) if one.angle is None else one.angle


def _steps(records: Sequence[ActuatorRecord]) -> Iterator[Direction]:
    """A step of the angle at each time, which stays until the end of the run."""
    ends = {record.run: float(record.times[-1]) for record in records}
    begins = {record.run: float(record.times[0]) for record in reversed(records)}
    total = sum(ends[run] - begins[run] for run in ends)
    every = max(STEP_EVERY, total / MOST_STEPS)
    for run, end in ends.items():
        for time in np.arange(begins[run] + every, end - every / 2, every).tolist():
            values = [_angle(one) for one in stepped(records, run, time)]
            yield Direction(STEP, None, values, {"run": float(run), "time": time})
