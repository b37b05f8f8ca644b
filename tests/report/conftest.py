"""A steering result as a stage would give it, from a small simulation that shares nothing with ident.

The actuator is stepped on a grid of one millisecond; run names, topics and reasons are hostile on
purpose: they come from a log, and a log is not to be trusted.
"""

from dataclasses import replace

import evaluate_case as evaluation
import improve_case as improvement
import numpy as np
import pandas as pd
import pytest
import tyre_case

from ident.results import (
    Damage,
    Estimate,
    Experiment,
    Gap,
    InfoResult,
    Latency,
    LogFile,
    Noise,
    Provenance,
    Refusal,
    RunFit,
    RunHealth,
    SignalHealth,
    SteeringModel,
    SteeringResult,
    StepFit,
    TopicHealth,
)

HOSTILE_IMG = '<img src=x onerror="window.injected=1">'
HOSTILE_SCRIPT = "</script><script>window.injected=2</script>"
HOSTILE_LINK = '<a href="javascript:window.injected=3">here</a> %{y} {{ 7 * 7 }}'
TRUTH = {"gain": 0.985, "dead_time": 0.123, "time_constant_1": 0.25, "time_constant_2": 0.08}
ESTIMATE = {"gain": 0.9853, "dead_time": 0.1222, "time_constant_1": 0.2507, "time_constant_2": 0.0803}
STANDARD_ERROR = {"gain": 0.0004, "dead_time": 0.0011, "time_constant_1": 0.0013, "time_constant_2": 0.0019}
UNITS = {"gain": "1", "dead_time": "s", "time_constant_1": "s", "time_constant_2": "s"}
STEP = 0.001
QUANTUM = np.deg2rad(0.1)


def respond(grid, request, parameters):
    """Step two first-order lags behind a dead time on a 1 ms grid: exact for a held input."""
    delay = round(parameters["dead_time"] / STEP)
    held = np.concatenate([np.zeros(delay), request[: grid.size - delay]]) * parameters["gain"]
    for name in ("time_constant_1", "time_constant_2"):
        decay = np.exp(-STEP / parameters[name])
        output = np.empty_like(held)
        state = 0.0
        for index, value in enumerate(held):
            output[index] = state
            state = decay * state + (1 - decay) * value
        held = output
    return held


def pulse_request(grid, amplitudes):
    """Rectangular pulses, 5 s on and 2 s off, after 2 s of rest."""
    request = np.zeros_like(grid)
    for index, amplitude in enumerate(amplitudes):
        start = 2.0 + 7.0 * index
        request[(grid >= start) & (grid < start + 5.0)] = amplitude
    return request


def sine_request(grid, frequencies, amplitude):
    """Sines one after the other, each at least 12 s and two periods long, 1 s of rest between."""
    request = np.zeros_like(grid)
    bounds = []
    start = 2.0
    for frequency in frequencies:
        length = max(2, np.ceil(12.0 * frequency / (2 * np.pi))) * 2 * np.pi / frequency
        inside = (grid >= start) & (grid < start + length)
        request[inside] = amplitude * np.sin(frequency * (grid[inside] - start))
        bounds.append((frequency, start, start + length))
        start += length + 1.0
    return request, bounds


def sample_run(name, grid, request, seed, gap=None):
    """Sample the simulated actuator: 50 Hz request, 100 Hz measured with AR(1) noise, 0.1 deg steps."""
    rng = np.random.default_rng(seed)
    sent = np.arange(0.004, grid[-1] - 0.01, 0.02)
    sent_values = request[np.round(sent / STEP).astype(int)]
    held = sent_values[np.clip(np.searchsorted(sent, grid, side="right") - 1, 0, None)]
    truth = respond(grid, held, TRUTH)
    model = respond(grid, held, ESTIMATE)
    time = np.arange(0.007, grid[-1] - 0.01, 0.01) + rng.normal(
        0, 0.0004, np.arange(0.007, grid[-1] - 0.01, 0.01).size
    )
    noise = np.zeros(time.size)
    for index, shock in enumerate(rng.normal(0, 0.0012, time.size)):
        noise[index] = 0.6 * noise[index - 1] + shock if index else shock
    measured = np.round((np.interp(time, grid, truth) + 0.002 + noise) / QUANTUM) * QUANTUM
    modelled = np.interp(time, grid, model) + 0.002
    part = np.zeros(time.size, dtype=int)
    keep = np.ones(time.size, dtype=bool)
    request_part = np.zeros(sent.size, dtype=int)
    if gap:
        part[time > gap[0]] = 1
        request_part[sent > gap[0]] = 1
        keep = (time < gap[0]) | (time > gap[1])
    measured_table = pd.DataFrame(
        {
            "run": name,
            "part": part,
            "time": time,
            "measured": measured,
            "modelled": modelled,
            "residual": measured - modelled,
            "experiment": -1,
            "used": False,
        }
    )[keep]
    request_table = pd.DataFrame({"run": name, "part": request_part, "time": sent, "request": sent_values})
    return measured_table, request_table


