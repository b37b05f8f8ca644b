"""Samples that a recorder repeats are told from those that a quantised signal repeats by chance."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ident.experiments.held_samples import without_held
from ident.signals.signal import Signal

Array = NDArray[np.float64]

PERIOD, QUANTUM = 0.01, 0.0017  # [s], [rad]
TIMES = PERIOD * np.arange(3000)


def turned_and_held(noise: float, seed: int) -> Array:
    """An angle that is turned by some radians in three seconds and held for one and a half, quantised."""
    random = np.random.default_rng(seed)
    targets = random.uniform(-8.0, 8.0, 8)
    place = np.clip((TIMES % 4.5) / 3.0, 0.0, 1.0)
    index = (TIMES // 4.5).astype(int)
    angle = targets[index] + (targets[index + 1] - targets[index]) * place
    return np.round((angle + noise * random.standard_normal(TIMES.size)) / QUANTUM) * QUANTUM


def left_out(values: Array) -> int:
    signal = Signal("steering_wheel_angle", TIMES, values, "rad")
    return TIMES.size - without_held(signal, rest_counts=True)[0].time.size


@pytest.mark.parametrize("noise", [0.3, 0.6, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(5))
def test_what_a_turned_and_held_wheel_repeats_by_chance_stays(noise: float, seed: int) -> None:
    assert left_out(turned_and_held(noise * QUANTUM, seed)) == 0


@pytest.mark.parametrize("slower", [2, 4])
def test_what_a_faster_recorder_repeats_is_left_out(slower: int) -> None:
    values = turned_and_held(3.0 * QUANTUM, 1)
    recorded = np.repeat(values[::slower], slower)[: TIMES.size]
    assert left_out(recorded) > 0.8 * (1 - 1 / slower) * TIMES.size


def test_a_signal_without_resolution_repeats_nothing_by_chance() -> None:
    values = np.cumsum(np.random.default_rng(1).standard_normal(TIMES.size))
    values[1::10] = values[::10]
    assert left_out(values) == TIMES.size // 10
