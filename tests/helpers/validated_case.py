"""A validation and its tables as the stage gives them, from a simulation that shares nothing with ident.

Errors, rates and speeds of the opened runs are those of that simulation; the scores of the others are drawn
about them. Names are hostile on purpose.
"""

import functools
from dataclasses import replace

import numpy as np
import pandas as pd
from validated_drive import LANE, LAWS, PERIOD, SCENARIOS, STARTS, WHEELBASE, drive, path_of, run_of

from ident.results import Estimate, Provenance, Refusal, RunHealth
from ident.results.validate import (
    Cell,
    Claim,
    LoggedLevel,
    MarginLoss,
    MismatchCurve,
    ModelPair,
    Score,
    ValidateResult,
)

HOSTILE = 'path_b <img src=x onerror="window.injected=1"></script>' + "y" * 90
LOGGED_RUNS = ["day 1/path_a", HOSTILE]
EFFECTS = ["tyre_relaxation", "actuator_rate_limit"]
RANKING = [
    "lqr",
    "mpc_spatial",
    "mpc_spatial_rate",
    "mpc_time",
    "mpc_robust",
    "mpc_time_kinematic",
    "stanley",
    "pure_pursuit",
    "pid",
]
WEIGHTS = {
    "lqr": {"lateral_error": 1.0, "steering_rate": 0.02},
    "mpc_spatial": {"lateral_error": 1.0, "jerk": 0.1},
}
SCORED = {
    "lateral_error_rms": "m",
    "lateral_error_max": "m",
    "lateral_error_settled": "m",
    "arrival_time_error": "s",
    "braking_work": "J/kg",
    "steering_rate_rms": "rad/s",
    "solve_time_p99": "s",
}


def score(measure, runs):
    """Median of the runs that were completed, with an interval from their spread."""
    sizes = [getattr(run, measure) for run in runs if run.completed]
    if not sizes:
        return None
    value, spread = float(np.median(np.abs(sizes))), float(np.ptp(sizes)) / 4
    return Score(measure, value, max(value - spread, 0.0), value + spread, SCORED[measure])


def cell(controller, scenario, runs):
    scores = [found for measure in SCORED if (found := score(measure, runs)) is not None]
    best = {
        "mpc_spatial": ["lateral_error_max", "lateral_error_rms"],
        "lqr": ["steering_rate_rms", "lateral_error_max"],
        "pid": ["solve_time_p99"],
    }
    return Cell(
        controller, scenario, len(runs), sum(run.completed for run in runs), scores, best.get(controller, [])
    )


def build_runs():
    """Give every run with its rows and horizons, in the order of ``ValidateResult.runs``."""
    return [
        (scenario, controller, offset, *drive(scenario, controller, offset))
        for scenario in SCENARIOS
        for controller in LAWS
        for offset in STARTS
    ]


def build_tables(driven, worst):
    """The tables of ident.stages.validate_tables: one start of the first two scenarios is opened."""
    frames = []
    for index, (scenario, controller, offset, rows, _) in enumerate(driven):
        if offset == driven[worst][2] and scenario in list(SCENARIOS)[:2]:
            frames.append(rows.assign(run=index, controller=controller, scenario=scenario))
    opened = pd.concat(frames, ignore_index=True).astype({"controller": "category", "scenario": "category"})
    horizon = pd.concat(
        [
            pd.DataFrame(
                {"run": worst, "time": cycle * PERIOD, "step": range(len(at)), "x": at[:, 0], "y": at[:, 1]}
            )
            for cycle, at in enumerate(driven[worst][4])
        ],
        ignore_index=True,
    )
    return {
        "validate": opened,
        "validate_reference": pd.concat([reference(name) for name in SCENARIOS], ignore_index=True),
        "validate_horizon": horizon,
        "validate_logged": pd.concat(
            [logged(run, seed) for seed, run in enumerate(LOGGED_RUNS)], ignore_index=True
        ),
    }


def reference(scenario):
    speed = SCENARIOS[scenario][0]
    s, x, y, heading, curvature = path_of(scenario)
    return pd.DataFrame(
        {
            "scenario": scenario,
            "set_speed": speed,
            "run": "",
            "arc_length": s,
            "x": x,
            "y": y,
            "heading": heading,
            "curvature": curvature,
            "speed": speed,
            "time": s / speed,
            "road_wheel_angle": WHEELBASE * curvature,
        }
    )