def pulse_experiments(name, amplitudes):
    used = ["first_order_63", "modified_harriott", "likelihood"]
    found = [
        Experiment(
            run=name,
            kind="pulse",
            start=2.0 + 7.0 * index,
            end=8.98 + 7.0 * index,
            start_uncertainty=0.02,
            level_before=0.0,
            level_after=0.0,
            amplitude=float(amplitude),
            used_by=used,
        )
        for index, amplitude in enumerate(amplitudes)
    ]
    found[-1] = replace(
        found[-1],
        used_by=["likelihood"],
        rejected={
            "modified_harriott": f"response not settled {HOSTILE_LINK}",
            "first_order_63": "not settled",
        },
    )
    return found


def sine_experiments(name, bounds, amplitude):
    return [
        Experiment(
            run=name,
            kind="sine",
            start=start,
            end=end,
            amplitude=amplitude,
            frequency=frequency,
            used_by=["likelihood"],
            rejected={"first_order_63": "not a step", "modified_harriott": "not a step"},
        )
        for frequency, start, end in bounds
    ]


def mark(table, experiments, offset):
    """Write into the table which samples belong to which experiment; outside, nothing is modelled."""
    table = table.copy()
    for index, experiment in enumerate(experiments):
        inside = table["time"].between(experiment.start, experiment.end)
        table.loc[inside, "experiment"] = offset + index
        table.loc[inside, "used"] = bool(experiment.used_by)
    outside = table["experiment"] < 0
    table.loc[outside, ["modelled", "residual"]] = np.nan
    return table


def estimate(name, scale=1.0, shift=0.0, status="identified", reason=None):
    std = STANDARD_ERROR[name] * scale
    value = ESTIMATE[name] + shift * std
    return Estimate(value, std, value - 1.96 * std, value + 1.96 * std, UNITS[name], status, reason)


def steering_model(scale=1.0, seed=None):
    shifts = np.zeros(4) if seed is None else np.random.default_rng(seed).normal(size=4)
    parts = {name: estimate(name, scale, shift) for name, shift in zip(ESTIMATE, shifts, strict=True)}
    if scale > 3:
        parts["time_constant_2"] = replace(
            parts["time_constant_2"], status="weak", reason="only known to 14 %: add steps or faster sines"
        )
    t1, t2 = parts["time_constant_1"].value, parts["time_constant_2"].value
    lag = parts["dead_time"].value + t1 + t2
    frequency, damping = (t1 * t2) ** -0.5, (t1 + t2) / (2 * (t1 * t2) ** 0.5)
    return SteeringModel(
        **parts,
        total_lag=Estimate(lag, 0.0003 * scale, lag - 0.0006 * scale, lag + 0.0006 * scale, "s"),
        natural_frequency=Estimate(frequency, 0.06, frequency - 0.12, frequency + 0.12, "rad/s"),
        damping_ratio=Estimate(damping, 0.012, damping - 0.024, damping + 0.024, "1"),
    )


