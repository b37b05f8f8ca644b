"""The compiled simulation: against CasADi, against its own NumPy path, and as a numerical method."""

from __future__ import annotations

from typing import Any

import casadi_bicycle
import numpy as np
import pytest
from numpy.typing import NDArray
from vehicle_values import KINDS, MOUNTED, TILTED, segments, truck

from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import Engine, compiled
from ident.dynamics.system import System, symbol

Array = NDArray[np.float64]

EVERY = pytest.mark.parametrize("kind", KINDS)
SIZES = [40, 1, 25, 2]


def made(kind: str) -> tuple[Engine, Array]:
    engine = compiled(bicycle(kind, kind))
    return engine, engine.vector(truck(kind, MOUNTED, TILTED))


def magic() -> tuple[Engine, Array]:
    return made("magic_formula")


def largest_difference(found: Array, expected: Array, axis: int | tuple[int, ...]) -> float:
    """Largest difference over the largest value along an axis."""
    size = np.max(np.abs(expected), axis=axis)
    return float(np.max(np.max(np.abs(found - expected), axis=axis) / np.where(size > 0, size, 1.0)))


@EVERY
def test_outputs_and_derivatives_are_those_of_casadi(kind: str) -> None:
    engine, p = made(kind)
    starts, inputs, steps, offsets = segments(5, [50], 0.02)
    _, outputs, derivatives = engine.sensitivities(
        starts, inputs, steps, offsets, p, active=engine.parameters
    )
    expected, slopes = casadi_bicycle.simulate(kind, engine.parameters, starts[0], inputs, 0.02, p)
    assert largest_difference(outputs, expected, 0) < 1e-12
    assert largest_difference(derivatives, slopes, 1) < 1e-9
    assert np.count_nonzero(np.any(slopes != 0, axis=1)) > 70


@EVERY
def test_the_numpy_path_gives_what_the_compiled_code_gives(kind: str) -> None:
    engine, p = made(kind)
    starts, inputs, steps, offsets = segments(5, [30], 0.02)
    states, outputs, derivatives = engine.sensitivities(
        starts, inputs, steps, offsets, p, active=engine.parameters
    )
    assert largest_difference(engine.outputs_of(states, inputs, p), outputs, 0) < 1e-12
    c, _, q = engine.output_jacobians(states[:1], inputs[:1], p)
    assert largest_difference(np.concatenate([c, q], axis=2)[0], derivatives[:, 0, :], 0) < 1e-12
    a, b, d = engine.jacobians(states, inputs, p)
    rates = casadi_bicycle.model(kind, engine.parameters)[0]
    arguments = list(zip(states, inputs, strict=True))
    assert (
        largest_difference(
            engine.rates(states, inputs, p), np.array([rates(x, u, p).full()[:, 0] for x, u in arguments]), 0
        )
        < 1e-12
    )
    jacobian = rates.jacobian()
    for place in (0, 17):
        wanted = [part.full() for part in jacobian(*arguments[place], p, 0)]
        for found, expected in zip((a, b, d), wanted, strict=True):
            assert largest_difference(found[place], expected, 0) < 1e-9


def test_the_numpy_path_broadcasts_over_leading_axes() -> None:
    engine, p = magic()
    states = np.random.default_rng(0).normal(size=(4, 1, 5)) * 0.1
    inputs = np.array([[0.01, 8.0], [0.05, 12.0], [-0.02, 10.0]])
    assert engine.rates(states, inputs, p).shape == (4, 3, 5)
    a, b, d = engine.jacobians(states, inputs, p)
    assert (a.shape, b.shape, d.shape) == ((4, 3, 5, 5), (4, 3, 5, 2), (4, 3, 5, p.size))
    assert engine.rates(states, inputs, p)[2, 1] == pytest.approx(
        engine.rates(states[2, 0], inputs[1], p), rel=1e-14
    )


