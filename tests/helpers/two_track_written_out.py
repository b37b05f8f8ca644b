"""The two-track model written out by hand in Python numbers, and any model as a function of numbers.

The equations share nothing with the model under test: wheels in a loop, angles by ``atan2``, loads by the
moments of the whole vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import sympy
from numpy.typing import NDArray

from ident.dynamics.derivation import derive
from ident.dynamics.printing import ArrayPrinter
from ident.dynamics.system import System, symbol

Array = NDArray[np.float64]
Curve = Callable[[float], float]
GRAVITY = 9.81


def in_numbers(system: System) -> Callable[[Mapping[str, float]], dict[str, float]]:
    """Rates as "d.<state>" and outputs of a model at a named point, without compiling anything."""
    every = [*system.states, *system.inputs, *system.parameters, *system.intermediates]
    names = {symbol(name): f"v{k}" for k, name in enumerate(every)}
    printer = ArrayPrinter(names)
    results = {f"d.{name}": value for name, value in system.states.items()} | dict(system.outputs)
    lines = [f"{names[symbol(name)]} = {printer.doprint(v)}" for name, v in system.intermediates.items()]
    text = [printer.doprint(sympy.sympify(value)) for value in results.values()]
    given = ", ".join(names[symbol(name)] for name in every[: -len(system.intermediates)])
    body = "\n    ".join([*lines, f"return [{', '.join(text)}]"])
    space: dict[str, object] = {"np": np}
    exec(f"def of({given}):\n    {body}\n", space)
    order = [*system.states, *system.inputs, *system.parameters]

    def at(point: Mapping[str, float]) -> dict[str, float]:
        with np.errstate(all="ignore"):
            found = space["of"](*(np.float64(point[name]) for name in order))  # type: ignore[operator]
        return dict(zip(results, map(float, found), strict=True))

    return at


def gradient(system: System, point: Mapping[str, float]) -> dict[tuple[str, str], float]:
    """("d.<state>", name) -> derivative of a rate, of all that are not identically zero."""
    block = derive(system).rates_with_jacobian
    every = {"x": list(system.states), "u": list(system.inputs), "p": list(system.parameters)}
    given = [name for names in every.values() for name in names]
    names = {symbol(name): f"v{k}" for k, name in enumerate(given)}
    names |= {name: f"w{k}" for k, (name, _) in enumerate(block.assignments)}
    printer = ArrayPrinter(names)
    space: dict[str, object] = {"np": np} | {f"v{k}": np.float64(point[n]) for k, n in enumerate(given)}
    with np.errstate(all="ignore"):
        for name, value in block.assignments:
            space[names[name]] = eval(printer.doprint(value), space)
        found = [float(eval(printer.doprint(value), space)) for value in block.jacobian]
    rates = [f"d.{name}" for name in system.states]
    return {
        (rates[row], every[kind][column]): found[place]
        for kind, entries in block.entries.items()
        for (row, column), place in entries.items()
    }


def wheel_places(p: Mapping[str, float], axles: tuple[int, int]) -> list[tuple[str, float, float, int]]:
    """(group, x, y, number of the axle in its group), front to rear, left before right."""
    places = []
    for group, count in zip(("front", "rear"), axles, strict=True):
        middle = p["cg_to_front_axle"] if group == "front" else -p["cg_to_rear_axle"]
        for j in range(count):
            x = middle + (0.5 * (count - 1) - j) * p.get(f"{group}_spacing", 0.0)
            places += [(group, x, side * p[f"{group}_track"] / 2, j) for side in (1, -1)]
    return places


def wheel_loads(
    p: Mapping[str, float], axles: tuple[int, int], lifted: int | None, sideways: float
) -> list[float]:
    """Loads [N] at a lateral acceleration [m/s²]; the lifted axle is one of the rear ones."""
    u = p.get("rear_lift", 0.0) if lifted is not None else 0.0
    weights = {"front": [1.0 / axles[0]] * axles[0], "rear": [1.0 / axles[1]] * axles[1]}
    if lifted is not None:
        others = axles[1] - 1
        weights["rear"] = [(1 - u if j == lifted else 1 + u / others) / axles[1] for j in range(axles[1])]
    places = wheel_places(p, axles)
    at = {
        group: sum(weights[group][j] * x for g, x, y, j in places if g == group and y > 0)
        for group in ("front", "rear")
    }
    weight = p["mass"] * GRAVITY
    loads_of = np.linalg.solve([[1.0, 1.0], [at["front"], at["rear"]]], [weight, 0.0])
    rest = dict(zip(("front", "rear"), loads_of, strict=True))
    loads = []
    for group, _, y, j in places:
        own = weights[group][j] * rest[group]
        share = p["front_roll_share"] if group == "front" else 1 - p["front_roll_share"]
        moved = share * weights[group][j] * p["mass"] * sideways * p["cg_height"] / p[f"{group}_track"]
        moved = min(max(moved, -own / 2), own / 2)
        loads.append(own / 2 - math.copysign(moved, y * moved) if moved else own / 2)
    return loads


def accelerations(
    state: Sequence[float],
    angle: float,
    speed: float,
    p: Mapping[str, float],
    curves: Mapping[str, Curve],
    axles: tuple[int, int] = (1, 1),
    lifted: int | None = None,
) -> tuple[float, float]:
    """Lateral force over mass [m/s²], yaw acceleration [rad/s²] of a vehicle that rolls forward."""
    across, turn = state[0], state[1]
    wheelbase = p["cg_to_front_axle"] + p["cg_to_rear_axle"]
    s = p["load_sensitivity"]
    pushed, moment = 0.0, 0.0
    loads = wheel_loads(p, axles, lifted, speed * turn)
    for (group, x, y, _), load in zip(wheel_places(p, axles), loads, strict=True):
        share = p["ackermann_share"] * y / wheelbase
        wheel = math.atan(math.tan(angle) / (1 - share * math.tan(angle))) if group == "front" else 0.0
        slip = wheel - math.atan2(across + x * turn, speed - y * turn)
        count = axles[0 if group == "front" else 1]
        other = p["cg_to_rear_axle" if group == "front" else "cg_to_front_axle"]
        z = load / (p["mass"] * GRAVITY * other / wheelbase / count / 2)
        peak = (1 + s) / (2 * s) if s else math.inf  # load at which the stiffness is largest
        stiffness = min(z, peak) * (1 + s - s * min(z, peak))
        force = z * curves[group](stiffness / z * slip) / (2 * count) if z > 0 else 0.0
        forward, left = -force * math.sin(wheel), force * math.cos(wheel)
        pushed += left
        moment += x * left - y * forward
    return pushed / p["mass"], moment / p["yaw_inertia"]
