"""How well a model predicts measured motion: simulation from the logged state, errors, their intervals.

A segment is simulated from the state that the log gives at its first instant, driven by the logged speed and
steering; nothing is estimated in it. Errors are measured minus simulated at the raw stamps:

    RMS = sqrt(mean(e²)),  NRMSE = RMS/std(y),  VAF = 1 - var(e)/var(y).

Intervals: bootstrap of blocks of ``BLOCK`` seconds of driving, which are longer than what a manoeuvre
correlates over. Two models are compared on the same segments, paired block by block.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.engine import Engine
from ident.estimation.vehicle_records import MotionRecord, Windows, part_of

Array = NDArray[np.float64]
Index = NDArray[np.intp]

BLOCK = 10.0  # [s]
DRAWS = 2000
NEAR = 0.15  # [s] of the samples around an instant that give its state
MOUNTING = ("reference_x", "imu_x", "imu_y")
REPEATS = 5  # of a timing; the fastest counts
LEAST_SAMPLES = 3


@dataclass(frozen=True)
class Candidate:
    """A model that predicts motion from road-wheel angle and longitudinal velocity.

    parameters : all of the engine's but where the sensors are
    """

    name: str
    engine: Engine
    parameters: Mapping[str, float]

    def vectors(self, records: Sequence[MotionRecord]) -> Array:
        """(w, p) parameters for each segment."""
        rows = []
        for record in records:
            mounting = dict(zip(MOUNTING, (record.reference_x, *record.imu), strict=True))
            known = {**self.parameters, **mounting}
            rows.append([known[name] for name in self.engine.parameters])
        return np.array(rows)


@dataclass(frozen=True)
class Segments:
    """Parts of runs to be predicted, each from its own logged state.

    records : one a segment; they may overlap
    states : (w, 5) lateral velocity and yaw rate of the CG, heading, position of the CG at their beginning
    substeps : (N,) RK4 steps in each step of the grid
    """

    records: list[MotionRecord]
    states: Array

    @cached_property
    def windows(self) -> Windows:
        """The segments on one grid."""
        return Windows(self.records)

    @cached_property
    def _block_numbers(self) -> dict[tuple[int, int], int]:
        """Number of each block of driving that a segment reaches into: (run, which of its blocks)."""
        reached = {
            (record.run, block)
            for record in self.records
            for block in range(int(record.times[0] // BLOCK), int(record.times[-1] // BLOCK) + 1)
        }
        return {key: number for number, key in enumerate(sorted(reached))}

    @property
    def block_count(self) -> int:
        """How many blocks of driving there are."""
        return len(self._block_numbers)

    def blocks_of(self, signal: str) -> Index:
        """(n,) block of driving of each sample of a signal."""
        samples = self.windows.signals[signal]
        return self.blocks_at(samples.window, samples.times)

    def blocks_at(self, segment: Index, times: Array) -> Index:
        """(n,) block of driving of instants (n,) [s since the start of the run] in segments (n,)."""
        keys = zip(self.windows.run[segment].tolist(), (times // BLOCK).astype(int).tolist(), strict=True)
        numbers = self._block_numbers
        return np.array([numbers[key] for key in keys], dtype=np.intp)


STATES = ("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")


def whole(records: Sequence[MotionRecord], rear_arm: float) -> Segments:
    """Every record from its first instant to its last."""
    return Segments(list(records), np.array([logged_state(r, r.times[0], rear_arm) for r in records]))


def from_many_starts(
    records: Sequence[MotionRecord], seconds: float, every: float, rear_arm: float
) -> Segments:
    """Segments of equal length whose beginnings are ``every`` seconds apart."""
    parts, states = [], []
    for record in records:
        length, step = round(seconds / record.period), max(1, round(every / record.period))
        for first in range(0, record.times.size - length, step):
            parts.append(part_of(record, first, first + length))
            states.append(logged_state(record, record.times[first], rear_arm))
    return Segments(parts, np.array(states).reshape(len(parts), len(STATES)))


def logged_state(record: MotionRecord, instant: float, rear_arm: float) -> Array:
    """State of the CG at an instant, from the samples near it.

    Where no lateral velocity is logged the rear axle is taken not to slip: v_y = l_r r.
    """
    at = {name: _at(record, name, instant) for name in STATES}
    yaw_rate = at["yaw_rate"]
    if yaw_rate is None:
        yaw_rate = _slope(record, "heading", instant) or 0.0
    lateral = at["lateral_velocity"]
    across = rear_arm * yaw_rate if lateral is None else lateral - record.reference_x * yaw_rate
    heading = at["heading"] or 0.0
    x = (at["position_x"] or 0.0) - record.reference_x * np.cos(heading)
    y = (at["position_y"] or 0.0) - record.reference_x * np.sin(heading)
    return np.array([across, yaw_rate, heading, x, y])


def _near(record: MotionRecord, name: str, instant: float) -> tuple[Array, Array] | None:
    samples = record.measured.get(name)
    if samples is None or samples.times.size < LEAST_SAMPLES:
        return None
    near = np.flatnonzero(np.abs(samples.times - instant) <= NEAR)
    if near.size < LEAST_SAMPLES:
        near = np.argsort(np.abs(samples.times - instant))[:LEAST_SAMPLES]
    return samples.times[near] - instant, samples.values[near]


def _at(record: MotionRecord, name: str, instant: float) -> float | None:
    """Value of a straight line through the samples near an instant."""
    near = _near(record, name, instant)
    return None if near is None else float(np.polyfit(*near, 1)[1])


def _slope(record: MotionRecord, name: str, instant: float) -> float | None:
    near = _near(record, name, instant)
    return None if near is None else float(np.polyfit(*near, 1)[0])


@dataclass(frozen=True)
class Prediction:
    """What a model predicts on segments.

    outputs : name -> (N,) on the grid of all segments
    errors : signal -> (n,) measured minus predicted at the samples
    measured : signal -> (n,); segment, block : signal -> (n,) of each sample
    """

    outputs: dict[str, Array]
    errors: dict[str, Array]
    measured: dict[str, Array]
    segment: dict[str, Index]
    block: dict[str, Index]


def predict(candidate: Candidate, segments: Segments) -> Prediction:
    """Simulate every segment and compare it with what was measured."""
    engine, windows = candidate.engine, segments.windows
    starts = segments.states[:, [STATES.index(name) for name in engine.states]]
    vectors = candidate.vectors(segments.records)
    _, outputs = engine.simulate(
        np.ascontiguousarray(starts), windows.inputs, windows.steps, windows.offsets, vectors
    )
    columns = dict(zip(engine.outputs, outputs.T, strict=True))
    errors, measured, segment, block = {}, {}, {}, {}
    for name, samples in windows.signals.items():
        if name in columns:
            modelled = samples.at(np.ascontiguousarray(columns[name][:, None]))[:, 0]
            errors[name], measured[name] = samples.values - modelled, samples.values
            segment[name], block[name] = samples.window, segments.blocks_of(name)
    return Prediction(columns, errors, measured, segment, block)


def nanoseconds_per_step(candidate: Candidate, segments: Segments) -> float:
    """Processor time to simulate one step of the grid, the fastest of several runs [ns]."""
    engine, windows = candidate.engine, segments.windows
    starts = np.ascontiguousarray(segments.states[:, [STATES.index(name) for name in engine.states]])
    vectors = candidate.vectors(segments.records)
    spent = []
    for _ in range(REPEATS):
        begin = time.thread_time()
        engine.simulate(starts, windows.inputs, windows.steps, windows.offsets, vectors)
        spent.append(time.thread_time() - begin)
    return 1e9 * min(spent) / windows.times.size


@dataclass(frozen=True)
class BlockSums:
    """Squared errors of one signal, block by block: (b,) sums and counts of samples."""

    squares: Array
    counts: Array

    @property
    def rms(self) -> float:
        """Root mean square over all blocks."""
        return float(np.sqrt(self.squares.sum() / max(self.counts.sum(), 1.0)))

    def draws(self, weights: Array) -> Array:
        """(d,) root mean squares with the blocks drawn as often as ``weights`` (d, b) say."""
        return np.asarray(np.sqrt(weights @ self.squares / np.maximum(weights @ self.counts, 1e-300)))


def block_sums(
    found: Prediction, signal: str, count: int, chosen: NDArray[np.bool_] | None = None
) -> BlockSums:
    """Gather the errors of a signal by the block of driving that they fall into.

    Parameters
    ----------
    count : of the blocks
    chosen : (w,) segments that count; all where None
    """
    errors, block = found.errors[signal], found.block[signal]
    keep = np.ones(errors.size, dtype=np.bool_) if chosen is None else chosen[found.segment[signal]]
    samples = np.bincount(block[keep], minlength=count).astype(np.float64)
    return BlockSums(np.bincount(block[keep], errors[keep] ** 2, count).astype(np.float64), samples)


def bootstrap_weights(blocks: int, seed: int) -> Array:
    """(DRAWS, blocks) how often each block is drawn, with replacement."""
    random = np.random.default_rng(seed)
    return random.multinomial(blocks, np.full(blocks, 1 / blocks), DRAWS).astype(np.float64)


def interval(sums: BlockSums, weights: Array) -> tuple[float, float] | None:
    """95 % interval of the root mean square; None where fewer than three blocks hold samples."""
    if np.count_nonzero(sums.counts) < 3:
        return None
    low, high = np.quantile(sums.draws(weights), [0.025, 0.975])
    return float(low), float(high)


def paired(one: BlockSums, other: BlockSums, weights: Array) -> tuple[float, float, float, float]:
    """Ratio of two root mean squares on the same blocks, its interval, and the p-value of no difference."""
    ratios = one.draws(weights) / np.maximum(other.draws(weights), 1e-300)
    low, high = np.quantile(ratios, [0.025, 0.975])
    beyond = min(np.mean(ratios >= 1), np.mean(ratios <= 1))
    p = min(1.0, 2 * max(float(beyond), 1 / DRAWS))
    return one.rms / max(other.rms, 1e-300), float(low), float(high), p
