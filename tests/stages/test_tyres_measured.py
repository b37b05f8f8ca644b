"""`ident tyres` on measured logs that are not part of the project; what is expected follows from their facts.

The logs: a car with measured front-wheel forces (ramp steer to the tyre limit, step steer, straight line) and
a race car on a road course. They are read from ``IDENT_MEASURED``, by default beside the repository.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest

from ident.dynamics.engine import compiled
from ident.dynamics.kinematic import kinematic
from ident.estimation.evaluation import Candidate, predict, whole
from ident.estimation.tyre_fit import BANK, KindFit, fit_tyres
from ident.estimation.tyre_start import tyre_starts
from ident.estimation.vehicle_records import MotionRecord, cut
from ident.results import TyresResult
from ident.stages.inputs import InputSettings, load
from ident.stages.output import Context
from ident.stages.tyre_data import tyre_data
from ident.stages.tyre_settings import TyresSettings
from ident.stages.tyres import tyres

MEASURED = Path(os.environ.get("IDENT_MEASURED", Path(__file__).parents[2] / "../shared/measured"))
CAR, RACE_CAR = MEASURED / "p1_psu", MEASURED / "iac_deepdynamics"
CONTEXT = Context(command="test", date="2026-01-01T00:00:00Z")
SHORT = 5.0  # [s]

pytestmark = pytest.mark.skipif(
    not CAR.is_dir() or not RACE_CAR.is_dir(), reason=f"no measured logs at {MEASURED}: set IDENT_MEASURED"
)


@pytest.fixture(scope="module")
def car() -> TyresResult:
    return tyres([CAR], InputSettings(), TyresSettings(kinds=["brush"]), CONTEXT).result


@pytest.fixture(scope="module")
def race_car(tmp_path_factory: pytest.TempPathFactory) -> TyresResult:
    """With the yaw rate from the heading, because the logged one is late."""
    text = (RACE_CAR / "channels.yaml").read_text(encoding="utf-8")
    lines = [
        "  yaw_rate: {derivative_of: heading}" if line.startswith("  yaw_rate:") else line
        for line in text.splitlines()
    ]
    channels = tmp_path_factory.mktemp("race_car") / "channels.yaml"
    channels.write_text("\n".join(lines), encoding="utf-8")
    settings = TyresSettings(kinds=["linear"])
    return tyres([RACE_CAR], InputSettings(channels=channels), settings, CONTEXT).result


# --- the car with measured wheel forces -----------------------------------------------------------


def test_no_run_is_left_out_for_a_stiffness_that_it_does_not_tell(car: TyresResult) -> None:
    assert {one.run for one in car.by_run} == {"ramp_steer_l", "step_steer", "straight_line_1"}


def test_on_a_straight_road_no_bank_hides_in_the_bias_of_the_accelerometer(car: TyresResult) -> None:
    own = [one for one in car.nuisance if one.run == "straight_line_1"]
    assert "road_bank" not in {one.name for one in own}
    (bias,) = [one.parameters["bias"].value for one in own if one.of == "lateral_acceleration"]
    assert abs(bias) < 0.15  # the wheels need less than 100 N an axle there: 0.1 m/s² of 1724 kg


def test_stiffness_from_motion_stands_beside_that_from_wheel_forces(car: TyresResult) -> None:
    (front,) = car.measured_forces
    assert front.axle == "front"
    assert front.from_motion.value == car.fits[0].front["cornering_stiffness"].value
    assert front.from_forces.status == front.from_motion.status == "identified"
    assert front.from_forces.low > front.from_motion.high
    assert front.correlation > 0.97


def test_the_mismatch_is_explained_from_the_data(car: TyresResult) -> None:
    (front,) = car.measured_forces
    assert 1.1 < front.scale.low < front.scale.high < 1.2
    for said in (
        "it grows with the load",
        "its mass is not what is wrong",
        "step_steer left out",
        "at rest in straight_line_1 the left wheel reads +",
        "opposite",
    ):
        assert said in front.reason
    by_load = re.search(r"\+(\d+) ± (\d+) % below 4 m/s² and \+(\d+) ± (\d+) % above it", front.reason)
    assert by_load is not None
    gentle, gentle_error, hard, hard_error = map(int, by_load.groups())
    assert hard - gentle > 3 * np.hypot(gentle_error, hard_error) > 0


def rms(found: KindFit | None, records: list[MotionRecord], offset: float, rear_arm: float) -> float:
    """Of the yaw rate, simulated from the logged state; without a fit that of the kinematic bicycle."""
    if found is None:
        arms = {"cg_to_front_axle": 1.35, "cg_to_rear_axle": rear_arm, "steering_offset": offset}
        candidate = Candidate("kinematic", compiled(kinematic()), arms)
    else:
        known = dict.fromkeys(BANK, 0.0) | found.parameters
        candidate = Candidate("bicycle", found.problem.engine, known)
    error = predict(candidate, whole(records, rear_arm)).errors["yaw_rate"]
    return float(np.sqrt(np.mean(error**2)))


def test_yaw_rate_is_predicted_in_windows_that_took_no_part_in_the_fit(record_property) -> None:
    data = tyre_data(load([CAR], InputSettings(), CONTEXT), InputSettings().align, ["ramp*"], 3.0)
    windows = [part for record in data.records for part in cut(record, SHORT)]
    fitted, held_out = windows[::2], windows[1::2]
    starts = tyre_starts("brush", fitted, data.body)
    found = fit_tyres(fitted, "brush", data.body, starts, floor=data.floor, window=SHORT, bank=False)
    offset = found.parameters["steering_offset"]
    inside, outside = (rms(found, part, offset, 1.15) for part in (fitted, held_out))
    simple = rms(None, held_out, offset, 1.15)
    told = {"held_out": outside, "fitted": inside, "kinematic": simple}
    record_property("yaw_rate_rms", {name: round(value, 4) for name, value in told.items()})
    assert outside < 1.5 * inside
    assert outside < simple / 4


# --- the race car ---------------------------------------------------------------------------------


def test_the_reference_point_that_nobody_states_is_fitted_and_told(race_car: TyresResult) -> None:
    (place,) = [one.parameters["x"] for one in race_car.nuisance if "x" in one.parameters]
    assert place.status == "identified"
    assert -1.7328 < place.low < place.high < 1.248 + 1.0
    assert place.high - place.low < 0.5
    assert race_car.by_run[0].reference_x == place.value
    assert any("stated nowhere and was fitted" in one for one in race_car.warnings)


def test_a_lateral_velocity_that_holds_a_share_of_the_speed_is_told(race_car: TyresResult) -> None:
    (turned,) = [
        one for one in race_car.nuisance if one.name == "antenna_offset" and one.of == "lateral_velocity"
    ]
    assert turned.needed
    assert 0.5 < np.rad2deg(abs(turned.parameters["heading"].value)) < 1.2


def test_a_late_yaw_rate_is_not_compared_beside_the_heading(race_car: TyresResult) -> None:
    assert "yaw_rate" not in race_car.noise
    assert "heading" in race_car.noise


def test_a_yaw_inertia_is_not_claimed_at_a_hundredth_of_a_radian(race_car: TyresResult) -> None:
    assert max(abs(end) for ends in race_car.excited.values() for end in ends) < 0.06
    inertia = race_car.fits[0].yaw_inertia
    assert inertia.status in ("weak", "not_identifiable")
    assert inertia.low is None or inertia.high > 2 * inertia.low


def test_understeer_is_that_of_the_steering_against_the_turning(race_car: TyresResult) -> None:
    """v tan δ over the yaw rate has slope 3.58 m for a wheelbase of 2.981 m, mostly at 13 to 25 m/s."""
    gradient = race_car.understeer_gradient
    assert gradient.status == "identified"
    expected = [(3.58 - 2.981) / speed**2 for speed in (25.0, 13.0)]
    assert expected[0] < gradient.low < gradient.high < expected[1]
