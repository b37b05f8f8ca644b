"""What a fit of a vehicle model needs of the logs: windows, inputs on a grid, outputs on raw stamps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

GAP = 1.5  # periods: a longer interval interrupts the samples
NODES = 4  # of the interpolation between grid points


@dataclass(frozen=True)
class Samples:
    """One measured signal in one window: (n,) stamps [s since the start of the run] and values."""

    times: Array
    values: Array


@dataclass(frozen=True)
class MotionRecord:
    """One window of a run, with an initial state of its own.

    run : index of the run
    times : (m,) uniform grid [s since the start of the run], at least NODES points
    road_wheel_angle, speed : (m,) inputs at the grid [rad], [m/s], linear in between
    measured : signal of the glossary -> samples within the grid; the heading is unwrapped
    reference_x : x of the point that pose and velocity refer to, from the CG [m]
    imu : x and y of the inertial unit, from the CG [m]
    reference_known : whether the reference point was stated
    """

    run: int
    times: Array
    road_wheel_angle: Array
    speed: Array
    measured: Mapping[str, Samples]
    reference_x: float = 0.0
    imu: tuple[float, float] = (0.0, 0.0)
    reference_known: bool = True

    @property
    def period(self) -> float:
        """Of the grid [s]."""
        return float((self.times[-1] - self.times[0]) / (self.times.size - 1))


def cut(record: MotionRecord, seconds: float, lead: float = 0.0) -> list[MotionRecord]:
    """Equal windows of about this length; a window ends at the grid point at which the next begins.

    lead : by how much the grid of a window begins before its samples [s], so that a late sensor still reads
        what the window holds
    """
    points, ahead = record.times.size - 1, round(lead / record.period)
    if points - ahead <= NODES:
        ahead = 0
    count = max(1, min(round((points - ahead) * record.period / seconds), (points - ahead) // NODES))
    edges = np.rint(np.linspace(ahead, points, count + 1)).astype(int).tolist()
    return [part_of(record, first, last, ahead) for first, last in pairwise(edges)]


def part_of(record: MotionRecord, first: int, last: int, ahead: int = 0) -> MotionRecord:
    """Window from one grid point to another; the last sample belongs to it only where the record ends.

    ahead : grid points by which the grid begins before the samples
    """
    grid = slice(first - ahead, last + 1)
    end = np.inf if last == record.times.size - 1 else record.times[last]
    measured = {}
    for name, samples in record.measured.items():
        own = slice(*np.searchsorted(samples.times, [record.times[first], end]))
        measured[name] = Samples(samples.times[own], samples.values[own])
    return replace(
        record,
        times=record.times[grid],
        road_wheel_angle=record.road_wheel_angle[grid],
        speed=record.speed[grid],
        measured=measured,
    )


@dataclass(frozen=True)
class SignalSamples:
    """The samples of one signal in all windows, and where they lie on the grid of all windows together.

    window : (n,) index of the window of each sample
    times, values : (n,)
    first, weights : (n,) first of NODES grid points, (n, NODES) their weights in the cubic between them
    slope_weights : (n, NODES) their weights in the slope of that cubic [1/s]
    begins : (w + 1,) where the samples of each window begin
    starts : indices at which the noise restarts
    period : median time between samples [s]
    """

    signal: str
    window: Index
    times: Array
    values: Array
    first: Index
    weights: Array
    slope_weights: Array
    begins: Index
    starts: Index
    period: float

    def beyond(self, states: int) -> int:
        """Count the samples that initial states of each window, so many, do not follow whatever they are."""
        return int(np.maximum(np.diff(self.begins) - states, 0).sum())

    def at(self, grid: Array) -> Array:
        """(n, c) values of columns (N, c) on the grid of all windows, at the samples."""
        return _at_samples(np.ascontiguousarray(grid), self.first, self.weights)

    def slopes(self, grid: Array) -> Array:
        """(n, c) derivatives to time of the same columns, of the cubic between the grid points."""
        return _at_samples(np.ascontiguousarray(grid), self.first, self.slope_weights)


@dataclass(frozen=True)
class Stretch:
    """An uninterrupted part of a run on the grid of all windows, in which windows may overlap.

    rows : (m,) of the grid of all windows; place : (m,) of each on the grid of the stretch
    times : (k,) of that grid [s since the start of the run]
    """

    rows: Index
    place: Index
    times: Array

    def whole(self, values: Array) -> Array:
        """(k, ...) values on the grid of the stretch, from those on the grid of all windows."""
        made = np.zeros((self.times.size, *values.shape[1:]))
        made[self.place] = values[self.rows]
        return made


COLUMNS = ("road_wheel_angle", "longitudinal_velocity")
"""Inputs of the model that are measured."""


class Windows:
    """The windows of all runs, one after another on one grid.

    inputs : (N, 2) as ``COLUMNS`` names them
    """

    def __init__(self, records: Sequence[MotionRecord]) -> None:
        """Take the records: at least one, those of a run one after another."""
        self.records = list(records)
        self.run = np.array([record.run for record in records], dtype=np.intp)
        self.runs = int(self.run.max()) + 1
        self.offsets = np.cumsum([0, *(record.times.size for record in records)]).astype(np.intp)
        self.steps = np.concatenate([np.full(r.times.size, r.period) for r in records])
        self.times = np.concatenate([record.times for record in records])
        self._latest: dict[str, tuple[float, SignalSamples]] = {}  # by signal: the delay asked for last
        self.inputs = np.column_stack(
            [
                np.concatenate([record.road_wheel_angle for record in records]),
                np.concatenate([record.speed for record in records]),
            ]
        )

    @cached_property
    def signals(self) -> dict[str, SignalSamples]:
        """The measured signals that any window has."""
        names = sorted({name for record in self.records for name in record.measured})
        return {name: self._samples(name) for name in names}

    def same_as(self, other: Windows) -> bool:
        """Whether they are cut from the same records, so that states of the one are of the other."""
        return self.records is other.records

    @property
    def seconds(self) -> float:
        """Driven in all windows [s]."""
        return float(sum(record.times[-1] - record.times[0] for record in self.records))

    @cached_property
    def stretches(self) -> list[Stretch]:
        """The uninterrupted parts of the runs, each driven through in windows that follow one another."""
        parts: list[list[int]] = []
        for number, record in enumerate(self.records):
            before = self.records[number - 1]
            gap = record.times[0] - before.times[-1] if number else np.inf
            if parts and record.run == before.run and gap - 1e-6 * record.period <= 0:
                parts[-1].append(number)
            else:
                parts.append([number])
        return [self._stretch(part) for part in parts]

    def _stretch(self, part: Sequence[int]) -> Stretch:
        first = self.records[part[0]]
        rows = np.concatenate([np.arange(self.offsets[k], self.offsets[k + 1]) for k in part])
        place = np.rint((self.times[rows] - first.times[0]) / first.period).astype(np.intp)
        return Stretch(rows, place, first.times[0] + first.period * np.arange(place.max() + 1))

    def run_of(self, stretch: Stretch) -> int:
        """The run that a stretch belongs to."""
        return int(self.run[np.searchsorted(self.offsets, stretch.rows[0], side="right") - 1])

    def later(self, name: str, delay: float) -> SignalSamples:
        """The samples of a signal placed where the grid was ``delay`` [s] before their stamps."""
        if self._latest.get(name, (None,))[0] != delay:
            self._latest[name] = (delay, self._samples(name, delay))
        return self._latest[name][1]

    def _samples(self, name: str, delay: float = 0.0) -> SignalSamples:
        nothing = Samples(np.zeros(0), np.zeros(0))
        own = [record.measured.get(name, nothing) for record in self.records]
        counts = [one.times.size for one in own]
        placed = [
            _placed(record, one.times - delay, int(offset))
            for record, one, offset in zip(self.records, own, self.offsets, strict=False)
        ]
        times = np.concatenate([one.times for one in own])
        begins = np.cumsum([0, *counts]).astype(np.intp)
        inner = np.concatenate([np.diff(one.times) for one in own])
        period = float(np.median(inner)) if inner.size else 1.0
        gaps = np.flatnonzero(np.diff(times) > GAP * period) + 1
        return SignalSamples(
            signal=name,
            window=np.repeat(np.arange(len(own)), counts).astype(np.intp),
            times=times,
            values=np.concatenate([one.values for one in own]),
            first=np.concatenate([first for first, _, _ in placed]),
            weights=np.concatenate([weights for _, weights, _ in placed]),
            slope_weights=np.concatenate([slopes for _, _, slopes in placed]),
            begins=begins,
            starts=np.unique(np.concatenate([begins[:-1][np.array(counts) > 0], gaps])).astype(np.intp),
            period=period,
        )


def _placed(record: MotionRecord, times: Array, offset: int) -> tuple[Index, Array, Array]:
    """First grid point, weights (n, NODES) of the cubic through four grid points (Lagrange) and its slope."""
    position = (times - record.times[0]) / record.period
    first = np.clip(np.floor(position).astype(np.intp) - 1, 0, record.times.size - NODES)
    x = position - first
    weights = np.column_stack(
        [
            -(x - 1) * (x - 2) * (x - 3) / 6,
            x * (x - 2) * (x - 3) / 2,
            -x * (x - 1) * (x - 3) / 2,
            x * (x - 1) * (x - 2) / 6,
        ]
    )
    slopes = np.column_stack(
        [
            -(3 * x**2 - 12 * x + 11) / 6,
            (3 * x**2 - 10 * x + 6) / 2,
            -(3 * x**2 - 8 * x + 3) / 2,
            (3 * x**2 - 6 * x + 2) / 6,
        ]
    )
    return (first + offset).astype(np.intp), weights, slopes / record.period


@numba.njit(cache=True, error_model="numpy")
def _at_samples(grid: Array, first: Index, weights: Array) -> Array:
    rows, width = first.size, grid.shape[1]
    values = np.empty((rows, width))
    for k in range(rows):
        i = first[k]
        for j in range(width):
            values[k, j] = (
                weights[k, 0] * grid[i, j]
                + weights[k, 1] * grid[i + 1, j]
                + weights[k, 2] * grid[i + 2, j]
                + weights[k, 3] * grid[i + 3, j]
            )
    return values
