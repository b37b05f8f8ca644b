"""What ``ident validate`` tells: controllers on the identified model, and against logged runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ident.results.common import Estimate, Provenance, Refusal
from ident.results.logs import RunHealth

ControllerName = Literal[
    "pid",
    "pure_pursuit",
    "stanley",
    "lqr",
    "mpc_time_kinematic",
    "mpc_time",
    "mpc_spatial",
    "mpc_spatial_rate",
    "mpc_robust",
]
ScenarioName = Literal[
    "single_lane_change", "double_lane_change", "double_lane_change_scaled", "truncated_slalom", "logged"
]


@dataclass(frozen=True)
class Measures:
    """The numbers of one closed loop.

    completed : whether the truck came to the end of the path
    lateral_error_rms, _p95, _max, _settled : of the tracked point [m]; settled: mean of the last stretch
    heading_error_rms : [rad]
    arrival_time_error : when it came to the end less the stipulated time [s]; None where it did not
    braking_work, acceleration_work : per mass [J/kg]
    drive_switches : changes between braking and accelerating
    lateral_acceleration_max : [m/s²]; lateral_jerk_rms : [m/s³]
    steering_rate_rms, steering_rate_max : of the road wheels [rad/s]; steering_reversals : [1/s]
    violations : cycles in which a limit was exceeded
    infeasible : cycles in which the optimisation failed and the fallback was used
    solve_time_p50, _p95, _p99 : [s]; deadline_misses : cycles that took longer than the period
    """

    completed: bool
    lateral_error_rms: float
    lateral_error_p95: float
    lateral_error_max: float
    lateral_error_settled: float
    heading_error_rms: float
    arrival_time_error: float | None
    braking_work: float
    acceleration_work: float
    drive_switches: int
    lateral_acceleration_max: float
    lateral_jerk_rms: float
    steering_rate_rms: float
    steering_rate_max: float
    steering_reversals: float
    violations: int
    infeasible: int
    solve_time_p50: float
    solve_time_p95: float
    solve_time_p99: float
    deadline_misses: int


@dataclass(frozen=True, kw_only=True)
class ClosedLoopRun(Measures):
    """One controller, one scenario, one disturbance, one truck, and its measures.

    speed : of the scenario [m/s]
    disturbance : what was disturbed, such as {"lateral_error": 0.5 [m], "heading_error": 0.05 [rad],
        "speed": 1.0 [m/s]} at the start, and mismatch of the simulated truck such as {"mass": 0.3} (relative)
        or {"dead_time": 0.1} (absolute, SI)
    prediction_model, simulation_model : kinematic or the kind of tyres, "+" and its effects
    scenario_run : the logged run whose path was followed, where the scenario is ``logged``
    lost : how it did not come to the end of the path, None where it did
    """

    controller: ControllerName
    scenario: ScenarioName
    speed: float
    disturbance: dict[str, float]
    prediction_model: str
    simulation_model: str
    scenario_run: str | None = None
    seed: int | None = None
    lost: str | None = None


@dataclass(frozen=True)
class Score:
    """A measure of one controller in one scenario over all its disturbed starts.

    value : median over the runs that were completed; low, high : its 95 % interval (bootstrap over runs)
    """

    measure: str
    value: float
    low: float | None
    high: float | None
    unit: str


@dataclass(frozen=True)
class Cell:
    """A controller in a scenario: the table that answers the first question.

    runs, completed : how many there were, and how many came to the end within the lane
    best_in : measures in which no other controller is clearly better (paired over the same starts)
    """

    controller: ControllerName
    scenario: ScenarioName
    runs: int
    completed: int
    scores: list[Score]
    best_in: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class ModelPair:
    """A prediction model against a simulation model, one controller, over the same starts."""

    controller: ControllerName
    prediction_model: str
    simulation_model: str
    completed: float
    lateral_error_rms: float
    lateral_error_max: float
    cost_ns_per_step: float | None = None


@dataclass(frozen=True)
class MismatchCurve:
    """How the error of a controller grows with one mismatch of the truck.

    what : mass, friction, dead_time, ...; unit : of ``sizes``, "1" where relative
    lateral_error_max : per size, None where the path was lost
    """

    controller: ControllerName
    scenario: ScenarioName
    what: str
    unit: str
    sizes: list[float]
    lateral_error_max: list[float | None]


@dataclass(frozen=True)
class MarginLoss:
    """A controller on the truck without and with the effects that were found.

    completed_* : share of the runs; lateral_error_max_* : from an undisturbed start [m]
    """

    controller: ControllerName
    scenario: ScenarioName
    effects: list[str]
    completed_without: float
    completed_with: float
    lateral_error_max_without: float
    lateral_error_max_with: float
    is_lost: bool


@dataclass(frozen=True)
class LoggedLevel:
    """One level of the comparison with a logged run.

    0 : measured steering -> vehicle; 1 : command -> actuator and vehicle; 2 : the controller on the logged
    states, its command compared; 3 : the whole loop on the logged reference, only where level 2 agrees
    rms : signal -> rms error [SI]; agrees : None where the level could not be run
    """

    run: str
    level: Literal[0, 1, 2, 3]
    agrees: bool | None
    rms: dict[str, float]
    allowed: dict[str, float]
    controller: ControllerName | None = None
    reason: str | None = None


@dataclass(frozen=True)
class Claim:
    """A statement of the source, examined: whether the runs support it, and the numbers.

    difference : of a measure, the controller of the claim less another, over the same starts
    measures, against : of each difference, the name of its measure and the other controller
    """

    claim: str
    holds: Literal["yes", "no", "in part", "undecided"]
    evidence: str
    difference: list[Estimate] = field(default_factory=list)
    measures: list[str] = field(default_factory=list)
    against: list[ControllerName] = field(default_factory=list)


@dataclass(frozen=True)
class ValidateResult:
    """The answer of ``ident validate``.

    verdict : one line: which controller, on which model, holds how far
    cells : scenario x controller; runs : all closed loops behind them
    worst : index into ``runs`` of the run that is opened in the report
    reached : the highest level of the comparison with logs that the data supports, None without logs
    model : name of the prediction model; lane_half_width : from the path to the edge of the lane [m]
    settings : what was tried, name -> told in words
    """

    schema_version: str
    provenance: Provenance
    verdict: str
    next_step: str | None
    model: str
    period: float
    lane_half_width: float
    settings: dict[str, str]
    runs: list[ClosedLoopRun]
    cells: list[Cell]
    ranking: list[ControllerName]
    pairs: list[ModelPair]
    mismatch: list[MismatchCurve]
    margins: list[MarginLoss]
    claims: list[Claim]
    logged: list[LoggedLevel]
    reached: int | None
    worst: int | None
    weights: dict[str, dict[str, float]]
    health: list[RunHealth]
    refused: list[Refusal]
    warnings: list[str]
