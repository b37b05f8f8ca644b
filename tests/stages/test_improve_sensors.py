"""Sensors against each other: each error is found and named, a perfect set agrees, what lacks is told."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from generator.effects import campaign, drive_campaign, measured, truth_of
from generator.injected import Injected, typical
from motion_runs import with_signals
from ruamel.yaml import YAML
from sensed_motion import Drive, sensed
from truck_runs import run_of, vehicle_of

from ident.results import SensorCheck
from ident.signals.run import Run, load_runs
from ident.stages.improve_sensors import sensor_checks

ROOT = Path(__file__).parents[2]
MEASURED = Path(os.environ.get("IDENT_MEASURED", ROOT / "../shared/measured"))
needs_measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason=f"no measured logs at {MEASURED}: set IDENT_MEASURED"
)

GYRO, ACROSS = (
    "yaw rate against the derivative of the heading: ",
    "lateral acceleration against v r + dv_y/dt: ",
)
SPEED, TRACK = (
    "speed against the speed of the position: ",
    "lateral velocity against the track of the position: ",
)
POSITION = "position against speed, heading and lateral velocity: lag"
COURSE = "course of the position less heading and side slip"
STRAIGHT = "steering angle where the truck drives straight"

VARIED = Drive(seconds=200.0, swing=5.0, turn=0.25)


def by_name(runs: Sequence[Run]) -> dict[str, SensorCheck]:
    return {check.name: check for check in sensor_checks(runs)}


def differing(runs: Sequence[Run]) -> dict[str, str | None]:
    return {check.name: check.effect for check in sensor_checks(runs) if check.verdict == "differs"}


def drive_both_ways(**sensors: dict[str, float]) -> list[Run]:
    return [
        sensed(replace(VARIED, heading=heading, still=8.0), seed, sensors, name=f"run_{seed}")
        for seed, heading in ((1, 0.4), (2, 3.4))
    ]


def test_perfect_sensors_agree_in_everything() -> None:
    checks = by_name(drive_both_ways())
    assert len(checks) == 17
    assert {check.verdict for check in checks.values()} == {"agrees"}
    for check in checks.values():
        assert check.estimate.low < check.expected < check.estimate.high or "too small" in check.meaning
        assert check.effect is None
        assert check.meaning.startswith("as it should be")


@pytest.mark.parametrize(
    ("signal", "wrong", "check", "effect", "value", "within"),
    [
        ("yaw_rate", {"scale": 1.01}, GYRO + "scale", "gyro_scale", 1.01, 0.004),
        ("yaw_rate", {"bias": 0.003}, GYRO + "bias", "sensor_bias", 0.003, 3e-4),
        ("yaw_rate", {"lag": 0.05}, GYRO + "lag", "sensor_latency", 0.05, 0.006),
        ("yaw_rate", {"lag": 0.36}, GYRO + "lag", "sensor_latency", 0.36, 0.01),
        ("speed", {"scale": 1.01}, SPEED + "scale", "wheel_speed_scale", 1.01, 6e-4),
        ("speed", {"lag": 0.08}, SPEED + "lag", "sensor_latency", 0.08, 0.012),
        ("lateral_acceleration", {"scale": 1.09}, ACROSS + "scale", None, 1.09, 0.01),
        ("lateral_acceleration", {"scale": 1.09, "lag": 0.03}, ACROSS + "scale", "body_roll", 1.09, 0.01),
        ("lateral_acceleration", {"scale": 0.93}, ACROSS + "scale", None, 0.93, 0.01),
        ("lateral_acceleration", {"bias": 0.08}, ACROSS + "bias", "sensor_bias", 0.08, 0.01),
        ("lateral_acceleration", {"lag": 0.05}, ACROSS + "lag", "sensor_latency", 0.05, 0.008),
        ("lateral_velocity", {"bias": -0.06}, TRACK + "bias", "sensor_bias", -0.06, 0.02),
        ("lateral_velocity", {"lag": 0.08}, TRACK + "lag", "sensor_latency", 0.08, 0.02),
        ("heading", {"bias": 0.015}, COURSE, "antenna_offset", -0.015, 0.002),
    ],
)
def test_one_wrong_sensor_is_found_with_its_size(
    signal: str, wrong: dict[str, float], check: str, effect: str | None, value: float, within: float
) -> None:
    runs = drive_both_ways(**{signal: wrong})
    found = by_name(runs)[check]
    assert found.verdict == "differs"
    assert found.effect == effect
    assert found.estimate.value == pytest.approx(value, abs=within)
    assert found.estimate.low < value < found.estimate.high
    assert found.p_value is not None
    assert found.p_value < 0.01
    assert found.signals[0] in {signal, "heading"}


def test_a_late_position_is_found_by_the_track_it_makes() -> None:
    late = {"lag": 0.07}
    runs = drive_both_ways(position_x=late, position_y=late)
    found = by_name(runs)[POSITION]
    assert (found.verdict, found.effect) == ("differs", "sensor_latency")
    assert found.estimate.value == pytest.approx(0.07, abs=0.01)


def test_a_late_inertial_unit_is_told_as_one() -> None:
    late = {"lag": 0.05}
    checks = by_name(drive_both_ways(yaw_rate=late, lateral_acceleration=late))
    for name in (GYRO + "lag", ACROSS + "lag"):
        assert checks[name].verdict == "differs"
        assert "the whole inertial unit is late" in checks[name].meaning


def test_a_late_lateral_velocity_does_not_blame_the_accelerometer() -> None:
    runs = drive_both_ways(lateral_velocity={"lag": 0.12})
    assert differing(runs) == {TRACK + "lag": "sensor_latency"}


@pytest.mark.parametrize(
    ("signal", "wrong", "check"),
    [
        ("speed", {"scale": 1.0015, "noise": 0.002}, SPEED + "scale"),
        ("yaw_rate", {"bias": 1.5e-4, "noise": 2e-4}, GYRO + "bias"),
    ],
)
def test_a_certain_but_negligible_difference_agrees_and_is_told(
    signal: str, wrong: dict[str, float], check: str
) -> None:
    quiet = {name: {"noise": 1e-4} for name in ("heading", "position_x", "position_y")}
    found = by_name(drive_both_ways(**{**quiet, signal: wrong}))[check]
    assert found.verdict == "agrees"
    assert found.p_value is not None
    assert found.p_value < 1e-3
    assert "certain, but too small to matter" in found.meaning
    assert found.effect is None


def test_a_bias_is_found_while_standing() -> None:
    runs = drive_both_ways(yaw_rate={"bias": 0.004}, lateral_acceleration={"bias": 0.12})
    checks = by_name(runs)
    gyro, across = checks["yaw rate at standstill"], checks["lateral acceleration at standstill"]
    assert (gyro.verdict, across.verdict) == ("differs", "differs")
    assert gyro.estimate.value == pytest.approx(0.004, abs=6e-4)
    assert "slope" in across.meaning
    assert "2 standstills" in across.meaning


def test_the_wrong_speed_alone_does_not_blame_the_accelerometer() -> None:
    signals = ("speed", "yaw_rate", "lateral_acceleration", "heading", "position_x", "position_y")
    drive = replace(VARIED, signals=(*signals, "lateral_velocity"))
    runs = [
        sensed(replace(drive, heading=heading), seed, {"speed": {"scale": 1.03}}, name=str(seed))
        for seed, heading in ((3, 0.0), (4, 3.1))
    ]
    assert differing(runs) == {SPEED + "scale": "wheel_speed_scale"}
    assert by_name(runs)[ACROSS + "scale"].estimate.value == pytest.approx(1.0, abs=0.01)


def test_without_a_position_the_speed_is_compared_with_the_localization() -> None:
    runs = [
        with_signals(run, position_x=None, position_y=None) for run in drive_both_ways(speed={"scale": 1.012})
    ]
    found = by_name(runs)["speed against the velocity of the localization: scale"]
    assert (found.verdict, found.effect) == ("differs", "wheel_speed_scale")
    assert found.estimate.value == pytest.approx(1.012, abs=1e-3)


def test_without_a_lateral_velocity_no_lag_of_the_accelerometer_is_told() -> None:
    runs = [with_signals(run, lateral_velocity=None) for run in drive_both_ways()]
    checks = by_name(runs)
    lag, scale = checks[ACROSS + "lag"], checks[ACROSS + "scale"]
    assert lag.verdict == "not_testable"
    assert "the side slip looks like a lag" in lag.meaning
    assert lag.estimate.value is None
    assert scale.estimate.value == pytest.approx(1.0, abs=0.03)


def test_straight_driving_tells_a_bias_and_no_scale() -> None:
    straight = replace(VARIED, turn=0.002)
    runs = [sensed(straight, seed, {"yaw_rate": {"bias": 0.002}}) for seed in (1, 2)]
    checks = by_name(runs)
    assert checks[GYRO + "scale"].verdict == "not_testable"
    assert "drive curves" in checks[GYRO + "scale"].meaning
    assert checks[GYRO + "bias"].verdict == "differs"
    assert checks[GYRO + "bias"].estimate.value == pytest.approx(0.002, abs=2e-4)


def test_what_a_log_lacks_is_told_as_not_testable() -> None:
    run = sensed(replace(VARIED, signals=("yaw_rate", "heading"), vehicle=None), 5)
    checks = by_name([run])
    tested = {name for name, check in checks.items() if check.verdict != "not_testable"}
    assert tested == {GYRO + "scale", GYRO + "bias", GYRO + "lag"}
    for name, check in checks.items():
        if name not in tested:
            assert check.meaning.startswith("cannot be tested: no ")
            assert check.estimate.status == "not_identifiable"
            assert check.p_value is None


def test_what_is_known_too_roughly_does_not_agree() -> None:
    runs = [sensed(replace(VARIED, seconds=60.0), 7, {"lateral_velocity": {"noise": 0.5}})]
    found = by_name(runs)[TRACK + "bias"]
    assert found.verdict == "not_testable"
    assert found.estimate.status == "weak"
    assert "need ±" in found.meaning
    assert found.effect is None


def test_the_mean_of_both_road_wheels_is_the_steering_angle() -> None:
    runs = []
    for run in drive_both_ways(steering_wheel_angle={"bias": 0.1}):
        wheel = run.signals["steering_wheel_angle"]
        left, right = (
            replace(wheel, name=f"road_wheel_angle_{side}", values=wheel.values / 20 + toe)
            for side, toe in (("left", 0.004), ("right", -0.004))
        )
        made = with_signals(run, steering_wheel_angle=None)
        runs.append(with_signals(made, road_wheel_angle_left=left, road_wheel_angle_right=right))
    found = by_name(runs)[STRAIGHT]
    assert (found.verdict, found.effect) == ("differs", "steering_offset")
    assert found.signals[0] == "road_wheel_angle"
    assert found.estimate.value == pytest.approx(0.005, abs=5e-4)


def test_no_runs_and_empty_runs_make_no_claims() -> None:
    run = sensed(replace(VARIED, seconds=30.0), 8)
    empty = replace(run, signals={})
    short = replace(run, duration=0.0, signals=run.signals)
    for runs in ([], [empty], [short], [empty, short]):
        assert {check.verdict for check in sensor_checks(runs)} == {"not_testable"}


def test_one_broken_run_does_not_take_the_others_with_it() -> None:
    runs = drive_both_ways()
    broken = replace(runs[0], signals={"heading": runs[0].signals["heading"]}, name="broken")
    assert differing([broken, *runs]) == {}
    tested = [check for check in sensor_checks([broken, *runs]) if check.verdict == "agrees"]
    assert len(tested) == 17


def test_left_and_right_and_the_order_of_runs_change_nothing() -> None:
    wrong = {"yaw_rate": {"lag": 0.04}, "lateral_acceleration": {"scale": 1.08}, "speed": {"scale": 1.015}}
    runs = drive_both_ways(**wrong)
    mirrored = [
        with_signals(
            run,
            **{
                name: replace(signal, values=-signal.values)
                for name, signal in run.signals.items()
                if name not in {"speed", "longitudinal_velocity", "position_x"}
            },
        )
        for run in runs
    ]
    turned = [replace(run, vehicle=replace(run.vehicle, imu_position=(0.5, -0.1, 0.0))) for run in mirrored]
    first, second, third = (by_name(each) for each in (runs, turned, runs[::-1]))
    for name, check in first.items():
        assert second[name].verdict == check.verdict
        assert third[name].verdict == check.verdict
        assert abs(second[name].estimate.value) == pytest.approx(
            abs(check.estimate.value), rel=1e-3, abs=1e-6
        )
        assert third[name].estimate.value == pytest.approx(check.estimate.value, rel=1e-6, abs=1e-9)


def test_a_bias_that_changes_with_each_start_is_told_as_uneven() -> None:
    runs = [
        sensed(
            replace(VARIED, seconds=80.0), seed, {"yaw_rate": {"bias": 0.003 * (-1) ** seed}}, name=str(seed)
        )
        for seed in range(6)
    ]
    assert "not the same in all runs" in by_name(runs)[GYRO + "bias"].meaning


def test_a_check_is_plain_data() -> None:
    for check in sensor_checks(drive_both_ways(yaw_rate={"lag": 0.05})):
        for value in asdict(check)["estimate"].values():
            assert value is None or type(value) in {float, str}
        assert check.p_value is None or (type(check.p_value) is float and 0 <= check.p_value <= 1)
        assert "\n" not in check.meaning


def test_the_scale_of_a_perfect_sensor_lies_in_its_interval() -> None:
    """Whole runs with coloured noise, jitter and a gap: of 40 seeds at least 93 % for each quantity."""
    names = (GYRO + "scale", GYRO + "bias", SPEED + "scale", ACROSS + "scale", ACROSS + "bias", POSITION)
    held = dict.fromkeys(names, 0)
    for seed in range(40):
        checks = by_name([sensed(Drive(seconds=90.0, turn=0.2, swing=4.0, gap=(40.0, 42.0)), 100 + seed)])
        for name in names:
            estimate, expected = checks[name].estimate, checks[name].expected
            held[name] += estimate.low <= expected <= estimate.high
    assert min(held.values()) >= 0.93 * 40, held


# --- the truck of the sample logs -----------------------------------------------------------------


def truck_runs(injected: Sequence[Injected], seed: int, **how: object) -> list[Run]:
    made = campaign(injected, seed, **how)
    vehicle = vehicle_of(truth_of(how.get("truck"), seed).planar)
    return [run_of(name, motion, vehicle) for name, motion in made.items()]


@pytest.mark.parametrize("how", [{}, {"truck": "another", "gusts": 1500.0, "dropped": 0.05}])
def test_a_campaign_without_effects_has_no_difference(how: dict[str, object]) -> None:
    checks = sensor_checks(truck_runs([], 11, **how))
    assert [check.name for check in checks if check.verdict == "differs"] == []
    assert sum(check.verdict == "agrees" for check in checks) >= 14


@pytest.mark.parametrize(
    ("injected", "expected"),
    [
        (typical("sensor_bias", 0.5), {GYRO + "bias", "yaw rate at standstill"}),
        (
            typical("sensor_bias", 0.5, of="lateral_acceleration"),
            {ACROSS + "bias", "lateral acceleration at standstill"},
        ),
        (typical("sensor_latency", 0.5), {GYRO + "lag"}),
        (typical("wheel_speed_scale", 0.5), {SPEED + "scale"}),
        (typical("body_roll", 0.5), {ACROSS + "scale", ACROSS + "lag"}),
    ],
)
def test_half_of_a_typical_effect_is_found_and_only_it(injected: Injected, expected: set[str]) -> None:
    found = differing(truck_runs([injected], 12))
    assert set(found) <= expected
    assert set(found.values()) == {injected.name}
    assert any(name in found for name in expected if "standstill" not in name)


def test_a_slope_where_the_truck_stands_is_no_bias() -> None:
    checks = by_name(truck_runs([typical("road_bank")], 700))
    stood = checks["lateral acceleration at standstill"]
    assert (stood.verdict, stood.effect) == ("differs", None)
    assert stood.meaning.startswith("the truck stood on a slope")
    assert checks[ACROSS + "bias"].verdict == "agrees"


def test_tyres_and_steering_do_not_look_like_sensors() -> None:
    injected = [typical("tyre_relaxation"), typical("load_transfer"), typical("steering_linkage_play")]
    driven = drive_campaign(injected, 13)
    runs = [
        run_of(name, motion, vehicle_of(driven.truth.planar)) for name, motion in measured(driven, 13).items()
    ]
    assert differing(runs) == {}


SEEN_BY_SENSORS = {"sensor_latency", "sensor_bias", "wheel_speed_scale", "gyro_scale", "body_roll"}
SETS = sorted((ROOT / "sample_logs" / "undeclared").glob("set_*"))


@pytest.mark.parametrize("folder", SETS, ids=lambda folder: folder.name)
def test_of_undeclared_effects_the_sensors_show_theirs_and_no_other(folder: Path) -> None:
    truth = YAML(typ="safe").load((ROOT / "tests" / "truth" / "undeclared.yaml").read_text(encoding="utf-8"))
    expected = {each["name"] for each in truth[folder.name]} & SEEN_BY_SENSORS
    checks = sensor_checks(load_runs([folder]).runs)
    assert {check.effect for check in checks if check.verdict == "differs"} == expected
    assert all(check.verdict != "not_testable" for check in checks)


# --- measured logs that are not part of the project ------------------------------------------------


@needs_measured
def test_a_car_without_a_vehicle_file_has_its_sensors_checked() -> None:
    """A tilted device, a wheel speed 1.3 % above the pose's, a heading 0.0157 rad beside the course."""
    runs = load_runs([MEASURED / "comma2k19_rav4"]).runs
    checks = by_name(runs)
    speed, course = checks[SPEED + "scale"], checks[COURSE]
    assert (speed.verdict, speed.effect) == ("differs", "wheel_speed_scale")
    assert speed.estimate.value == pytest.approx(1.013, abs=0.002)
    assert course.verdict == "differs"
    assert course.estimate.value == pytest.approx(-0.0157, abs=0.001)
    tilted = checks[ACROSS + "bias"]
    assert tilted.verdict == "differs"
    assert "a bank of the road looks the same" in tilted.meaning
    for name in (GYRO + "scale", GYRO + "lag", ACROSS + "scale", ACROSS + "lag", "yaw rate at standstill"):
        assert checks[name].verdict == "not_testable", name


