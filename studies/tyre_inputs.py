"""What the errors of the measured steering and speed cost the tyre fit.

    python studies/tyre_inputs.py [--window 10] [--windows 18] [--whole]

The bound of ``tyre_bound.py`` takes steering and speed as known. A fit drives its model with what the sensors
say of them, so their noise w reaches the modelled outputs as G w, and the residual is e + G w. With the exact
covariance R of e and Q of w (10 s windows, dense matrices), three standard deviations of each parameter:

* known inputs: weights and noise R alone;
* noisy inputs: weights and noise R + G Q G', the least that any fit can reach that knows nothing more of
  the inputs than their measured values;
* ignored: the weights are R⁻¹, the noise is R + G Q G'; a fit that does not know that its inputs are noisy;
* by signal: the weights are the inverse of R + G Q G' without what it holds between signals; what a fit can
  do that learns the noise of each signal from its own residuals.

With ``--whole`` also the least for runs that are not cut. Both, with what the fit believes beforehand, stay
in studies/results/tyre_bound.json, which ``tyre_coverage.py`` holds the fit against.

G is made by simulating the generator again with each input sample moved, one at a time. Correlation of the
noise across windows is left out, in all four alike.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

import numpy as np  # noqa: E402
from bound import autocovariance, whitened  # noqa: E402
from generator.motion_sets import SOURCES, channel_of, motion_set, noise_free, sensors_of  # noqa: E402
from generator.runs import TRIPS, driver_run  # noqa: E402
from generator.truth import Truth, load_truth  # noqa: E402
from generator.vehicle import STEP, simulate  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from scipy.linalg import block_diag, cho_factor, cho_solve, toeplitz  # noqa: E402
from tyre_bound import (  # noqa: E402
    CASES,
    COMMON,
    OF_RUN,
    OUTPUTS,
    PARAMETERS,
    Driven,
    Window,
    by_fit_name,
    derivatives,
    derived,
    derived_std,
    driven,
    fit_bound,
    half_steps,
    inputs_at,
    reduced,
    scaled_inverse,
    seen,
    table,
    value_of,
    whitened_design,
    windows,
)

Array = NDArray[np.float64]

KEPT = HERE / "results" / "tyre_bound.json"
INPUTS = {"steering_wheel_angle": (0, 1e-4), "longitudinal_velocity": (1, 1e-3)}  # column, step moved by
COARSE = 10.0  # [1/s] of the hats that stand for the noise of inputs over whole runs
WAYS = ("known inputs", "noisy inputs", "ignored", "by signal")


def input_effect(trip: Driven, truth: Truth, window: Window, signal: str, stamps: Array) -> Array:
    """(n, m) change of all outputs per change of each sample of an input; linear between samples."""
    column, step = INPUTS[signal]
    time = half_steps(window)
    inputs = inputs_at(trip, time)
    motion = simulate(truth.planar, window.state, window.begin, inputs)
    nominal = _stacked(seen(trip, truth.planar, window, motion))
    effects = []
    for hat in np.eye(len(stamps)):
        moved = inputs.copy()
        moved[:, column] += step * np.interp(time, stamps, hat)
        start = window.state.copy()
        if signal == "longitudinal_velocity":
            start[0] = moved[0, 1]
            moved[:, 2] += step * np.gradient(np.interp(time, stamps, hat), time)
        shaken = simulate(truth.planar, start, window.begin, moved)
        effects.append((_stacked(seen(trip, truth.planar, window, shaken)) - nominal) / step)
    return np.column_stack(effects)


def _stacked(values: dict[str, Array]) -> Array:
    return np.concatenate([values[name] for name in OUTPUTS])


def stamps_around(times: Array, window: Window) -> Array:
    """Stamps that matter inside a window, on whole steps of the simulation [s]."""
    near = (times > window.begin - 0.03) & (times < window.end + 0.05)
    return np.round(times[near] / STEP) * STEP


def window_sums(task: tuple[str, float, int]) -> list[list[list[float]]]:
    """For each of ``WAYS``: A = D' W D and B = D' W S W D of one window, without its start."""
    name, length, number = task
    truth = load_truth()
    trip = driven(TRIPS[name], truth, 1, name)
    window = windows(trip, truth.planar, length)[number]
    true = motion_set(driver_run(TRIPS[name]), noise_free(truth), 1, name)
    slopes = derivatives(trip, truth.planar, window)
    sizes = [len(slopes[output]) for output in OUTPUTS]
    sensors = [_covariance(truth, output, size) for output, size in zip(OUTPUTS, sizes, strict=True)]
    noise = block_diag(*sensors)
    total = noise.copy()
    for signal in INPUTS:
        stamps = stamps_around(true[signal].time, window)
        effect = input_effect(trip, truth, window, signal, stamps)
        total += effect @ _covariance(truth, signal, len(stamps)) @ effect.T
    edges = np.cumsum([0, *sizes])
    diagonal = block_diag(*(total[a:b, a:b] for a, b in pairwise(edges)))
    design = np.vstack([slopes[output] for output in OUTPUTS])
    pairs = {
        "known inputs": (noise, noise),
        "noisy inputs": (total, total),
        "ignored": (noise, total),
        "by signal": (diagonal, total),
    }
    return [[part.tolist() for part in _sums(design, *pairs[way])] for way in WAYS]


def _covariance(truth: Truth, signal: str, size: int) -> Array:
    return toeplitz(autocovariance(channel_of(truth, signal), size - 1))


def _sums(design: Array, assumed: Array, actual: Array) -> tuple[Array, Array]:
    weighted = cho_solve(cho_factor(assumed), design)
    return without_last(design.T @ weighted, weighted.T @ actual @ weighted, len(COMMON) + len(OF_RUN))


def without_last(weights: Array, spread: Array, size: int) -> tuple[Array, Array]:
    """A and B for the first ``size`` unknowns, where the weights A determine the rest."""
    removed = np.eye(len(weights))[:, :size]
    removed[size:] = -scaled_inverse(weights[size:, size:]) @ weights[size:, :size]
    return removed.T @ weights @ removed, removed.T @ spread @ removed


def deviations(sums: Array, spread: Array, known: Sequence[str], beliefs: dict[str, float]) -> Array:
    """Covariance of what is free of ``PARAMETERS``, for one way of weighing."""
    free = [i for i, name in enumerate(COMMON) if name not in known]
    prior = np.diag([beliefs.get(name, np.inf) ** -2.0 for name in COMMON])
    inverse = scaled_inverse((sums + prior)[np.ix_(free, free)])
    count = sum(COMMON[i] in PARAMETERS for i in free)
    return (inverse @ (spread + prior)[np.ix_(free, free)] @ inverse)[:count, :count]


def summed(runs: Sequence[str], parts: Sequence[list[list[list[float]]]]) -> Array:
    """(4, 2, n, n) A and B of every way over all windows, the biases of each run eliminated."""
    total = 0.0
    for run in set(runs):
        own = np.sum([part for name, part in zip(runs, parts, strict=True) if name == run], axis=0)
        total = total + np.array([without_last(weights, spread, len(COMMON)) for weights, spread in own])
    return np.asarray(total)


# --- runs as a whole ---------------------------------------------------------------------------------


def whole_run_information(name: str) -> Array:
    """Information of ``COMMON`` from one run as one window, inputs through sensors.

    A covariance matrix of a whole run is too large, so (R + G Q G')⁻¹ is had by Woodbury's identity, with R⁻¹
    by exact whitening and the noise of the inputs as independent hats every ``1/COARSE``: the same density at
    low frequencies, which are what adds up in heading and position.
    """
    truth = load_truth()
    trip = driven(TRIPS[name], truth, 1, name)
    whole = windows(trip, truth.planar, trip.duration)[0]
    design = whitened_design(trip, truth, trip.duration)
    effects = [_coarse_effect(trip, truth, whole, signal) for signal in INPUTS]
    sizes = np.cumsum([len(trip.times[output]) for output in OUTPUTS])[:-1]
    by_output = zip(*(np.split(effect, sizes) for effect in effects), strict=True)
    inner, cross, own = 0.0, 0.0, 0.0
    for output, parts in zip(OUTPUTS, by_output, strict=True):
        white = whitened(np.column_stack(parts), channel_of(truth, output))
        inner = inner + white.T @ white
        cross = cross + white.T @ design[output]
        own = own + design[output].T @ design[output]
    inner = np.asarray(inner) + np.eye(len(inner))  # effects are in standard deviations
    return reduced(np.asarray(own - np.asarray(cross).T @ np.linalg.solve(inner, cross)))


def _coarse_effect(trip: Driven, truth: Truth, window: Window, signal: str) -> Array:
    """(n, m) change of all outputs per standard deviation of each hat of an input."""
    stamps = np.round(np.arange(window.begin, window.end + 1.0 / COARSE, 1.0 / COARSE) / STEP) * STEP
    channel, sensor = channel_of(truth, signal), sensors_of(truth)[SOURCES[signal][0]]
    lags = autocovariance(channel, 200)
    density = (lags[0] + 2.0 * lags[1:].sum()) / sensor.rate
    return input_effect(trip, truth, window, signal, stamps) * np.sqrt(density * COARSE)


def main() -> None:
    """Print the table of the planar sample runs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--window", type=float, default=10.0, help="[s]")
    parser.add_argument("--windows", type=int, default=18, help="how many, from all runs in turn")
    parser.add_argument("--whole", action="store_true", help="runs as a whole, too (takes longer)")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    names = [name for name, trip in TRIPS.items() if trip.vehicle == "planar"]
    count = round(TRIPS[names[0]].duration / options.window)
    tasks = [(name, options.window, number) for number in range(count) for name in names][: options.windows]
    with ProcessPoolExecutor(options.jobs) as pool:
        parts = list(pool.map(window_sums, tasks))
    total = summed([task[0] for task in tasks], parts)
    truck = load_truth().planar
    least = deviations(*total[WAYS.index("noisy inputs")], *CASES["beliefs"])
    if len(tasks) == count * len(names):
        _keep("windows", by_fit_name(least, PARAMETERS, truck))
    print(f"{len(tasks)} windows of {options.window:g} s: relative standard deviations [%]")
    for case, (known, beliefs) in CASES.items():
        print(f"\n{case:28}" + "".join(f"{way:>16}" for way in WAYS))
        names_free = [name for name in PARAMETERS if name not in known]
        found = []
        for sums, spread in total:
            inverse = deviations(sums, spread, known, beliefs)
            stds = dict(zip(names_free, np.sqrt(np.diag(inverse)), strict=True))
            found.append({**stds, **derived_std(truck, inverse, names_free)})
        values = {**{name: value_of(truck, name) for name in names_free}, **derived(truck)}
        for name, value in values.items():
            print(f"{name:28}" + "".join(f"{100 * one[name] / abs(value):>16.3g}" for one in found))
    if options.whole:
        with ProcessPoolExecutor(options.jobs) as pool:
            whole = np.sum(list(pool.map(whole_run_information, names)), axis=0)
        _keep("whole", fit_bound(whole, truck))
        print(f"\n{len(names)} whole runs, noisy inputs\n{table(whole, truck)}")


def _keep(which: str, stds: dict[str, float]) -> None:
    KEPT.parent.mkdir(exist_ok=True)
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    KEPT.write_text(json.dumps(kept | {which: stds}, indent=1) + "\n")


if __name__ == "__main__":
    main()