def logged(run, seed):
    """Two engaged stretches of a logged run with four levels; the model is a little off."""
    rng = np.random.default_rng(seed)
    frames = []
    for part, begin in enumerate((0.0, 40.0)):
        time = begin + np.arange(0.0, 25.0, 0.04)
        wave = np.sin(0.5 * time)
        base = {"run": run, "part": part, "time": time, "arc_length": 15.0 * time}
        truth = {
            "lateral_error": 0.12 * wave,
            "heading_error": 0.01 * wave,
            "speed": 15.0 + 0.1 * wave,
            "steering_request": 0.4 * wave,
            "steering_angle": 0.38 * np.sin(0.5 * (time - 0.3)),
            "road_wheel_angle": 0.02 * wave,
            "yaw_rate": 0.06 * wave,
        }
        for level in range(4):
            sources = (
                {"log": 1.0, "model": 0.95} if level < 2 else {"log": 1.0, "lqr": 0.9, "mpc_spatial": 1.02}
            )
            for source, scale in sources.items():
                noise = 0.02 if source == "log" else 0.0
                signals = {
                    name: values
                    + (scale - 1) * wave * np.ptp(values)
                    + noise * np.ptp(values) * rng.normal(size=time.size)
                    for name, values in truth.items()
                }
                frames.append(pd.DataFrame({**base, "level": level, "source": source, **signals}))
    return pd.concat(frames, ignore_index=True).astype({"source": "category", "run": "category"})


def known(value, std, unit):
    return Estimate(value, std, value - 1.96 * std, value + 1.96 * std, unit)


def mismatch_curves():
    sizes = {
        ("mass", "1"): [-0.4, -0.2, 0.0, 0.15, 0.3],
        ("stiffness", "1"): [-0.3, 0.0, 0.3],
        ("friction", "1"): [0.3, 0.5, 0.7, 1.0],
        ("dead_time", "s"): [-0.1, 0.0, 0.1, 0.2],
        ("time_constant", "1"): [-0.5, 0.0, 0.5],
    }
    curves = []
    for place, controller in enumerate(LAWS):
        for (what, unit), steps in sizes.items():
            home = 1.0 if what == "friction" else 0.0
            found = [
                0.12
                + 0.02 * place
                + abs(step - home) * (2.0 if unit == "s" else 0.4) * (1.3 if place < 3 else 0.6)
                for step in steps
            ]
            errors = [None if error > 0.52 and controller == "pid" else error for error in found]
            curves.append(MismatchCurve(controller, "single_lane_change", what, unit, steps, errors))
    return curves


def model_pairs():
    models = ["kinematic", "linear", "magic_formula"]
    trucks = [*models[1:], "magic_formula+tyre_relaxation+actuator_rate_limit"]
    return [
        ModelPair(controller, own, truck, *completed(own, truck), 0.08 + 0.05 * (own != truck), size, 310.0)
        for controller in ("lqr", "mpc_time", "mpc_spatial")
        for own in models
        for truck in trucks
        for size in [0.21 + 0.3 * (own == "kinematic") + 0.11 * ("+" in truck)]
    ]


def completed(own, truck):
    if own == "kinematic" and "+" in truck:
        return (0.0,)
    return (0.8,) if "+" in truck and own == "linear" else (1.0,)


def levels():
    allowed = {"yaw_rate": 0.006, "lateral_error": 0.1}
    return [
        LoggedLevel(LOGGED_RUNS[0], 0, True, {"yaw_rate": 0.004, "lateral_error": 0.05}, allowed),
        LoggedLevel(
            LOGGED_RUNS[0], 1, True, {"steering_angle": 0.012, "yaw_rate": 0.005}, {"steering_angle": 0.02}
        ),
        LoggedLevel(LOGGED_RUNS[0], 2, True, {"steering_request": 0.04}, {"steering_request": 0.06}, "lqr"),
        LoggedLevel(
            LOGGED_RUNS[0],
            2,
            False,
            {"steering_request": 0.4},
            {"steering_request": 0.06},
            "pid",
            "feeds back less",
        ),
        LoggedLevel(LOGGED_RUNS[0], 3, True, {"lateral_error": 0.03}, {"lateral_error": 0.05}, "lqr"),
        LoggedLevel(
            LOGGED_RUNS[1], 0, False, {"yaw_rate": 0.02}, allowed, None, "yaw rate differs by 0.02 rad/s <b>"
        ),
        LoggedLevel(LOGGED_RUNS[1], 1, None, {}, {}, None, "level 0 does not agree"),
    ]


