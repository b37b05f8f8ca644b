"""An evaluation and its table as the stage gives them, from a simulation that shares nothing with ident.

The truth is the planar truck of ``tyre_case``; the models are that truck with other tyres, and a truck whose
tyres do not slip, each simulated over whole runs from the true state. Names are hostile on purpose.
"""

import numpy as np
import pandas as pd
import tyre_case
from tyre_case import FRONT, MASS, REAR, known

from ident.results import (
    AccelerationBand,
    Characteristic,
    Check,
    Comparison,
    Error,
    EvaluatedModel,
    EvaluateResult,
    Refusal,
    Requirement,
    RunError,
)

STEP = 0.02
HOSTILE = 'manual_b <img src=x onerror="window.injected=1"></script>'
RUNS = ["day 1/manual_a", HOSTILE, "manual_c"]
DRIVES = [(RUNS[0], 1, 26.0, 8.0, 0.10), (RUNS[1], 2, 20.0, 13.0, 0.075), (RUNS[2], 3, 22.0, 14.0, 0.11)]
MODELS = ("kinematic", "linear", "piecewise_linear", "brush", "magic_formula")
ASKED = "brush"
COSTS = dict(zip(MODELS, (21.0, 64.0, 72.0, 118.0, 151.0), strict=True))
STATES = ("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")
NOISE = {
    "yaw_rate": (0.004, "rad/s"),
    "lateral_acceleration": (0.08, "m/s^2"),
    "lateral_velocity": (0.03, "m/s"),
    "heading": (0.003, "rad"),
    "position_x": (0.03, "m"),
    "position_y": (0.03, "m"),
    "longitudinal_velocity": (0.02, "m/s"),
    "road_wheel_angle": (0.0005, "rad"),
}
ACCEPTABLE = {
    "yaw_rate": 0.004,
    "lateral_acceleration": 0.055,
    "lateral_velocity": 0.1,
    "heading": 0.012,
    "position_x": 0.25,
    "position_y": 0.25,
    "road_wheel_angle": 0.005,
}
SHARES = {"1 s": 0.35, "2 s": 0.55, "5 s": 0.8}
BANDS = ((0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, None))
LAG = 0.25


def axle_force(name, axle, slip):
    stiffness, peak, _, _ = axle
    if name == "linear":
        return stiffness * slip
    if name == "piecewise_linear":
        return stiffness * np.clip(slip, -peak / stiffness, peak / stiffness)
    return tyre_case.force(axle, slip * (1.02 if name == "brush" else 1.0))


def derivatives(name, truck, state, angle, speed):
    """Give the derivatives of the state and the lateral acceleration."""
    velocity, rate, heading = state[0], state[1], state[2]
    course = [
        rate,
        speed * np.cos(heading) - velocity * np.sin(heading),
        speed * np.sin(heading) + velocity * np.cos(heading),
    ]
    if name == "kinematic":
        wanted = speed * np.tan(angle) / (FRONT + REAR)
        return np.array([(REAR * wanted - velocity) / 0.02, (wanted - rate) / 0.02, *course]), speed * rate
    front = axle_force(name, truck["front"], angle - np.arctan((velocity + FRONT * rate) / speed))
    rear = axle_force(name, truck["rear"], -np.arctan((velocity - REAR * rate) / speed))
    acceleration = (front * np.cos(angle) + rear) / MASS
    turning = (FRONT * front * np.cos(angle) - REAR * rear) / truck["yaw_inertia"]
    return np.array([acceleration - speed * rate, turning, *course]), acceleration


def drive(name, truck, angle, speed):
    state = np.array([0.0, 0.0, 0.3, 500_000.0, 4_000_000.0])
    rows = np.empty((angle.size, 6))
    for index in range(angle.size):
        first, acceleration = derivatives(name, truck, state, angle[index], speed[index])
        rows[index] = [*state, acceleration]
        middle, _ = derivatives(name, truck, state + 0.5 * STEP * first, angle[index], speed[index])
        state = state + STEP * middle
    found = dict(zip((*STATES, "lateral_acceleration"), rows.T, strict=True))
    return {**found, "longitudinal_velocity": speed, "road_wheel_angle": angle}


def lagging(angle):
    """Give the angle that the request would lead to through a slightly wrong actuator."""
    wrong = np.empty_like(angle)
    state = 0.0
    for index, value in enumerate(np.interp(np.arange(angle.size) + 2.0, np.arange(angle.size), angle)):
        state += STEP / LAG * (value - state)
        wrong[index] = state
    return wrong


def run_table(run, seed, seconds, speed, angle):
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, STEP)
    steering = angle * np.sin(2 * np.pi * (0.08 * time + 0.004 * time**2)) * np.clip(time / 5.0, 0.0, 1.0)
    velocity = speed + 1.5 * np.sin(0.2 * time)
    true = drive("truth", tyre_case.TRUTH, steering, velocity)
    table = {"run": run, "time": time, "speed": velocity}
    for signal, (std, _) in NOISE.items():
        table[signal] = true[signal] + rng.normal(0.0, std, time.size)
    table["lateral_velocity"][::2] = np.nan
    for model in MODELS:
        given = {name: table[name] for name in ("longitudinal_velocity", "road_wheel_angle")}
        table |= columns(model, drive(model, tyre_case.MODEL, steering, velocity) | given, "")
    asked = drive(ASKED, tyre_case.MODEL, lagging(steering), velocity)
    asked["longitudinal_velocity"] = table["longitudinal_velocity"]
    return pd.DataFrame(table | columns(ASKED, asked, "__request"))


def columns(model, found, ending):
    return {f"{signal}__{model}{ending}": found[signal] for signal in NOISE}


