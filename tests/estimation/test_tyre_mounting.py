"""Found beside the tyres: a reference point nobody states, a turned sensor; and no bank that is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from motion_runs import BODY, TRUTH, records

from ident.estimation.tyre_fit import MISALIGNED, KindFit, fit_tyres
from ident.estimation.vehicle_fit import run_agreement
from ident.estimation.vehicle_records import MotionRecord, Samples

START = {
    "front.cornering_stiffness": TRUTH.front.stiffness * 1.2,
    "rear.cornering_stiffness": TRUTH.rear.stiffness * 0.8,
    "yaw_inertia": TRUTH.body.yaw_inertia * 1.1,
}
AHEAD, TURNED = 0.8, 0.025  # [m], [rad]
SECONDS = 60.0


def gentle(run: int = 0, name: str = "planar/planar_a") -> list[MotionRecord]:
    """The first part of a run of the simulated truck, without position."""
    kept = ("yaw_rate", "lateral_velocity", "lateral_acceleration", "heading")
    return [_shortened(record, kept) for record in records(name, run=run)][:1]


def _shortened(record: MotionRecord, kept: Sequence[str]) -> MotionRecord:
    last = min(round(SECONDS / record.period), record.times.size - 1)
    end = record.times[last]
    measured = {
        name: Samples(one.times[one.times <= end], one.values[one.times <= end])
        for name, one in record.measured.items()
        if name in kept
    }
    return replace(
        record,
        times=record.times[: last + 1],
        road_wheel_angle=record.road_wheel_angle[: last + 1],
        speed=record.speed[: last + 1],
        measured=measured,
    )


def moved(record: MotionRecord, ahead: float, turned: float) -> MotionRecord:
    """The lateral velocity of a point farther ahead, as a sensor reads it that is turned to the right."""
    own, rate = record.measured["lateral_velocity"], record.measured["yaw_rate"]
    turning = np.interp(own.times, rate.times, np.convolve(rate.values, np.ones(9) / 9, mode="same"))
    speed = np.interp(own.times, record.times, record.speed)
    read = Samples(own.times, own.values + ahead * turning + turned * speed)
    return replace(record, measured={**record.measured, "lateral_velocity": read}, reference_known=False)


def fitted(given: Sequence[MotionRecord]) -> KindFit:
    return fit_tyres(given, "linear", BODY, [START])


@cache
def moved_fit() -> KindFit:
    return fitted([moved(record, AHEAD, TURNED) for record in gentle()])


def terms(found: KindFit) -> list[str]:
    return [one.name for one in found.problem.run_terms]


def test_the_reference_point_is_found_where_nobody_states_it() -> None:
    found = moved_fit()
    index = found.names.index("reference_x")
    std = float(np.sqrt(found.fit.covariance[index, index]))
    stated = gentle()[0].reference_x
    assert abs(found.parameters["reference_x"] - (stated + AHEAD)) < max(3 * std, 0.1)
    assert std < 0.15


def test_a_turned_sensor_joins_the_model_and_is_found() -> None:
    found = moved_fit()
    assert MISALIGNED.name in terms(found)
    value = found.fit.point.of_runs[0, terms(found).index(MISALIGNED.name)]
    assert value == pytest.approx(TURNED, abs=0.003)


def test_neither_joins_where_the_point_is_stated_and_the_sensor_is_straight() -> None:
    found = fitted(gentle())
    assert "reference_x" not in found.names
    assert MISALIGNED.name not in terms(found)


def test_a_run_that_hardly_turns_gets_no_bank() -> None:
    def nearly_straight(record: MotionRecord) -> MotionRecord:
        small = {name: Samples(one.times, 0.01 * one.values) for name, one in record.measured.items()}
        return replace(record, run=1, road_wheel_angle=0.01 * record.road_wheel_angle, measured=small)

    both = [*gentle(), *map(nearly_straight, gentle())]
    found = fit_tyres(both, "linear", BODY, [START], bank=True)
    turned = np.ptp(gentle()[0].measured["heading"].values) > np.pi / 2
    assert [found.problem.has(run, "bank_cos") for run in (0, 1)] == [turned, False]
    banks = found.fit.point.of_runs[1, [terms(found).index(name) for name in ("bank_cos", "bank_sin")]]
    assert np.abs(banks).max() < 1e-6


def test_a_run_on_a_straight_road_tells_no_stiffness() -> None:
    def straight(record: MotionRecord) -> MotionRecord:
        random = np.random.default_rng(4)
        noise = {"yaw_rate": 0.002, "lateral_velocity": 0.02, "lateral_acceleration": 0.05, "heading": 0.002}
        measured = {
            name: Samples(one.times, noise[name] * random.standard_normal(one.times.size))
            for name, one in record.measured.items()
        }
        still = np.zeros(record.times.size)
        return replace(record, run=1, road_wheel_angle=still, measured=measured)

    found = fitted([*gentle(), *map(straight, gentle())])
    turning, still = run_agreement(found.fit)
    index = found.names.index("rear.cornering_stiffness")
    assert turning.std[index] < 0.1
    assert still.std[index] > 0.5
