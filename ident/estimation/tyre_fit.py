"""Fit the axle tyres of the dynamic bicycle to windows of measured motion (model matching, 2.2.5).

Mass and the distances of the axles are taken as given: planar motion tells mass, yaw inertia and stiffness
only in ratio. Fitted are the parameters of both axles, the yaw inertia, the offset of the steering and, run
by run, the bias of each sensor. Positive parameters are fitted as logarithms.

What the data hardly tell is held by a weak prior, said in ``PRIORS``: D, C and E of a Magic Formula axle are
known only jointly until its peak is excited. Where the posterior is not much narrower than the prior, the
parameter is called not identifiable. Tyres of a property file have scaling factors instead, of which
:mod:`ident.estimation.tyre_scaling` says which are fitted.

The state starts anew in every window of ``WINDOW`` seconds, so that what the model lacks and the noise of the
measured steering and speed, which are inputs, do not pile up in heading and position.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ident.dynamics.bicycle import bicycle
from ident.dynamics.constants import GRAVITY
from ident.dynamics.engine import compiled
from ident.dynamics.parameter import Parameter
from ident.dynamics.tyres import Stiffness, Tyre, by_name, stiffness, tyre_of
from ident.estimation.coordinates import Coordinate, RunTerm
from ident.estimation.noise import NoiseModel
from ident.estimation.vehicle_fit import VehicleFit, fit_vehicle, inflation
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_problem import VehicleProblem
from ident.estimation.vehicle_records import MotionRecord, Windows, cut
from ident.glossary import AXLES
from ident.results import TyreKind

Array = NDArray[np.float64]

KINKS = ((0.85, 0.85), (0.7, 0.7), (0.55, 0.55), (0.7, 2.0), (2.0, 0.7))  # of the largest slip angles
WINDOW = 10.0  # [s]

SENSOR_BIAS = {"yaw_rate": 0.02, "lateral_acceleration": 0.5, "lateral_velocity": 0.2, "heading": 0.1}
STEERING_OFFSET = 0.03  # [rad] standard deviation of the prior
BANK = {"bank_cos": 0.05, "bank_sin": 0.05}
BANK_CALLED_FOR, TURN_CALLED_FOR = 1e-4, 1e-3  # p-values below which a bank, a turned sensor join the model
MISALIGNED = RunTerm("lateral_velocity_by_speed", 0.02, by_speed_to="lateral_velocity")
TURNED = np.pi / 2  # [rad] of heading in a run, below which a bank and a bias of the accelerometer are alike
AT_REFERENCE = ("lateral_velocity", "position_x")
REFERENCE = 0.5  # of the wheelbase: standard deviation of the prior of a reference point that nobody states

USUAL_INERTIA, STATED_INERTIA = 0.5, 0.2  # priors of the logarithm: of m l_f l_r; of a stated value
FARTHEST = 10.0  # times, from the prior
FRICTION = 0.8  # [-] prior of peak force over load, and of its logarithm's standard deviation
PRIORS: dict[str, tuple[float, float]] = {
    "peak_force": (np.nan, 0.7),
    "shape": (np.log(1.3), 0.3),
    "curvature": (-0.5, 2.0),
    "saturation_slip": (np.log(0.2), 1.0),
    "LMUY": (0.0, 1.0),
}
RANGES: dict[str, tuple[float, float]] = {
    "shape": (0.8, 2.2),
    "curvature": (-10.0, 1.0),
    "LCY": (0.5, 1.6),
    "LEY": (-10.0, 10.0),
}
NOT_LOGARITHMIC = ("curvature", "LEY")


@dataclass(frozen=True)
class Body:
    """What the fit takes as given.

    mass [kg]; cg_to_front_axle, cg_to_rear_axle [m]
    yaw_inertia : where somebody has stated it with its error, [kg m²]
    std : name -> standard deviation of each of these, where stated
    """

    mass: float
    cg_to_front_axle: float
    cg_to_rear_axle: float
    yaw_inertia: float | None = None
    std: Mapping[str, float] = field(default_factory=dict)

    @property
    def wheelbase(self) -> float:
        """Distance of the axles [m]."""
        return self.cg_to_front_axle + self.cg_to_rear_axle

    def load(self, axle: str) -> float:
        """Vertical load of an axle at rest [N]."""
        other = self.cg_to_rear_axle if axle == "front" else self.cg_to_front_axle
        return self.mass * GRAVITY * other / self.wheelbase


@dataclass(frozen=True)
class Axles:
    """The tyres of both axles, of one kind.

    held : parameters, such as "front.LEY", that are not fitted -> their value
    why_held : parameter -> why
    """

    front: Tyre
    rear: Tyre
    held: Mapping[str, float] = field(default_factory=dict)
    why_held: Mapping[str, str] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """Name of the kind."""
        return self.front.kind

    def of(self, axle: str) -> Tyre:
        """Tyre of one axle."""
        return self.front if axle == "front" else self.rear

    @property
    def names(self) -> list[str]:
        """Parameters of both axles, such as "front.cornering_stiffness", also those that are held."""
        return [f"{axle}.{name}" for axle in AXLES for name in self.of(axle).names]


def axles_of(kind: str | Axles) -> Axles:
    """Both axles with tyres of one kind in ``TYRES``."""
    return kind if isinstance(kind, Axles) else Axles(tyre_of(kind), tyre_of(kind))


@dataclass(frozen=True)
class KindFit:
    """One kind of tyres, fitted.

    axles : the tyres of both axles
    problem, fit : the windows and the estimate in coordinates
    window : longest window [s]
    bank : whether the bank of the road is part of the model; bank_p : the p-value that decided it
    """

    axles: Axles
    body: Body
    problem: VehicleProblem
    fit: VehicleFit
    window: float
    bank: bool
    bank_p: float

    @property
    def kind(self) -> str:
        """Name of the kind of tyres."""
        return self.axles.kind

    @property
    def names(self) -> list[str]:
        """Names of the coordinates."""
        return [one.name for one in self.problem.coordinates]

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters of the model that the runs share."""
        return self.problem.values(self.fit.shared)

    def of_axle(self, axle: str) -> dict[str, float]:
        """Parameters of the tyres of one axle."""
        return {name: self.parameters[f"{axle}.{name}"] for name in self.axles.of(axle).names}

    def stiffness(self, axle: str) -> Stiffness:
        """Cornering stiffness of an axle."""
        return stiffness(self.axles.of(axle), self.of_axle(axle), self.body.load(axle))

    def prior_of(self, name: str) -> float:
        """Standard deviation of the prior of a coordinate."""
        return next(one.prior_std for one in self.problem.coordinates if one.name == name)


