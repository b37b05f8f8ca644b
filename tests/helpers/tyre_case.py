"""A tyre result and its tables as the stage gives them, from a simulation that shares nothing with ident.

A planar bicycle with Magic Formula axles is stepped at 100 Hz; the "model" is the same truck with slightly
other parameters, restarted at the truth every 10 s. Run names, topics and reasons are hostile on purpose.
"""

import numpy as np
import pandas as pd

from ident.results import (
    AxleCurve,
    EffectEstimate,
    Estimate,
    FixedValue,
    ForceComparison,
    Refusal,
    ResidualNoise,
    TyreFit,
    TyreRun,
    TyresResult,
)

STEP = 0.01
WINDOW = 10.0
MASS, FRONT, REAR = 12500.0, 2.38, 2.12
TRUTH = {"front": (330e3, 45e3, 1.35, -0.4), "rear": (417e3, 51.5e3, 1.35, -0.5), "yaw_inertia": 52000.0}
MODEL = {"front": (334e3, 44e3, 1.33, -0.5), "rear": (415e3, 53e3, 1.36, -0.4), "yaw_inertia": 51700.0}
SENSORS = {  # standard deviation of the noise, samples between two measurements
    "yaw_rate": (0.004, 1),
    "lateral_acceleration": (0.08, 1),
    "lateral_velocity": (0.03, 2),
    "heading": (0.003, 2),
    "position_x": (0.03, 2),
    "position_y": (0.03, 2),
}
RUNS = ["day 1/planar_a", 'planar_b <img src=x onerror="window.injected=1"></script>', "planar_c"]
STATES = ("lateral_velocity", "yaw_rate", "heading", "position_x", "position_y")


def force(axle, slip):
    stiffness, peak, shape, curvature = axle
    x = stiffness / (shape * peak) * slip
    return peak * np.sin(shape * np.arctan(x - curvature * (x - np.arctan(x))))


def answers(state, angle, speed, truck):
    """Give derivatives and what is measured at one instant."""
    velocity, rate, heading = state[0], state[1], state[2]
    front_slip = angle - np.arctan((velocity + FRONT * rate) / speed)
    rear_slip = -np.arctan((velocity - REAR * rate) / speed)
    front, rear = force(truck["front"], front_slip), force(truck["rear"], rear_slip)
    acceleration = (front * np.cos(angle) + rear) / MASS
    derivatives = np.array(
        [
            acceleration - speed * rate,
            (FRONT * front * np.cos(angle) - REAR * rear) / truck["yaw_inertia"],
            rate,
            speed * np.cos(heading) - velocity * np.sin(heading),
            speed * np.sin(heading) + velocity * np.cos(heading),
        ]
    )
    return derivatives, {
        "lateral_acceleration": acceleration,
        "front_slip_angle": front_slip,
        "rear_slip_angle": rear_slip,
        "front_lateral_force": front,
        "rear_lateral_force": rear,
    }


