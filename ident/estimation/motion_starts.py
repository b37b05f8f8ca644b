"""Where a fit of the motion begins: at one with other effects, its states and terms carried over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ident.estimation.elimination import stacked, with_priors
from ident.estimation.gauss_newton import minimise
from ident.estimation.motion_effects import MotionEffect
from ident.estimation.vehicle_fit import NEGLIGIBLE
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_problem import VehicleProblem

Array = NDArray[np.float64]

ITERATIONS = 10
SETTLING = 4  # steps of initial states alone
PLACES, ADAPTING = (-1.0, 0.0, 1.0), 2  # of a play where a stretch might begin, and steps to try each


def begun_states(problem: VehicleProblem, effects: Sequence[MotionEffect], before: VehiclePoint) -> Array:
    """(w, x) where the states that effects bring begin: at what the model without them says, else at zero."""
    made = np.zeros((len(problem.windows.records), problem.states))
    begins = {s: o for effect in effects for part in effect.parts for s, o in part.begins.items()}
    if not begins or not before.problem.windows.same_as(problem.windows):
        return made
    outputs = before.outputs
    first = problem.windows.offsets[:-1]
    for state, output in begins.items():
        if state not in before.problem.engine.states:
            made[:, problem.engine.states.index(state)] = outputs[
                first, before.problem.engine.outputs.index(output)
            ]
    return made


def terms_of_runs(problem: VehicleProblem, before: VehiclePoint) -> Array:
    """(runs, b) terms of the runs of a fit, for a model that may have more or fewer of them."""
    made = np.zeros((problem.windows.runs, len(problem.run_terms)))
    names = [term.name for term in before.problem.run_terms]
    for number, term in enumerate(problem.run_terms):
        if term.name in names:
            made[:, number] = before.of_runs[:, names.index(term.name)]
    return made


def initial_states(problem: VehicleProblem, before: VehiclePoint, local: Array) -> Array:
    """Initial states of a fit, for a model that may have more or fewer states."""
    made, old = local.copy(), before.problem.engine.states
    if not before.problem.windows.same_as(problem.windows):
        return made
    for number, name in enumerate(problem.engine.states):
        if name in old:
            made[:, number] = before.local[:, old.index(name)]
    if before.problem.anchors == problem.anchors:
        made[:, problem.states :] = before.local[:, before.problem.states :]
    return made


def minimised(point: VehiclePoint) -> VehiclePoint:
    """Maximum likelihood under the noise as it is; one that lacks much needs not be followed to the end."""
    return minimise(point, ITERATIONS, negligible=NEGLIGIBLE)[0]


def anew(point: VehiclePoint) -> VehiclePoint:
    """The minimum from a minimum, each stretch begun in its play where that serves its run best.

    Where a play begins changes nothing any more once it lies beyond where the wheel first turns: there an
    iteration finds no slope.
    """
    best = point
    for begin in point.problem.begins.tolist():
        for place in PLACES:
            of_runs = best.of_runs.copy()
            of_runs[:, begin] = place
            best = best.with_better_runs(_locally_adapted(replace(best, of_runs=of_runs)))
    return point if np.array_equal(best.of_runs, point.of_runs) else minimised(best)


def _locally_adapted(point: VehiclePoint) -> VehiclePoint:
    """Initial states that go with all else as it is."""
    for _ in range(ADAPTING):
        rest = np.zeros(len(point.problem.run_terms) + point.shared.size)
        steps = np.array([window.step(rest) for window in point.windows])
        point = replace(point, local=point.local + steps)
    return point


def settled(point: VehiclePoint) -> VehiclePoint:
    """Initial states adapted, and where in a play each stretch begins; all else as it is."""
    known = point.noise
    point = point.with_noise({name: known[name] for name in point.problem.compared if name in known})
    nothing = np.zeros(point.shared.size)
    for _ in range(SETTLING):
        of_runs = _begin_steps(point)
        rests = [np.concatenate([of_runs[run], nothing]) for run in point.problem.windows.run]
        steps = np.array([window.step(rest) for window, rest in zip(point.windows, rests, strict=True)])
        tried = replace(point, local=point.local + steps, of_runs=point.with_term_steps(of_runs))
        if not tried.value < point.value * (1 - 1e-9):
            break
        point = tried
    return point


def _begin_steps(point: VehiclePoint) -> Array:
    """(runs, b) steps of where a play begins, initial states following; zero for all other terms."""
    made, begins = np.zeros_like(point.of_runs), point.problem.begins
    if not begins.size:
        return made
    for run in range(point.problem.windows.runs):
        windows = zip(point.windows, point.problem.windows.run, strict=True)
        rows = stacked([window for window, of in windows if of == run])
        own = np.column_stack([rows[:, begins], rows[:, -1]])
        priors = point.problem.std_by_run[run, begins]
        own = with_priors(own, priors, -point.of_runs[run, begins])
        made[run, begins] = np.linalg.lstsq(own[:, :-1], own[:, -1], rcond=None)[0]
    return made
