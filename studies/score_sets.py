"""Scores made from rows of a known noise: sets on which the statistics of the loop are measured.

A truck is stood for by a second-order lag in front of two signals. Directions are regressors of its input
that passed the lag; what a fit takes up (a gain, a lag, a constant of each run, the initial state of each
window) is projected off; noise is whitened by an autoregression of order one whose correlation time is at
most 0.2 s, which is right for some of the noises and wrong for others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from score_colour import colour

from ident.estimation.layer import BIN, Group, LayerScores, Shape

Array = NDArray[np.float64]

PERIOD = 0.02  # [s]
SIGNALS = ("yaw_rate", "lateral_acceleration")
WINDOW = 10.0  # [s] a new initial state
LONGEST = 0.2  # [s] of the colour that counts as noise
WIDTHS = (0.05, 0.1, 0.2, 0.4, 0.8)

Noise = Callable[[np.random.Generator, int], Array]


def second_order(values: Array, frequency: float = 1.2, damping: float = 0.6) -> Array:
    """Values behind a lag of second order, of gain one [Hz, -]."""
    w, d = 2 * np.pi * frequency * PERIOD, np.exp(-2 * np.pi * frequency * damping * PERIOD)
    poles = [1.0, -2 * d * np.cos(w * np.sqrt(1 - damping**2)), d**2]
    return np.asarray(lfilter([sum(poles)], poles, values, axis=0))


def coloured(random: np.random.Generator, count: int, seconds: float) -> Array:
    """(count,) noise of variance one with an exponential correlation."""
    pole = np.exp(-PERIOD / seconds)
    start = random.standard_normal()
    driven = lfilter(
        [np.sqrt(1 - pole**2)], [1.0, -pole], random.standard_normal(count), zi=np.array([pole * start])
    )
    return np.asarray(driven[0])


def white(random: np.random.Generator, count: int) -> Array:
    """White, of variance one."""
    return random.standard_normal((count, 2))


def strong_colour(random: np.random.Generator, count: int) -> Array:
    """An autoregression of 0.9 a sample with white noise on it: of a higher order than the whitening."""
    return np.column_stack(
        [
            coloured(random, count, PERIOD / -np.log(0.9)) + 0.5 * random.standard_normal(count)
            for _ in SIGNALS
        ]
    )


def gusts(random: np.random.Generator, count: int) -> Array:
    """White, and a disturbance of 1.5 s that passes the lag, as strong as the noise itself."""
    gust = second_order(coloured(random, count, 1.5))
    return random.standard_normal((count, 2)) + gust[:, None] * np.array([1.0, 0.7])


def weak_gusts(random: np.random.Generator, count: int) -> Array:
    """The same at a fifth of the size: hardly seen in any bin."""
    gust = second_order(coloured(random, count, 1.5))
    return random.standard_normal((count, 2)) + 0.2 * gust[:, None] * np.array([1.0, 0.7])


def heavy_tails(random: np.random.Generator, count: int) -> Array:
    """Student's t of three degrees of freedom."""
    return np.clip(random.standard_t(3, (count, 2)), -30, 30) / np.sqrt(3)


def runs_unlike(random: np.random.Generator, count: int) -> Array:
    """White, of another size every ten seconds or so."""
    size = np.exp(0.5 * coloured(random, count, 10.0))
    return random.standard_normal((count, 2)) * size[:, None]


NOISES: dict[str, Noise] = {
    "white": white,
    "AR(1) 0.9 + white": strong_colour,
    "gusts 1.5 s": gusts,
    "weak gusts": weak_gusts,
    "heavy tails": heavy_tails,
    "runs unlike": runs_unlike,
}


