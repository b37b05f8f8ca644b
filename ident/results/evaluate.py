"""Results of ``ident evaluate``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ident.results.common import Estimate, Provenance, Refusal
from ident.results.logs import RunHealth

ModelName = Literal[
    "kinematic", "linear", "piecewise_linear", "brush", "magic_formula", "pac2002", "two_track"
]
InputLevel = Literal["measured", "request"]
SplitBy = Literal["run", "part", "block", "none"]


@dataclass(frozen=True)
class Error:
    """The size of an error with its 95 % interval, by block bootstrap over the held-out data."""

    value: float
    low: float | None
    high: float | None
    unit: str


@dataclass(frozen=True)
class AccelerationBand:
    """Errors while the lateral acceleration is between two sizes.

    lowest, highest : |a_y| [m/s²], highest None where there is no end; seconds : driven in the band
    """

    lowest: float
    highest: float | None
    seconds: float
    rms: dict[str, Error]


@dataclass(frozen=True)
class RunError:
    """Errors of one model on one held-out run, whole and free-running: signal -> root mean square."""

    run: str
    seconds: float
    rms: dict[str, float]


@dataclass(frozen=True)
class EvaluatedModel:
    """One model, driven by one input, on the held-out data.

    input : the measured steering, or the request through the identified actuator
    rms, peak : signal -> error over whole runs from the logged initial state
    nrmse : rms over the standard deviation of the measured signal [-]; vaf : variance accounted for [-]
    windows : length, such as "2 s" -> signal -> rms over windows of this length from many starts
    by_lateral_acceleration : rms over the shortest windows, by size of the lateral acceleration
    valid_to : |a_y| up to which every band is acceptable [m/s²], None where none is
    over_noise : signal -> rms over that of a repeated run, where there are repeats [-]
    cost_ns_per_step : of simulation, measured in this run
    """

    name: ModelName
    input: InputLevel
    rms: dict[str, Error]
    nrmse: dict[str, float]
    vaf: dict[str, float]
    peak: dict[str, float]
    windows: dict[str, dict[str, Error]]
    by_lateral_acceleration: list[AccelerationBand]
    valid_to: float | None
    cost_ns_per_step: float
    by_run: list[RunError]
    over_noise: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Comparison:
    """Whether one model is really better than another, paired on the same windows.

    ratio : rms of ``better`` over that of ``worse``, over ``signal``; p_value : that there is no difference
    """

    better: str
    worse: str
    signal: str
    ratio: Estimate
    p_value: float


@dataclass(frozen=True)
class Characteristic:
    """One figure in the style of ISO 14792 or ISO 14793, measured and simulated on the same data.

    tolerance : relative; within : whether they agree within it, None where one is missing
    """

    name: str
    style: Literal["ISO 14792", "ISO 14793"]
    measured: Estimate
    simulated: dict[str, Estimate]
    tolerance: float
    within: dict[str, bool]


@dataclass(frozen=True)
class Check:
    """One thing that was looked at before any number is believed."""

    what: str
    verdict: Literal["fine", "warning", "refused"]
    text: str


@dataclass(frozen=True)
class Requirement:
    """A limit of the recipe and what was measured: ``met`` is None where it could not be measured."""

    signal: str
    limit: float
    measured: float | None
    unit: str
    met: bool | None


@dataclass(frozen=True)
class CostRatio:
    """How much more a step of one model costs than one of another, both timed in this run.

    ratio : of their ``cost_ns_per_step`` [-]; reason : where it comes from
    reported : by the source, None where it reports none
    """

    model: ModelName
    over: ModelName
    ratio: float
    reported: float | None
    reason: str


@dataclass(frozen=True)
class EvaluateResult:
    """`ident evaluate`: which model is good enough, and for what.

    acceptable : signal -> rms over 2 s windows up to which a model is good enough
    chosen, chosen_input : the model within the acceptable band at the least cost; None where none is
    coverage : what was driven: seconds in cells of speed and |a_y|, with their edges
    held_out, training : names of runs, or of parts of runs ("manual_a [40, 60] s")
    geometry : cg_to_front_axle, cg_to_rear_axle, reference_x of the positions [m], where known: to draw it
    against : path of the other model file, where two were compared
    cost_ratios : PAC2002 over piecewise linear tyres, two tracks over one, where both were evaluated
    two_track : what the two-track model takes as given, in words; None where it was not evaluated
    """

    schema_version: str
    provenance: Provenance
    verdict: str
    next_step: str | None
    models: list[EvaluatedModel]
    acceptable: dict[str, Error]
    chosen: ModelName | None
    why: str
    split_by: SplitBy
    held_out: list[str]
    training: list[str]
    comparisons: list[Comparison]
    characteristics: list[Characteristic]
    checks: list[Check]
    requirements: list[Requirement]
    coverage: dict[str, list[list[float]]]
    speed_edges: list[float]
    acceleration_edges: list[float]
    repeat_noise: dict[str, float]
    runs: list[RunHealth]
    refused: list[Refusal]
    warnings: list[str]
    against: str | None = None
    geometry: dict[str, float] = field(default_factory=dict)
    cost_ratios: list[CostRatio] = field(default_factory=list)
    two_track: str | None = None
