"""Campaigns as the fits of the loop take them: complete, unchanged, and under the names of `ident`."""

import numpy as np
import pytest
from improve_runs import (
    OUTSIDE,
    TYPICAL,
    Injected,
    actuator_runs,
    drive_campaign,
    key_of,
    measured,
    motion_data,
    noise_floor,
    true_parameters,
    typical,
)

from ident.estimation.actuator_runs import fit_together

RUNS = ["there_and_back", "sweep_slow", "steps"]
SEED = 6


@pytest.fixture(scope="module")
def driven():
    return drive_campaign([], SEED, runs=RUNS)


@pytest.fixture(scope="module")
def runs(driven):
    return measured(driven, SEED)


def test_all_that_moves_becomes_windows_of_motion(driven, runs):
    data = motion_data(runs, driven.truth)
    assert [run.name for run in data.runs] == RUNS
    assert data.left_out == []
    assert data.body.mass == driven.truth.planar.body.mass
    names = {"yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y"}
    for record in data.records:
        assert set(record.measured) == names
        assert np.min(record.speed) > 1.9
    assert sum(record.times[-1] - record.times[0] for record in data.records) > 115.0


def test_the_windows_hold_what_was_measured(driven, runs):
    data = motion_data(runs, driven.truth)
    record = data.records[-1]
    turn, seen = runs["steps"]["yaw_rate"], record.measured["yaw_rate"]
    inside = np.isin(turn.time, seen.times)
    assert np.sum(inside) == len(seen.times) > 4000
    np.testing.assert_array_equal(turn.values[inside], seen.values)
    expected = np.interp(record.times, *_steering(runs["steps"])) / driven.truth.planar.steering_ratio
    assert np.sqrt(np.mean((record.road_wheel_angle - expected) ** 2)) < 1e-3


def _steering(run):
    angle = run["steering_wheel_angle"]
    return angle.time, angle.values


def test_the_actuator_of_a_sound_truck_is_found(driven, runs):
    records = actuator_runs(runs, driven.truth)
    assert [one.name for one in records] == RUNS
    fit, _, hidden = fit_together(records)
    actuator = driven.truth.steering.actuator
    t1, t2 = actuator.time_constant_1, actuator.time_constant_2
    gain, dead_time, total, ratio = fit.fit.shared[:4]
    assert hidden == []
    assert gain == pytest.approx(actuator.gain, abs=2e-4)
    assert dead_time == pytest.approx(actuator.dead_time, abs=1e-3)
    assert total == pytest.approx(t1 + t2, abs=2e-3)
    assert ratio == pytest.approx(t1 * t2 / (t1 + t2) ** 2, abs=6e-3)
    assert fit.rms == pytest.approx(noise_floor(driven, runs)["steering_wheel_angle"], rel=0.01)


def test_a_fault_of_the_actuator_leaves_more_than_noise(driven):
    stiff = drive_campaign([typical("steering_column_play")], SEED, runs=RUNS)
    runs = measured(stiff, SEED)
    fit, _, _ = fit_together(actuator_runs(runs, stiff.truth))
    assert fit.rms > 10.0 * noise_floor(stiff, runs)["steering_wheel_angle"]


def test_effects_go_by_the_keys_of_the_loop():
    assert key_of(typical("sensor_bias")) == "sensor_bias yaw_rate"
    assert key_of(typical("sensor_latency", of="imu")) == "sensor_latency inertial_unit"
    assert key_of(typical("body_roll")) == "body_roll"
    curve = Injected("steering_ratio_nonlinearity", {"cubic": 0.48, "quadratic": 0.1})
    told = true_parameters([curve, typical("tyre_relaxation")])
    assert told["steering_ratio_nonlinearity"] == pytest.approx({"cubic": 0.12, "quadratic": 0.05})
    assert told["tyre_relaxation"] == {"length": 0.5}


def test_no_effect_is_both_inside_and_outside():
    assert len(TYPICAL) == 12
    assert not set(TYPICAL) & set(OUTSIDE)
    assert len(OUTSIDE) >= 16
