"""An angle that is smoothed for as long as it rests."""

from __future__ import annotations

import numpy as np
import pytest
from motion_case import layer_of, records
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.estimation.adaptive_smoothing import AGREE, with_adaptively_smoothed
from ident.estimation.input_noise import INPUTS
from ident.estimation.noise import AutoRegression
from ident.estimation.own_noise import OwnNoise
from ident.estimation.vehicle_records import Windows

Array = NDArray[np.float64]

POLES, STD = (0.55, 0.18), 6e-5  # [rad]
NOISE = OwnNoise("road_wheel_angle", AutoRegression(np.array(POLES)), STD, INPUTS["road_wheel_angle"])


def turned(times: Array) -> Array:
    """Held, turned by 0.08 rad over 1.5 s as a hand does, held again."""
    share = np.clip((times - times[0] - 18.0) / 1.5, 0.0, 1.0)
    return np.asarray(0.08 * share**3 * (10.0 - 15.0 * share + 6.0 * share**2))


def windows_of(seed: int | None) -> tuple[Windows, Array]:
    """Smoothed as all inputs are, with noise or without; and the true angle."""
    windows = layer_of(records(count=1, seconds=40.0)).windows
    true, period = turned(windows.times), float(windows.steps[0])
    given = true.copy()
    if seed is not None:
        drawn = np.random.default_rng(seed).standard_normal(true.size + 500)
        given += lfilter([STD], [1.0, *(-pole for pole in POLES)], drawn)[500:]
    windows.inputs[:, 0] = INPUTS["road_wheel_angle"].of(given, period)
    return windows, true


def test_of_an_angle_that_rests_less_than_half_of_the_noise_is_left_and_its_turn_stays() -> None:
    before, after, turning = [], [], []
    for seed in range(6):
        windows, true = windows_of(seed)
        smooth = with_adaptively_smoothed(windows, [NOISE])
        seconds = windows.times - windows.times[0]
        rests = (abs(seconds - 18.75) > 3.0) & (seconds > 2.0) & (seconds < seconds[-1] - 2.0)
        before.append(np.std((windows.inputs[:, 0] - true)[rests]))
        after.append(np.std((smooth.inputs[:, 0] - true)[rests]))
        turning.append(np.abs(smooth.inputs[:, 0] - true)[~rests].max())
        assert smooth.same_as(windows)
        assert np.array_equal(smooth.inputs[:, 1], windows.inputs[:, 1]), "the speed has no corners"
    assert np.mean(after) < 0.5 * np.mean(before)
    assert np.mean(turning) < 2 * AGREE * 2.5 * np.mean(before), "as far as two estimates may be apart"


def test_an_angle_without_noise_stays_as_it_is() -> None:
    windows, _ = windows_of(None)
    exact = OwnNoise(NOISE.name, NOISE.shape, 1e-12, NOISE.smoothing)
    smooth = with_adaptively_smoothed(windows, [exact])
    assert smooth.inputs == pytest.approx(windows.inputs, abs=1e-9)
    assert with_adaptively_smoothed(windows, []).inputs == pytest.approx(windows.inputs, abs=0.0)


def test_noise_is_smoothed_over_the_spans_that_were_chosen() -> None:
    windows, _ = windows_of(1)
    smooth = with_adaptively_smoothed(windows, [NOISE])
    spans = smooth.adaptive[NOISE.name]
    both = np.column_stack([windows.inputs[:, 0], 2.0 * windows.inputs[:, 0]])
    expected = np.column_stack([smooth.inputs[:, 0], 2.0 * smooth.inputs[:, 0]])
    assert spans.of(windows, both) == pytest.approx(expected, rel=1e-12, abs=1e-15)
