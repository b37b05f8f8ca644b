"""Residuals of the vehicle model: their derivatives are exact, and elimination hides nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plane_truck import BODY, INERTIA, PlaneTruck, inputs, magic

from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import compiled
from ident.estimation.coordinates import Coordinate, RunTerm
from ident.estimation.noise import AutoRegression, NoiseModel
from ident.estimation.tyre_fit import BANK, SENSOR_BIAS, coordinates_of
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_problem import (
    ACROSS,
    ALONG,
    STEERING_RATIO,
    VehicleProblem,
)
from ident.estimation.vehicle_records import Samples, Windows, cut

KIND = "magic_formula"
TRUCK = PlaneTruck(magic(328e3, 45e3, 1.35, -0.4), magic(417e3, 51e3, 1.35, -0.5))
TRUE = {
    "front.cornering_stiffness": 328e3,
    "front.peak_force": 45e3,
    "front.shape": 1.35,
    "front.curvature": -0.4,
    "rear.cornering_stiffness": 417e3,
    "rear.peak_force": 51e3,
    "rear.shape": 1.35,
    "rear.curvature": -0.5,
    "yaw_inertia": INERTIA,
    "steering_offset": 0.0,
    STEERING_RATIO: 1.0,
}
GIVEN = {"mass": BODY.mass, "cg_to_front_axle": 2.38, "cg_to_rear_axle": 2.12}
NAMES = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", ALONG, ACROSS)


@cache
def records(seconds=16.0):
    return [
        TRUCK.drive(*inputs(seconds, seed=run), run=run, seed=run, pose=(0.4 + 2 * run, 30.0, -80.0))
        for run in range(2)
    ]


def problem_of(given, *, window=8.0, ratio=True, bank=True):
    coordinates = coordinates_of(KIND, BODY)
    if ratio:
        coordinates.append(Coordinate(STEERING_RATIO, logarithmic=False))
    terms = [RunTerm(name, std) for name, std in SENSOR_BIAS.items()]
    terms += [RunTerm(name, std) for name, std in BANK.items()] if bank else []
    windows = Windows([part for one in given for part in cut(one, window)])
    fixed = GIVEN if bank else GIVEN | dict.fromkeys(BANK, 0.0)
    return VehicleProblem(compiled(bicycle(KIND, KIND)), windows, coordinates, fixed, terms)


def coordinates_at(problem, values):
    return np.array([one.coordinate(values[one.name]) for one in problem.coordinates])


def colour(problem):
    """Noise with colour of its own for each signal."""
    sizes = (0.0015, 0.04, 0.012, 0.001, 0.01, 0.01)
    shapes = ([0.5], [0.8], [], [0.7, -0.1], [0.9], [0.3])
    made = {
        n: NoiseModel(AutoRegression(np.array(a)), s) for n, s, a in zip(NAMES, sizes, shapes, strict=True)
    }
    return {name: made[name] for name in problem.compared}


def generic_point(problem, seed=3):
    """A point at which no parameter has a special value."""
    random = np.random.default_rng(seed)
    shared = coordinates_at(problem, TRUE) + 0.03 * random.standard_normal(len(problem.coordinates))
    of_runs = problem.run_std * random.standard_normal((problem.windows.runs, problem.run_std.size)) * 0.3
    local = problem.initial_local
    local = local + 0.02 * random.standard_normal(local.shape)
    return VehiclePoint(problem, shared, of_runs, local, colour(problem))


def difference(at, size):
    """Central differences of fourth order of every residual of at(step)."""
    steps = {h: at(h * size).residuals for h in (-2, -1, 1, 2)}
    return {
        name: (
            8 * (steps[1][name].residual - steps[-1][name].residual)
            - (steps[2][name].residual - steps[-2][name].residual)
        )
        / (12 * size)
        for name in steps[1]
    }


@pytest.fixture(scope="module")
def point():
    return generic_point(problem_of(records()))


def test_the_generic_point_has_everything_in_it(point):
    assert sorted(point.problem.compared) == sorted(NAMES)
    assert point.problem.anchors == 0  # each window is one part
    assert [term.name for term in point.problem.run_terms] == [*SENSOR_BIAS, *BANK]
    assert point.problem.local == 5
    assert [one.name for one in point.problem.coordinates] == list(TRUE)


def check_column(point, column, moved):
    """The column of every signal is minus the derivative of its residual."""
    for name, change in difference(moved, 1e-3).items():
        scale = np.abs(change).max()
        found = point.residuals[name].columns[:, column]
        assert found == pytest.approx(-change, rel=1e-6, abs=1e-6 * scale + 1e-10), name


@pytest.mark.parametrize("name", list(TRUE)[:-1])
def test_derivatives_to_what_all_runs_share_are_exact(point, name):
    k = list(TRUE).index(name)
    unit = np.eye(len(TRUE))[k]
    column = point.problem.local + point.problem.run_std.size + k
    check_column(point, column, lambda step: replace(point, shared=point.shared + step * unit))


def test_the_derivative_to_the_steering_ratio_is_that_of_a_smaller_angle(point):
    """The ratio stands before the model: the angle falls with it, and nothing else depends on it."""
    ratio = replace(point, shared=np.append(point.shared[:-1], 1.0))

    def moved(step):
        given = [replace(one, road_wheel_angle=one.road_wheel_angle / (1 + step)) for one in records()]
        return replace(ratio, problem=problem_of(given))

    check_column(ratio, -2, moved)


@pytest.mark.parametrize("name", [*SENSOR_BIAS, *BANK])
def test_derivatives_to_the_terms_of_the_runs_are_exact(point, name):
    k = [term.name for term in point.problem.run_terms].index(name)
    unit = np.eye(point.problem.run_std.size)[k]  # of both runs at once: a sample sees its own alone
    moved = point.problem.local + k
    check_column(point, moved, lambda step: replace(point, of_runs=point.of_runs + step * unit))


def test_the_terms_of_a_run_do_not_touch_the_other(point):
    away = replace(point, of_runs=point.of_runs + np.array([[0.01], [0.0]]))
    for name, one in point.residuals.items():
        other = point.problem.windows.run[one.samples.window] == 1
        assert np.array_equal(away.residuals[name].residual[other], one.residual[other])
        assert not np.allclose(away.residuals[name].residual[~other], one.residual[~other], atol=1e-5)


@pytest.mark.parametrize("k", range(5))
def test_derivatives_to_the_initial_states_are_exact(point, k):
    unit = np.eye(point.problem.local)[k]
    check_column(point, k, lambda step: replace(point, local=point.local + step * unit))


@pytest.mark.parametrize("k", range(3))
def test_derivatives_to_the_moves_and_turns_of_later_parts_of_a_path_are_exact(k):
    point = generic_point(problem_of(records(), window=100.0, ratio=False, bank=False))
    assert point.problem.anchors == 3  # two parts
    unit = np.eye(point.problem.local)[5 + k]
    check_column(point, 5 + k, lambda step: replace(point, local=point.local + step * unit))


def test_a_part_of_the_path_that_is_moved_and_turned_as_a_whole_leaves_no_residual():
    truth = PlaneTruck(TRUCK.front, TRUCK.rear).drive(*inputs(24.0))
    problem = problem_of([truth], window=100.0, ratio=False, bank=False)
    x, y = (truth.measured[name] for name in ("position_x", "position_y"))
    late, turn = x.times >= 12.0, 1e-3
    first = np.flatnonzero(late)[0]
    dx, dy = x.values - x.values[first], y.values - y.values[first]
    broken = {
        **truth.measured,
        "position_x": Samples(x.times, np.where(late, x.values + 2.0 - turn * dy, x.values)),
        "position_y": Samples(y.times, np.where(late, y.values - 1.0 + turn * dx, y.values)),
    }
    for given, most in ((truth, 1e-5), (replace(truth, measured=broken), 1e-4)):
        problem = problem_of([given], window=100.0, ratio=False, bank=False)
        point = VehiclePoint(
            problem,
            coordinates_at(problem, TRUE),
            np.zeros((1, problem.run_std.size)),
            problem.initial_local,
            colour(problem),
        )
        for _ in range(3):
            point = point.moved(np.zeros(point.shared.size))
        for name in (ALONG, ACROSS):
            left = point.residuals[name].residual
            assert np.sqrt(np.mean(left**2)) < most, name


def test_another_noise_needs_nothing_simulated_again_and_weighs_the_same():
    point = generic_point(problem_of(records(), ratio=False))
    assert np.isfinite(point.value)
    assert point.triangle().size
    other = {name: replace(one, std=2.5 * one.std) for name, one in point.noise.items()}
    kept, anew = point.with_noise(other), replace(point, noise=other)
    assert kept.outputs is point.outputs
    assert kept.residuals is point.residuals
    assert kept.value == pytest.approx(anew.value, rel=1e-12)
    assert kept.value < point.value
    np.testing.assert_allclose(np.abs(kept.triangle()), np.abs(anew.triangle()), rtol=1e-9, atol=1e-9)


def test_from_a_point_whose_derivatives_are_no_numbers_no_step_leads_on():
    point = generic_point(problem_of(records(), ratio=False))
    assert point.smooth
    broken = replace(point)
    name = next(iter(point.white))
    rows = point.white[name].copy()
    rows[3, 0] = np.inf
    broken.__dict__["white"] = {**point.white, name: rows}
    assert not broken.smooth
    assert np.isfinite(broken.value)


def test_elimination_gives_the_step_and_the_covariance_of_one_large_least_squares_problem():
    point = generic_point(problem_of(records(), ratio=False))
    problem = point.problem
    rows, target = dense(point)
    scale = np.linalg.norm(rows, axis=0)
    expected = np.linalg.lstsq(rows / scale, target, rcond=None)[0] / scale
    size = point.shared.size
    triangle = point.triangle()
    step = np.linalg.solve(triangle[:size, :size], triangle[:size, -1])
    moved = point.wholly_moved(step)
    at = np.cumsum([0, problem.local * len(problem.windows.records), problem.run_std.size * 2])
    inverse = np.linalg.inv((rows / scale).T @ (rows / scale)) / np.outer(scale, scale)
    std = np.sqrt(np.diag(inverse))
    gained = np.concatenate(
        [(moved.local - point.local).ravel(), (moved.of_runs - point.of_runs).ravel(), step]
    )
    assert gained / std == pytest.approx(expected / std, abs=1e-4)
    bread = np.linalg.inv(triangle[:size, :size])
    assert (bread @ bread.T) / np.outer(std[at[2] :], std[at[2] :]) == pytest.approx(
        inverse[at[2] :, at[2] :] / np.outer(std[at[2] :], std[at[2] :]), abs=1e-5
    )
    for run in range(2):
        own = slice(at[1] + run * problem.run_std.size, at[1] + (run + 1) * problem.run_std.size)
        found = point.by_run[run].own_covariance(bread @ bread.T)
        assert found / np.outer(std[own], std[own]) == pytest.approx(
            inverse[own, own] / np.outer(std[own], std[own]), abs=1e-5
        )


def dense(point):
    """All rows [states of every window | terms of every run | shared] with the priors, and their target."""
    problem, windows = point.problem, point.problem.windows
    local, terms, size = problem.local, problem.run_std.size, point.shared.size
    width = local * len(windows.records) + terms * windows.runs + size
    blocks, targets = [], []
    for name, one in point.residuals.items():
        white = point.white[name]
        block = np.zeros((len(white), width))
        for window in range(len(windows.records)):
            own = one.samples.window == window
            run = int(windows.run[window])
            block[own, local * window : local * (window + 1)] = white[own, :local]
            begin = local * len(windows.records) + terms * run
            block[own, begin : begin + terms] = white[own, local : local + terms]
        block[:, -size:] = white[:, local + terms : -1]
        blocks.append(block)
        targets.append(white[:, -1])
    return _with_priors(point, blocks, targets, width)


def _with_priors(point, blocks, targets, width):
    problem = point.problem
    priors = [problem.initial_std.ravel(), np.tile(problem.run_std, problem.windows.runs), problem.prior_std]
    away = [
        *((problem.initial_local - point.local).ravel(), -point.of_runs.ravel()),
        problem.prior_mean - point.shared,
    ]
    weight = 1 / np.concatenate(priors)  # nothing where there is none
    assert weight.size == width
    return np.vstack([*blocks, np.diag(weight)]), np.concatenate([*targets, weight * np.concatenate(away)])


def test_the_value_is_the_sum_of_squares_of_those_rows():
    point = generic_point(problem_of(records(), ratio=False))
    _, target = dense(point)
    assert point.value == pytest.approx(target @ target, rel=1e-12)


def test_positions_whose_stamps_differ_are_not_compared_across_each_other():
    (one, _) = records()
    x = one.measured["position_x"]
    later = Samples(x.times[1:], x.values[1:])
    shifted = Samples(np.append(x.times[1:], x.times[-1]), x.values)
    for other in (later, shifted):
        problem = problem_of([replace(one, measured={**one.measured, "position_x": other})])
        assert ALONG not in problem.compared
        assert ACROSS not in problem.compared
        assert np.isfinite(generic_point(problem).value)


def test_without_a_heading_the_windows_start_along_the_path():
    (one, _) = records()
    kept = {name: one.measured[name] for name in ("position_x", "position_y", "yaw_rate")}
    problem = problem_of([replace(one, measured=kept)])
    (true,) = (one.measured["heading"],)
    for window, state in zip(problem.windows.records, problem.initial_local, strict=True):
        heading = np.interp(window.times[0], true.times, true.values)
        error = (state[2] - heading + np.pi) % (2 * np.pi) - np.pi
        assert abs(error) < 0.15


def test_initial_states_are_those_of_the_centre_of_gravity():
    truth = TRUCK.drive(*inputs(24.0))
    problem = problem_of([truth])
    states, _ = problem.simulate(
        coordinates_at(problem, TRUE), np.zeros((1, problem.run_std.size)), problem.initial_local
    )
    first = problem.windows.offsets[1:-1]  # at the very start the truck is not yet turning, in a jump
    turn = np.interp(problem.windows.times[first], truth.times, truth.measured["yaw_rate"].values)
    drift = np.interp(problem.windows.times[first], truth.times, truth.measured["lateral_velocity"].values)
    assert states[first, 0] == pytest.approx(drift + 2.12 * turn, abs=0.02)
    assert states[first, 1] == pytest.approx(turn, abs=0.01)
