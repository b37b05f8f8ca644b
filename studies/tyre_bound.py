"""The Cramér-Rao bound of the tyres of the planar truck, from the simulated truck alone.

    python studies/tyre_bound.py [--window 10]

Prints how well the Magic Formula of both axles (B, C, D, E), the yaw inertia, and what follows from them
(cornering stiffness B C D, peak D, understeer gradient) can be known from the three planar sample runs at
best: with all parameters free, with some of them known, and with weak beliefs about shape and curvature.

Derivatives are central differences of the generator's own outputs (yaw rate, lateral acceleration at the
inertial unit, lateral velocity, heading and position of the rear axle), and the noise is what the generator
adds, with its exact autocovariance on the sample index. Unknown beside the tyres: an offset of the steering,
in each run a bias of yaw rate, lateral acceleration, lateral velocity and heading, and the state at the start
of every window.
Steering and speed count as known, which the fit does not have: it sees them through sensors, so it can only
do worse (``tyre_inputs.py`` says by how much). Nothing of ``ident`` takes part.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

import numpy as np  # noqa: E402
from bound import whitened  # noqa: E402
from generator.motion import imu_signals, rear_axle_signals  # noqa: E402
from generator.motion_sets import MotionSet, channel_of, motion_set, noise_free  # noqa: E402
from generator.runs import TRIPS, Trip, driver_run, drivers_inputs  # noqa: E402
from generator.sensors import generator  # noqa: E402
from generator.truth import Planar, Truth, load_truth  # noqa: E402
from generator.vehicle import STEP, Motion, simulate  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

Array = NDArray[np.float64]

TYRE = ("stiffness", "shape", "peak", "curvature")
PARAMETERS = (*(f"front.{name}" for name in TYRE), *(f"rear.{name}" for name in TYRE), "yaw_inertia")
OUTPUTS = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")
BIASED = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading")
COMMON = (*PARAMETERS, "steering_offset")
OF_RUN = tuple(f"bias.{name}" for name in BIASED)
RELATIVE_STEP = 1e-4
STATE_STEPS = (1e-4, 1e-5, 1e-3, 1e-3, 1e-5)  # of v_y, r, x, y, ψ at the start
OFFSET_STEP = 1e-5  # [rad] at the road wheel
V_Y, YAW_RATE, X, Y, HEADING = range(1, 6)
AT_START = (V_Y, YAW_RATE, X, Y, HEADING)
MARGIN = 0.02  # [s] simulated beyond the last sample of a window


@dataclass(frozen=True)
class Driven:
    """A trip of the planar truck: its inputs, its noise-free motion, and the stamps of each output [s]."""

    wheel: Callable[[Array], Array]
    speed: Callable[[Array], Array]
    speed_rate: Callable[[Array], Array]
    start: Array
    duration: float
    times: dict[str, Array]


def driven(trip: Trip, truth: Truth, seed: int, name: str) -> Driven:
    """Prepare a trip as the generator drives it, with the stamps of its sensors."""
    wheel, speed, pose = drivers_inputs(trip, truth, generator(seed, name))
    true: MotionSet = motion_set(driver_run(trip), noise_free(truth), seed, name)
    start = np.array([float(speed(np.zeros(1))[0]), 0.0, 0.0, *pose])
    times = {output: true[output].time for output in OUTPUTS}
    return Driven(wheel, speed, speed.rate, start, trip.duration, times)


def with_parameter(truck: Planar, name: str, value: float) -> Planar:
    """Return the truck with one of ``PARAMETERS`` changed."""
    if name == "yaw_inertia":
        return replace(truck, body=replace(truck.body, yaw_inertia=value))
    axle, parameter = name.split(".")
    return replace(truck, **{axle: replace(getattr(truck, axle), **{parameter: value})})


def value_of(truck: Planar, name: str) -> float:
    """Return one of ``PARAMETERS``."""
    if name == "yaw_inertia":
        return truck.body.yaw_inertia
    axle, parameter = name.split(".")
    return float(getattr(getattr(truck, axle), parameter))


@dataclass(frozen=True)
class Window:
    """Samples from ``begin`` to ``end`` [s], simulated from ``state`` at ``begin``."""

    begin: float
    end: float
    state: Array


def windows(trip: Driven, truck: Planar, length: float) -> list[Window]:
    """Cut a trip into windows of about a length [s], each from the true state at its beginning."""
    count = max(1, round(trip.duration / length))
    edges = np.round(np.linspace(0.0, trip.duration, count + 1) / STEP) * STEP
    states = _simulate(trip, truck, Window(0.0, trip.duration, trip.start), 0.0).states
    return [Window(float(begin), float(end), states[round(begin / STEP)]) for begin, end in pairwise(edges)]


def half_steps(window: Window) -> Array:
    """(2 n + 1,) times at which the inputs of a window are wanted [s]."""
    steps = round((window.end - window.begin + MARGIN) / STEP)
    return window.begin + STEP / 2.0 * np.arange(2 * steps + 1)


def inputs_at(trip: Driven, time: Array) -> Array:
    """(n, 3) steering-wheel angle [rad], speed [m/s] and its derivative [m/s²]."""
    return np.column_stack([trip.wheel(time), trip.speed(time), trip.speed_rate(time)])


def _simulate(trip: Driven, truck: Planar, window: Window, offset: float) -> Motion:
    inputs = inputs_at(trip, half_steps(window))
    inputs[:, 0] += truck.steering_ratio * offset
    return simulate(truck, window.state, window.begin, inputs)


def outputs(trip: Driven, truck: Planar, window: Window, offset: float = 0.0) -> dict[str, Array]:
    """Noise-free outputs at the stamps inside a window; ``offset`` adds to the road-wheel angle [rad]."""
    return seen(trip, truck, window, _simulate(trip, truck, window, offset))


def seen(trip: Driven, truck: Planar, window: Window, motion: Motion) -> dict[str, Array]:
    """Noise-free outputs of a motion at the stamps inside a window."""
    rear, imu = rear_axle_signals(truck, motion), imu_signals(truck, motion)
    signals = {
        "yaw_rate": imu["yaw_rate"],
        "lateral_acceleration": imu["lateral_acceleration"],
        "lateral_velocity": rear["lateral_velocity"],
        "heading": rear["heading"],
        "position_x": rear["x"],
        "position_y": rear["y"],
    }
    inside = {name: (t >= window.begin) & (t < window.end) for name, t in trip.times.items()}
    return {name: signals[name](trip.times[name][inside[name]]) for name in OUTPUTS}


def derivatives(trip: Driven, truck: Planar, window: Window) -> dict[str, Array]:
    """(n, COMMON, OF_RUN and 5) derivative of each output to all that is unknown in a window."""
    columns: list[dict[str, Array]] = []
    for name in PARAMETERS:
        value = value_of(truck, name)
        step = RELATIVE_STEP * abs(value)
        columns.append(
            _slope(
                trip, step, *((with_parameter(truck, name, value + s * step), window, 0.0) for s in (1, -1))
            )
        )
    columns.append(_slope(trip, OFFSET_STEP, *((truck, window, s * OFFSET_STEP) for s in (1, -1))))
    zero = {output: np.zeros_like(values) for output, values in columns[0].items()}
    columns += [{**zero, biased: zero[biased] + 1.0} for biased in BIASED]
    for index, step in zip(AT_START, STATE_STEPS, strict=True):
        moved = np.zeros(6)
        moved[index] = step
        ends = ((truck, replace(window, state=window.state + s * moved), 0.0) for s in (1, -1))
        columns.append(_slope(trip, step, *ends))
    return {output: np.column_stack([column[output] for column in columns]) for output in OUTPUTS}


def _slope(
    trip: Driven, step: float, up: tuple[Planar, Window, float], down: tuple[Planar, Window, float]
) -> dict[str, Array]:
    above, below = outputs(trip, *up), outputs(trip, *down)
    return {name: (above[name] - below[name]) / (2.0 * step) for name in OUTPUTS}


def information(trips: Sequence[Driven], truth: Truth, length: float) -> Array:
    """Fisher information of ``COMMON`` from all trips; biases and states at the starts are eliminated."""
    return np.sum([reduced(trip_information(trip, truth, length)) for trip in trips], axis=0)


def trip_information(trip: Driven, truth: Truth, length: float) -> Array:
    """Information of ``COMMON``, ``OF_RUN`` and five start values a window, all windows together."""
    total = 0.0
    for white in whitened_design(trip, truth, length).values():
        total = total + white.T @ white
    return np.asarray(total)


def whitened_design(trip: Driven, truth: Truth, length: float) -> dict[str, Array]:
    """Derivatives of each output to all that is unknown in a trip, with noise made white across windows."""
    parts = [derivatives(trip, truth.planar, window) for window in windows(trip, truth.planar, length)]
    return {output: whitened(_design(parts, output), channel_of(truth, output)) for output in OUTPUTS}


def _design(parts: Sequence[dict[str, Array]], output: str) -> Array:
    common, local = len(COMMON) + len(OF_RUN), len(AT_START)
    ends = np.cumsum([0, *(len(part[output]) for part in parts)])
    columns = np.zeros((ends[-1], common + local * len(parts)))
    for number, (part, (begin, end)) in enumerate(zip(parts, pairwise(ends), strict=True)):
        first = common + local * number
        columns[begin:end, :common] = part[output][:, :common]
        columns[begin:end, first : first + local] = part[output][:, common:]
    return columns


def reduced(full: Array) -> Array:
    """Information of ``COMMON`` where nothing is known of the rest."""
    size = len(COMMON)
    cross = full[:size, size:]
    return full[:size, :size] - cross @ scaled_inverse(full[size:, size:]) @ cross.T


def scaled_inverse(matrix: Array) -> Array:
    """Inverse of a positive definite matrix whose rows have very different units."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)


