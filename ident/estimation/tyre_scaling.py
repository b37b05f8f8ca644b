"""Fit the scaling factors of PAC2002 tyres: which of them the data tell, and where the fit starts.

A property file holds whole curves; of an axle's lateral force a fit moves the cornering stiffness (LKY), the
friction (LMUY), the shape (LCY) and the curvature (LEY), as far as the data tell them:

1. LKY of both axles is always free.
2. A first fit frees LKY and LMUY. At its end the others are taken in the order LMUY, LCY, LEY, axle by axle;
   one is free if then every free factor but LKY would be known to ``TOLD``, as a standard error of its
   logarithm (of LEY itself), by the data alone. Where one is not, those after it are not either: they shape
   a part of the curve that is further out.
3. Where a factor is no longer told at the end of the fit in which it is free, it is held, and the fit done
   again.
4. A factor that is not free keeps the value of the file, and so does the curve that it shapes: the intervals
   of the others hold for a tyre whose curve has that shape.

The rule asks how well a factor would be known, not how far it is from the file's value, so that it does not
choose by the outcome.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.tyres import Tyre
from ident.dynamics.tyres.tyre import stiffness
from ident.estimation.smooth_motion import smooth_motion
from ident.estimation.tyre_fit import (
    MISALIGNED,
    Axles,
    Body,
    KindFit,
    coordinates_of,
    fit_tyres,
)
from ident.estimation.tyre_start import linear_start
from ident.estimation.vehicle_fit import inflation
from ident.estimation.vehicle_point import VehiclePoint
from ident.estimation.vehicle_records import MotionRecord
from ident.glossary import AXLES

Array = NDArray[np.float64]

ALWAYS, FIRST = "LKY", "LMUY"
ORDER = ("LMUY", "LCY", "LEY")
TOLD = 0.25  # standard error of a factor up to which it is free
NOTHING = 1e-12  # eigenvalue of the information, its diagonal one, that is none
STARTS = ((1.0, 1.0), (1.4, 1.0), (0.7, 1.0), (1.0, 0.6))  # on stiffness, on friction
LOWEST, HIGHEST = 0.15, 8.0  # of a starting value, inside the bounds


def fit_scaling(
    records: Sequence[MotionRecord],
    tyres: Mapping[str, Tyre],
    own: Mapping[str, float],
    body: Body,
    *,
    floor: Mapping[str, float] | None = None,
    bank: bool | None = None,
) -> KindFit:
    """Fit those scaling factors that the data tell.

    Parameters
    ----------
    records : whole stretches of the runs, those of one run one after another
    tyres : axle -> its PAC2002 tyres
    own : factor, such as "front.LKY" -> its value in the file
    floor : signal -> least standard deviation of its noise
    bank : whether the bank of the road is fitted; None: where the data call for it

    Raises
    ------
    ValueError
        If the model blows up from every start.
    """
    first = _holding(tyres, own, [f"{axle}.{name}" for axle in AXLES for name in ORDER if name != FIRST])
    starts = scaling_starts(first, own, records, body)
    fit = trial = fit_tyres(records, first, body, starts, floor=floor, bank=bank)
    why_held = _not_told(trial)
    while set(why_held) != set(fit.axles.held):
        axles = _holding(tyres, own, why_held)
        begin = {**fit.parameters, **axles.held}
        turned = MISALIGNED in trial.problem.run_terms
        fit = fit_tyres(records, axles, body, [begin], floor=floor, bank=trial.bank, misaligned=turned)
        why_held = {**_not_told(fit), **why_held}
    return replace(fit, axles=replace(fit.axles, why_held=why_held), bank_p=trial.bank_p)


def scaling_starts(
    axles: Axles, own: Mapping[str, float], records: Sequence[MotionRecord], body: Body
) -> list[dict[str, float]]:
    """Starting values: the stiffness of gentle driving over that of the file, friction as in the file."""
    linear = linear_start(smooth_motion(records, body), body)
    made = []
    for stiffer, friction in STARTS:
        start = {"yaw_inertia": linear.yaw_inertia, "steering_offset": linear.steering_offset or 0.0}
        for axle in AXLES:
            values = {name: own[f"{axle}.{name}"] for name in axles.of(axle).names}
            there = stiffness(axles.of(axle), values, body.load(axle)).value
            wanted = stiffer * linear.stiffness[axle] / there * values[ALWAYS]
            values |= {ALWAYS: float(np.clip(wanted, LOWEST, HIGHEST)), FIRST: friction * values[FIRST]}
            start |= {f"{axle}.{name}": value for name, value in values.items()}
        made.append(start)
    return made


def _holding(tyres: Mapping[str, Tyre], own: Mapping[str, float], names: Iterable[str]) -> Axles:
    return Axles(tyres["front"], tyres["rear"], {name: own[name] for name in names})


def _not_told(trial: KindFit) -> dict[str, str]:
    """Factors that are not to be free -> why, by the rule at the head of this module."""
    names, information = _information_on_all(trial)
    free = [name for name in names if name.rpartition(".")[2] not in ORDER]
    why: dict[str, str] = {}
    for axle in AXLES:
        for number, name in enumerate(ORDER):
            factor = f"{axle}.{name}"
            errors = _errors(information, names, [*free, factor])
            told = max(errors[one] for one in errors if one.rpartition(".")[2] in ORDER)
            if told <= TOLD:
                free.append(factor)
                continue
            why[factor] = _reason(axle, told, trial)
            why |= {f"{axle}.{later}": _after(name, axle) for later in ORDER[number + 1 :]}
            break
    return why


def _reason(axle: str, told: float, trial: KindFit) -> str:
    point, problem = trial.fit.point, trial.problem
    outputs = point.outputs
    slip = np.abs(outputs[:, problem.engine.outputs.index(f"{axle}_slip_angle")])
    size = f"{told:.2g}" if told < 100 else "more than 100"
    return (
        f"keeps the value of the file: freed, it or another factor would have a standard error of {size}, "
        f"need {TOLD}: the {axle} slip angle reaches {float(np.quantile(slip, 0.999)):.3f} rad: drive harder"
    )


def _after(name: str, axle: str) -> str:
    beyond = f"it shapes the curve further out than {name}, which is not told of the {axle} axle"
    return f"keeps the value of the file: {beyond}"


def _information_on_all(trial: KindFit) -> tuple[list[str], Array]:
    """Names of all coordinates were every factor free, and the information of the data on them (s, s).

    As wide as the residuals of the trial scatter; the priors are not in it.
    """
    everything = replace(trial.axles, held={})
    reference = "reference_x" in trial.names
    coordinates = coordinates_of(everything, trial.body, reference=reference)
    fixed = {name: value for name, value in trial.problem.fixed.items() if name not in trial.axles.held}
    problem = trial.problem.with_changed(coordinates=coordinates, fixed=fixed)
    shared = np.array([one.coordinate(trial.parameters[one.name]) for one in coordinates])
    point: VehiclePoint = replace(trial.fit.point, problem=problem, shared=shared)
    triangle = point.triangle()[: shared.size, :-1]
    of_factors = np.array([one.name.rpartition(".")[2] in ORDER for one in coordinates])
    prior = np.where(of_factors, 1 / problem.prior_std**2, 0.0)
    information = triangle.T @ triangle - np.diag(prior)
    return [one.name for one in coordinates], information / inflation(trial.fit)


def _errors(information: Array, names: Sequence[str], free: Sequence[str]) -> dict[str, float]:
    """Standard errors were only the named coordinates free, infinite where the data say nothing."""
    index = [names.index(name) for name in free]
    own = information[np.ix_(index, index)]
    size = np.sqrt(np.maximum(np.diag(own), 0.0))
    if np.any(size == 0):
        return dict.fromkeys(free, np.inf)
    values, vectors = np.linalg.eigh(own / np.outer(size, size))
    if values[0] <= NOTHING:
        return dict.fromkeys(free, np.inf)
    spread = np.sqrt(np.sum(vectors**2 / values, axis=1)) / size
    return dict(zip(free, spread.tolist(), strict=True))
