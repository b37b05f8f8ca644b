"""Campaigns of a truck with injected effects as `ident improve` takes them, without a log file between.

The same path as from log files: runs -> alignment and windows -> records of the motion layer, and runs ->
request and measured angle -> records of the actuator layer. Nothing of the truth is passed on but what a
vehicle file says.

    driven = drive_campaign([typical("tyre_relaxation")], seed=3)
    runs = measured(driven, 3)
    data = motion_data(runs, driven.truth)           # .records, .body, .floor: for the motion layer
    records = actuator_runs(runs, driven.truth)      # for the actuator layer
    floor = noise_floor(driven, runs)                # RMS of the generating model with its true parameters
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

from generator.effects import Drive, campaign, drive_campaign, measured, noise_floor  # noqa: E402
from generator.injected import OUTSIDE, TYPICAL, Injected, typical  # noqa: E402
from generator.motion_sets import MotionSet  # noqa: E402
from generator.truth import Truth  # noqa: E402
from truck_runs import run_of, vehicle_of  # noqa: E402

from ident.estimation.actuator_runs import RunRecords  # noqa: E402
from ident.estimation.motion_layer import KIND, MotionLayer  # noqa: E402
from ident.estimation.tyre_start import tyre_starts  # noqa: E402
from ident.estimation.vehicle_records import Samples  # noqa: E402
from ident.experiments.steering_data import steering_run  # noqa: E402
from ident.experiments.stretches import jitter_of  # noqa: E402
from ident.signals.signal import LoadedLogs  # noqa: E402
from ident.stages.inputs import AlignSettings  # noqa: E402
from ident.stages.steering import actuator_record  # noqa: E402
from ident.stages.tyre_data import TyreData, tyre_data  # noqa: E402

__all__ = [
    "OUTSIDE",
    "TYPICAL",
    "Drive",
    "Injected",
    "Truth",
    "actuator_runs",
    "campaign",
    "drive_campaign",
    "key_of",
    "loaded_runs",
    "measured",
    "motion_data",
    "motion_layer",
    "noise_floor",
    "speeds",
    "true_parameters",
    "typical",
]

TRAVEL = 0.5  # [rad] at which `ident` counts the change of the steering ratio
DEVICES = {"imu": "inertial_unit"}
LEAST_SPEED = 2.0  # [m/s] so that the slow circles take part


def key_of(one: Injected) -> str:
    """Return the key under which `ident` lists an effect: its name, and the signal that it acts on."""
    of = DEVICES.get(one.signal, one.signal)
    return f"{one.name} {of}" if of else one.name


def true_parameters(injected: Sequence[Injected]) -> dict[str, dict[str, float]]:
    """Return what is injected by key, as `ident` counts it: the ratio by its change at ``TRAVEL``."""
    made = {}
    for one in injected:
        values = dict(one.values)
        if one.name == "steering_ratio_nonlinearity":
            values = {
                "cubic": values["cubic"] * TRAVEL**2,
                "quadratic": values["quadratic"] * TRAVEL,
            }
        made[key_of(one)] = values
    return made


def loaded_runs(runs: Mapping[str, MotionSet], truth: Truth) -> LoadedLogs:
    """Return the runs as if read from log files, with the vehicle file of the truck."""
    vehicle = vehicle_of(truth.planar)
    return LoadedLogs([run_of(name, motion, vehicle) for name, motion in runs.items()], [], [], [])


def motion_data(runs: Mapping[str, MotionSet], truth: Truth, *, least_speed: float = LEAST_SPEED) -> TyreData:
    """Return windows of motion, the body of the vehicle and the noise floors that the sensors' steps set.

    least_speed : below which nothing is used [m/s]
    """
    return tyre_data(loaded_runs(runs, truth), AlignSettings(), None, least_speed)


def motion_layer(data: TyreData, start: Mapping[str, float] | None = None) -> MotionLayer:
    """Return the motion layer of these data, as the command begins it unless ``start`` says where else."""
    vehicle = data.vehicle
    tall = vehicle.cg_height / vehicle.track if vehicle.cg_height and vehicle.track else None
    begin = tyre_starts(KIND, data.records, data.body)[0] if start is None else start
    return MotionLayer(data.records, [run.name for run in data.runs], data.body, begin, data.floor, tall)


def actuator_runs(runs: Mapping[str, MotionSet], truth: Truth) -> list[RunRecords]:
    """Return request and measured angle of every run whose request excites the actuator."""
    made = []
    for run in loaded_runs(runs, truth).runs:
        found = steering_run(run, "steering_wheel")
        if isinstance(found, str) or not found.excited:
            continue
        records = [actuator_record(found.stretches[index]) for index in found.excited]
        made.append(RunRecords(run.name, records, jitter_of(found.measured.time)))
    return made


def speeds(runs: Mapping[str, MotionSet], truth: Truth) -> dict[str, Samples]:
    """Return the logged speed of every run [m/s]."""
    signals = {run.name: run.signals["speed"] for run in loaded_runs(runs, truth).runs}
    return {name: Samples(one.time, one.values) for name, one in signals.items()}