def test_many_segments_at_once_are_as_each_alone() -> None:
    engine, p = magic()
    starts, inputs, steps, offsets = segments(5, SIZES, 0.02)
    own = p * np.linspace(0.9, 1.1, len(SIZES))[:, None]
    active = ["rear.shape", "mass"]
    together = engine.sensitivities(starts, inputs, steps, offsets, own, active=active)
    for place in range(len(SIZES)):
        part = slice(offsets[place], offsets[place + 1])
        alone = engine.sensitivities(
            starts[[place]], inputs[part], steps[part], [0, SIZES[place]], own[place], active=active
        )
        for many, one in zip(together[:2], alone[:2], strict=True):
            assert np.array_equal(many[part], one)
        assert np.array_equal(together[2][:, part], alone[2])


def test_arrays_that_are_read_only_or_not_contiguous_are_taken_as_well() -> None:
    engine, p = magic()
    starts, inputs, steps, offsets = segments(5, [20], 0.02)
    arguments = (starts, np.asfortranarray(inputs), np.broadcast_to(0.02, 20), offsets.astype(np.int32), p)
    parts = np.broadcast_to(np.int64(1), 20)
    p.flags.writeable = False
    expected = engine.simulate(starts, inputs, steps, offsets, p)[1]
    assert np.array_equal(engine.simulate(*arguments, substeps=parts)[1], expected)
    derivatives = engine.sensitivities(*arguments, active=[0], substeps=parts)[2]
    wanted = engine.sensitivities(starts, inputs, steps, offsets, p, active=[0])[2]
    assert np.array_equal(derivatives, wanted)


def test_simulation_with_and_without_derivatives_is_the_same() -> None:
    engine, p = magic()
    arguments = (*segments(5, SIZES, 0.02), p)
    substeps = np.full(sum(SIZES), 3)
    plain = engine.simulate(*arguments, substeps=substeps, held=["road_wheel_angle"])
    full = engine.sensitivities(*arguments, active=["mass"], substeps=substeps, held=["road_wheel_angle"])
    for one, other in zip(plain, full[:2], strict=True):
        assert largest_difference(one, other, 0) < 1e-13


def test_some_parameters_and_outputs_give_those_columns_and_rows() -> None:
    engine, p = magic()
    arguments = (*segments(5, SIZES, 0.02), p)
    full = engine.sensitivities(*arguments, active=engine.parameters)[2]
    active, wanted = ["rear.curvature", "mass", "imu_x"], ["heading", "yaw_rate"]
    part = engine.sensitivities(*arguments, active=active, wanted=wanted)[2]
    columns = [*range(5), *(5 + engine.parameters.index(name) for name in active)]
    rows = [engine.outputs.index(name) for name in wanted]
    assert np.array_equal(part, full[np.ix_(rows, range(sum(SIZES)), columns)])
    places = [engine.parameters.index(name) for name in active]
    assert np.array_equal(engine.sensitivities(*arguments, active=places, wanted=wanted)[2], part)


def test_substeps_are_steps_on_a_finer_grid() -> None:
    engine, p = magic()
    starts, inputs, steps, offsets = segments(5, [11], 0.06)
    fine = np.linspace(0, 10, 31)
    dense = np.stack([np.interp(fine, range(11), column) for column in inputs.T], axis=1)
    active = ["front.peak_force", "steering_offset"]
    coarse = engine.sensitivities(starts, inputs, steps, offsets, p, active=active, substeps=np.full(11, 3))
    finer = engine.sensitivities(starts, dense, np.full(31, 0.02), [0, 31], p, active=active)
    assert largest_difference(coarse[1], finer[1][::3], 0) < 1e-12
    assert largest_difference(coarse[2], finer[2][:, ::3], 1) < 1e-11


def test_a_held_input_keeps_its_value_to_the_next_grid_point() -> None:
    integrator = System("integrator", {"x": symbol("u")}, ("u",), (), {"y": symbol("x")})
    engine = compiled(integrator)
    inputs = np.array([[1.0], [3.0], [2.0]])
    arguments = ([[0.0]], inputs, [0.5, 0.5, 0.0], [0, 3], np.empty(0))
    assert engine.simulate(*arguments, held=["u"])[1][:, 0] == pytest.approx([0.0, 0.5, 2.0])
    assert engine.simulate(*arguments)[1][:, 0] == pytest.approx([0.0, 1.0, 2.25])


