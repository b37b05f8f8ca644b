"""`ident improve` on measured logs that are no part of the project; what is expected is what their facts say.

The logs: a servo that is commanded in six ways, a car in three manoeuvres up to the limit of its tyres, a car
on a road with its own sensors only, a truck without a measured steering. They are read from
``IDENT_MEASURED``, by default beside the repository.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ident.results import ImproveResult, SensorCheck
from ident.stages.improve import improve
from ident.stages.improve_settings import ImproveSettings
from ident.stages.inputs import InputSettings
from ident.stages.output import Context, StageOutput

MEASURED = Path(os.environ.get("IDENT_MEASURED", Path(__file__).parents[2] / "../shared/measured"))
SERVO, CAR, ROAD_CAR, TRUCK = (
    MEASURED / name for name in ("servo_miuzei", "p1_psu", "comma2k19_rav4", "rhino_volvo_fh16")
)
CONTEXT = Context(command="test", date="2026-01-01T00:00:00Z")
FOLLOWED = ["chirp", "ramps", "steps", "triangles"]  # the servo comes near what is asked of it

pytestmark = pytest.mark.skipif(
    not all(one.is_dir() for one in (SERVO, CAR, ROAD_CAR, TRUCK)),
    reason=f"no measured logs at {MEASURED}: set IDENT_MEASURED",
)


def improved(logs: Path, runs: list[str] | None = None) -> StageOutput[ImproveResult]:
    return improve([logs], InputSettings(runs=runs), ImproveSettings(), CONTEXT)


def explained(table: pd.DataFrame, run: str, column: str) -> float:
    """Share of the variance of the measured signal in a run that took no part in the fit."""
    own = table[table["run"] == run]
    left = own["measured"] - own[column]
    return 1 - float(np.mean(left**2)) / float(np.var(own["measured"]))


def named(checks: list[SensorCheck], name: str) -> SensorCheck:
    return next(one for one in checks if one.name == name)


# --- the servo: a linear model fits its steps and not its triangles ---------------------------------


@pytest.fixture(scope="module")
def servo() -> StageOutput[ImproveResult]:
    return improved(SERVO, FOLLOWED)


def test_the_servo_turns_no_faster_than_a_rate(servo: StageOutput[ImproveResult]) -> None:
    first = servo.result.effects[0]
    assert first.name == "steering_rate_limit"
    rate = first.parameters["rate"]
    assert rate.value is not None
    assert rate.value == pytest.approx(4.78, rel=0.05)  # of an earlier fit to the large steps alone


def test_the_limit_is_the_same_in_all_runs_of_the_servo(servo: StageOutput[ImproveResult]) -> None:
    p_value = servo.result.effects[0].same_in_runs_p
    assert p_value is not None
    assert p_value > 0.01


def test_with_the_limit_the_triangles_are_predicted_by_a_fit_without_them(
    servo: StageOutput[ImproveResult],
) -> None:
    table = servo.tables["improve_held_out"]
    assert explained(table, "triangles", "before") < 0.7
    assert explained(table, "triangles", "after") > 0.85
    assert explained(table, "chirp", "after") > explained(table, "chirp", "before") + 0.05
    for run in ("steps", "ramps"):  # the linear model explains them already
        assert explained(table, run, "after") > explained(table, run, "before") - 0.005


def test_a_quarter_of_the_held_out_error_of_the_servo_goes(servo: StageOutput[ImproveResult]) -> None:
    error, confirmed = servo.result.error, servo.result.confirmation
    assert error.split_by == "run"
    after, before = (one["steering_wheel_angle"].value for one in (error.after, error.before))
    assert after < 0.78 * before
    assert confirmed is not None
    assert confirmed.confirmed


def test_what_the_rollouts_of_the_servo_differ_in_is_not_explained_away(
    servo: StageOutput[ImproveResult],
) -> None:
    assert servo.result.verdict == "unexplained"
    assert servo.result.steps[-1].gate.rejected


# --- the car at the limit of its tyres ----------------------------------------------------------------


@pytest.fixture(scope="module")
def car() -> ImproveResult:
    return improved(CAR).result


def test_the_car_at_its_limit_has_no_name_for_what_is_left(car: ImproveResult) -> None:
    assert car.verdict == "unexplained"
    assert car.layers == ["motion"]
    assert len(car.effects) <= 3


def test_the_ramp_that_no_other_run_comes_near_is_in_every_fit(car: ImproveResult) -> None:
    assert any(one.startswith("ramp_steer_l is in every fit: its lateral") for one in car.warnings)
    assert car.error.split_by == "run"


def test_no_model_of_the_car_spins_on_data_that_took_no_part(car: ImproveResult) -> None:
    assert car.error.after["yaw_rate"].value < 0.1  # [rad/s], of up to 0.8
    assert car.error.after["lateral_velocity"].value < 0.5  # [m/s], of up to 0.6
    for name, before in car.error.before.items():
        assert car.error.after[name].value < 1.3 * before.value, name


def test_the_position_of_the_car_is_late(car: ImproveResult) -> None:
    check = named(car.sensors, "position against speed, heading and lateral velocity: lag")
    assert check.verdict == "differs"
    assert check.effect == "sensor_latency"
    assert check.estimate.value == pytest.approx(0.06, abs=0.02)  # 60 to 80 ms by course and slip


# --- sensors alone --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def road_car() -> ImproveResult:
    return improved(ROAD_CAR).result


def test_a_car_without_a_steering_request_and_mass_is_refused_all_but_its_sensors(
    road_car: ImproveResult,
) -> None:
    assert road_car.layers == []
    assert road_car.effects == []
    reasons = {one.what.partition(" ")[0]: one.reason for one in road_car.refused}
    assert "need steering_wheel_request" in reasons["actuator"]
    assert "the vehicle file lacks mass" in reasons["motion"]
    untested = {one.what for one in road_car.not_testable}
    assert {"steering_rate_limit", "tyre_relaxation", "body_roll", "steering_friction"} <= untested


@pytest.mark.parametrize(
    ("name", "value", "within"),
    [
        ("speed against the speed of the position: scale", 1.013, 0.002),  # 1.3 % above the pose's speed
        ("course of the position less heading and side slip", -0.0157, 0.002),
        ("lateral acceleration against v r + dv_y/dt: bias", 0.134, 0.04),
    ],
)
def test_the_sensors_of_the_road_car_differ_as_its_facts_say(
    road_car: ImproveResult, name: str, value: float, within: float
) -> None:
    check = named(road_car.sensors, name)
    assert check.verdict == "differs"
    assert check.estimate.value == pytest.approx(value, abs=within)


def test_gentle_curves_do_not_tell_the_scale_of_a_gyro(road_car: ImproveResult) -> None:
    check = named(road_car.sensors, "yaw rate against the derivative of the heading: scale")
    assert check.verdict == "not_testable"
    assert "drive curves" in check.meaning


def test_a_truck_without_a_measured_steering_is_told_by_its_sensors_alone() -> None:
    result = improved(TRUCK, ["snake", "lane_change", "clock_wise_circle"]).result
    assert result.layers == []
    assert result.told.startswith("no model could be looked at, only the sensors")
    reasons = [one.reason for one in result.refused]
    assert any("no measured steering" in one for one in reasons)


def test_a_servo_alone_holds_no_motion(servo: StageOutput[ImproveResult]) -> None:
    assert servo.result.layers == ["actuator"]
    assert any(one.what.startswith("motion") for one in servo.result.refused)
    untested = {one.what for one in servo.result.not_testable}
    assert {"steering_linkage_play", "body_roll", "tyre_relaxation"} <= untested
