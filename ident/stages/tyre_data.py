"""What the tyre stage takes from the logs: windows of motion, the body of the vehicle, noise floors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.errors import NotIdentifiable
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_problem import ACROSS, ALONG, POSITION
from ident.estimation.vehicle_records import MotionRecord, Samples
from ident.experiments.motion import MotionRun, MotionSettings, motion_runs
from ident.results import FixedValue, Refusal
from ident.signals.run import LoadedLogs, Run
from ident.stages.inputs import AlignSettings, SplitSettings, named
from ident.stages.split_motion import OTHER_SIDE, Side, split_motion, takes_part
from ident.stages.steering_ratio import BOTH, KINEMATIC, VEHICLE, ratio_map
from ident.vehicle import Vehicle

GIVEN = {"mass": "kg", "cg_to_front_axle": "m", "cg_to_rear_axle": "m"}
TURNING = ("yaw_rate", "heading", "lateral_acceleration")
LEAST_ACCELERATION = 0.5  # [m/s²]
NOT_NAMED = "not among tyres.runs"
STRETCH = 1e6  # [s]: windows are cut by the fit


@dataclass(frozen=True)
class TyreData:
    """Runs that can be used, and what belongs to them.

    runs : those with windows; records : their windows, with the index of the run
    ratio_source : where the steering ratio comes from, None where the road-wheel angle was measured
    ratio_std : relative standard deviation of the ratio, where stated
    floor : compared signal -> least standard deviation of its noise, from its resolution
    """

    runs: list[MotionRun]
    records: list[MotionRecord]
    vehicle: Vehicle
    body: Body
    ratio_source: str | None
    ratio_std: float
    floor: Mapping[str, float]
    left_out: list[Refusal]
    warnings: list[str]


def tyre_data(
    loaded: LoadedLogs,
    align: AlignSettings,
    globs: Sequence[str] | None,
    least_speed: float,
    *,
    split: SplitSettings | None = None,
    side: Side = "training",
    refuse_late: bool = True,
) -> TyreData:
    """Gather what the fit needs, or on the other ``side`` of the split what it is judged by.

    refuse_late : see :class:`~ident.experiments.motion.MotionSettings`

    Raises
    ------
    NotIdentifiable
        If the vehicle file lacks what cannot be identified, or no run tells how the vehicle turns.
    """
    known = [run for run in loaded.runs if globs is None or named(run.name, globs)]
    left_out = [Refusal(run.name, NOT_NAMED) for run in loaded.runs if run not in known]
    if not known:
        raise NotIdentifiable(f"no run is named by tyres.runs {', '.join(globs or [])}")
    split = split or SplitSettings()
    chosen = [run for run in known if takes_part(run.name, split, side)]
    left_out += [Refusal(run.name, OTHER_SIDE[side]) for run in known if run not in chosen]
    if not chosen:
        raise NotIdentifiable(f"the split leaves no run: each is {OTHER_SIDE[side]}: hold out other ones")
    vehicle = _vehicle(chosen)
    alike = [run for run in chosen if run.vehicle == vehicle]
    left_out += [
        Refusal(run.name, "its vehicle file says another vehicle: fit its runs by themselves")
        for run in chosen
        if run not in alike
    ]
    table, source = _ratio(alike, align, vehicle)
    how = MotionSettings(
        rate=align.rate,
        max_gap=align.max_gap,
        window=STRETCH,
        least_speed=least_speed,
        refuse_late=refuse_late,
    )
    found, refused = motion_runs(alike, ratio=table, settings=how)
    found = [split_motion(run, split, side, how.shortest) for run in found]
    usable = [run for run in found if _why_not(run) is None]
    left_out += [*refused, *(Refusal(run.name, why) for run in found if (why := _why_not(run)) is not None)]
    if not usable:
        raise NotIdentifiable(f"no run can be used for the tyres: {_reasons(left_out)}")
    _refuse_straight(usable)
    steering = {run.steering_source for run in usable}
    return TyreData(
        runs=usable,
        records=_records(usable),
        vehicle=vehicle,
        body=_body(vehicle),
        ratio_source=source if any("steering_wheel_angle" in one for one in steering) else None,
        ratio_std=_ratio_std(vehicle) if source == VEHICLE else 0.0,
        floor=_floor(loaded.runs),
        left_out=left_out,
        warnings=_told(usable),
    )


def without_run(data: TyreData, number: int, reason: str) -> TyreData:
    """Return the data without one run."""
    kept = [record for record in data.records if record.run != number]
    records = [replace(record, run=record.run - (record.run > number)) for record in kept]
    runs = [run for index, run in enumerate(data.runs) if index != number]
    left_out = [*data.left_out, Refusal(data.runs[number].name, reason)]
    return replace(data, runs=runs, records=records, left_out=left_out)


def fixed_values(data: TyreData) -> dict[str, FixedValue]:
    """What the fit takes as given."""
    std = data.vehicle.std
    made = {
        name: FixedValue(float(getattr(data.vehicle, name)), std.get(name), unit, "vehicle file")
        for name, unit in GIVEN.items()
    }
    ratio = data.vehicle.steering_ratio
    if data.ratio_source == VEHICLE and isinstance(ratio, float | int):
        made["steering_ratio"] = FixedValue(float(ratio), std.get("steering_ratio"), "1", VEHICLE)
    return made


def _vehicle(runs: Sequence[Run]) -> Vehicle:
    """Return the vehicle that most runs are of, among those whose file says enough."""
    known = [run.vehicle for run in runs if run.vehicle is not None]
    complete = [one for one in known if all(getattr(one, name) is not None for name in GIVEN)]
    if complete:
        return max(complete, key=complete.count)
    missing = [name for name in GIVEN if not known or getattr(known[0], name) is None]
    raise NotIdentifiable(
        f"the vehicle file lacks {', '.join(missing)}: planar motion tells mass and stiffness only in ratio: "
        "give them in vehicle.yaml (`ident init` writes a first one)"
    )


def _ratio(
    runs: Sequence[Run], align: AlignSettings, vehicle: Vehicle
) -> tuple[list[list[float]] | None, str | None]:
    """Return the table of the ratio, None for that of the vehicle file, and where it comes from.

    The vehicle file comes before the kinematic gain: that holds the slip of the tyres at low speed.
    """
    table, source, _ = ratio_map(runs, align)
    if source == BOTH or (source == KINEMATIC and vehicle.steering_ratio is None):
        return table, source
    return None, VEHICLE if vehicle.steering_ratio is not None else None


def _ratio_std(vehicle: Vehicle) -> float:
    ratio = vehicle.steering_ratio
    return vehicle.std.get("steering_ratio", 0.0) / ratio if isinstance(ratio, float | int) else 0.0


def _why_not(run: MotionRun) -> str | None:
    if not run.windows:
        return "nothing of it lies on this side of the split"
    there = {name for window in run.windows for name in window.measurements}
    if there & set(TURNING):
        return None
    names = f"{', '.join(TURNING[:-1])} or {TURNING[-1]}"
    return f"no {names}: nothing tells how the vehicle turns: name the topic of one in channels.yaml"


def _reasons(left_out: Sequence[Refusal]) -> str:
    reasons = list(dict.fromkeys(one.reason for one in left_out))
    return "; ".join(reasons[:3]) + (f" and {len(reasons) - 3} more" if len(reasons) > 3 else "")


def _refuse_straight(runs: Sequence[MotionRun]) -> None:
    most = max(hardest_turn(run) for run in runs)
    if most < LEAST_ACCELERATION:
        raise NotIdentifiable(
            f"the lateral acceleration stays below {most:.2f} m/s², need {LEAST_ACCELERATION} m/s²: drive "
            "curves and lane changes at 10 to 15 m/s"
        )


def hardest_turn(run: MotionRun) -> float:
    """Rough lateral acceleration that a run exceeds in a hundredth of its time [m/s²]."""
    return float(np.quantile(np.abs(_acceleration(run)), 0.99))


def _acceleration(run: MotionRun) -> np.ndarray:
    """Rough lateral acceleration at the yaw-rate samples, else from the kinematic turn [m/s²]."""
    made = []
    for window in run.windows:
        turn = window.measurements.get("yaw_rate")
        if turn is None:
            made.append(window.speed**2 * np.tan(window.road_wheel_angle) / 5.0)
        else:
            made.append(np.interp(turn.times, window.times, window.speed) * turn.values)
    return np.concatenate(made)


def _records(runs: Sequence[MotionRun]) -> list[MotionRecord]:
    return [
        MotionRecord(
            run=number,
            times=window.times,
            road_wheel_angle=window.road_wheel_angle,
            speed=window.speed,
            measured={name: Samples(one.times, one.values) for name, one in window.measurements.items()},
            reference_x=run.reference_x,
            reference_known=run.reference_known,
            imu=run.imu,
        )
        for number, run in enumerate(runs)
        for window in run.windows
    ]


def _body(vehicle: Vehicle) -> Body:
    std = {name: value for name, value in vehicle.std.items() if name in {*GIVEN, "yaw_inertia"}}
    mass, front, rear = (float(getattr(vehicle, name)) for name in GIVEN)
    return Body(mass, front, rear, vehicle.yaw_inertia, std)


def _floor(runs: Sequence[Run]) -> dict[str, float]:
    made: dict[str, float] = {}
    for run in runs:
        for name, health in run.health.signals.items():
            if health.resolution is not None:
                made[name] = min(made.get(name, np.inf), health.resolution / np.sqrt(12))
    position = [made[name] for name in POSITION if name in made]
    return made | dict.fromkeys((ALONG, ACROSS), min(position)) if position else made


def _told(runs: Sequence[MotionRun]) -> list[str]:
    return [f"{run.name}: {one}" for run in runs for one in (*run.rejected, *run.notes)] + [
        f"{run.name}: {finding.text}"
        for run in runs
        for finding in run.findings
        if finding.verdict == "warning"
    ]
