"""Where the ratio map of a run comes from: both angles, slow motion, the vehicle file."""

from pathlib import Path

import numpy as np
import pytest

from ident.results import RunHealth
from ident.signals.run import load_runs
from ident.signals.signal import Run, Signal
from ident.stages.inputs import AlignSettings
from ident.stages.steering_ratio import BOTH, KINEMATIC, VEHICLE, ratio_map
from ident.vehicle import Vehicle

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"


def run_of(vehicle=None, **columns):
    time = np.arange(0, 60, 0.01)
    signals = {name: Signal(name, time, values(time), "") for name, values in columns.items()}
    health = RunHealth("run", "", "", 60.0, "", "", [], {}, [])
    return Run("run", 0, 60.0, signals, vehicle, health)


def wheel(time):
    return 3 * np.sin(0.3 * time)


def test_both_angles_come_first_and_two_road_wheels_are_averaged():
    run = run_of(
        Vehicle(steering_ratio=15.0),
        steering_wheel_angle=wheel,
        road_wheel_angle_left=lambda t: wheel(t) / 20 + 0.01 * wheel(t) ** 2,
        road_wheel_angle_right=lambda t: wheel(t) / 20 - 0.01 * wheel(t) ** 2,
    )
    table, source, refused = ratio_map([run], AlignSettings())
    assert source == BOTH
    assert refused == []
    assert np.diff(table, axis=0)[:, 0] / np.diff(table, axis=0)[:, 1] == pytest.approx(20.0, rel=1e-6)


def test_without_a_road_wheel_angle_the_motion_at_low_speed_tells():
    run = run_of(
        Vehicle(cg_to_front_axle=2.0, cg_to_rear_axle=1.7, steering_ratio=15.0),
        steering_wheel_angle=wheel,
        speed=lambda t: np.full_like(t, 2.0),
        yaw_rate=lambda t: 2.0 * np.tan(wheel(t) / 20) / 3.7,
    )
    table, source, _ = ratio_map([run], AlignSettings())
    assert source == KINEMATIC
    assert (table[-1][0] - table[0][0]) / (table[-1][1] - table[0][1]) == pytest.approx(20.0, rel=1e-3)


def test_without_motion_the_vehicle_file_tells_and_what_failed_is_said():
    run = run_of(
        Vehicle(steering_ratio=15.0), steering_wheel_angle=lambda t: 0 * t, road_wheel_angle=lambda t: 0 * t
    )
    table, source, refused = ratio_map([run], AlignSettings())
    assert (table, source) == ([[-15.0, -1.0], [15.0, 1.0]], VEHICLE)
    assert [one.what for one in refused] == [f"ratio map from {BOTH}"]


def test_with_nothing_there_is_no_map():
    assert ratio_map([run_of(steering_wheel_angle=wheel)], AlignSettings()) == ([], None, [])


def test_the_slow_runs_of_the_simulated_truck_give_its_ratio_but_for_its_slip():
    """At 5 m/s the tyres slip: the ratio comes out larger by the understeer, a few per cent."""
    loaded = load_runs([SAMPLES / "slow_circle", SAMPLES / "slow_slalom"], vehicle=SAMPLES / "vehicle.yaml")
    table, source, _ = ratio_map(loaded.runs, AlignSettings())
    assert source == KINEMATIC
    ratio = (table[-1][0] - table[0][0]) / (table[-1][1] - table[0][1])
    true = (
        load_runs([SAMPLES / "slow_circle"], vehicle=SAMPLES / "vehicle.yaml").runs[0].vehicle.steering_ratio
    )
    assert true <= ratio <= 1.03 * true
