"""What the evaluation takes from the logs: the held-out runs, free of the known biases of the sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from glob import escape
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.cascade import Request, Steering, steer
from ident.errors import NotIdentifiable
from ident.estimation.evaluation import Segments
from ident.estimation.vehicle_records import NODES, MotionRecord, Samples, part_of
from ident.experiments.motion import MotionRun
from ident.experiments.steering_data import SteeringRun, steering_run
from ident.results import SteeringResult, TyresResult
from ident.signals.run import LoadedLogs, Run
from ident.stages.evaluate_models import OFFSET, sensor_biases
from ident.stages.inputs import InputSettings, SplitSettings
from ident.stages.tyre_data import NOT_NAMED, TyreData, tyre_data

Array = NDArray[np.float64]
Motion = TypeVar("Motion", MotionRecord, MotionRun)

LEAST_SPEED = 1.0  # [m/s] below which nothing is predicted
SHORTEST = 0.5  # [s] of a request that is followed


@dataclass(frozen=True)
class HeldOut:
    """Runs that took no part in the fit.

    runs, motion : as they were read; records : whole stretches, free of sensor biases
    tyres : what the models come from; steering : of the actuator, where it was identified
    """

    runs: list[Run]
    motion: list[MotionRun]
    records: list[MotionRecord]
    rear_arm: float
    tyres: TyresResult
    steering: SteeringResult | None

    @property
    def names(self) -> list[str]:
        """Names of the runs, in the order of their indices."""
        return [run.name for run in self.motion]

    def parts(self, split: SplitSettings) -> list[str]:
        """Names of the runs, with what is held out of those that are held out in part."""
        made = []
        for number, name in enumerate(self.names):
            own = [record for record in self.records if record.run == number]
            if split.block_of(name) is None or not own:
                made.append(name)
            else:
                made += [f"{name} [{one.times[0]:.2f}, {one.times[-1]:.2f}] s" for one in own]
        return made


def held_out_motion(loaded: LoadedLogs, inputs: InputSettings, tyres: TyresResult) -> TyreData:
    """Return the motion that is held out; where nothing is said, that of the runs that the fit did not use.

    Raises
    ------
    NotIdentifiable
        If there is none, or none that can be predicted.
    """
    used = {run.run for run in tyres.by_run if run.used}
    split = inputs.split
    names = [
        run.name
        for run in loaded.runs
        if (
            split.holds_out(run.name) or split.block_of(run.name) if split.is_stated else run.name not in used
        )
    ]
    if not names:
        raise NotIdentifiable(
            f"all {len(used)} runs were used in the fit: hold one out with split.held_out in the recipe"
        )
    data = tyre_data(loaded, inputs.align, [escape(name) for name in names], LEAST_SPEED)
    blocks = {number: split.block_of(run.name) for number, run in enumerate(data.runs)}
    records = [part for r in data.records if (part := _within(r, blocks[r.run]))]
    return replace(data, records=records, left_out=[one for one in data.left_out if one.reason != NOT_NAMED])


def _within(record: MotionRecord, block: tuple[float, float] | None) -> MotionRecord | None:
    """Return the part of a record inside a block of its run, None where there is hardly any."""
    if block is None:
        return record
    first, last = (int(np.searchsorted(record.times, end)) for end in block)
    last = min(last, record.times.size - 1)
    return part_of(record, first, last) if last - first >= NODES else None


def held_out_data(
    data: TyreData, runs: Sequence[Run], tyres: TyresResult, steering: SteeringResult | None
) -> HeldOut:
    """Gather what is predicted."""
    if not data.records:
        raise NotIdentifiable("no held-out run has motion to predict: hold out another with split.held_out")
    by_name = {run.name: run for run in runs}
    biases = sensor_biases(tyres)
    return HeldOut(
        [by_name[run.name] for run in data.runs],
        [_placed(run, tyres) for run in data.runs],
        [_without_bias(_placed(record, tyres), biases) for record in data.records],
        data.body.cg_to_rear_axle,
        tyres,
        steering,
    )


def _placed(motion: Motion, tyres: TyresResult) -> Motion:
    """Put the reference point where the fit found it, where nobody states it."""
    found = [run.reference_x for run in tyres.by_run if run.used and run.reference_x is not None]
    return motion if motion.reference_known or not found else replace(motion, reference_x=found[0])


def _without_bias(record: MotionRecord, biases: Mapping[str, float]) -> MotionRecord:
    measured = {
        name: Samples(one.times, one.values - biases[name]) if name in biases else one
        for name, one in record.measured.items()
    }
    return replace(record, measured=measured)


@dataclass(frozen=True)
class Driver:
    """The request of each run, and the actuator that it drives.

    runs : steering data of each held-out run, or why there is none
    """

    actuator: Steering
    runs: list[SteeringRun | str]
    zero: float

    def followed(self, record: MotionRecord) -> list[MotionRecord]:
        """Parts of a record in which a request that was recorded before was followed."""
        run = self.runs[record.run]
        if isinstance(run, str):
            return []
        parts = []
        for stretch in run.stretches:
            begin = stretch.command_times[0] + max(self.actuator.dead_time, 0.0)
            first, last = (int(np.searchsorted(record.times, end)) for end in (begin, stretch.end))
            last = min(last, record.times.size) - 1
            if (last - first) * record.period >= SHORTEST:
                parts.append(part_of(record, first, last))
        return parts

    def driven(self, record: MotionRecord) -> MotionRecord:
        """The same part, its road-wheel angle that which the request causes from the measured one on.

        The measured angle holds the zero of its sensor; what the models add to it is taken off again here.
        """
        request = self._request(record)
        table = self.actuator.ratio
        wheel = np.interp(record.road_wheel_angle[:2] + self.zero, table[:, 1], table[:, 0])
        start = float(wheel[0]), float((wheel[1] - wheel[0]) / record.period)
        angle = steer(request, self.actuator, record.times, start).road_wheel_angle - self.zero
        return replace(record, road_wheel_angle=np.asarray(angle))

    def _request(self, record: MotionRecord) -> Request:
        run = self.runs[record.run]
        if isinstance(run, str):
            raise NotIdentifiable(f"run {record.run} has no request: {run}")
        stretch = next(one for one in run.stretches if one.end >= record.times[-1])
        return Request(stretch.command_times, stretch.command_values)


def driver_of(data: HeldOut) -> Driver | None:
    """Return who drives by request; None where the actuator is not identified."""
    actuator = _actuator(data.steering)
    if actuator is None or data.steering is None:
        return None
    pair = data.steering.pair
    return Driver(actuator, [steering_run(run, pair) for run in data.runs], _zero(data.tyres))


def by_request(driver: Driver, segments: Segments) -> tuple[Segments, list[Array]]:
    """Return segments driven by the request, and the measured road-wheel angle on the grid of each."""
    measured = [record.road_wheel_angle for record in segments.records]
    return Segments([driver.driven(record) for record in segments.records], segments.states), measured


def _actuator(steering: SteeringResult | None) -> Steering | None:
    if steering is None or (not steering.ratio and steering.pair == "steering_wheel"):
        return None
    model = steering.model
    known = [model.gain.value, model.dead_time.value, model.total_lag.value]
    if any(value is None for value in known):
        return None
    gain, dead_time, total = (float(value or 0.0) for value in known)
    frequency = model.natural_frequency.value  # of any response, also of one that has no real time constants
    product = 0.0 if frequency is None else 1 / frequency**2
    table = steering.ratio if steering.pair == "steering_wheel" else [[-1.0, -1.0], [1.0, 1.0]]
    return Steering(gain, dead_time, total - dead_time, product, np.array(table))


def _zero(tyres: TyresResult) -> float:
    found = [one.parameters["angle"].value for one in tyres.nuisance if one.name == OFFSET]
    return (found or [0.0])[0] or 0.0
