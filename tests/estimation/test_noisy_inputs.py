"""Noise of the inputs as their calm parts show it, and what it does to an estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from generator.injected_actuator import play
from motion_case import TRUCK, TRUE, coloured, layer_of, records
from numpy.typing import NDArray
from plane_truck import inputs
from scipy.signal import freqz, lfilter

from ident.estimation.input_noise import INPUTS
from ident.estimation.motion_scores import Projection
from ident.estimation.noise import AutoRegression
from ident.estimation.noisy_inputs import disturbance
from ident.estimation.own_noise import OwnNoise, own_noise
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_records import MotionRecord

Array = NDArray[np.float64]

POLES, STD = (0.55, 0.18), 6e-5  # of the innovations [rad]
WIDTH = 0.006  # [rad]


def noise_of(count: int, seed: int) -> Array:
    drawn = np.random.default_rng(seed).standard_normal(count + 500)
    return np.asarray(lfilter([STD], [1.0, *(-pole for pole in POLES)], drawn)[500:])


def held(one: MotionRecord, number: int) -> Array:
    """The same stamps with an angle that is held, moved over half a second, and held again."""
    seconds = one.times - one.times[0]
    steps = np.random.default_rng(number).uniform(-0.08, 0.08, 8)
    place = np.clip((seconds % 5.0) / 0.5, 0.0, 1.0)
    blend = place**2 * (3.0 - 2.0 * place)
    index = (seconds // 5.0).astype(int)
    return np.asarray(steps[index % 8] + (steps[(index + 1) % 8] - steps[index % 8]) * blend)


def test_the_colour_of_an_input_is_that_of_its_noise_and_not_of_its_motion() -> None:
    given = [
        replace(one, road_wheel_angle=held(one, number) + noise_of(one.times.size, number))
        for number, one in enumerate(records(count=6, seconds=40.0))
    ]
    found = next(one for one in own_noise(given) if one.name == "road_wheel_angle")
    frequencies = 2 * np.pi * np.array([0.5, 2.0, 5.0]) * given[0].period
    told = found.std * np.abs(freqz([1.0], [1.0, *-found.shape.coefficients], frequencies)[1])
    true = STD * np.abs(freqz([1.0], [1.0, *(-pole for pole in POLES)], frequencies)[1])
    assert told == pytest.approx(true, rel=0.25)


def test_an_exact_input_has_next_to_no_noise() -> None:
    given = [
        replace(one, road_wheel_angle=held(one, number), speed=np.full(one.times.size, 9.0))
        for number, one in enumerate(records(count=2, seconds=40.0))
    ]
    assert all(one.std * one.shape.total_over_innovations() < 1e-7 for one in own_noise(given))


NOISE = OwnNoise("road_wheel_angle", AutoRegression(np.array(POLES)), STD, INPUTS["road_wheel_angle"])


def point_of(
    given: Sequence[MotionRecord],
    keys: tuple[str, ...],
    values: dict[str, float],
    noises: Sequence[OwnNoise] = (),
) -> VehiclePoint:
    """At parameters; the noise of its inputs is given, which never rest here, where it could be read."""
    layer = layer_of(given)
    layer.__dict__["own_noise"] = list(noises)
    problem = layer.problem(keys)
    shared = np.array([one.coordinate({**TRUE, **values}[one.name]) for one in problem.coordinates])
    of_runs = np.zeros((problem.windows.runs, len(problem.run_terms)))
    return VehiclePoint(problem, shared, of_runs, problem.initial_local, coloured(problem))


def noisy(one: MotionRecord, seed: int, sign: float = 1.0) -> MotionRecord:
    return replace(one, road_wheel_angle=one.road_wheel_angle + sign * noise_of(one.times.size, seed))


def information_of(point: VehiclePoint) -> Array:
    triangle = point.triangle()[: point.shared.size, :-1]
    return np.asarray(triangle.T @ triangle)


def moved(point: VehiclePoint, other: VehiclePoint) -> Array:
    """(s,) step that makes up for what the other's inputs change in the outputs, to first order."""
    change = {name: (white - point.white_errors[name])[:, None] for name, white in other.white_errors.items()}
    scores = Projection(point).shared_scores(change).sum(axis=0)[:, 0]
    return np.asarray(np.linalg.solve(information_of(point), scores))


def test_a_smooth_model_is_not_shifted_and_its_scores_scatter_as_the_draws_say() -> None:
    clean = records(count=3, seconds=30.0)
    point = point_of(clean, (), {})
    inverse = np.linalg.inv(information_of(point))
    found = disturbance(point, [NOISE])
    told = np.sqrt(np.diag(inverse @ found.scores.scatter.sum(axis=0) @ inverse))
    steps = [
        moved(point, point_of([noisy(r, 1000 * seed + k) for k, r in enumerate(clean)], (), {}))
        for seed in range(40)
    ]
    assert told == pytest.approx(np.std(steps, axis=0, ddof=1), rel=0.35)
    assert not found.scores.mean.any()


def test_a_play_scatters_and_is_shifted_as_the_draws_say() -> None:
    clean = records(count=4, seconds=40.0)
    keys, loose = ("steering_linkage_play",), {"linkage_play": WIDTH}
    point, seen, shift, spread = point_of(clean, keys, loose), [], [], []
    place = [one.name for one in point.problem.coordinates].index("linkage_play")
    for seed in range(14):
        pair = [
            point_of([noisy(r, 100 * seed + k, sign) for k, r in enumerate(clean)], keys, loose, [NOISE])
            for sign in (1.0, -1.0)
        ]
        seen += [float(moved(point, other)[place]) for other in pair]
        if seed < 4:
            found, inverse = disturbance(pair[0], [NOISE]), np.linalg.inv(information_of(pair[0]))
            shift.append(-float((inverse @ found.scores.mean.sum(axis=0))[place]))
            covariance = inverse @ found.scores.scatter.sum(axis=0) @ inverse
            spread.append(float(np.sqrt(covariance[place, place])))
    of_pairs = np.mean(np.reshape(seen, (-1, 2)), axis=1)
    assert abs(np.mean(seen)) > 4 * np.std(of_pairs, ddof=1) / np.sqrt(of_pairs.size), "there is a shift"
    assert np.mean(shift) == pytest.approx(np.mean(seen), rel=0.3)
    assert np.mean(spread) == pytest.approx(np.std(seen, ddof=1), rel=0.3)


def test_a_play_is_not_wider_by_the_noise_of_a_wheel_that_is_turned_and_held() -> None:
    given = []
    for number in range(3):
        _, speed = inputs(40.0, seed=number)
        angle = held(TRUCK.drive(np.zeros(speed.size), speed, run=number), number)
        driven = TRUCK.drive(play(angle, WIDTH), speed, run=number, seed=number)
        noise = noise_of(angle.size, 1000 + number)
        given.append(replace(driven, road_wheel_angle=angle + noise))
    fit = layer_of(given).fitted(("steering_linkage_play",)).renoised()
    width = fit.estimates()["steering_linkage_play"].parameters["width"]
    assert width.std < 0.005 * WIDTH
    assert abs(width.value - WIDTH) < min(3 * width.std, 0.005 * WIDTH)
