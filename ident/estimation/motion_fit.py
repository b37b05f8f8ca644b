"""One fit of the motion layer: its scores, its likelihood, its effects with their sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.effects.catalogue import CATALOGUE
from ident.estimation.coordinates import Coordinate
from ident.estimation.input_noise import InputNoise
from ident.estimation.layer import LayerFit, LayerScores, Likelihood
from ident.estimation.motion_effects import (
    MotionEffect,
    told_as,
)
from ident.estimation.motion_scores import Projection
from ident.estimation.motion_screen import MotionDirections, motion_directions
from ident.estimation.motion_starts import anew, minimised
from ident.estimation.reported_fit import reported_fit
from ident.estimation.signal_noise import capped_noise, identify_noise
from ident.estimation.vehicle_fit import (
    VehicleFit,
    inflation,
    least_white,
    shift_by_run,
)
from ident.estimation.vehicle_point import VehiclePoint
from ident.results import EffectEstimate, Estimate

if TYPE_CHECKING:
    from ident.estimation.motion_layer import MotionLayer

Array = NDArray[np.float64]

NOISE_ROUNDS = 4
SAME_NOISE = 0.005
OTHER_NOISE = 0.2  # change beyond which the colour is identified anew
OTHER_COLOUR = 0.01  # p-value below which likewise
ROUNDS_KEPT = 2  # after which its order stays
Z = 1.959964


@dataclass(frozen=True)
class MotionFit:
    """See :class:`~ident.estimation.layer.LayerFit`; ``point``: the maximum likelihood, and its noise."""

    layer: MotionLayer
    keys: tuple[str, ...]
    point: VehiclePoint

    @property
    def freedom(self) -> int:
        """Parameters that the effects add."""
        return sum(self.layer.effects[k].freedom if k in self.layer.effects else 1 for k in self.keys)

    @property
    def parameters(self) -> dict[str, float]:
        """Of the model, by name."""
        return self.point.problem.values(self.point.shared)

    def renoised(self) -> MotionFit:
        """See :class:`~ident.estimation.layer.LayerFit`.

        The order of a noise is that of the fit before, until its size has changed much or what is left of a
        signal is not white under it: then the colour was that of what was missing.
        """
        point, kept = self.point, ROUNDS_KEPT
        known = any(one.shape.total_over_innovations() > 1 for one in point.noise.values())
        for number in range(NOISE_ROUNDS):
            point = minimised(point) if number else anew(minimised(point))
            keep = known or number >= kept
            noise, _ = identify_noise(point, self.layer.floor, keep_order=keep)
            changed = max(abs(noise[n].std / point.noise[n].std - 1) for n in noise)
            point, settled = point.with_noise(noise), changed < SAME_NOISE
            if known and (changed > OTHER_NOISE or (settled and least_white(point) < OTHER_COLOUR)):
                known, kept = False, number + 1 + ROUNDS_KEPT
            elif settled:
                break
        return MotionFit(self.layer, self.keys, minimised(point))

    @cached_property
    def projection(self) -> Projection:
        """What the fit takes up of any direction."""
        return Projection(self.point)

    @cached_property
    def final(self) -> VehicleFit:
        """The fit as it is reported: least squares where something is left that is no noise."""
        return reported_fit(self.point, self.layer.floor, self.layer.noise_of(self.point.problem))

    def scores(self) -> LayerScores:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return self.directions().scores()

    def directions(self, noises: Sequence[InputNoise] | None = None) -> MotionDirections:
        """What is looked for at this fit; of use for other measurements of the same runs, too.

        noises : of the inputs; those of the layer unless given
        """
        candidates = [one for key, one in self.layer.effects.items() if key not in self.keys]
        noises = self.layer.input_noise if noises is None else noises
        return motion_directions(self.point, self.projection, candidates, self.layer.body, noises)

    def likelihood(self, like: LayerFit | None = None, *, roughly: bool = False) -> Likelihood:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        like = motion_fit_or_none(like)
        if like is None or like.point.noise is self.point.noise:
            return self.projection.likelihood()
        weighed = self.point.with_noise(like.point.noise)
        if roughly:
            projection = Projection(weighed)
            return projection.likelihood(projection.residuals())
        key = id(like.point)
        if key not in self._adapted:
            self._adapted[key] = (like.point, Projection(minimised(weighed)).likelihood())
        return self._adapted[key][1]

    @cached_property
    def _adapted(self) -> dict[int, tuple[VehiclePoint, Likelihood]]:
        """By the noise of other points, which are kept so that their identity is theirs alone."""
        return {}

    @property
    def is_far(self) -> bool:
        """See :class:`~ident.estimation.layer.LayerFit`; the bicycle is near enough."""
        return False

    def size(self, key: str) -> float:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        name, problem = next(iter(self.layer.effects[key].sizes)), self.point.problem
        if name in self.parameters:
            return self.parameters[name]
        terms = [one.name for one in problem.run_terms]
        return float(self.point.of_runs[:, terms.index(name)].mean())

    def rms(self) -> dict[str, float]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return {n: float(np.sqrt(np.mean(one.residual**2))) for n, one in self.point.residuals.items()}

    def noise(self) -> dict[str, float]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return {name: one.total_std for name, one in self.point.noise.items()}

    def slow_noise(self) -> list[str]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return capped_noise(self.point)

    def estimates(self) -> dict[str, EffectEstimate]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        return {
            key: self._estimate(self.layer.effects[key]) for key in self.keys if key in self.layer.effects
        }

    def term(self, key: str) -> tuple[float, float]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        fit = self.final
        index = [one.name for one in fit.point.problem.coordinates].index(key)
        return float(fit.shared[index]), float(np.sqrt(fit.covariance[index, index]))

    def _estimate(self, effect: MotionEffect) -> EffectEstimate:
        fit = self.final
        names = [one.name for one in fit.point.problem.coordinates]
        made = {}
        for name, parameter in effect.sizes.items():
            short = told_as(effect, parameter.name)
            if name in names:
                index = names.index(name)
                made[short] = _of_coordinate(
                    fit.point.problem.coordinates[index],
                    float(fit.shared[index]),
                    float(np.sqrt(fit.covariance[index, index])),
                    parameter.unit,
                )
            else:
                value, std = self._mean_of_runs(fit, name)
                made[short] = Estimate(value, std, value - Z * std, value + Z * std, parameter.unit)
        return EffectEstimate(effect.name, CATALOGUE[effect.name].enters, made, effect.of)

    def _mean_of_runs(self, fit: VehicleFit, term: str) -> tuple[float, float]:
        values, std = self._of_runs(fit, term)
        weight = 1 / std**2
        return float(values @ weight / weight.sum()), float(1 / np.sqrt(weight.sum()))

    def _of_runs(self, fit: VehicleFit, term: str) -> tuple[Array, Array]:
        number = [one.name for one in fit.point.problem.run_terms].index(term)
        spread = [run.own_covariance(fit.covariance)[number, number] for run in fit.point.by_run]
        return fit.point.of_runs[:, number], np.sqrt(np.array(spread) * inflation(fit))

    def sizes_by_run(self, key: str) -> tuple[Array, Array]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        effect, fit = self.layer.effects[key], self.final
        size = next(iter(effect.sizes))
        if effect.run_terms:
            return self._of_runs(fit, size)
        index = [one.name for one in fit.point.problem.coordinates].index(size)
        shift, std = shift_by_run(fit, index)
        coordinate, at = fit.point.problem.coordinates[index], float(fit.shared[index])
        return coordinate.value(at) + coordinate.slope(at) * shift, coordinate.slope(at) * std

    def is_allowed(self) -> dict[str, str]:
        """See :class:`~ident.estimation.layer.LayerFit`."""
        coordinates = {
            one.name: (one, at)
            for one, at in zip(self.point.problem.coordinates, self.point.shared, strict=True)
        }
        told = {}
        for key in (k for k in self.keys if k in self.layer.effects):
            for name in self.layer.effects[key].sizes:
                if name not in coordinates:
                    continue
                one, at = coordinates[name]
                if not one.low < at < one.high and name == next(iter(self.layer.effects[key].sizes)):
                    told[key] = (
                        f"{name.rpartition('.')[2]} runs to {one.value(at):.3g}, the end of what is possible"
                    )
        return told


def motion_fit(fit: LayerFit) -> MotionFit:
    """The same, known to be of the motion.

    Raises
    ------
    TypeError
        If it is of another layer.
    """
    if not isinstance(fit, MotionFit):
        raise TypeError("a fit of another layer")
    return fit


def motion_fit_or_none(fit: LayerFit | None) -> MotionFit | None:
    """Likewise, or None."""
    return None if fit is None else motion_fit(fit)


def _of_coordinate(one: Coordinate, at: float, std: float, unit: str) -> Estimate:
    value = one.value(at)
    ends = [one.value(at - Z * std), one.value(at + Z * std)]
    return Estimate(value, std * one.slope(at), ends[0], ends[1], unit)