def criteria(found: Mapping[TyreKind, KindFit]) -> dict[TyreKind, float]:
    """Bayesian information criterion of each kind; the least is the best.

    By the likelihood, where any kind leaves nothing but noise. Where none does, by the size of what is left
    of each signal, N ln(rms²): N counts its correlation times in the data, by the kind that leaves least.
    """
    if any(not one.fit.is_coloured for one in found.values()):
        rows = {k: sum(r.residual.size for r in one.fit.point.residuals.values()) for k, one in found.items()}
        return {
            kind: -2 * one.fit.log_likelihood + one.fit.shared.size * float(np.log(rows[kind]))
            for kind, one in found.items()
        }
    sizes = {
        kind: {name: np.log(rms**2) for name, rms in one.fit.rms().items()} for kind, one in found.items()
    }
    best = min(sizes, key=lambda kind: sum(sizes[kind].values()))
    counts = found[best].fit.independent_samples()
    total = float(np.log(sum(counts.values())))
    return {
        kind: sum(counts[name] * float(size) for name, size in own.items())
        + found[kind].fit.shared.size * total
        for kind, own in sizes.items()
    }


def fit_tyres(
    records: Sequence[MotionRecord],
    kind: str | Axles,
    body: Body,
    starts: Sequence[Mapping[str, float]],
    *,
    floor: Mapping[str, float] | None = None,
    noise: Mapping[str, NoiseModel] | None = None,
    window: float = WINDOW,
    bank: bool | None = None,
    misaligned: bool | None = None,
) -> KindFit:
    """Fit one kind of tyres, the same on both axles.

    Parameters
    ----------
    records : whole stretches of the runs, those of one run one after another
    kind : in ``TYRES``, or the tyres of both axles
    starts : parameter, such as "front.cornering_stiffness" or "yaw_inertia" -> value, one for each start
    floor : signal -> least standard deviation of its noise
    noise : of every compared signal, where it is given and not identified
    window : about how long each is [s]
    bank : whether the bank of the road is fitted; None: where the data call for it
    misaligned : whether the lateral velocity may hold a share of the speed, as a sensor that is turned
        measures it; None: where the data call for it, and never where the bank is given
    """
    if bank is None:
        extended = partial(fit_tyres, records, kind, body, floor=floor, noise=noise, window=window)
        return _extended(extended, starts, records)
    axles = axles_of(kind)
    problem = _problem(records, axles, body, window, bank=bank, misaligned=bool(misaligned))
    coordinates = [_to_coordinates(problem, start) for start in starts]
    if axles.kind == "piecewise_linear":
        coordinates += _kinked(problem, coordinates[0])
    fit = fit_vehicle(problem, coordinates, floor=floor, noise=noise)
    return KindFit(axles, body, problem, fit, window, bank, 1.0)