def driven(random: np.random.Generator, count: int) -> Array:
    """(count,) input of a run: steps, a sine or a sweep, or a hand's."""
    t = np.arange(count) * PERIOD
    kind = random.integers(4)
    if kind == 0:
        levels = random.choice([-1.0, -0.5, 0.0, 0.5, 1.0], count)
        return np.asarray(levels[(t // 4).astype(int)])
    if kind == 1:
        return np.asarray(random.uniform(0.4, 1.2) * np.sin(2 * np.pi * random.uniform(0.1, 0.5) * t))
    if kind == 2:
        return np.asarray(0.6 * np.sin(2 * np.pi * (0.1 + 0.5 * t / t[-1]) * t))
    return second_order(coloured(random, count, 1.0), 0.5)


def play(values: Array, width: float) -> Array:
    """Values behind a play."""
    out, at = np.empty_like(values), 0.0
    for k, value in enumerate(values):
        at = min(max(at, value - width / 2), value + width / 2)
        out[k] = at
    return out


@dataclass(frozen=True)
class Truck:
    """Runs of a truck: input (n,), run (n,), time (n,) [s], speed (n,)."""

    run: NDArray[np.intp]
    time: Array
    input: Array
    speed: Array

    @cached_property
    def directions(self) -> tuple[Array, tuple[Group, ...]]:
        """(2 n, c) of signal after signal, and the groups."""
        return _directions(self)

    @cached_property
    def nuisance(self) -> Array:
        """(2 n, p) what a fit takes up."""
        u, n = self.input, self.input.size
        rate = np.gradient(u, PERIOD)
        shared = [self.both(u, both) for both in ((1.0, 0.0), (0.0, 1.0))]
        shared += [self.both(rate), self.both(second_order(rate))]
        window = self.run * 1000 + (self.time // WINDOW).astype(int)
        for each in np.unique(window):
            since = self.time - self.time[window == each][0]
            for damping in (0.3, 0.8):
                decay = np.where(window == each, np.exp(-since / damping), 0.0)
                shared += [np.concatenate([decay, 0 * decay]), np.concatenate([0 * decay, decay])]
        for run in np.unique(self.run):
            here = (self.run == run).astype(float)
            shared.append(np.concatenate([here, np.zeros(n)]))
        return np.column_stack(shared)

    def both(self, port: Array, gains: tuple[float, float] = (1.0, 0.7)) -> Array:
        """(2 n,) what an addition to the input adds to both signals, run by run."""
        out = np.concatenate([second_order(port[self.run == run]) for run in np.unique(self.run)])
        return np.concatenate([gains[0] * out, gains[1] * self.speed * out])


def truck(random: np.random.Generator, runs: int = 8, seconds: float = 40.0) -> Truck:
    """Some runs."""
    count = round(seconds / PERIOD)
    inputs = [driven(random, count) for _ in range(runs)]
    speeds = random.choice([0.5, 1.0, 1.5], runs)
    return Truck(
        run=np.repeat(np.arange(runs), count).astype(np.intp),
        time=np.tile(np.arange(count) * PERIOD, runs),
        input=np.concatenate(inputs),
        speed=np.repeat(speeds, count),
    )


def _directions(of: Truck) -> tuple[Array, tuple[Group, ...]]:
    u, t, v = of.input, of.time, of.speed
    rate = np.gradient(u, PERIOD)
    found: list[Array] = []
    groups: list[Group] = []

    def add(key: str, columns: list[Array], effect: str | None, *, each: bool = False) -> None:
        first = len(found)
        found.extend(columns)
        numbers = tuple(range(first, len(found)))
        shapes = tuple(Shape((k,)) for k in numbers) if each else (Shape(numbers),)
        groups.append(Group(key, shapes, effect))

    first = len(found)
    found.extend([of.both(play(u, width) - u) for width in WIDTHS])
    shapes = tuple(Shape((first + k,), {"width": w}, w) for k, w in enumerate(WIDTHS))
    groups.append(Group("play", shapes, "steering_linkage_play"))
    add("relaxation", [of.both(rate / v)], "tyre_relaxation")
    add("ratio", [of.both(u * np.abs(u)), of.both(u**3)], "steering_ratio_nonlinearity")
    limit = np.clip(rate, -3.0, 3.0) - rate
    add("rate limit", [of.both(limit)], "steering_rate_limit")
    zero = np.zeros(u.size)
    latency = [
        np.concatenate([of.both(rate)[: u.size], zero]),
        np.concatenate([zero, of.both(rate)[u.size :]]),
    ]
    for name, column in zip(SIGNALS, latency, strict=True):
        add(f"latency {name}", [column], "sensor_latency")
    biases = [np.concatenate([zero, (of.run == run).astype(float)]) for run in np.unique(of.run)]
    add("bias lateral_acceleration", biases, "sensor_bias")
    roll = [second_order(of.both(u)[u.size :], f, 0.3) for f in (0.5, 0.8, 1.2)]
    add("roll", [np.concatenate([zero, column]) for column in roll], "body_roll", each=True)
    for port, gains in {"force": (1.0, 0.7), "moment": (1.0, -0.3)}.items():
        for name, values in {
            "|u|": np.abs(u), "u|u|": u * np.abs(u), "u³": u**3, "sgn u'": np.sign(rate), "v u": v * u,
            "u' |u'|": rate * np.abs(rate), "t": t,
        }.items():  # fmt: skip
            add(f"{port}: {name}", [of.both(values, gains)], None)
        steps = [
            of.both(np.where((of.run == run) & (t > at), 1.0, 0.0), gains)
            for run in np.unique(of.run)
            for at in np.arange(4.0, t.max() - 2.0, 4.0)
        ]
        add(f"{port}: step", steps, None, each=True)
    return np.column_stack(found), tuple(groups)


@dataclass(frozen=True)
class Whitened:
    """Rows of a truck under one whitening: directions (2 n, c) freed of what the fit takes up."""

    truck: Truck
    poles: Array
    directions: Array
    basis: Array
    bins: NDArray[np.intp]
    activity: Array

    def rows(self, values: Array) -> Array:
        """(2 n, ...) whitened: signal after signal, run after run."""
        return _whiten(values, self.truck.run, self.poles)

    def scores(self, noise: Array, layer: str = "motion") -> LayerScores:
        """Of measured minus modelled (n, 2) before the fit."""
        rows = self.rows(noise.T.ravel())
        rows = rows - self.basis @ (self.basis.T @ rows)
        rows = rows / np.repeat([np.std(part) for part in np.split(rows, 2)], rows.size // 2)
        count = self.bins.max() + 1
        both = np.concatenate([self.bins, self.bins])
        run, time = (self._first(values) for values in (self.truck.run, self.truck.time))
        squares = [np.bincount(self.bins, part**2, count) for part in np.split(rows, 2)]
        each = np.bincount(self.bins, minlength=count).astype(float)
        return LayerScores(
            layer=layer,
            run=run.astype(np.intp),
            time=time + BIN / 2,
            scores=_sums(self.directions * rows[:, None], both),
            gram=self.gram,
            energy=self.energy,
            power=np.column_stack(squares),
            count=np.column_stack([each, each]),
            activity=self.activity,
            signals=SIGNALS,
            activities=("rate", "size"),
            groups=self.truck.directions[1],
            colour=colour(
                self.gathered,
                np.column_stack([np.bincount(self.bins, part, count) for part in np.split(rows, 2)])
                / np.sqrt(each)[:, None],
                run.astype(np.intp),
                time + BIN / 2,
                np.diag(self.gram),
            ),
        )

    @cached_property
    def gathered(self) -> Array:
        """(b, 2, c) directions summed over bins."""
        sums = np.stack([_sums(part, self.bins) for part in np.split(self.directions, 2)], axis=1)
        return np.asarray(sums / np.sqrt(np.bincount(self.bins))[:, None, None])

    @cached_property
    def gram(self) -> Array:
        """(c, c)."""
        return self.directions.T @ self.directions

    @cached_property
    def energy(self) -> Array:
        """(b, c)."""
        return _sums(self.directions**2, np.concatenate([self.bins, self.bins]))

    def _first(self, values: Array | NDArray[np.intp]) -> Array:
        return np.asarray(values[np.unique(self.bins, return_index=True)[1]], dtype=float)


def _sums(rows: Array, bins: NDArray[np.intp]) -> Array:
    order = np.argsort(bins, kind="stable")
    begins = np.flatnonzero(np.diff(bins[order], prepend=-1))
    return np.asarray(np.add.reduceat(rows[order], begins, axis=0))


def _whiten(values: Array, run: NDArray[np.intp], poles: Array) -> Array:
    first = np.tile(np.diff(run, prepend=-1) != 0, 2)
    pole = np.repeat(poles, run.size)
    before = np.roll(values, 1, axis=0)
    shape = (-1,) + (1,) * (values.ndim - 1)
    rest = values - pole.reshape(shape) * before
    start = np.sqrt(1 - pole**2).reshape(shape) * values
    return np.asarray(np.where(first.reshape(shape), start, rest))


def whitened(of: Truck, noise: Array) -> Whitened:
    """Whiten by the first autocorrelation of a noise (n, 2) like that to be tested, and project."""
    parts = [noise[of.run == run] for run in np.unique(of.run)]
    at = sum((part[1:] * part[:-1]).sum(axis=0) for part in parts) / sum(
        (part**2).sum(axis=0) for part in parts
    )
    poles = np.clip(at, 0.0, np.exp(-PERIOD / LONGEST))
    directions = _whiten(of.directions[0], of.run, poles)
    basis = np.linalg.qr(_whiten(of.nuisance, of.run, poles))[0]
    free = directions - basis @ (basis.T @ directions)
    left = (free**2).sum(axis=0) / np.maximum((directions**2).sum(axis=0), 1e-300)
    free[:, left < 1e-6] = 0.0
    bins = (of.run * 10000 + (of.time / BIN + 1e-9).astype(int)).astype(np.intp)
    bins = np.unique(bins, return_inverse=True)[1].astype(np.intp)
    rate = np.gradient(of.input, PERIOD)
    size = np.bincount(bins)
    activity = np.column_stack([np.bincount(bins, values**2) / size for values in (rate, of.input)])
    return Whitened(of, poles, free, basis, bins, activity)


def null_scores(random: np.random.Generator, of: Truck, kind: str) -> LayerScores:
    """Scores of a truck with one of NOISES and nothing else."""
    noise = drawn(random, of, kind)
    return whitened(of, noise).scores(noise)


def drawn(random: np.random.Generator, of: Truck, kind: str) -> Array:
    """(n, 2) noise of one of NOISES."""
    counts = np.bincount(of.run).tolist()
    return np.concatenate([NOISES[kind](random, count) for count in counts])