def build_table():
    return pd.concat([run_table(*each) for each in DRIVES], ignore_index=True)


def size(value, signal, spread=0.12):
    return Error(value, value * (1 - spread), value * (1 + spread), NOISE[signal][1])


def differences(rows, model, ending=""):
    found = {signal: (rows[signal] - rows[f"{signal}__{model}{ending}"]).to_numpy() for signal in NOISE}
    found = {signal: values[np.isfinite(values)] for signal, values in found.items() if signal in ACCEPTABLE}
    return {signal: values for signal, values in found.items() if np.any(values != 0)}


def rms_of(found):
    return {signal: float(np.sqrt(np.mean(values**2))) for signal, values in found.items() if values.size}


def bands_of(table, model, ending):
    bands = []
    for lowest, highest in BANDS:
        driven = table["lateral_acceleration"].abs()
        rows = table[(driven >= lowest) & (driven < (highest or np.inf))]
        rms = {signal: 0.5 * value for signal, value in rms_of(differences(rows, model, ending)).items()}
        rms = {signal: size(value, signal, 0.2) for signal, value in rms.items()}
        bands.append(AccelerationBand(lowest, highest, len(rows) * STEP, rms))
    return bands


def evaluated(table, model, given):
    ending = "__request" if given == "request" else ""
    found = differences(table, model, ending)
    rms = rms_of(found)
    runs = [
        RunError(str(run), float(rows["time"].max()), rms_of(differences(rows, model, ending)))
        for run, rows in table.groupby("run", sort=False)
    ]
    windows = {
        length: {signal: size(share * value, signal) for signal, value in rms.items()}
        for length, share in SHARES.items()
    }
    return EvaluatedModel(
        name=model,
        input=given,
        rms={signal: size(value, signal) for signal, value in rms.items()},
        nrmse={signal: value / float(table[signal].std()) for signal, value in rms.items()},
        vaf={s: 1.0 - float(values.var()) / float(table[s].var()) for s, values in found.items()},
        peak={signal: float(np.abs(values).max()) for signal, values in found.items()},
        windows=windows,
        by_lateral_acceleration=bands_of(table, model, ending),
        valid_to={"kinematic": 0.0, "linear": 2.0}.get(model, 4.0),
        cost_ns_per_step=COSTS[model],
        by_run=runs,
        over_noise={signal: value / (1.4 * NOISE[signal][0]) for signal, value in rms.items()},
    )


def covered(table, speeds, accelerations):
    cells, _, _ = np.histogram2d(
        table["speed"], table["lateral_acceleration"].abs(), bins=[speeds, accelerations]
    )
    return (cells * STEP).tolist()


def characteristics():
    gain = Characteristic(
        "yaw rate gain at 1 rad/s",
        "ISO 14793",
        known(2.21, 0.02, "1/s"),
        {"linear": known(2.36, 0.004, "1/s"), "magic_formula": known(2.24, 0.004, "1/s")},
        0.05,
        {"linear": False, "magic_formula": True},
    )
    gradient = Characteristic(
        "understeer_gradient",
        "ISO 14792",
        known(0.00148, 0.05, "rad s^2/m"),
        {"linear": known(0.00131, 0.02, "rad s^2/m"), "magic_formula": known(0.00150, 0.02, "rad s^2/m")},
        0.1,
        {"linear": False, "magic_formula": True},
    )
    return [gradient, gain]


CHECKS = [
    Check("steering is measured", "fine", "the measured angle lags the request by 0.21 s: it is no echo"),
    Check("sign and unit", "fine", "yaw rate over v tan δ / L is 0.96"),
    Check("reference point", "warning", f"{HOSTILE}: a_y against v r leaves 0.3 m/s²: set reference_point"),
    Check("held-out runs", "fine", "none of the 3 held-out runs was used in the fit"),
]
COMPARISONS = [
    Comparison("magic_formula", "linear", "yaw_rate", known(0.54, 0.03, "1"), 1e-4),
    Comparison("magic_formula", "brush", "yaw_rate", known(0.98, 0.03, "1"), 0.4),
]
REQUIREMENTS = [
    Requirement("yaw_rate", 0.02, 0.0068, "rad/s", met=True),
    Requirement("roll_angle", 0.01, None, "rad", met=None),
]


def build_result(table, provenance, health):
    models = [evaluated(table, model, "measured") for model in MODELS]
    models.append(evaluated(table, ASKED, "request"))
    speeds, accelerations = [5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.0], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    held_out = covered(table, speeds, accelerations)
    training = (0.5 * np.array(held_out) + np.eye(6)).tolist()
    return EvaluateResult(
        schema_version="1",
        provenance=provenance,
        verdict="Usable for control to 4 m/s² at 6.5–15.5 m/s: brush tyres, 118 ns a step.",
        next_step="drive held-out runs beyond 4 m/s² to know more",
        models=models,
        acceptable={signal: Error(v, None, None, NOISE[signal][1]) for signal, v in ACCEPTABLE.items()},
        chosen="brush",
        why="within every acceptable size over 2 s windows at the least cost",
        split_by="run",
        held_out=RUNS,
        training=["manual_d", "manual_e"],
        comparisons=COMPARISONS,
        characteristics=characteristics(),
        checks=CHECKS,
        requirements=REQUIREMENTS,
        coverage={"held_out": held_out, "training": training},
        speed_edges=speeds,
        acceleration_edges=accelerations,
        repeat_noise={"yaw_rate": 0.0056},
        runs=health,
        refused=[Refusal("PAC2002", "the vehicle file names no .tir file: add tyres: file.tir")],
        warnings=["topic <b>%{y}</b>: 3 headings jumped by more than 10° and were left out"],
    )