def _extended(
    fit: Callable[..., KindFit], starts: Sequence[Mapping[str, float]], records: Sequence[MotionRecord]
) -> KindFit:
    """Fit without bank and misalignment, and again with those for which the data call."""
    plain = fit(starts, bank=False)
    p_bank = _p_of(plain, _bank_terms(records), dict.fromkeys(BANK, 0.0)) if _turned(records) else 1.0
    there = "lateral_velocity" in plain.problem.compared
    p_misaligned = _p_of(plain, [MISALIGNED], {}) if there else 1.0
    bank, misaligned = p_bank < BANK_CALLED_FOR, p_misaligned < TURN_CALLED_FOR
    if not (bank or misaligned):
        return replace(plain, bank_p=p_bank)
    here = dict(plain.parameters)
    found = fit([here, *starts] if misaligned else [here], bank=bank, misaligned=misaligned)
    return replace(found, bank_p=p_bank)


def _problem(
    records: Sequence[MotionRecord], axles: Axles, body: Body, window: float, *, bank: bool, misaligned: bool
) -> VehicleProblem:
    windows = Windows([part for record in records for part in cut(record, window)])
    given = ("mass", "cg_to_front_axle", "cg_to_rear_axle")
    fixed = {name: float(getattr(body, name)) for name in given} | dict(axles.held)
    terms = [RunTerm(name, std) for name, std in SENSOR_BIAS.items()]
    terms += [MISALIGNED] if misaligned else []
    if bank:
        terms += _bank_terms(records)
    else:
        fixed |= dict.fromkeys(BANK, 0.0)
    coordinates = coordinates_of(axles, body, reference=_reference_is_open(records))
    model = compiled(bicycle(*(by_name(tyre) for tyre in (axles.front, axles.rear))))
    tyres = {axle: (axles.of(axle), body.load(axle)) for axle in AXLES}
    return VehicleProblem(model, windows, coordinates, fixed, terms, tyres=tyres)


def _bank_terms(records: Sequence[MotionRecord]) -> list[RunTerm]:
    only = frozenset(_turned(records))
    return [RunTerm(name, std, only) for name, std in BANK.items()]


def _turned(records: Sequence[MotionRecord]) -> list[int]:
    """Runs in which the heading turns enough to tell a bank from biases."""
    ends: dict[int, list[float]] = {}
    for record in records:
        heading = record.measured.get("heading")
        if heading is not None and heading.values.size:
            ends.setdefault(record.run, []).extend([float(heading.values.min()), float(heading.values.max())])
    return [run for run, values in ends.items() if max(values) - min(values) > TURNED]


def _reference_is_open(records: Sequence[MotionRecord]) -> bool:
    """Whether nobody has stated the point that the measured motion refers to, and something refers to it."""
    used = any(name in record.measured for record in records for name in AT_REFERENCE)
    return used and not any(record.reference_known for record in records)