def covariance(
    info: Array, known: Sequence[str] = (), beliefs: dict[str, float] | None = None
) -> tuple[Array, list[str]]:
    """Smallest covariance of what is free of ``PARAMETERS``, and their names.

    known : parameters that are given
    beliefs : parameter -> standard deviation of what is believed of it beforehand
    """
    free = [i for i, name in enumerate(COMMON) if name not in known]
    total = info.copy()
    for name, std in (beliefs or {}).items():
        total[COMMON.index(name), COMMON.index(name)] += 1.0 / std**2
    names = [COMMON[i] for i in free]
    inverse = scaled_inverse(total[np.ix_(free, free)])
    count = sum(name in PARAMETERS for name in names)
    return inverse[:count, :count], names[:count]


# --- what follows from the parameters ------------------------------------------------------------


def derived(truck: Planar) -> dict[str, float]:
    """Cornering stiffness of both axles [N/rad] and the understeer gradient [rad s²/m]."""
    body = truck.body
    front, rear = (a.stiffness * a.shape * a.peak for a in (truck.front, truck.rear))
    gradient = body.mass / (body.cg_to_front_axle + body.cg_to_rear_axle)
    gradient *= body.cg_to_rear_axle / front - body.cg_to_front_axle / rear
    return {
        "front.cornering_stiffness": front,
        "rear.cornering_stiffness": rear,
        "understeer_gradient": gradient,
    }