@needs_measured
def test_the_bias_of_another_gyro_in_the_same_car(tmp_path: Path) -> None:
    """The car's gyro is off by about -0.007 rad/s: its sum is -0.44 rad in 60 s, the heading's -0.008."""
    text = (MEASURED / "comma2k19_rav4" / "channels.yaml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.strip().startswith("yaw_rate:")]
    lines.insert(1, "  yaw_rate: {topic: /vehicle/yaw_rate, field: twist.angular.z, unit: rad/s}")
    channels = tmp_path / "channels.yaml"
    channels.write_text("\n".join(lines), encoding="utf-8")
    (run,) = load_runs([MEASURED / "comma2k19_rav4"], channels=[channels]).runs
    found = by_name([run])[GYRO + "bias"]
    assert found.verdict == "differs"
    assert found.estimate.value == pytest.approx((-0.44 + 0.008) / 60, abs=3e-4)


@needs_measured
def test_a_late_position_and_a_late_yaw_rate_are_found_with_their_lag() -> None:
    car = by_name(load_runs([MEASURED / "p1_psu"]).runs)
    assert (car[POSITION].verdict, car[POSITION].effect) == ("differs", "sensor_latency")
    assert 0.045 < car[POSITION].estimate.value < 0.08
    assert car[GYRO + "scale"].verdict == "agrees"
    race = by_name(load_runs([MEASURED / "iac_deepdynamics"]).runs)
    assert race[GYRO + "lag"].verdict == "differs"
    assert 0.3 < race[GYRO + "lag"].estimate.value < 0.4
    wheels = race["speed against the velocity of the localization: scale"]
    assert wheels.estimate.value == pytest.approx(1.012, abs=0.002)


@needs_measured
def test_a_log_without_speed_tells_of_its_gyro_alone() -> None:
    checks = by_name(load_runs([MEASURED / "kora_k3_bags"]).runs)
    assert checks[GYRO + "bias"].verdict != "not_testable"
    assert checks[SPEED + "scale"].verdict == "not_testable"
    assert np.isfinite(checks[GYRO + "bias"].estimate.std)
