"""Prediction of the simulated planar truck by its own model, and the arithmetic of its errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from generator.motion_sets import motion_set, noise_free
from generator.truth import load_truth
from truck_runs import run_of, vehicle_of

from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import compiled
from ident.dynamics.kinematic import kinematic
from ident.estimation.evaluation import (
    BlockSums,
    Candidate,
    block_sums,
    bootstrap_weights,
    from_many_starts,
    interval,
    logged_state,
    nanoseconds_per_step,
    paired,
    predict,
    whole,
)
from ident.estimation.vehicle_records import MotionRecord, Samples
from ident.experiments.motion import MotionSettings, motion_runs

NAME = "planar/planar_c"
LEVEL = {"bank_cos": 0.0, "bank_sin": 0.0, "steering_offset": 0.0}


@pytest.fixture(scope="module")
def truth():
    return load_truth()


def records_of(truth, seed=1):
    run = run_of(NAME, motion_set(NAME, truth, seed), vehicle_of(truth.planar))
    found, refused = motion_runs([run], settings=MotionSettings(window=1e6))
    assert not refused
    return [
        MotionRecord(
            0,
            window.times,
            window.road_wheel_angle,
            window.speed,
            {name: Samples(one.times, one.values) for name, one in window.measurements.items()},
            reference_x=found[0].reference_x,
            imu=found[0].imu,
        )
        for window in found[0].windows
    ]


@pytest.fixture(scope="module")
def clean(truth):
    return records_of(noise_free(truth))


@pytest.fixture(scope="module")
def own_model(truth):
    body = truth.planar.body
    parameters = {
        "mass": body.mass,
        "yaw_inertia": body.yaw_inertia,
        "cg_to_front_axle": body.cg_to_front_axle,
        "cg_to_rear_axle": body.cg_to_rear_axle,
        **LEVEL,
    }
    for axle in ("front", "rear"):
        tyre = getattr(truth.planar, axle)
        parameters |= {
            f"{axle}.cornering_stiffness": tyre.stiffness * tyre.shape * tyre.peak,
            f"{axle}.peak_force": tyre.peak,
            f"{axle}.shape": tyre.shape,
            f"{axle}.curvature": tyre.curvature,
        }
    return Candidate("magic_formula", compiled(bicycle("magic_formula", "magic_formula")), parameters)


@pytest.fixture(scope="module")
def kinematic_model(truth):
    body = truth.planar.body
    known = {name: getattr(body, name) for name in ("cg_to_front_axle", "cg_to_rear_axle")}
    return Candidate("kinematic", compiled(kinematic()), {**known, "steering_offset": 0.0})


def test_the_true_model_predicts_a_minute_without_noise_from_its_logged_start(clean, own_model, truth):
    found = predict(own_model, whole(clean, truth.planar.body.cg_to_rear_axle))
    assert np.sqrt(np.mean(found.errors["yaw_rate"] ** 2)) < 2e-4
    assert np.sqrt(np.mean(found.errors["lateral_acceleration"] ** 2)) < 3e-3
    assert np.abs(found.errors["heading"]).max() < 2e-3
    assert np.hypot(found.errors["position_x"], found.errors["position_y"]).max() < 1.0


def test_the_error_of_the_true_model_is_the_noise_of_the_sensors(own_model, truth):
    channel = truth.imu.channels["yaw_rate"]
    noise = np.hypot(channel.white_std, channel.noise_std)
    records = [
        replace(r, measured={k: s for k, s in r.measured.items() if k != "position_x"})
        for r in records_of(truth)
    ]
    found = predict(own_model, whole(records, truth.planar.body.cg_to_rear_axle))
    own = found.errors["yaw_rate"] - channel.bias
    assert np.std(own) == pytest.approx(noise, rel=0.05)
    assert "position_x" not in found.errors


def test_the_kinematic_model_is_far_worse_where_there_is_lateral_acceleration(clean, kinematic_model, truth):
    segments = from_many_starts(clean, 1.0, 0.5, truth.planar.body.cg_to_rear_axle)
    found = predict(kinematic_model, segments)
    felt = [np.abs(record.measured["lateral_acceleration"].values).mean() for record in segments.records]
    gentle = np.array(felt) < 0.5
    rms = [block_sums(found, "yaw_rate", segments.block_count, part).rms for part in (gentle, ~gentle)]
    assert rms[1] > 2 * rms[0]


def test_windows_start_at_the_logged_state_and_have_the_length_asked(clean, truth):
    segments = from_many_starts(clean, 2.0, 0.5, truth.planar.body.cg_to_rear_axle)
    lengths = {round(float(r.times[-1] - r.times[0]), 6) for r in segments.records}
    assert lengths == {2.0}
    first = segments.records[7]
    state = dict(zip(("vy", "r", "heading", "x", "y"), segments.states[7], strict=True))
    truth_rate = np.interp(
        first.times[0], first.measured["yaw_rate"].times, first.measured["yaw_rate"].values
    )
    assert state["r"] == pytest.approx(truth_rate, abs=2e-3)
    assert np.diff([r.times[0] for r in segments.records]) == pytest.approx(0.5, abs=1e-9)


def test_without_a_lateral_velocity_the_rear_axle_does_not_slip_at_the_start(clean):
    bare = replace(clean[0], measured={"yaw_rate": clean[0].measured["yaw_rate"]})
    at = float(clean[0].times[500])
    state = logged_state(bare, at, 2.12)
    assert state[0] == pytest.approx(2.12 * state[1])
    assert list(state[2:]) == [0.0, 2.12, 0.0]  # the rear axle stands at the origin, heading along x


def test_intervals_of_independent_blocks_hold_the_rms_as_often_as_they_say():
    random = np.random.default_rng(3)
    weights = bootstrap_weights(40, 0)
    held = 0
    for _ in range(300):
        squares = random.chisquare(20, 40)
        low, high = interval(BlockSums(squares, np.full(40, 20.0)), weights)
        held += low <= 1.0 <= high
    assert 0.90 <= held / 300 <= 0.98


def test_a_difference_that_every_block_shows_is_certain_and_none_is_not():
    random = np.random.default_rng(5)
    base = random.chisquare(20, 30)
    one, better = BlockSums(base, np.full(30, 20.0)), BlockSums(0.8 * base, np.full(30, 20.0))
    value, low, high, p = paired(better, one, bootstrap_weights(30, 1))
    assert value == pytest.approx(np.sqrt(0.8))
    assert low == pytest.approx(value)
    assert high == pytest.approx(value)
    assert p < 0.01
    other = BlockSums(random.permutation(base), np.full(30, 20.0))
    assert paired(other, one, bootstrap_weights(30, 1))[3] > 0.2


def test_fewer_than_three_blocks_have_no_interval():
    assert interval(BlockSums(np.array([1.0, 2.0]), np.array([5.0, 5.0])), bootstrap_weights(2, 0)) is None


def test_the_cost_of_a_step_is_measured(clean, own_model, kinematic_model):
    segments = whole(clean, 2.12)
    slow, fast = (nanoseconds_per_step(one, segments) for one in (own_model, kinematic_model))
    assert 0 < fast < slow < 1e5
