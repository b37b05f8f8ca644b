"""What the loop needs of a part of the truck: fits with effects, and scores of those that are not in it.

The truck falls into two layers, because the steering angle between them is measured: the actuator (request to
angle) and the motion (angle and speed to yaw rate, acceleration, velocity, pose). Each is fitted by itself;
what is tested is tested over both.

A *direction* is what a candidate would add to the modelled signals, at first order in its size, whitened by
the noise of each signal and freed of all that the fitted parameters can take up. A candidate has one or more
*shapes*, each of one or several directions: a play has one shape for each width that is tried, a bias of each
run has one shape of as many directions as there are runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from ident.results import EffectEstimate, Refusal

Array = NDArray[np.float64]
Index = NDArray[np.intp]

SIZE = "size"
BIN = 0.25  # [s] of what scores are gathered in


@dataclass(frozen=True)
class Shape:
    """One form of a candidate.

    columns : of the scores
    at : parameters of the effect that this form holds, such as {"width": 0.003}; a full fit starts there
    size : size of the effect that one unit of its (first) column stands for
    """

    columns: tuple[int, ...]
    at: Mapping[str, float] = field(default_factory=dict)
    size: float = 1.0


@dataclass(frozen=True)
class Group:
    """One candidate of the screen.

    key : "sensor_bias yaw_rate" of an effect, "yaw_moment: step" of the generic basis
    effect : name in the catalogue, None for a direction of the generic basis
    """

    key: str
    shapes: tuple[Shape, ...]
    effect: str | None = None


@dataclass(frozen=True)
class LayerScores:
    """Scores of all candidates at a fit, gathered in bins of about ``BIN`` seconds within windows.

    run, time : (b,) run of each bin and its middle [s since the start of the run], in the order of driving
    scores : (b, c) sum over a bin of direction times whitened residual
    gram : (c, c) inner products of the directions over all bins
    energy : (b, c) squared length of each direction within a bin; what a bin can tell of it. A direction that
        the fitted parameters take up (less than a millionth of its squared length left) is zero throughout
    power, count : (b, s) sum of squared whitened residuals and number of samples of each signal
    activity : (b, a) how much is going on in each bin: mean squares of what excites the layer
    signals, activities : names of those columns
    groups : the candidates
    colour : (c,) how much more each score scatters than its length says, by noise that whitening signal by
        signal does not know (:mod:`ident.estimation.input_noise`); none where it is not given
    """

    layer: str
    run: Index
    time: Array
    scores: Array
    gram: Array
    energy: Array
    power: Array
    count: Array
    activity: Array
    signals: tuple[str, ...]
    activities: tuple[str, ...]
    groups: tuple[Group, ...]
    colour: Array | None = None


@dataclass(frozen=True)
class Likelihood:
    """2 log likelihood of a fit bin by bin, under a noise that is the same for all fits that are compared.

    run, time, values : (b,)
    """

    run: Index
    time: Array
    values: Array


class DoesNotFit(ValueError):
    """A model with some effects cannot be fitted to the data at hand."""


class LayerFit(Protocol):
    """A layer fitted with some effects."""

    @property
    def keys(self) -> tuple[str, ...]:
        """Of the effects that are in it."""
        ...

    @property
    def freedom(self) -> int:
        """Number of parameters that these effects add."""
        ...

    def scores(self) -> LayerScores:
        """Scores of every candidate that is not in the fit, and of the generic basis."""
        ...

    def likelihood(self, like: LayerFit | None = None, *, roughly: bool = False) -> Likelihood:
        """By the noise of this fit, or of another one of the same layer.

        roughly : to first order in what another noise changes, where that is quicker
        """
        ...

    def estimates(self) -> dict[str, EffectEstimate]:
        """The effects with their parameters, by key."""
        ...

    @property
    def is_far(self) -> bool:
        """Whether it is so far from the data that scores at it say little: then all effects are fitted."""
        ...

    def size(self, key: str) -> float:
        """Size of an effect that is in it, in the unit of the effect."""
        ...

    def term(self, key: str) -> tuple[float, float]:
        """Coefficient of a generic term that is in the fit, and its standard error."""
        ...

    def sizes_by_run(self, key: str) -> tuple[Array, Array]:
        """(r,) size of an effect by each run alone, (r,) its standard error; infinite where a run is mute."""
        ...

    def noise(self) -> dict[str, float]:
        """Standard deviation of the noise of each compared signal."""
        ...

    def slow_noise(self) -> list[str]:
        """Signals whose residual lasts longer than noise is taken to: that of theirs is at least as told."""
        ...

    def rms(self) -> dict[str, float]:
        """Root mean square of measured minus modelled, of the runs of the fit."""
        ...

    def renoised(self) -> Self:
        """The same effects, with the noise identified anew from what is left."""
        ...

    def is_allowed(self) -> dict[str, str]:
        """Key -> why the estimate of this effect is physically impossible; empty where all are possible."""
        ...


class Layer(Protocol):
    """One part of the truck with its data: the actuator or the motion."""

    @property
    def name(self) -> str:
        """Of the layer."""
        ...

    @property
    def runs(self) -> list[str]:
        """Names of its runs."""
        ...

    @property
    def not_testable(self) -> list[Refusal]:
        """Effects that its data cannot test, with the reason."""
        ...

    def fitted(
        self,
        keys: Sequence[str] = (),
        *,
        start: LayerFit | None = None,
        shapes: Mapping[str, Sequence[Mapping[str, float]]] | None = None,
    ) -> LayerFit:
        """Fit the base model with these effects, all parameters free.

        start : a fit to begin from
        shapes : key -> values of its parameters to begin from, several starts; ``SIZE`` stands for the first
            parameter where its own name is not among them
        """
        ...

    def without(self, runs: Sequence[str]) -> Layer:
        """The layer without some runs."""
        ...

    def with_term(self, key: str, at: Mapping[str, float], fit: LayerFit) -> Layer | None:
        """The layer with a generic term of the screen, which ``fitted`` then takes as a key."""
        ...

    def held_out(self, fit: LayerFit, runs: Sequence[str]) -> HeldOut:
        """Errors of a fit in runs that may have taken no part in it; only initial states are estimated."""
        ...

    def effect(self, key: str) -> EffectCard:
        """What is said of an effect to a reader."""
        ...


@dataclass(frozen=True)
class HeldOut:
    """Errors of a fitted model on some runs.

    errors : signal -> (n,) measured minus modelled; run, time : signal -> (n,) place of the run among those
        that were asked for, [s]
    modelled : signal -> (n,); of the position along its measured path and across it [m]
    likelihood : by the noise of the fit
    """

    errors: dict[str, Array]
    modelled: dict[str, Array]
    run: dict[str, Index]
    time: dict[str, Array]
    likelihood: Likelihood


@dataclass(frozen=True)
class EffectCard:
    """What the catalogue says of an effect.

    name, enters : as in the catalogue; of : signal that it acts on
    size : its first parameter; unit, typical : of the size
    equation : SymPy expression or equation of the changed term
    meaning : in words, one sentence
    shown_by : the run that shows it, in words
    positive : whether its size cannot be negative
    meanings : parameter -> what it is, in words
    """

    name: str
    enters: str
    of: str | None
    size: str
    unit: str
    typical: float
    equation: object
    meaning: str
    shown_by: str
    positive: bool = True
    meanings: Mapping[str, str] = field(default_factory=dict)
