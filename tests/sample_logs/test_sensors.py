"""The simulated sensors: stamps, latency, noise and resolution."""

import numpy as np
import pytest
from generator.sensors import arrivals, coloured_noise, generator, measure, schedule, seconds
from generator.truth import Channel, Sensor


def test_stamps_follow_the_rate_with_a_phase_and_jitter_of_their_own():
    sensor = Sensor(rate=50.0, jitter=0.0005, channels={})
    stamps = schedule(sensor, 0.0, 200.0, generator(1, "run", "topic"))
    time = seconds(stamps)
    assert len(stamps) == pytest.approx(10_000, abs=1)
    assert np.all(np.diff(stamps) > 0)
    spacing = time - 0.02 * np.arange(len(time))
    assert 0.0 < np.mean(spacing) < 0.02
    assert np.std(spacing) == pytest.approx(0.0005, rel=0.05)
    other = seconds(schedule(sensor, 0.0, 200.0, generator(1, "run", "other")))
    assert abs(np.median(other[: len(time)] - time[: len(other)])) > 1e-4


def test_messages_arrive_late_in_order_and_sometimes_very_late(truth):
    recording = truth.recording
    stamps = schedule(truth.imu, 0.0, 200.0, generator(1, "stamps"))
    late = arrivals(stamps, recording, generator(1, "latency"))
    wait = seconds(late - stamps)
    assert np.all(np.diff(late) > 0)
    assert np.min(wait) >= recording.latency_shortest - 1e-9
    assert np.median(wait) == pytest.approx(
        recording.latency_shortest + np.log(2.0) * recording.latency_excess, rel=0.1
    )
    assert np.max(wait) > 10.0 * np.median(wait)


def test_coloured_noise_has_the_colour_and_the_size_asked_for():
    channel = Channel(noise_std=0.3, noise_ar=(0.55, 0.18))
    noise = coloured_noise(channel, 400_000, generator(4, "noise"))
    assert np.std(noise) == pytest.approx(0.3, rel=0.02)
    lagged = [np.mean(noise[lag:] * noise[: -lag or None]) / np.var(noise) for lag in range(3)]
    first = 0.55 / (1.0 - 0.18)  # Yule-Walker
    assert lagged[1] == pytest.approx(first, abs=0.01)
    assert lagged[2] == pytest.approx(0.55 * first + 0.18, abs=0.01)


def test_a_measurement_has_the_bias_noise_and_resolution_asked_for():
    channel = Channel(bias=0.02, white_std=0.003, noise_std=0.004, noise_ar=(0.5,), resolution=0.0005)
    true = np.sin(np.linspace(0.0, 300.0, 100_000))
    error = measure(channel, true, generator(2, "measure")) - true
    assert np.mean(error) == pytest.approx(0.02, abs=1e-4)
    assert np.std(error) == pytest.approx(np.sqrt(0.003**2 + 0.004**2 + 0.0005**2 / 12.0), rel=0.02)
    steps = (error + true) / 0.0005
    np.testing.assert_allclose(steps, np.round(steps), rtol=0, atol=1e-6)


def test_a_perfect_sensor_tells_the_truth():
    true = np.linspace(-1.0, 1.0, 100)
    np.testing.assert_array_equal(measure(Channel(), true, generator(1)), true)


def test_random_numbers_depend_on_seed_run_and_topic():
    draws = {generator(*key).random() for key in ((1, "a", "x"), (1, "a", "y"), (1, "b", "x"), (2, "a", "x"))}
    assert len(draws) == 4
    assert generator(1, "a", "x").random() in draws
