"""Errors of one model on the held-out runs, in every cut in which they are told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.evaluation import (
    BlockSums,
    Candidate,
    Prediction,
    Segments,
    block_sums,
    bootstrap_weights,
    from_many_starts,
    interval,
    nanoseconds_per_step,
    predict,
    whole,
)
from ident.estimation.vehicle_records import MotionRecord
from ident.results import AccelerationBand, Error, EvaluatedModel, InputLevel, ModelName, RunError
from ident.stages.evaluate_data import HeldOut, by_request, driver_of
from ident.stages.evaluate_settings import UNITS

Array = NDArray[np.float64]

LENGTHS = {"1 s": 1.0, "2 s": 2.0, "5 s": 5.0}
JUDGED = "2 s"
SHORTEST = "1 s"
EVERY = 0.5  # [s] between the starts of windows
BANDS = (0.0, 1.0, 2.0, 3.0, 4.0, np.inf)  # [m/s²]
LEAST_SECONDS = 2.0  # in a band, that it counts
ANGLE = "road_wheel_angle"


@dataclass(frozen=True)
class Level:
    """Segments of the held-out runs, driven by one input.

    cuts : length -> segments, "whole" among them; angles : cut -> measured road-wheel angle of each segment,
    where the input is the request
    """

    name: InputLevel
    cuts: Mapping[str, Segments]
    angles: Mapping[str, Sequence[Array]] | None = None

    @cached_property
    def weights(self) -> dict[str, Array]:
        """Bootstrap draws of the blocks of each cut."""
        return {cut: bootstrap_weights(one.block_count, 0) for cut, one in self.cuts.items()}

    @cached_property
    def acceleration(self) -> dict[str, Array]:
        """(w,) mean size of the lateral acceleration of each segment, from speed and yaw rate [m/s²]."""
        return {
            cut: np.array([_acceleration(record) for record in one.records]) for cut, one in self.cuts.items()
        }


def _acceleration(record: MotionRecord) -> float:
    turn = record.measured.get("yaw_rate")
    if turn is not None and turn.times.size:
        return float(np.mean(np.abs(np.interp(turn.times, record.times, record.speed) * turn.values)))
    felt = record.measured.get("lateral_acceleration")
    return float(np.mean(np.abs(felt.values))) if felt is not None and felt.times.size else 0.0


def levels(data: HeldOut) -> list[Level]:
    """The measured steering, and the request through the actuator where one was followed."""
    measured = _cuts(data.records, data.rear_arm)
    if JUDGED not in measured:
        longest = max(float(r.times[-1] - r.times[0]) for r in data.records)
        raise NotIdentifiable(
            f"the longest stretch that is held out has {longest:.2g} s, need more than {JUDGED}: hold out a "
            "longer run with split.held_out"
        )
    made = [Level("measured", measured)]
    driver = driver_of(data)
    followed = [] if driver is None else [part for r in data.records for part in driver.followed(r)]
    if driver is not None and followed:
        driven = {c: by_request(driver, one) for c, one in _cuts(followed, data.rear_arm).items()}
        own = {cut: segments for cut, (segments, _) in driven.items()}
        made.append(Level("request", own, {cut: angles for cut, (_, angles) in driven.items()}))
    return made


def _cuts(records: Sequence[MotionRecord], rear_arm: float) -> dict[str, Segments]:
    """Whole records, and windows of every length; lengths that no record holds are left out."""
    cuts = {"whole": whole(records, rear_arm)}
    for cut, seconds in LENGTHS.items():
        cuts[cut] = from_many_starts(records, seconds, EVERY, rear_arm)
    return {cut: one for cut, one in cuts.items() if one.records}


class Evaluated:
    """One model at one level: its predictions and what is told of them."""

    def __init__(self, candidate: Candidate, level: Level) -> None:
        """Predict every cut."""
        self.candidate, self.level = candidate, level
        self.predictions = {cut: self._predicted(cut) for cut in level.cuts}

    def _predicted(self, cut: str) -> Prediction:
        segments = self.level.cuts[cut]
        found = predict(self.candidate, segments)
        if self.level.angles is None:
            return found
        measured = np.concatenate(self.level.angles[cut])
        errors = measured - segments.windows.inputs[:, 0]
        lengths = np.diff(segments.windows.offsets)
        found.errors[ANGLE], found.measured[ANGLE] = errors, measured
        found.segment[ANGLE] = np.repeat(np.arange(len(lengths)), lengths).astype(np.intp)
        found.block[ANGLE] = segments.blocks_at(found.segment[ANGLE], segments.windows.times)
        return found

    def sums(self, cut: str, signal: str, chosen: NDArray[np.bool_] | None = None) -> BlockSums:
        """Squared errors of a signal, block by block."""
        return block_sums(self.predictions[cut], signal, self.level.cuts[cut].block_count, chosen)

    def rms(self, cut: str, chosen: NDArray[np.bool_] | None = None) -> dict[str, Error]:
        """Root mean square of every signal, with its interval."""
        made = {}
        for signal in self.predictions[cut].errors:
            sums = self.sums(cut, signal, chosen)
            if sums.counts.sum() > 0:
                ends = interval(sums, self.level.weights[cut]) or (None, None)
                made[signal] = Error(sums.rms, ends[0], ends[1], UNITS[signal])
        return made

    def bands(self, cut: str = SHORTEST) -> list[AccelerationBand]:
        """Errors by size of the lateral acceleration."""
        if cut not in self.level.cuts:
            return []
        size, made = self.level.acceleration[cut], []
        for low, high in pairwise(BANDS):
            chosen = (size >= low) & (size < high)
            seconds = float(np.count_nonzero(chosen)) * EVERY
            if seconds >= LEAST_SECONDS:
                end = None if np.isinf(high) else high
                made.append(AccelerationBand(low, end, seconds, self.rms(cut, chosen)))
        return made

    def told(
        self, names: Sequence[str], acceptable: Mapping[str, float], noise: Mapping[str, float]
    ) -> EvaluatedModel:
        """Everything that the result holds of it."""
        free = self.predictions["whole"]
        rms, bands = self.rms("whole"), self.bands()
        spread = {name: float(np.std(values)) for name, values in free.measured.items()}
        return EvaluatedModel(
            name=cast(ModelName, self.candidate.name),
            input=self.level.name,
            rms=rms,
            nrmse={name: rms[name].value / spread[name] for name in rms if spread[name] > 0},
            vaf={
                name: 1 - float(np.var(free.errors[name])) / spread[name] ** 2
                for name in rms
                if spread[name] > 0
            },
            peak={name: float(np.abs(errors).max()) for name, errors in free.errors.items() if errors.size},
            windows={cut: self.rms(cut) for cut in LENGTHS if cut in self.predictions},
            by_lateral_acceleration=bands,
            valid_to=valid_to(bands, acceptable),
            cost_ns_per_step=nanoseconds_per_step(self.candidate, self.level.cuts["whole"]),
            by_run=self._by_run(names),
            over_noise={
                name: rms[name].value / size for name, size in noise.items() if name in rms and size > 0
            },
        )

    def _by_run(self, names: Sequence[str]) -> list[RunError]:
        segments, free = self.level.cuts["whole"], self.predictions["whole"]
        run = np.array([record.run for record in segments.records])
        made = []
        for number, name in enumerate(names):
            own = run == number
            if not own.any():
                continue
            seconds = sum(float(r.times[-1] - r.times[0]) for r in segments.records if r.run == number)
            kept = {signal: errors[own[free.segment[signal]]] for signal, errors in free.errors.items()}
            rms = {signal: float(np.sqrt(np.mean(part**2))) for signal, part in kept.items() if part.size}
            made.append(RunError(name, seconds, rms))
        return made


def valid_to(bands: Sequence[AccelerationBand], acceptable: Mapping[str, float]) -> float | None:
    """|a_y| up to which every band is driven and acceptable, None where the first is not [m/s²]."""
    end: float | None = None
    for band in bands:
        if band.lowest > (end or 0.0):
            return end
        if any(name in band.rms and band.rms[name].value > limit for name, limit in acceptable.items()):
            return end
        end = band.highest if band.highest is not None else band.lowest
    return end
