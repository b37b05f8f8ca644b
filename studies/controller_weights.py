"""The gains of the controllers, chosen by the rule of ``ident.control.controllers.weights``.

    python studies/controller_weights.py [--candidates 12] [--seed 1] [--only NAME ...] [--out FILE]

Gains are drawn around those in use, and the closed loops of the tuning scenarios are driven with each: lane
changes of another width and at other speeds than the validation reports, some from a start beside the road,
on the truck as it is believed to be, with 0.15 s more dead time, with softer tyres, and with a controller
that believes it to be kinematic. The cost of a run is that of the rule; a lost path costs ``LOST``. What
costs least over all is told beside what is in use.

A regulator takes its weights from the acceptable deviations; for it, what is told is the largest dead time
beside the estimate with which it keeps the tuning path, were the steering's deviations larger or smaller.
For the MPC on the kinematic model it is the cost by its acceptable heading error, beside that of the MPC
that knows the tyres.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from ident.control.closed_loop import ClosedLoop, Disturbance, run
from ident.control.controllers import CONTROLLERS
from ident.control.controllers.controller import Controller
from ident.control.controllers.weights import (
    ACCEPTABLE,
    PID_GAINS,
    PURE_PURSUIT_GAINS,
    STANLEY_GAINS,
    weights_of,
)
from ident.control.paths import lane_change_length, single_lane_change
from ident.control.plant import Plant
from ident.control.reference import Reference
from ident.control.scenarios import reference
from ident.control.speed_profile import SpeedLimits
from ident.control.truck import SteeringActuator, Truck

PERIOD = 0.05  # [s]
LOST = 1e3
SPREAD = 0.4  # standard deviation of the logarithm of a candidate's numbers
STIFFNESS = ("front.cornering_stiffness", "rear.cornering_stiffness")
COUNTED = ("lateral_error", "heading_error", "steering_rate", "steering_request")
CHOSEN = {"pid": PID_GAINS, "pure_pursuit": PURE_PURSUIT_GAINS, "stanley": STANLEY_GAINS}
FACTORS = (0.5, 1.0, 2.0, 4.0)  # of the steering's acceptable deviations
DELAYS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3)  # [s]
HEADINGS = tuple(ACCEPTABLE["heading_error"] / 2.0 ** (0.5 * step) for step in range(5))  # [rad]
KINEMATIC, DYNAMIC = "mpc_time_kinematic", "mpc_time"
FIXED = ("softening_speed", "shortest_look_ahead", "integral_time")  # matter at low speed, or slowly

TRUCK = Truck(
    model="linear",
    parameters={
        "mass": 12500.0,
        "yaw_inertia": 52000.0,
        "cg_to_front_axle": 2.38,
        "cg_to_rear_axle": 2.12,
        "front.cornering_stiffness": 328000.0,
        "rear.cornering_stiffness": 417000.0,
    },
    steering=SteeringActuator(0.986, 0.1173, 0.262, 0.081, np.array([[-10.25, -0.5], [10.25, 0.5]])),
)


@dataclass(frozen=True)
class Tuning:
    """One closed loop of the tuning: width [m] and speed [m/s] of a lane change, start, simulated truck.

    believed : what the controller is made from
    """

    width: float
    speed: float
    start: Disturbance
    truck: Truck
    believed: Truck = TRUCK


def scenarios() -> list[Tuning]:
    """All closed loops that a candidate is driven in."""
    late = replace(TRUCK, steering=replace(TRUCK.steering, dead_time=TRUCK.steering.dead_time + 0.15))
    values = dict(TRUCK.parameters)
    soft = replace(TRUCK, parameters=values | {name: 0.8 * values[name] for name in STIFFNESS})
    beside = Disturbance(lateral_error=-0.4, heading_error=0.02)
    made = [
        Tuning(width, speed, Disturbance(), truck)
        for width, speed in ((2.0, 15.0), (3.0, 25.0))
        for truck in (TRUCK, late, soft)
    ]
    kinematic = replace(TRUCK, model="kinematic")
    made += [Tuning(2.0, 15.0, beside, late), Tuning(3.0, 25.0, beside, late)]
    return [*made, Tuning(2.0, 15.0, Disturbance(), TRUCK, kinematic)]


@cache
def path_of(width: float, speed: float, model: str = TRUCK.model) -> Reference:
    """A lane change at 1.5 m/s², with the steady cornering of a model."""
    limits = SpeedLimits(set_speed=speed, lateral_acceleration=1.5)
    length = lane_change_length(1.5 / speed**2, width)
    path = single_lane_change(length, offset=width, lead_in=speed, run_out=4 * speed)
    return reference(path, replace(TRUCK, model=model), limits)


def cost(loop: ClosedLoop) -> float:
    """Mean over time of the rule's cost; ``LOST`` where the path was lost."""
    if not loop.completed:
        return LOST
    steps = np.diff(loop.times)
    wheels = loop.states["road_wheel_angle"]
    wanted = np.interp(loop.arc_length, loop.reference.arc_length, loop.reference.road_wheel_angle)
    squares = {
        "lateral_error": loop.lateral_error[1:] ** 2,
        "heading_error": loop.heading_error[1:] ** 2,
        "steering_rate": (np.diff(wheels) / steps) ** 2,
        "steering_request": (wheels - wanted)[1:] ** 2,
    }
    total = sum(square / ACCEPTABLE[name] ** 2 for name, square in squares.items())
    return float(np.sum(total * steps) / np.sum(steps))


