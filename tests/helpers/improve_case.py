"""Improvements and their tables as the stage gives them, from a simulation that shares nothing with ident.

The truth is a linear bicycle whose axle forces lag behind the slip (relaxation); "before" has none, "after"
has one of a slightly wrong length. Errors, gains and means are those of the simulated signals; p-values,
candidates and detectable sizes are made up, of a believable size. Names are hostile on purpose.
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from ident.results import (
    Candidate,
    Confirmation,
    DetectableSize,
    Discovered,
    ErrorComparison,
    ErrorRange,
    Estimate,
    FoundEffect,
    ImproveGate,
    ImproveResult,
    ImproveStep,
    Localisation,
    NextExperiment,
    Refusal,
    Regressor,
    SensorCheck,
)

STEP = 0.01
HOSTILE = 'sweep_b <img src=x onerror="window.injected=1"></script>' + "x" * 90
RUNS = ["day 1/sweep_a", HOSTILE, "lane_change_c"]
DRIVES = [
    (RUNS[0], 1, 24.0, 5.0, 0.10, 0.5),
    (RUNS[1], 2, 18.0, 9.0, 0.06, 0.5),
    (RUNS[2], 3, 16.0, 15.0, 0.03, 0.2),
]
MASS, INERTIA, FRONT, REAR, STIFFNESS = 12_000.0, 60_000.0, 2.4, 2.1, (3.2e5, 4.4e5)
LENGTHS = {"measured": 0.6, "before": 0.0, "after": 0.56}
NOISE = {
    "yaw_rate": (0.0015, "rad/s"),
    "lateral_acceleration": (0.03, "m/s^2"),
    "lateral_velocity": (0.01, "m/s"),
}


def known(value, std, unit):
    return Estimate(value, std, value - 1.96 * std, value + 1.96 * std, unit)


def drive(length, steering, speed):
    """Give the signals of a bicycle whose forces lag behind the slip by ``length`` [m]."""
    velocity = rate = front = rear = 0.0
    rows = np.empty((steering.size, 3))
    for index, angle in enumerate(steering):
        wanted = (
            STIFFNESS[0] * (angle - (velocity + FRONT * rate) / speed),
            -STIFFNESS[1] * (velocity - REAR * rate) / speed,
        )
        pace = min(1.0, STEP * speed / length) if length else 1.0
        front, rear = front + pace * (wanted[0] - front), rear + pace * (wanted[1] - rear)
        acceleration = (front + rear) / MASS
        rows[index] = rate, acceleration, velocity
        velocity += STEP * (acceleration - speed * rate)
        rate += STEP * (FRONT * front - REAR * rear) / INERTIA
    return dict(zip(NOISE, rows.T, strict=True))


def run_table(run, seed, seconds, speed, angle, frequency):
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, STEP)
    steering = (
        angle * np.sin(2 * np.pi * (0.1 * time + frequency / seconds * time**2)) * np.clip(time, 0.0, 1.0)
    )
    table = {"run": run, "time": time, "layer": "motion"}
    found = {way: drive(length, steering, speed) for way, length in LENGTHS.items()}
    for signal, (std, _) in NOISE.items():
        seen = found["measured"][signal] + rng.normal(0.0, std, time.size)
        table |= {f"{signal}_measured": seen} | {
            f"{signal}_{way}": found[way][signal] for way in ("before", "after")
        }
    table["lateral_velocity_measured"][1::2] = np.nan
    table["regressor"] = np.gradient(found["before"]["lateral_acceleration"], STEP)
    table["activity"] = np.clip(np.abs(table["regressor"]) / 6.0, 0.0, 1.0)
    return pd.DataFrame(table)


def build_tables():
    table = pd.concat([run_table(*each) for each in DRIVES], ignore_index=True)
    held_out = [
        pd.DataFrame(
            {
                "run": table["run"],
                "time": table["time"],
                "signal": signal,
                **{way: table[f"{signal}_{way}"] for way in LENGTHS},
            }
        )
        for signal in NOISE
    ]
    return {"improve": table, "improve_held_out": pd.concat(held_out, ignore_index=True)}


def errors(tables, way):
    found = {}
    for signal, (_, unit) in NOISE.items():
        left = tables["improve"][f"{signal}_measured"] - tables["improve"][f"{signal}_{way}"]
        rms = float(np.sqrt(np.nanmean(left**2)))
        found[signal] = ErrorRange(rms, 0.93 * rms, 1.08 * rms, unit)
    return found


RELAXATION = (
    '<math display="block"><mfrac><mi>σ</mi><mi>v</mi></mfrac><mover><mi>F</mi><mo>˙</mo></mover>'
    "<mo>+</mo><mi>F</mi><mo>=</mo><msub><mi>F</mi><mi>static</mi></msub><mfenced><mi>α</mi></mfenced></math>"
)
EFFECT = FoundEffect(
    key="tyre_relaxation",
    name="tyre_relaxation",
    enters="T",
    members=["tyre_relaxation"],
    parameters={"length": known(0.56, 0.03, "m")},
    p_value=0.0005,
    equation=RELAXATION,
    meaning="the axle's force follows its slip angle only after the tyre has rolled about this far",
    same_in_runs_p=0.34,
    share={"yaw_rate": 0.9, "lateral_acceleration": 0.93},
    meanings={"length": "distance rolled until 63 % of a new force is there"},
)
CANDIDATES = [
    Candidate(
        "tyre_relaxation", "tyre_relaxation", "T", 1480.0, 1, 0.0005, 1702.0, 0.31, True, EFFECT.parameters
    ),
    Candidate(
        "sensor_latency yaw_rate",
        "sensor_latency",
        "M",
        1210.0,
        1,
        0.0005,
        1266.0,
        0.22,
        False,
        {"delay": known(0.04, 0.001, "s")},
        "fits worse by 436, and its delay falls with speed: 67 ms at 5 m/s, 23 ms at 15 m/s",
    ),
    Candidate("body_roll", "body_roll", "Y", 402.0, 3, 0.0005, 455.0, 0.05, False, {}, "fits worse by 1247"),
    Candidate(
        "steering_linkage_play",
        "steering_linkage_play",
        "G",
        14.0,
        1,
        0.04,
        None,
        None,
        False,
        {},
        "not fitted: 5 better",
    ),
    Candidate(
        "load_transfer", "load_transfer", "T", 2.1, 2, 0.97, None, None, False, {}, "score within noise"
    ),
]
STEPS = [
    ImproveStep(
        ImproveGate(0.0005, True, 0.05, "yaw moment: rate of the lateral force", "motion", 214, 2.0, 1999),
        [
            Localisation("front_tyre", 0.88),
            Localisation("rear_tyre", 0.74),
            Localisation("yaw_moment", 0.6),
            Localisation("linkage", 0.55),
            Localisation("lateral_force", 0.21),
            Localisation("lateral_acceleration", 0.04),
        ],
        CANDIDATES,
        "tyre_relaxation",
        "tyre relaxation gains most, in the fit and held out; no other is within the class",
    ),
    ImproveStep(
        ImproveGate(0.41, False, 0.05, "lateral acceleration: |u|", "motion", 198, 2.0, 1999),
        [],
        [],
        None,
        "the gate does not reject: nothing is left that these data tell",
    ),
]
SENSORS = [
    SensorCheck(
        "gyro against heading: scale",
        ["yaw_rate", "heading"],
        known(1.001, 0.002, "1"),
        1.0,
        0.6,
        "agrees",
        None,
        "the gyro reads what the heading turns",
    ),
    SensorCheck(
        "position speed against wheel speed: scale",
        ["speed", "position_x"],
        known(0.978, 0.001, "1"),
        1.0,
        1e-6,
        "differs",
        "wheel_speed_scale",
        "the wheels read 2.2 % too little: measure their radius",
    ),
    SensorCheck(
        "gyro at rest",
        ["yaw_rate"],
        Estimate(None, None, None, None, "rad/s", "not_identifiable", "never stood"),
        0.0,
        None,
        "not_testable",
        "sensor_bias",
        "stand 60 s before driving off",
    ),
]
DETECTABLE = {
    "sensor_latency yaw_rate": DetectableSize(0.006, "s", 0.04),
    "steering_linkage_play": DetectableSize(0.0011, "rad", 0.004),
    "load_transfer": DetectableSize(0.11, "1", 0.05),
    "sensor_bias yaw_rate": DetectableSize(0.0004, "rad/s", 0.004),
}
NOT_TESTABLE = [
    Refusal("grade", "no drive or brake signal in the logs"),
    Refusal("trailer", "not built yet"),
]


def named(tables, provenance, health):
    before, after = errors(tables, "before"), errors(tables, "after")
    return ImproveResult(
        schema_version="1",
        provenance=provenance,
        verdict="named",
        told="Named: tyre relaxation, 0.56 m (0.50 … 0.62 m); 90 % of the error above the noise is gone.",
        base="linear tyres",
        layers=["motion"],
        sensors=SENSORS,
        effects=[EFFECT],
        discovered=None,
        candidates=CANDIDATES,
        steps=STEPS,
        minimum_detectable=DETECTABLE,
        next_experiment=NextExperiment(
            "a sine sweep to 2 Hz at 4 m/s",
            ["sensor_latency lateral_acceleration"],
            "the lags part at low speed",
        ),
        error=ErrorComparison(before, after, {name: std for name, (std, _) in NOISE.items()}, "run"),
        confirmation=Confirmation(
            known(0.31, 0.04, "1"),
            dict(zip(RUNS, (0.4, 0.35, -0.02), strict=True)),
            True,
            "leave one run out",
        ),
        not_testable=NOT_TESTABLE,
        runs=health,
        refused=[Refusal("actuator", "no steering request in the logs: record it")],
        warnings=["topic <b>%{y}</b>: 3 headings jumped by more than 10° and were left out"],
        regressor=Regressor("rate of the lateral acceleration", "m/s^3", "yaw_rate"),
    )


def equivalent(result):
    members = ["tyre_relaxation", "sensor_latency yaw_rate"]
    effect = replace(EFFECT, members=members, same_in_runs_p=None)
    alike = replace(CANDIDATES[1], in_class=True, why_not="fits worse by 0.6 alone: within the class")
    found = [CANDIDATES[0], alike, *CANDIDATES[2:]]
    return replace(
        result,
        verdict="equivalent",
        told="One of two: tyre relaxation or sensor latency of the yaw rate; runs at one speed cannot tell.",
        effects=[effect],
        candidates=found,
        steps=[replace(STEPS[0], candidates=found), STEPS[1]],
    )


def unexplained(result):
    term = Discovered(
        "yaw_moment",
        "r|r|",
        "<math><mrow><msub><mi>I</mi><mi>z</mi></msub><mover><mi>r</mi><mo>˙</mo></mover><mo>=</mo><mo>⋯</mo>"
        "<mo>+</mo><mi>c</mi><mi>r</mi><mo>|</mo><mi>r</mi><mo>|</mo></mrow></math>",
        known(-91_000.0, 4_000.0, "N m s^2/rad^2"),
        0.0005,
        0.96,
        {"yaw_rate": 0.7},
    )
    return replace(
        result,
        verdict="unexplained",
        told="Unexplained: r|r| in the yaw moment takes 70 % of what is above the noise; it has no name.",
        effects=[],
        discovered=term,
        steps=[
            replace(
                STEPS[0], added=None, why="the best candidate leaves a term that is worth more than itself"
            )
        ],
        regressor=Regressor("yaw rate times its size", "rad^2/s^2", "yaw_rate"),
    )


def adequate(result):
    small = {
        name: ErrorRange(1.02 * std, 0.97 * std, 1.08 * std, unit) for name, (std, unit) in NOISE.items()
    }
    return replace(
        result,
        verdict="adequate",
        told="Adequate: nothing is left that these data tell (p = 0.41).",
        effects=[],
        candidates=[],
        steps=[STEPS[1]],
        next_experiment=None,
        confirmation=None,
        error=replace(result.error, before=small, after=small),
        regressor=None,
        refused=[],
        warnings=[],
    )


def bare_table(table):
    """Give the table of a result to which nothing was added."""
    kept = table.drop(columns=["regressor", "activity"])
    return kept.assign(**{f"{signal}_before": kept[f"{signal}_after"] for signal in NOISE})


def actuator_only(result):
    """Give a result and its tables of logs with nothing but the steering."""
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 20.0, STEP)
    wanted = 0.4 * np.sin(0.9 * time)
    after = np.clip(wanted, -0.35, 0.35)
    measured = after + rng.normal(0.0, 0.002, time.size)
    table = pd.DataFrame(
        {
            "run": RUNS[1],
            "time": time,
            "layer": "actuator",
            "steering_wheel_angle_measured": measured,
            "steering_wheel_angle_before": wanted,
            "steering_wheel_angle_after": after,
            "regressor": wanted,
            "activity": (np.abs(wanted) > 0.35) * 1.0,
        }
    )
    size = ErrorRange(0.0021, 0.002, 0.0022, "rad")
    effect = replace(
        EFFECT,
        key="steering_dead_zone",
        name="steering_dead_zone",
        enters="A",
        members=["steering_dead_zone"],
        parameters={"width": known(0.004, 0.0002, "rad")},
        meanings={},
        share={},
    )
    made = replace(
        result,
        told="Named: steering dead zone, 4 mrad.",
        layers=["actuator"],
        sensors=[],
        effects=[effect],
        error=ErrorComparison(
            {"steering_wheel_angle": ErrorRange(0.02, None, None, "rad")},
            {"steering_wheel_angle": size},
            {"steering_wheel_angle": 0.002},
            "block",
        ),
        regressor=Regressor("request", "rad", "steering_wheel_angle"),
        confirmation=Confirmation(known(0.2, 0.3, "1"), {RUNS[1]: 0.2}, False, "blocks within one run"),
    )
    return made, {"improve": table}


def sensors_only(result):
    return replace(
        adequate(result),
        told="Only the sensors could be tested: one of them is off.",
        base="no model",
        layers=[],
        error=ErrorComparison({}, {}, {}, "none"),
        steps=[],
        minimum_detectable={},
    )
