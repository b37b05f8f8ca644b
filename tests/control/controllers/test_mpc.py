"""The predictive controllers: their law, their limits, what they do when a program fails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench_case import BODY, RATIO, STEERING, STIFFNESS, circle, straight, truck
from scipy.linalg import expm, solve_discrete_are

from ident.control.controllers.controller import Measured
from ident.control.controllers.mpc_controller import PATIENCE
from ident.control.controllers.mpc_robust import mpc_robust
from ident.control.controllers.mpc_spatial import mpc_spatial, mpc_spatial_rate
from ident.control.controllers.mpc_time import mpc_time, mpc_time_kinematic
from ident.control.controllers.mpc_tubes import corrected_bounds
from ident.control.controllers.weights import ACCEPTABLE
from ident.control.many_points import ManyPoints
from ident.control.paths import lane_change_length, mirrored, single_lane_change
from ident.control.qp import Solution
from ident.control.qp_store import keeper, solve_alone
from ident.control.scenarios import reference
from ident.control.speed_profile import SpeedLimits
from ident.errors import NotIdentifiable

PERIOD = 0.05
SPEED = 21.0  # [m/s] one for which the terminal cost is made, so that nothing is interpolated
DYNAMIC = {
    "mpc_time": mpc_time,
    "mpc_spatial": mpc_spatial,
    "mpc_spatial_rate": mpc_spatial_rate,
    "mpc_robust": mpc_robust,
}
ALL = {**DYNAMIC, "mpc_time_kinematic": mpc_time_kinematic}
AT_ONCE = {"dead_time": 0.0}


@pytest.fixture(scope="module")
def controllers():
    """Made once: each is reset before it is used."""
    return {name: make(truck(**AT_ONCE), PERIOD) for name, make in ALL.items()}


def measured(time=0.0, **others):
    nothing = dict.fromkeys(Measured.__dataclass_fields__, 0.0)
    return Measured(**(nothing | {"time": time, "longitudinal_velocity": SPEED} | others))


def first(controller, told, road):
    controller.reset()
    return controller.step(told, road)


def riccati_gain():
    """K of Δu of a hand-written bicycle with its lags and its last request as a state (Rajamani, 2012)."""
    M, J, LF, LR = BODY.values()
    CF, CR = STIFFNESS.values()
    v, T1, T2 = SPEED, STEERING.time_constant_1, STEERING.time_constant_2
    A = np.zeros((6, 6))
    A[0, :2] = -(CF + CR) / (M * v), -v - (LF * CF - LR * CR) / (M * v)
    A[1, :2] = -(LF * CF - LR * CR) / (J * v), -(LF**2 * CF + LR**2 * CR) / (J * v)
    A[0, 4], A[1, 4] = CF / M / RATIO, LF * CF / J / RATIO
    A[2, 0], A[2, 3], A[3, 1], A[4, 5] = 1.0, v, 1.0, 1.0
    A[5, 4:] = -1 / (T1 * T2), -(T1 + T2) / (T1 * T2)
    joint = np.zeros((7, 7))
    joint[:6, :6], joint[5, 6] = A, STEERING.gain / (T1 * T2)
    step = expm(joint * PERIOD)  # the last row holds the request: it is the model with the request as a state
    change = step[:, 6:7]
    named = {2: "lateral_error", 3: "heading_error", 5: "steering_rate"}
    Q = np.zeros((7, 7))
    for place, name in named.items():
        Q[place, place] = PERIOD / (ACCEPTABLE[name] * (RATIO if place == 5 else 1.0)) ** 2
    R = np.array([[1.0 / PERIOD / (ACCEPTABLE["steering_request_rate"] * RATIO) ** 2]])
    P = solve_discrete_are(step, change, Q, R)
    return np.linalg.solve(R + change.T @ P @ change, change.T @ P @ step)[0]


@pytest.mark.parametrize("name", ["mpc_time", "mpc_spatial"])
def test_without_active_limits_the_request_is_that_of_the_riccati_equation(controllers, name):
    told = measured(position_y=0.05, heading=0.002, lateral_velocity=0.02, yaw_rate=-0.004)
    told = replace(told, steering_angle=0.01 * STEERING.gain)
    state = np.array([0.02, -0.004, 0.05 + SPEED * 0.0, 0.002, 0.01 * STEERING.gain, 0.0, 0.01])
    command, told_of = first(controllers[name], told, straight(SPEED, 400.0))
    assert told_of.solved
    assert command.steering_request == pytest.approx(0.01 - riccati_gain() @ state, rel=2e-3)
    assert command.acceleration_request == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(("left", "slow"), [(0.3, 0.0), (-0.6, 0.0), (0.4, 1.5)])
def test_time_and_space_agree_on_a_straight_road(controllers, left, slow):
    told = measured(position_y=left, longitudinal_velocity=SPEED - slow)
    road = straight(SPEED, 400.0)
    in_time, in_space = (first(controllers[name], told, road) for name in ("mpc_time", "mpc_spatial"))
    assert in_space[0].steering_request == pytest.approx(in_time[0].steering_request, rel=0.03)
    assert in_space[0].acceleration_request == pytest.approx(in_time[0].acceleration_request, abs=0.05)


@pytest.mark.parametrize("name", list(ALL))
def test_a_mirrored_road_is_answered_with_the_mirrored_request(controllers, name):
    limits = SpeedLimits(set_speed=SPEED)
    length = lane_change_length(limits.lateral_acceleration / SPEED**2)
    path = single_lane_change(length, lead_in=10.0, run_out=80.0)
    told = measured(position_x=12.0, position_y=0.3, heading=0.01, yaw_rate=0.02, steering_angle=0.1)
    other = replace(told, position_y=-0.3, heading=-0.01, yaw_rate=-0.02, steering_angle=-0.1)
    left, right = (
        first(controllers[name], state, reference(road, truck(), limits))[0]
        for state, road in ((told, path), (other, mirrored(path)))
    )
    assert left.steering_request == pytest.approx(-right.steering_request, rel=1e-3)
    assert left.acceleration_request == pytest.approx(right.acceleration_request, abs=1e-3)
    assert abs(left.steering_request) > 1e-3


def test_limits_of_angle_and_acceleration_hold_along_the_whole_plan(controllers):
    narrow = mpc_spatial(truck(highest_angle=0.01, **AT_ONCE), PERIOD)
    command, _ = first(
        narrow, measured(position_y=1.5, longitudinal_velocity=SPEED - 4), straight(SPEED, 400)
    )
    highest = 0.01 * RATIO / STEERING.gain
    assert command.steering_request == pytest.approx(-highest, rel=1e-6)
    assert np.abs(narrow._last.controls[:, 0]).max() <= highest * (1 + 1e-6)
    assert narrow._last.controls[:, 1].max() <= truck().drive.highest + 1e-6
    assert narrow._last.controls[:, 1].max() > 0.9 * truck().drive.highest


@pytest.mark.parametrize("speed", [8.0, 21.0])
def test_a_rate_limit_for_each_metre_is_one_in_time(speed):
    rate = 0.05
    limited = mpc_spatial_rate(truck(**AT_ONCE), PERIOD, steering_rate=rate)
    told = measured(position_y=1.0, longitudinal_velocity=speed)
    command, _ = first(limited, told, straight(speed, 300.0))
    plan = limited._last
    passed = np.diff(plan.states[:, 0])  # the plan's own time
    changes = np.diff(np.concatenate([[0.0], plan.controls[:, 0]])) * STEERING.gain / RATIO
    assert np.all(np.abs(changes) <= rate * passed * 1.01 + 1e-9)
    assert np.abs(changes[:3]) == pytest.approx(rate * PERIOD, rel=0.02)
    assert command.steering_request == pytest.approx(-rate * PERIOD * RATIO / STEERING.gain, rel=0.01)
    way = np.diff(plan.grid)
    assert way == pytest.approx(PERIOD * speed, rel=1e-9)


def test_a_truck_outside_its_lane_is_told_and_comes_back(controllers):
    _, told = first(controllers["mpc_time"], measured(position_y=1.4), straight(SPEED, 400.0))
    assert told.solved
    assert told.violation > 0.2
    _, inside = first(controllers["mpc_time"], measured(position_y=0.3), straight(SPEED, 400.0))
    assert inside.violation < 1e-6


def test_the_predicted_horizon_lies_on_the_road_that_is_followed(controllers):
    road = circle(1 / 300.0, 15.0, 400.0)
    angle = 0.1
    told = measured(
        position_x=300 * np.sin(angle),
        position_y=300 * (1 - np.cos(angle)),
        heading=angle,
        yaw_rate=0.05,
        longitudinal_velocity=15.0,
    )
    for name in ("mpc_time", "mpc_spatial"):
        _, diagnostics = first(controllers[name], told, road)
        assert diagnostics.horizon.shape == (41, 2)
        radius = np.hypot(diagnostics.horizon[:, 0], 300 - diagnostics.horizon[:, 1])
        assert radius == pytest.approx(300.0, abs=0.25)
        way = np.hypot(*np.diff(diagnostics.horizon, axis=0).T)
        assert way == pytest.approx(15.0 * PERIOD, rel=0.02)


# --- when a program fails ----------------------------------------------------------------------------


class Failing:
    """A solver that finds nothing."""

    def solve(self, _):
        return Solution(False, "max_iter_reached", None, 60, 0.0)


def test_the_last_plan_goes_on_and_then_the_regulator_steers(monkeypatch):
    controller, road = mpc_time(truck(**AT_ONCE), PERIOD), straight(SPEED, 400.0)
    by_plan, _ = controller.step(measured(position_y=0.05), road)
    planned = controller._last.controls.copy()
    assert by_plan.steering_request == pytest.approx(planned[0, 0])
    monkeypatch.setattr(controller, "_solver", Failing())
    told = [
        controller.step(measured(k * PERIOD, position_x=k * PERIOD * SPEED, position_y=0.05), road)
        for k in range(1, PATIENCE + 3)
    ]
    assert [d.fallback for _, d in told] == ["last_plan"] * PATIENCE + ["lqr"] * 2
    assert not any(d.solved for _, d in told)
    sent = [c.steering_request for c, _ in told[:PATIENCE]]
    assert sent == pytest.approx(planned[1 : PATIENCE + 1, 0])
    assert controller.failures == PATIENCE + 2
    controller.reset()
    assert controller.failures == 0


def test_without_a_plan_the_regulator_answers_what_the_program_would_have(monkeypatch, controllers):
    told, road = measured(position_y=0.1, heading=-0.004), straight(SPEED, 400.0)
    solved, _ = first(controllers["mpc_time"], told, road)
    failing = mpc_time(truck(**AT_ONCE), PERIOD)
    monkeypatch.setattr(failing, "_solver", Failing())
    command, diagnostics = failing.step(told, road)
    assert diagnostics.fallback == "lqr"
    assert command.steering_request == pytest.approx(solved.steering_request, rel=2e-3)


def test_limits_that_cannot_be_met_are_a_failure_that_is_counted():
    controller = mpc_time(truck(**AT_ONCE), PERIOD)
    controller.base.lowest_request, controller.base.highest_request = 1.0, 0.5
    _, diagnostics = controller.step(measured(), straight(SPEED, 400.0))
    assert not diagnostics.solved
    assert diagnostics.fallback == "lqr"
    assert diagnostics.extra["status"] in {"primal_infeasible", "max_iter_reached"}
    assert controller.failures == 1


def test_a_measurement_that_is_missing_keeps_the_requests_as_they_were(controllers):
    controller, road = controllers["mpc_spatial"], straight(SPEED, 400.0)
    before, _ = first(controller, measured(position_y=0.2), road)
    command, diagnostics = controller.step(measured(PERIOD, lateral_velocity=np.nan), road)
    assert diagnostics.fallback == "held"
    assert command == before
    assert controller.failures == 1


def test_every_program_of_a_run_can_be_stored_and_solved_again_alone(tmp_path):
    controller = mpc_spatial(truck(**AT_ONCE), PERIOD, keep=keeper(tmp_path, "mpc_spatial"))
    road, plans = straight(SPEED, 400.0), []
    for k in range(3):
        controller.step(measured(k * PERIOD, position_x=k * SPEED * PERIOD, position_y=0.4), road)
        plans.append(controller._last.controls[0])
    paths = sorted(tmp_path.iterdir())
    assert len(paths) == 3
    program, solution = solve_alone(paths[2])
    assert solution.solved
    assert program.violation(solution.z) < 1e-6
    assert program.cost(solution.z) == pytest.approx(
        controller.program.cost(controller._solver.solve(controller.program).z), rel=1e-7
    )


# --- the tube ----------------------------------------------------------------------------------------


def test_the_nominal_truck_keeps_tighter_limits_than_the_truck(controllers):
    road = straight(SPEED, 400.0)
    for name, expected in (("mpc_time", 1.0), ("mpc_robust", None)):
        controller = controllers[name]
        first(controller, measured(position_y=0.1), road)
        lane = controller.program.h_high[np.isfinite(controller.program.h_high)].max()
        assert expected is None or lane == pytest.approx(expected, abs=1e-9)
    robust = controllers["mpc_robust"]
    assert lane == pytest.approx(1.0 - robust._tubes.box(SPEED)[robust._aside])
    assert 0.02 < robust._tubes.box(SPEED)[robust._aside] < 0.6


def test_what_the_estimator_corrects_stays_within_the_bounds_of_the_residuals():
    noise = {
        "lateral_velocity": 0.012,
        "yaw_rate": 0.0015,
        "position_across": 0.012,
        "heading": 0.001,
        "steering_wheel_angle": 0.002,
    }
    controller = mpc_robust(truck(), PERIOD, noise=noise)
    estimator, names = controller.base.estimator, controller.prediction.states
    random, missed = np.random.default_rng(4), []
    for k in range(400):
        drawn = dict(zip(noise, random.standard_normal(5) * list(noise.values()), strict=True))
        at = {name: drawn[name] for name in ("lateral_velocity", "yaw_rate", "heading")}
        seen = measured(
            k * PERIOD,
            position_x=k * SPEED * PERIOD,
            position_y=drawn["position_across"],
            steering_angle=drawn["steering_wheel_angle"],
            **at,
        )
        expected = estimator.ahead(seen.time, 0.0) if k else None
        estimator.update(seen, 0.0)
        estimator.sent.add(seen.time, (0.0, 0.0))
        if k > 100:
            missed.append(estimator.state - expected)
    bounds = corrected_bounds(controller.prediction, PERIOD, noise)(SPEED)
    for name in ("lateral_velocity", "yaw_rate", "lateral_error", "heading_error", "steering_angle"):
        size = np.array(missed)[:, names.index(name)]
        assert np.mean(np.abs(size) <= bounds[name]) > 0.95, name
        assert bounds[name] < 4.0 * size.std(), name


def test_a_truck_beside_the_plan_is_pulled_back_and_one_outside_the_tube_begins_anew(controllers):
    robust, road = controllers["mpc_robust"], straight(SPEED, 400.0)
    first(robust, measured(), road)
    _, inside = robust.step(measured(PERIOD, position_x=SPEED * PERIOD, position_y=0.004), road)
    assert inside.extra["left_tube"] is False
    command, outside = robust.step(measured(2 * PERIOD, position_x=2 * SPEED * PERIOD, position_y=2.0), road)
    assert outside.extra["left_tube"] is True
    assert command.steering_request < -0.01


def test_residuals_that_leave_no_room_to_steer_are_refused():
    controller = mpc_robust(truck(**AT_ONCE), PERIOD, noise={"yaw_rate": 0.3})
    with pytest.raises(NotIdentifiable, match=r"tube takes .* rad of the steering request, need at most"):
        controller.step(measured(), straight(SPEED, 400.0))


# --- the model at many points ------------------------------------------------------------------------


def test_many_points_at_once_are_what_the_engine_gives_for_each(controllers):
    prediction = controllers["mpc_spatial"].prediction
    random = np.random.default_rng(0)
    x = 0.1 * random.standard_normal((30, len(prediction.states)))
    x[:, prediction.index["longitudinal_velocity"]] = random.uniform(5.0, 25.0, 30)
    u = 0.05 * random.standard_normal((30, len(prediction.engine.inputs)))
    p = prediction.parameters(-1.2)
    rates, A, B = ManyPoints(prediction.engine).jacobians(x, u, p)
    to_states, to_inputs, _ = prediction.engine.jacobians(x, u, p)
    np.testing.assert_allclose(rates, prediction.engine.rates(x, u, p), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(A, to_states, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(B, to_inputs, rtol=1e-11, atol=1e-12)
    with pytest.raises(ValueError, match="shapes"):
        ManyPoints(prediction.engine).jacobians(x, u[:10], p)