def topics_health(gaps):
    wheel = "/vehicle/steering_wheel", "truck_msgs/msg/SteeringWheelAngle"
    lost = 50 if gaps else 0
    topic = TopicHealth(*wheel, 9000, 100.0, 0.04, list(gaps), lost, "header", 0, 1, 0.0041, 0.0093)
    odd = TopicHealth(f"/odd/{HOSTILE_IMG}", "std_msgs/msg/Float64", 2, None, None, [], None, "log")
    sent = "/control/steering_wheel_request", "truck_msgs/msg/SteeringWheelRequest"
    return [TopicHealth(*sent, 4500, 50.0, 0.02, [], 0, "header"), topic, odd]


def run_health(name, duration, *, gaps=(), damage=()):
    return RunHealth(
        name=name,
        format="rosbag2 mcap",
        start="2025-10-09T08:53:20Z",
        duration=duration,
        channels="channels.yaml",
        vehicle="vehicle.yaml",
        topics=topics_health(gaps),
        signals={
            "steering_wheel_request": SignalHealth(
                "steering_wheel_request",
                "rad",
                "/control/steering_wheel_request.angle",
                4500,
                -1.571,
                1.571,
                None,
                0.98,
                0,
            ),
            "steering_wheel_angle": SignalHealth(
                "steering_wheel_angle",
                "rad",
                "/vehicle/steering_wheel.angle",
                9000,
                -1.55,
                1.55,
                float(QUANTUM),
                0.71,
                3,
            ),
        },
        missing=["yaw_rate", "speed"],
        latencies=[Latency("yaw_rate", "heading", Estimate(0.034, 0.004, 0.026, 0.042, "s"))],
        clocks=["header stamps are 4.1 ms before arrival (median)"],
        damage=list(damage),
    )


def build_tables():
    left = "day 1/steering_pulses_a"
    right = f"day 1/{HOSTILE_IMG}{HOSTILE_SCRIPT}"
    sines = "steering_sines_a"
    amplitudes = {
        left: np.pi * np.array([1 / 4, -1 / 4, 1 / 3, -1 / 3, 1 / 2]),
        right: np.pi * np.array([1 / 2, 1 / 3, 1 / 4]),
    }
    pieces, requests, experiments = [], [], []
    for seed, (name, steps) in enumerate(amplitudes.items()):
        grid = np.arange(0, 2.0 + 7.0 * len(steps), STEP)
        table, request = sample_run(
            name, grid, pulse_request(grid, steps), seed, gap=(14.2, 14.72) if name == left else None
        )
        found = pulse_experiments(name, steps)
        pieces.append(mark(table, found, len(experiments)))
        requests.append(request)
        experiments += found
    bounds = sine_request(np.zeros(1), [0.5, 1.0, 3.0, 10.0], 0.4)[1]
    grid = np.arange(0, bounds[-1][2] + 1.0, STEP)
    table, request = sample_run(sines, grid, sine_request(grid, [0.5, 1.0, 3.0, 10.0], 0.4)[0], 9)
    found = sine_experiments(sines, bounds, 0.4)
    pieces.append(mark(table, found, len(experiments)))
    requests.append(request)
    experiments += found
    tables = {
        "steering": pd.concat(pieces, ignore_index=True),
        "steering_request": pd.concat(requests, ignore_index=True),
    }
    return tables, experiments


def run_fits(steering):
    fits = []
    for seed, (name, rows) in enumerate(steering.groupby("run", sort=False)):
        used = rows[rows["used"]]
        vaf = 1 - used["residual"].var() / used["measured"].var()
        rms = float(np.sqrt((used["residual"] ** 2).mean()))
        excitation = ["sine"] if "sine" in name else ["pulse"]
        fits.append(
            RunFit(name, excitation, len(used), steering_model(2.0 + 2 * seed, seed), rms, vaf, vaf + 1e-7)
        )
    return fits


def step_fits():
    return [
        StepFit(
            "first_order_63",
            0.9849,
            0.168,
            0.287,
            None,
            0.0171,
            7,
            {"gain": 0.0011, "dead_time": 0.006, "time_constant_1": 0.009},
        ),
        StepFit(
            "modified_harriott",
            0.9849,
            0.131,
            0.247,
            0.071,
            0.0042,
            6,
            {"gain": 0.0011, "dead_time": 0.009, "time_constant_1": 0.006, "time_constant_2": 0.011},
        ),
    ]


