"""The actuator's residuals and derivatives against a superposition of step responses and complex steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from actuator_truth import derivatives, modelled
from numpy.typing import NDArray

from ident.estimation.actuator_likelihood import (
    SHORTEST_LAG_SHARE,
    ActuatorProblem,
    ActuatorRecord,
    without_unknown_head,
)

Array = NDArray[np.float64]

NO_LOSS = np.zeros(0, dtype=np.intp)
OVERDAMPED = np.array([0.9, 0.12, 0.33, 0.18, 0.03])
SHAPES = {
    "overdamped": OVERDAMPED,
    "underdamped": np.array([0.9, 0.12, 0.33, 0.6, 0.03]),
    "near critical": np.array([0.9, 0.12, 0.33, 0.2501, 0.03]),
    "near first order": np.array([0.9, 0.12, 0.33, SHORTEST_LAG_SHARE, 0.03]),
    "leading": np.array([1.1, -0.05, 0.33, 0.18, -0.2]),
}
LOCAL = np.array([0.1, 0.05, 0.02, -0.004])


def record(*, first_sample: float = 0.013, lost: NDArray[np.intp] = NO_LOSS, run: int = 0) -> ActuatorRecord:
    random = np.random.default_rng(0)
    sent = np.arange(150) * 0.02 + random.normal(0, 1e-3, 150)
    values = np.where(sent > 0.7, 0.5, 0.2) + 0.1 * np.sin(3 * sent)
    times = np.arange(first_sample, 3, 0.01)
    return ActuatorRecord(
        run=run,
        command_times=sent,
        command_values=values,
        times=times,
        measured=np.sin(times),
        starts=np.zeros(1, dtype=np.intp),
        lost=lost,
        start_uncertainty=0.01,
        rest_rate=0.05,
    )


def check(one: ActuatorRecord, shared: Array, local: Array) -> None:
    linear = ActuatorProblem([one]).linearise(shared, [local])[0]
    expected = one.measured - modelled(one, shared, local).real
    np.testing.assert_allclose(linear.residual, expected, rtol=0, atol=1e-11)
    by_shared, by_local = derivatives(one, shared, local)
    np.testing.assert_allclose(linear.shared, by_shared, rtol=0, atol=2e-9)
    np.testing.assert_allclose(linear.local, by_local, rtol=0, atol=2e-9)


@pytest.mark.parametrize("shared", SHAPES.values(), ids=SHAPES.keys())
def test_residual_and_all_derivatives_are_exact(shared: Array) -> None:
    check(record(), shared, LOCAL)


@pytest.mark.parametrize("shared", SHAPES.values(), ids=SHAPES.keys())
def test_the_value_of_a_lost_command_is_a_parameter_with_its_derivative(shared: Array) -> None:
    check(record(lost=np.array([40, 41, 90, 149])), shared, np.append(LOCAL, [0.3, 0.31, 0.5, 0.2]))


def test_a_first_command_that_acts_already_hides_what_was_before_it() -> None:
    late = record(first_sample=0.4)
    check(late, OVERDAMPED, LOCAL)
    linear = ActuatorProblem([late]).linearise(OVERDAMPED, [LOCAL])[0]
    np.testing.assert_array_equal(linear.local[:, 2:4], 0.0)


def test_every_run_has_its_own_bias() -> None:
    records = [record(run=1), record(run=0), record(run=1)]
    shared = np.array([0.9, 0.12, 0.33, 0.18, 0.03, -0.5])
    linear = ActuatorProblem(records).linearise(shared, [LOCAL] * 3)
    for one, own in zip(linear, (1, 0, 1), strict=True):
        np.testing.assert_array_equal(one.shared[:, 4 + own], 1.0)
        np.testing.assert_array_equal(one.shared[:, 5 - own], 0.0)
    np.testing.assert_allclose(linear[0].residual - linear[1].residual, 0.53, rtol=0, atol=1e-13)


def test_the_simulation_is_the_measurement_less_its_residual() -> None:
    one = record()
    simulated = ActuatorProblem([one]).simulate(OVERDAMPED, [LOCAL])[0]
    np.testing.assert_allclose(simulated, modelled(one, OVERDAMPED, LOCAL).real, rtol=0, atol=1e-12)


def test_the_fit_begins_at_rest_at_the_first_measured_angle() -> None:
    one = record(lost=np.array([40]))
    start = ActuatorProblem([one]).start(OVERDAMPED)[0]
    expected = [one.measured[0] - 0.03, 0, 0, 0, 0.9 * one.command_values[40]]
    np.testing.assert_allclose(start, expected, rtol=0, atol=1e-15)


def test_priors_hold_what_rest_and_the_period_say_and_nothing_else() -> None:
    one = record(lost=np.array([40]))
    prior = ActuatorProblem([one]).linearise(OVERDAMPED, [np.append(LOCAL, 0.3)])[0]
    np.testing.assert_allclose(prior.prior, [np.inf, 0.05, 0.025, 0.01, np.inf])
    np.testing.assert_allclose(prior.prior_residual[1:4], -LOCAL[1:])
    moving = replace(one, rest_rate=np.inf, start_uncertainty=np.inf)
    free = ActuatorProblem([moving]).linearise(OVERDAMPED, [np.append(LOCAL, 0.3)])[0]
    assert np.all(np.isinf(free.prior))


def test_parameters_stay_where_they_mean_something() -> None:
    problem = ActuatorProblem([record()])
    np.testing.assert_allclose(problem.inside(np.array([-1, 5, 1e-9, 0, 99])), [-1, 2, 1e-3, 1e-4, 99])
    np.testing.assert_allclose(problem.inside(np.array([0.5, -3, 90, 70, 0])), [0.5, -0.2, 20, 25, 0])
    assert problem.inside(OVERDAMPED) == pytest.approx(OVERDAMPED, abs=0)


def test_the_head_of_a_record_in_motion_is_left_out_up_to_the_dead_time() -> None:
    moving = replace(record(), rest_rate=np.inf, starts=np.array([0, 10, 150]))
    rest = without_unknown_head(moving, 0.3)
    assert rest.times[0] >= moving.command_times[0] + 0.3
    assert rest.times[0] - 0.01 < moving.command_times[0] + 0.3
    removed = moving.times.size - rest.times.size
    np.testing.assert_array_equal(rest.measured, moving.measured[removed:])
    np.testing.assert_array_equal(rest.starts, [0, 150 - removed])


def test_a_record_at_rest_keeps_its_head() -> None:
    assert without_unknown_head(record(), 0.3).times.size == record().times.size
