"""Requests as senders really send them: events, staircases, noise, chirps, and only partly followed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ident.experiments.find import find_experiments
from ident.experiments.found import Found
from ident.experiments.stretches import Stretch, find_stretches

Array = NDArray[np.float64]

TIME = np.arange(0, 60, 0.02)


def stretches(time: Array, command: Array, **more: list[tuple[float, float]]) -> list[Stretch]:
    """Stretches of a command with an answer that moves a little all the time."""
    seen = np.arange(time[0] + 0.003, 60, 0.01)
    return find_stretches(time, command, seen, 0.01 * np.sin(seen), **more)


def found_in(time: Array, command: Array) -> list[Found]:
    (stretch,) = stretches(time, command)
    return find_experiments(stretch)


def accepted(time: Array, command: Array) -> list[tuple[str, float]]:
    return [(one.kind, round(one.start, 2)) for one in found_in(time, command) if not one.rejected]


def burst(
    frequency: float, cycles: float, *, size: float = 0.4, at: float = 2.0, time: Array = TIME
) -> Array:
    inside = (time >= at) & (time < at + 2 * np.pi * cycles / frequency)
    return np.where(inside, size * np.sin(frequency * (time - at)), 0.0)


# --- events -----------------------------------------------------------------------------------------

EVENTS = np.array([0.0, 2.0, 7.0, 9.0, 14.0, 16.0])
LEVELS = np.array([0.0, 1.0, 0.0, -0.5, 0.0, 0.3])


def test_a_request_sent_only_when_it_changes_has_the_same_steps() -> None:
    found = found_in(EVENTS, LEVELS)
    assert [one.kind for one in found] == ["pulse", "step", "pulse", "step", "step"]
    assert [one.start for one in found] == [2.0, 7.0, 9.0, 14.0, 16.0]
    assert [one.end_time for one in found][:4] == [7.0, 9.0, 14.0, 16.0]
    assert found[-1].end_time == pytest.approx(60, abs=0.02)
    assert [one.amplitude for one in found] == pytest.approx([1.0, -1.0, -0.5, 0.5, 0.3])
    assert [one.hold_before for one in found] == pytest.approx([2.0, 5.0, 2.0, 5.0, 2.0])
    assert {one.start_uncertainty for one in found} == {0.0}


def test_events_are_commands_that_act_at_their_stamps() -> None:
    (stretch,) = stretches(EVENTS, LEVELS)
    assert not stretch.steady
    assert stretch.command_period == 0.0
    assert stretch.end == stretch.times[-1]


def test_event_driven_changes_without_a_hold_are_no_steps() -> None:
    random = np.random.default_rng(3)
    times = np.cumsum(random.exponential(0.05, 400))
    found = found_in(times, np.cumsum(random.standard_normal(400)) * 0.02)
    holds = [one.end_time - one.start for one in found if one.kind in ("step", "pulse")]
    assert all(hold >= 0.2 for hold in holds)


# --- only partly followed ---------------------------------------------------------------------------


@pytest.mark.parametrize("events", [True, False], ids=["events", "50 Hz"])
def test_nothing_is_used_after_the_request_is_no_longer_followed(*, events: bool) -> None:
    time, command = (EVENTS, LEVELS) if events else (TIME, burst(1.0, 8))
    parts = stretches(time, command, enabled=[(1.0, 8.5), (10.0, 18.0), (18.005, 18.02)])
    assert len(parts) == (1 if events else 2)  # two events, 2 s apart, tell nothing of a step
    for part, (low, high) in zip(parts, [(1.0, 8.5), (10.0, 18.0)], strict=False):
        assert low <= part.command_times[0]
        assert part.command_times[-1] < high
        assert low <= part.times[0]
        assert part.times[-1] <= high


# --- staircases -------------------------------------------------------------------------------------


def test_a_sine_of_few_levels_is_a_sine_and_not_steps() -> None:
    coarse = np.round(burst(1.0, 4, size=0.04) / 1e-3) * 1e-3
    assert accepted(TIME, coarse) == [("sine", pytest.approx(2.0, abs=0.05))]


def test_a_request_renewed_more_slowly_than_it_is_sent_is_no_row_of_steps() -> None:
    renewed = burst(1.0, 4)[(TIME / 0.1).astype(int) * 5]
    assert not [one for one in found_in(TIME, renewed) if one.kind in ("step", "pulse")]


def test_a_ramp_of_small_jumps_is_no_row_of_steps() -> None:
    ramp = np.round(np.interp(TIME, [2, 12, 20, 30], [0, 0.5, 0.5, 0]) / 5e-3) * 5e-3
    assert {one.kind for one in found_in(TIME, ramp)} == {"other"}


def test_a_hold_of_a_fifth_of_a_second_is_the_shortest() -> None:
    def pulse(hold: float) -> set[str]:
        return {
            kind for kind, _ in accepted(TIME, np.where((TIME >= 5) & (5 + hold - 1e-9 > TIME), 0.5, 0.0))
        }

    assert "pulse" in pulse(0.2)
    assert "pulse" not in pulse(0.16)


# --- what is no sine --------------------------------------------------------------------------------

CHIRPS = {
    "slow, linear, to 10 rad/s": 0.4 * np.sin(0.1 * TIME + 9.9 / 120 * TIME**2),
    "slow, linear, to 3 rad/s": 0.4 * np.sin(0.1 * TIME + 2.9 / 120 * TIME**2),
    "logarithmic": 0.4 * np.sin(0.02 * np.cumsum(0.1 * 100 ** (TIME / 60))),
}


@pytest.mark.parametrize("command", CHIRPS.values(), ids=CHIRPS)
def test_no_piece_of_a_chirp_is_a_sine(command: Array) -> None:
    assert {one.kind for one in found_in(TIME, command) if not one.rejected} == {"other"}


def test_a_piece_of_a_chirp_is_told_from_a_sine_by_its_frequency() -> None:
    command = np.where(TIME < 32, 0.4 * np.sin(2.0 * TIME + 0.01 * TIME**2), 0.0)
    told = [one.rejected for one in found_in(TIME, command) if one.kind == "sine"]
    assert told
    assert all(reason for reason in told)


def test_a_request_of_noise_alone_has_no_steps_and_no_sines() -> None:
    for seed in range(4):
        noise = 0.01 * np.random.default_rng(seed).standard_normal(TIME.size)
        found = found_in(TIME, noise)
        assert {one.kind for one in found if not one.rejected} <= {"other"}
        assert len(found) < 12  # and no list of everything that it is not


def test_noise_on_the_request_does_not_hide_a_pulse() -> None:
    noise = 0.002 * np.random.default_rng(0).standard_normal(TIME.size)
    command = np.where((TIME >= 10) & (TIME < 15), 1.0, 0.0) + noise
    kept = [one for one in found_in(TIME, command) if one.kind != "other" and not one.rejected]
    assert [(one.kind, round(one.start, 1)) for one in kept] == [("pulse", 10.0), ("step", 15.0)]


def test_too_few_commands_a_cycle_are_told() -> None:
    time = np.arange(0, 60, 0.2)
    told = [one.rejected for one in found_in(time, burst(9.0, 40, time=time)) if one.kind == "sine"]
    assert any("commands a cycle, 4 needed" in str(reason) for reason in told)


# --- in one row -------------------------------------------------------------------------------------


def test_pulses_and_sines_back_to_back_keep_their_borders() -> None:
    command, at = np.zeros_like(TIME), 2.0
    borders = [at]
    for seconds, level, frequency in (
        (5.0, 0.8, 0.0),
        (2 * np.pi, 0.3, 3.0),
        (3.0, 0.5, 0.0),
        (4.0, 0.2, 3 * np.pi),
    ):
        inside = (at - 1e-9 <= TIME) & (at + seconds - 1e-9 > TIME)
        wave = np.sin(frequency * (TIME[inside] - at)) if frequency else 1.0
        command[inside] = level * wave
        at += seconds
        borders.append(at)
    found = [one for one in found_in(TIME, command) if not one.rejected]
    sines = [one for one in found if one.kind == "sine"]
    assert [one.frequency for one in sines] == pytest.approx([3.0, 3 * np.pi], rel=0.01)
    assert [one.start for one in sines] == pytest.approx([borders[1], borders[3]], abs=0.05)
    assert [one.end_time for one in sines] == pytest.approx([borders[2], borders[4]], abs=0.05)
    assert found[0].kind == "pulse"
    assert (found[0].start, found[0].end_time) == pytest.approx((2.0, 7.0), abs=0.03)
