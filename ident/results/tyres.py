"""Results of ``ident tyres``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ident.results.common import Estimate, Provenance, Refusal
from ident.results.logs import RunHealth

STRICT = {"extra": "forbid"}

TyreKind = Literal["linear", "piecewise_linear", "magic_formula", "brush", "pac2002"]


@dataclass(frozen=True)
class TyreFile:
    """A tyre property file as it was read, whole, so that what was fitted to it can be used elsewhere.

    name : of the file, without its folder
    sha256 : of its bytes, which are ``text`` in ``encoding``
    lines : how its lines end; line feeds in ``text``, but where they are mixed
    number : axle -> how many of these tyres it has, 4 where they are dual
    not_modelled : what it holds beside what is used here
    """

    __pydantic_config__ = STRICT

    name: str
    sha256: str
    encoding: Literal["utf-8", "latin-1"]
    lines: Literal["lf", "crlf", "mixed"]
    number: dict[str, int]
    not_modelled: list[str]
    text: str


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
class TwoTrackFit:
    """The two-track model with tyres of one kind, fitted for itself to the windows of the bicycle.

    axles : "front", "rear" -> number of axles; lifted : the one of them that is off the road, 1 the foremost
    chassis : parameter -> value that was taken as given, by the vehicle file or as assumed
    front, rear : parameter -> estimate; the force is that of all wheels of the axles there together
    rms : signal -> root mean square of measured minus modelled, as of the other fits
    criterion_gain : criterion of the bicycle with these tyres less that of this model; positive: it is better
    """

    kind: TyreKind
    axles: dict[str, int]
    lifted: dict[str, int]
    chassis: dict[str, FixedValue]
    front: dict[str, Estimate]
    rear: dict[str, Estimate]
    yaw_inertia: Estimate
    steering_offset: float
    rms: dict[str, float]
    criterion_gain: float
    converged: bool


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
    spans : from and to, since the start of the run, of what was fitted [s]
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
    spans: list[list[float]] = field(default_factory=list)


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
class ForceObserver:
    """Forces of the axles as states of their own, observed from the motion without a tyre model.

    rate : by how much of its load the rate of change of a force wanders, by maximum likelihood [s^-1.5]
    noise : signal -> standard deviation per sample of the white noise that it was given
    noise_from : where that comes from, in words
    half_width : axle -> half the width of the 95 % band, median [N]; of the noise of the sensors alone
    from_inversion : axle -> rms of its difference from the force inversion [N]
    from_wheels : axle -> rms of the difference from measured wheel forces, of the "observer" and of the
        "inversion" at the same instants [N], where they were measured
    innovations : signal -> [mean, low, high] of the squared innovations over their variance, and where
        99 % of such means lie if noise and model are right
    """

    rate: float
    noise: dict[str, float]
    noise_from: str
    half_width: dict[str, float]
    from_inversion: dict[str, float]
    from_wheels: dict[str, dict[str, float]]
    innovations: dict[str, list[float]]


@dataclass(frozen=True)
class TyresResult:
    """`ident tyres`: the axle tyres of the dynamic bicycle.

    verdict : one line
    chosen : the kind that goes on into ``model.yaml``; why : in words
    excited : axle -> [lowest, highest] slip angle that the data excites [rad]
    fixed : what the vehicle file gives, such as the mass
    nuisance : offsets and biases fitted with the tyres
    property_files : those of the vehicle file, where the scaling factors of PAC2002 tyres were fitted
    observer : None where the motion does not tell the forces of two axles; why is among the warnings
    two_track : None where the vehicle file does not give what it needs; why is among what is refused
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
    property_files: list[TyreFile] = field(default_factory=list)
    observer: ForceObserver | None = None
    two_track: TwoTrackFit | None = None
