"""The two-track model from the vehicle file, through its fit, to what is evaluated and told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from plane_truck import IMU, REFERENCE_X
from two_track_written_out import accelerations, in_numbers

from ident.dynamics.axle_groups import AxleGroup
from ident.dynamics.two_track import FRONT, REAR, TANDEM
from ident.dynamics.tyres import tyre_of
from ident.errors import NotIdentifiable
from ident.estimation.tyre_fit import Axles
from ident.estimation.vehicle_records import MotionRecord
from ident.report.html import render
from ident.report.pages.evaluate import evaluate_page
from ident.report.pages.tyres import tyres_page
from ident.report.summary import describe_evaluate
from ident.results import Estimate, FixedValue, TwoTrackFit, TyresResult
from ident.stages import two_track_model
from ident.stages.evaluate import evaluate
from ident.stages.evaluate_settings import EvaluateSettings
from ident.stages.inputs import InputSettings, SplitSettings
from ident.stages.output import Context, StageOutput
from ident.stages.two_track_model import chassis_of, groups_of, two_track_candidate, two_track_fit
from ident.stages.tyre_settings import TyresSettings
from ident.stages.tyres import tyres
from ident.vehicle import AxlesOfGroup, Vehicle

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
VEHICLE = Vehicle(track=2.05, cg_height=1.3)
LINEAR = dict.fromkeys(("front", "rear"), tyre_of("linear"))
CONTEXT = Context(command="test", date="2026-01-01T00:00:00Z")
HELD_OUT = SplitSettings(held_out=["manual_c"])
RUNS = [SAMPLES / "manual_b", SAMPLES / "manual_c"]


def known(value: float, unit: str = "1") -> Estimate:
    return Estimate(value, 0.01 * value, 0.98 * value, 1.02 * value, unit)


def fit_of(vehicle: Vehicle) -> TwoTrackFit:
    groups = groups_of(vehicle)
    return TwoTrackFit(
        kind="linear",
        axles={group.name: group.axles for group in groups},
        lifted={group.name: group.lifted + 1 for group in groups if group.lifted is not None},
        chassis=chassis_of(vehicle, LINEAR, groups),
        front={"cornering_stiffness": known(3.3e5)},
        rear={"cornering_stiffness": known(4e5)},
        yaw_inertia=known(52e3),
        steering_offset=0.004,
        rms={},
        criterion_gain=12.0,
        converged=True,
    )


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> TyresResult:
    """Only what the model is made of; equations stand in for the compiled model, which has the same names."""
    monkeypatch.setattr(two_track_model, "compiled", lambda system: system)
    result = object.__new__(TyresResult)
    fixed = {"mass": 12500.0, "cg_to_front_axle": 2.38, "cg_to_rear_axle": 2.12}
    stated = {name: FixedValue(value, None, "", "vehicle file") for name, value in fixed.items()}
    for name, value in {"fixed": stated, "property_files": []}.items():
        object.__setattr__(result, name, value)
    return result


def test_it_moves_as_the_equations_written_out_with_these_values(fitted: TyresResult) -> None:
    candidate = two_track_candidate(fitted, fit_of(VEHICLE))
    none = np.zeros(4)
    record = MotionRecord(0, none, none, none, {}, reference_x=REFERENCE_X, imu=IMU)
    names = candidate.engine.parameters
    values = dict(zip(names, candidate.vectors([record])[0].tolist(), strict=True))
    state = {"lateral_velocity": -0.3, "yaw_rate": 0.2, "heading": 0.0, "position_x": 0.0, "position_y": 0.0}
    inputs = {"road_wheel_angle": 0.05, "longitudinal_velocity": 13.0}
    found = in_numbers(candidate.engine)(values | state | inputs)  # type: ignore[arg-type]
    curves = {"front": lambda slip: 3.3e5 * slip, "rear": lambda slip: 4e5 * slip}
    felt, turning = accelerations([-0.3, 0.2], 0.054, 13.0, values, curves)
    assert found["d.yaw_rate"] == pytest.approx(turning, rel=1e-9)
    assert found["d.lateral_velocity"] == pytest.approx(felt - 13.0 * 0.2, rel=1e-9)


def test_what_nobody_states_is_assumed_and_said_so() -> None:
    assert groups_of(VEHICLE) == (FRONT, REAR)
    made = chassis_of(VEHICLE, LINEAR, (FRONT, REAR))
    assert {name: (one.value, one.source) for name, one in made.items()} == {
        "front_track": (2.05, "vehicle file"),
        "rear_track": (2.05, "vehicle file"),
        "cg_height": (1.3, "vehicle file"),
        "front_roll_share": (0.4, "assumed"),
        "ackermann_share": (0.8, "assumed"),
        "load_sensitivity": (0.3, "assumed"),
    }


def test_what_the_vehicle_file_states_is_taken(fitted: TyresResult) -> None:
    stated = replace(
        VEHICLE,
        front_roll_share=0.55,
        ackermann_share=0.0,
        load_sensitivity=0.1,
        axles={"rear": AxlesOfGroup(3, 1.31, 1.83, lifted=1)},
        std={"front_roll_share": 0.05},
    )
    groups = groups_of(stated)
    assert groups == (FRONT, AxleGroup("rear", 3, lifted=0))
    made = chassis_of(stated, LINEAR, groups)
    assert {one.source for one in made.values()} == {"vehicle file"}
    assert made["front_roll_share"].std == 0.05
    candidate = two_track_candidate(fitted, fit_of(stated))
    wanted = {"front_track": 2.05, "rear_track": 1.83, "rear_spacing": 1.31, "rear_lift": 1.0}
    wanted |= {"ackermann_share": 0.0, "load_sensitivity": 0.1, "steering_offset": 0.004}
    assert wanted.items() <= candidate.parameters.items()
    assert candidate.engine.name == "two_track_linear_1_linear_3"  # type: ignore[attr-defined]


def test_the_groups_of_the_vehicle_file_are_those_of_the_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {}

    def none(found: object, chassis: dict[str, float], *, groups: object, floor: object) -> None:
        asked.update(chassis, groups=groups)
        raise ValueError("the model blows up")

    monkeypatch.setattr(two_track_model, "fit_two_track", none)
    tandem = replace(VEHICLE, axles={"rear": AxlesOfGroup(2, 1.35)})
    data = SimpleNamespace(vehicle=tandem, floor=None)
    found = {"linear": SimpleNamespace(axles=Axles(LINEAR["front"], LINEAR["rear"]))}
    with pytest.raises(NotIdentifiable, match="the model blows up"):
        two_track_fit(data, found, "linear")  # type: ignore[arg-type]
    assert asked["groups"] == (FRONT, TANDEM)
    assert (asked["rear_spacing"], asked["rear_track"]) == (1.35, 2.05)


@pytest.mark.parametrize(
    ("lacking", "told"),
    [
        ({"track": None}, "states no track: add track to vehicle.yaml"),
        ({"cg_height": None}, "states no cg_height: add"),
        ({"track": None, "cg_height": None}, "states no track and cg_height: add"),
    ],
)
def test_a_vehicle_file_without_track_or_height_is_refused(lacking: dict[str, None], told: str) -> None:
    with pytest.raises(NotIdentifiable, match=told):
        chassis_of(replace(VEHICLE, **lacking), LINEAR, (FRONT, REAR))  # type: ignore[arg-type]


# --- on runs of the sample truck, which has two tracks -------------------------------------------------


def inputs(vehicle: Path = SAMPLES / "vehicle.yaml") -> InputSettings:
    return InputSettings(vehicle=vehicle, channels=str(SAMPLES / "channels.yaml"), split=HELD_OUT)


@pytest.fixture(scope="module")
def stage() -> StageOutput[TyresResult]:
    return tyres(RUNS, inputs(), TyresSettings(kinds=["linear"]), CONTEXT)


def test_its_tyres_are_stiffer_at_rest_than_those_of_the_bicycle(stage: StageOutput[TyresResult]) -> None:
    """The truck's tyres lose stiffness to the moving load, which a bicycle takes for softer tyres."""
    own, bicycle = stage.result.two_track, stage.result.fits[0]
    assert own is not None
    assert own.converged
    for axle in ("front", "rear"):
        two, one = (getattr(fit, axle)["cornering_stiffness"] for fit in (own, bicycle))
        assert two.value > one.value
    assert own.criterion_gain > 10.0
    assert not [one for one in stage.result.refused if one.what == "two_track"]


