"""A vehicle with two tracks, written out by hand, found again by the fit of the two-track model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from plane_truck import BODY, INERTIA, NOISE
from two_track_drive import CHASSIS, START, STIFFNESS, driven

from ident.estimation.two_track_fit import fit_two_track
from ident.estimation.tyre_fit import KindFit, fit_tyres


@pytest.fixture(scope="module")
def bicycle() -> KindFit:
    records = [driven(seed, run=seed) for seed in (0, 1)]
    return fit_tyres(records, "linear", BODY, [START], bank=False, misaligned=False)


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