def cost_of(name: str, weights: Mapping[str, float]) -> float:
    """Mean cost of a controller over all tuning scenarios."""
    made: dict[str, Controller] = {}
    costs = []
    for one in scenarios():
        model = one.believed.model
        if model not in made:
            made[model] = CONTROLLERS[name](one.believed, PERIOD, weights)
        road = path_of(one.width, one.speed, model)
        costs.append(cost(run(Plant(one.truck), made[model], road, one.start)))
    return float(np.mean(costs))


def candidates(name: str, count: int, seed: int) -> list[dict[str, float]]:
    """What is in use, and drawings around it."""
    random = np.random.default_rng([seed, list(CHOSEN).index(name)])
    used = dict(CHOSEN[name])
    drawn = [
        {
            key: value * (1.0 if key in FIXED else float(np.exp(SPREAD * random.normal())))
            for key, value in used.items()
        }
        for _ in range(count)
    ]
    return [used, *drawn]


def margin(factor: float) -> float:
    """Largest dead time beside the estimate with which the LQR keeps the path [s]."""
    weights = {name: value * (factor if "steering" in name else 1.0) for name, value in ACCEPTABLE.items()}
    controller = CONTROLLERS["lqr"](TRUCK, PERIOD, weights)
    held = 0.0
    for delay in DELAYS:
        late = replace(TRUCK, steering=replace(TRUCK.steering, dead_time=TRUCK.steering.dead_time + delay))
        if not run(Plant(late), controller, path_of(3.0, 25.0)).completed:
            break
        held = delay
    return held


def damped() -> dict[str, float]:
    """Cost of the MPC without tyres by its acceptable heading error, and of the one with."""
    own = weights_of(KINEMATIC)
    told = {f"{size:.4f}": cost_of(KINEMATIC, own | {"heading_error": size}) for size in HEADINGS}
    return told | {DYNAMIC: cost_of(DYNAMIC, weights_of(DYNAMIC))}


def searched(name: str, count: int, seed: int) -> dict[str, object]:
    """What is in use and what costs least."""
    tried = candidates(name, count, seed)
    costs = [cost_of(name, weights) for weights in tried]
    best = int(np.argmin(costs))
    print(f"{name}: in use {costs[0]:.3f}, best of {len(tried)} {costs[best]:.3f}", tried[best], flush=True)
    return {"used": tried[0], "cost": costs[0], "best": tried[best], "best_cost": costs[best]}


def main() -> None:
    """Search, tell and write."""
    parser = argparse.ArgumentParser(description="gains of the controllers")
    parser.add_argument("--candidates", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    every = [*CHOSEN, "lqr", KINEMATIC]
    parser.add_argument("--only", choices=every, nargs="*", default=every)
    parser.add_argument("--out", type=Path, default=Path("studies/results/controller_weights.json"))
    asked = parser.parse_args()
    told: dict[str, object] = json.loads(asked.out.read_text()) if asked.out.exists() else {}
    told |= {name: searched(name, asked.candidates, asked.seed) for name in asked.only if name in CHOSEN}
    if "lqr" in asked.only:
        told["lqr"] = {f"{factor:g}": margin(factor) for factor in FACTORS}
        print("lqr: dead time held, by factor of the steering's deviations", told["lqr"], flush=True)
    if KINEMATIC in asked.only:
        told[KINEMATIC] = damped()
        print("kinematic MPC: cost by acceptable heading error", told[KINEMATIC], flush=True)
    asked.out.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