def derived_std(truck: Planar, inverse: Array, names: Sequence[str]) -> dict[str, float]:
    """Smallest standard deviation of each of ``derived``."""
    spread = {}
    for what in derived(truck):
        slope = np.array([_derived_slope(truck, what, name) for name in names])
        spread[what] = float(np.sqrt(slope @ inverse @ slope))
    return spread


def _derived_slope(truck: Planar, what: str, name: str) -> float:
    value = value_of(truck, name)
    step = 1e-6 * abs(value)
    ends = [derived(with_parameter(truck, name, value + s * step))[what] for s in (1, -1)]
    return (ends[0] - ends[1]) / (2.0 * step)


# --- the table -----------------------------------------------------------------------------------

SHAPES = ("front.shape", "rear.shape")
CURVATURES = ("front.curvature", "rear.curvature")
# what the fit believes beforehand of peak and shape (relative) and of the curvature, see ident's tyre_fit
BELIEFS = {
    "front.peak": 0.7 * 46200.0,
    "rear.peak": 0.7 * 51900.0,
    **dict.fromkeys(SHAPES, 0.3 * 1.3),
    **dict.fromkeys(CURVATURES, 2.0),
}
CASES: dict[str, tuple[tuple[str, ...], dict[str, float]]] = {
    "all free": ((), {}),
    "E known": (CURVATURES, {}),
    "C and E known": ((*SHAPES, *CURVATURES), {}),
    "beliefs": ((), BELIEFS),
}


