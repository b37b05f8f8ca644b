"""What is taken from logs that hold a path and a steering request: stretches in which a controller drove."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from glob import escape

from ident.dynamics.cascade import Steering
from ident.errors import NotIdentifiable
from ident.estimation.vehicle_records import MotionRecord
from ident.experiments.steering_data import steering_run
from ident.glossary import STEERING_PAIRS
from ident.results import Refusal
from ident.signals.run import LoadedLogs, Run
from ident.stages.evaluate_data import LEAST_SPEED, Driver
from ident.stages.inputs import AlignSettings, named
from ident.stages.tyre_data import NOT_NAMED, tyre_data
from ident.stages.validate_truck import Believed

PATH = ("reference_x", "reference_y")
SHORTEST = 5.0  # [s] of a stretch that is compared


@dataclass(frozen=True)
class FollowedRun:
    """One run: where its own controller drove.

    records : stretches in which it was engaged, on one grid each
    """

    run: Run
    records: list[MotionRecord]
    driver: Driver
    rear_arm: float


def followed_runs(
    loaded: LoadedLogs, align: AlignSettings, globs: Sequence[str] | None, truck: Believed
) -> tuple[list[FollowedRun], list[Refusal]]:
    """Gather the runs that hold reference and request, and say why others do not take part."""
    request = STEERING_PAIRS[truck.pair][0]
    chosen, refused = [], []
    for run in loaded.runs:
        missing = [name for name in (*PATH, request) if name not in run.signals]
        if globs is not None and not named(run.name, globs):
            continue
        if not missing:
            chosen.append(run)
        elif globs is not None or len(missing) < len((*PATH, request)) - 1:
            refused.append(Refusal(run.name, f"not compared: no {' and no '.join(missing)}"))
    found = []
    for run in chosen:
        try:
            found.append(_followed(run, loaded, align, truck))
        except NotIdentifiable as error:
            refused.append(Refusal(run.name, f"not compared: {error}"))
    return found, refused


def _followed(run: Run, loaded: LoadedLogs, align: AlignSettings, truck: Believed) -> FollowedRun:
    data = tyre_data(loaded, align, [escape(run.name)], LEAST_SPEED)
    if not data.records:
        raise NotIdentifiable("; ".join(o.reason for o in data.left_out if o.reason != NOT_NAMED))
    steering = truck.truck.steering
    lags = steering.time_constant_1, steering.time_constant_2
    actuator = Steering(steering.gain, steering.dead_time, sum(lags), lags[0] * lags[1], steering.ratio)
    known = steering_run(run, truck.pair)
    if isinstance(known, str):
        raise NotIdentifiable(known)
    driver = Driver(actuator, [known], truck.offset)
    parts = [part for record in data.records for part in driver.followed(record)]
    long = [part for part in parts if part.times[-1] - part.times[0] >= SHORTEST]
    if not long:
        raise NotIdentifiable(f"its controller never drove for {SHORTEST:g} s together")
    arm = truck.truck.parameters["cg_to_rear_axle"]
    return FollowedRun(run, long, driver, arm)
