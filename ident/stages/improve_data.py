"""What the loop takes from the logs: the layers of the truck that they hold, and why others are missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from ident.errors import NotIdentifiable
from ident.estimation.actuator_layer import ActuatorLayer
from ident.estimation.actuator_runs import RunRecords
from ident.estimation.layer import Layer
from ident.estimation.motion_effects import LONGEST_DELAY
from ident.estimation.motion_layer import KIND, MotionLayer
from ident.estimation.tyre_start import tyre_starts
from ident.estimation.vehicle_records import Samples
from ident.experiments.steering_data import choose_pair, steering_run, why_not_excited
from ident.experiments.stretches import jitter_of
from ident.glossary import STEERING_PAIRS
from ident.results import Refusal, SensorCheck
from ident.signals.run import LoadedLogs, Run
from ident.stages.improve_sensors import sensor_checks
from ident.stages.inputs import InputSettings, named
from ident.stages.steering import actuator_record
from ident.stages.steering_vehicle import runs_of_one_vehicle
from ident.stages.tyre_data import TyreData, tyre_data

DELAYED = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading")
LEAST_SPEED = 2.0  # [m/s] below which slip angles say little and noise of the speed much
USUAL_RATIO = 20.0
NOT_NAMED = "not among improve.runs"


@dataclass
class LayerData:
    """The layers that the logs hold.

    sensors : compared with each other
    runs : of one vehicle, those that are looked at
    motion : of the tyre stage's kind, None where there is none
    refused : what cannot be looked at, and why
    """

    sensors: list[SensorCheck]
    layers: list[Layer] = field(default_factory=list)
    runs: list[Run] = field(default_factory=list)
    motion: TyreData | None = None
    refused: list[Refusal] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def too_late(sensors: Sequence[SensorCheck]) -> dict[str, str]:
    """Signals that are later than the loop could find, and what to do with them."""
    made = {}
    for one in sensors:
        late = one.estimate.value
        differs = one.effect == "sensor_latency" and one.verdict == "differs" and late is not None
        if differs and late is not None and late > LONGEST_DELAY and one.signals[0] in DELAYED:
            made[one.signals[0]] = (
                f"{late:.2f} s late, at most {LONGEST_DELAY:g} s is looked for: state align.latency, or map "
                "it as the derivative of another signal"
            )
    return made


def layer_data(loaded: LoadedLogs, inputs: InputSettings, runs: Sequence[str] | None) -> LayerData:
    """Compare the sensors, and gather the layers of one vehicle, each from the runs that it can use."""
    chosen = [run for run in loaded.runs if runs is None or named(run.name, runs)]
    alike, others = runs_of_one_vehicle(chosen, None)
    left_out = [Refusal(run.name, NOT_NAMED) for run in loaded.runs if run not in chosen]
    sensors = sensor_checks(alike)
    without = too_late(sensors)
    made = LayerData(sensors=sensors, runs=alike, refused=[*left_out, *others])
    try:
        made.layers.append(_actuator(alike))
    except NotIdentifiable as error:
        made.refused.append(Refusal("actuator (request to angle)", str(error)))
    try:
        data = tyre_data(replace(loaded, runs=alike), inputs.align, None, LEAST_SPEED, refuse_late=False)
        made.motion = data
        made.layers.append(_motion(data, without))
        made.refused += [Refusal(name, why) for name, why in without.items()]
        made.refused += data.left_out
        made.warnings += data.warnings
    except NotIdentifiable as error:
        made.refused.append(Refusal("motion (angle to yaw rate, acceleration, place)", str(error)))
    return made


def _actuator(runs: Sequence[Run]) -> ActuatorLayer:
    """Return the layer of request and measured angle."""
    pair = choose_pair(runs)
    records, speed, reasons = [], {}, []
    for run in runs:
        found = steering_run(run, pair)
        if isinstance(found, str):
            reasons.append(found)
        elif not found.excited:
            reasons.append(why_not_excited(found))
        else:
            parts = [actuator_record(found.stretches[i]) for i in found.excited]
            records.append(RunRecords(run.name, parts, jitter_of(found.measured.time)))
            if "speed" in run.signals:
                speed[run.name] = Samples(run.signals["speed"].time, run.signals["speed"].values)
    if not records:
        raise NotIdentifiable("; ".join(dict.fromkeys(reasons)) or "no run")
    ratios = [run.vehicle.steering_ratio for run in runs if run.vehicle is not None]
    known = [float(one) for one in ratios if isinstance(one, int | float)]
    return ActuatorLayer(
        records,
        signal=STEERING_PAIRS[pair][1],
        steering_ratio=known[0] if known else USUAL_RATIO,
        speed=speed,
    )


def _motion(data: TyreData, without: Mapping[str, str]) -> MotionLayer:
    """Return the layer of the motion."""
    vehicle = data.vehicle
    height = None
    if vehicle.cg_height is not None and vehicle.track is not None:
        height = vehicle.cg_height / vehicle.track
    records = [
        replace(one, measured={name: s for name, s in one.measured.items() if name not in without})
        for one in data.records
    ]
    start: Mapping[str, float] = tyre_starts(KIND, records, data.body)[0]
    return MotionLayer(records, [run.name for run in data.runs], data.body, start, data.floor, height)
