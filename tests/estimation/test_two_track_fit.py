"""A vehicle with two tracks, written out by hand, found again by the fit of the two-track model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from plane_truck import BODY, INERTIA, NOISE, STEP, inputs, linear
from two_track_written_out import accelerations

from ident.estimation.two_track_fit import fit_two_track
from ident.estimation.tyre_fit import KindFit, fit_tyres
from ident.estimation.vehicle_records import MotionRecord, Samples

Array = NDArray[np.float64]

CHASSIS = {
    "cg_height": 1.5,
    "front_roll_share": 0.7,
    "ackermann_share": 0.8,
    "load_sensitivity": 0.35,
    "front_track": 1.9,
    "rear_track": 1.9,
}
STIFFNESS = {"front.cornering_stiffness": 3.3e5, "rear.cornering_stiffness": 4.0e5}
TRUTH = CHASSIS | {
    "mass": BODY.mass,
    "yaw_inertia": INERTIA,
    "cg_to_front_axle": BODY.cg_to_front_axle,
    "cg_to_rear_axle": BODY.cg_to_rear_axle,
}
CURVES = {axle: linear(STIFFNESS[f"{axle}.cornering_stiffness"]) for axle in ("front", "rear")}


def driven(seed: int, seconds: float = 20.0) -> MotionRecord:
    """Sensors at the CG, their noise white; two Heun steps a sample, which is exact to a hundredth of it."""
    angle, speed = inputs(seconds, most=0.075, seed=seed)
    angle[:100] *= np.linspace(0, 1, 100)
    state, rows = np.zeros(2), []

    def rates(at: Array, k: float) -> Array:
        delta, along = (np.interp(k, np.arange(angle.size), each) for each in (angle, speed))
        felt, turning = accelerations(at.tolist(), float(delta), float(along), TRUTH, CURVES)
        return np.array([felt - along * at[1], turning, felt])

    for k in range(angle.size):
        rows.append([*state, rates(state, k)[2]])
        for half in (0.0, 0.5):
            first = rates(state, k + half)[:2]
            ahead = state + STEP / 2 * first
            state = state + STEP / 4 * (first + rates(ahead, k + half + 0.5)[:2])
    times = STEP * np.arange(angle.size)
    random = np.random.default_rng(seed)
    read = dict(zip(("lateral_velocity", "yaw_rate", "lateral_acceleration"), np.array(rows).T, strict=True))
    measured = {n: Samples(times, v + NOISE[n] * random.standard_normal(v.size)) for n, v in read.items()}
    return MotionRecord(seed, times, angle, speed, measured)


@pytest.fixture(scope="module")
def bicycle() -> KindFit:
    start = STIFFNESS | {"yaw_inertia": INERTIA, "steering_offset": 0.0}
    return fit_tyres([driven(0), driven(1)], "linear", BODY, [start], bank=False, misaligned=False)


def errors(found: KindFit) -> dict[str, float]:
    """Estimate less truth, in standard errors of the fit."""
    spread = np.sqrt(np.diag(found.fit.covariance))
    return {
        name: (float(found.fit.shared[k]) - math.log(STIFFNESS.get(name, INERTIA))) / float(spread[k])
        for k, name in enumerate(found.names)
        if name in {*STIFFNESS, "yaw_inertia"}
    }


def test_stiffness_of_tyres_under_moving_loads_is_found_where_a_bicycle_is_wrong(bicycle: KindFit) -> None:
    two = fit_two_track(bicycle, CHASSIS)
    assert np.ptp(two.problem.windows.inputs[:, 0]) > 0.12
    assert max(map(abs, errors(two).values())) < 3.5
    assert max(map(abs, errors(bicycle).values())) > 6.0
    assert two.fit.log_likelihood > bicycle.fit.log_likelihood + 20.0
    assert not two.fit.is_coloured
    rms = two.fit.rms()
    for name in ("yaw_rate", "lateral_acceleration", "lateral_velocity"):
        assert rms[name] == pytest.approx(NOISE[name], rel=0.05)


def test_what_the_chassis_lacks_is_named(bicycle: KindFit) -> None:
    with pytest.raises(ValueError, match="needs cg_height, rear_track"):
        fit_two_track(bicycle, {n: v for n, v in CHASSIS.items() if n not in {"cg_height", "rear_track"}})
