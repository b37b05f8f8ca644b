"""Figures of handling of a simulated truck and of models of it, side by side."""

from __future__ import annotations

import numpy as np
import pytest
from plane_truck import BODY, INERTIA, STEP, PlaneTruck, linear

from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import compiled
from ident.dynamics.kinematic import kinematic
from ident.estimation.evaluation import Candidate, Prediction, Segments, predict, whole
from ident.results import Characteristic
from ident.stages.evaluate_characteristics import characteristics

FRONT, REAR = 330e3, 417e3
GRADIENT = BODY.mass / BODY.wheelbase * (BODY.cg_to_rear_axle / FRONT - BODY.cg_to_front_axle / REAR)
KNOWN = {
    "mass": BODY.mass,
    "yaw_inertia": INERTIA,
    "cg_to_front_axle": BODY.cg_to_front_axle,
    "cg_to_rear_axle": BODY.cg_to_rear_axle,
    "bank_cos": 0.0,
    "bank_sin": 0.0,
    "steering_offset": 0.0,
}


def driving() -> tuple[np.ndarray, np.ndarray]:
    """Slow ramps, then lively steering, then steps, at 12 m/s."""
    times = STEP * np.arange(round(150 / STEP) + 1)
    slow = 0.035 * np.sin(2 * np.pi * 0.05 * times) * (times < 80)
    random = np.random.default_rng(3)
    lines = np.arange(0.05, 1.4, 0.04)
    lively = 0.003 * np.sin(2 * np.pi * lines * times[:, None] + random.uniform(0, 6.28, lines.size)).sum(1)
    lively *= (times >= 80) & (times < 125)
    steps = np.interp(times, [130, 130.2, 136, 136.2, 142, 142.2], [0, 0.02, 0.02, 0, 0, -0.02])
    return slow + lively + steps, np.full(times.size, 12.0)


def linear_model(front: float, rear: float) -> Candidate:
    engine = compiled(bicycle("linear", "linear"))
    tyres = {"front.cornering_stiffness": front, "rear.cornering_stiffness": rear}
    return Candidate("linear", engine, {**KNOWN, **tyres})


@pytest.fixture(scope="module")
def segments() -> Segments:
    record = PlaneTruck(linear(FRONT), linear(REAR)).drive(*driving(), seed=8)
    return whole([record], BODY.cg_to_rear_axle)


@pytest.fixture(scope="module")
def predictions(segments: Segments) -> dict[str, Prediction]:
    models = {
        "linear": linear_model(FRONT, REAR),
        "soft_front": linear_model(0.6 * FRONT, REAR),
        "kinematic": Candidate("kinematic", compiled(kinematic()), KNOWN),
    }
    return {name: predict(model, segments) for name, model in models.items()}


@pytest.fixture(scope="module")
def found(segments: Segments, predictions: dict[str, Prediction]) -> dict[str, Characteristic]:
    return {one.name: one for one in characteristics(segments, predictions, BODY, 0.1)}


def test_the_true_model_is_within_the_tolerance_in_every_figure(found: dict[str, Characteristic]) -> None:
    told = {name: one.within["linear"] for name, one in found.items() if "linear" in one.within}
    assert all(told.values())
    for start in ("understeer", "steady yaw-rate gain", "yaw rate gain", "lateral acceleration phase"):
        assert any(name.startswith(start) for name in told)
    assert "response time of the yaw rate to steps" in told


def test_measured_and_simulated_are_close_to_the_closed_form(found: dict[str, Characteristic]) -> None:
    one = found["understeer gradient"]
    assert one.style == "ISO 14792"
    assert one.measured.value == pytest.approx(GRADIENT, rel=0.04)
    assert one.simulated["linear"].value == pytest.approx(GRADIENT, rel=0.02)
    soft = BODY.mass / BODY.wheelbase * (BODY.cg_to_rear_axle / (0.6 * FRONT) - BODY.cg_to_front_axle / REAR)
    assert one.simulated["soft_front"].value == pytest.approx(soft, rel=0.02)
    assert one.simulated["kinematic"].value == pytest.approx(0.0, abs=2e-5)


def test_wrong_models_are_outside(found: dict[str, Characteristic]) -> None:
    assert found["understeer gradient"].within["soft_front"] is False
    assert found["understeer gradient"].within["kinematic"] is False
    phase = next(one for name, one in found.items() if name.startswith("yaw rate phase at 1 Hz"))
    assert phase.style == "ISO 14793"
    assert phase.within["kinematic"] is False


def test_a_wide_tolerance_lets_a_wrong_model_in(
    segments: Segments, predictions: dict[str, Prediction]
) -> None:
    own = characteristics(segments, predictions, BODY, {"understeer": 20.0})
    by_name = {one.name: one for one in own}
    assert by_name["understeer gradient"].within["soft_front"] is True
    assert by_name["understeer gradient"].tolerance == 20.0
    assert {one.tolerance for name, one in by_name.items() if "understeer" not in name} == {0.1}


def test_a_figure_that_was_not_driven_is_left_open_with_its_reason(
    found: dict[str, Characteristic],
) -> None:
    one = found["end of the linear range"]
    assert one.measured.value is None
    assert one.measured.reason
    assert one.within == {}


def test_nothing_is_called_compliant(found: dict[str, Characteristic]) -> None:
    assert "complian" not in repr(found).lower()


def test_without_a_turning_signal_there_are_no_figures(segments: Segments) -> None:
    (record,) = segments.records
    kept = {"position_x": record.measured["position_x"]}
    bare = Segments(
        [type(record)(0, record.times, record.road_wheel_angle, record.speed, kept)], segments.states
    )
    assert characteristics(bare, {}, BODY) == []
