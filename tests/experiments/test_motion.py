"""What of a run goes into the fit of a vehicle model, and what is left out and said."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from motion_runs import at_times, changed, derived_yaw_rate, truck_run, with_signals

from ident.experiments.motion import MotionRun, MotionSettings, motion_run, motion_runs
from ident.signals.run import load_runs
from ident.signals.signal import Run
from ident.vehicle import Vehicle

ROOT = Path(__file__).parents[2]
MEASURED = Path(os.environ.get("IDENT_MEASURED", ROOT / ".." / "shared" / "measured"))
SIGNALS = {"yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y"}
RATIO = 20.5


def windows_of(run: Run, **settings: float) -> MotionRun:
    found = motion_run(run, settings=MotionSettings(**settings))
    assert isinstance(found, MotionRun), found
    return found


def test_a_run_becomes_windows_of_equal_length_with_every_signal() -> None:
    found = windows_of(truck_run())
    lengths = [window.times[-1] - window.times[0] for window in found.windows]
    assert len(lengths) == 6
    assert lengths == pytest.approx([10.0] * 6, abs=0.03)
    assert all(set(window.measurements) == SIGNALS for window in found.windows)
    assert found.reference_x == -2.12
    assert found.imu == (0.6, 0.0)
    assert found.steering_source == "steering_wheel_angle through the ratio of the vehicle file"
    assert found.speed_source == "longitudinal_velocity"
    assert found.rejected == []


def test_each_sample_lies_inside_the_grid_of_one_window_only() -> None:
    run = truck_run()
    found = windows_of(run)
    for name in SIGNALS:
        parts = [window.measurements[name] for window in found.windows]
        for window, part in zip(found.windows, parts, strict=True):
            assert window.times[0] <= part.times[0]
            assert part.times[-1] <= window.times[-1]
        times = np.concatenate([part.times for part in parts])
        values = np.concatenate([part.values for part in parts])
        own = run.signals[name]
        inside = (own.time >= found.windows[0].times[0]) & (own.time <= found.windows[-1].times[-1])
        np.testing.assert_array_equal(times, own.time[inside])
        np.testing.assert_array_equal(values, own.values[inside])


def test_windows_of_one_stretch_share_the_instant_between_them() -> None:
    found = windows_of(truck_run())
    for before, after in zip(found.windows[:-1], found.windows[1:], strict=True):
        assert before.times[-1] == after.times[0]
        assert np.diff(after.times) == pytest.approx(np.full(after.times.size - 1, 0.01))


def test_inputs_are_those_of_the_truck() -> None:
    noise_free, noisy = windows_of(truck_run(noisy=False)), windows_of(truck_run())
    wheel = truck_run(noisy=False).signals["steering_wheel_angle"]
    for true, window in zip(noise_free.windows, noisy.windows, strict=True):
        exact = np.interp(true.times, wheel.time, wheel.values / RATIO)
        assert np.abs(true.road_wheel_angle - exact).max() < 1e-4  # of 0.06: what lies between samples
        # the sensor's bias is 0.0065 rad at the steering wheel, its noise 0.0014 rad
        assert np.mean(window.road_wheel_angle - true.road_wheel_angle) == pytest.approx(
            0.0065 / RATIO, rel=0.1
        )
        assert np.std(window.speed - true.speed) < 0.02


def test_a_table_of_the_ratio_goes_before_the_vehicle_file_and_on_beyond_its_ends() -> None:
    table = [[-0.5, -0.02], [0.0, 0.0], [0.5, 0.03]]
    found = motion_run(truck_run(), ratio=table)
    assert isinstance(found, MotionRun)
    assert found.steering_source == "steering_wheel_angle through the ratio found"
    wheel = truck_run().signals["steering_wheel_angle"]
    for window in found.windows:
        turned = np.interp(window.times, wheel.time, wheel.values)
        assert np.abs(turned).max() > 0.5
        exact = np.where(turned < 0, turned * 0.04, turned * 0.06)
        assert window.road_wheel_angle == pytest.approx(exact, abs=1e-4)


def test_the_mean_of_two_road_wheels_is_used_before_the_steering_wheel() -> None:
    run = truck_run()
    wheel = run.signals["steering_wheel_angle"]
    left, right = (
        replace(wheel, name=f"road_wheel_angle_{side}", values=wheel.values / RATIO * factor)
        for side, factor in (("left", 1.04), ("right", 0.96))
    )
    both = with_signals(run, road_wheel_angle_left=left, road_wheel_angle_right=right)
    found = windows_of(both)
    assert found.steering_source == "mean of road_wheel_angle_left and road_wheel_angle_right"
    assert found.windows[2].road_wheel_angle == pytest.approx(windows_of(run).windows[2].road_wheel_angle)
    one = replace(left, name="road_wheel_angle")
    assert windows_of(with_signals(both, road_wheel_angle=one)).steering_source == "road_wheel_angle"


def test_a_better_source_with_few_samples_is_passed_over() -> None:
    run = truck_run()
    own = run.signals["longitudinal_velocity"]
    sparse = at_times(own, own.time < 12.0)
    found = windows_of(with_signals(run, longitudinal_velocity=sparse))
    assert found.speed_source == "speed"
    assert len(found.windows) == 6
    slow = at_times(own, np.arange(own.time.size) % 25 == 0)  # 2 Hz
    assert windows_of(with_signals(run, longitudinal_velocity=slow)).speed_source == "speed"


def test_a_gap_of_an_input_divides_the_run_and_is_told() -> None:
    run = truck_run()
    wheel = run.signals["steering_wheel_angle"]
    gap = at_times(wheel, (wheel.time < 20.0) | (wheel.time > 24.0))
    found = windows_of(with_signals(run, steering_wheel_angle=gap))
    assert not [w for w in found.windows if w.times[0] < 22.0 < w.times[-1]]
    assert [round(float(w.times[-1] - w.times[0])) for w in found.windows] == [10, 10, 9, 9, 9, 9]
    assert found.rejected == ["4.0 s without road-wheel angle or speed"]


def test_slow_parts_and_short_pieces_are_left_out_with_their_seconds() -> None:
    def slow(time: np.ndarray, values: np.ndarray) -> np.ndarray:
        crawling = ((time > 10.0) & (time < 18.0)) | ((time > 20.0) & (time < 25.0))
        return np.where(crawling, 1.0, values)

    run = with_signals(changed(truck_run(), longitudinal_velocity=slow), position_x=None, position_y=None)
    found = windows_of(run)
    assert found.rejected[0].endswith("s slower than 3 m/s")
    assert float(found.rejected[0].split()[0]) == pytest.approx(13.0, abs=0.5)
    assert found.rejected[1].endswith("s in pieces shorter than 3 s")
    assert float(found.rejected[1].split()[0]) == pytest.approx(2.0, abs=0.3)
    assert all(window.speed.min() >= 3.0 for window in found.windows)


def test_a_reverse_or_standing_vehicle_gives_no_window_and_the_reason() -> None:
    run = changed(truck_run(), longitudinal_velocity=lambda _t, v: -v, speed=lambda _t, v: 0 * v)
    found = motion_run(run)
    assert isinstance(found, str)
    assert found.startswith("no 3 s at 3 m/s or faster with road-wheel angle, speed and a measured motion; ")
    assert "60.0 s slower than 3 m/s" in found
    assert "\n" not in found


def test_a_correction_of_the_localization_ends_a_window() -> None:
    def shifted(time: np.ndarray, values: np.ndarray) -> np.ndarray:
        return values + 0.05 * (time > 25.003)

    found = windows_of(changed(truck_run(), heading=shifted))
    assert not [w for w in found.windows if w.times[0] < 25.0 < w.times[-1] - 0.05]
    assert found.rejected[0].startswith("heading: 1 jump, the largest 0.0")
    assert sum(w.times[-1] - w.times[0] for w in found.windows) > 59.8


def test_a_spike_is_an_outlier_and_no_end_of_a_window() -> None:
    def spiked(_time: np.ndarray, values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[1500:1502] += 3.0
        return values

    found = windows_of(changed(truck_run(), position_x=spiked))
    assert found.rejected == ["position_x and position_y: 2 samples stand alone and were left out"]
    assert len(found.windows) == 6
    own = truck_run().signals["position_x"].time
    there = np.concatenate([window.measurements["position_x"].times for window in found.windows])
    assert set(own[1500:1502]) & set(there) == set()
    assert own.size - there.size <= 4


def test_a_position_that_jumps_all_the_time_is_left_out_instead_of_the_windows() -> None:
    def jumping(time: np.ndarray, values: np.ndarray) -> np.ndarray:
        return values + 2.0 * np.cos(np.arange(time.size) // 50)

    found = windows_of(changed(truck_run(), position_y=jumping))
    assert len(found.windows) == 6
    assert all({"position_x", "position_y"}.isdisjoint(window.measurements) for window in found.windows)
    assert "too many to cut the run there, left out" in found.rejected[0]
    assert "half of them 1 s apart or less" in found.rejected[0]


def test_held_samples_are_not_counted_twice() -> None:
    run = truck_run()
    odometry = run.signals["heading"].time
    fast = np.arange(odometry[0], odometry[-1], 0.002)  # 500 Hz, the values of 50 Hz
    last = np.searchsorted(odometry, fast, side="right") - 1
    names = ("heading", "position_x", "position_y", "lateral_velocity")
    held = {n: replace(run.signals[n], time=fast, values=run.signals[n].values[last]) for n in names}
    found = windows_of(with_signals(run, **held))
    for name in ("heading", "lateral_velocity", "position_x"):
        assert np.median(np.diff(found.windows[1].measurements[name].times)) == pytest.approx(0.02, rel=0.1)
    assert sum("repeat the one before" in told for told in found.rejected) >= 2


def test_the_repetitions_of_a_quantised_signal_are_information() -> None:
    def coarse(_time: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.round(values / 0.004) * 0.004  # 0.23 degrees/s, as on the bus of a car

    run = changed(truck_run(), yaw_rate=coarse)
    assert np.mean(np.diff(run.signals["yaw_rate"].values) == 0) > 0.3
    found = windows_of(run)
    assert found.windows[0].measurements["yaw_rate"].times.size > 990
    assert found.rejected == []


def test_a_fast_signal_is_low_passed_and_thinned() -> None:
    run = truck_run()
    fast = np.arange(0.0, 60.0, 0.001)
    own = run.signals["yaw_rate"]
    vibrating = np.interp(fast, own.time, own.values) + 0.3 * np.sin(2 * np.pi * 180.0 * fast)
    found = windows_of(with_signals(run, yaw_rate=replace(own, time=fast, values=vibrating)))
    part = found.windows[2].measurements["yaw_rate"]
    assert np.median(np.diff(part.times)) == pytest.approx(0.01, rel=1e-6)
    true = truck_run(noisy=False).signals["yaw_rate"]
    assert np.std(part.values - np.interp(part.times, true.time, true.values)) < 0.002


def test_impossible_values_are_left_out() -> None:
    def broken(_time: np.ndarray, values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[[700, 3000]] = -28.3
        return values

    found = windows_of(changed(truck_run(), yaw_rate=broken))
    assert "yaw_rate: 2 samples up to 28.3 rad/s left out, need at most 3" in found.rejected


def test_a_signal_in_raw_counts_is_refused() -> None:
    run = truck_run()
    raw = replace(run.signals["yaw_rate"], raw=True)
    found = windows_of(with_signals(run, yaw_rate=raw))
    assert found.rejected == ["yaw_rate: a raw count: give its unit in channels.yaml"]
    wheel = replace(run.signals["steering_wheel_angle"], raw=True)
    told = motion_run(with_signals(run, steering_wheel_angle=wheel))
    assert told == "steering_wheel_angle is a raw count: give its unit in channels.yaml"


def test_a_heading_and_its_derivative_are_not_both_compared() -> None:
    found = windows_of(derived_yaw_rate(truck_run()))
    assert all(set(window.measurements) == SIGNALS - {"yaw_rate"} for window in found.windows)
    assert found.rejected == ["yaw_rate: not compared, it is the derivative of the heading, which is"]


def test_a_derivative_of_a_heading_that_jumps_all_the_time_is_used_between_the_jumps() -> None:
    def jumping(time: np.ndarray, values: np.ndarray) -> np.ndarray:
        return values + 0.1 * (np.arange(time.size) // 50 % 2)

    found = windows_of(derived_yaw_rate(changed(truck_run(), heading=jumping)))
    assert all("heading" not in window.measurements for window in found.windows)
    true = truck_run(noisy=False).signals["yaw_rate"]
    parts = [window.measurements["yaw_rate"] for window in found.windows]
    errors = np.concatenate([p.values - np.interp(p.times, true.time, true.values) for p in parts])
    assert np.abs(errors).max() < 0.05  # a jump of 0.1 rad in 0.15 s would be 1 rad/s
    assert errors.size > 1800


def test_half_a_position_is_none() -> None:
    run = truck_run()
    raw = replace(run.signals["position_y"], raw=True)
    found = windows_of(with_signals(run, position_y=raw))
    assert {"position_x", "position_y"}.isdisjoint(found.windows[0].measurements)
    assert "position_x: left out, x and y of a position need the same stamps" in found.rejected


def test_what_a_run_lacks_is_told_and_the_others_are_used() -> None:
    run = truck_run()
    no_ratio = replace(run, name="b", vehicle=None)
    no_speed = replace(with_signals(run, speed=None, longitudinal_velocity=None), name="c")
    no_steering = replace(with_signals(run, steering_wheel_angle=None), name="d")
    still = replace(with_signals(run, **dict.fromkeys(SIGNALS)), name="e")
    found, refusals = motion_runs([run, no_ratio, no_speed, no_steering, still])
    assert [each.name for each in found] == ["planar/planar_a"]
    reasons = {each.what: each.reason for each in refusals}
    assert (
        reasons["b"] == "steering_wheel_angle without a steering ratio: state steering_ratio in vehicle.yaml"
    )
    assert reasons["c"].startswith("no speed and no longitudinal_velocity: name its topic")
    assert reasons["d"].startswith("no measured steering: name the topic of road_wheel_angle or")
    assert reasons["e"].startswith("nothing to compare a vehicle model with: need one of yaw_rate")


def test_the_point_of_the_pose_is_never_guessed_unsaid() -> None:
    run = truck_run()
    unsaid = {n: replace(run.signals[n], at=None) for n in ("position_x", "position_y", "lateral_velocity")}
    found = windows_of(with_signals(run, **unsaid))
    assert found.reference_x == 0.0
    assert found.notes[0].startswith("the point that position and lateral velocity refer to is not said")
    unknown = replace(run, vehicle=Vehicle(steering_ratio=RATIO))
    found = windows_of(unknown)
    assert set(found.windows[0].measurements) == {"yaw_rate", "lateral_acceleration", "heading"}
    assert any("cg_to_rear_axle is not known" in told for told in found.rejected)


def test_a_lateral_velocity_of_another_point_is_moved_to_that_of_the_position() -> None:
    run = truck_run(noisy=False)
    velocity, rate = run.signals["lateral_velocity"], run.signals["yaw_rate"]
    at_cg = velocity.values + 2.12 * np.interp(velocity.time, rate.time, rate.values)
    found = windows_of(with_signals(run, lateral_velocity=replace(velocity, values=at_cg, at="cg")))
    part = found.windows[3].measurements["lateral_velocity"]
    exact = np.interp(part.times, velocity.time, velocity.values)
    assert part.values == pytest.approx(exact, abs=2e-3)


def test_long_windows_are_whole_stretches() -> None:
    found = windows_of(truck_run(), window=1e9)
    assert len(found.windows) == 1


@pytest.mark.skipif(not MEASURED.is_dir(), reason=f"no measured logs in {MEASURED} (IDENT_MEASURED)")
def test_a_race_car_with_a_late_yaw_rate_and_a_corrected_position() -> None:
    (run,) = load_runs([MEASURED / "iac_deepdynamics"]).runs
    found = windows_of(run)
    assert all(set(w.measurements) == {"heading", "lateral_velocity"} for w in found.windows)
    told = "; ".join(found.rejected)
    assert "yaw_rate is 0.31 s late against heading, need less than 0.1 s" in told
    assert "position_x and position_y: " in told  # corrected once a second
    assert "half of them 1 s apart or less" in told
    assert "road_wheel_angle: 1895 samples of 11900 repeat the one before" in told
    assert sum(w.times[-1] - w.times[0] for w in found.windows) > 0.9 * 460


@pytest.mark.skipif(not MEASURED.is_dir(), reason=f"no measured logs in {MEASURED} (IDENT_MEASURED)")
def test_a_car_with_two_road_wheel_angles() -> None:
    runs = {run.name: run for run in load_runs([MEASURED / "p1_psu"]).runs}
    found = windows_of(runs["ramp_steer_l"])
    assert found.steering_source == "mean of road_wheel_angle_left and road_wheel_angle_right"
    assert set(found.windows[0].measurements) == SIGNALS
    warned = [each for each in found.findings if each.verdict == "warning"]
    assert [each.signals for each in warned] == [("position_x", "position_y")]
    assert warned[0].ratio == pytest.approx(0.06, abs=0.02)  # the GPS position is late
