"""Measures on signals whose measures are known."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from bench_case import Held, Steers, circle, direct, straight, truck

from ident.control.closed_loop import Disturbance, Outcome, Settings, run
from ident.control.measures import (
    LOST,
    Label,
    Limits,
    measure,
    model_name,
    quantile,
    rms,
    settled,
    switches,
    told,
    turns,
    works,
)
from ident.control.plant import Plant

UNEVEN = np.sort(np.concatenate([np.linspace(0.0, 10.0, 4001), 10 * np.random.default_rng(0).random(2000)]))


def test_means_are_over_time_whatever_the_grid():
    wave = 3.0 * np.sin(2 * np.pi * UNEVEN)
    assert rms(UNEVEN, wave) == pytest.approx(3.0 / np.sqrt(2), rel=1e-4)
    assert rms(np.array([0.0, 1.0, 4.0]), np.array([2.0, 2.0, 2.0])) == pytest.approx(2.0)
    assert rms(np.array([0.0, 3.0]), np.array([0.0, 3.0])) == pytest.approx(np.sqrt(3.0))
    assert quantile(UNEVEN, UNEVEN, 0.95) == pytest.approx(9.5, abs=0.01)
    mostly = np.where(UNEVEN < 9.6, 1.0, 5.0)
    assert quantile(UNEVEN, mostly, 0.95) == 1.0
    assert quantile(UNEVEN, mostly, 0.97) == 5.0


def test_the_settled_error_is_the_mean_of_the_last_second_with_its_sign():
    decaying = -0.2 + np.exp(-UNEVEN)
    expected = -0.2 + np.exp(-9.0) - np.exp(-10.0)
    assert settled(UNEVEN, decaying) == pytest.approx(expected, abs=1e-6)
    assert settled(np.array([0.0, 0.5]), np.array([1.0, 3.0])) == pytest.approx(2.0)


def test_works_of_braking_and_of_accelerating_are_those_of_the_kinetic_energy():
    speed = 15.0 + 2.0 * np.sin(UNEVEN * 2 * np.pi / 5)
    acceleration = 2.0 * 2 * np.pi / 5 * np.cos(UNEVEN * 2 * np.pi / 5)
    braking, driving = works(UNEVEN, acceleration, speed)
    swing = 0.5 * (17.0**2 - 13.0**2)
    assert braking == pytest.approx(2 * swing, rel=1e-4)
    assert driving == pytest.approx(2 * swing, rel=1e-4)


def test_noise_within_the_band_is_no_switch_and_no_reversal():
    random = np.random.default_rng(1)
    noise = 0.004 * random.uniform(-1.0, 1.0, UNEVEN.size)
    assert switches(noise, 0.05) == 0
    assert switches(0.3 * np.sin(2 * np.pi * 0.3 * UNEVEN) + noise, 0.05) == 5
    assert switches(np.array([0.1, 0.0, 0.1, 0.0, -0.1, 0.0, -0.1]), 0.05) == 1
    assert turns(noise, 0.01) == 0
    assert turns(0.3 * np.sin(2 * np.pi * 0.3 * UNEVEN) + noise, 0.01) == 6
    assert turns(np.array([0.0, 1.0, 0.9, 2.0, -1.0]), 0.5) == 1
    assert turns(np.array([]), 0.5) == 0


def test_a_steady_circle_has_the_acceleration_of_the_circle_and_no_jerk():
    angle, speed = 0.05, 6.0
    radius = 4.5 / np.tan(angle)
    road = circle(1 / np.hypot(radius, 1.9), speed, 60.0)
    road = replace(road, road_wheel_angle=np.full_like(road.speed, angle))
    found = measure(run(Plant(direct("kinematic")), Held(angle), road))
    assert found.lateral_acceleration_max == pytest.approx(speed**2 / radius, rel=1e-6)
    assert found.lateral_jerk_rms < 1e-6
    assert found.steering_rate_max < 1e-6
    assert found.braking_work == found.acceleration_work == 0.0


def test_jerk_and_rates_of_a_weave_are_those_of_its_amplitude():
    """Kinematic truck, small angles, requests so often that they are nearly a sine."""
    speed, size, frequency = 8.0, 0.01, 0.25
    angular = 2 * np.pi * frequency

    class Weaves(Held):
        def step(self, measured, reference):
            _, told = super().step(measured, reference)
            return replace(self.command, steering_request=size * np.sin(angular * measured.time)), told

    loop = run(Plant(direct("kinematic", time_constant_1=0.02)), Weaves(period=0.01), straight(speed, 64.0))
    found = measure(loop)
    assert found.steering_rate_rms == pytest.approx(size * angular / np.sqrt(2), rel=0.02)
    assert found.lateral_jerk_rms == pytest.approx(speed**2 / 4.5 * size * angular / np.sqrt(2), rel=0.02)
    assert found.lateral_acceleration_max == pytest.approx(speed**2 / 4.5 * size, rel=0.01)
    assert found.steering_reversals == pytest.approx(2 * frequency, rel=0.05)


def test_violations_are_counted_by_cycle_and_plans_count_too():
    plant, road = Plant(truck()), straight(20.0, 200.0)
    loop = run(plant, Steers(), road, Disturbance(1.0))
    assert measure(loop).violations == 0
    beyond = loop.times[np.abs(loop.lateral_error) > 0.5]
    cycles = {min(int(np.ceil(time / 0.05 - 1e-9)) - 1, 999) for time in beyond if time > 0} | {0}
    assert 2 < len(cycles) < 100
    assert measure(loop, Limits(lateral_error=0.5)).violations == len(cycles)
    assert measure(loop, Limits(lateral_acceleration=1e-9, steering_rate=1e-9)).violations > 100
    planned = tuple(replace(one, violation=0.1 * (k == 7)) for k, one in enumerate(loop.diagnostics))
    assert measure(replace(loop, diagnostics=planned)).violations == 1


def test_solve_times_failures_and_missed_deadlines_are_counted():
    loop = run(Plant(truck()), Steers(), straight(20.0, 100.0))
    times = np.linspace(0.001, 0.1, loop.cycles.size)
    slow = tuple(
        replace(one, solve_time=float(time), solved=time < 0.09)
        for one, time in zip(loop.diagnostics, times, strict=True)
    )
    found = measure(replace(loop, diagnostics=slow))
    assert found.solve_time_p50 == pytest.approx(np.median(times))
    assert found.solve_time_p99 == pytest.approx(np.quantile(times, 0.99))
    assert found.deadline_misses == np.count_nonzero(times > 0.05)
    assert found.infeasible == np.count_nonzero(times >= 0.09)


def test_a_run_is_told_with_its_start_and_its_mismatch():
    one = truck("magic_formula", effects={"tyre_relaxation": {"length": 0.5}, "gyro_scale": {"scale": 0.01}})
    assert model_name(one) == "magic_formula+tyre_relaxation+gyro_scale"
    loop = run(Plant(truck()), Steers(), straight(20.0, 100.0), Disturbance(lateral_error=0.5))
    label = Label("single_lane_change", 20.0, "linear", model_name(one), {"mass": 0.3}, seed=4)
    run_told = told(loop, label)
    assert run_told.disturbance == {"lateral_error": 0.5, "mass": 0.3}
    assert run_told.controller == "pid"
    assert run_told.completed
    assert run_told.arrival_time_error == pytest.approx(loop.arrival_time - 5.0)
    assert run_told.lateral_error_max == pytest.approx(0.5, abs=1e-6)
    assert run_told.seed == 4
    assert run_told.lost is None


def test_how_a_path_was_lost_is_told():
    label = Label("single_lane_change", 20.0, "linear", "linear")
    gone = run(Plant(truck()), Steers(), straight(20.0, 100.0), Disturbance(lateral_error=3.0))
    assert told(gone, label).lost == "left the lane"
    inwards, wide = Disturbance(heading_error=np.pi / 2), Settings(lateral_limit=50.0)
    folded = run(Plant(truck("kinematic")), Held(), circle(0.2, 5.0, 60.0), inwards, wide)
    assert told(folded, label).lost == "came to the centre of the path's curvature"
    assert set(LOST) == set(get_args(Outcome)) - {"completed"}
