"""The fit of the tyres starts near the truth, whatever was recorded, and never with nonsense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_runs import BODY, TRUTH, records, without

from ident.dynamics.tyres import TYRES
from ident.estimation.smooth_motion import smooth_motion
from ident.estimation.tyre_start import linear_start, tyre_starts
from ident.estimation.vehicle_records import MotionRecord, Samples

INERTIA = TRUTH.body.yaw_inertia
STIFFNESS = {
    axle: tyre.stiffness * tyre.shape * tyre.peak
    for axle, tyre in (("front", TRUTH.front), ("rear", TRUTH.rear))
}


@pytest.mark.parametrize("left_out", [(), ("lateral_velocity",), ("heading", "position_x")])
def test_stiffness_and_yaw_inertia_are_read_off_gentle_driving(left_out: tuple[str, ...]) -> None:
    found = linear_start(smooth_motion(without(records(), *left_out), BODY), BODY)
    assert set(found.from_data) == {"front", "rear", "yaw_inertia"}
    assert found.stiffness["front"] == pytest.approx(STIFFNESS["front"], rel=0.06)
    assert found.stiffness["rear"] == pytest.approx(STIFFNESS["rear"], rel=0.06)
    assert found.yaw_inertia == pytest.approx(INERTIA, rel=0.06)
    arms = BODY.cg_to_rear_axle / STIFFNESS["front"] - BODY.cg_to_front_axle / STIFFNESS["rear"]
    assert found.understeer_gradient == pytest.approx(BODY.mass / BODY.wheelbase * arms, abs=0.0008)


def test_a_stated_yaw_inertia_is_kept() -> None:
    found = linear_start(smooth_motion(records(), BODY), replace(BODY, yaw_inertia=60000.0))
    assert found.yaw_inertia == 60000.0


@pytest.mark.parametrize("kind", TYRES)
def test_every_kind_gets_its_parameters(kind: str) -> None:
    starts = tyre_starts(kind, records(), BODY)
    names = {f"{axle}.{name}" for axle in ("front", "rear") for name in TYRES[kind].names}
    assert len(starts) >= 5
    for start in starts:
        assert set(start) == names | {"yaw_inertia", "steering_offset"}
        assert all(np.isfinite(value) for value in start.values())
        for axle in ("front", "rear"):
            for parameter in TYRES[kind].parameters:
                value = start[f"{axle}.{parameter.name}"]
                assert parameter.low <= value <= parameter.high
    apart = {round(start["front.cornering_stiffness"], -3) for start in starts}
    assert len(apart) >= 4


def test_the_curve_starts_near_that_of_the_truck() -> None:
    first = tyre_starts("magic_formula", records(), BODY)[0]
    for axle in ("front", "rear"):
        tyre = getattr(TRUTH, axle)
        assert first[f"{axle}.cornering_stiffness"] == pytest.approx(STIFFNESS[axle], rel=0.06)
        assert first[f"{axle}.peak_force"] == pytest.approx(tyre.peak, rel=0.2)


@pytest.mark.parametrize("kind", ["piecewise_linear", "magic_formula", "brush"])
def test_no_start_has_less_force_than_was_driven(kind: str) -> None:
    driven = BODY.mass * 4.0 * BODY.cg_to_front_axle / BODY.wheelbase  # at 4 m/s², the rear axle
    for start in tyre_starts(kind, records(), BODY):
        peak = start.get("rear.peak_force")
        if peak is None:
            peak = start["rear.cornering_stiffness"] * start["rear.saturation_slip"]
        assert peak > 0.8 * driven


@pytest.mark.parametrize("kind", TYRES)
def test_straight_driving_starts_with_usual_values(kind: str) -> None:
    times = np.arange(0.0, 20.0, 0.01)
    rng = np.random.default_rng(2)
    noise = {
        name: Samples(times, std * rng.standard_normal(times.size))
        for name, std in (("yaw_rate", 1e-3), ("lateral_acceleration", 0.05), ("lateral_velocity", 0.02))
    }
    record = MotionRecord(0, times, 1e-5 * rng.standard_normal(times.size), np.full(times.size, 15.0), noise)
    for start in tyre_starts(kind, [record], BODY):
        for axle in ("front", "rear"):
            assert 2.0 < start[f"{axle}.cornering_stiffness"] / BODY.load(axle) < 40.0
        assert 0.3 < start["yaw_inertia"] / (BODY.mass * 2.38 * 2.12) < 3.0


@pytest.mark.parametrize("kind", TYRES)
def test_a_record_without_any_signal_starts_with_usual_values(kind: str) -> None:
    (record,) = records()
    starts = tyre_starts(kind, [replace(record, measured={})], BODY)
    assert starts[0]["front.cornering_stiffness"] == pytest.approx(8 * BODY.load("front"))
    assert starts[0]["yaw_inertia"] == pytest.approx(BODY.mass * 2.38 * 2.12)


def test_a_turned_sign_of_the_steering_gives_no_negative_stiffness() -> None:
    (record,) = records()
    turned = replace(record, road_wheel_angle=-record.road_wheel_angle)
    for start in tyre_starts("magic_formula", [turned], BODY):
        assert start["front.cornering_stiffness"] > 0
        assert start["rear.cornering_stiffness"] > 0


def test_the_start_of_the_two_track_truck_is_physical() -> None:
    first = tyre_starts("magic_formula", records("manual_a"), BODY)[0]
    assert first["front.cornering_stiffness"] == pytest.approx(3.3e5, rel=0.1)
    assert first["rear.cornering_stiffness"] == pytest.approx(4.1e5, rel=0.1)
    assert first["yaw_inertia"] == pytest.approx(INERTIA, rel=0.05)
