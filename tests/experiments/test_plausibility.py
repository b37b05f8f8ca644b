"""Signs, units and axes that cannot be true are found before anything is fitted, and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_runs import changed, derived_yaw_rate, truck_run, with_signals

from ident.experiments.comparison import Finding, refused
from ident.experiments.motion import MotionRun, MotionSettings, motion_run
from ident.experiments.motion_inputs import road_wheel_input, speed_input
from ident.experiments.plausibility import check_plausibility
from ident.results import Estimate, Latency
from ident.signals.signal import Run, Signal

EARTH = 9.80665


def times(factor: float):
    return lambda _time, values: factor * values


def findings_of(run: Run) -> list[Finding]:
    grid = np.arange(int(run.duration * 100)) / 100
    steering, speed = road_wheel_input(run), speed_input(run)
    assert not isinstance(steering, str)
    assert not isinstance(speed, str)
    angle, velocity = (each.at(grid, 100.0, 0.2) for each in (steering, speed))
    known = np.isfinite(angle) & np.isfinite(velocity)
    return check_plausibility(
        run,
        Signal("road_wheel_angle", grid[known], angle[known], "rad"),
        Signal("speed", grid[known], velocity[known], "m/s"),
    )


@pytest.mark.parametrize(
    "name",
    ["planar/planar_a", "planar/planar_b", "planar/planar_c", "manual_a", "slow_slalom", "slow_circle"],
)
def test_true_signals_are_plausible(name: str) -> None:
    findings = findings_of(truck_run(name))
    assert len(findings) >= 5
    assert {each.verdict for each in findings} == {"fine"}, findings


@pytest.mark.parametrize(
    ("changes", "culprits", "says"),
    [
        ({"yaw_rate": times(-1)}, {"yaw_rate"}, "opposite to what it says, the sign is turned"),
        ({"yaw_rate": times(57.29578)}, {"yaw_rate"}, "degrees taken as radians"),
        ({"yaw_rate": times(-57.29578)}, {"yaw_rate"}, "degrees taken as radians, and the sign is turned"),
        ({"yaw_rate": times(1 / 57.29578)}, {"yaw_rate"}, "degrees taken as radians"),
        ({"lateral_acceleration": times(-1)}, {"lateral_acceleration"}, "the sign is turned"),
        ({"lateral_acceleration": times(EARTH)}, {"lateral_acceleration"}, "g taken as m/s²"),
        ({"lateral_acceleration": times(1 / EARTH)}, {"lateral_acceleration"}, "g taken as m/s²"),
        ({"heading": times(-1)}, {"heading", "position_x", "position_y"}, "the sign is turned"),
        ({"lateral_velocity": times(-1)}, {"lateral_velocity"}, "the sign is turned"),
        ({"lateral_velocity": times(57.3)}, {"lateral_velocity"}, "degrees"),
        ({"steering_wheel_angle": times(-1)}, {"road_wheel_angle"}, "the sign is turned"),
        ({"steering_wheel_angle": times(57.29578)}, {"road_wheel_angle"}, "degrees taken as radians"),
        (
            {"position_y": times(-1)},
            {"position_x", "position_y"},
            "x and y are exchanged or one has the wrong",
        ),
        (
            {"position_x": times(0.3048), "position_y": times(0.3048)},
            {"position_x", "position_y"},
            "check the unit of the position",
        ),
        ({"longitudinal_velocity": times(3.6)}, {"speed"}, "km/h taken as m/s"),
    ],
)
def test_the_wrong_signal_is_named_with_what_is_wrong(changes, culprits: set[str], says: str) -> None:
    found = refused(findings_of(changed(truck_run("manual_a"), **changes)))
    assert set(found) == culprits
    assert any(says in text for text in found.values()), found
    assert all("\n" not in text and "channels.yaml" in text for text in found.values())


def test_a_heading_counted_from_north_does_not_agree_with_the_position() -> None:
    found = refused(findings_of(changed(truck_run(), heading=lambda _t, v: v + np.pi / 2)))
    assert set(found) == {"position_x", "position_y"}
    assert "where little slips is -1.57" in found["position_x"]


def test_a_steering_wheel_angle_taken_as_that_of_the_road_wheel_is_recognised() -> None:
    run = truck_run()
    wheel = replace(run.signals["steering_wheel_angle"], name="road_wheel_angle")
    told = motion_run(with_signals(run, road_wheel_angle=wheel))
    assert isinstance(told, str)
    assert "a steering-wheel angle taken as that of the road wheel, or a wrong steering ratio" in told


@pytest.mark.parametrize(("factor", "says"), [(3.6, "km/h taken as m/s"), (1 / 3.6, "km/h taken as m/s")])
def test_without_a_position_the_speed_is_found_wrong_by_the_turning(factor: float, says: str) -> None:
    run = with_signals(changed(truck_run(), speed=times(factor)), longitudinal_velocity=None)
    settings = MotionSettings(least_speed=0.1)
    told = motion_run(with_signals(run, position_x=None, position_y=None), settings=settings)
    assert isinstance(told, str)
    assert told.startswith("the speed is about ")
    assert says in told


def test_two_signals_that_contradict_each_other_alone_are_both_refused() -> None:
    run = with_signals(
        changed(truck_run(), yaw_rate=times(-1)),
        **dict.fromkeys(("heading", "lateral_acceleration", "position_x", "position_y", "lateral_velocity")),
    )
    found = refused(findings_of(run))
    assert set(found) == {"road_wheel_angle", "yaw_rate"}
    assert "of road_wheel_angle or yaw_rate in channels.yaml" in found["yaw_rate"]


def test_a_derived_yaw_rate_is_no_witness_for_its_heading() -> None:
    others = dict.fromkeys(("position_x", "position_y", "lateral_velocity"))
    turned = with_signals(changed(truck_run(), heading=times(-1)), **others)
    found = refused(findings_of(derived_yaw_rate(turned)))
    assert set(found) == {"heading", "yaw_rate"}
    assert "heading disagrees with road_wheel_angle, lateral_acceleration" in found["heading"]


def test_without_a_wheelbase_signs_and_large_factors_are_still_found() -> None:
    run = truck_run()
    vehicle = replace(run.vehicle, cg_to_front_axle=None)
    assert not refused(findings_of(replace(run, vehicle=vehicle)))
    turned = changed(replace(run, vehicle=vehicle), steering_wheel_angle=times(-1))
    assert set(refused(findings_of(turned))) == {"road_wheel_angle"}


def test_a_wrong_ratio_and_a_wrong_tyre_radius_are_doubted_and_used() -> None:
    run = changed(
        truck_run("slow_slalom"),
        steering_wheel_angle=times(2.5),
        longitudinal_velocity=times(1.05),
    )
    findings = findings_of(run)
    assert not refused(findings)
    doubted = {each.signals for each in findings if each.verdict == "warning"}
    assert ("road_wheel_angle",) in doubted
    assert ("speed", "position_x", "position_y") in doubted


def test_a_small_angle_between_course_and_heading_is_doubted() -> None:
    findings = findings_of(changed(truck_run(), heading=lambda _t, v: v + 0.04))
    (doubted,) = [each for each in findings if each.verdict == "warning"]
    assert doubted.ratio == pytest.approx(-0.04, abs=0.005)
    assert "it looks like a slip angle" in doubted.text


def test_straight_driving_accuses_nobody() -> None:
    rng = np.random.default_rng(4)

    def noise(time: np.ndarray, _values: np.ndarray) -> np.ndarray:
        return 0.002 * rng.standard_normal(time.size)

    names = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "steering_wheel_angle", "heading")
    run = changed(truck_run(), **dict.fromkeys(names, noise))
    run = with_signals(run, position_x=None, position_y=None)
    assert not refused(findings_of(run))


@pytest.mark.parametrize(("seconds", "verdict"), [(0.31, "refused"), (-0.2, "refused"), (0.06, "warning")])
def test_a_late_signal_is_named(seconds: float, verdict: str) -> None:
    run = truck_run()
    delay = Estimate(seconds, 0.005, seconds - 0.01, seconds + 0.01, "s")
    late = Latency("yaw_rate", "heading", delay)
    weak = Latency("position", "heading", replace(delay, status="weak"))
    findings = findings_of(replace(run, health=replace(run.health, latencies=[late, weak])))
    (found,) = [each for each in findings if each.verdict != "fine"]
    assert (found.signals, found.verdict) == (("yaw_rate",), verdict)
    assert f"{abs(seconds):.2f} s {'late' if seconds > 0 else 'early'}" in found.text
    assert "align.latency" in found.text
    assert "{derivative_of: heading}" in found.text


def test_what_is_refused_does_not_reach_the_windows() -> None:
    found = motion_run(changed(truck_run(), lateral_acceleration=times(EARTH)))
    assert isinstance(found, MotionRun)
    assert all("lateral_acceleration" not in window.measurements for window in found.windows)
    assert any("g taken as m/s²" in told for told in found.rejected)
    told = motion_run(changed(truck_run(), steering_wheel_angle=times(-1)))
    assert isinstance(told, str)
    assert "invert: true" in told


def test_a_late_signal_is_kept_where_its_lag_is_looked_for() -> None:
    run = truck_run()
    late = Latency("yaw_rate", "heading", Estimate(0.31, 0.005, 0.30, 0.32, "s"))
    run = replace(run, health=replace(run.health, latencies=[late]))
    dropped, kept = (motion_run(run, settings=MotionSettings(refuse_late=refuse)) for refuse in (True, False))
    assert isinstance(dropped, MotionRun)
    assert isinstance(kept, MotionRun)
    assert all("yaw_rate" not in window.measurements for window in dropped.windows)
    assert all("yaw_rate" in window.measurements for window in kept.windows)
    assert any(each.verdict == "warning" and "0.31 s late" in each.text for each in kept.findings)
