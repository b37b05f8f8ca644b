"""One fit of the actuator layer: its scores, its likelihood, its sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.effects.actuator_effect import ActuatorEffect, Excitation
from ident.estimation.actuator_directions import basis_directions, effect_directions
from ident.estimation.actuator_effects import ACTUATOR_EFFECTS, EffectsProblem
from ident.estimation.actuator_fit import estimate
from ident.estimation.actuator_likelihood import BIAS, GAIN
from ident.estimation.actuator_scores import Bins, record_likelihood, scores_of, white_rows
from ident.estimation.elimination import eliminate
from ident.estimation.layer import LayerFit, LayerScores, Likelihood
from ident.estimation.noise import Linearised
from ident.estimation.output_error import Fit
from ident.estimation.signal_noise import AT_CAP
from ident.estimation.vehicle_records import Samples
from ident.results import EffectEstimate, Estimate

Array = NDArray[np.float64]

AT_THE_END = 1.01
UNKNOWN = 1e3  # times its size: a standard error that says nothing
MUTE = 1e-4  # of the length of a direction: less than that left tells nothing of its size
LONGEST_NOISE = 0.2  # [s] correlation time of a sensor's noise
FAR = 0.3  # of what the angle moves, left over


@dataclass(frozen=True, eq=False)
class ActuatorLayerFit:
    """The actuator with some effects; see :class:`~ident.estimation.layer.LayerFit`.

    runs : names of the runs of the problem; signal : that is measured
    speed : of each record [m/s], None where not known
    base : the linear fit beside it, None where this is that
    """

    runs: tuple[str, ...]
    signal: str
    speed: tuple[Samples | None, ...]
    problem: EffectsProblem
    fit: Fit
    base: ActuatorLayerFit | None

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the effects, then of the generic terms."""
        return self.problem.keys

    @property
    def freedom(self) -> int:
        """One size an effect, one coefficient a term."""
        return len(self.problem.keys)

    def sizes(self) -> dict[str, float]:
        """Size of each effect, coefficient of each term."""
        return self.problem.sizes(self.fit.shared)

    @cached_property
    def linearised(self) -> list[Linearised]:
        """The records at the fit."""
        return self.problem.linearise(self.fit.shared, self.fit.local)

    @cached_property
    def excitation(self) -> Excitation:
        """How hard the actuator was driven, by this fit."""
        records, fit = self.problem.records, self.fit
        answers = [self.problem.respond(r, fit.shared, x) for r, x in zip(records, fit.local, strict=True)]
        column = np.concatenate([answer.column for answer in answers])
        return Excitation(
            noise=fit.noise.total_std,
            amplitude=float(np.ptp(column)) / 2,
            request=max(float(np.abs(r.command_values).max()) for r in records),
            rate=max(float(np.abs(answer.rate).max()) for answer in answers),
            samples=column.size,
        )

    def scores(self) -> LayerScores:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        candidates = [effect for name, effect in ACTUATOR_EFFECTS.items() if name not in self.keys]
        directions = [
            one
            for effect in candidates
            for one in effect_directions(self.problem, self.fit, effect, self.excitation)
        ]
        directions += basis_directions(self.problem, self.fit, self.speed)
        return scores_of(self.problem, self.linearised, self.fit.noise, directions, self.signal)

    def likelihood(self, like: LayerFit | None = None, *, roughly: bool = False) -> Likelihood:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        del roughly  # exactly is quick
        other = self if like is None else like
        if not isinstance(other, ActuatorLayerFit):
            raise TypeError("a fit of another layer")
        return record_likelihood(Bins(self.problem.records), self.linearised, other.fit.noise)

    def estimates(self) -> dict[str, EffectEstimate]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return {
            effect.name: EffectEstimate(effect.name, "A", {effect.size.name: self._estimate(place)})
            for place, effect in enumerate(self.problem.effects)
        }

    def _estimate(self, place: int) -> Estimate:
        index = self.problem.first_size + place
        std = float(np.sqrt(self.fit.covariance[index, index]))
        return estimate(
            float(self.fit.shared[index]), std, self.problem.effects[place].size.unit, self.fit.freedom
        )

    def sizes_by_run(self, key: str) -> tuple[Array, Array]:
        """See :class:`~ident.estimation.layer.LayerFit`; one step from the common fit, all else free too."""
        index = self.problem.first_size + self.keys.index(key)
        values, errors = np.full(len(self.runs), self.fit.shared[index]), np.full(len(self.runs), np.inf)
        for run in range(len(self.runs)):
            step, std = self._step_of_run(run, index)
            if std < UNKNOWN * abs(self.fit.shared[index]):
                values[run] += step
                errors[run] = std
        return values, errors

    def _step_of_run(self, run: int, index: int) -> tuple[float, float]:
        """Step of a parameter that one run alone asks for, and its standard error; none where it is mute."""
        pairs = zip(self.problem.records, self.linearised, strict=True)
        own = [part for record, part in pairs if record.run == run]
        rows = np.vstack(
            [white_rows(part, self.fit.noise, np.zeros((part.times.size, 0)))[1].rows for part in own]
        )
        others = [*range(BIAS), BIAS + run, *range(self.problem.first_size, self.fit.shared.size)]
        others.remove(index)
        left = eliminate(rows[:, [*others, index, -1]], len(others)).rows
        length, whole = (float(np.linalg.norm(column)) for column in (left[:, 0], rows[:, index]))
        if length <= MUTE * whole or length == 0 or not np.isfinite(length):
            return 0.0, np.inf
        return float(left[:, 0] @ left[:, 1]) / length**2, 1 / length

    def noise(self) -> dict[str, float]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return {self.signal: self.fit.noise.total_std}

    def slow_noise(self) -> list[str]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        period = float(np.median(np.concatenate([np.diff(r.times) for r in self.problem.records])))
        return [self.signal] if self.fit.noise.shape.lasts(period) > AT_CAP * LONGEST_NOISE else []

    @property
    def is_far(self) -> bool:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        parts = [r.measured - r.measured.mean() for r in self.problem.records]
        spread = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
        return bool(self.rms()[self.signal] > FAR * spread)

    def size(self, key: str) -> float:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return self.sizes()[key]

    def term(self, key: str) -> tuple[float, float]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        index = self.problem.first_size + self.keys.index(key)
        return float(self.fit.shared[index]), float(np.sqrt(self.fit.covariance[index, index]))

    def renoised(self) -> Self:
        """See :class:`~ident.estimation.layer.LayerFit`; its noise is that of what it leaves already."""
        return self

    def rms(self) -> dict[str, float]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        residual = np.concatenate(self.fit.residuals)
        return {self.signal: float(np.sqrt(np.mean(residual**2)))}

    def is_allowed(self) -> dict[str, str]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        seen = self.excitation
        sizes = self.sizes()
        told = {
            effect.name: self._impossible(effect, sizes[effect.name], seen) for effect in self.problem.effects
        }
        return {name: why for name, why in told.items() if why}

    def _impossible(self, effect: ActuatorEffect, size: float, seen: Excitation) -> str | None:
        low, high = (self.problem.scale * end for end in (effect.size.low, effect.size.high))
        if self.fit.shared[GAIN] <= 0:
            return f"the gain is {self.fit.shared[GAIN]:.3g}: the angle would turn against its request"
        if not low * AT_THE_END < size < high / AT_THE_END:
            return (
                f"{effect.size.name} {size:.3g} is at the end of what is possible ({low:.3g} to {high:.3g})"
            )
        return effect.impossible(size, seen)


def named_effects(keys: Sequence[str]) -> list[ActuatorEffect]:
    """Effects of this layer by name.

    Raises
    ------
    ValueError
        If one of them is none of this layer.
    """
    if unknown := sorted(set(keys) - set(ACTUATOR_EFFECTS)):
        raise ValueError(f"{', '.join(unknown)}: no effect of the actuator")
    return [ACTUATOR_EFFECTS[key] for key in keys]