def test_it_is_ranked_beside_the_bicycle_with_its_cost(stage: StageOutput[TyresResult]) -> None:
    found = evaluate(RUNS, inputs(), EvaluateSettings(), CONTEXT, tyres=stage.result)
    result = found.result
    by_name = {one.name: one for one in result.models}
    assert set(by_name) == {"kinematic", "linear", "two_track"}
    assert by_name["two_track"].rms["yaw_rate"].value < by_name["linear"].rms["yaw_rate"].value
    (ratio,) = result.cost_ratios
    cost = {name: one.cost_ns_per_step for name, one in by_name.items()}
    assert (ratio.model, ratio.over, ratio.reported) == ("two_track", "linear", None)
    assert ratio.ratio == cost["two_track"] / cost["linear"]
    assert 1.1 < ratio.ratio < 20.0
    assert "takes 4 wheels" in ratio.reason
    assert result.two_track == (
        "two-track: linear tyres fitted again for it; vehicle file: cg height 1.1 m, front track 2 m, rear "
        "track 2 m; assumed: front roll share 0.4, ackermann share 0.8, load sensitivity 0.3"
    )
    assert "two-track costs" in describe_evaluate(result)
    page = render([evaluate_page(result, found.tables)])
    assert "two-track: linear tyres fitted again for it" in page
    assert {one.what for one in result.refused} >= {"brush", "magic_formula"}
    assert "two_track" not in {one.what for one in result.refused}


def test_the_page_of_the_tyres_shows_what_was_assumed(stage: StageOutput[TyresResult]) -> None:
    page = render([tyres_page(stage.result, stage.tables)])
    assert "linear tyres, fitted again on two tracks, to the same windows" in page
    assert "load sensitivity" in page
