"""The planar bicycle against closed forms, symmetry, energy, crawling and the truck of the sample logs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from generator.truth import Planar, load_truth
from generator.vehicle import STEP
from generator.vehicle import simulate as independent
from numpy.typing import NDArray
from vehicle_values import AT_CG, BODY, KINDS, LEVEL, MOUNTED, TILTED, segments, truck

from ident.dynamics.bicycle import CRAWL, bicycle, substeps_for
from ident.dynamics.engine import Engine, compiled
from ident.dynamics.tyres.magic_formula import from_bcde

Array = NDArray[np.float64]

EVERY = pytest.mark.parametrize("kind", KINDS)
MASS, INERTIA, L_F, L_R = BODY.values()
WHEELBASE = L_F + L_R
C_F, C_R = 3.3e5, 4e5
UNDERSTEER = MASS / WHEELBASE * (L_R / C_F - L_F / C_R)  # [rad s²/m]


def made(kind: str) -> Engine:
    return compiled(bicycle(kind, kind))


def driven(
    engine: Engine,
    values: dict[str, float],
    angle: Array,
    speed: Array,
    step: float,
    start: Array | None = None,
) -> tuple[Array, dict[str, Array]]:
    """States and outputs of one drive, with as many substeps as it needs."""
    steps = np.full(angle.size, step)
    parts = substeps_for(values, speed, steps)
    starts = np.zeros((1, 5)) if start is None else start[None, :]
    states, outputs = engine.simulate(
        starts,
        np.stack([angle, speed], axis=1),
        steps,
        [0, angle.size],
        engine.vector(values),
        substeps=parts,
    )
    return states, dict(zip(engine.outputs, outputs.T, strict=True))


@pytest.mark.parametrize("speed", [4.0, 10.0, 20.0])
def test_steady_cornering_has_the_yaw_rate_of_the_textbook(speed: float) -> None:
    angle = 1e-4
    drive = driven(made("linear"), truck("linear"), np.full(3000, angle), np.full(3000, speed), 0.01)[1]
    gain = speed / (WHEELBASE + UNDERSTEER * speed**2)
    assert drive["yaw_rate"][-1] == pytest.approx(gain * angle, rel=1e-7)
    assert drive["lateral_acceleration"][-1] == pytest.approx(speed * gain * angle, rel=1e-7)
    assert drive["front_slip_angle"][-1] - drive["rear_slip_angle"][-1] == pytest.approx(
        UNDERSTEER * speed * gain * angle, rel=1e-6
    )


@pytest.mark.parametrize("speed", [3.0, 12.0, 25.0])
@EVERY
def test_straight_ahead_the_eigenvalues_are_those_of_the_characteristic_polynomial(
    kind: str, speed: float
) -> None:
    engine = made(kind)
    a, _, _ = engine.jacobians(np.zeros(5), [0.0, speed], engine.vector(truck(kind)))
    damping = (C_F + C_R) / (MASS * speed) + (L_F**2 * C_F + L_R**2 * C_R) / (INERTIA * speed)
    stiffness = C_F * C_R * WHEELBASE**2 / (MASS * INERTIA * speed**2) + (L_R * C_R - L_F * C_F) / INERTIA
    expected = np.sort_complex(np.roots([1.0, damping, stiffness]))
    assert np.sort_complex(np.linalg.eigvals(a[:2, :2])) == pytest.approx(expected, rel=1e-10)


@EVERY
def test_a_mirrored_drive_is_the_mirror_of_the_drive(kind: str) -> None:
    engine = made(kind)
    _, inputs, _, _ = segments(5, [400], 0.02)
    start = np.array([0.1, -0.05, 0.3, 4.0, -2.0])
    mirror = np.array([-1.0, -1.0, -1.0, 1.0, -1.0])
    values = truck(kind, {"reference_x": -2.12, "imu_x": 0.6})
    right, _ = driven(engine, values, inputs[:, 0], inputs[:, 1], 0.02, start)
    left, _ = driven(engine, values, -inputs[:, 0], inputs[:, 1], 0.02, start * mirror)
    assert np.max(np.abs(left * mirror - right)) < 1e-9


@EVERY
def test_the_tyres_take_exactly_the_energy_that_the_motion_loses(kind: str) -> None:
    engine = made(kind)
    random = np.random.default_rng(2)
    states = random.normal(size=(100, 5)) * [0.8, 0.3, 1.0, 1.0, 1.0]
    angle, speed = random.uniform(-0.3, 0.3, 100), random.uniform(2, 20, 100)
    inputs = np.stack([angle, speed], axis=1)
    p = engine.vector(truck(kind))
    rates = engine.rates(states, inputs, p)
    outputs = dict(zip(engine.outputs, engine.outputs_of(states, inputs, p).T, strict=True))
    front, rear = outputs["front_lateral_force"], outputs["rear_lateral_force"]
    v_y, r = states[:, 0], states[:, 1]
    power = MASS * v_y * rates[:, 0] + INERTIA * r * rates[:, 1]
    lost_ahead = speed * (-front * np.sin(angle) + MASS * v_y * r)  # a drive force makes up for it
    slide_f = (v_y + L_F * r) * np.cos(angle) - speed * np.sin(angle)
    slide_r = v_y - L_R * r
    assert power + lost_ahead == pytest.approx(front * slide_f + rear * slide_r, rel=1e-9, abs=1e-6)
    assert np.all(front * slide_f <= 0)
    assert np.all(rear * slide_r <= 0)


def test_a_bank_pushes_sideways_and_turns_over_with_the_heading() -> None:
    engine = made("linear")
    values = truck("linear", {"bank_cos": 0.02, "bank_sin": 0.01})
    p, level = engine.vector(values), engine.vector(truck("linear"))
    inputs = [0.0, 10.0]
    for heading in (0.0, 0.7, math.pi / 2, math.pi):
        state = np.array([0.0, 0.0, heading, 0.0, 0.0])
        sine = 0.02 * math.cos(heading) + 0.01 * math.sin(heading)
        assert engine.rates(state, inputs, p)[0] == pytest.approx(-9.81 * sine, abs=1e-12)
        assert np.array_equal(engine.outputs_of(state, inputs, p), engine.outputs_of(state, inputs, level))


def test_the_accelerometer_of_a_truck_that_holds_straight_on_a_bank_reads_the_bank() -> None:
    engine = made("linear")
    values = truck("linear", {"bank_cos": 0.02})
    load = MASS * 9.81 * 0.02
    front, rear = load * L_R / WHEELBASE, load * L_F / WHEELBASE
    state = np.array([-10.0 * math.tan(rear / C_R), 0.0, 0.0, 0.0, 0.0])
    angle = front / C_F - rear / C_R
    for _ in range(20):  # F_f cos δ instead of F_f
        angle = front / math.cos(angle) / C_F + math.atan(state[0] / 10.0)
    p = engine.vector(values)
    assert engine.rates(state, [angle, 10.0], p)[:2] == pytest.approx(0.0, abs=1e-12)
    read = engine.outputs_of(state, [angle, 10.0], p)[engine.outputs.index("lateral_acceleration")]
    assert read == pytest.approx(9.81 * 0.02, rel=1e-12)


def test_a_steering_offset_is_an_angle() -> None:
    engine = made("magic_formula")
    _, inputs, _, _ = segments(5, [50], 0.02)
    offset = driven(
        engine, truck("magic_formula", {"steering_offset": 0.01}), inputs[:, 0], inputs[:, 1], 0.02
    )[0]
    turned = driven(engine, truck("magic_formula"), inputs[:, 0] + 0.01, inputs[:, 1], 0.02)[0]
    assert np.max(np.abs(offset - turned)) < 1e-12
    assert np.max(np.abs(offset - driven(engine, truck("magic_formula"), *inputs.T, 0.02)[0])) > 1e-2


# --- standstill, crawling, reverse -------------------------------------------------------------------


@EVERY
def test_a_truck_at_standstill_stays_where_it_is_however_it_is_steered(kind: str) -> None:
    angle = 0.6 * np.sin(np.arange(2000) * 0.02)
    states, _ = driven(made(kind), truck(kind), angle, np.zeros(2000), 0.02)
    assert np.max(np.abs(states)) < 1e-9


@pytest.mark.parametrize("speed", [0.01, 0.1, 0.5, 0.9, 1.1, -0.3, -1.0])
@EVERY
def test_a_crawling_truck_goes_where_its_wheels_point(kind: str, speed: float) -> None:
    angle = 0.2
    _, drive = driven(made(kind), truck(kind), np.full(4000, angle), np.full(4000, speed), 0.01)
    kinematic = speed * math.tan(angle) / WHEELBASE
    assert drive["yaw_rate"][-1] == pytest.approx(kinematic, rel=0.01)
    assert drive["lateral_velocity"][-1] == pytest.approx(L_R * kinematic, rel=0.02, abs=1e-9)


@EVERY
def test_coming_to_a_stop_and_reversing_does_not_blow_up(kind: str) -> None:
    time = np.arange(6000) * 0.01
    speed = 5.0 * np.cos(0.2 * time)
    states, drive = driven(made(kind), truck(kind, TILTED), 0.3 * np.sin(0.5 * time), speed, 0.01)
    assert np.all(np.isfinite(states))
    assert np.max(np.abs(drive["yaw_rate"])) < 5.0 * math.tan(0.31) / WHEELBASE * 1.1
    assert np.max(np.abs(drive["lateral_velocity"])) < 1.5


def test_above_crawling_the_slip_angle_is_exactly_that_of_the_book() -> None:
    engine = made("linear")
    random = np.random.default_rng(5)
    states = random.normal(size=(200, 5)) * [0.3, 0.2, 1, 1, 1]
    angle, speed = random.uniform(-0.4, 0.4, 200), random.uniform(3 * CRAWL, 20, 200)
    outputs = engine.outputs_of(states, np.stack([angle, speed], axis=1), engine.vector(truck("linear")))
    v_y, r = states[:, 0], states[:, 1]
    named = dict(zip(engine.outputs, outputs.T, strict=True))
    assert named["front_slip_angle"] == pytest.approx(angle - np.arctan((v_y + L_F * r) / speed), abs=1e-14)
    assert named["rear_slip_angle"] == pytest.approx(-np.arctan((v_y - L_R * r) / speed), abs=1e-14)


def test_few_substeps_are_needed_at_speed_and_many_at_a_crawl() -> None:
    values, steps = truck("linear"), np.full(4, 0.03)
    parts = substeps_for(values, np.array([15.0, 5.0, 0.2, -0.2]), steps)
    assert parts[0] == 1
    assert parts[1] < parts[2] == parts[3]
    a, _, _ = made("linear").jacobians(np.zeros(5), [0.0, 0.2], made("linear").vector(values))
    fastest = np.max(np.abs(np.linalg.eigvals(a[:2, :2])))
    assert fastest * 0.03 / parts[2] < 1.05
    assert fastest * 0.03 > 2.78, "one step would not be stable: the test is of something"


# --- the truck of the sample logs --------------------------------------------------------------------


def planar_values(truth: Planar) -> dict[str, float]:
    body = {name: getattr(truth.body, name) for name in BODY}
    tyres = {
        f"{axle}.{name}": value
        for axle in ("front", "rear")
        for name, value in from_bcde(
            *(getattr(getattr(truth, axle), n) for n in ("stiffness", "shape", "peak", "curvature"))
        ).items()
    }
    return body | tyres | AT_CG | LEVEL


def test_the_simulated_truck_of_the_sample_logs_moves_as_this_model_does() -> None:
    truth = load_truth().planar
    count = 8000
    half = np.arange(2 * count + 1) * STEP / 2
    whole = half[::2]
    speed = np.interp(whole, [0, 3, 5, 8], [6.0, 6.0, 14.0, 10.0])
    rate = np.diff(speed) / STEP
    acceleration = np.interp(half, whole[:-1] + STEP / 2, rate)
    wheel = np.interp(half, whole, truth.steering_ratio * (0.13 * np.sin(1.2 * whole) + 0.02 * whole / 8))
    inputs = np.stack([wheel, np.interp(half, whole, speed), acceleration], axis=1)
    start = np.array([6.0, 0.05, 0.02, 3.0, -2.0, 0.4])
    motion = independent(truth, start, 0.0, inputs)
    values = planar_values(truth) | MOUNTED
    driven_speed = motion.states[:, 0]
    angle = wheel[::2] / truth.steering_ratio
    states, drive = driven(made("magic_formula"), values, angle, driven_speed, STEP, start[[1, 2, 5, 3, 4]])
    assert np.max(np.abs(states[:, 0])) > 0.05
    assert np.ptp(drive["lateral_acceleration"]) > 5.0
    for column, name in enumerate(("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")):
        place = {"lateral_velocity": 1, "yaw_rate": 2, "heading": 5, "position_x": 3, "position_y": 4}[name]
        assert np.max(np.abs(states[:, column] - motion.states[:, place])) < 1e-6, name
    r, heading = motion.states[:, 2], motion.states[:, 5]
    across = motion.rates[:, 1] + motion.states[:, 0] * r + 0.6 * motion.rates[:, 2] - 0.15 * r**2
    assert np.max(np.abs(drive["lateral_acceleration"] - across)) < 1e-6
    assert np.max(np.abs(drive["lateral_velocity"] - motion.states[:, 1] + 2.12 * r)) < 1e-6
    assert np.max(np.abs(drive["position_y"] - motion.states[:, 4] + 2.12 * np.sin(heading))) < 1e-6


def test_the_independent_truck_disagrees_where_its_tyre_is_another() -> None:
    truth = load_truth().planar
    other = replace(truth, rear=replace(truth.rear, stiffness=truth.rear.stiffness * 1.01))
    inputs = np.tile([truth.steering_ratio * 0.05, 10.0, 0.0], (4001, 1))
    motion = independent(other, np.array([10.0, 0, 0, 0, 0, 0]), 0.0, inputs)
    states, _ = driven(
        made("magic_formula"), planar_values(truth), np.full(2001, 0.05), np.full(2001, 10.0), STEP
    )
    assert np.max(np.abs(states[:, 0] - motion.states[:, 1])) > 1e-4
