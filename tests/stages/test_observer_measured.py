"""Observed axle forces beside the measured wheel forces of a car; its logs are not part of the project."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from ident.estimation.force_inversion import invert_forces
from ident.estimation.force_observer import observe_forces
from ident.estimation.force_system import MEASURED
from ident.estimation.noise_band import noise_above_the_motion
from ident.estimation.vehicle_records import cut
from ident.signals.run import LoadedLogs
from ident.stages.inputs import InputSettings, load
from ident.stages.output import Context
from ident.stages.tyre_data import TyreData, tyre_data

CAR = Path(os.environ.get("IDENT_MEASURED", Path(__file__).parents[2] / "../shared/measured")) / "p1_psu"
CONTEXT = Context(command="test", date="2026-01-01T00:00:00Z")

pytestmark = pytest.mark.skipif(not CAR.is_dir(), reason=f"no measured logs at {CAR}: set IDENT_MEASURED")


@pytest.fixture(scope="module")
def logs() -> LoadedLogs:
    return load([CAR], InputSettings(), CONTEXT)


@pytest.fixture(scope="module")
def data(logs: LoadedLogs) -> TyreData:
    return tyre_data(logs, InputSettings().align, None, 3.0)


def errors(logs: LoadedLogs, data: TyreData, run: str) -> dict[str, tuple[float, float]]:
    """Rms of the force of the front axle against the wheels [N], as it is and after one scale and offset."""
    (own,) = [one for one in logs.runs if one.name == run]
    (record,) = [one for one in data.records if data.runs[one.run].name == run]
    noise = noise_above_the_motion([record], MEASURED)
    found = observe_forces([record], data.body, noise)
    points = invert_forces(cut(record, 10.0), data.body)
    times = points.times[points.valid]
    wheels = sum(
        np.interp(times, own.signals[name].time, own.signals[name].values)
        for name in ("front_left_lateral_force", "front_right_lateral_force")
    )
    observed = found.forces[np.searchsorted(found.times, times - 1e-9), 0]
    told = {"observer": observed, "inversion": points.front_force[points.valid]}
    return {name: (rms(force - wheels), rms(fitted(force, wheels))) for name, force in told.items()}


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def fitted(force: np.ndarray, wheels: np.ndarray) -> np.ndarray:
    design = np.column_stack([force, np.ones(force.size)])
    return design @ np.linalg.lstsq(design, wheels, rcond=None)[0] - wheels


def test_in_the_ramp_both_follow_the_wheels_alike(logs: LoadedLogs, data: TyreData, record_property) -> None:
    """Forces to 9 kN; what is left is mostly the scale of 1.14 that the wheels read more than the motion."""
    found = errors(logs, data, "ramp_steer_l")
    record_property("rms", found)
    assert found["observer"][0] < 1.02 * found["inversion"][0]
    assert found["observer"][1] < 1.02 * found["inversion"][1] < 270.0


def test_where_the_accelerometer_is_wrong_the_lateral_velocity_saves_the_observer(
    logs: LoadedLogs, data: TyreData, record_property
) -> None:
    """In the step steer a_y follows v r with correlation 0.89 only; the inversion takes it as it is."""
    found = errors(logs, data, "step_steer")
    record_property("rms", found)
    assert found["observer"][0] < 0.6 * found["inversion"][0]
    assert found["observer"][1] < 0.6 * found["inversion"][1]


def test_the_contradiction_of_the_sensors_shows_in_the_innovations(data: TyreData) -> None:
    (record,) = [one for one in data.records if data.runs[one.run].name == "step_steer"]
    told = observe_forces([record], data.body, noise_above_the_motion([record], MEASURED)).consistency
    assert told["lateral_velocity"].mean > 10 * told["lateral_velocity"].high