def claims():
    return [
        Claim(
            "spatial-error MPC steers more smoothly than the others",
            "in part",
            "smoother than PID and Stanley in 4 of 4 scenarios; LQR with feed-forward is smoother still",
            [known(-0.0124, 0.002, "rad/s"), known(0.0041, 0.0011, "rad/s")],
            ["steering_rate_rms"] * 2,
            ["pid", "lqr"],
        ),
        Claim(
            "it brakes and accelerates less",
            "undecided",
            "the intervals hold zero",
            [known(0.1, 0.4, "J/kg")],
        ),
        Claim("it leaves no offset", "yes", "settles at 2 mm (95 % below 4 mm)", [known(0.002, 0.001, "m")]),
        Claim("it arrives on time from disturbed starts", "no", "0.12 s late, as LQR <b>bold</b>"),
    ]


def build(provenance, health):
    """Give the result with everything in it, and its tables."""
    driven = build_runs()
    runs = [run_of(rows, scenario, name, offset) for scenario, name, offset, rows, _ in driven]
    worst = max(range(len(runs)), key=lambda index: runs[index].lateral_error_max)
    cells = [
        cell(name, scenario, [run for run in runs if (run.controller, run.scenario) == (name, scenario)])
        for scenario in SCENARIOS
        for name in LAWS
    ]
    margins = [
        MarginLoss(
            name, "single_lane_change", EFFECTS, 1.0, 0.6 if name == "pid" else 1.0, 0.2, 0.55, name == "pid"
        )
        for name in LAWS
    ]
    result = ValidateResult(
        schema_version="1",
        provenance=provenance,
        verdict="LQR with feed-forward holds the lane in all 4 scenarios from all starts at 50 to 80 km/h; "
        "its error stays below 0.4 m up to a dead time 0.1 s off.",
        next_step="give logs with a reference and a command: ident validate LOGS",
        model="magic_formula",
        period=PERIOD,
        lane_half_width=LANE,
        settings={"disturbances": "5 starts, e_y -0.5 to 0.5 m", "seed": "1"},
        runs=runs,
        cells=cells,
        ranking=RANKING,
        pairs=model_pairs(),
        mismatch=mismatch_curves(),
        margins=margins,
        claims=claims(),
        logged=levels(),
        reached=3,
        worst=worst,
        weights=WEIGHTS,
        health=health,
        refused=[Refusal("path_c", "no reference: record reference_x and reference_y <b>")],
        warnings=["mpc_robust took longer than its period in 1.2 % of the cycles"],
    )
    return result, build_tables(driven, worst)


@functools.cache
def case():
    """Give the result with everything in it and its tables; tests must not change them."""
    made = Provenance(
        "0.1.0", "ident validate sample_logs/ --model model.yaml", 1, "2025-10-09T12:00:00+00:00"
    )
    health = [
        RunHealth(
            name, "rosbag2 mcap", "2025-10-09T08:53:20Z", 65.0, "channels.yaml", "vehicle.yaml", [], {}, []
        )
        for name in LOGGED_RUNS
    ]
    return build(made, health)


def bare(result):
    """One controller, one scenario, without logs, pairs, mismatch or effects."""
    own = [one for one in result.cells if (one.controller, one.scenario) == ("lqr", "single_lane_change")]
    runs = [one for one in result.runs if (one.controller, one.scenario) == ("lqr", "single_lane_change")]
    return replace(
        result,
        runs=runs,
        cells=own,
        ranking=["lqr"],
        pairs=[],
        mismatch=[],
        margins=[],
        claims=[],
        logged=[],
        reached=None,
        worst=0,
        weights={},
        settings={},
        health=[],
        refused=[],
        warnings=[],
        next_step=None,
    )


def nothing(result):
    """All controllers were refused: nothing was driven."""
    return replace(
        bare(result), runs=[], cells=[], ranking=[], worst=None, verdict="No controller could be made."
    )
