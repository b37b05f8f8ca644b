"""What the stages return and what is written as JSON: frozen dataclasses of plain numbers.

SI units (rad, rad/s); what is missing is ``None``; NaN never appears. Each class is turned into a JSON
Schema, and each output is validated against it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

SCHEMA_VERSION = "1"

Status = Literal["identified", "weak", "not_identifiable"]


@dataclass(frozen=True)
class Estimate:
    """A value with its standard error and its 95 % interval.

    value : the estimate, None where the data cannot give one
    std : standard error
    low, high : ends of the 95 % interval, None where there is none
    reason : why the status is not ``identified``
    """

    value: float | None
    std: float | None
    low: float | None
    high: float | None
    unit: str
    status: Status = "identified"
    reason: str | None = None


@dataclass(frozen=True)
class Refusal:
    """A question that the data cannot answer."""

    what: str
    reason: str


@dataclass(frozen=True)
class LogFile:
    """One file that was read."""

    path: str
    sha256: str
    bytes: int


@dataclass(frozen=True)
class Provenance:
    """What an output was made from; two runs are equal but for ``date``.

    files : the logs, with paths relative to the LOGS argument
    applied : which channel map, vehicle file and recipe were used, for each run
    command : the command that makes this output again
    """

    version: str
    command: str
    seed: int
    date: str
    files: list[LogFile] = field(default_factory=list)
    applied: dict[str, str] = field(default_factory=dict)


# --- logs and signals -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Damage:
    """What a log has lost: ``what`` says it in one line; a count is None where nothing tells it."""

    what: str
    messages_lost: int | None = None
    seconds_lost: float | None = None
    bytes_lost: int | None = None


@dataclass(frozen=True)
class Gap:
    """A stretch without samples: from ``start`` [s since the start of the run], ``seconds`` long."""

    start: float
    seconds: float


@dataclass(frozen=True)
class TopicHealth:
    """How one topic was recorded.

    rate : median rate [1/s], None below three messages
    jitter : spread (half of the 16-84 % range) of the period, in parts of the period
    gaps : stretches without messages longer than 1.5 periods
    lost : messages missing in those gaps, at the median rate, None where there is no steady rate
    out_of_order, repeated_stamps : messages stamped before, or the same as, their predecessor
    arrival_delay, arrival_delay_p95 : log time minus header stamp, median and 95 % point [s]
    """

    name: str
    type: str
    messages: int
    rate: float | None
    jitter: float | None
    gaps: list[Gap]
    lost: int | None
    stamp: Literal["header", "log"]
    out_of_order: int = 0
    repeated_stamps: int = 0
    arrival_delay: float | None = None
    arrival_delay_p95: float | None = None


@dataclass(frozen=True)
class SignalHealth:
    """One signal of the glossary as it was found in a run.

    source : "topic.field" or what it is derived from
    resolution : smallest step between different values, where the signal is quantised
    repeated : share of samples equal to the one before
    not_finite : samples that are NaN or infinite, left out
    """

    name: str
    unit: str
    source: str
    samples: int
    low: float | None
    high: float | None
    resolution: float | None
    repeated: float
    not_finite: int


@dataclass(frozen=True)
class Latency:
    """How late ``signal`` is against ``reference`` [s]; reported, never removed unasked."""

    signal: str
    reference: str
    delay: Estimate


@dataclass(frozen=True)
class RunHealth:
    """What a run holds and what is wrong with it."""

    name: str
    format: str
    start: str
    duration: float
    channels: str
    vehicle: str
    topics: list[TopicHealth]
    signals: dict[str, SignalHealth]
    missing: list[str]
    latencies: list[Latency] = field(default_factory=list)
    clocks: list[str] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)


@dataclass(frozen=True)
class InfoResult:
    """`ident info`: what is in the logs."""

    schema_version: str
    provenance: Provenance
    runs: list[RunHealth]
    unreadable: list[Refusal]
    warnings: list[str]


# --- steering -------------------------------------------------------------------------------------

Pair = Literal["steering_wheel", "road_wheel"]
Classification = Literal["first_order", "overdamped", "critically_damped", "underdamped"]
StepMethod = Literal[
    "first_order_63",
    "tangent",
    "sundaresan_krishnaswamy",
    "underdamped",
    "modified_harriott",
    "modified_harriott_iterated",
]
ExperimentKind = Literal["step", "pulse", "sine", "other"]


@dataclass(frozen=True)
class Experiment:
    """An experiment found in the request.

    start, end : [s since the start of the run]; ``end`` is the last sample that belongs to it
    start_uncertainty : how much earlier than ``start`` the change may have been [s]
    level_before, level_after : request before and after a step or pulse [rad]; before is None where
        the log begins with the step
    amplitude : size of the step or pulse, signed, or amplitude of the sine [rad]
    frequency : of a sine [rad/s]
    used_by : what uses it: "first_order_63", "modified_harriott", "likelihood"
    rejected : for everything that does not use it, the reason
    """

    run: str
    kind: ExperimentKind
    start: float
    end: float
    start_uncertainty: float = 0.0
    level_before: float | None = None
    level_after: float | None = None
    amplitude: float | None = None
    frequency: float | None = None
    used_by: list[str] = field(default_factory=list)
    rejected: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class SteeringModel:
    """K exp(-L s) / ((T1 s + 1)(T2 s + 1)), equation (2.25); total_lag is L + T1 + T2.

    natural_frequency, damping_ratio : the same denominator as s²/ω² + 2 ζ s/ω + 1 (2.19); where it is
        underdamped it has no real time constants and these two stand alone.
    """

    gain: Estimate
    dead_time: Estimate
    time_constant_1: Estimate
    time_constant_2: Estimate
    total_lag: Estimate
    natural_frequency: Estimate
    damping_ratio: Estimate


@dataclass(frozen=True)
class StepFit:
    """What one step method gives: the medians over the steps it could use, None where it has none.

    spread : standard deviation between steps of each value, None below two steps
    rms_error : of the step responses against this model [rad]
    steps : how many steps were used
    """

    method: StepMethod
    gain: float | None
    dead_time: float | None
    time_constant_1: float | None
    time_constant_2: float | None
    rms_error: float | None
    steps: int
    spread: dict[str, float | None] = field(default_factory=dict)
    reason: str | None = None
    natural_frequency: float | None = None
    damping_ratio: float | None = None


@dataclass(frozen=True)
class RunFit:
    """The model fitted to one run alone, beside the common model on that run.

    vaf : variance accounted for by the common model [-], 1 - var(residual)/var(measured)
    vaf_own : the same for the fit to this run alone
    reason : why it has no own fit, or is not used
    used : whether the common fit uses it
    """

    run: str
    excitation: list[str]
    samples: int
    model: SteeringModel | None
    rms_error: float
    vaf: float
    vaf_own: float | None
    reason: str | None = None
    used: bool = True


@dataclass(frozen=True)
class Noise:
    """The noise of the measured angle: innovations of standard deviation ``std`` [rad].

    kind : "ar" on the sample index, y_k = sum a_i y_(k-i) + e_k, or "continuous_ar1" with
        ``correlation_time`` [s] where the stamps jitter
    quantisation : resolution of the measured angle [rad], None where it is not quantised
    """

    kind: Literal["ar", "continuous_ar1"]
    std: float
    total_std: float
    ar: list[float]
    correlation_time: float | None
    quantisation: float | None


@dataclass(frozen=True)
class AmplitudeFit:
    """The model fitted to the steps and pulses of one size alone.

    amplitude : size of the steps, unsigned [rad]
    steps : how many
    """

    amplitude: float
    steps: int
    gain: Estimate
    dead_time: Estimate
    time_constant_1: Estimate
    time_constant_2: Estimate
    total_lag: Estimate


@dataclass(frozen=True)
class FrequencyPoint:
    """Gain and phase at one frequency.

    method : "sine" from a sine of this frequency, "h1" from the spectra of a chirp or other broadband part
    frequency : [rad/s]; amplitude : of the sine in the request [rad], None for h1
    gain : measured over requested amplitude [-]; phase : of the measured angle against the request [rad],
        negative for a lag, continuous over frequency
    gain_std, phase_std : standard errors under the coloured noise of the fit
    harmonic_2, harmonic_3 : amplitude at twice and three times the frequency over that at the frequency [-],
        and their standard errors; a linear system has none. None for h1
    coherence : share of the measured power that the request explains linearly [-], None for a sine
    """

    run: str
    method: Literal["sine", "h1"]
    start: float
    end: float
    frequency: float
    amplitude: float | None
    gain: float
    gain_std: float
    phase: float
    phase_std: float
    harmonic_2: float | None = None
    harmonic_2_std: float | None = None
    harmonic_3: float | None = None
    harmonic_3_std: float | None = None
    coherence: float | None = None


@dataclass(frozen=True)
class FrequencyCurve:
    """The identified transfer function over frequency, with the standard errors of its covariance.

    frequency : [rad/s], rising; gain : [-]; phase : [rad], continuous, negative for a lag
    """

    frequency: list[float]
    gain: list[float]
    gain_std: list[float]
    phase: list[float]
    phase_std: list[float]


@dataclass(frozen=True)
class Cutoff:
    """Between which frequencies something ends; ``high`` is None where it lies beyond all that was driven."""

    low: float
    high: float | None
    unit: str


@dataclass(frozen=True)
class Bandwidth:
    """The bandwidth of the steering, seen three ways.

    bode : -3 dB frequency (1/sqrt 2 of the DC gain) of the identified transfer function [rad/s]
    measured : where the measured gain crosses 1/sqrt 2 of the DC gain [rad/s]
    sine_cutoff : the highest frequency that still changes the output significantly, and the next one driven
    overlap : whether the intervals of the three overlap; None where the measurements do not reach that far
    reason : in words
    """

    bode: Estimate
    measured: Estimate
    sine_cutoff: Cutoff | None
    overlap: bool | None
    reason: str


@dataclass(frozen=True)
class SteeringResult:
    """`ident steering`: the steering transfer function and what it was identified from.

    verdict : one line
    adequate : whether the residual is explained by the noise and the runs agree with one model
    vaf : variance accounted for over all runs used
    agreement_p : p-value of the hypothesis that all runs have the same parameters
    amplitude_p : p-value of the hypothesis that steps of all sizes have the same parameters
    ratio : [[steering-wheel angle, road-wheel angle], ...] [rad], rising; empty where nothing tells it
    ratio_source : "both angles", "kinematic gain at low speed" or "vehicle file"
    """

    schema_version: str
    provenance: Provenance
    verdict: str
    next_step: str | None
    pair: Pair
    model: SteeringModel
    classification: Classification
    classification_reason: str
    adequate: bool
    agreement_p: float | None
    rms_error: float
    vaf: float
    samples: int
    noise: Noise
    step_methods: list[StepFit]
    by_run: list[RunFit]
    experiments: list[Experiment]
    runs: list[RunHealth]
    refused: list[Refusal]
    warnings: list[str]
    by_amplitude: list[AmplitudeFit] = field(default_factory=list)
    amplitude_p: float | None = None
    frequency_response: list[FrequencyPoint] = field(default_factory=list)
    model_response: FrequencyCurve | None = None
    bandwidth: Bandwidth | None = None
    ratio: list[list[float]] = field(default_factory=list)
    ratio_source: str | None = None


# --- tyres ----------------------------------------------------------------------------------------

TyreKind = Literal["linear", "piecewise_linear", "magic_formula", "brush"]


@dataclass(frozen=True)
class AxleCurve:
    """Force of an axle against its slip angle, with the standard error that its parameters leave.

    slip_angle : [rad], rising, beyond what the data excites; force, force_std : of both wheels together [N]
    """

    slip_angle: list[float]
    force: list[float]
    force_std: list[float]


@dataclass(frozen=True)
class TyreFit:
    """The bicycle with one kind of axle tyres, fitted to all runs.

    front, rear : parameter -> estimate; the force is that of the axle, both wheels together
    parameters : names in the order of ``correlation``, such as "front.cornering_stiffness", "yaw_inertia"
    rms : signal -> root mean square of measured minus modelled, from windows with estimated initial states
    to_fixed : parameter -> {fixed value -> relative change of the parameter per relative change of it}
    criterion : Bayesian information criterion; the least is the best of the fits to the same data
    """

    kind: TyreKind
    front: dict[str, Estimate]
    rear: dict[str, Estimate]
    yaw_inertia: Estimate
    rms: dict[str, float]
    parameters: list[str]
    correlation: list[list[float]]
    excited: dict[str, list[float]]
    curves: dict[str, AxleCurve]
    understeer_gradient: Estimate
    characteristic_speed: Estimate
    to_fixed: dict[str, dict[str, float]]
    log_likelihood: float
    criterion: float
    converged: bool
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class EffectEstimate:
    """One effect that is part of a fitted model, with its parameters.

    name : of the catalogue, such as "sensor_bias"; enters : A, G, T, Y, R, X or M
    of : the signal that it acts on, where it acts on one; run : where it belongs to one run
    needed : whether the data call for it (its p-value, all such effects together, is below 1 %)
    """

    name: str
    enters: str
    parameters: dict[str, Estimate]
    of: str | None = None
    run: str | None = None
    p_value: float | None = None
    needed: bool = True


@dataclass(frozen=True)
class FixedValue:
    """A value that the fit takes as given; ``std`` None where nobody stated how well it is known."""

    value: float
    std: float | None
    unit: str
    source: str


@dataclass(frozen=True)
class ResidualNoise:
    """What the fit found the noise of a signal to be.

    std : of the innovations; total_std : of the noise
    ar : y_k = sum a_i y_(k-i) + e_k at ``sample_period`` [s]
    coloured_beyond : whether what is left is correlated over longer than noise of a sensor is: then it holds
        what the model lacks, and the intervals rest on the spread between windows
    """

    unit: str
    std: float
    total_std: float
    ar: list[float]
    sample_period: float
    coloured_beyond: bool


@dataclass(frozen=True)
class TyreRun:
    """One run in the tyre fit.

    seconds : fitted, in ``windows`` windows; speed, lateral_acceleration : range [m/s], [m/s²]
    agreement_p : p-value of the hypothesis that this run has the parameters of all runs together
    reason : why it is not used, where it is not
    reference_x : x of the point that logged positions belong to, from the CG [m], None where it is not known
    """

    run: str
    windows: int
    seconds: float
    speed: list[float]
    lateral_acceleration: list[float]
    rms: dict[str, float]
    agreement_p: float | None = None
    used: bool = True
    reason: str | None = None
    reference_x: float | None = None


@dataclass(frozen=True)
class ForceComparison:
    """The front or rear axle seen by its measured wheel forces, beside what its motion says.

    from_forces, from_motion : cornering stiffness at small slip [N/rad]
    scale : measured force over the force that the motion needs (force inversion) [-]
    correlation : of the two [-]; reason : what explains a mismatch, in words
    """

    axle: Literal["front", "rear"]
    from_forces: Estimate
    from_motion: Estimate
    scale: Estimate
    correlation: float
    reason: str


@dataclass(frozen=True)
class TyresResult:
    """`ident tyres`: the axle tyres of the dynamic bicycle.

    verdict : one line
    chosen : the kind that goes on into ``model.yaml``; why : in words
    excited : axle -> [lowest, highest] slip angle that the data excites [rad]
    fixed : what the vehicle file gives, such as the mass
    nuisance : offsets and biases fitted with the tyres
    """

    schema_version: str
    provenance: Provenance
    verdict: str
    next_step: str | None
    fits: list[TyreFit]
    chosen: TyreKind
    why: str
    excited: dict[str, list[float]]
    understeer_gradient: Estimate
    characteristic_speed: Estimate
    nuisance: list[EffectEstimate]
    fixed: dict[str, FixedValue]
    noise: dict[str, ResidualNoise]
    by_run: list[TyreRun]
    agreement_p: float | None
    speed: list[float]
    lateral_acceleration: list[float]
    samples: int
    runs: list[RunHealth]
    refused: list[Refusal]
    warnings: list[str]
    measured_forces: list[ForceComparison] = field(default_factory=list)
