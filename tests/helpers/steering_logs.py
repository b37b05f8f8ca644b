"""Small logs of a steering actuator: MCAP files of a request and its answer, with known truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from actuator_truth import Test, ar1_noise, pulses, sines
from generator.truth import Actuator
from log_files import ANGLE, FLAG, REQUEST, Message, message, nanoseconds, write_mcap
from numpy.typing import NDArray

from ident.results import SteeringResult

Array = NDArray[np.float64]

CHANNELS = """signals:
  steering_wheel_request: {topic: /request, field: angle, unit: rad}
  steering_wheel_angle: {topic: /angle, field: angle, unit: rad}
  engaged: {topic: /engaged, field: engaged, unit: "1"}
"""
TRUTH = Actuator(0.95, 0.123, 0.25, 0.08)
NOISE = 0.003
PARAMETERS = ("gain", "dead_time", "time_constant_1", "time_constant_2")


def rows(topic: str, kind: str, field: str, time: Array, values: Array, epoch: float) -> list[Message]:
    kept = [round(float(t), 9) for t in time]
    return [
        message(topic, kind, nanoseconds(epoch + t), **{field: value})
        for t, value in zip(kept, values.tolist(), strict=True)
    ]


def write(
    path: Path,
    test: Test,
    measured: Array,
    *,
    sign: float = 1.0,
    epoch: float = 0.0,
    engaged: tuple[Array, NDArray[np.bool_]] | None = None,
) -> Path:
    """One MCAP file of a request and its answer, with the channel map beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    (path.parent / "channels.yaml").write_text(CHANNELS, encoding="utf-8")
    messages = rows("/request", REQUEST, "angle", test.command_times, sign * test.command_values, epoch)
    messages += rows("/angle", ANGLE, "angle", test.times, sign * measured, epoch)
    if engaged is not None:
        messages += rows("/engaged", FLAG, "engaged", *engaged, epoch)
    return write_mcap(path, sorted(messages, key=lambda one: one.time))


def pulse_test(seed: int) -> Test:
    return pulses(np.random.default_rng(seed), on=4.0, off=3.0, sizes=(1.0, -0.7), before=1.0)


def sine_test(seed: int) -> Test:
    return sines(np.random.default_rng(seed), (2.0, 5.0))


def answer(test: Test, actuator: Actuator = TRUTH, seed: int = 1) -> Array:
    noise = ar1_noise(test.times.size, NOISE, 0.5, np.random.default_rng(seed))
    return test.record(actuator, noise, bias=0.01).measured


def values(result: SteeringResult) -> Array:
    return np.array([getattr(result.model, name).value for name in PARAMETERS])


def near_truth(result: SteeringResult, actuator: Actuator = TRUTH) -> None:
    for name in PARAMETERS:
        found = getattr(result.model, name)
        truth = float(np.real(getattr(actuator, name)))
        assert found.value == pytest.approx(truth, abs=4 * found.std), name
