"""Directions freed of what a fit takes up, against one large least-squares problem; bins lose nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from motion_case import COLOUR, TRUE, layer_of, point_at, records

from ident.estimation.coordinates import RunTerm
from ident.estimation.layer import BIN
from ident.estimation.motion_scores import Projection, add_to_bins
from ident.estimation.vehicle_inputs import Probe
from ident.estimation.vehicle_point import VehiclePoint

TIGHT = 5e-5  # [rad] of the prior of the heading: about as much as a window tells of it
KEYS = ("sensor_bias yaw_rate", "road_bank", "sensor_latency yaw_rate")


@cache
def point() -> VehiclePoint:
    """Two runs in two windows each, with terms of the runs, off the minimum."""
    values = TRUE | {"bank_cos": 0.01, "bank_sin": -0.01, "delay.yaw_rate": 0.013}
    layer = replace(layer_of(records()), base_terms=(RunTerm("heading", TIGHT),))
    return point_at(layer.problem(KEYS), values, seed=2)


@cache
def projection() -> Projection:
    return Projection(point())


@cache
def probes() -> list[Probe]:
    """Twenty: more than the engine carries at once."""
    windows = point().problem.windows
    times, read = windows.times, windows.signals["yaw_rate"].times
    made = [Probe({"probe.yaw_moment": 2e3 * np.sin(k * times)}) for k in np.linspace(0.3, 6, 12)]
    made += [Probe({"probe.road_wheel_angle": 1e-3 * np.cos(k * times)}) for k in (0.5, 1.5, 4.0, 9.0)]
    made += [Probe(signals={"yaw_rate": 1e-3 * np.sin(k * read)}) for k in (0.2, 1.0, 3.0)]
    both = {"probe.lateral_force": 1e3 * np.sign(np.sin(times))}
    return [*made, Probe(both, {"yaw_rate": 1e-3 * np.cos(2 * read)})]


@cache
def combined() -> np.ndarray:
    """Every probe alone, and two sums of some."""
    made = np.hstack([np.eye(20), np.zeros((20, 2))])
    made[[0, 5, 17], 20] = 1.0, -2.0, 0.5
    made[[12, 19], 21] = 1.0, 1.0
    return made


@cache
def directions():
    return projection().directions(probes(), combined())


def rows_of(of_signal, number) -> np.ndarray:
    """Rows of one window, signal after signal."""
    made = []
    for name, one in point().residuals.items():
        own = one.samples.window == number
        made.append(of_signal[name][own])
    return np.concatenate(made)


def white(columns: np.ndarray, name: str, window: np.ndarray) -> np.ndarray:
    """First differences of a signal whose noise is correlated from sample to sample within windows."""
    correlation, size = COLOUR[name]
    made = columns.copy()
    made[1:] -= correlation * columns[:-1]
    first = np.flatnonzero(np.diff(window, prepend=-1))
    made[first] = columns[first] * np.sqrt(1 - correlation**2)
    return made / size


@cache
def dense() -> np.ndarray:
    """All rows [states of every window | terms of every run, by their priors | shared]."""
    problem, blocks = point().problem, []
    local, terms = problem.local, len(problem.run_terms)
    windows, runs = len(problem.windows.records), problem.windows.runs
    assert (windows, runs, terms) == (4, 2, 2)
    columns = {n: white(o.columns, n, o.samples.window) for n, o in point().residuals.items()}
    for number in range(windows):
        rows, run = rows_of(columns, number), int(problem.windows.run[number])
        block = np.zeros((len(rows), local * windows + terms * runs + point().shared.size))
        block[:, local * number : local * (number + 1)] = rows[:, :local]
        begin = local * windows + terms * run
        block[:, begin : begin + terms] = rows[:, local : local + terms] * problem.run_std
        block[:, local * windows + terms * runs :] = rows[:, local + terms : -1]
        blocks.append(block)
    return np.vstack(blocks)


def freed(columns: np.ndarray) -> np.ndarray:
    """Columns without what least squares explains of them; terms of the runs cost what their priors say."""
    rows, local = dense(), point().problem.local * 4
    prior = np.zeros((4, rows.shape[1]))
    prior[:, local : local + 4] = np.eye(4)
    tall = np.vstack([rows, prior])
    scale = np.linalg.norm(tall, axis=0)
    padded = np.vstack([columns, np.zeros((4, columns.shape[1]))])
    basis, _ = np.linalg.qr(tall / scale)
    return (padded - basis @ (basis.T @ padded))[: len(rows)]


@cache
def expected() -> np.ndarray:
    problem = point().problem
    parts = [
        problem.probed(point().shared, point().of_runs, point().local, probes()[begin : begin + 10])
        for begin in (0, 10)
    ]
    whitened = {
        n: white(np.hstack([part[n] for part in parts]) @ combined(), n, o.samples.window)
        for n, o in point().residuals.items()
    }
    return freed(np.vstack([rows_of(whitened, number) for number in range(4)]))


def test_directions_are_those_of_one_large_least_squares_problem() -> None:
    found = np.vstack(directions().rows)
    right = expected()
    size = np.linalg.norm(right, axis=0)
    assert size.min() > 0.1
    assert np.linalg.norm(found - right, axis=0) / size == pytest.approx(0.0, abs=1e-5)
    gram = right.T @ right
    assert directions().gram / np.outer(size, size) == pytest.approx(gram / np.outer(size, size), abs=1e-5)


def test_residuals_are_freed_of_the_same() -> None:
    residual = {n: white(o.columns, n, o.samples.window)[:, -1:] for n, o in point().residuals.items()}
    right = freed(np.vstack([rows_of(residual, number) for number in range(4)]))[:, 0]
    found = np.concatenate(projection().residuals())
    assert found == pytest.approx(right, abs=1e-4 * np.abs(right).max())


def test_scores_are_directions_times_residuals_and_bins_lose_nothing() -> None:
    left = projection().residuals()
    scores = directions().scores(left)
    size = np.sqrt(np.diag(directions().gram) * sum(float(one @ one) for one in left))
    right = np.vstack(directions().rows).T @ np.concatenate(left)
    assert scores.sum(axis=0) / size == pytest.approx(right / size, abs=1e-12)
    assert directions().energy.sum(axis=0) == pytest.approx(np.diag(directions().gram), rel=1e-9)
    power, count = projection().power()
    samples = [one.samples.times.size for one in point().residuals.values()]
    assert count.sum(axis=0).tolist() == samples
    squares = [float(one[:, -1] @ one[:, -1]) for one in point().white.values()]
    assert power.sum(axis=0) == pytest.approx(squares, rel=1e-12)
    assert projection().likelihood().values.sum() == pytest.approx(-sum(squares), rel=1e-12)
    assert projection().power(left)[0].sum() == pytest.approx(sum(float(one @ one) for one in left))


def test_every_sample_falls_into_the_bin_of_its_instant() -> None:
    bins, windows = projection().bins, point().problem.windows
    assert np.array_equal(bins.run, windows.run[bins.window])
    for number in range(4):
        times = np.concatenate(
            [one.samples.times[one.samples.window == number] for one in point().residuals.values()]
        )
        where = projection().bins_of_rows(number)
        assert np.all(bins.window[where] == number)
        assert np.abs(times - bins.time[where]).max() < BIN / 2 + 0.011  # the last bin may be cut off late
        own = bins.time[bins.window == number]
        assert np.diff(own) == pytest.approx(BIN)
        assert set(where) == set(np.flatnonzero(bins.window == number))


def test_means_over_bins_are_those_of_the_grid() -> None:
    windows = point().problem.windows
    assert projection().mean(np.full(windows.times.size, 3.0)) == pytest.approx(3.0)
    ramp = projection().mean(windows.times)
    inner = np.diff(projection().bins.window, append=9, prepend=9) == 0
    assert ramp[inner[1:] & inner[:-1]] == pytest.approx(
        projection().bins.time[inner[1:] & inner[:-1]], abs=0.01
    )


def test_rows_are_added_where_they_belong_also_several_at_once() -> None:
    total = np.ones((4, 2))
    add_to_bins(total, np.array([3, 0, 3, 3]), np.arange(8.0).reshape(4, 2))
    assert total.tolist() == [[3.0, 4.0], [1.0, 1.0], [1.0, 1.0], [1.0 + 0 + 4 + 6, 1.0 + 1 + 5 + 7]]


def test_what_the_fit_takes_up_has_no_score() -> None:
    """A probe that does what a shared parameter does is one of the fit: zero throughout, and not nearly."""
    windows, problem = point().problem.windows, point().problem
    name = "delay.yaw_rate"
    number = [one.name for one in problem.coordinates].index(name)
    column = problem.local + len(problem.run_terms) + number
    late = Probe(signals={"yaw_rate": point().residuals["yaw_rate"].columns[:, column]})
    angle = Probe({"probe.bank_force": -np.cos(trajectory("heading"))})  # what the bank of the model does
    other = Probe({"probe.yaw_moment": 1e3 * np.sin(windows.times)})
    made = projection().directions([late, angle, other], np.eye(3))
    scores = made.scores(projection().residuals())
    for gone in (0, 1):
        assert not made.energy[:, gone].any()
        assert not made.gram[gone].any()
        assert not scores[:, gone].any()
    assert made.gram[2, 2] > 1.0


def trajectory(name: str) -> np.ndarray:
    problem = point().problem
    states, _ = problem.simulate(point().shared, point().of_runs, point().local)
    return states[:, problem.engine.states.index(name)]


def test_a_term_of_the_runs_leaves_what_its_prior_keeps_back() -> None:
    """A term that the data hardly know better than its prior does is taken up in part only."""
    read = point().problem.windows.signals["heading"].window
    values = np.where(point().problem.windows.run[read] == 0, TIGHT, 0.0)
    made = projection().directions([Probe(signals={"heading": values})], np.eye(1))
    columns = {n: np.zeros((o.samples.times.size, 1)) for n, o in point().residuals.items()}
    columns["heading"] = white(values[:, None], "heading", read)
    rows = np.vstack([rows_of(columns, number) for number in range(4)])
    left = float(np.sum(freed(rows) ** 2))
    assert made.gram[0, 0] == pytest.approx(left, rel=1e-6)
    assert 0.01 * float(np.sum(rows**2)) < left < 0.95 * float(np.sum(rows**2))
