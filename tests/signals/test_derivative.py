"""The rate of change of a sampled signal."""

import numpy as np
import pytest

from ident.signals.derivative import WINDOW, slope


def jittered(rng, rate, seconds):
    return np.sort(np.arange(0, seconds, 1 / rate) + rng.normal(0, 0.1 / rate, int(seconds * rate)))


@pytest.mark.parametrize("rate", [10, 20, 50, 100])
def test_a_parabola_is_exact_on_jittering_stamps(rate):
    time = jittered(np.random.default_rng(rate), rate, 8.0)
    at, found = slope(time, 2.0 - 0.5 * time + 0.3 * time**2)
    assert found == pytest.approx(-0.5 + 0.6 * at, abs=1e-9)
    assert len(at) > 0.9 * len(time) - 20


def test_a_slow_sine_keeps_its_size_and_has_no_delay():
    time = np.arange(0, 20, 0.01)
    frequency = 0.2 / WINDOW
    omega = 2 * np.pi * frequency
    at, found = slope(time, np.sin(omega * time))
    waves = np.column_stack([np.cos(omega * at), np.sin(omega * at)])
    in_phase, late = np.linalg.lstsq(waves, found / omega, rcond=None)[0]
    assert 0.93 < in_phase <= 1.0
    assert abs(late) < 1e-9


def test_noise_is_suppressed():
    rng = np.random.default_rng(1)
    time = np.arange(0, 100, 0.01)
    _, found = slope(time, rng.normal(0, 1, len(time)))
    difference = np.sqrt(2) / 0.01
    assert found.std() < 0.05 * difference


def test_nothing_is_said_across_a_gap():
    time = np.concatenate([np.arange(0, 2, 0.01), np.arange(5, 7, 0.01)])
    at, found = slope(time, np.where(time < 3, 0.0, 100.0))
    assert not np.any((at > 1.99) & (at < 5.0))
    assert found == pytest.approx(0, abs=1e-9)


def test_too_few_samples_give_nothing():
    at, found = slope(np.arange(4.0), np.arange(4.0))
    assert len(at) == len(found) == 0


def test_five_samples_give_one_slope():
    at, found = slope(np.arange(5.0), 3 * np.arange(5.0))
    assert at.tolist() == [2.0]
    assert found == pytest.approx([3.0])
