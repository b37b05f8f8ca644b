"""Effects in the fit of the motion: exact derivatives alone and together; probes that agree with them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from motion_case import TRUE, layer_of, point_at, records

from ident.estimation.motion_effects import LATE, motion_effects
from ident.estimation.motion_effects import testable as reason_against
from ident.estimation.motion_fit import MotionFit
from ident.estimation.motion_layer import MotionLayer
from ident.estimation.motion_starts import settled
from ident.estimation.vehicle_inputs import Probe
from ident.estimation.vehicle_point import VehiclePoint

DELAY = 0.0337  # [s] no multiple of the grid
SIZES = {  # coordinate -> value at which derivatives are looked at
    "steering_offset": 0.004,
    "bank_cos": 0.02,
    "bank_sin": -0.03,
    "linkage_play": 0.004,
    **{f"delay.{name}": DELAY for name in (*LATE, "road_wheel_angle")},
    "tyre_relaxation.length": 0.6,
    "load_transfer.sensitivity": 0.5,
    "load_transfer.front_share": 0.4,
    "body_roll.gain": 0.011,
    "body_roll.frequency": 5.0,
    "body_roll.damping": 0.25,
    "steering_ratio_nonlinearity.cubic": 0.12,
    "steering_ratio_nonlinearity.quadratic": -0.05,
    "wheel_speed_scale.scale": 0.02,
}
ALONE = {"sensor_latency yaw_rate", "sensor_latency lateral_acceleration"}  # the inertial unit has them both
TOGETHER = tuple(key for key in motion_effects() if key not in ALONE)
SHARED = [name for name in SIZES if name not in {"delay.yaw_rate", "delay.lateral_acceleration"}]
PLAY = 1e-6  # relative step over which a play has hardly a kink


@cache
def layer() -> MotionLayer:
    return layer_of(records())


@cache
def point_with(*keys: str) -> VehiclePoint:
    return point_at(layer().problem(keys), TRUE | SIZES, seed=4)


def change_with(point: VehiclePoint, step: np.ndarray) -> dict[str, np.ndarray]:
    """Derivative of the modelled signals along a step of the shared coordinates, by central differences."""
    more, less = (replace(point, shared=point.shared + sign * step).residuals for sign in (1, -1))
    twice, back = (replace(point, shared=point.shared + 2 * sign * step).residuals for sign in (1, -1))
    return {
        name: -(
            8 * (more[name].residual - less[name].residual) - (twice[name].residual - back[name].residual)
        )
        / 12
        for name in more
    }


def assert_exact(point: VehiclePoint, name: str) -> None:
    number = [one.name for one in point.problem.coordinates].index(name)
    size = PLAY if name == "linkage_play" else 1e-4 * max(abs(point.shared[number]), 0.03)
    changes = change_with(point, size * np.eye(point.shared.size)[number])
    column = point.problem.local + len(point.problem.run_terms) + number
    assert max(np.abs(change).max() for change in changes.values()) > 0
    for signal, change in changes.items():
        exact = point.residuals[signal].columns[:, column]
        scale = max(1.0, np.abs(exact).max())
        assert exact == pytest.approx(change / size, abs=3e-6 * scale), signal


@pytest.mark.parametrize("name", [*TRUE, *SHARED])
def test_derivatives_are_exact_with_all_effects_at_once(name: str) -> None:
    assert_exact(point_with(*TOGETHER), name)


@pytest.mark.parametrize("key", ["sensor_latency yaw_rate", "sensor_latency lateral_acceleration"])
def test_derivatives_to_the_delay_of_one_sensor_are_exact(key: str) -> None:
    point = point_with(key)
    (coordinate,) = motion_effects()[key].coordinates
    assert_exact(point, coordinate.name)
    (signal,) = motion_effects()[key].needs
    column = point.problem.local + len(point.problem.run_terms) + point.shared.size - 1
    touched = {name for name, one in point.residuals.items() if np.any(one.columns[:, column])}
    assert touched == {signal}


def test_every_coordinate_of_every_effect_was_looked_at() -> None:
    names = {c.name for effect in motion_effects().values() for c in effect.coordinates}
    assert names == set(SIZES)


def test_the_inertial_unit_and_the_gyro_may_be_late_by_different_delays() -> None:
    problem = layer().problem(["sensor_latency inertial_unit", "sensor_latency yaw_rate"])
    point = point_at(problem, TRUE | SIZES | {"delay.yaw_rate": 0.05})
    own = point.problem.local + len(problem.run_terms) + point.shared.size
    touched = [
        {name for name, one in point.residuals.items() if np.any(one.columns[:, column])}
        for column in (own - 2, own - 1)
    ]
    assert touched == [{"lateral_acceleration"}, {"yaw_rate"}]


def test_an_effect_is_testable_only_with_the_signals_that_it_needs() -> None:
    effects = motion_effects()
    both = [one for key, one in effects.items() if key == "sensor_latency inertial_unit"]
    assert "lateral_acceleration, which no run holds" in str(reason_against(both[0], ["yaw_rate", "heading"]))
    assert reason_against(both[0], ["yaw_rate", "lateral_acceleration"]) is None
    given = records()
    kept = ("yaw_rate", "heading")
    poor = [replace(one, measured={name: one.measured[name] for name in kept}) for one in given]
    made = layer_of(poor)
    refused = {one.what: one.reason for one in made.not_testable}
    assert set(refused) | set(made.effects) == set(effects)
    assert not set(refused) & set(made.effects)
    assert set(made.effects) >= {"steering_offset", "sensor_latency yaw_rate", "sensor_bias yaw_rate"}
    assert set(refused) >= {"sensor_bias lateral_acceleration", "antenna_offset lateral_velocity"}


# --- probes and directions -----------------------------------------------------------------------


@cache
def base() -> MotionFit:
    """A fit that lacks nothing, of runs without noise."""
    made = layer_of(records(noisy=False))
    return MotionFit(made, (), settled(point_at(made.problem(()))))


def disturbed(point: VehiclePoint, name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Residuals of a simulation in which an input is really disturbed."""
    problem = point.problem.with_changed()
    driven = problem.driven

    def pushed(shared: np.ndarray, of_runs: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        inputs, chain = driven(shared, of_runs)
        inputs = inputs.copy()
        inputs[:, problem.engine.inputs.index(name)] += values
        return inputs, chain

    problem.driven = pushed
    return {n: one.residual for n, one in replace(point, problem=problem).residuals.items()}


FORCES = ("front_lateral_force", "rear_lateral_force", "lateral_force", "bank_force", "yaw_moment")
PUSHES = {
    **{f"probe.{name}": 10.0 for name in FORCES},
    **dict.fromkeys(("probe.road_wheel_angle", "probe.front_slip_angle", "probe.rear_slip_angle"), 1e-5),
    "road_wheel_angle": 1e-5,
    "longitudinal_velocity": 1e-3,
}


@pytest.mark.parametrize("name", PUSHES)
def test_a_probe_does_what_a_simulation_does_that_is_disturbed(name: str) -> None:
    point = replace(base().point, local=base().point.local + 0.01)
    times = point.problem.windows.times
    values = PUSHES[name] * np.sin(1.9 * times + 0.4)
    probed = point.problem.probed(point.shared, point.of_runs, point.local, [Probe({name: values})])
    more, less = disturbed(point, name, values), disturbed(point, name, -values)
    assert set(probed) == set(more)
    for signal, columns in probed.items():
        change = (less[signal] - more[signal]) / 2
        assert columns[:, 0] == pytest.approx(change, abs=2e-4 * np.abs(change).max() + 1e-12), signal


def test_a_probe_of_a_signal_touches_it_alone_and_of_a_place_along_and_across() -> None:
    point = base().point
    samples = point.problem.windows.signals
    turn = np.cos(samples["yaw_rate"].times)
    east = np.ones(samples["position_x"].times.size)
    probes = [Probe(signals={"yaw_rate": turn}), Probe(signals={"position_x": east})]
    seen = point.problem.probed(point.shared, point.of_runs, point.local, probes)
    assert np.array_equal(seen["yaw_rate"], np.column_stack([turn, 0 * turn]))
    path = np.column_stack([seen["position_along"][:, 1], seen["position_across"][:, 1]])
    assert np.linalg.norm(path, axis=1) == pytest.approx(1.0)
    touched = {name for name, columns in seen.items() if np.any(columns)}
    assert touched == {"yaw_rate", "position_along", "position_across"}


SMALL = {  # coordinate -> what the truck has: the shape that is tried with these values has to explain it
    "steering_offset": 4e-4,
    "bank_cos": 2e-3,
    "bank_sin": 3e-3,
    "linkage_play": 2e-3,
    **{f"delay.{name}": 0.005 for name in (*LATE, "road_wheel_angle")},
    "tyre_relaxation.length": 0.5,
    "load_transfer.sensitivity": 0.05,
    "load_transfer.front_share": 0.35,
    "body_roll.gain": 0.01,
    "body_roll.frequency": 4.5,
    "body_roll.damping": 0.15,
    "steering_ratio_nonlinearity.cubic": 0.02,
    "steering_ratio_nonlinearity.quadratic": 0.01,
    "wheel_speed_scale.scale": 0.002,
}
BY_RUN = (0.002, 0.001)  # of the terms of the two runs
ROUGH = {
    "tyre_relaxation": (0.15, 0.97),
    "body_roll": (0.05, 0.95),
    "sensor_latency steering_angle": (0.03, 0.99),
}


@pytest.mark.parametrize("key", motion_effects())
def test_the_direction_of_an_effect_is_what_it_does_and_its_size_is_told_in_its_unit(key: str) -> None:
    """Against a truth with the effect, of which the fitted model without it is asked to first order."""
    fit = base()
    effect = fit.layer.effects[key]
    problem = fit.layer.problem([key])
    own = {one.name: SMALL[one.name] for one in effect.coordinates}
    truth = fit.layer._point(problem, [key], fit, own)
    shared = [one.coordinate((fit.parameters | own)[one.name]) for one in problem.coordinates]
    truth = replace(truth, shared=np.array(shared))
    expected = [next(iter(own.values()), 0.0)]
    if effect.run_terms:
        expected = list(BY_RUN)
        terms = truth.of_runs.copy()
        terms[:, -1] = BY_RUN
        truth = replace(truth, of_runs=terms)
    # the residual of the truth is minus what the effect does: the roles are exchanged
    scores = directions().scores(truth)
    shape = next(
        s for s in group_of(scores, key).shapes if len(s.columns) >= len(expected) and agrees(s, own)
    )
    columns = list(shape.columns)
    total = -scores.scores.sum(axis=0)[columns]
    found = np.linalg.solve(scores.gram[np.ix_(columns, columns)], total)
    wrong, explained = ROUGH.get(key, (0.01, 0.999))
    assert found[: len(expected)] == pytest.approx(expected, rel=wrong)
    assert total @ found > explained * scores.power.sum()


@cache
def directions():
    return base().directions()


def group_of(scores, key):
    return next(group for group in scores.groups if group.key == key)


def agrees(shape, own):
    """Whether the values that a shape holds are those of the truck, by their short names."""
    given = {name.rpartition(".")[2]: value for name, value in own.items()}
    given |= {"width": own["linkage_play"]} if "linkage_play" in own else {}
    return all(given[name.rpartition(".")[2]] == value for name, value in shape.at.items())


def test_without_noise_nothing_is_left_of_a_right_model() -> None:
    scores = directions().scores()
    assert scores.power.sum() < 0.2  # of 3162 samples of six signals, in units of their noise
    assert np.abs(scores.scores.sum(axis=0) / np.sqrt(np.maximum(np.diag(scores.gram), 1e-12))).max() < 0.2


def test_residuals_alone_are_those_that_come_with_their_derivatives() -> None:
    point = point_with(*TOGETHER)
    alone = point.problem.errors(point.outputs, point.shared, point.of_runs, point.local)
    assert list(alone) == list(point.residuals)
    for name, one in point.residuals.items():
        assert alone[name].columns.shape == (one.residual.size, 1)
        np.testing.assert_allclose(alone[name].residual, one.residual, rtol=0, atol=1e-12)
    assert point.window_sums.sum() < point.value < np.inf
