"""Generic directions: what may be wrong in an equation of the motion, whatever its physical cause.

Each is a function of what is known along the fitted trajectory, added to one equation (lateral force, front
axle, yaw moment) or to one measured signal. They see what past inputs alone do not explain: drift, a step at
some time, the heading, the place, the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from ident.estimation.vehicle_inputs import Probe
from ident.estimation.vehicle_point import VehiclePoint

Array = NDArray[np.float64]

EQUATIONS = ("lateral_force", "front_tyre", "yaw_moment")
READ = ("yaw_rate", "lateral_acceleration", "lateral_velocity")
OF_FORCES = (
    "1", "t", "u", "|u|", "u|u|", "u^3", "sgn(du/dt)", "v", "v u", "cos(heading)", "sin(heading)", "r|r|",
    "a|a|", "x", "y",
)  # fmt: skip
OF_SIGNALS = ("t", "u", "|u|", "u|u|", "sgn(du/dt)", "v", "v u", "cos(heading)", "sin(heading)", "y", "y|y|")
STEP_TIMES = 12  # at which something may have changed, over all runs
SMOOTH = 0.1  # [s] of the steering rate whose sign counts
STILL = 0.005  # [rad/s] steering rate below which its sign fades


@dataclass(frozen=True)
class Trajectory:
    """The fitted motion on the grid of all windows.

    values : name of a state, input or output -> (N,); offsets : (w + 1,) of the windows; times : (N,)
    run : (N,)
    """

    values: Mapping[str, Array]
    offsets: NDArray[np.intp]
    times: Array
    run: NDArray[np.intp]

    def __getitem__(self, name: str) -> Array:
        """Values of a state, input or output."""
        return self.values[name]


def trajectory_of(point: VehiclePoint) -> Trajectory:
    """Simulate the fitted model."""
    problem, windows = point.problem, point.problem.windows
    inputs, _ = problem.driven(point.shared, point.of_runs)
    engine = problem.engine
    states, outputs = engine.simulate(
        np.ascontiguousarray(point.local[:, : problem.states]),
        inputs,
        windows.steps,
        windows.offsets,
        problem.parameters(point.shared, point.of_runs),
    )
    values = dict(zip(engine.inputs, inputs.T, strict=True))
    values |= dict(zip(engine.outputs, outputs.T, strict=True))
    values |= {f"state.{name}": column for name, column in zip(engine.states, states.T, strict=True)}
    values |= {
        name: column for name, column in zip(engine.states, states.T, strict=True) if name not in values
    }
    run = np.repeat(windows.run, np.diff(windows.offsets))
    return Trajectory(values, windows.offsets, windows.times, run)


def basis(path: Trajectory) -> dict[str, Array]:
    """The functions of the basis along the motion, each of about unit size."""
    angle, speed = path["road_wheel_angle"], path["longitudinal_velocity"]
    rate = steering_rate(path)
    turn = path["state.yaw_rate"]
    felt = path["felt_acceleration"]
    u, v = scaled(angle), speed / max(float(np.mean(np.abs(speed))), 1e-3)
    heading = path["state.heading"]
    made = {
        "1": np.ones(u.size),
        "t": _in_runs(path),
        "u": u,
        "|u|": np.abs(u),
        "u|u|": u * np.abs(u),
        "u^3": u**3,
        "sgn(du/dt)": np.tanh(rate / STILL),
        "v": v,
        "v u": v * u,
        "cos(heading)": np.cos(heading),
        "sin(heading)": np.sin(heading),
        "r|r|": scaled(turn) * np.abs(scaled(turn)),
        "a|a|": scaled(felt) * np.abs(scaled(felt)),
        "x": scaled(path["state.position_x"] - np.mean(path["state.position_x"])),
        "y": scaled(path["state.position_y"] - np.mean(path["state.position_y"])),
    }
    return {name: np.asarray(values) for name, values in made.items()}


def sizes_of(path: Trajectory) -> dict[str, float]:
    """What the functions of the basis were divided by, where they were."""
    u, r, a = (_size(path[name]) for name in ("road_wheel_angle", "state.yaw_rate", "felt_acceleration"))
    v = max(float(np.mean(np.abs(path["longitudinal_velocity"]))), 1e-3)
    x, y = (_size(path[f"state.position_{k}"] - np.mean(path[f"state.position_{k}"])) for k in "xy")
    made = {"u": u, "|u|": u, "u|u|": u**2, "u^3": u**3, "v": v, "v u": v * u}
    return made | {"r|r|": r**2, "a|a|": a**2, "x": x, "y": y}


def _size(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def steering_rate(path: Trajectory) -> Array:
    """(N,) rate of the road-wheel angle [rad/s], smoothed within windows."""
    made = np.zeros(path.times.size)
    for begin, end in zip(path.offsets[:-1].tolist(), path.offsets[1:].tolist(), strict=True):
        times = path.times[begin:end]
        period = times[1] - times[0]
        smooth = gaussian_filter1d(path["road_wheel_angle"][begin:end], SMOOTH / period)
        made[begin:end] = np.gradient(smooth, period)
    return made


def scaled(values: Array) -> Array:
    """Divided by the root mean square."""
    size = _size(values)
    return values / size if size > 0 else values


def _in_runs(path: Trajectory) -> Array:
    """Time within each run, from -1 to 1."""
    made = np.zeros(path.times.size)
    for run in np.unique(path.run):
        own = path.run == run
        times = path.times[own]
        made[own] = 2 * (times - times.min()) / max(float(np.ptp(times)), 1e-9) - 1
    return made


def driven_since(path: Trajectory) -> Array:
    """(N,) seconds of driving before each instant, over all windows."""
    lengths = [0.0]
    for begin, end in zip(path.offsets[:-1].tolist(), path.offsets[1:].tolist(), strict=True):
        lengths.append(float(path.times[end - 1] - path.times[begin]))
    before = np.repeat(np.cumsum(lengths)[:-1], np.diff(path.offsets))
    return before + path.times - np.repeat(path.times[path.offsets[:-1]], np.diff(path.offsets))


def push(equation: str, values: Array, sizes: Mapping[str, float]) -> Probe:
    """A disturbance of one equation by a function of about unit size.

    sizes : mass, yaw_inertia
    """
    scale = {"yaw_moment": sizes["yaw_inertia"]}.get(equation, sizes["mass"])
    port = {"front_tyre": "front_lateral_force"}.get(equation, equation)
    return Probe(inputs={f"probe.{port}": scale * values})


def steps(path: Trajectory) -> Sequence[tuple[float, Array]]:
    """(seconds of driving, (N,) one after it) for the times at which something may have changed."""
    driven = driven_since(path)
    edges = np.linspace(driven.min(), driven.max(), STEP_TIMES + 2)[1:-1]
    return [(float(edge), (driven > edge).astype(np.float64)) for edge in edges]


def pushed_by(
    key: str, at: Mapping[str, float], path: Trajectory, parameters: Mapping[str, float]
) -> dict[str, Array] | None:
    """Input of the model -> (N,) what a unit of a generic term adds to it; None where it is no push.

    A unit is that of the term as it is written, in SI: of "yaw_moment: r|r|" 1 rad/s² per (rad/s)².

    key : as of the screen, such as "yaw_moment: r|r|"; at : what its shape holds
    """
    equation, _, name = key.partition(": ")
    if equation not in EQUATIONS:
        return None
    if "since" in at:
        values = (driven_since(path) > at["since"]).astype(np.float64)
        values = values * (scaled(path["felt_acceleration"]) if equation == "front_tyre" else 1.0)
    else:
        values = basis(path)[name] * sizes_of(path).get(name, 1.0)
    return dict(push(equation, values, parameters).inputs)
