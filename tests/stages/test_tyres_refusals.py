"""What `ident tyres` cannot answer is refused in one line: what was found, what is needed, what to do."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from motion_runs import changed, truck_run, with_signals

from ident.cli import main
from ident.errors import NotIdentifiable
from ident.signals.run import LoadedLogs
from ident.signals.signal import Run
from ident.stages.inputs import AlignSettings
from ident.stages.tyre_data import tyre_data

MEASURED = Path(os.environ.get("IDENT_MEASURED", Path(__file__).parents[2] / "../shared/measured"))
LEAST_SPEED = 3.0


def gathered(*runs: Run):
    return tyre_data(LoadedLogs(list(runs), [], [], []), AlignSettings(), None, LEAST_SPEED)


def no_mass(run: Run) -> Run:
    return replace(run, vehicle=replace(run.vehicle, mass=None))


def no_steering(run: Run) -> Run:
    return with_signals(run, steering_wheel_angle=None)


def no_ratio(run: Run) -> Run:
    return replace(run, vehicle=replace(run.vehicle, steering_ratio=None))


def no_speed(run: Run) -> Run:
    return with_signals(run, speed=None, longitudinal_velocity=None)


def nothing_that_turns(run: Run) -> Run:
    return with_signals(run, yaw_rate=None, heading=None, lateral_acceleration=None)


def straight(run: Run) -> Run:
    small = {name: lambda _, values: 0.01 * values for name in ("steering_wheel_angle", "yaw_rate")}
    still = {name: lambda _, values: 0.0 * values for name in ("lateral_acceleration", "lateral_velocity")}
    return with_signals(changed(run, **small, **still), heading=None, position_x=None, position_y=None)


def wrong_sign(run: Run) -> Run:
    return changed(run, steering_wheel_angle=lambda _, values: -values)


def degrees(run: Run) -> Run:
    return changed(run, steering_wheel_angle=lambda _, values: np.rad2deg(values))


def raw_counts(run: Run) -> Run:
    return with_signals(run, steering_wheel_angle=replace(run.signals["steering_wheel_angle"], raw=True))


def raw_speed(run: Run) -> Run:
    there = [name for name in ("speed", "longitudinal_velocity") if name in run.signals]
    return with_signals(run, **{name: replace(run.signals[name], raw=True) for name in there})


def crawling(run: Run) -> Run:
    names = [name for name in ("speed", "longitudinal_velocity") if name in run.signals]
    return changed(run, **{name: lambda _, values: 0.1 * values for name in names})


CASES: dict[str, tuple[Callable[[Run], Run], tuple[str, ...]]] = {
    "no mass": (no_mass, ("the vehicle file lacks mass", "only in ratio", "vehicle.yaml")),
    "no steering": (no_steering, ("no measured steering", "name the topic of road_wheel_angle")),
    "no steering ratio": (no_ratio, ("without a steering ratio", "state steering_ratio in vehicle.yaml")),
    "no speed": (no_speed, ("no speed", "name its topic and unit in channels.yaml")),
    "nothing that turns": (nothing_that_turns, ("nothing tells how the vehicle turns", "name the topic")),
    "straight driving": (straight, ("lateral acceleration stays below", "need 0.5 m/s²", "drive curves")),
    "wrong sign of the steering": (wrong_sign, ("the sign is turned", "road_wheel_angle in channels.yaml")),
    "degrees": (degrees, ("degrees taken as radians", "road_wheel_angle in channels.yaml")),
    "raw counts": (raw_counts, ("steering_wheel_angle is a raw count: give its unit in channels.yaml",)),
    "raw speed": (raw_speed, ("is a raw count", "channels.yaml")),
    "crawling": (crawling, ("no 3 s at 3 m/s or faster", "60.0 s slower than 3 m/s")),
}


@pytest.mark.parametrize(("make", "told"), CASES.values(), ids=CASES)
def test_refuses_in_one_line_that_says_what_to_do(make: Callable[[Run], Run], told: tuple[str, ...]) -> None:
    with pytest.raises(NotIdentifiable) as caught:
        gathered(make(truck_run()))
    message = str(caught.value)
    assert "\n" not in message
    for part in told:
        assert part in message


def test_the_unchanged_run_is_taken() -> None:
    assert [run.name for run in gathered(truck_run()).runs] == ["planar/planar_a"]


@pytest.mark.parametrize("make", [no_steering, raw_counts, wrong_sign, degrees])
def test_a_run_that_cannot_be_used_does_not_stop_the_others(make: Callable[[Run], Run]) -> None:
    other = replace(make(truck_run("planar/planar_b")), name="other")
    data = gathered(truck_run(), other)
    assert [run.name for run in data.runs] == ["planar/planar_a"]
    assert [one.what for one in data.left_out] == ["other"]
    assert data.left_out[0].reason


REAL = {
    "rhino_volvo_fh16": "no measured steering",
    "comma2k19_rav4": "the vehicle file lacks mass, cg_to_front_axle, cg_to_rear_axle",
    "kora_k3_bags": "no measured steering",
    "servo_miuzei": "the vehicle file lacks mass, cg_to_front_axle, cg_to_rear_axle",
}


@pytest.mark.parametrize(("name", "told"), REAL.items(), ids=REAL)
def test_measured_logs_that_hold_too_little_are_refused_with_exit_code_4(name, told, tmp_path) -> None:
    if not (MEASURED / name).is_dir():
        pytest.skip(f"no measured logs at {MEASURED}: set IDENT_MEASURED")
    done = CliRunner().invoke(
        main, ["tyres", str(MEASURED / name), "--out", str(tmp_path / "out"), "--quiet"]
    )
    assert done.exit_code == 4
    lines = [line for line in done.stderr.splitlines() if line]
    assert len(lines) == 1
    assert told in lines[0]
    assert "yaml" in lines[0]
    assert not (tmp_path / "out").exists()