def build_result(tables, experiments):
    used = tables["steering"][tables["steering"]["used"]]
    runs = list(dict.fromkeys(tables["steering"]["run"]))
    length = tables["steering"].groupby("run")["time"].max()
    gap = Gap(14.2, 0.52)
    health = [
        run_health(runs[0], float(length[runs[0]]), gaps=[gap]),
        run_health(
            runs[1], float(length[runs[1]]), damage=[Damage("file ends inside a chunk", None, 1.2, 40960)]
        ),
        run_health(runs[2], float(length[runs[2]])),
    ]
    return SteeringResult(
        schema_version="1",
        provenance=provenance(runs),
        verdict="Adequate: one overdamped second-order model explains all 3 runs to the noise (VAF 99.99 %).",
        next_step="identify the tyres: ident tyres sample_logs/",
        pair="steering_wheel",
        model=steering_model(),
        classification="overdamped",
        classification_reason="both time constants are real and different (ζ = 1.17, 95 % above 1.14)",
        adequate=True,
        agreement_p=0.41,
        rms_error=float(np.sqrt((used["residual"] ** 2).mean())),
        vaf=float(1 - used["residual"].var() / used["measured"].var()),
        samples=len(used),
        noise=Noise("ar", 0.0013, float(used["residual"].std()), [0.52, 0.06], None, float(QUANTUM)),
        step_methods=step_fits(),
        by_run=run_fits(tables["steering"]),
        experiments=experiments,
        runs=health,
        refused=[Refusal("bandwidth", f"no chirp in the logs {HOSTILE_SCRIPT}: drive sines up to 10 rad/s")],
        warnings=[f"{HOSTILE_IMG}: 3 samples are not finite and were left out"],
    )


def provenance(runs):
    return Provenance(
        version="0.1.0",
        command="ident steering sample_logs/ --seed 1",
        seed=1,
        date="2025-10-09T12:00:00+00:00",
        files=[
            LogFile(f"{name}/0.mcap", f"{index:064x}", 123456 * (index + 1))
            for index, name in enumerate(runs)
        ],
        applied=dict.fromkeys(runs, "channels.yaml, vehicle.yaml"),
    )


@pytest.fixture(scope="session")
def steering_case():
    """The result and its tables; tests must not change them."""
    tables, experiments = build_tables()
    return build_result(tables, experiments), tables


@pytest.fixture(scope="session")
def info_result(steering_case):
    result = steering_case[0]
    return InfoResult(
        "1",
        result.provenance,
        result.runs,
        [Refusal(f"broken/{HOSTILE_IMG}.mcap", "0 bytes: nothing to read")],
        [f"mapped topic {HOSTILE_LINK} is in no log"],
    )


@pytest.fixture(scope="session")
def tyres_case(steering_case):
    """The tyre result and its tables; tests must not change them."""
    tables = tyre_case.build_tables()
    made = replace(provenance(tyre_case.RUNS), command="ident tyres sample_logs/")
    health = [run_health(name, 40.0) for name in tyre_case.RUNS]
    return tyre_case.build_result(tables, made, health), tables


@pytest.fixture(scope="session")
def evaluate_case(steering_case):
    """The evaluation and its table; tests must not change them."""
    table = evaluation.build_table()
    made = replace(provenance(evaluation.RUNS), command="ident evaluate sample_logs/")
    health = [run_health(name, 26.0) for name in evaluation.RUNS]
    return evaluation.build_result(table, made, health), {"evaluate": table}


@pytest.fixture(scope="session")
def improve_cases(steering_case):
    """Name of a verdict -> the improvement and its tables; tests must not change them."""
    tables = improvement.build_tables()
    made = replace(provenance(improvement.RUNS), command="ident improve sample_logs/")
    result = improvement.named(tables, made, [run_health(name, 24.0) for name in improvement.RUNS])
    bare = {"improve": improvement.bare_table(tables["improve"])}
    return {
        "named": (result, tables),
        "equivalent": (improvement.equivalent(result), tables),
        "unexplained": (improvement.unexplained(result), tables),
        "adequate": (improvement.adequate(result), bare),
        "actuator": improvement.actuator_only(result),
        "sensors": (improvement.sensors_only(result), {}),
    }
