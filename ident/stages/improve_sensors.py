"""Sensors first, without tyres: what the sensors say of each other, and what a difference would be.

A quantity differs where the data contradict what it should be (all quantities together at 5 %, after Holm
1979) and the difference is large enough to matter; it agrees where it does not and the data would have shown
what matters; else it cannot be tested.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ident.experiments.sensor_checks import Answer, answers, lateral_acceleration
from ident.experiments.sensor_series import SPEEDS, SensorSeries, sensor_series
from ident.results import Estimate, SensorCheck, Status
from ident.signals.signal import Run

LEVEL = 0.05
SHORTEST = 5.0  # [s] of a run that is looked at
WIDEST = 2.5  # half of the 95 % interval over the standard error that is needed
RATIO = 18.0  # steering wheel over road wheel, for what matters of an angle whose ratio is not known


@dataclass(frozen=True)
class Question:
    """What is asked of one quantity.

    name : in words; unit, expected : of the quantity
    negligible : difference that does not matter
    needed : standard error above which a typical size would go unseen, so that nothing can be said to agree
    effect : of the catalogue that a difference would be
    differs : what a difference means and what to do, in words
    """

    name: str
    unit: str
    expected: float
    negligible: float
    needed: float
    effect: str | None
    differs: str


CORRECT_LAG = "state it as align.latency in the recipe, or let the loop fit it as sensor_latency"
QUESTIONS = {
    "yaw_rate scale": Question(
        "yaw rate against the derivative of the heading: scale",
        "1",
        1.0,
        1e-3,
        0.005,
        "gyro_scale",
        "the gyro's scale is wrong: calibrate it over full circles",
    ),
    "yaw_rate bias": Question(
        "yaw rate against the derivative of the heading: bias",
        "rad/s",
        0.0,
        2e-4,
        0.0015,
        "sensor_bias",
        "the gyro has a bias: measure it in a standstill of 60 s and take it out, or let the loop fit it",
    ),
    "yaw_rate lag": Question(
        "yaw rate against the derivative of the heading: lag",
        "s",
        0.0,
        3e-3,
        0.015,
        "sensor_latency",
        f"one of the two is late or low-passed (negative: the heading): {CORRECT_LAG}",
    ),
    "speed scale": Question(
        "speed against the speed of the position: scale",
        "1",
        1.0,
        2e-3,
        0.007,
        "wheel_speed_scale",
        "the radius of the wheels is wrong: scale it in channels.yaml, or let the loop fit it",
    ),
    "speed lag": Question(
        "speed against the speed of the position: lag",
        "s",
        0.0,
        0.01,
        0.02,
        "sensor_latency",
        f"one of the two is late (negative: the position): {CORRECT_LAG}",
    ),
    "longitudinal_velocity scale": Question(
        "longitudinal velocity against the speed of the position: scale",
        "1",
        1.0,
        2e-3,
        0.007,
        None,
        "the localization contradicts itself: where the other speed agrees with the position use that one",
    ),
    "longitudinal_velocity lag": Question(
        "longitudinal velocity against the speed of the position: lag",
        "s",
        0.0,
        0.01,
        0.02,
        "sensor_latency",
        f"one of the two is late (negative: the position): {CORRECT_LAG}",
    ),
    "lateral_acceleration scale": Question(
        "lateral acceleration against v r + dv_y/dt: scale",
        "1",
        1.0,
        0.01,
        0.03,
        "body_roll",
        "the body rolls out of the turn and the accelerometer feels gravity (above 1), or its scale is "
        "wrong: log the roll rate to tell",
    ),
    "lateral_acceleration bias": Question(
        "lateral acceleration against v r + dv_y/dt: bias",
        "m/s^2",
        0.0,
        0.01,
        0.03,
        "sensor_bias",
        "the accelerometer has a bias or is tilted: drive the same road both ways, or let the loop fit it",
    ),
    "lateral_acceleration lag": Question(
        "lateral acceleration against v r + dv_y/dt: lag",
        "s",
        0.0,
        5e-3,
        0.015,
        "sensor_latency",
        "the accelerometer is late or low-passed, or early (negative), or not where imu_position says: "
        f"{CORRECT_LAG}",
    ),
    "position lag": Question(
        "position against speed, heading and lateral velocity: lag",
        "s",
        0.0,
        5e-3,
        0.015,
        "sensor_latency",
        f"the position is late, or heading and speed are (negative): {CORRECT_LAG}",
    ),
    "heading direction": Question(
        "course of the position less heading and side slip",
        "rad",
        0.0,
        2e-3,
        0.005,
        "antenna_offset",
        "the heading is turned against the direction of travel: correct its zero, it looks like a side slip",
    ),
    "lateral_velocity bias": Question(
        "lateral velocity against the track of the position: bias",
        "m/s",
        0.0,
        0.01,
        0.015,
        "sensor_bias",
        "the lateral velocity has a bias: let the loop fit it, or do not use it",
    ),
    "lateral_velocity lag": Question(
        "lateral velocity against the track of the position: lag",
        "s",
        0.0,
        0.01,
        0.015,
        "sensor_latency",
        f"the lateral velocity is late, or early (negative): {CORRECT_LAG}",
    ),
    "yaw_rate at rest": Question(
        "yaw rate at standstill",
        "rad/s",
        0.0,
        2e-4,
        0.0015,
        "sensor_bias",
        "the gyro has a bias: take it out, or let the loop fit it",
    ),
    "lateral_acceleration at rest": Question(
        "lateral acceleration at standstill",
        "m/s^2",
        0.0,
        0.02,
        0.03,
        "sensor_bias",
        "the accelerometer has a bias or is tilted, or the truck stood on a slope (1 % across is 0.1 m/s²)",
    ),
}
BY_VELOCITY = {
    "speed scale": "speed against the velocity of the localization: scale",
    "speed lag": "speed against the velocity of the localization: lag",
}
ZERO = Question(
    "steering angle where the truck drives straight",
    "rad",
    0.0,
    1e-3,
    1e-3,
    "steering_offset",
    "evidence only: the zero of the steering, a bank or wind; the loop decides with the model",
)


def sensor_checks(runs: Sequence[Run]) -> list[SensorCheck]:
    """Compare the sensors of all runs with each other and with rest.

    Needs no vehicle file, no steering and no model; what a log lacks is told as not testable.
    """
    found = [sensor_series(run) for run in runs if run.duration >= SHORTEST]
    given = _corrected(found, answers(found))
    asked = [(answer, _question(answer, runs)) for answer in given]
    limits = _levels([answer.p_value(question.expected) for answer, question in asked])
    checks = {
        answer.key: _check(answer, question, limit)
        for (answer, question), limit in zip(asked, limits, strict=True)
    }
    return list(_together(checks).values())


def _together(checks: dict[str, SensorCheck]) -> dict[str, SensorCheck]:
    """Say of a difference what another difference makes of it."""
    lag, scale = "lateral_acceleration lag", "lateral_acceleration scale"
    gyro = "yaw_rate lag"
    rest, bias = "lateral_acceleration at rest", "lateral_acceleration bias"
    made = dict(checks)
    if _differs(checks, rest) and checks[bias].verdict == "agrees":
        told = "the truck stood on a slope: the accelerometer shows no bias while driving"
        made[rest] = replace(checks[rest], effect=None, meaning=told)
    if _differs(checks, scale) and checks[lag].verdict == "agrees":
        told = "without the lag of a rolling body: the accelerometer's scale, or a roll too quick to lag"
        made[scale] = replace(checks[scale], effect=None, meaning=f"{told}: log the roll rate to tell")
    if not _differs(checks, lag):
        return made
    if _differs(checks, scale) and checks[scale].effect == "body_roll":
        told = "a body that rolls lags, too: see the scale"
        made[lag] = replace(checks[lag], effect="body_roll", meaning=f"{told}; or {checks[lag].meaning}")
    elif _differs(checks, gyro) and _same(checks[lag], checks[gyro]):
        told = f"yaw rate and lateral acceleration alike: the whole inertial unit is late: {CORRECT_LAG}"
        made |= {key: replace(checks[key], meaning=told) for key in (lag, gyro)}
    return made


def _differs(checks: dict[str, SensorCheck], key: str) -> bool:
    return key in checks and checks[key].verdict == "differs"


def _same(one: SensorCheck, other: SensorCheck) -> bool:
    """Whether two estimates are the same but for noise."""
    values = [check.estimate.value or 0.0 for check in (one, other)]
    std = [check.estimate.std or 0.0 for check in (one, other)]
    return abs(values[0] - values[1]) < 3 * math.hypot(*std)


def _corrected(runs: Sequence[SensorSeries], given: list[Answer]) -> list[Answer]:
    """Answers of the other sensors again, where a wrong one takes part in what is expected of them.

    The scale of the only speed, and the lag of the lateral velocity, would pass for errors of the
    accelerometer.
    """
    level = LEVEL / max(len(given), 1)
    speed, drift = (_wrong(given, key, level) for key in ("speed scale", "lateral_velocity lag"))
    if all(run.speed_source == SPEEDS[0] for run in runs) and speed is not None:
        runs = [_replaced(run, SPEEDS[0], run.values[SPEEDS[0]] / speed) for run in runs]
        mine = [one for one in given if one.signals[0] == SPEEDS[0]]
        given = [*mine, *(one for one in answers(runs) if one.signals[0] != SPEEDS[0])]
    if drift is not None:
        runs = [_earlier(run, "lateral_velocity", drift) for run in runs]
        again = {one.key: one for one in lateral_acceleration(runs)}
        given = [again.get(one.key, one) for one in given]
    return given


def _wrong(given: Sequence[Answer], key: str, level: float) -> float | None:
    """Value of a quantity that certainly is not what it should be."""
    found = next((one for one in given if one.key == key), None)
    question = QUESTIONS[key]
    if found is None or found.value is None:
        return None
    p_value = found.p_value(question.expected)
    large = abs(found.value - question.expected) > question.negligible
    return found.value if large and p_value is not None and p_value < level else None


def _replaced(run: SensorSeries, name: str, values: NDArray[np.float64]) -> SensorSeries:
    return replace(run, values={**run.values, name: values})


def _earlier(run: SensorSeries, name: str, lag: float) -> SensorSeries:
    if name not in run.values:
        return run
    moved = np.interp(run.time + lag, run.time, run.values[name], left=np.nan, right=np.nan)
    return _replaced(run, name, moved)


def _question(answer: Answer, runs: Sequence[Run]) -> Question:
    if answer.key.endswith(" zero"):
        return _zero(answer.signals[0], runs)
    question = QUESTIONS[answer.key]
    if answer.signals == SPEEDS:
        return replace(question, name=BY_VELOCITY[answer.key])
    return question


def _zero(name: str, runs: Sequence[Run]) -> Question:
    if name != "steering_wheel_angle":
        return ZERO
    stated = [run.vehicle.steering_ratio for run in runs if run.vehicle]
    ratio = next((one for one in stated if isinstance(one, int | float)), RATIO)
    return replace(ZERO, negligible=ratio * ZERO.negligible, needed=ratio * ZERO.needed)


def _levels(p_values: Sequence[float | None]) -> list[float]:
    """Level of each, so that all together have ``LEVEL`` (Holm); zero from the first that is kept on."""
    order = sorted((p, number) for number, p in enumerate(p_values) if p is not None)
    levels = [0.0] * len(p_values)
    for rank, (p, number) in enumerate(order):
        level = LEVEL / (len(order) - rank)
        if p > level:
            break
        levels[number] = level
    return levels


def _check(answer: Answer, question: Question, level: float) -> SensorCheck:
    p_value = answer.p_value(question.expected)
    base = SensorCheck(
        name=question.name,
        signals=list(answer.signals),
        estimate=_estimate(answer, question),
        expected=question.expected,
        p_value=p_value,
        verdict="not_testable",
        effect=None,
        meaning="",
    )
    if answer.value is None or answer.std is None or p_value is None:
        return replace(base, meaning=f"cannot be tested: {answer.why_not}")
    off = abs(answer.value - question.expected)
    if p_value <= level and off > question.negligible:
        meaning = _noted(question.differs, answer)
        return replace(base, verdict="differs", effect=_effect(answer, question), meaning=meaning)
    if _is_weak(answer, question):
        low, high = answer.interval() or (answer.value, answer.value)
        told = (
            f"cannot be tested: it is known to ±{(high - low) / 2:.2g} {_unit(question)}".rstrip()
            + f", need ±{WIDEST * question.needed:.2g}: drive longer and more varied"
        )
        return replace(base, meaning=told)
    small = " (certain, but too small to matter)" if p_value <= level else ""
    return replace(base, verdict="agrees", meaning=_noted(f"as it should be{small}", answer))


def _is_weak(answer: Answer, question: Question) -> bool:
    """Whether a typical difference would go unseen."""
    low, high = answer.interval() or (-math.inf, math.inf)
    return (high - low) / 2 > WIDEST * question.needed


def _effect(answer: Answer, question: Question) -> str | None:
    """Return the effect; a body that rolls makes the lateral acceleration larger, never smaller."""
    if question.effect == "body_roll" and answer.value is not None and answer.value < question.expected:
        return None
    return question.effect


def _noted(text: str, answer: Answer) -> str:
    return f"{text}; {answer.note}" if answer.note else text


def _unit(question: Question) -> str:
    return "" if question.unit == "1" else question.unit


def _estimate(answer: Answer, question: Question) -> Estimate:
    interval = answer.interval()
    if interval is None or answer.std is None:
        return Estimate(None, None, None, None, question.unit, "not_identifiable", answer.why_not)
    weak = _is_weak(answer, question)
    status: Status = "weak" if weak else "identified"
    wanted = f"{WIDEST * question.needed:.2g} {_unit(question)}".rstrip()
    reason = f"half of the interval is above {wanted}" if weak else None
    low, high = (float(end) for end in interval)
    return Estimate(float(answer.value or 0.0), float(answer.std), low, high, question.unit, status, reason)
