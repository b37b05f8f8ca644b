"""Layers of the motion over short campaigns of the truck of the sample logs, sound or not."""

from __future__ import annotations

from functools import cache

from improve_runs import Injected, drive_campaign, measured, motion_data

from ident.estimation.motion_layer import KIND, MotionLayer
from ident.estimation.tyre_start import tyre_starts

RUNS = ("sweep_fast", "ramp_steer")
SEED = 3


@cache
def driven(*injected: tuple[str, str | None]):
    """Driven with effects of usual size, each a name and what it acts on."""
    return drive_campaign([usual(name, of) for name, of in injected], SEED, runs=RUNS)


def usual(name: str, of: str | None = None) -> Injected:
    return Injected(name, of=of)


def layer_over(drive, seed: int = SEED, **how) -> MotionLayer:
    """The layer as `ident improve` makes it of the logs of a campaign."""
    data = motion_data(measured(drive, seed, **how), drive.truth)
    start = tyre_starts(KIND, data.records, data.body)[0]
    vehicle = data.vehicle
    ratio = vehicle.cg_height / vehicle.track if vehicle.cg_height and vehicle.track else None
    runs = [run.name for run in data.runs]
    return MotionLayer(data.records, runs, data.body, start, data.floor, ratio)
