"""The steering actuator with effects as an output-error problem, for any number of them at once.

theta = (K, L, a1, shape, bias of each run, size of each effect, coefficient of each generic term). Sizes are
not taken as logarithms: the angle is linear in them piece by piece (w / 2 to one side, ρ t, K d), and no
effect at all lies within reach. What a unit of a generic term adds is given with each record, to the commands
(after what effects make of them) or to the angle, and does not depend on theta. The shape is
rho = T1 T2 / a1² as in ``actuator_likelihood``; with a limited rate, which needs real lags in a known order,
it is the skew (T1 - T2) / a1 between -1 and 1, whose sign says which of the lags is limited. Local to a
record are those of ``actuator_likelihood`` (initial angle and rate, command before the first and how early
the first took effect, lost commands) and the place of the column within its play when the record began, as a
part of the width: it is somewhere, with equal chance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.actuator_nonlinear import DEAD_TIME as DEAD_TIME_ROLE
from ident.dynamics.actuator_nonlinear import FIRST as FIRST_ROLE
from ident.dynamics.actuator_nonlinear import LIMIT as LIMIT_ROLE
from ident.dynamics.actuator_nonlinear import ROLES, Lags, by_ratio, by_skew, nonlinear_response
from ident.dynamics.actuator_nonlinear import SECOND as SECOND_ROLE
from ident.dynamics.actuator_nonlinear import SHIFT as SHIFT_ROLE
from ident.dynamics.actuator_nonlinear import WIDTH as WIDTH_ROLE
from ident.dynamics.effects.actuator_effect import ActuatorEffect
from ident.dynamics.effects.steering_column_play import STEERING_COLUMN_PLAY
from ident.dynamics.effects.steering_dead_zone import STEERING_DEAD_ZONE
from ident.dynamics.effects.steering_rate_limit import STEERING_RATE_LIMIT
from ident.estimation.actuator_likelihood import (
    BIAS,
    DEAD_TIME,
    DEAD_TIME_RANGE,
    GAIN,
    LARGEST_RATIO,
    RATIO,
    REST_LAG,
    SHORTEST_LAG_SHARE,
    SUM,
    SUM_RANGE,
    ActuatorRecord,
)
from ident.estimation.noise import Linearised

Array = NDArray[np.float64]

ACTUATOR_EFFECTS = {
    effect.name: effect for effect in (STEERING_RATE_LIMIT, STEERING_COLUMN_PLAY, STEERING_DEAD_ZONE)
}

ANGLE, RATE, AHEAD, EARLY, SLACK, LOST = range(6)  # local parameters; the last begins the lost commands
SKEW = RATIO  # the same place
LARGEST_SKEW = 1 - 2 * SHORTEST_LAG_SHARE
FIRST_SKEW = 0.3  # of a start from poles that are complex or nearly equal
UNIFORM = 1 / np.sqrt(12)
BEFORE_ALL = 1e6  # [s] before a record, when the command that it does not hold was given

_ANGLE, _RATE, _AHEAD, _SLACK, _GAIN = range(ROLES, ROLES + 5)  # columns of the response
_REQUEST = ROLES + 5


@dataclass(frozen=True)
class Response:
    """The modelled angle of one record.

    angle, column, rate : (n,) at the sensor, before the play, its rate
    shared, local, extra : derivatives of the angle at the sensor to the shared and the local parameters, and
        to the sizes of what was added to the request
    """

    angle: Array
    column: Array
    rate: Array
    shared: Array
    local: Array
    extra: Array


class EffectsProblem:
    """The records of all runs with an actuator that has some effects."""

    def __init__(
        self,
        records: Sequence[ActuatorRecord],
        runs: int,
        effects: Sequence[ActuatorEffect] = (),
        *,
        scale: float = 1.0,
        terms: Sequence[str] = (),
    ) -> None:
        """Take the records: at least one, each with at least one sample, of ``runs`` runs in all.

        scale : sizes of the effects here over those at the road wheels
        terms : generic terms, which every record knows
        """
        self.records = list(records)
        self.runs = runs
        self.effects = tuple(effects)
        self.scale = scale
        self.limited = any(effect.place == "rate" for effect in effects)
        self.terms = tuple(terms)
        self.first_size = BIAS + runs
        self.first_term = self.first_size + len(self.effects)

    def with_effect(self, effect: ActuatorEffect) -> EffectsProblem:
        """The same with one more effect."""
        effects = (*self.effects, effect)
        return EffectsProblem(self.records, self.runs, effects, scale=self.scale, terms=self.terms)

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the effects, then the terms."""
        return (*(effect.name for effect in self.effects), *self.terms)

    def sizes(self, shared: Array) -> dict[str, float]:
        """Size of each effect and coefficient of each term, by name."""
        return dict(zip(self.keys, shared[self.first_size :].tolist(), strict=True))

    def inside(self, shared: Array) -> Array:
        """Clip to the physical region."""
        low = np.full(shared.size, -np.inf)
        high = np.full(shared.size, np.inf)
        low[DEAD_TIME], high[DEAD_TIME] = DEAD_TIME_RANGE
        low[SUM], high[SUM] = SUM_RANGE
        ends = (-LARGEST_SKEW, LARGEST_SKEW) if self.limited else (SHORTEST_LAG_SHARE, LARGEST_RATIO)
        low[RATIO], high[RATIO] = ends
        for place, effect in enumerate(self.effects, start=self.first_size):
            low[place] = self.scale * effect.size.low
            high[place] = self.scale * effect.size.high
        return np.asarray(np.clip(shared, low, high))

    @staticmethod
    def inside_local(local: Array) -> Array:
        """Clip the place within the play to its ends."""
        made = local.copy()
        made[SLACK] = np.clip(made[SLACK], -0.5, 0.5)
        return made

    def start(self, shared: Array) -> list[Array]:
        """Local parameters to begin with: at rest at the first measured angle, command unchanged."""
        return [self.start_one(record, shared) for record in self.records]

    @staticmethod
    def start_one(record: ActuatorRecord, shared: Array) -> Array:
        """Local parameters of one record to begin with."""
        angle = record.measured[0] - shared[BIAS + record.run]
        lost = shared[GAIN] * record.command_values[record.lost]
        return np.concatenate([[angle, 0.0, 0.0, 0.0, 0.0], lost])

    def linearise(self, shared: Array, local: Sequence[Array]) -> list[Linearised]:
        """Residual and exact derivatives of every record."""
        return [self.linearise_one(r, shared, x) for r, x in zip(self.records, local, strict=True)]

    def linearise_at(self, number: int, shared: Array, local: Array) -> Linearised:
        """Residual and exact derivatives of the record with that number."""
        return self.linearise_one(self.records[number], shared, local)

    def linearise_one(self, record: ActuatorRecord, shared: Array, local: Array) -> Linearised:
        """Residual and exact derivatives of one record."""
        response = self.respond(record, shared, local)
        residual = record.measured - response.angle - shared[BIAS + record.run]
        prior = np.full(local.size, np.inf)
        prior[RATE] = record.rest_rate
        prior[AHEAD] = record.rest_rate * REST_LAG
        prior[EARLY] = max(record.start_uncertainty, 1e-9)
        prior[SLACK] = UNIFORM
        left = np.zeros(local.size)
        left[RATE:LOST] = -local[RATE:LOST]
        return Linearised(record.times, residual, response.shared, response.local, record.starts, prior, left)

    def lags(self, shared: Array) -> Lags:
        """The dynamics at some parameters."""
        sizes = shared[self.first_size : self.first_term]
        made = by_skew(*shared[[SUM, SKEW]]) if self.limited else by_ratio(*shared[[SUM, RATIO]])
        for effect, size in zip(self.effects, sizes, strict=True):
            if effect.place == "rate":
                made = replace(made, rate=min(made.rate, float(size)))
            elif effect.place == "width":
                made = replace(made, width=made.width + float(size))
        return made

    def respond(
        self, record: ActuatorRecord, shared: Array, local: Array, added: Array | None = None
    ) -> Response:
        """Answer of the actuator to the commands of a record.

        added : (m, e) directions that are added to the request, after what effects make of it
        """
        pushes = self._pushes(record)
        extra = pushes if added is None else np.column_stack([pushes, added])
        lags = self.lags(shared)
        slack = float(local[SLACK])
        first = local[ANGLE] + lags.width * slack
        values, by_command = self._drive(record, shared, local, extra)
        values[0] = first + local[AHEAD]
        by_command[0, [_ANGLE, _AHEAD, _SLACK, WIDTH_ROLE]] = 1.0, 1.0, lags.width, slack
        by_start = np.zeros((3, by_command.shape[1]))
        by_start[0, [_ANGLE, _SLACK, WIDTH_ROLE]] = 1.0, lags.width, slack
        by_start[1, _RATE] = by_start[2, _ANGLE] = 1.0
        long_ago = min(record.command_times[0], record.times[0]) - BEFORE_ALL
        times = np.concatenate([[long_ago], record.command_times])
        times[1] += local[EARLY]
        start = (np.array([first, local[RATE], local[ANGLE]]), by_start)
        command = (times, values, by_command)
        out, by = nonlinear_response(lags, shared[DEAD_TIME], command, record.times, start)
        return self._response(record, shared, out, by, extra.shape[1])

    def _pushes(self, record: ActuatorRecord) -> Array:
        """(m, t) what a unit of each term adds to the commands."""
        known = [record.terms[key].request for key in self.terms]
        columns = [np.zeros(record.command_values.size) if one is None else one for one in known]
        return np.column_stack(columns) if columns else np.zeros((record.command_values.size, 0))

    def _drive(
        self, record: ActuatorRecord, shared: Array, local: Array, extra: Array
    ) -> tuple[Array, Array]:
        """(m + 1,) commands in units of the angle, the first one left open, and their derivatives."""
        maps = [effect for effect in self.effects if effect.request is not None]
        lost, count = record.lost, record.command_values.size
        by = np.zeros((count + 1, _REQUEST + len(maps) + lost.size + extra.shape[1]))
        request = record.command_values
        for place, effect in enumerate(maps):
            size = self.sizes(shared)[effect.name]
            request, by_size, by_request = _mapped(effect, request, size)
            by[1:, _REQUEST : _REQUEST + place] *= by_request[:, None]
            by[1:, _REQUEST + place] = shared[GAIN] * by_size
        request = request + extra[:, : len(self.terms)] @ shared[self.first_term :]
        values = np.concatenate([[0.0], shared[GAIN] * request])
        by[1:, _GAIN] = request
        first_extra = _REQUEST + len(maps) + lost.size
        by[1:, first_extra:] = shared[GAIN] * extra
        values[1 + lost] = local[LOST:]
        by[1 + lost] = 0.0
        by[1 + lost, _REQUEST + len(maps) + np.arange(lost.size)] = 1.0
        return values, by

    def _response(self, record: ActuatorRecord, shared: Array, out: Array, by: Array, extra: int) -> Response:
        lost = slice(by.shape[1] - extra - record.lost.size, by.shape[1] - extra)
        jacobian = np.zeros((record.times.size, shared.size))
        jacobian[:, GAIN] = by[:, _GAIN]
        jacobian[:, DEAD_TIME] = by[:, DEAD_TIME_ROLE]
        jacobian[:, SUM] = by[:, FIRST_ROLE]
        jacobian[:, RATIO] = by[:, SECOND_ROLE]
        jacobian[:, BIAS + record.run] = 1.0
        place = _REQUEST
        for number, effect in enumerate(self.effects, start=self.first_size):
            if effect.place == "request":
                jacobian[:, number] = by[:, place]
                place += 1
            else:
                role = LIMIT_ROLE if effect.place == "rate" else WIDTH_ROLE
                jacobian[:, number] = by[:, role]
        first = by.shape[1] - extra
        angle = out[:, 0].copy()
        for number, key in enumerate(self.terms):
            column, push = by[:, first + number], record.terms[key].angle
            jacobian[:, self.first_term + number] = column if push is None else column + push
            angle += 0.0 if push is None else shared[self.first_term + number] * push
        local = np.column_stack([by[:, [_ANGLE, _RATE, _AHEAD, SHIFT_ROLE, _SLACK]], by[:, lost]])
        return Response(angle, out[:, 1], out[:, 2], jacobian, local, by[:, first + len(self.terms) :])


def _mapped(effect: ActuatorEffect, request: Array, size: float) -> tuple[Array, Array, Array]:
    if effect.request is None:
        raise ValueError(f"{effect.name} does not change the request")
    return effect.request(request, size)


def with_effects(
    shared: Array,
    problem: EffectsProblem,
    sizes: Mapping[str, float],
    *,
    skewed: bool = False,
    side: float = 1.0,
) -> Array:
    """Parameters of a problem from those without sizes (K, L, a1, shape, biases).

    sizes : of all effects of the problem, by name; coefficients of its terms, zero where not among them
    skewed : whether the shape is the skew already, and not T1 T2 / a1²
    side : sign of the skew that it becomes
    """
    base = shared.copy()
    if problem.limited and not skewed:
        base[SKEW] = side * max(float(np.sqrt(max(1 - 4 * base[RATIO], 0.0))), FIRST_SKEW)
    elif skewed and not problem.limited:
        base[RATIO] = (1 - base[SKEW] ** 2) / 4
    names = [effect.name for effect in problem.effects]
    own = [sizes[name] for name in names] + [sizes.get(key, 0.0) for key in problem.terms]
    return np.concatenate([base, own])
