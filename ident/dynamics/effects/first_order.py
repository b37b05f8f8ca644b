"""What a small effect would add to a model at its ports, along a trajectory of the model without it.

Nothing is compiled for it: the expression that an effect puts at a port is differentiated to its parameters
at zero and evaluated by NumPy along the trajectory; the probes (:mod:`ident.dynamics.effects.probes`) carry
it on to the outputs. What has a state of its own is run as a filter along the trajectory, a play as it is.

Parameters that mean nothing at size zero (the width of a play, the frequency of a mode, how a load is shared)
are tried at a few values each: every one is a *shape* of the effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise, product

import numpy as np
import sympy
from numpy.typing import NDArray

from ident.dynamics.blocks import lagged, oscillating, play
from ident.dynamics.constants import GRAVITY
from ident.dynamics.effects.effect import Effect
from ident.dynamics.effects.load_transfer import SLIGHT
from ident.dynamics.effects.probes import PORTS
from ident.dynamics.effects.road_bank import ROAD_BANK
from ident.dynamics.effects.sensor_bias import sensor_bias
from ident.dynamics.effects.steering_offset import STEERING_OFFSET
from ident.dynamics.effects.steering_ratio_nonlinearity import STEERING_RATIO_NONLINEARITY
from ident.dynamics.effects.tyre_relaxation import LENGTH, rolling_rate
from ident.dynamics.effects.wheel_speed_scale import WHEEL_SPEED_SCALE
from ident.dynamics.engine import Engine
from ident.dynamics.printing import ArrayPrinter
from ident.dynamics.symbols import symbol
from ident.glossary import AXLES

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

PLAY_WIDTHS = (0.0005, 0.001, 0.002, 0.004, 0.008, 0.016)  # [rad] at the road wheels
FRONT_SHARES = (0.15, 0.35, 0.55, 0.75)
ROLL_FREQUENCIES = (3.0, 4.5, 6.5, 9.0)  # [rad/s]
ROLL_DAMPINGS = (0.15, 0.5)

# Names at the ports -> names along a trajectory, where they differ.
ALONG = {
    "road_wheel_angle": "steered_angle",
    "front_working_slip": "front_slip_angle",
    "rear_working_slip": "rear_slip_angle",
    "front_lateral_force": "front_static_force",
    "rear_lateral_force": "rear_static_force",
    "settled_acceleration": "felt_acceleration",
}
PROBED = {port: name for name, port in PORTS.items()} | {"longitudinal_velocity": "longitudinal_velocity"}
MEASURED = "measured_"
VALUE = "value of the port"


@dataclass(frozen=True)
class Trajectory:
    """What a model with ``PROBES`` did, at the grid points of all segments.

    values : name -> (N,) inputs, and outputs by their names; steps : (N,) to the next grid point [s]
    offsets : (s + 1,) first grid point of each segment, and N
    parameters : name -> value, the same in all segments: of the body, and what effects take as given
    """

    values: Mapping[str, Array]
    steps: Array
    offsets: Integers
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class ShapeColumns:
    """One form of an effect at first order.

    at : parameters that this form holds, such as {"frequency": 4.5}
    free : parameters that its columns stand for, in order; a column is the change per unit of its parameter
    inputs : input of the model -> (N, d) what is added to it
    signals : output -> (N, d) what is added to it and to nothing else
    """

    at: Mapping[str, float]
    free: tuple[str, ...]
    inputs: Mapping[str, Array]
    signals: Mapping[str, Array]


def trajectory_of(
    engine: Engine,
    inputs: Array,
    outputs: Array,
    steps: Array,
    offsets: Integers,
    parameters: Mapping[str, float],
) -> Trajectory:
    """Name what ``Engine.simulate`` was given and gave.

    inputs : (N, nu); outputs : (N, ny); steps : (N,) [s]; offsets : (s + 1,)
    """
    values = dict(zip(engine.outputs, outputs.T, strict=True)) | dict(
        zip(engine.inputs, inputs.T, strict=True)
    )
    return Trajectory(values, steps, np.asarray(offsets, dtype=np.int64), parameters)


def first_order(key: str, along: Trajectory) -> list[ShapeColumns]:
    """All shapes of an effect along a trajectory.

    key : its name, and after a blank the signal that it acts on where it acts on one: "sensor_bias yaw_rate"

    Raises
    ------
    KeyError
        If the effect has no form of first order here, or the trajectory lacks what it needs.
    """
    name, _, of = key.partition(" ")
    return ON_A_SIGNAL[name](along, of) if of else SHAPES[name](along)


def _plain(effect: Effect) -> Callable[[Trajectory], list[ShapeColumns]]:
    """Of an effect all of whose parameters are sizes."""
    return lambda along: [_of_changes(effect, along, effect.parameter_names, {})]


def _load_transfer(along: Trajectory) -> list[ShapeColumns]:
    size, share = SLIGHT.parameter_names
    return [_of_changes(SLIGHT, along, (size,), {share: value}) for value in FRONT_SHARES]


def _relaxation(along: Trajectory) -> list[ShapeColumns]:
    """What is missing of the forces while a tyre of the typical length rolls, over that length.

    The exact derivative at length zero, -Ḟ/|v|, has no bound where the truck crawls.
    """
    return [relaxation_of_length(along, LENGTH.typical)]


def relaxation_of_length(along: Trajectory, length: float) -> ShapeColumns:
    """Change of both axle forces per length, of a tyre with this length [m]."""
    rate = rolling_rate(along.values["longitudinal_velocity"], length)
    inputs = {}
    for axle in AXLES:
        force = along.values[f"{axle}_static_force"]
        late = lagged(force, rate, along.steps, along.offsets) - force
        inputs[f"probe.{axle}_lateral_force"] = (late / length)[:, None]
    return ShapeColumns({"length": length}, ("length",), inputs, {})


def _roll(along: Trajectory) -> list[ShapeColumns]:
    made = []
    for frequency, damping in product(ROLL_FREQUENCIES, ROLL_DAMPINGS):
        felt = along.values["felt_acceleration"]
        angle = oscillating(felt, frequency, damping, along.steps, along.offsets)
        at = {"frequency": frequency, "damping": damping}
        read = {"lateral_acceleration": GRAVITY * angle[:, None]}
        made.append(ShapeColumns(at, ("gain",), {}, read))
    return made


def _linkage_play(along: Trajectory) -> list[ShapeColumns]:
    """Play of each width over each segment, the linkage in the middle of it at first."""
    angle = along.values["road_wheel_angle"]
    made = []
    for width in PLAY_WIDTHS:
        follows = [play(part, width)[0] for part in _parts(angle, along.offsets)]
        column = ((np.concatenate(follows) - angle) / width)[:, None]
        made.append(ShapeColumns({"width": width}, ("width",), {"probe.road_wheel_angle": column}, {}))
    return made


def _bias(along: Trajectory, signal: str) -> list[ShapeColumns]:
    effect = sensor_bias(signal)
    one = _of_changes(effect, along, effect.parameter_names, {})
    return [ShapeColumns({}, ("bias",), one.inputs, one.signals)]


def _latency(along: Trajectory, signal: str) -> list[ShapeColumns]:
    """-dy/dt, by differences within each segment."""
    return [ShapeColumns({}, ("delay",), {}, {signal: -rate_of(along, signal)[:, None]})]


def _scale(along: Trajectory, signal: str) -> list[ShapeColumns]:
    return [ShapeColumns({}, ("scale",), {}, {signal: along.values[signal][:, None]})]


def rate_of(along: Trajectory, name: str) -> Array:
    """(N,) derivative to time, by central differences within each segment."""
    values, made = along.values[name], []
    for first, last in pairwise(along.offsets.tolist()):
        times = np.concatenate([[0.0], np.cumsum(along.steps[first : last - 1])])
        part = values[first:last]
        made.append(np.gradient(part, times) if part.size > 1 else np.zeros(part.size))
    return np.concatenate(made) if made else np.zeros(0)


def _parts(values: Array, offsets: Integers) -> list[Array]:
    return [values[first:last] for first, last in pairwise(offsets.tolist())]


def _of_changes(
    effect: Effect, along: Trajectory, free: Sequence[str], at: Mapping[str, float]
) -> ShapeColumns:
    """Derivatives of all that an effect changes to its free parameters, at zero."""
    inputs, signals = {}, {}
    for port in effect.changes:
        columns = _columns(effect, port, along, tuple(free), at)
        if port.startswith(MEASURED):
            signals[port.removeprefix(MEASURED)] = columns
        else:
            inputs[PROBED[port]] = columns
    return ShapeColumns(_short(at), tuple(_short(dict.fromkeys(free, 0.0))), inputs, signals)


def _short(values: Mapping[str, float]) -> dict[str, float]:
    return {name.rpartition(".")[2]: value for name, value in values.items()}


def _columns(
    effect: Effect, port: str, along: Trajectory, free: tuple[str, ...], at: Mapping[str, float]
) -> Array:
    """(N, d) change of one port per unit of each free parameter."""
    names, function = _derivative(effect, port, free)
    values = {parameter.name: parameter.typical for parameter in effect.given} | dict(at)
    own = ALONG.get(port, port.removeprefix(MEASURED))
    arguments = [
        along.values[own] if name == VALUE else _value(ALONG.get(name, name), along, values) for name in names
    ]
    found = function(*arguments)
    count = along.steps.size
    return np.stack([np.broadcast_to(np.asarray(one, dtype=np.float64), (count,)) for one in found], axis=1)


def _value(name: str, along: Trajectory, values: Mapping[str, float]) -> Array | float:
    if name in along.values:
        return along.values[name]
    return along.parameters[name] if name in along.parameters else values[name]


class _Known(dict[str, sympy.Expr]):
    """What is known at a port: every name, and the force of a tyre is its static one."""

    def __missing__(self, name: str) -> sympy.Expr:
        return symbol(name)


@cache
def _derivative(
    effect: Effect, port: str, free: tuple[str, ...]
) -> tuple[tuple[str, ...], Callable[..., list[Array]]]:
    """Names of the arguments, and the derivatives of a change to free parameters at zero, by NumPy."""
    changed = sympy.sympify(effect.changes[port](symbol(VALUE), _Known()))
    zero = {symbol(name): 0 for name in free}
    slopes = [sympy.diff(changed, symbol(name)).subs(zero) for name in free]
    used = sorted(set().union(*(slope.free_symbols for slope in slopes)), key=str)
    function: Callable[..., list[Array]] = sympy.lambdify(
        used, slopes, [{"np": np}], printer=ArrayPrinter({}), cse=True, dummify=True
    )
    return tuple(str(one) for one in used), function


SHAPES: dict[str, Callable[[Trajectory], list[ShapeColumns]]] = {
    "steering_linkage_play": _linkage_play,
    "steering_offset": _plain(STEERING_OFFSET),
    "steering_ratio_nonlinearity": _plain(STEERING_RATIO_NONLINEARITY),
    "load_transfer": _load_transfer,
    "tyre_relaxation": _relaxation,
    "road_bank": _plain(ROAD_BANK),
    "body_roll": _roll,
    "wheel_speed_scale": _plain(WHEEL_SPEED_SCALE),
}
ON_A_SIGNAL: dict[str, Callable[[Trajectory, str], list[ShapeColumns]]] = {
    "sensor_bias": _bias,
    "sensor_latency": _latency,
    "gyro_scale": _scale,
}
