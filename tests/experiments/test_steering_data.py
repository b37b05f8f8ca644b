"""Which signals make the steering data of a run, and which parts of it are followed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.experiments.steering_data import choose_pair, steering_run, why_not_excited
from ident.results import RunHealth
from ident.signals.signal import Run, Signal

Array = NDArray[np.float64]

TIME = np.arange(0, 20, 0.02)
STEP = np.where(TIME >= 5, 0.5, 0.0)
ANSWER = 0.5 * (1 - np.exp(-np.maximum(TIME - 5.1, 0) / 0.3))


def signal(name: str, values: Array, time: Array = TIME, *, raw: bool = False) -> Signal:
    return Signal(name, time, np.asarray(values, dtype=np.float64), "rad", raw=raw)


def run(*signals: Signal, name: str = "run") -> Run:
    health = RunHealth(name, "MCAP", "", 20.0, "", "", [], {}, [])
    return Run(name, 0, 20.0, {one.name: one for one in signals}, None, health)


REQUEST = signal("steering_wheel_request", STEP)
MEASURED = signal("steering_wheel_angle", ANSWER)
ROAD = (signal("road_wheel_request", STEP), signal("road_wheel_angle", ANSWER))


def test_the_pair_that_most_runs_have_is_chosen() -> None:
    wheel, road = run(REQUEST, MEASURED), run(*ROAD)
    assert choose_pair([wheel]) == "steering_wheel"
    assert choose_pair([road, road, wheel]) == "road_wheel"
    assert choose_pair([run(REQUEST, MEASURED, *ROAD)]) == "steering_wheel"


def test_half_pairs_are_refused_with_what_there_is() -> None:
    with pytest.raises(
        NotIdentifiable, match=r"in 2 runs: found road_wheel_angle, steering_wheel_request, need"
    ):
        choose_pair([run(REQUEST), run(ROAD[1])])
    with pytest.raises(NotIdentifiable, match="in 1 run: found neither, need"):
        choose_pair([run()])


def test_what_a_run_lacks_is_told() -> None:
    assert steering_run(run(REQUEST), "steering_wheel") == "no steering_wheel_angle"
    told = steering_run(run(), "road_wheel")
    assert told == "no road_wheel_request and no road_wheel_angle"


def test_a_raw_count_is_no_request() -> None:
    raw = signal("steering_wheel_request", STEP, raw=True)
    assert steering_run(run(raw, MEASURED), "steering_wheel") == (
        "steering_wheel_request is a raw count: give its unit in channels.yaml"
    )


def test_an_angle_that_never_moves_is_told() -> None:
    still = signal("steering_wheel_angle", 0 * TIME + 0.3)
    assert steering_run(run(REQUEST, still), "steering_wheel") == (
        "the measured angle stays at 0.3 rad while the request changes"
    )


def test_signals_that_never_overlap_are_told() -> None:
    later = signal("steering_wheel_angle", ANSWER, TIME + 100)
    assert "never overlap" in str(steering_run(run(REQUEST, later), "steering_wheel"))


def test_a_constant_request_excites_nothing_and_its_level_is_told() -> None:
    constant = signal("steering_wheel_request", 0 * TIME + 0.25)
    found = steering_run(
        run(constant, signal("steering_wheel_angle", 0.25 + 0.001 * np.sin(TIME))), "steering_wheel"
    )
    assert not isinstance(found, str)
    assert found.excited == []
    assert why_not_excited(found) == "the request is constant: 0.25 rad"


def followed(**flags: Array) -> list[tuple[float, float]]:
    """First and last command of each stretch, with flags at 10 Hz."""
    time = np.arange(0, 20, 0.1)
    switches = [signal(name, values, time) for name, values in flags.items()]
    found = steering_run(run(REQUEST, MEASURED, *switches), "steering_wheel")
    if isinstance(found, str):
        return []
    return [(round(s.command_times[0], 2), round(s.command_times[-1], 2)) for s in found.stretches]


TENTHS = np.arange(200) / 10


def test_only_what_is_engaged_is_used() -> None:
    on = ((TENTHS >= 2) & (TENTHS < 8)) | (TENTHS >= 12)
    assert followed(engaged=on.astype(float)) == [(2.0, 7.98), (12.0, 19.98)]


def test_what_the_driver_overrides_is_left_out() -> None:
    override = ((TENTHS >= 6) & (TENTHS < 9)).astype(float)
    assert followed(driver_override=override) == [(0.0, 5.98), (9.0, 19.98)]


def test_engaged_and_overridden_is_not_followed() -> None:
    on = (TENTHS >= 2).astype(float)
    override = ((TENTHS >= 6) & (TENTHS < 9)).astype(float)
    assert followed(engaged=on, driver_override=override) == [(2.0, 5.98), (9.0, 19.98)]


def test_a_run_that_is_never_engaged_has_no_data() -> None:
    assert followed(engaged=0 * TENTHS) == []