def test_derivatives_of_the_inputs_reach_the_outputs() -> None:
    engine, p = magic()
    starts, inputs, steps, offsets = segments(5, [30], 0.02)
    chain = np.zeros((30, 2, 3))
    chain[:, 0, 1] = 1.0  # what the offset of the angle does, by way of the input
    chain[:, 0, 2] = inputs[:, 0]  # a gain of the angle, which is no parameter of the model
    active = ["steering_offset", "front.shape", "angle_gain"]
    derivatives = engine.sensitivities(
        starts, inputs, steps, offsets, p, active=active, input_derivatives=chain
    )[2]
    plain = engine.sensitivities(starts, inputs, steps, offsets, p, active=active[:2])[2]
    offset = plain[:, :, 5]
    assert largest_difference(derivatives[:, :, 5], offset, 1) < 1e-13
    assert largest_difference(derivatives[:, :, 6] - plain[:, :, 6], offset, 1) < 1e-9
    small = 1e-5
    turned = [engine.simulate(starts, inputs * [1 + s * small, 1], steps, offsets, p)[1].T for s in (1, -1)]
    assert largest_difference(derivatives[:, :, 7], (turned[0] - turned[1]) / (2 * small), 1) < 1e-6


def test_halving_the_step_makes_the_error_sixteen_times_smaller() -> None:
    engine, p = magic()
    ends = {}
    for parts in (1, 2, 4, 64):
        time = np.linspace(0.0, 1.6, 33)
        inputs = np.stack([0.02 * time, 8 + time], axis=1)
        arguments = ([[0.2, 0.1, 0.0, 0.0, 0.0]], inputs, np.full(33, 0.05), [0, 33], p)
        substeps = np.full(33, parts)
        states, _, slopes = engine.sensitivities(*arguments, active=engine.parameters, substeps=substeps)
        ends[parts] = np.concatenate([states[5], slopes[0, 5]])
    errors = [np.linalg.norm((ends[parts] - ends[64]) / ends[64].clip(1e-3)) for parts in (1, 2, 4)]
    orders = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    assert orders == pytest.approx([4.0, 4.0], abs=0.35)


GOOD: dict[str, Any] = {
    "starts": np.zeros((1, 5)),
    "inputs": np.full((3, 2), 5.0),
    "steps": np.full(3, 0.01),
    "offsets": [0, 3],
}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"starts": np.zeros((2, 5))}, "starts has shape"),
        ({"inputs": np.zeros((4, 2))}, "inputs has shape"),
        ({"steps": np.zeros(2)}, "steps has shape"),
        ({"offsets": [0, 0, 3]}, "offsets"),
        ({"offsets": [1, 3]}, "offsets"),
        ({"parameters": np.zeros(3)}, "parameters has shape"),
        ({"substeps": [1, 0, 1]}, "substeps"),
        ({"held": ["gear"]}, "gear"),
    ],
)
def test_refuses_arrays_that_do_not_fit_together(wrong: dict[str, Any], message: str) -> None:
    engine, p = magic()
    with pytest.raises(ValueError, match=message):
        engine.simulate(**(GOOD | {"parameters": p} | wrong))


@pytest.mark.parametrize("active", [["stray"], ["mass", "mass"], [99], [-1]])
def test_refuses_active_parameters_that_are_none(active: list[Any]) -> None:
    engine, p = magic()
    with pytest.raises(ValueError, match="parameters"):
        engine.sensitivities(**GOOD, parameters=p, active=active)


def test_refuses_a_vector_with_a_name_missing_or_too_many() -> None:
    engine, _ = magic()
    values = truck("magic_formula")
    with pytest.raises(ValueError, match=r"unknown.*stray"):
        engine.vector(values | {"stray": 1.0})
    with pytest.raises(ValueError, match=r"missing.*mass"):
        engine.vector({name: value for name, value in values.items() if name != "mass"})
