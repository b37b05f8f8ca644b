"""Observed axle forces against trucks that share nothing with the observer, and against the inversion."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from generator.vehicle import magic_formula
from motion_runs import BODY as SAMPLE_BODY
from motion_runs import TRUTH, records
from numpy.typing import NDArray
from plane_truck import BODY, IMU, INERTIA, NOISE, REFERENCE_X, STEP, PlaneTruck, brush, inputs
from scipy.linalg import expm

from ident.errors import NotIdentifiable
from ident.estimation.force_inversion import invert_forces
from ident.estimation.force_observer import LEVEL, ObservedForces, observe_forces
from ident.estimation.force_system import ForceVehicle
from ident.estimation.kalman import filtered
from ident.estimation.noise import AutoRegression, NoiseModel
from ident.estimation.vehicle_records import MotionRecord, Samples

Array = NDArray[np.float64]

TRUCK = PlaneTruck(brush(3.3e5, 4.4e4), brush(4.0e5, 5.0e4))
SIGNALS = ("yaw_rate", "lateral_acceleration", "lateral_velocity")
SEEDS = range(8)


def white(std: float) -> NoiseModel:
    return NoiseModel(AutoRegression(np.zeros(0)), std)


KNOWN = {name: white(NOISE[name]) for name in SIGNALS}


@cache
def driven(seed: int, seconds: float = 20.0) -> tuple[MotionRecord, Array]:
    """A noisy drive, and the forces (m, 2) of both axles in it."""
    angle, speed = inputs(seconds, most=0.07, seed=seed)
    clean = TRUCK.drive(angle, speed).measured
    turn = clean["yaw_rate"].values
    across = clean["lateral_velocity"].values - REFERENCE_X * turn
    rows = zip(angle.tolist(), speed.tolist(), across.tolist(), turn.tolist(), strict=True)
    forces = [
        (
            TRUCK.front(a - math.atan((v + BODY.cg_to_front_axle * r) / u)),
            TRUCK.rear(-math.atan((v - BODY.cg_to_rear_axle * r) / u)),
        )
        for a, u, v, r in rows
    ]
    return TRUCK.drive(angle, speed, seed=100 + seed), np.array(forces)


@cache
def observed(seed: int) -> ObservedForces:
    return observe_forces([driven(seed)[0]], BODY, KNOWN, yaw_inertia=INERTIA)


def rms(error: Array) -> float:
    return float(np.sqrt(np.mean(np.square(error))))


def kept(record: MotionRecord, *names: str) -> MotionRecord:
    return replace(record, measured={name: record.measured[name] for name in names})


# --- forces and bands -----------------------------------------------------------------------------


def test_forces_are_nearer_to_the_truth_than_those_of_the_inversion() -> None:
    ours, theirs = [], []
    for seed in SEEDS:
        record, truth = driven(seed)
        points = invert_forces([record], BODY, yaw_inertia=INERTIA)
        at = np.searchsorted(record.times, points.times[points.valid] - 1e-9)
        inverted = np.column_stack([points.front_force, points.rear_force])[points.valid]
        ours.append(observed(seed).forces[at] - truth[at])
        theirs.append(inverted - truth[at])
    for axle in (0, 1):
        own, other = (rms(np.concatenate(part)[:, axle]) for part in (ours, theirs))
        assert own < 100.0  # [N] of forces up to 20 kN
        assert own < 0.8 * other


def test_bands_hold_the_truth_as_often_as_they_say() -> None:
    """Bands of all instants of one drive are no independent trials: the share is that of 160 s."""
    inside, slips = [], []
    for seed in SEEDS:
        found, (record, truth) = observed(seed), driven(seed)
        low, high = found.band("front")
        inside.append((low <= truth[:, 0]) & (truth[:, 0] <= high))
        assert np.all(found.force_std < 1000.0)
        clean = TRUCK.drive(record.road_wheel_angle, record.speed).measured
        turn = clean["yaw_rate"].values
        across = clean["lateral_velocity"].values - REFERENCE_X * turn
        slip = -np.arctan((across - BODY.cg_to_rear_axle * turn) / record.speed)
        slips.append(np.abs(found.slip_angles[:, 1] - slip) <= LEVEL * found.slip_std[:, 1])
    assert 0.93 <= np.mean(np.concatenate(inside)) <= 0.995
    assert 0.91 <= np.mean(np.concatenate(slips)) <= 0.99


def wandering(seed: int, rate: float, seconds: float = 40.0) -> tuple[MotionRecord, Array]:
    """Motion under forces whose rates of change are random walks: what the observer takes for true."""
    random = np.random.default_rng(seed)
    fine, count = STEP / 10, round(seconds / STEP) * 10 + 1
    loads = np.array([BODY.load("front"), BODY.load("rear")])
    rates = rate * math.sqrt(fine) * loads * np.cumsum(random.standard_normal((count, 2)), axis=0)
    rates -= np.linspace(0, 1, count)[:, None] * rates[-1]
    forces = np.cumsum(rates, axis=0) * fine
    angle = 0.05 * np.sin(0.5 * fine * np.arange(count))
    pushed = forces[:, 0] * np.cos(angle)
    turning = (BODY.cg_to_front_axle * pushed - BODY.cg_to_rear_axle * forces[:, 1]) / INERTIA
    turn = np.concatenate([[0.0], np.cumsum((turning[1:] + turning[:-1]) / 2)]) * fine
    felt = (pushed + forces[:, 1]) / BODY.mass
    rising = felt - 12.0 * turn
    across = np.concatenate([[0.0], np.cumsum((rising[1:] + rising[:-1]) / 2)]) * fine
    read = {
        "yaw_rate": turn,
        "lateral_acceleration": felt + IMU[0] * turning - IMU[1] * turn**2,
        "lateral_velocity": across + REFERENCE_X * turn,
    }
    times = fine * np.arange(count)[::10]
    measured = {
        name: Samples(times, values[::10] + NOISE[name] * random.standard_normal(times.size))
        for name, values in read.items()
    }
    speed = np.full(times.size, 12.0)
    record = MotionRecord(0, times, angle[::10], speed, measured, reference_x=REFERENCE_X, imu=IMU)
    return record, forces[::10]


def test_where_forces_wander_as_assumed_rate_bands_and_innovations_are_exact() -> None:
    shares, rates, squares = [], [], []
    for seed in range(6):
        record, truth = wandering(seed, 0.3)
        found = observe_forces([record], BODY, KNOWN, yaw_inertia=INERTIA)
        rates.append(found.rate)
        shares.append(np.mean(np.abs(found.forces - truth) <= LEVEL * found.force_std))
        squares.append([one.mean for one in found.consistency.values()])
        assert all(one.low < one.mean < one.high for one in found.consistency.values())
    assert np.mean(rates) == pytest.approx(0.3, rel=0.05)
    assert 0.93 <= np.mean(shares) <= 0.97
    assert np.mean(squares) == pytest.approx(1.0, abs=0.08)


def test_the_rate_is_where_the_innovations_are_most_likely_whatever_the_mass_is_called() -> None:
    record, _ = wandering(3, 0.3)
    found = observe_forces([record], BODY, KNOWN, yaw_inertia=INERTIA)
    heavy = observe_forces([record], replace(BODY, mass=2 * BODY.mass), KNOWN, yaw_inertia=2 * INERTIA)
    assert heavy.rate == pytest.approx(found.rate, rel=1e-6)
    assert heavy.forces == pytest.approx(2 * found.forces, rel=1e-5, abs=1.0)


def test_smoothing_halves_what_a_filter_does_not_know() -> None:
    record, truth = driven(1)
    vehicle = ForceVehicle(BODY, INERTIA, {}, {name: NOISE[name] ** 2 for name in SIGNALS})
    problem = vehicle.problem(record)
    late = filtered(problem.system, observed(1).rate ** 2).states[problem.grid, 2:4] - truth
    assert rms(observed(1).forces[200:] - truth[200:]) < 0.6 * rms(late[200:])


def test_forces_of_the_sample_truck_with_coloured_noise_and_known_biases() -> None:
    """The noise of its sensors is AR(1) and white; at low frequencies it has this density."""
    parts = {
        "yaw_rate": (0.0008, 0.0012, 0.6),
        "lateral_acceleration": (0.02, 0.04, 0.8),
        "lateral_velocity": (0.006, 0.012, 0.85),
    }
    noise = {n: white(math.sqrt(w**2 + c**2 * (1 + a) / (1 - a))) for n, (w, c, a) in parts.items()}
    bias = {
        "steering_offset": -0.0065 / TRUTH.steering_ratio,
        "yaw_rate": 0.0018,
        "lateral_acceleration": 0.035,
    }
    inertia = TRUTH.body.yaw_inertia
    found = observe_forces(records(), SAMPLE_BODY, noise, yaw_inertia=inertia, bias={0: bias})
    exact = invert_forces(records(noisy=False), SAMPLE_BODY, yaw_inertia=inertia)
    inverted = invert_forces(records(), SAMPLE_BODY, yaw_inertia=inertia, bias=bias)
    use = exact.valid & inverted.valid
    at = np.searchsorted(found.times, exact.times[use] - 1e-9)
    for column, axle in enumerate(("front", "rear")):
        tyre, slip = getattr(TRUTH, axle), exact.slip_angle(axle)[use]
        truth = magic_formula(slip, tyre.stiffness, tyre.shape, tyre.peak, tyre.curvature)
        error = found.forces[at, column] - truth
        assert rms(error) < 0.8 * rms(inverted.force(axle)[use] - truth)
        assert 0.93 < np.mean(np.abs(error) <= LEVEL * found.force_std[at, column]) <= 1.0
        wrong = found.slip_angles[at, column] - slip
        assert rms(wrong) < 0.7 * rms(inverted.slip_angle(axle)[use] - slip)
        assert 0.9 < np.mean(np.abs(wrong) <= LEVEL * found.slip_std[at, column]) <= 1.0


def test_coloured_noise_counts_by_its_density_at_low_frequencies() -> None:
    record, _ = driven(2)
    slow = {**KNOWN, "yaw_rate": NoiseModel(AutoRegression(np.array([0.5])), NOISE["yaw_rate"] / 2)}
    found = observe_forces([record], BODY, slow, yaw_inertia=INERTIA)
    assert found.rate == observed(2).rate
    assert np.array_equal(found.forces, observed(2).forces)


# --- the system, what is missing, properties ------------------------------------------------------


def test_the_step_is_the_matrix_exponential_of_the_motion_and_its_noise_that_of_van_loan() -> None:
    record, _ = driven(0)
    vehicle = ForceVehicle(BODY, INERTIA, {}, dict.fromkeys(SIGNALS, 1.0))
    system = vehicle.problem(record).system
    k = 700
    cosine = math.cos((record.road_wheel_angle[k] + record.road_wheel_angle[k - 1]) / 2)
    speed = (record.speed[k] + record.speed[k - 1]) / 2
    a = np.zeros((6, 6))
    a[0, 1], a[0, 2], a[0, 3] = -speed, cosine / BODY.mass, 1 / BODY.mass
    a[1, 2], a[1, 3] = BODY.cg_to_front_axle * cosine / INERTIA, -BODY.cg_to_rear_axle / INERTIA
    a[2, 4] = a[3, 5] = 1.0
    push = np.diag([0, 0, 0, 0, BODY.load("front") ** 2, BODY.load("rear") ** 2])
    both = expm(np.block([[-a, push], [np.zeros((6, 6)), a.T]]) * STEP)
    assert system.transition[k] == pytest.approx(expm(a * STEP), rel=1e-9, abs=1e-16)
    assert system.driven[k] == pytest.approx(both[6:, 6:].T @ both[:6, 6:], rel=1e-6, abs=1e-18)


def test_without_lateral_velocity_forces_are_told_and_slip_angles_are_not() -> None:
    record, truth = driven(3)
    found = observe_forces([kept(record, *SIGNALS[:2])], BODY, KNOWN, yaw_inertia=INERTIA)
    assert rms(found.forces - truth) < 120.0
    assert np.all(np.isnan(found.slip_angles))
    assert np.all(np.isnan(found.lateral_velocity))


def test_without_accelerometer_the_lateral_velocity_tells_them_less_well() -> None:
    record, truth = driven(3)
    found = observe_forces([kept(record, "yaw_rate", "lateral_velocity")], BODY, KNOWN, yaw_inertia=INERTIA)
    assert np.mean(found.force_std) > 1.2 * np.mean(observed(3).force_std)
    assert np.mean(np.abs(found.forces - truth) <= LEVEL * found.force_std) > 0.9


def test_bands_widen_where_samples_are_missing_and_hold_there_too() -> None:
    record, truth = driven(4)
    lost = (record.times > 9.0) & (record.times < 9.6)
    measured = {name: Samples(one.times[~lost], one.values[~lost]) for name, one in record.measured.items()}
    found = observe_forces([replace(record, measured=measured)], BODY, KNOWN, yaw_inertia=INERTIA)
    middle = np.argmin(np.abs(record.times - 9.3))
    assert np.all(found.force_std[middle] > 3 * observed(4).force_std[middle])
    assert np.all(np.abs(found.forces[lost] - truth[lost]) < 2.6 * found.force_std[lost])


def test_a_mirrored_drive_has_the_mirrored_forces() -> None:
    record, _ = driven(5)
    measured = {name: Samples(one.times, -one.values) for name, one in record.measured.items()}
    turned = replace(
        record, road_wheel_angle=-record.road_wheel_angle, measured=measured, imu=(IMU[0], -IMU[1])
    )
    found = observe_forces([turned], BODY, KNOWN, yaw_inertia=INERTIA)
    assert found.forces == pytest.approx(-observed(5).forces, rel=1e-6, abs=1e-3)
    assert found.slip_angles == pytest.approx(-observed(5).slip_angles, rel=1e-6, abs=1e-9)


def test_a_bias_that_is_told_is_taken_out() -> None:
    record, _ = driven(6)
    moved = dict(record.measured)
    for name, size in (("yaw_rate", 0.004), ("lateral_acceleration", 0.2)):
        moved[name] = Samples(moved[name].times, moved[name].values + size)
    turned = moved["lateral_velocity"]
    moved["lateral_velocity"] = Samples(turned.times, turned.values + 0.01 * record.speed)
    biased = replace(record, measured=moved, road_wheel_angle=record.road_wheel_angle - 0.003)
    bias = {
        "yaw_rate": 0.004,
        "lateral_acceleration": 0.2,
        "lateral_velocity_by_speed": 0.01,
        "steering_offset": 0.003,
    }
    found = observe_forces([biased], BODY, KNOWN, yaw_inertia=INERTIA, bias={0: bias})
    assert found.forces == pytest.approx(observed(6).forces, rel=1e-6, abs=1e-3)
    two = kept(biased, *SIGNALS[:2])
    blind, told = (
        observe_forces([two], BODY, KNOWN, yaw_inertia=INERTIA, bias={0: each}, rate=found.rate)
        for each in ({}, {"lateral_acceleration": 0.2})
    )
    shift = (blind.forces - told.forces)[100:-100].sum(axis=1)
    assert shift == pytest.approx(0.2 * BODY.mass, rel=0.01)


def test_several_runs_have_one_rate_and_biases_of_their_own() -> None:
    first, second = driven(1)[0], replace(driven(2)[0], run=1)
    turned = {
        name: Samples(one.times, one.values + (0.004 if name == "yaw_rate" else 0.0))
        for name, one in second.measured.items()
    }
    both = [first, replace(second, measured=turned)]
    found = observe_forces(both, BODY, KNOWN, yaw_inertia=INERTIA, bias={1: {"yaw_rate": 0.004}})
    rates = sorted([observed(1).rate, observed(2).rate])
    assert rates[0] <= found.rate <= rates[1]
    for run, truth in ((0, driven(1)[1]), (1, driven(2)[1])):
        assert rms(found.forces[found.run == run] - truth) < 100.0


def test_a_long_record_is_cut_and_a_part_of_it_tells_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    record, truth = driven(1)
    monkeypatch.setattr("ident.estimation.force_observer.PIECE", 5.0)
    monkeypatch.setattr("ident.estimation.force_observer.SEARCHED", 10.0)
    found = observe_forces([record], BODY, KNOWN, yaw_inertia=INERTIA)
    assert np.count_nonzero(np.diff(found.times) == 0.0) == 3
    assert found.rate == pytest.approx(observed(1).rate, rel=0.5)
    at = np.searchsorted(record.times, found.times - 1e-9)
    assert rms(found.forces - truth[at]) < 130.0


def test_sensors_that_contradict_each_other_are_told_by_their_innovations() -> None:
    record, _ = driven(7)
    slow = record.measured["lateral_velocity"]
    wrong = Samples(slow.times, slow.values + 0.3 * np.sin(1.5 * slow.times))
    spoiled = replace(record, measured={**record.measured, "lateral_velocity": wrong})
    found = observe_forces([spoiled], BODY, KNOWN, yaw_inertia=INERTIA).consistency
    assert found["lateral_velocity"].mean > 2 * found["lateral_velocity"].high


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (("yaw_rate",), r"\['yaw_rate'\]"),
        (("lateral_acceleration", "lateral_velocity"), r"\['lateral_acceleration', 'lateral_velocity'\]"),
        (("heading",), "nothing"),
    ],
)
def test_records_that_do_not_tell_two_forces_are_refused(names: tuple[str, ...], found: str) -> None:
    with pytest.raises(NotIdentifiable, match=f"measured with known noise {found}, need yaw_rate and one of"):
        observe_forces([kept(driven(0)[0], *names)], BODY, KNOWN)


def test_driving_straight_is_refused() -> None:
    still = TRUCK.drive(np.zeros(1001), np.full(1001, 10.0), seed=1)
    with pytest.raises(NotIdentifiable, match=r"need 0\.003 to stand out of the noise"):
        observe_forces([still], BODY, KNOWN, yaw_inertia=INERTIA)
