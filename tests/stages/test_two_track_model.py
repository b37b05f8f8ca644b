"""The two-track model made from the results of the tyre stage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_truck import IMU, REFERENCE_X
from two_track_written_out import accelerations, in_numbers

from ident.dynamics.two_track import FRONT, TANDEM
from ident.errors import NotIdentifiable
from ident.estimation.vehicle_records import MotionRecord
from ident.results import EffectEstimate, Estimate, FixedValue, TyreFit, TyresResult
from ident.stages import two_track_model
from ident.stages.two_track_model import two_track_candidate
from ident.vehicle import Vehicle

VEHICLE = Vehicle(track=2.05, cg_height=1.3)


def known(value: float, unit: str = "1") -> Estimate:
    return Estimate(value, 0.01 * value, 0.98 * value, 1.02 * value, unit)


def fit_of(kind: str) -> TyreFit:
    fit = object.__new__(TyreFit)
    axles = {"front": {"cornering_stiffness": known(3.3e5)}, "rear": {"cornering_stiffness": known(4e5)}}
    for name, value in {"kind": kind, "yaw_inertia": known(52e3), **axles}.items():
        object.__setattr__(fit, name, value)
    return fit


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> TyresResult:
    """Only what the model is made of; equations stand in for the compiled model, which has the same names."""
    monkeypatch.setattr(two_track_model, "compiled", lambda system: system)
    result = object.__new__(TyresResult)
    fixed = {"mass": 12500.0, "cg_to_front_axle": 2.38, "cg_to_rear_axle": 2.12}
    offset = EffectEstimate("steering_offset", "G", {"angle": known(0.004, "rad")})
    parts = {
        "fits": [fit_of("linear")],
        "chosen": "linear",
        "fixed": {name: FixedValue(value, None, "", "vehicle file") for name, value in fixed.items()},
        "nuisance": [offset],
        "property_files": [],
    }
    for name, value in parts.items():
        object.__setattr__(result, name, value)
    return result


def test_it_moves_as_the_equations_written_out_with_these_values(fitted: TyresResult) -> None:
    candidate, assumed = two_track_candidate(fitted, VEHICLE)
    none = np.zeros(4)
    record = MotionRecord(0, none, none, none, {}, reference_x=REFERENCE_X, imu=IMU)
    names = candidate.engine.parameters
    values = dict(zip(names, candidate.vectors([record])[0].tolist(), strict=True))
    state = {"lateral_velocity": -0.3, "yaw_rate": 0.2, "heading": 0.0, "position_x": 0.0, "position_y": 0.0}
    inputs = {"road_wheel_angle": 0.05, "longitudinal_velocity": 13.0}
    found = in_numbers(candidate.engine)(values | state | inputs)
    curves = {"front": lambda slip: 3.3e5 * slip, "rear": lambda slip: 4e5 * slip}
    felt, turning = accelerations([-0.3, 0.2], 0.054, 13.0, values, curves)
    assert found["d.yaw_rate"] == pytest.approx(turning, rel=1e-9)
    assert found["d.lateral_velocity"] == pytest.approx(felt - 13.0 * 0.2, rel=1e-9)
    assert values["front_track"] == values["rear_track"] == 2.05
    assert [one.split(" 0.")[0] for one in assumed] == [
        "front roll share",
        "ackermann share",
        "load sensitivity",
    ]


def test_what_is_given_is_not_assumed(fitted: TyresResult) -> None:
    given = {"front_roll_share": 0.55, "rear_spacing": 1.31, "load_sensitivity": 0.1, "ackermann_share": 1.0}
    candidate, assumed = two_track_candidate(fitted, VEHICLE, groups=(FRONT, TANDEM), given=given)
    assert assumed == []
    assert given.items() <= candidate.parameters.items()
    with pytest.raises(ValueError, match="has no rear_lift"):
        two_track_candidate(fitted, VEHICLE, given={"rear_lift": 1.0})


@pytest.mark.parametrize(
    ("lacking", "told"),
    [
        ({"track": None}, "states no track: add track to vehicle.yaml"),
        ({"cg_height": None}, "states no cg_height: add"),
        ({"track": None, "cg_height": None}, "states no track and cg_height: add"),
    ],
)
def test_a_vehicle_file_without_track_or_height_is_refused(
    fitted: TyresResult, lacking: dict[str, None], told: str
) -> None:
    with pytest.raises(NotIdentifiable, match=told):
        two_track_candidate(fitted, replace(VEHICLE, **lacking))


def test_tyres_that_were_not_fitted_are_refused(fitted: TyresResult) -> None:
    with pytest.raises(NotIdentifiable, match="pac2002 tyres were not fitted, need linear: add"):
        two_track_candidate(fitted, VEHICLE, kind="pac2002")
