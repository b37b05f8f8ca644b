"""Noise of the inputs: what is drawn of it, and how much of it the residuals are found to hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_case import layer_of, records
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.estimation.input_noise import (
    INPUTS,
    SLOW,
    DrawnNoise,
    InputNoise,
    Smoothing,
    input_noise,
    with_smooth_inputs,
)
from ident.estimation.vehicle_records import Windows

Array = NDArray[np.float64]


def noisy(speed: float = 0.03, angle: float = 0.0) -> list:
    """Runs of a sound truck, whose measured inputs hold white noise of these standard deviations."""
    made = []
    for number, one in enumerate(records(count=4, seconds=24.0)):
        random = np.random.default_rng(10 + number)
        made.append(
            replace(
                one,
                speed=one.speed + speed * random.standard_normal(one.speed.size),
                road_wheel_angle=one.road_wheel_angle + angle * random.standard_normal(one.speed.size),
            )
        )
    return made


def test_smoothing_keeps_polynomials_of_its_order_and_takes_away_most_of_the_noise():
    times = np.arange(400) * 0.01
    smoothing = Smoothing(0.3, 5)
    exact = 1.0 - times + 0.3 * times**5
    assert smoothing.of(exact, 0.01) == pytest.approx(exact, abs=1e-9)
    noise = np.random.default_rng(1).standard_normal((400, 50))
    assert np.std(smoothing.of(noise, 0.01)) < 0.55
    short = noise[:20]
    assert smoothing.of(short, 0.01) is short


def test_draws_have_the_standard_deviation_and_the_time_constant_that_were_asked_for():
    given = records(count=2)
    windows = Windows(given)
    raw = Smoothing(0.0, 1)  # nothing is smoothed
    for constant in (0.0, SLOW):
        drawn = InputNoise("longitudinal_velocity", 0.2, constant, raw).drawn(windows, 400, 2)
        assert drawn.shape == (windows.times.size, 400)
        period = given[0].period
        assert np.std(drawn, axis=1) == pytest.approx(np.full(windows.times.size, 0.2), rel=0.25)
        first, last = windows.offsets[:2].tolist()
        lag = round(0.2 / period)
        product = np.mean(drawn[first : last - lag] * drawn[first + lag : last]) / 0.04
        assert product == pytest.approx(np.exp(-lag * period / constant) if constant else 0.0, abs=0.02)
        across = np.mean(drawn[last - 1] * drawn[last]) / 0.04
        assert across == pytest.approx(0.0, abs=0.15), "windows are drawn by themselves"


def rows_of(random: np.random.Generator, windows: int, responses: list[Array], draws: int) -> list[Array]:
    """Draws of each kind through a matrix (n, m) of its own."""
    return [
        np.hstack([one @ random.standard_normal((one.shape[1], draws)) for one in responses])
        for _ in range(windows)
    ]


def drawn_case(variances: tuple[float, float, float], seed: int, draws: int = 16):
    """Residuals that hold white noise and two kinds of noise of the inputs of known variances."""
    random = np.random.default_rng(seed)
    decay = np.exp(-np.arange(120) / 15.0)
    fast = np.array([np.roll(np.eye(120)[k], 0) for k in range(0, 120, 4)]).T
    responses = [
        np.apply_along_axis(lambda column: np.convolve(column, decay)[:120], 0, fast),
        np.cumsum(np.cumsum(np.random.default_rng(99).standard_normal((120, 6)), axis=0), axis=0) / 2000.0,
    ]
    rows = rows_of(random, 60, responses, draws)
    residuals = [
        np.sqrt(variances[0]) * random.standard_normal(120)
        + sum(
            np.sqrt(v) * (one @ random.standard_normal(one.shape[1]))
            for v, one in zip(variances[1:], responses, strict=True)
        )
        for _ in range(60)
    ]
    return DrawnNoise(np.repeat([1, 2], draws), rows), residuals, responses


VARIANCES = [(1.0, 0.0, 0.0), (0.9, 0.25, 0.0), (1.0, 0.1, 0.6), (1.0, 0.5, 0.3)]
TIME = np.linspace(-1.0, 1.0, 120)
DIRECTIONS = np.column_stack([np.ones(120), TIME, TIME**2, np.sin(9 * TIME), np.abs(TIME) < 0.1])


@pytest.mark.parametrize("variances", VARIANCES)
def test_scores_scatter_as_far_as_is_told_from_the_residuals(variances):
    told = []
    for seed in range(12):
        case, residuals, responses = drawn_case(variances, seed)
        told.append(case.colour([DIRECTIONS] * len(residuals), case.variances(residuals)))
    length = np.square(DIRECTIONS).sum(axis=0)
    responses = drawn_case(variances, 0)[2]
    exact = variances[0] + sum(
        v * np.square(DIRECTIONS.T @ one).sum(axis=1) / length
        for v, one in zip(variances[1:], responses, strict=True)
    )
    assert np.mean(told, axis=0) == pytest.approx(exact, rel=0.2)


def test_white_residuals_have_no_noise_of_the_inputs_in_them():
    found = np.array([case.variances(r) for case, r, _ in (drawn_case((1.0, 0, 0), s) for s in range(12))])
    assert found[:, 0] == pytest.approx(np.ones(12), abs=0.06)
    assert np.all(found[:, 1:] < 0.02)


def test_the_colour_of_a_direction_is_the_variance_of_its_score_over_that_of_white_noise():
    variances = (1.0, 0.3, 0.2)
    case, _, responses = drawn_case(variances, 5, draws=800)
    told = case.colour([DIRECTIONS] * 60, np.array(variances))
    length = np.square(DIRECTIONS).sum(axis=0)
    exact = 1.0 + sum(
        v * np.square(DIRECTIONS.T @ one).sum(axis=1) / length
        for v, one in zip(variances[1:], responses, strict=True)
    )
    assert told == pytest.approx(exact, rel=0.15)
    none = case.colour([np.zeros((120, 1))] * 60, np.array(variances))
    assert none == pytest.approx([1.0])


def test_a_few_residuals_that_are_no_noise_change_little():
    case, residuals, responses = drawn_case((1.0, 0.2, 0.0), 7)
    before = case.variances(residuals)
    residuals[11] = residuals[11] + 100.0 * responses[0][:, 3] / np.linalg.norm(responses[0][:, 3])
    after = case.variances(residuals)
    assert after[1] == pytest.approx(before[1], abs=0.1)


def test_the_noise_of_a_measured_speed_is_found_and_that_of_an_exact_angle_is_not():
    given = noisy()
    fit = layer_of(given).fitted()
    kinds = input_noise(given)
    case = fit.projection.of_input_noise(kinds)
    variances = case.variances(fit.projection.residuals())
    assert [one.name for one in kinds] == ["road_wheel_angle"] * 2 + ["longitudinal_velocity"] * 2
    period = given[0].period
    density = [one.std**2 * (2 * one.time_constant or period) for one in kinds]  # at low frequencies
    found = variances[1:] * density
    assert found[2] + found[3] == pytest.approx(0.03**2 * period, rel=0.5)
    assert found[0] + found[1] < 1e-9, "the angle is exact"


@pytest.mark.parametrize("constant", [0.0, SLOW])
def test_noise_is_no_larger_than_the_input_shows_above_the_motion(constant):
    given = []
    for number, one in enumerate(records(count=4, seconds=24.0)):
        random = np.random.default_rng(30 + number)
        pole = np.exp(-one.period / constant) if constant else 0.0
        noise = lfilter([np.sqrt(1 - pole**2)], [1, -pole], random.standard_normal(one.speed.size + 500))
        given.append(replace(one, speed=one.speed + 0.03 * noise[500:]))
    kind = next(
        one
        for one in input_noise(given)
        if one.name == "longitudinal_velocity" and one.time_constant == constant
    )
    assert kind.most * kind.std**2 == pytest.approx(0.03**2, rel=0.2)


def test_what_a_model_lacks_is_not_taken_for_noise_of_an_input_beyond_what_that_shows():
    case, residuals, responses = drawn_case((1.0, 0.1, 0.0), 9)
    random = np.random.default_rng(4)
    residuals = [one + 20.0 * random.standard_normal() * responses[0][:, 5] for one in residuals]
    assert case.variances(residuals)[1] > 1.0
    bound = replace(case, most=[0.15, 0.05]).variances(residuals)
    assert bound[1:] == pytest.approx([0.15, 0.05], rel=1e-3)


def test_smoothed_records_differ_in_their_inputs_alone():
    one = noisy(speed=0.05, angle=1e-3)[0]
    smooth = with_smooth_inputs(one)
    assert smooth.measured is one.measured
    true = records(count=1, seconds=24.0)[0]
    for name in INPUTS:
        left = np.std(getattr(smooth, name) - getattr(true, name))
        assert left < 0.6 * np.std(getattr(one, name) - getattr(true, name)), name
