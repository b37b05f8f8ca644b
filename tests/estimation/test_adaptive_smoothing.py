"""An angle that is smoothed for as long as it rests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_case import layer_of, records
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.estimation.adaptive_smoothing import adaptively_smoothed
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
    before, after, turning = [], [], ([], [])
    for seed in range(6):
        windows, true = windows_of(seed)
        smooth = adaptively_smoothed(windows, windows.inputs, [NOISE])
        seconds = windows.times - windows.times[0]
        rests = (abs(seconds - 18.75) > 3.0) & (seconds > 2.0) & (seconds < seconds[-1] - 2.0)
        errors = windows.inputs[:, 0] - true, smooth[:, 0] - true
        for error, resting, largest in zip(errors, (before, after), turning, strict=True):
            resting.append(np.std(error[rests]))
            largest.append(np.abs(error[~rests]).max())
        assert np.array_equal(smooth[:, 1], windows.inputs[:, 1]), "the speed has no corners"
    assert np.mean(after) < 0.5 * np.mean(before)
    assert np.mean(turning[1]) < 1.5 * np.mean(turning[0]), "a turn is followed"


def test_an_angle_without_noise_stays_as_it_is() -> None:
    windows, _ = windows_of(None)
    exact = OwnNoise(NOISE.name, NOISE.shape, 1e-12, NOISE.smoothing)
    smooth = adaptively_smoothed(windows, windows.inputs, [exact])
    assert smooth == pytest.approx(windows.inputs, abs=1e-9)
    assert np.array_equal(adaptively_smoothed(windows, windows.inputs, []), windows.inputs)


def test_an_exact_angle_that_stops_at_once_does_not_swing_beyond() -> None:
    (run,) = records(count=1, seconds=40.0)
    stops = 0.08 * np.clip((run.times - run.times[0] - 18.0) / 0.4, 0.0, 1.0)
    layer = layer_of([replace(run, road_wheel_angle=stops)])
    true = 0.08 * np.clip((layer.windows.times - run.times[0] - 18.0) / 0.4, 0.0, 1.0)
    swing = [np.abs(one.inputs[:, 0] - true).max() for one in (layer.windows, layer.calm_windows)]
    assert swing[0] > 1e-3, "smoothing over a fixed span swings"
    assert swing[1] < 1e-9
