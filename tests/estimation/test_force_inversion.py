"""Axle forces and slip angles from the motion, against the truck that made it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from generator.vehicle import magic_formula
from motion_runs import BODY, TRUTH, records, without

from ident.estimation.force_inversion import ForcePoints, invert_forces
from ident.estimation.smooth_motion import INTEGRAL, MEASURED, POSITION, smooth_motion
from ident.estimation.vehicle_records import MotionRecord, Samples

INERTIA = TRUTH.body.yaw_inertia


def curve_error(points: ForcePoints, axle: str) -> np.ndarray:
    tyre = getattr(TRUTH, axle)
    curve = magic_formula(points.slip_angle(axle), tyre.stiffness, tyre.shape, tyre.peak, tyre.curvature)
    return (points.force(axle) - curve)[points.valid]


@pytest.mark.parametrize("axle", ["front", "rear"])
def test_without_noise_the_points_lie_on_the_curve_of_the_tyre(axle: str) -> None:
    points = invert_forces(records(noisy=False), BODY, yaw_inertia=INERTIA)
    assert points.slip_sources == (MEASURED,)
    assert points.valid.mean() > 0.97
    assert np.ptp(points.force(axle)) > 45e3
    assert np.sqrt(np.mean(curve_error(points, axle) ** 2)) < 60.0  # [N], what 0.2 s of smoothing leave


def test_with_noise_offset_and_biases_a_known_bias_is_taken_out() -> None:
    bias = {
        "steering_offset": -0.0065 / TRUTH.steering_ratio,
        "yaw_rate": 0.0018,
        "lateral_acceleration": 0.035,
    }
    raw = invert_forces(records(), BODY, yaw_inertia=INERTIA)
    freed = invert_forces(records(), BODY, yaw_inertia=INERTIA, bias=bias)
    assert np.mean(curve_error(raw, "rear")) > 150.0
    for axle in ("front", "rear"):
        assert abs(np.mean(curve_error(freed, axle))) < 60.0
        assert np.std(curve_error(freed, axle)) < 600.0


def test_forces_balance_mass_and_yaw_inertia() -> None:
    points = invert_forces(records(), BODY, yaw_inertia=INERTIA)
    front = points.front_force * points.cosine
    total = front + points.rear_force
    assert total == pytest.approx(BODY.mass * points.lateral_acceleration, rel=1e-9, abs=1e-6)
    moment = BODY.cg_to_front_axle * front - BODY.cg_to_rear_axle * points.rear_force
    assert moment == pytest.approx(INERTIA * points.yaw_acceleration, rel=1e-9, abs=1e-6)


def test_a_mirrored_drive_gives_mirrored_points() -> None:
    def mirrored(one: MotionRecord) -> MotionRecord:
        turned = {
            name: each if name == "position_x" else Samples(each.times, -each.values)
            for name, each in one.measured.items()
        }
        return replace(one, road_wheel_angle=-one.road_wheel_angle, measured=turned)

    there = invert_forces(records(), BODY)
    back = invert_forces([mirrored(one) for one in records()], BODY)
    for axle in ("front", "rear"):
        assert back.slip_angle(axle) == pytest.approx(-there.slip_angle(axle), abs=1e-12)
        assert back.force(axle) == pytest.approx(-there.force(axle), abs=1e-6)


@pytest.mark.parametrize("left_out", [(), ("lateral_velocity",)])
def test_the_place_of_the_imu_is_accounted_for(left_out: tuple[str, ...]) -> None:
    (record,) = without(records(noisy=False), *left_out)
    (rate,) = [record.measured["yaw_rate"]]
    turning = np.gradient(rate.values, rate.times)
    acceleration = record.measured["lateral_acceleration"]
    slope = np.interp(acceleration.times, rate.times, turning)
    squared = np.interp(acceleration.times, rate.times, rate.values) ** 2
    moved = acceleration.values + 1.5 * slope - 0.8 * squared
    elsewhere = replace(
        record,
        imu=(record.imu[0] + 1.5, record.imu[1] + 0.8),
        measured={**record.measured, "lateral_acceleration": Samples(acceleration.times, moved)},
    )
    here, there = (invert_forces([one], BODY, yaw_inertia=INERTIA) for one in (record, elsewhere))
    use = here.valid & there.valid
    assert np.std((here.rear_force - there.rear_force)[use]) < 60.0
    unaware = invert_forces([replace(elsewhere, imu=record.imu)], BODY, yaw_inertia=INERTIA)
    assert np.std((here.rear_force - unaware.rear_force)[use]) > 500.0


def test_without_lateral_velocity_the_slip_angles_come_from_acceleration_and_yaw_rate() -> None:
    given = records(noisy=False)
    measured = invert_forces(given, BODY, yaw_inertia=INERTIA)
    integrated = invert_forces(without(given, "lateral_velocity"), BODY, yaw_inertia=INERTIA)
    assert integrated.slip_sources == (INTEGRAL,)
    use = measured.valid & integrated.valid
    error = (integrated.rear_slip_angle - measured.rear_slip_angle)[use]
    assert np.std(measured.rear_slip_angle[use]) > 0.02
    assert np.std(error) < 0.004
    # a biased accelerometer and gyro, 10 s long pieces
    noisy = invert_forces(without(records(), "lateral_velocity"), BODY, yaw_inertia=INERTIA)
    assert np.std((noisy.rear_slip_angle - measured.rear_slip_angle)[use]) < 0.005


def test_with_a_position_and_a_heading_alone_there_are_points_too() -> None:
    given = without(records(), "lateral_velocity", "lateral_acceleration", "yaw_rate")
    points = invert_forces(given, BODY, yaw_inertia=INERTIA)
    assert points.slip_sources == (POSITION,)
    for axle in ("front", "rear"):
        assert (
            np.corrcoef(points.slip_angle(axle)[points.valid], points.force(axle)[points.valid])[0, 1] > 0.97
        )


def test_a_window_that_tells_no_turning_is_left_out() -> None:
    given = without(records(), "yaw_rate", "heading")
    points = invert_forces(given, BODY)
    assert points.times.size == 0
    assert points.slip_sources == ()
    assert invert_forces([], BODY).valid.size == 0


def test_without_anything_that_tells_the_slip_no_point_is_valid() -> None:
    given = without(records(), "lateral_velocity", "lateral_acceleration", "position_x")
    points = invert_forces(given, BODY)
    assert points.times.size > 0
    assert not points.valid.any()


def test_points_near_a_gap_are_not_valid() -> None:
    (record,) = records()
    rate = record.measured["yaw_rate"]
    keep = (rate.times < 24.0) | (rate.times > 26.0)
    broken = {**record.measured, "yaw_rate": Samples(rate.times[keep], rate.values[keep])}
    points = invert_forces([replace(record, measured=broken)], BODY)
    inside = (points.times > 24.3) & (points.times < 25.7)
    assert not points.valid[inside].any()
    assert points.valid[(points.times > 21.0) & (points.times < 23.5)].all()


def test_rows_are_those_of_the_runs_in_order() -> None:
    given = [*records(run=0), *records("planar/planar_b", run=1)]
    points = invert_forces(given, BODY)
    assert set(points.run) == {0, 1}
    assert (np.diff(points.run) >= 0).all()
    one = points.times[points.run == 1]
    assert (np.diff(one) >= 0).all()


def test_the_bandwidth_is_as_stated() -> None:
    times = np.arange(0.0, 9.0, 0.01)
    steady = np.full(times.size, 12.0)

    def gain(frequency: float) -> float:
        wave = Samples(times, np.sin(2 * np.pi * frequency * times))
        record = MotionRecord(0, times, 0 * times, steady, {"yaw_rate": wave, "lateral_acceleration": wave})
        (motion,) = smooth_motion([record], BODY)
        exact = 2 * np.pi * frequency * np.cos(2 * np.pi * frequency * times)
        use = motion.valid
        return float(motion.yaw_acceleration[use] @ exact[use] / (exact[use] @ exact[use]))

    assert gain(0.85) == pytest.approx(0.97, abs=0.005)
    assert gain(2.75) == pytest.approx(1 / np.sqrt(2), abs=0.01)
