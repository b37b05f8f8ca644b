"""Every check before an evaluation fires on what it is for, and stays quiet on good data."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import tyre_case
from motion_runs import changed, truck_run, with_signals

from ident.experiments.motion import MotionRun, MotionSettings, motion_run
from ident.results import Check, FixedValue, Provenance, TyreRun, TyresResult
from ident.signals.signal import Run, Signal
from ident.stages.evaluate_checks import ECHOED, HELD_OUT, PARAMETERS, POINT, SIGNS, checks

NAMES = ["planar/planar_a", "planar/planar_b", "planar/planar_c"]


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    return [truck_run(name) for name in NAMES]


def motion_of(runs: Sequence[Run]) -> list[MotionRun]:
    found = [motion_run(run, settings=MotionSettings(window=1e6)) for run in runs]
    assert all(isinstance(one, MotionRun) for one in found)
    return found


@pytest.fixture(scope="module")
def tyres(runs: list[Run]) -> TyresResult:
    made = tyre_case.build_result(tyre_case.build_tables(), Provenance("0", "", 0, ""), [])
    vehicle = runs[0].vehicle
    fixed = {
        name: FixedValue(getattr(vehicle, name), None, unit, "vehicle file")
        for name, unit in (("mass", "kg"), ("cg_to_front_axle", "m"), ("cg_to_rear_axle", "m"))
    }
    fixed["steering_ratio"] = FixedValue(vehicle.steering_ratio, None, "1", "vehicle file")
    used = [
        TyreRun(name, 6, 60.0, [8, 15], [-4, 4], {}, reference_x=-vehicle.cg_to_rear_axle)
        for name in ("manual_a", "manual_b [0, 40] s")
    ]
    return replace(made, fixed=fixed, by_run=used)


def made(runs: Sequence[Run], tyres: TyresResult, **how) -> dict[str, list[Check]]:
    vehicle = how.get("vehicle", runs[0].vehicle)
    found = checks(runs, motion_of(runs), tyres, vehicle, how.get("held_out", NAMES))
    told: dict[str, list[Check]] = {}
    for one in found:
        told.setdefault(one.what, []).append(one)
    return told


def with_request(run: Run, lag: float) -> Run:
    """The run with a request that its steering wheel follows some time later; an echo for lag 0."""
    angle = run.signals["steering_wheel_angle"]
    if lag == 0.0:
        return with_signals(run, steering_wheel_request=replace(angle, name="steering_wheel_request"))
    ahead = np.interp(angle.time + lag, angle.time, angle.values)
    return with_signals(
        run, steering_wheel_request=Signal("steering_wheel_request", angle.time, ahead, "rad")
    )


def test_good_runs_pass_every_check(runs: list[Run], tyres: TyresResult) -> None:
    told = made(runs, tyres)
    assert set(told) == {ECHOED, SIGNS, POINT, PARAMETERS, HELD_OUT}
    assert {one.verdict for checks in told.values() for one in checks} == {"fine"}
    assert len(told[SIGNS]) == 1
    assert "no run holds a request" in told[ECHOED][0].text


@pytest.mark.parametrize("factor", [1.0, 0.97])
def test_steering_that_repeats_the_request_is_refused(
    runs: list[Run], tyres: TyresResult, factor: float
) -> None:
    echo = with_request(changed(runs[0], steering_wheel_angle=lambda _t, v: factor * v), 0.0)
    told = made([echo, runs[1]], tyres)
    assert [one.verdict for one in told[ECHOED]] == ["refused"]
    assert told[ECHOED][0].text.startswith("planar/planar_a: ")


@pytest.mark.parametrize("lag", [0.05, 0.3])
def test_steering_that_follows_the_request_is_measured(
    runs: list[Run], tyres: TyresResult, lag: float
) -> None:
    told = made([with_request(runs[0], lag)], tyres)
    assert [one.verdict for one in told[ECHOED]] == ["fine"]
    late = re.fullmatch(r"it follows the request (.*) s late in 1 run", told[ECHOED][0].text)
    assert float(late[1]) == pytest.approx(lag, abs=0.011)


def test_a_request_that_never_moves_tells_nothing(runs: list[Run], tyres: TyresResult) -> None:
    angle = runs[0].signals["steering_wheel_angle"]
    still = Signal("steering_wheel_request", angle.time, np.zeros(len(angle.time)), "rad")
    told = made([with_signals(runs[0], steering_wheel_request=still)], tyres)
    assert "no run holds a request" in told[ECHOED][0].text


@pytest.mark.parametrize(
    ("signal", "change"),
    [
        ("yaw_rate", lambda _t, v: -v),
        ("yaw_rate", lambda _t, v: np.degrees(v)),
        ("lateral_acceleration", lambda _t, v: v / 9.81),
    ],
    ids=["turned yaw rate", "yaw rate in degrees", "acceleration in g"],
)
def test_a_wrong_sign_or_unit_is_refused(runs: list[Run], tyres: TyresResult, signal: str, change) -> None:
    told = made([changed(runs[0], **{signal: change})], tyres)
    bad = [one for one in told[SIGNS] if one.verdict == "refused"]
    assert bad
    assert all(one.text.startswith("planar/planar_a: ") for one in bad)
    assert any(signal in one.text for one in bad)


def test_a_reference_point_that_does_not_fit_is_refused(runs: list[Run], tyres: TyresResult) -> None:
    misplaced = [
        with_signals(
            run,
            **{
                name: replace(run.signals[name], at="cg")
                for name in ("position_x", "position_y", "lateral_velocity")
            },
        )
        for run in runs
    ]
    told = made(misplaced, tyres)
    by_velocity = next(one for one in told[POINT] if "the lateral velocity fits" in one.text)
    assert by_velocity.verdict == "refused"
    assert "2.12 m ahead of the rear axle" in by_velocity.text
    assert any("in the fit" in one.text and one.verdict == "warning" for one in told[POINT])


def test_another_mass_in_the_file_is_refused(runs: list[Run], tyres: TyresResult) -> None:
    told = made(runs, tyres, vehicle=replace(runs[0].vehicle, mass=14000.0))
    (one,) = told[PARAMETERS]
    assert one.verdict == "refused"
    assert "mass was 12500 kg in the fit, the vehicle file says 14000 kg" in one.text


def test_a_ratio_that_left_the_file_is_refused(runs: list[Run], tyres: TyresResult) -> None:
    told = made(runs, tyres, vehicle=replace(runs[0].vehicle, steering_ratio=None))
    (one,) = told[PARAMETERS]
    assert one.verdict == "refused"
    assert "steering_ratio was 20.5 in the fit, the vehicle file says nothing" in one.text


@pytest.mark.parametrize(
    ("held_out", "verdict"),
    [
        ("manual_c", "fine"),
        ("manual_a", "refused"),
        ("manual_a [40, 60] s", "refused"),
        ("manual_b", "refused"),
        ("manual_b [45, 60] s", "fine"),
        ("manual_b [39.5, 60] s", "refused"),
    ],
)
def test_held_out_runs_that_the_fit_has_seen_are_refused(
    runs: list[Run], tyres: TyresResult, held_out: str, verdict: str
) -> None:
    (one,) = made(runs[:1], tyres, held_out=[held_out])[HELD_OUT]
    assert one.verdict == verdict
    assert (held_out in one.text) == (verdict == "refused")


def test_a_run_that_the_fit_left_out_may_be_held_out(runs: list[Run], tyres: TyresResult) -> None:
    unused = [replace(run, used=False) for run in tyres.by_run]
    (one,) = made(runs[:1], replace(tyres, by_run=unused), held_out=["manual_a"])[HELD_OUT]
    assert one.verdict == "fine"


@pytest.mark.parametrize(("fitted", "verdict"), [([0.0, 35.0], "fine"), ([0.0, 45.0], "refused")])
def test_a_run_may_be_split_between_the_fit_and_the_evaluation(
    runs: list[Run], tyres: TyresResult, fitted: list[float], verdict: str
) -> None:
    name = runs[0].name
    (motion,) = motion_of(runs[:1])
    (window,) = motion.windows
    late = window.times >= 40.0
    kept = replace(
        window,
        times=window.times[late],
        road_wheel_angle=window.road_wheel_angle[late],
        speed=window.speed[late],
        measurements={},
    )
    fit = replace(tyres, by_run=[TyreRun(name, 4, 35.0, [8, 15], [-4, 4], {}, spans=[fitted])])
    found = checks(runs[:1], [replace(motion, windows=[kept])], fit, runs[0].vehicle, [name])
    assert [one.verdict for one in found if one.what == HELD_OUT] == [verdict]
