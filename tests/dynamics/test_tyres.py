"""Axle forces: their limits, their shape, and the relations that the source gives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from vehicle_values import KINDS
from vehicle_values import TYRES as VALUES

from ident.dynamics.tyres import TYRES, axle_force, evaluate
from ident.dynamics.tyres.magic_formula import (
    curvature_from_peak_slip,
    from_bcde,
    shape_from_sliding_force,
    to_bcde,
)

SLIP = np.linspace(-0.3, 0.3, 401)
EVERY = pytest.mark.parametrize("kind", KINDS)


def test_every_kind_has_values_here() -> None:
    assert set(KINDS) == set(TYRES)
    assert all(set(VALUES[kind]) == set(tyre.names) for kind, tyre in TYRES.items())


@EVERY
def test_the_slope_at_zero_slip_is_the_cornering_stiffness(kind: str) -> None:
    force, slope, _ = evaluate(TYRES[kind], np.array([0.0]), VALUES[kind])
    assert force[0] == 0.0
    assert slope[0] == pytest.approx(VALUES[kind]["cornering_stiffness"], rel=1e-14)


@EVERY
def test_a_mirrored_slip_angle_gives_the_mirrored_force(kind: str) -> None:
    force, _ = axle_force(kind, SLIP, VALUES[kind])
    mirrored, _ = axle_force(kind, -SLIP, VALUES[kind])
    assert np.max(np.abs(force + mirrored)) <= 1e-11 * np.max(np.abs(force))


@EVERY
def test_the_gradient_is_that_of_the_force(kind: str) -> None:
    _, derivative = axle_force(kind, SLIP, VALUES[kind])
    for column, name in enumerate(TYRES[kind].names):
        step = 1e-5 * abs(VALUES[kind][name])
        above, below = (
            axle_force(kind, SLIP, VALUES[kind] | {name: VALUES[kind][name] + sign * step})[0]
            for sign in (1, -1)
        )
        numeric = (above - below) / (2 * step)
        kink = np.abs(np.abs(SLIP) - VALUES[kind].get("saturation_slip", 9.0)) < 1e-5
        assert derivative[~kink, column] == pytest.approx(
            numeric[~kink], rel=1e-6, abs=1e-8 * np.max(np.abs(numeric))
        )


@EVERY
def test_typical_values_lie_inside_the_bounds(kind: str) -> None:
    for parameter in TYRES[kind].parameters:
        assert parameter.low < parameter.typical < parameter.high


def test_piecewise_linear_is_continuous_and_ends_at_stiffness_times_slip() -> None:
    values = VALUES["piecewise_linear"]
    edge = values["saturation_slip"]
    slips = np.array([edge * (1 - 1e-12), edge, edge * (1 + 1e-12), 1.0])
    force, _ = axle_force("piecewise_linear", slips, values)
    assert force == pytest.approx(values["cornering_stiffness"] * edge, rel=1e-11)


def test_the_magic_formula_is_that_of_the_source() -> None:
    b, c, d, e = 5.4, 1.35, 45000.0, -0.4
    force, _ = axle_force("magic_formula", SLIP, from_bcde(b, c, d, e))
    bent = b * SLIP - e * (b * SLIP - np.arctan(b * SLIP))
    assert force == pytest.approx(d * np.sin(c * np.arctan(bent)), rel=1e-12, abs=1e-9)
    assert to_bcde(**from_bcde(b, c, d, e)) == pytest.approx((b, c, d, e), rel=1e-14)


def test_the_magic_formula_peaks_where_the_source_says() -> None:
    b, c, d, peak_slip = 9.0, 1.4, 3e4, 0.25
    values = from_bcde(b, c, d, curvature_from_peak_slip(b, c, peak_slip))
    force, slope, _ = evaluate(TYRES["magic_formula"], np.array([peak_slip]), values)
    assert force[0] == pytest.approx(d, rel=1e-12)
    assert abs(slope[0]) < 1e-8 * values["cornering_stiffness"]


def test_the_magic_formula_slides_with_the_force_that_gave_its_shape() -> None:
    c = shape_from_sliding_force(0.8 * 3e4, 3e4)
    force, _ = axle_force("magic_formula", np.array([1e9]), from_bcde(9.0, c, 3e4, 0.0))
    assert force[0] == pytest.approx(0.8 * 3e4, rel=1e-6)
    assert 1.0 < c < 2.0


@pytest.mark.parametrize("sliding", [-1.0, 3.1e4])
def test_refuses_a_sliding_force_beyond_the_peak(sliding: float) -> None:
    with pytest.raises(ValueError, match="sliding force"):
        shape_from_sliding_force(sliding, 3e4)


def test_refuses_a_peak_slip_without_a_peak() -> None:
    with pytest.raises(ValueError, match="need above 1"):
        curvature_from_peak_slip(9.0, 0.9, 0.2)


def test_the_brush_reaches_its_peak_with_zero_slope_and_stays_there() -> None:
    stiffness, peak = 3.3e5, 2e4
    edge = math.atan(3 * peak / stiffness)
    slips = np.array([edge * (1 - 1e-7), edge, edge * 1.5, 1.2])
    force, slope, _ = evaluate(TYRES["brush"], slips, {"cornering_stiffness": stiffness, "peak_force": peak})
    assert force == pytest.approx(peak, rel=1e-12)
    assert np.max(np.abs(slope)) < 1e-6 * stiffness


def test_the_brush_is_the_parabolic_one() -> None:
    stiffness, peak = 3.3e5, 2e4
    slips = np.linspace(0.0, 0.17, 50)
    z = stiffness * np.tan(slips) / (3 * peak)
    force, _ = axle_force("brush", slips, {"cornering_stiffness": stiffness, "peak_force": peak})
    assert force == pytest.approx(peak * (1 - (1 - z) ** 3), rel=1e-12)