def coordinates_of(kind: str | Axles, body: Body, *, reference: bool = False) -> list[Coordinate]:
    """What is fitted: both axles but for what is held, the yaw inertia, the offset of the steering.

    reference : whether the point that pose and velocity refer to is fitted too, being stated nowhere
    """
    axles = axles_of(kind)
    made = [
        _of_axle(axle, one, body)
        for axle in AXLES
        for one in axles.of(axle).parameters
        if f"{axle}.{one.name}" not in axles.held
    ]
    offset = Coordinate("steering_offset", logarithmic=False, prior_std=STEERING_OFFSET)
    point = Coordinate(
        "reference_x",
        logarithmic=False,
        low=-2 * body.wheelbase,
        high=2 * body.wheelbase,
        prior_std=REFERENCE * body.wheelbase,
    )
    return [*made, _inertia(body), offset, *([point] if reference else [])]


def _inertia(body: Body) -> Coordinate:
    """Yaw inertia, near what the vehicle file says, else near m l_f l_r, unless the data tell it."""
    value, std = body.mass * body.cg_to_front_axle * body.cg_to_rear_axle, USUAL_INERTIA
    if body.yaw_inertia is not None:
        value, std = body.yaw_inertia, STATED_INERTIA
        if "yaw_inertia" in body.std:
            std = body.std["yaw_inertia"] / value
    low, high = float(np.log(value / FARTHEST)), float(np.log(value * FARTHEST))
    return Coordinate(
        "yaw_inertia", logarithmic=True, low=low, high=high, prior_mean=float(np.log(value)), prior_std=std
    )


def _of_axle(axle: str, parameter: Parameter, body: Body) -> Coordinate:
    name = parameter.name
    low, high = RANGES.get(name, (parameter.low, parameter.high))
    mean, std = PRIORS.get(name, (0.0, np.inf))
    if name == "peak_force":
        mean = float(np.log(FRICTION * body.load(axle)))
    logarithmic = name not in NOT_LOGARITHMIC
    ends = np.log([low, high]) if logarithmic else np.array([low, high])
    return Coordinate(f"{axle}.{name}", logarithmic, float(ends[0]), float(ends[1]), mean, std)


def _to_coordinates(problem: VehicleProblem, start: Mapping[str, float]) -> Array:
    return np.array([one.coordinate(start.get(one.name, 0.0)) for one in problem.coordinates])


def _kinked(problem: VehicleProblem, start: Array) -> list[Array]:
    """Starts with the kink of either axle or both within the slip angles of the data.

    Beyond them the likelihood is flat in it, and nothing would draw it in.
    """
    names = [one.name for one in problem.coordinates]
    at = {axle: names.index(f"{axle}.saturation_slip") for axle in AXLES}
    wide = start.copy()
    wide[list(at.values())] = 0.0  # 1 rad
    of_runs = np.zeros((problem.windows.runs, len(problem.run_terms)))
    _, outputs = problem.simulate(wide, of_runs, problem.initial_local)
    most = {
        axle: float(np.abs(outputs[:, problem.engine.outputs.index(f"{axle}_slip_angle")]).max())
        for axle in AXLES
    }
    made = []
    for front, rear in KINKS:
        one = start.copy()
        for axle, share in (("front", front), ("rear", rear)):
            one[at[axle]] = np.log(share * most[axle])
        made.append(one)
    return made


def _p_of(found: KindFit, extra: Sequence[RunTerm], no_more_fixed: Mapping[str, float]) -> float:
    """p-value of the hypothesis that no run has these terms, by the score at zero (all runs together).

    no_more_fixed : parameters of the model that the terms take the place of
    """
    plain = found.problem
    fixed = {name: value for name, value in plain.fixed.items() if name not in no_more_fixed}
    terms = [*plain.run_terms, *extra]
    wider = plain.with_changed(fixed=fixed, run_terms=terms)
    of_runs = np.pad(found.fit.point.of_runs, ((0, 0), (0, len(extra))))
    point = replace(found.fit.point, problem=wider, of_runs=of_runs)
    gained = _left(found.fit.point) - _left(point)
    freedom = sum(wider.windows.runs if term.only is None else len(term.only) for term in extra)
    return float(chi2.sf(max(gained, 0.0) / inflation(found.fit), freedom))


def _left(point: VehiclePoint) -> float:
    """Sum of squares that a Gauss-Newton step of all parameters would leave."""
    rest = point.triangle()[point.shared.size :, -1]
    return float(rest @ rest)
