"""Levels against logs: on a run of the sample truck, and on a log that one of our controllers has made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from validate_case import MODEL, write_model

from ident.control.closed_loop import Disturbance, Settings, run
from ident.control.controllers import CONTROLLERS
from ident.control.plant import Plant
from ident.control.scenarios import scenario
from ident.control.speed_profile import SpeedLimits
from ident.model_file import read_model
from ident.results import LoggedLevel
from ident.signals.run import LoadedLogs
from ident.stages.inputs import InputSettings, load
from ident.stages.output import Context
from ident.stages.validate_levels import Logged
from ident.stages.validate_logged import open_levels
from ident.stages.validate_logged_data import followed_runs
from ident.stages.validate_settings import ACCEPTABLE
from ident.stages.validate_shadow import closed, closed_level, shadow
from ident.stages.validate_stretch import LoggedStretch, stretches_of
from ident.stages.validate_truck import Believed, believed

SAMPLES = Path(__file__).parents[2] / "sample_logs"
PERIOD = 0.05


@pytest.fixture(scope="module")
def logs() -> LoadedLogs:
    return load([SAMPLES], InputSettings(runs=["path_b"]), Context("c", "d"))


def truck_of(folder: Path, text: str = MODEL) -> Believed:
    return believed(read_model(write_model(folder, text)), "model")


def levels(logs: LoadedLogs, truck: Believed) -> list[LoggedLevel]:
    (followed,), refused = followed_runs(logs, InputSettings().align, None, truck)
    assert refused == []
    return open_levels(followed, truck, [], ACCEPTABLE)


def test_a_model_like_the_truck_agrees_where_the_controller_drove(logs: LoadedLogs, tmp_path: Path) -> None:
    first, second = levels(logs, truck_of(tmp_path))
    assert (first.agrees, second.agrees) == (True, True)
    assert set(second.rms) == {*first.rms, "road_wheel_angle"}
    (followed,), _ = followed_runs(logs, InputSettings().align, None, truck_of(tmp_path))
    spans = [(part.times[0], part.times[-1]) for part in followed.records]
    assert np.allclose(spans, [(8.0, 27.0), (36.0, 55.0)], atol=0.2)  # engaged, as the generator was told


def test_stops_at_the_vehicle_where_its_tyres_are_wrong(logs: LoadedLogs, tmp_path: Path) -> None:
    wrong = MODEL.replace("value: 400000.0", "value: 120000.0")
    first, second = levels(logs, truck_of(tmp_path, wrong))
    assert (first.agrees, second.agrees) == (False, None)
    assert first.reason is not None
    assert second.reason == f"level 0 does not agree: {first.reason}"


def test_stops_at_the_actuator_where_its_dead_time_is_wrong(logs: LoadedLogs, tmp_path: Path) -> None:
    late = MODEL.replace("value: 0.1173", "value: 0.35")
    first, second = levels(logs, truck_of(tmp_path, late))
    assert (first.agrees, second.agrees) == (True, False)
    assert second.reason is not None
    assert "road wheel angle rms" in second.reason


def test_the_logged_path_and_errors_are_those_of_the_rear_axle(logs: LoadedLogs, tmp_path: Path) -> None:
    truck = truck_of(tmp_path)
    (followed,), _ = followed_runs(logs, InputSettings().align, None, truck)
    made, refused = stretches_of(followed, truck, PERIOD)
    assert (len(made), refused) == (2, [])
    stretch, signals = made[0], followed.run.signals
    assert stretch.reference.tracked_x == -2.12
    at = {name: np.interp(stretch.cycles, s.time, s.values) for name, s in signals.items()}
    angle = at["reference_heading"]
    across = np.cos(angle) * (at["position_y"] - at["reference_y"]) - np.sin(angle) * (
        at["position_x"] - at["reference_x"]
    )
    inner = slice(20, -20)
    assert np.ptp(across[inner]) > 0.5
    assert np.allclose(stretch.lateral_error[inner], across[inner], atol=0.05)


def test_a_path_that_leads_backwards_is_refused(logs: LoadedLogs, tmp_path: Path) -> None:
    truck = truck_of(tmp_path)
    (followed,), _ = followed_runs(logs, InputSettings().align, None, truck)
    signals = dict(followed.run.signals)
    wanted = signals["reference_heading"]
    signals["reference_heading"] = replace(wanted, values=wanted.values + np.pi)
    back = replace(followed, run=replace(followed.run, signals=signals))
    made, refused = stretches_of(back, truck, PERIOD)
    assert made == []
    assert len(refused) == 2
    assert all("m backwards: take another run" in one.reason for one in refused)


def test_points_of_the_path_without_a_number_are_told(logs: LoadedLogs, tmp_path: Path) -> None:
    truck = truck_of(tmp_path)
    (followed,), _ = followed_runs(logs, InputSettings().align, None, truck)
    signals = dict(followed.run.signals)
    values = signals["reference_x"].values.copy()
    values[values.size // 4 : values.size // 4 + 3] = np.nan
    signals["reference_x"] = replace(signals["reference_x"], values=values)
    holed = replace(followed, run=replace(followed.run, signals=signals))
    made, _ = stretches_of(holed, truck, PERIOD)
    assert any("3 of " in text and "points without a number" in text for one in made for text in one.lost)
    told = Logged(stretches=made).warnings
    assert len(told) == sum(len(one.lost) for one in made)
    assert all(text.startswith(f"{followed.run.name}, path: ") for text in told)


@pytest.fixture(scope="module")
def own_log(tmp_path_factory: pytest.TempPathFactory) -> tuple[Believed, LoggedStretch]:
    """A log whose controller, truck and path are known: Stanley in a slalom."""
    truck = truck_of(tmp_path_factory.mktemp("own"))
    path = scenario("truncated_slalom", truck.truck, SpeedLimits(15.0, 2.5))
    course = run(
        Plant(truck.truck), CONTROLLERS["stanley"](truck.truck, PERIOD), path, Disturbance(0.3), Settings()
    )
    assert course.completed
    at = {name: np.interp(course.cycles, course.times, values) for name, values in course.states.items()}
    errors = [
        np.interp(course.cycles, course.times, values)
        for values in (course.arc_length, course.lateral_error, course.heading_error)
    ]
    request = np.array([one.steering_request for one in course.commands])
    acceleration = np.array([one.acceleration_request for one in course.commands])
    place = at["position_x"], at["position_y"], at["heading"]
    return truck, LoggedStretch(
        "own", 0, path, (), course.cycles, course.measured, request, acceleration, *place, *errors
    )


def test_the_logged_controller_is_told_from_another(own_log: tuple[Believed, LoggedStretch]) -> None:
    truck, stretch = own_log
    same, other = (
        shadow(name, CONTROLLERS[name](truck.truck, PERIOD), stretch) for name in ("stanley", "lqr")
    )
    assert np.allclose(same.request, stretch.request, atol=1e-9)
    assert same.level().agrees
    assert not other.level().agrees
    assert other.share > 0.1


def test_the_closed_loop_repeats_its_own_log(own_log: tuple[Believed, LoggedStretch]) -> None:
    truck, stretch = own_log
    controller = CONTROLLERS["stanley"](truck.truck, PERIOD)
    level = closed_level("stanley", closed(controller, Plant(truck.truck), stretch, 0), stretch, 0.05, 0.0)
    assert level.agrees
    assert level.rms["lateral_error"] < 1e-6


def test_the_closed_loop_on_another_truck_does_not(own_log: tuple[Believed, LoggedStretch]) -> None:
    truck, stretch = own_log
    late = replace(truck.truck, steering=replace(truck.truck.steering, dead_time=0.4))
    controller = CONTROLLERS["stanley"](truck.truck, PERIOD)
    level = closed_level("stanley", closed(controller, Plant(late), stretch, 0), stretch, 0.05, 0.0)
    assert level.agrees is False
    assert level.reason is not None
