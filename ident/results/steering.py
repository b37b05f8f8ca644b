"""Results of ``ident steering``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ident.results.common import Estimate, Provenance, Refusal
from ident.results.logs import RunHealth

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