def fit_bound(info: Array, truck: Planar) -> dict[str, float]:
    """Smallest standard deviations of what the fit tells, by the fit's names, with its beliefs."""
    return by_fit_name(*covariance(info, (), BELIEFS), truck)


def by_fit_name(inverse: Array, names: Sequence[str], truck: Planar) -> dict[str, float]:
    """Standard deviations of what the fit tells, by the fit's names, from a covariance."""
    stds = dict(zip(names, np.sqrt(np.diag(inverse)), strict=True))
    made = {name: stds[name] for name in (*SHAPES, *CURVATURES, "yaw_inertia")}
    peaks = {f"{axle}.peak_force": stds[f"{axle}.peak"] for axle in ("front", "rear")}
    both = {**made, **peaks, **derived_std(truck, inverse, names)}
    return {name: float(std) for name, std in both.items()}


def table(info: Array, truck: Planar) -> str:
    """Relative standard deviations [%] in every case."""
    found = {}
    for case, (known, beliefs) in CASES.items():
        inverse, names = covariance(info, known, beliefs)
        stds = dict(zip(names, np.sqrt(np.diag(inverse)), strict=True))
        found[case] = {**stds, **derived_std(truck, inverse, names)}
    values = {**{name: value_of(truck, name) for name in PARAMETERS}, **derived(truck)}
    lines = [f"{'':28}{'true':>12}" + "".join(f"{case:>16}" for case in CASES)]
    for name, value in values.items():
        cells = [found[case].get(name) for case in CASES]
        shown = ["known" if cell is None else f"{100 * cell / abs(value):.3g} %" for cell in cells]
        lines.append(f"{name:28}{value:>12.5g}" + "".join(f"{cell:>16}" for cell in shown))
    return "\n".join(lines)


def correlations(inverse: Array, names: Sequence[str]) -> str:
    """Correlation matrix as text."""
    std = np.sqrt(np.diag(inverse))
    matrix = inverse / np.outer(std, std)
    lines = [f"{'':18}" + "".join(f"{i:>7}" for i in range(len(names)))]
    for number, (name, row) in enumerate(zip(names, matrix, strict=True)):
        lines.append(f"{number} {name:16}" + "".join(f"{value:>7.3f}" for value in row))
    return "\n".join(lines)


def main() -> None:
    """Print the tables of the planar sample runs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--window", type=float, default=10.0, help="[s] with a state of its own")
    options = parser.parse_args()
    truth = load_truth()
    trips = [driven(trip, truth, 1, name) for name, trip in TRIPS.items() if trip.vehicle == "planar"]
    for length in (trips[0].duration, options.window):
        info = information(trips, truth, length)
        print(
            f"\n{len(trips)} runs of {trips[0].duration:.0f} s, windows of {length:g} s: standard deviation"
        )
        print(table(info, truth.planar))
        for case in ("all free", "C and E known", "beliefs"):
            print(f"\ncorrelation, {case}")
            print(correlations(*covariance(info, *CASES[case])))


if __name__ == "__main__":
    main()
