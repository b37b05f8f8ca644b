"""A layer of the loop in which everything is linear: effects are columns, fits are least squares.

The signal is 20 samples a second of white noise of unit size, in four runs of a minute, on what the truth
adds of the columns. All is exact, so that the loop around it can be tested by itself, and quickly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from ident.estimation.layer import (
    BIN,
    DoesNotFit,
    EffectCard,
    Group,
    HeldOut,
    LayerScores,
    Likelihood,
    Shape,
)
from ident.results import EffectEstimate, Estimate, Refusal

Array = NDArray[np.float64]

RATE = 20.0  # [1/s]
RUNS, SECONDS = 4, 60.0
COUNT = round(RATE * SECONDS)


def column(seed: int) -> Array:
    """(n,) of unit size and about a second of memory, over all runs."""
    random = np.random.default_rng([seed, 5])
    made = gaussian_filter1d(random.standard_normal((RUNS, COUNT)), 0.5 * RATE, axis=1)
    return (made / made.std()).ravel()


@dataclass(frozen=True)
class LinearLayer:
    """See :class:`ident.estimation.layer.Layer`.

    values : (n,); effects, generic : key -> (n,)
    positive : effects that cannot be negative; impossible : effect -> why it is
    blown_up : effects with which no fit is possible; dull : effects that a fit hardly uses
    far : whether its fits are far from the data
    """

    values: Array
    effects: Mapping[str, Array]
    generic: Mapping[str, Array] = field(default_factory=dict)
    positive: frozenset[str] = frozenset()
    impossible: Mapping[str, str] = field(default_factory=dict)
    blown_up: frozenset[str] = frozenset()
    dull: frozenset[str] = frozenset()
    far: bool = False
    run: NDArray[np.intp] = field(default_factory=lambda: np.repeat(np.arange(RUNS), COUNT))
    name: str = "motion"

    @property
    def runs(self) -> list[str]:
        return [f"run_{number}" for number in np.unique(self.run)]

    @property
    def not_testable(self) -> list[Refusal]:
        return []

    @property
    def time(self) -> Array:
        return np.tile(np.arange(COUNT) / RATE, self.values.size // COUNT)

    @cached_property
    def base(self) -> Array:
        """(n, r + 1) a constant of each run, and a slope that all share."""
        return np.column_stack([self.run[:, None] == np.unique(self.run), column(0)[: self.values.size]])

    def columns(self, keys: Sequence[str]) -> Array:
        known = {**self.generic, **self.effects}
        return np.column_stack([self.base, *(known[key] for key in keys)])

    def fitted(
        self,
        keys: Sequence[str] = (),
        *,
        start: LinearFit | None = None,
        shapes: Mapping[str, Sequence[Mapping[str, float]]] | None = None,
    ) -> LinearFit:
        del shapes  # least squares needs no start
        if hopeless := self.blown_up & set(keys):
            raise DoesNotFit(f"the model blows up with {', '.join(hopeless)}")
        rows = self.columns(keys)
        found = np.linalg.lstsq(rows, self.values, rcond=None)[0]
        for number, key in enumerate(keys):
            found[self.base.shape[1] + number] *= 0.001 if key in self.dull else 1.0
        noise = start.std if start else float(np.std(self.values - rows @ found))
        return LinearFit(self, tuple(keys), found, noise)

    def without(self, runs: Sequence[str]) -> LinearLayer:
        kept = ~np.isin(self.run, [self.runs.index(name) for name in runs])
        effects = {key: one[kept] for key, one in self.effects.items()}
        generic = {key: one[kept] for key, one in self.generic.items()}
        return replace(self, values=self.values[kept], run=self.run[kept], effects=effects, generic=generic)

    def with_term(self, key: str, at: Mapping[str, float], fit: LinearFit) -> LinearLayer | None:
        del at, fit
        return self if key in self.generic else None

    def held_out(self, fit: LinearFit, runs: Sequence[str]) -> HeldOut:
        raise NotImplementedError

    def effect(self, key: str) -> EffectCard:
        meaning = f"what {key} does"
        positive = key in self.positive
        return EffectCard(key, "Y", None, "size", "m", 0.5, None, meaning, f"a run for {key}", positive)


@dataclass(frozen=True)
class LinearFit:
    """See :class:`ident.estimation.layer.LayerFit`."""

    layer: LinearLayer
    keys: tuple[str, ...]
    found: Array
    std: float

    @property
    def is_far(self) -> bool:
        return self.layer.far

    @property
    def freedom(self) -> int:
        return len(self.keys)

    @property
    def residual(self) -> Array:
        return self.layer.values - self.layer.columns(self.keys) @ self.found

    @property
    def covariance(self) -> Array:
        rows = self.layer.columns(self.keys)
        return self.std**2 * np.linalg.inv(rows.T @ rows)

    @property
    def bins(self) -> NDArray[np.intp]:
        """(n,) bin of each sample."""
        size = round(BIN * RATE)
        return np.arange(self.layer.values.size) // size

    def summed(self, values: Array) -> Array:
        made = np.zeros((int(self.bins.max()) + 1, *values.shape[1:]))
        np.add.at(made, self.bins, values)
        return made

    @property
    def places(self) -> tuple[NDArray[np.intp], Array]:
        size = round(BIN * RATE)
        return self.layer.run[::size], self.layer.time[::size] + BIN / 2

    def scores(self) -> LayerScores:
        left = {k: c for k, c in self.layer.effects.items() if k not in self.keys}
        everything = {**left, **self.layer.generic}
        rows = self.layer.columns(self.keys)
        directions = np.column_stack(list(everything.values())) / self.std
        before = np.sum(directions**2, axis=0)
        directions = directions - rows @ np.linalg.lstsq(rows, directions, rcond=None)[0]
        directions[:, np.sum(directions**2, axis=0) < 1e-6 * before] = 0.0
        white = self.residual / self.std
        run, time = self.places
        return LayerScores(
            layer=self.layer.name,
            run=run,
            time=time,
            scores=self.summed(directions * white[:, None]),
            gram=directions.T @ directions,
            energy=self.summed(directions**2),
            power=self.summed(white[:, None] ** 2),
            count=self.summed(np.ones((white.size, 1))),
            activity=self.summed(column(0)[: white.size, None] ** 2),
            signals=("reading",),
            activities=("input",),
            groups=tuple(
                Group(key, (Shape((number,)),), key if key in left else None)
                for number, key in enumerate(everything)
            ),
        )

    def likelihood(self, like: LinearFit | None = None, *, roughly: bool = False) -> Likelihood:
        del roughly  # all is linear
        std = like.std if like is not None else self.std
        return Likelihood(*self.places, -self.summed((self.residual / std) ** 2))

    def size(self, key: str) -> float:
        return float(self.found[self.layer.base.shape[1] + self.keys.index(key)])

    def term(self, key: str) -> tuple[float, float]:
        number = self.layer.base.shape[1] + self.keys.index(key)
        return self.size(key), float(np.sqrt(self.covariance[number, number]))

    def estimates(self) -> dict[str, EffectEstimate]:
        made = {}
        for key in self.keys:
            value, std = self.term(key)
            estimate = Estimate(value, std, value - 1.96 * std, value + 1.96 * std, "m")
            made[key] = EffectEstimate(key, "Y", {"size": estimate}, None)
        return made

    def sizes_by_run(self, key: str) -> tuple[Array, Array]:
        """Of each run alone, all else as it is."""
        own, left = self.layer.effects[key], self.residual
        runs = [self.layer.run == number for number in np.unique(self.layer.run)]
        told = np.array([float(own[r] @ own[r]) for r in runs])
        away = np.array([float(own[r] @ left[r]) for r in runs]) / told
        return self.size(key) + away, self.std / np.sqrt(told)

    def noise(self) -> dict[str, float]:
        return {"reading": self.std}

    def rms(self) -> dict[str, float]:
        return {"reading": float(np.sqrt(np.mean(self.residual**2)))}

    def renoised(self) -> LinearFit:
        return replace(self, std=float(np.std(self.residual)))

    def is_allowed(self) -> dict[str, str]:
        return {key: why for key, why in self.layer.impossible.items() if key in self.keys}


def made_layer(truth: Mapping[str, float], seed: int, **parts) -> LinearLayer:
    """A layer with effects e1 ... e6 and generic terms g1 ... g4, of which the truth holds some.

    parts : of the layer; effects, generic : columns beside those, or in their place
    """
    effects = {f"e{k}": column(k) for k in range(1, 7)} | parts.pop("effects", {})
    generic = {f"force: g{k}": column(100 + k) for k in range(1, 5)} | parts.pop("generic", {})
    values = 0.7 * column(0) + np.random.default_rng(seed).standard_normal(column(0).size)
    for key, size in truth.items():
        values = values + size * {**effects, **generic}[key]
    return LinearLayer(values, effects, generic, **parts)
