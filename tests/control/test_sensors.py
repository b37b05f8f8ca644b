"""What the sensors of the bench read, against the truth and against theory."""

from __future__ import annotations

import numpy as np
import pytest
from bench_case import truck

from ident.control.controllers.controller import Command
from ident.control.plant import Plant, Start
from ident.control.sensors import NoiseSource, Sensors, noise_of, seen
from ident.errors import BadRecipe
from ident.model_file import SignalNoise

PERIOD = 0.05


def readings(plant, count=30, seed=0, heading=0.3):
    """What is read at each cycle, what is true then, and the whole true motion."""
    ride = plant.begin(Start(15.0, heading=heading), seed)
    read, truth, parts = [], [], []
    for k in range(count):
        read.append(ride.measured())
        truth.append(ride.now)
        parts.append(ride.advance(Command(float(np.sin(0.4 * k)), 0.2), PERIOD * (k + 1)))
    return read, truth, parts


def test_without_errors_the_sensors_read_the_truth():
    read, truth, _ = readings(Plant(truck()))
    for one, now in zip(read, truth, strict=True):
        values = vars(one).copy()
        values.pop("time")
        assert values == {name: now[name] for name in values}
    assert [one.time for one in read] == pytest.approx(PERIOD * np.arange(30), abs=1e-12)


def test_a_late_sensor_reads_what_was():
    late = 0.073
    read, _, parts = readings(Plant(truck(), Sensors(latency={"yaw_rate": late})))
    times = np.concatenate([part.times for part in parts])
    rates = np.concatenate([part.values["yaw_rate"] for part in parts])
    then = np.interp([one.time - late for one in read], times, rates)
    np.testing.assert_allclose([one.yaw_rate for one in read], then, atol=1e-9)
    assert np.max(np.abs(then)) > 0.01


def test_biases_and_scales_of_effects_add_to_those_of_the_sensors():
    effects = {
        "sensor_bias yaw_rate": {"bias": 0.01},
        "gyro_scale": {"scale": 0.1},
        "wheel_speed_scale": {"wheel_speed_scale.scale": 0.02},
    }
    plant = Plant(truck(effects=effects), Sensors(bias={"yaw_rate": 0.005}))
    read, truth, _ = readings(plant)
    rates = np.array([now["yaw_rate"] for now in truth])
    speeds = np.array([now["longitudinal_velocity"] for now in truth])
    np.testing.assert_allclose([one.yaw_rate for one in read], 1.1 * rates + 0.015, atol=1e-12)
    np.testing.assert_allclose([one.longitudinal_velocity for one in read], 1.02 * speeds, rtol=1e-12)


def test_an_autoregression_has_its_variance_and_correlation():
    coefficient, std = 0.8, 0.5
    source = NoiseSource("heading", SignalNoise(std, [coefficient], 0.02), 7)
    drawn = np.array([source.at(0.02 * k) for k in range(20000)])
    total = std**2 / (1 - coefficient**2)
    assert np.var(drawn) == pytest.approx(total, rel=0.06)
    assert np.mean(drawn[1:] * drawn[:-1]) / np.var(drawn) == pytest.approx(coefficient, abs=0.02)


def test_noise_begins_as_it_goes_on():
    """The first value has the variance of the stationary process, and does not begin at zero."""
    noise = SignalNoise(1.0, [0.9], 0.02)
    firsts = [NoiseSource("heading", noise, seed).at(0.0) for seed in range(400)]
    assert np.var(firsts) == pytest.approx(1 / (1 - 0.81), rel=0.25)


def test_a_slow_sensor_repeats_its_sample_and_a_fast_one_skips():
    noise = SignalNoise(1.0, [0.5], 0.1)
    slow = NoiseSource("yaw_rate", noise, 3)
    values = [slow.at(0.05 * k) for k in range(20)]
    assert values[::2] == values[1::2]
    assert len(set(values)) == 10
    sparse = NoiseSource("yaw_rate", noise, 3)
    assert [sparse.at(0.2 * k) for k in range(5)] == values[::4]


def test_continuous_noise_keeps_its_correlation_over_any_time():
    tau, std = 0.3, 2.0
    source = NoiseSource("yaw_rate", SignalNoise(std, correlation_time=tau), 0)
    drawn = np.array([source.at(0.21 * k) for k in range(20000)])
    assert np.std(drawn) == pytest.approx(std, rel=0.03)
    assert np.corrcoef(drawn[1:], drawn[:-1])[0, 1] == pytest.approx(np.exp(-0.21 / tau), abs=0.02)


def test_seeds_reproduce_and_signals_do_not_share_their_noise():
    noise = {"yaw_rate": SignalNoise(0.01), "heading": SignalNoise(0.01)}
    both = Plant(truck(), Sensors(noise=noise))
    alone = Plant(truck(), Sensors(noise={"yaw_rate": SignalNoise(0.01)}))
    rates = [
        [one.yaw_rate for one in readings(plant, seed=seed)[0]]
        for plant, seed in ((both, 5), (both, 5), (alone, 5), (both, 6))
    ]
    assert rates[0] == rates[1] == rates[2]
    assert rates[0] != rates[3]


def test_noise_across_the_truck_turns_with_its_heading():
    sensors = Sensors(noise={"position_across": SignalNoise(0.5)})
    read, truth, _ = readings(Plant(truck("kinematic"), sensors), heading=0.7)
    errors = np.array(
        [
            (one.position_x - now["position_x"], one.position_y - now["position_y"])
            for one, now in zip(read, truth, strict=True)
        ]
    )
    angles = np.array([now["heading"] for now in truth])
    along = errors[:, 0] * np.cos(angles) + errors[:, 1] * np.sin(angles)
    across = errors[:, 1] * np.cos(angles) - errors[:, 0] * np.sin(angles)
    np.testing.assert_allclose(along, 0.0, atol=1e-12)
    assert np.std(across) > 0.2


def test_names_of_a_model_file_become_those_that_a_controller_sees():
    noise = {
        "steering_wheel_angle": SignalNoise(1.0),
        "speed": SignalNoise(2.0),
        "lateral_acceleration": SignalNoise(3.0),
        "position_along": SignalNoise(4.0),
    }
    assert {name: one.std for name, one in noise_of(noise).items()} == {
        "steering_angle": 1.0,
        "longitudinal_velocity": 2.0,
        "position_along": 4.0,
    }
    with pytest.raises(BadRecipe, match="hitch_angle: no sensor of the bench"):
        seen("hitch_angle")


def test_refuses_sensors_that_are_not():
    for made in (
        lambda: Sensors(bias={"speed": 1.0}),
        lambda: Sensors(noise={"roll_angle": SignalNoise(1.0)}),
        lambda: Sensors(latency={"yaw_rate": -0.1}),
    ):
        with pytest.raises(BadRecipe, match="need"):
            made()
