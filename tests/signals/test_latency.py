"""Which latencies are estimated, on a generated drive and on measured ones."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from ident.signals.latency import latencies
from ident.signals.run import load_runs
from ident.signals.signal import Signal
from ident.vehicle import Vehicle

MEASURED = Path(os.environ.get("IDENT_MEASURED", Path(__file__).parents[2] / ".." / "shared" / "measured"))
measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason=f"no measured logs in {MEASURED} (IDENT_MEASURED)"
)

STEP = 0.001
REAR_AXLE_TO_IMU = 3.0


def integral(values):
    return cumulative_trapezoid(values, dx=STEP, initial=0)


def drive(seconds=120.0, seed=0):
    """A drive on a fine grid, the rear axle slipping: time, and each signal at its own point."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, seconds, STEP)
    waves = [(f, rng.uniform(0, 2 * np.pi)) for f in np.geomspace(0.03, 0.6, 12)]
    yaw_rate = 0.05 * sum(np.sin(2 * np.pi * f * time + p) for f, p in waves) / np.sqrt(6)
    speed = 11 + 1.5 * sum(np.sin(2 * np.pi * f * time + 2 * p) for f, p in waves) / np.sqrt(6)
    heading = 0.4 + integral(yaw_rate)
    lateral = -0.02 * speed**2 * yaw_rate
    along = integral(speed * np.cos(heading) - lateral * np.sin(heading))
    across = integral(speed * np.sin(heading) + lateral * np.cos(heading))
    at_imu = lateral + REAR_AXLE_TO_IMU * yaw_rate
    return time, {
        "yaw_rate": yaw_rate,
        "heading": heading,
        "speed": speed,
        "longitudinal_velocity": speed,
        "lateral_velocity": lateral,
        "position_x": along,
        "position_y": across,
        "lateral_acceleration": np.gradient(at_imu, STEP) + speed * yaw_rate,
        "longitudinal_acceleration": np.gradient(speed, STEP) - at_imu * yaw_rate,
    }


NOISE = {"yaw_rate": 2e-3, "heading": 1e-3, "speed": 0.03, "lateral_acceleration": 0.05}


def signals(delays, *, seed=0, leave_out=()):
    """Signals as sensors give them: each at its rate and phase, noisy, and as late as ``delays`` says."""
    time, truth = drive(seed=seed)
    rng = np.random.default_rng(seed + 100)
    found = {}
    for name, values in truth.items():
        if name in leave_out:
            continue
        rate = 100.0 if name in {"yaw_rate", "lateral_acceleration", "longitudinal_acceleration"} else 25.0
        stamps = np.arange(3.0 + rng.uniform(0, 1 / rate), time[-1] - 0.1, 1 / rate)
        read = np.interp(stamps - delays.get(name, 0.0), time, values)
        noise = NOISE.get(name, 0.02) * rng.standard_normal(len(read))
        at = "rear_axle" if name == "lateral_velocity" else None
        found[name] = Signal(name, stamps, read + noise, "x", at=at)
    return found


TRUCK = Vehicle(cg_to_front_axle=2.4, cg_to_rear_axle=2.0, imu_position=(1.0, 0.0, 0.0))
SOURCES = {"speed": "/wheels.v", "longitudinal_velocity": "/odometry.v"}


def found(delays, vehicle=TRUCK, **options):
    return {late.signal: late for late in latencies(signals(delays, **options), vehicle, SOURCES)}


def test_sensors_that_are_not_late_are_said_not_to_be():
    every = [found({}, seed=seed) for seed in range(4)]
    names = {"yaw_rate", "position", "speed", "longitudinal_acceleration", "lateral_acceleration"}
    assert all(set(late) == names for late in every)
    delays = [each.delay for late in every for each in late.values()]
    assert all(delay.std < 0.005 for delay in delays)
    assert all(abs(delay.value) < 4 * delay.std for delay in delays)
    assert sum(delay.low <= 0 <= delay.high for delay in delays) >= 16  # of 20, at 95 %


@pytest.mark.parametrize(
    ("name", "delays", "truth"),
    [
        ("yaw_rate", {"yaw_rate": 0.32}, 0.32),
        ("position", {"position_x": 0.07, "position_y": 0.07}, 0.07),
        ("speed", {"speed": 0.15}, 0.15),
        ("lateral_acceleration", {"lateral_acceleration": 0.05}, 0.05),
        ("yaw_rate", {"heading": 0.1}, -0.1),
    ],
)
def test_a_late_sensor_is_measured(name, delays, truth):
    delay = found(delays)[name].delay
    assert abs(delay.value - truth) < 4 * delay.std
    assert delay.std < 0.005
    assert delay.status == "identified"


def test_the_place_of_the_imu_is_not_taken_for_a_delay():
    known = found({})["lateral_acceleration"].delay
    unknown = found({}, Vehicle())["lateral_acceleration"].delay
    assert abs(known.value) < 4 * known.std
    assert unknown.status == "weak"
    assert "imu_position" in unknown.reason
    assert unknown.value < -0.1  # 3 m / 11 m/s: why it must not be called identified


def test_side_slip_is_not_taken_for_a_delay():
    late = found({}, leave_out=("lateral_velocity",))
    assert "position" not in late
    assert "lateral_acceleration" not in late


def test_two_signals_of_one_source_are_no_pair():
    one = {"speed": "/odometry.v", "longitudinal_velocity": "/odometry.v"}
    assert "speed" not in {late.signal for late in latencies(signals({}), TRUCK, one)}


def test_a_derived_yaw_rate_is_not_compared_with_what_it_is_derived_from():
    sources = {**SOURCES, "yaw_rate": "derivative of heading"}
    assert "yaw_rate" not in {late.signal for late in latencies(signals({}), TRUCK, sources)}


def test_a_run_without_pairs_has_no_latencies():
    only = {name: signal for name, signal in signals({}).items() if name == "yaw_rate"}
    assert latencies(only, None, {}) == []


@measured
def test_the_yaw_rate_of_a_race_car_is_late_as_its_facts_say():
    (run,) = load_runs([MEASURED / "iac_deepdynamics"]).runs
    late = {each.signal: each.delay for each in run.health.latencies}
    assert late["yaw_rate"].value == pytest.approx(0.32, abs=0.02)
    assert late["longitudinal_acceleration"].low <= 1.6 <= late["longitudinal_acceleration"].high


@measured
def test_the_gps_of_a_car_is_late_and_its_gyro_is_not():
    runs = {run.name: run for run in load_runs([MEASURED / "p1_psu"]).runs}
    late = {each.signal: each.delay for each in runs["ramp_steer_l"].health.latencies}
    assert 0.045 < late["position"].value < 0.08
    assert abs(late["yaw_rate"].value) < 0.005