def drive(angle, speed, truck, restart=None):
    """Step the truck; at every window it begins again at the states of ``restart``."""
    state = np.array([0.0, 0.0, 0.3, 500_000.0, 4_000_000.0])
    rows = []
    for index in range(angle.size):
        if restart is not None and index % round(WINDOW / STEP) == 0:
            state = np.array([restart[name][index] for name in STATES])
        first, outputs = answers(state, angle[index], speed[index], truck)
        rows.append({**dict(zip(STATES, state, strict=True)), **outputs})
        middle, _ = answers(state + 0.5 * STEP * first, angle[index], speed[index], truck)
        state = state + STEP * middle
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def run_tables(name, seed, seconds, speed, angle):
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, STEP)
    steering = angle * np.sin(2 * np.pi * (0.08 * time + 0.004 * time**2)) * np.clip(time / 5.0, 0.0, 1.0)
    velocity = speed + 2.0 * np.sin(0.2 * time)
    true = drive(steering, velocity, TRUTH)
    model = drive(steering, velocity, MODEL, restart=true)
    table = {"run": name, "window": (time // WINDOW).astype(int), "time": time}
    for signal, (std, every) in SENSORS.items():
        measured = true[signal] + rng.normal(0.0, std, time.size)
        measured[np.arange(time.size) % every != 0] = np.nan
        table |= {signal: measured, f"{signal}_model": model[signal]}
    slips = ("front_slip_angle", "rear_slip_angle", "front_lateral_force", "rear_lateral_force")
    table |= {"road_wheel_angle": steering, "speed": velocity} | {key: model[key] for key in slips}
    points = [inverted(name, axle, time, true, rng) for axle in ("front", "rear")]
    return pd.DataFrame(table), points


def inverted(name, axle, time, true, rng):
    """Force inversion as it comes out of a log: noisy, at 20 points a second."""
    at = np.arange(0, time.size, 5)
    return pd.DataFrame(
        {
            "run": name,
            "time": time[at],
            "axle": axle,
            "slip_angle": true[f"{axle}_slip_angle"][at] + rng.normal(0.0, 0.002, at.size),
            "force": true[f"{axle}_lateral_force"][at] + rng.normal(0.0, 900.0, at.size),
            "lateral_acceleration": true["lateral_acceleration"][at],
            "measured_force": np.nan,
        }
    )


def build_tables():
    drives = [(RUNS[0], 1, 40.0, 8.0, 0.16), (RUNS[1], 2, 40.0, 12.0, 0.11), (RUNS[2], 3, 30.0, 13.0, 0.09)]
    made = [run_tables(*each) for each in drives]
    return {
        "tyres": pd.concat([table for table, _ in made], ignore_index=True),
        "tyre_forces": pd.concat([points for _, both in made for points in both], ignore_index=True),
    }


def known(value, relative, unit, status="identified", reason=None):
    std = abs(value) * relative
    return Estimate(value, std, value - 1.96 * std, value + 1.96 * std, unit, status, reason)


NO_PEAK = "the largest force seen is 78 % of the peak: drive to 6 m/s² to see more of the curve"
NAMES = ("cornering_stiffness", "peak_force", "shape", "curvature")
UNITS = ("N/rad", "N", "1", "1")


def axle_estimates(axle, kind):
    stiffness = known(axle[0], 0.008, "N/rad")
    if kind == "linear":
        return {"cornering_stiffness": known(axle[0] * 0.91, 0.006, "N/rad")}
    if kind == "piecewise_linear":
        slip = known(0.11, 0.09, "rad", "weak", NO_PEAK)
        return {"cornering_stiffness": known(axle[0] * 0.95, 0.007, "N/rad"), "saturation_slip": slip}
    curvature = Estimate(axle[3], 3.0, None, None, "1", "not_identifiable", NO_PEAK)
    return {
        "cornering_stiffness": stiffness,
        "peak_force": known(axle[1], 0.06, "N"),
        "shape": known(axle[2], 0.2, "1", "weak", NO_PEAK),
        "curvature": curvature,
    }


def curve_of(kind, estimates):
    slip = np.linspace(-0.25, 0.25, 201)
    values = [estimate.value for estimate in estimates.values()]
    if kind == "magic_formula":
        forces = force(values, slip)
    else:
        limit = values[1] if kind == "piecewise_linear" else np.inf
        forces = values[0] * np.clip(slip, -limit, limit)
    std = 0.006 * np.abs(forces) + 3e6 * np.abs(slip) ** 3
    return AxleCurve(slip.tolist(), forces.tolist(), std.tolist())


def rms_of(table, worse=1.0):
    return {
        signal: worse * float(np.sqrt(np.nanmean((table[signal] - table[f"{signal}_model"]) ** 2)))
        for signal in SENSORS
    }


def build_fit(kind, tables, worse, criterion):
    axles = {axle: axle_estimates(MODEL[axle], kind) for axle in ("front", "rear")}
    parameters = [f"{axle}.{name}" for axle, values in axles.items() for name in values] + ["yaw_inertia"]
    root = np.random.default_rng(5).normal(size=(len(parameters), 2 * len(parameters)))
    covariance = root @ root.T + 3.0
    spread = np.sqrt(np.diag(covariance))
    return TyreFit(
        kind=kind,
        **axles,
        yaw_inertia=known(MODEL["yaw_inertia"], 0.012, "kg m^2"),
        rms=rms_of(tables["tyres"], worse),
        parameters=parameters,
        correlation=(covariance / np.outer(spread, spread)).tolist(),
        excited=excited_of(tables),
        curves={axle: curve_of(kind, axles[axle]) for axle in axles},
        understeer_gradient=known(0.00148, 0.05, "rad s^2/m"),
        characteristic_speed=known(55.1, 0.025, "m/s"),
        to_fixed={
            name: {"mass": 1.0 if "curvature" not in name and "shape" not in name else 0.02}
            for name in parameters
        },
        log_likelihood=-0.5 * criterion + 30.0,
        criterion=criterion,
        converged=True,
    )


def excited_of(tables):
    columns = {axle: tables["tyres"][f"{axle}_slip_angle"] for axle in ("front", "rear")}
    return {axle: [float(slip.min()), float(slip.max())] for axle, slip in columns.items()}


def by_run(tables):
    runs = []
    for name, rows in tables["tyres"].groupby("run", sort=False):
        acceleration = rows["lateral_acceleration_model"]
        runs.append(
            TyreRun(
                run=name,
                windows=int(rows["window"].nunique()),
                seconds=float(rows["time"].max()),
                speed=[float(rows["speed"].min()), float(rows["speed"].max())],
                lateral_acceleration=[float(acceleration.min()), float(acceleration.max())],
                rms=rms_of(rows),
                agreement_p=0.31,
                reference_x=-REAR,
            )
        )
    rejected = TyreRun(
        "parked", 0, 0.0, [0.0, 0.0], [0.0, 0.0], {}, None, False, "stands still <b>always</b>"
    )
    return [*runs, rejected]


def build_result(tables, provenance, health):
    kinds = {"linear": (2.2, -81200.0), "piecewise_linear": (1.4, -83900.0), "magic_formula": (1.0, -84700.0)}
    fits = [build_fit(kind, tables, worse, criterion) for kind, (worse, criterion) in kinds.items()]
    bias = EffectEstimate(
        "sensor_bias",
        "M",
        {"bias": Estimate(0.0021, 1e-4, 0.0019, 0.0023, "rad/s")},
        "yaw_rate",
        None,
        1e-9,
        True,
    )
    offset = {"angle": Estimate(0.0004, 3e-4, -0.0002, 0.001, "rad")}
    return TyresResult(
        schema_version="1",
        provenance=provenance,
        verdict="Identified: cornering stiffness 334 and 415 kN/rad, understeer gradient 1.48 mrad/(m/s²).",
        next_step="drive to 6 m/s² on a wide area to see the peak of the curves",
        fits=fits,
        chosen="magic_formula",
        why="least criterion: 800 below the piecewise linear one",
        excited=fits[-1].excited,
        understeer_gradient=fits[-1].understeer_gradient,
        characteristic_speed=fits[-1].characteristic_speed,
        nuisance=[
            bias,
            EffectEstimate("steering_offset", "G", offset, None, RUNS[1], 0.17, needed=False),
        ],
        fixed={
            "mass": FixedValue(MASS, 300.0, "kg", "vehicle.yaml"),
            "cg_to_front_axle": FixedValue(FRONT, None, "m", "vehicle.yaml"),
            "cg_to_rear_axle": FixedValue(REAR, None, "m", "vehicle.yaml"),
        },
        noise={
            name: ResidualNoise("rad/s", std, 1.1 * std, [0.4], STEP * every, coloured_beyond=False)
            for name, (std, every) in SENSORS.items()
        },
        by_run=by_run(tables),
        agreement_p=0.42,
        speed=[6.0, 15.0],
        lateral_acceleration=[-4.2, 4.3],
        samples=int(tables["tyres"][list(SENSORS)].notna().to_numpy().sum()),
        runs=health,
        refused=[Refusal("front.curvature", NO_PEAK)],
        warnings=["topic <b>%{y}</b>: 3 headings jumped by more than 10° and were left out"],
        measured_forces=[],
    )


def wheel_forces():
    return ForceComparison(
        "front",
        known(290e3, 0.004, "N/rad"),
        known(334e3, 0.01, "N/rad"),
        known(0.87, 0.003, "1"),
        0.994,
        "the measured force is 13 % below what the motion needs, at all slips alike: a scale error",
    )
