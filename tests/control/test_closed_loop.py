"""The loop: how runs begin and end, what a controller is given, and what is the same twice."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from bench_case import Held, Steers, circle, direct, straight, truck

from ident.control.closed_loop import Disturbance, Settings, run, start_on
from ident.control.controllers import CONTROLLERS
from ident.control.disturbances import changed
from ident.control.measures import measure
from ident.control.plant import Plant
from ident.control.sensors import Sensors
from ident.errors import BadRecipe
from ident.model_file import SignalNoise

ROAD = straight(20.0, 200.0)


def test_an_undisturbed_run_arrives_when_it_should():
    loop = run(Plant(truck()), Held(), ROAD)
    assert loop.completed
    assert loop.outcome == "completed"
    assert loop.arrival_time == pytest.approx(10.0, abs=1e-9)
    assert np.all(loop.lateral_error == 0.0)
    assert loop.cycles.size == len(loop.commands) == len(loop.diagnostics) == loop.dropped.size == 200
    assert np.all(np.diff(loop.times) > 0)


def test_a_run_begins_beside_the_road_as_it_was_disturbed():
    road = replace(circle(0.01, 15.0, 50.0), tracked_x=1.5)
    begin = Disturbance(lateral_error=0.5, heading_error=0.05, speed=-1.0)
    loop = run(Plant(truck("kinematic")), Held(), road, begin)
    assert loop.lateral_error[0] == pytest.approx(0.5, abs=1e-9)
    assert loop.heading_error[0] == pytest.approx(0.05, abs=1e-9)
    assert loop.states["longitudinal_velocity"][0] == pytest.approx(14.0)
    assert loop.arc_length[0] == pytest.approx(0.0, abs=1e-9)


def test_a_start_on_a_curve_is_in_steady_motion_at_the_cg():
    road = replace(
        circle(0.01, 15.0, 50.0),
        tracked_x=2.0,
        yaw_rate=np.full(101, 0.15),
        lateral_velocity=np.full(101, 0.2),
        heading_error=np.full(101, -0.013),
        road_wheel_angle=np.full(101, 0.05),
    )
    start = start_on(road, Disturbance())
    assert start.lateral_velocity == pytest.approx(0.2 - 2.0 * 0.15)
    assert start.heading == pytest.approx(-0.013)
    assert start.road_wheel_angle == 0.05
    ride = Plant(truck()).begin(start)
    assert ride.now["road_wheel_angle"] == pytest.approx(0.05, abs=1e-12)


@pytest.mark.parametrize(
    ("controller", "road", "settings", "outcome"),
    [
        (Held(1.0), ROAD, Settings(), "left_the_lane"),
        (Held(0.0, -3.0), ROAD, Settings(patience=0.5, grace=0.0), "too_late"),
        (Held(float("nan")), ROAD, Settings(), "no_command"),
    ],
)
def test_a_path_is_lost_in_a_way_that_is_told(controller, road, settings, outcome):
    loop = run(Plant(truck()), controller, road, settings=settings)
    assert loop.outcome == outcome
    assert not loop.completed
    assert loop.arrival_time is None
    assert measure(loop).arrival_time_error is None
    assert all(np.isfinite(value) for value in vars(measure(loop)).values() if value is not None)


def test_a_truck_at_the_centre_of_the_curve_has_no_place_on_the_path():
    road, inwards = circle(0.2, 5.0, 60.0), Disturbance(heading_error=np.pi / 2)
    loop = run(Plant(truck("kinematic")), Held(), road, inwards, Settings(lateral_limit=50.0))
    assert loop.outcome == "folded"
    assert loop.lateral_error[-1] == pytest.approx(5.0, abs=0.3)


def test_a_model_that_blows_up_ends_the_run_and_is_measured_up_to_there():
    """An oversteering truck beyond its critical speed, with tyres without limit."""
    wild = direct("linear", parameters={**truck().parameters, "rear.cornering_stiffness": 2e3})
    loop = run(Plant(wild), Held(0.05), straight(30.0, 3000.0), settings=Settings(lateral_limit=1e9))
    assert loop.outcome in {"blew_up", "folded", "too_late"}
    assert np.isfinite(measure(loop).lateral_error_max)


def test_dropped_commands_leave_the_last_one_in_force():
    settings = Settings(dropped=0.4, seed=3)
    loop = run(Plant(direct("kinematic")), Steers(ratio=1.0), ROAD, Disturbance(0.5), settings)
    assert 0.3 < np.mean(loop.dropped) < 0.5
    asked = np.array([one.steering_request for one in loop.commands])
    in_force = np.maximum.accumulate(np.where(loop.dropped, -1, np.arange(asked.size)))
    expected = np.where(in_force < 0, 0.0, asked[np.maximum(in_force, 0)])
    stands = np.interp(loop.cycles + 0.04, loop.times, loop.states["steering_angle"])
    np.testing.assert_allclose(stands, expected, atol=1e-9)
    assert np.any(loop.dropped & (np.abs(asked - expected) > 1e-6))


def test_the_same_seed_gives_the_same_run_and_drops_do_not_move_the_noise():
    noise = {"yaw_rate": SignalNoise(0.01), "position_y": SignalNoise(0.05, [0.7], 0.02)}
    plant = Plant(truck(), Sensors(noise=noise))

    def driven(**settings):
        return run(plant, Steers(), ROAD, Disturbance(0.5), Settings(**settings))

    first, again, other = driven(seed=4), driven(seed=4), driven(seed=5)
    np.testing.assert_array_equal(first.lateral_error, again.lateral_error)
    assert np.max(np.abs(first.lateral_error[:500] - other.lateral_error[:500])) > 1e-4
    dropping = driven(seed=4, dropped=0.3)
    noises = [
        [one.position_y - left for one, left in zip(loop.measured, at_cycles(loop), strict=True)][:50]
        for loop in (first, dropping)
    ]
    np.testing.assert_allclose(noises[0], noises[1], atol=1e-9)


def at_cycles(loop):
    return np.interp(loop.cycles, loop.times, loop.states["position_y"])


def test_measures_converge_with_the_step_of_the_integration():
    steps = (0.025, 0.0125, 0.00625, 0.001)
    names = ("lateral_error_rms", "lateral_error_max", "lateral_acceleration_max", "acceleration_work")
    found = []
    for step in steps:
        loop = run(Plant(truck("magic_formula"), step=step), Steers(), ROAD, Disturbance(0.8, 0.03, -1.0))
        assert loop.completed
        found.append([getattr(measure(loop), name) for name in names])
    away = np.abs(np.array(found[:-1]) / np.array(found[-1]) - 1)
    assert np.all(away[-1] < 1e-4), away
    assert np.all(away[-1] < away[0] / 4), away


def test_a_loop_can_be_sent_to_another_process():
    parts = (Plant(truck()), Steers(), ROAD, Disturbance(0.5), Settings())
    here = run(*parts)
    there = pickle.loads(pickle.dumps(run(*pickle.loads(pickle.dumps(parts)))))
    np.testing.assert_array_equal(here.lateral_error, there.lateral_error)


def test_refuses_settings_without_meaning():
    for made in (lambda: Settings(dropped=1.0), lambda: Settings(lateral_limit=0.0)):
        with pytest.raises(BadRecipe, match="need"):
            made()
    with pytest.raises(BadRecipe, match="period of 0 s"):
        run(Plant(truck()), Held(period=0.0), ROAD)


def plain(thing, above=()):
    """All numbers and names that can be reached from an object, as nested tuples that compare by value."""
    if isinstance(thing, str | int | float | bool | bytes) or thing is None:
        return thing
    if isinstance(thing, np.ndarray):
        return thing.shape, thing.tobytes()
    if id(thing) in above:
        return "again"
    above = (*above, id(thing))
    if isinstance(thing, Mapping):
        found = tuple((str(key), plain(value, above)) for key, value in thing.items())
    elif isinstance(thing, list | tuple | set | frozenset):
        found = tuple(plain(value, above) for value in thing)
    elif type(thing).__module__.startswith("ident") and hasattr(thing, "__dict__"):
        found = plain(vars(thing), above)
    else:
        found = ()
    return type(thing).__name__, found


@pytest.mark.parametrize("name", ["pid", "lqr"])
def test_no_controller_sees_a_number_of_the_simulated_truck(name):
    """The simulated truck changes; whatever the controller holds is the same, and so is what it answers."""
    believed = truck("linear")
    before = plain(believed)
    controllers = [CONTROLLERS[name](believed, 0.05) for _ in range(2)]
    made = [plain(controllers[0])]
    simulated = deepcopy(believed)
    heavier = changed(simulated, {"mass": 0.3, "stiffness": -0.2, "dead_time": 0.07, "ratio": 0.05})
    plants = [Plant(simulated), Plant(heavier)]
    made.append(plain(controllers[0]))
    loops = [
        run(plant, controller, ROAD, Disturbance(0.3))
        for plant, controller in zip(plants, controllers, strict=True)
    ]
    assert made[0] == made[1]
    assert plain(believed) == before
    assert np.max(np.abs(loops[0].lateral_error[:800] - loops[1].lateral_error[:800])) > 1e-3
    for controller in controllers:
        controller.reset()
    answers = [[one.step(told, ROAD)[0] for told in loops[1].measured] for one in controllers]
    assert answers[0] == answers[1] == list(loops[1].commands)


def test_a_controller_is_given_measurements_and_the_reference_only():
    given = []

    class Watching(Held):
        def step(self, *arguments):
            given.append(arguments)
            return super().step(*arguments)

    simulated = truck()
    loop = run(Plant(simulated), Watching(), ROAD)
    assert len(given) == loop.cycles.size
    assert all(reference is ROAD for _, reference in given)
    assert {type(measured).__name__ for measured, _ in given} == {"Measured"}
    assert all(isinstance(value, float) for measured, _ in given for value in vars(measured).values())
