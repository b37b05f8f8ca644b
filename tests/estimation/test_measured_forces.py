"""Curve and scale of measured axle forces, against forces that a known tyre and a known sensor made."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from ident.dynamics.tyres import axle_force
from ident.estimation.measured_forces import correlation_length, fit_curve, fit_scale
from ident.estimation.tyre_fit import Body

BODY = Body(1700.0, 1.3, 1.2)
COUNT, RUNS = 600, 2
TRUE = {"cornering_stiffness": 85e3, "peak_force": 7000.0}
OFFSETS = np.array([150.0, -80.0])
SCALE, NOISE, COLOUR = 1.06, 150.0, 0.9
RUN = np.repeat(np.arange(RUNS), COUNT).astype(np.intp)


def slip_angle() -> np.ndarray:
    time = np.linspace(0.0, 30.0, COUNT)
    return np.concatenate([0.12 * np.sin(0.9 * time), 0.05 * np.sin(0.5 * time) + 0.02])


def noise(seed: int) -> np.ndarray:
    """AR(1) of standard deviation NOISE, for each run by itself."""
    white = np.random.default_rng(seed).standard_normal((RUNS, COUNT + 200))
    return (NOISE * np.sqrt(1 - COLOUR**2) * lfilter([1.0], [1.0, -COLOUR], white, axis=1))[:, 200:].ravel()


def curve(kind: str = "brush", values: dict[str, float] | None = None) -> np.ndarray:
    return axle_force(kind, slip_angle(), values or TRUE)[0]


def test_without_noise_the_curve_that_made_the_forces_is_found() -> None:
    found = fit_curve("brush", "front", BODY, slip_angle(), curve() + OFFSETS[RUN], RUN, [60e3, 9000.0])
    assert np.exp(found.estimates) == pytest.approx(list(TRUE.values()), rel=1e-3)
    assert found.offsets == pytest.approx(OFFSETS, abs=2.0)


def test_without_noise_the_scale_is_found_apart_from_the_offsets() -> None:
    found = fit_scale(curve(), SCALE * curve() + OFFSETS[RUN], RUN)
    assert found.estimates == pytest.approx([SCALE], abs=1e-12)
    assert found.offsets == pytest.approx(OFFSETS, abs=1e-6)


@pytest.mark.parametrize("kind", ["linear", "piecewise_linear", "magic_formula"])
def test_every_kind_gives_the_stiffness_of_its_own_forces(kind: str) -> None:
    values = {
        "linear": {"cornering_stiffness": 85e3},
        "piecewise_linear": {"cornering_stiffness": 85e3, "saturation_slip": 0.07},
        "magic_formula": {
            "cornering_stiffness": 85e3,
            "peak_force": 7000.0,
            "shape": 1.35,
            "curvature": -0.5,
        },
    }[kind]
    forces = curve(kind, values) + np.random.default_rng(0).standard_normal(RUN.size)
    start = [value * 1.2 for value in values.values()]
    found = fit_curve(kind, "front", BODY, slip_angle(), forces, RUN, start)
    assert np.exp(found.estimates[0]) == pytest.approx(85e3, rel=0.01)


def test_intervals_hold_the_truth_as_often_as_they_say_under_coloured_noise() -> None:
    sets, inside = 120, {"scale": 0, "stiffness": 0}
    for seed in range(sets):
        left = noise(seed)
        scale = fit_scale(curve(), SCALE * curve() + left, RUN)
        fitted = fit_curve("brush", "front", BODY, slip_angle(), curve() + left, RUN, list(TRUE.values()))
        inside["scale"] += abs(scale.estimates[0] - SCALE) < scale.half_width(0)
        error = abs(fitted.estimates[0] - np.log(TRUE["cornering_stiffness"]))
        inside["stiffness"] += error < fitted.half_width(0)
    for count in inside.values():
        assert 0.88 * sets <= count < sets  # 95 % expected; 0.88 is 3.5 standard deviations below


def test_standard_errors_know_the_colour_of_the_noise() -> None:
    coloured = fit_scale(curve(), SCALE * curve() + noise(1), RUN)
    shuffled = np.random.default_rng(2).permutation(noise(1))
    white = fit_scale(curve(), SCALE * curve() + shuffled, RUN)
    expected = np.sqrt((1 + COLOUR) / (1 - COLOUR))  # of slow excitation under AR(1) noise
    assert 0.5 * expected < coloured.std(0) / white.std(0) < 1.5 * expected
    assert coloured.freedom < white.freedom / 3


def test_the_correlation_length_is_that_of_the_noise() -> None:
    assert correlation_length(noise(3), RUN) == pytest.approx(-1 / np.log(COLOUR), rel=0.4)
