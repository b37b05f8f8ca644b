"""Results of ``ident improve``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ident.results.common import Estimate, Provenance, Refusal
from ident.results.evaluate import SplitBy
from ident.results.logs import RunHealth

Verdict = Literal["adequate", "named", "equivalent", "unexplained"]
LayerName = Literal["actuator", "motion"]
CheckVerdict = Literal["agrees", "differs", "not_testable"]

DIFFERENT_SIZES, DOUBTFUL_SIZES = 1e-3, 0.05
"""p-value of one size in all runs below which an effect does not stand, and below which it is told."""


@dataclass(frozen=True)
class ErrorRange:
    """Root mean square of measured minus modelled of one signal, with its 95 % interval (blocks drawn anew).

    low, high : None where the data have too few blocks
    """

    value: float
    low: float | None
    high: float | None
    unit: str


@dataclass(frozen=True)
class SensorCheck:
    """Two sensors against each other, or one against rest; no model of the vehicle takes part.

    name : such as "gyro against heading: scale"
    signals : that take part
    estimate : of what should be ``expected`` (zero for a bias or a lag, one for a scale)
    effect : of the catalogue, that a difference would be, such as "gyro_scale"
    meaning : in words, with what to do
    """

    name: str
    signals: list[str]
    estimate: Estimate
    expected: float
    p_value: float | None
    verdict: CheckVerdict
    effect: str | None
    meaning: str


@dataclass(frozen=True)
class ImproveGate:
    """Whether anything is left in the residuals that noise does not explain.

    p_value : of the hypothesis that nothing is, all that was looked for together
    rejected : at ``level``
    strongest : what fired, as "yaw moment: step at a time"; layer : where
    tests : how many directions were looked at; block : length of what is drawn as one [s]; draws
    """

    p_value: float
    rejected: bool
    level: float
    strongest: str
    layer: LayerName
    tests: int
    block: float
    draws: int


@dataclass(frozen=True)
class Localisation:
    """How much of what is left each equation could take up, were its error any function of time.

    equation : actuator, linkage, front_tyre, rear_tyre, lateral_force, yaw_moment or a measured signal
    share : of the whitened power above noise that a free error in this equation alone explains
    """

    equation: str
    share: float


@dataclass(frozen=True)
class Candidate:
    """One effect of the catalogue (or a discovered term) at one step of the loop.

    key : name and, where it acts on one signal, that signal: "sensor_bias yaw_rate"
    statistic : of its score, 2 log likelihood that one step would gain; freedom : parameters it adds
    p_value : of the score, corrected for all that was looked at
    gain : 2 log likelihood that it gains fitted in full, None where it was not fitted
    held_out_gain : log likelihood a sample that it gains on runs that took no part, None where not fitted
    in_class : whether the data cannot tell it from the best
    parameters : fitted, else the one-step estimate of its size
    why_not : why it was not added, None where it was
    """

    key: str
    name: str
    enters: str
    statistic: float
    freedom: int
    p_value: float
    gain: float | None = None
    held_out_gain: float | None = None
    in_class: bool = False
    parameters: dict[str, Estimate] = field(default_factory=dict)
    why_not: str | None = None


@dataclass(frozen=True)
class FoundEffect:
    """One effect that was added.

    name : of the catalogue; of : the signal that it acts on, where it acts on one
    members : its class, itself first: effects that these data cannot tell apart
    equation : in MathML; meaning : of the equation and its size, in words
    meanings : parameter -> what it is, in words
    same_in_runs_p : p-value of the hypothesis that its size is the same in all runs that tell it
    share : of the noise-corrected error that all that was added to its layer takes away, signal by signal
    """

    key: str
    name: str
    enters: str
    members: list[str]
    parameters: dict[str, Estimate]
    p_value: float
    equation: str
    meaning: str
    of: str | None = None
    same_in_runs_p: float | None = None
    share: dict[str, float] = field(default_factory=dict)
    meanings: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Discovered:
    """What is left has no name in the catalogue: the best sparse term, and where it enters.

    equation : the equation that it joins, such as "yaw_moment"; term : such as "r|r|"
    mathml : both, typeset; coefficient : with its unit
    stability : share of half-samples in which it was chosen
    """

    equation: str
    term: str
    mathml: str
    coefficient: Estimate
    p_value: float
    stability: float
    share: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ImproveStep:
    """One round: the gate, where it points, what was compared, what was added.

    added : key of the effect, None where nothing was
    why : what decided, in one line
    """

    gate: ImproveGate
    localisation: list[Localisation]
    candidates: list[Candidate]
    added: str | None
    why: str


@dataclass(frozen=True)
class Confirmation:
    """The improved model against the base model on runs that took no part in its fit.

    gain : log likelihood a sample, with its 95 % interval; by_run : run -> the same gain alone
    confirmed : whether the interval lies above zero
    how : "leave one run out", or "blocks within one run"
    """

    gain: Estimate
    by_run: dict[str, float]
    confirmed: bool
    how: str


@dataclass(frozen=True)
class DetectableSize:
    """The smallest size of an effect that these data would show, at 85 % power and 5 % false alarms in all.

    typical : of the catalogue, to compare with
    """

    value: float
    unit: str
    typical: float


@dataclass(frozen=True)
class ErrorComparison:
    """Error of the base and the improved model on runs that took no part in the fit.

    noise : standard deviation of each signal's noise
    at_least : signals whose noise is at least that: their errors last longer than what is told from errors of
        the model, and only what is faster counts as noise
    """

    before: dict[str, ErrorRange]
    after: dict[str, ErrorRange]
    noise: dict[str, float]
    split_by: SplitBy
    at_least: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Regressor:
    """The variable on which what the base model leaves hangs: column "regressor" of the table "improve".

    name : in words, such as "rate of the lateral force"; signal : whose residual it explains best
    """

    name: str
    unit: str
    signal: str


@dataclass(frozen=True)
class NextExperiment:
    """The run to drive next: what it would separate or show, and why it would."""

    drive: str
    separates: list[str]
    why: str


@dataclass(frozen=True)
class ImproveResult:
    """`ident improve`: the residual, its cause, the added effect, the error before and after.

    verdict : adequate, named, equivalent or unexplained; told : the same in one line
    effects : added, in order; discovered : where the catalogue lacks what is left
    candidates : of the last step that compared any; steps : one a round
    minimum_detectable : key -> size, of every candidate that is not in the model
    not_testable : effects of the catalogue that cannot be tested on these data, or are not built yet
    base : what the loop began with, in words; layers : which parts of the truck were looked at
    regressor : what explains the residual of the base model, None where nothing was added
    """

    schema_version: str
    provenance: Provenance
    verdict: Verdict
    told: str
    base: str
    layers: list[LayerName]
    sensors: list[SensorCheck]
    effects: list[FoundEffect]
    discovered: Discovered | None
    candidates: list[Candidate]
    steps: list[ImproveStep]
    minimum_detectable: dict[str, DetectableSize]
    next_experiment: NextExperiment | None
    error: ErrorComparison
    confirmation: Confirmation | None
    not_testable: list[Refusal]
    runs: list[RunHealth]
    refused: list[Refusal]
    warnings: list[str]
    regressor: Regressor | None = None
