"""Where the ratio map comes from: both angles, the motion at low speed, or the vehicle file."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.ratio_map import fit_ratio_map, kinematic_road_angle
from ident.results import Refusal
from ident.signals.alignment import align
from ident.signals.run import Run
from ident.stages.inputs import AlignSettings

Array = NDArray[np.float64]
Columns = tuple[Array, Array, Array]

BOTH = "both angles"
KINEMATIC = "kinematic gain at low speed"
VEHICLE = "vehicle file"


def ratio_map(
    runs: Sequence[Run], settings: AlignSettings
) -> tuple[list[list[float]], str | None, list[Refusal]]:
    """[[steering wheel, road wheel], ...] [rad], where it comes from, and why better sources gave none."""
    refused = []
    sources: tuple[tuple[str, Callable[[Run, AlignSettings], Columns | None]], ...] = (
        (BOTH, _both_angles),
        (KINEMATIC, _kinematic),
    )
    for name, read in sources:
        found = [columns for run in runs if (columns := read(run, settings)) is not None]
        if not found:
            continue
        wheel, road, weight = (np.concatenate(parts) for parts in zip(*found, strict=True))
        try:
            table = fit_ratio_map(wheel, road, weight)
        except NotIdentifiable as error:
            refused.append(Refusal(f"ratio map from {name}", str(error)))
            continue
        return [list(pair) for pair in table], name, refused
    return _from_vehicle(runs), VEHICLE if _from_vehicle(runs) else None, refused


def _aligned(run: Run, settings: AlignSettings, names: Sequence[str]) -> dict[str, Array] | None:
    if any(name not in run.signals or run.signals[name].raw for name in names):
        return None
    aligned = align(run, rate=settings.rate, max_gap=settings.max_gap, names=names)
    valid = np.all([aligned.valid[name] for name in names], axis=0)
    return {name: aligned.columns[name][valid] for name in names}


def _both_angles(run: Run, settings: AlignSettings) -> Columns | None:
    """Measured angles of both; of two road wheels the mean."""
    pairs = (("road_wheel_angle",), ("road_wheel_angle_left", "road_wheel_angle_right"))
    for road in pairs:
        columns = _aligned(run, settings, ("steering_wheel_angle", *road))
        if columns is not None:
            wheel = columns.pop("steering_wheel_angle")
            return wheel, np.mean(list(columns.values()), axis=0), np.ones_like(wheel)
    return None


def _kinematic(run: Run, settings: AlignSettings) -> Columns | None:
    wheelbase = run.vehicle.wheelbase if run.vehicle else None
    columns = _aligned(run, settings, ("steering_wheel_angle", "speed", "yaw_rate"))
    if wheelbase is None or columns is None:
        return None
    road, weight = kinematic_road_angle(columns["speed"], columns["yaw_rate"], wheelbase)
    usable = np.isfinite(road)
    return columns["steering_wheel_angle"][usable], road[usable], weight[usable]


def _from_vehicle(runs: Sequence[Run]) -> list[list[float]]:
    for run in runs:
        ratio = run.vehicle.steering_ratio if run.vehicle else None
        if isinstance(ratio, tuple):
            return [list(pair) for pair in ratio]
        if ratio is not None:
            return [[-float(ratio), -1.0], [float(ratio), 1.0]]
    return []
