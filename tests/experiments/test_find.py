"""Experiments are found by themselves in the request, in any order; what is none is not taken for one."""

import numpy as np
import pytest

from ident.experiments.find import find_experiments
from ident.experiments.stretches import find_stretches

RATE = 50.0


def held(parts, rate=RATE, resolution=0.0, kind=np.float64, jitter=0.0):
    """Commands of pieces (duration [s], function of the time within the piece)."""
    times, values, start = [], [], 0.0
    for duration, value in parts:
        time = np.arange(round(duration * rate)) / rate
        times.append(start + time)
        values.append(value(time) * np.ones_like(time))
        start += len(time) / rate
    time, command = np.concatenate(times), np.concatenate(values)
    if resolution:
        command = np.round(command / resolution) * resolution
    time = time + jitter / rate * np.random.default_rng(0).uniform(-0.5, 0.5, time.size)
    return time, command.astype(kind).astype(np.float64)


def pause(seconds, level=0.0):
    return seconds, lambda t: 0 * t + level


def sine(frequency, cycles=3.0, size=0.4):
    return cycles * 2 * np.pi / frequency, lambda t: size * np.sin(frequency * t)


def all_in(time, command):
    """The measured angle does not matter to what is found, but for a step at the very start."""
    seen = np.arange(time[0], time[-1], 0.01)
    (stretch,) = find_stretches(time, command, seen, 0.001 * np.sin(seen))
    return find_experiments(stretch)


def found_in(time, command):
    return [one for one in all_in(time, command) if one.rejected is None]


PULSES = [pause(2), pause(5, 0.8), pause(2), pause(5, -1.0), pause(2), pause(5, 1.6), pause(2)]
SETTINGS = {
    "clean": {},
    "10 Hz": {"rate": 10.0},
    "100 Hz": {"rate": 100.0},
    "float32": {"kind": np.float32},
    "quantised": {"resolution": 1e-3},
    "jittered": {"jitter": 0.1},
}


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=SETTINGS)
def test_rectangular_pulses_are_found_with_their_returns(setting):
    found = found_in(*held(PULSES, **setting))
    assert [one.kind for one in found] == ["pulse", "step"] * 3
    assert [one.amplitude for one in found] == pytest.approx([0.8, -0.8, -1.0, 1.0, 1.6, -1.6], abs=2e-3)
    assert [one.start for one in found] == pytest.approx([2, 7, 9, 14, 16, 21], abs=0.11)
    assert [one.level_before for one in found] == pytest.approx([0, 0.8, 0, -1, 0, 1.6], abs=2e-3)


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=SETTINGS)
def test_sines_back_to_back_are_told_apart(setting):
    frequencies = [0.5, 2.0, 1.0, 3.0]
    found = [one for one in found_in(*held([sine(w) for w in frequencies], **setting)) if one.kind == "sine"]
    assert [one.frequency for one in found] == pytest.approx(frequencies, rel=0.02)
    assert [one.amplitude for one in found] == pytest.approx([0.4] * 4, rel=0.03)


def test_sines_with_pauses_and_pulses_between_them_are_found_in_any_order():
    time, command = held(
        [pause(1), sine(5.0), pause(2), pause(5, 0.6), pause(2), sine(0.3, 1.5), pause(1), sine(1.0)]
    )
    kinds = [(one.kind, round(one.frequency or 0, 1)) for one in found_in(time, command)]
    assert kinds == [("sine", 5.0), ("pulse", 0.0), ("step", 0.0), ("sine", 0.3), ("sine", 1.0)]


def test_a_short_slow_sine_of_one_and_a_fifth_cycles_is_found_whole():
    (one,) = [one for one in found_in(*held([pause(3), sine(0.1, 1.2), pause(3)])) if one.kind == "sine"]
    assert one.frequency == pytest.approx(0.1, rel=1e-3)
    assert (one.end_time - one.start) * one.frequency / (2 * np.pi) == pytest.approx(1.2, abs=0.03)


def test_a_sine_of_less_than_a_cycle_is_rejected_with_its_cycles():
    time, command = held([pause(3), sine(1.0, 0.9), pause(3)])
    (stretch,) = find_stretches(time, command, time, 0 * time)
    told = [one.rejected for one in find_experiments(stretch) if one.kind == "sine"]
    assert len(told) == 1
    assert told[0].startswith("0.9")
    assert "one needed: drive it longer" in told[0]


def triangle(t):
    return 0.4 * (2 * np.abs((t / 4) % 1 - 0.5) - 0.5)


NO_SINES = {
    "triangle": [pause(1), (40, triangle), pause(1)],
    "chirp": [pause(1), (40, lambda t: 0.4 * np.sin(0.3 * t + 0.06 * t**2)), pause(1)],
    "ramps": [pause(1), (5, lambda t: 0.1 * t), pause(2, 0.5), (5, lambda t: 0.5 - 0.1 * t), pause(1)],
    "random walk": [
        pause(1),
        (40, lambda t: 0.02 * np.cumsum(np.random.default_rng(5).standard_normal(t.size))),
    ],
}


@pytest.mark.parametrize("parts", NO_SINES.values(), ids=NO_SINES)
def test_what_is_no_step_and_no_sine_is_other_excitation(parts):
    found = all_in(*held(parts))
    assert found
    assert all(one.kind == "other" or (one.kind == "sine" and one.rejected) for one in found)


def test_binary_noise_gives_steps_and_no_sines():
    random = np.random.default_rng(2)
    parts = [pause(random.uniform(0.1, 0.6), 0.3 * random.choice([-1, 1])) for _ in range(60)]
    kinds = {one.kind for one in found_in(*held(parts))}
    assert "sine" not in kinds
    assert kinds & {"step", "pulse"}


def test_a_constant_request_gives_nothing():
    assert found_in(*held([pause(20, 0.3)])) == []


def test_mirrored_requests_give_mirrored_experiments():
    time, command = held([*PULSES, sine(1.0), pause(1)])
    plain, mirrored = found_in(time, command), found_in(time, -command)
    assert [one.kind for one in plain] == [one.kind for one in mirrored]
    steps = [one for one in plain if one.kind != "sine"]
    assert [-one.amplitude for one in steps] == [one.amplitude for one in mirrored if one.kind != "sine"]


def test_a_step_whose_first_command_is_lost_is_known_to_the_messages_lost():
    time, command = held(PULSES)
    edge = int(np.flatnonzero(np.diff(command))[0]) + 1
    keep = np.arange(time.size) != edge
    found = found_in(time[keep], command[keep])
    assert found[0].kind == "pulse"
    assert found[0].start == pytest.approx(2.0 + 1 / RATE)
    assert found[0].start_uncertainty == pytest.approx(1 / RATE)


def test_a_step_at_the_first_sample_is_found_by_the_answer():
    time = np.arange(0, 5, 0.02)
    answer = 0.8 * (1 - np.exp(-np.maximum(time - 0.12, 0) / 0.3))
    (stretch,) = find_stretches(time, 0 * time + 0.8, time, answer)
    (one,) = find_experiments(stretch)
    assert (one.kind, one.start, one.level_before) == ("step", 0.0, None)
    assert one.amplitude == pytest.approx(0.8)
    assert one.start_uncertainty == pytest.approx(0.02)
