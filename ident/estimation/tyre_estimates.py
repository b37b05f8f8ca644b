"""From the fit of the tyres to what is told of them: values, intervals, verdicts, curves.

Interval of a positive parameter: of its logarithm. Where the vehicle file states how well a fixed value is
known, that error is carried through the fit to first order; where it does not, the result says how much each
parameter would move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from ident.dynamics.tyres import evaluate
from ident.estimation.coordinates import Coordinate
from ident.estimation.tyre_fit import KindFit
from ident.estimation.vehicle_fit import to_fixed
from ident.estimation.vehicle_problem import STEERING_RATIO
from ident.glossary import AXLES
from ident.results import AxleCurve, Estimate, Status, TyreFit

Array = NDArray[np.float64]

Z = float(norm.ppf(0.975))
IDENTIFIED, WEAK = 0.1, 0.5  # relative standard errors
FAR = 3.0  # standard deviations of the prior
OWN_SHARE = 0.5  # of the prior's standard deviation: above, the data add little to it
FIXED = ("mass", "cg_to_front_axle", "cg_to_rear_axle", STEERING_RATIO)
PEAK = ("peak_force", "shape", "curvature", "LMUY", "LCY", "LEY")
OF_BEND = (*PEAK, "saturation_slip")
WIDEST = 1.2  # [rad] slip angle within which a curve has its peak
STIFFNESS = "cornering_stiffness"
PEAK_REACHED = 0.95  # of the peak force: the axle has come near it
REACH = 1.6  # of the excited slip angle, up to which curves are drawn
POINTS = 81
EXCITED = 0.001  # share of the samples beyond either end
PLAIN_UNITS = {"yaw_inertia": "kg m^2", "steering_offset": "rad", "reference_x": "m"}
ABSOLUTE = ("curvature", "LEY", "steering_offset", "reference_x")


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of the coordinates with that of the fixed values in it.

    covariance : (s, s); by_fixed : (s, f) change per relative change of each of FIXED
    relative : (f,) relative standard deviation of each of FIXED, zero where none is stated
    """

    covariance: Array
    by_fixed: Array
    relative: Array

    def covariance_of_values(self, found: KindFit) -> list[list[float]]:
        """Covariance of the parameters themselves, not of their logarithms."""
        slopes = np.array(
            [one.slope(at) for one, at in zip(found.problem.coordinates, found.fit.shared, strict=True)]
        )
        rows: list[list[float]] = (self.covariance * np.outer(slopes, slopes)).tolist()
        return rows


def uncertainty(found: KindFit, steering_ratio_std: float = 0.0) -> Uncertainty:
    """Carry the stated errors of the fixed values through the fit.

    steering_ratio_std : relative
    """
    by_fixed = to_fixed(found.problem, found.fit, FIXED)
    relative = [found.body.std.get(name, 0.0) / getattr(found.body, name) for name in FIXED[:-1]]
    stated = np.array([*relative, steering_ratio_std])
    spread = by_fixed * stated
    return Uncertainty(found.fit.covariance + spread @ spread.T, by_fixed, stated)


def tyre_fit(found: KindFit, known: Uncertainty, criterion: float) -> TyreFit:
    """Everything that is told of one kind.

    criterion : by which kinds are compared, of :func:`~ident.estimation.tyre_fit.criteria`
    """
    excited = excited_slip(found)
    std = np.sqrt(np.diag(known.covariance))
    by_name = {
        one.name: _estimate(one, _unit(one.name, found), at, s, excited)
        for one, at, s in zip(found.problem.coordinates, found.fit.shared, std, strict=True)
    }
    for axle in AXLES:
        by_name |= _beyond_what_was_driven(axle, found, by_name, excited[axle])
    gradient, speed = _understeer(found, known)
    return TyreFit(
        kind=found.kind,  # type: ignore[arg-type]
        front=_of_axle("front", found, by_name, known.covariance),
        rear=_of_axle("rear", found, by_name, known.covariance),
        yaw_inertia=by_name["yaw_inertia"],
        rms=found.fit.rms(),
        parameters=found.names,
        correlation=(known.covariance / np.outer(std, std)).tolist(),
        excited=excited,
        curves={axle: _curve(axle, found, excited[axle], known.covariance) for axle in AXLES},
        understeer_gradient=gradient,
        characteristic_speed=speed,
        to_fixed=_relative_changes(found, known.by_fixed),
        log_likelihood=found.fit.log_likelihood,
        criterion=criterion,
        converged=found.fit.converged,
        warnings=_warnings(found),
    )


def excited_slip(found: KindFit) -> dict[str, list[float]]:
    """Lowest and highest slip angle of each axle [rad], one in a thousand apart at either end."""
    point = found.fit.point
    outputs = point.outputs
    made = {}
    for axle in AXLES:
        slip = outputs[:, found.problem.engine.outputs.index(f"{axle}_slip_angle")]
        low, high = np.quantile(slip, [EXCITED, 1 - EXCITED])
        made[axle] = [float(low), float(high)]
    return made


def _estimate(
    one: Coordinate, unit: str, at: float, std: float, excited: Mapping[str, Sequence[float]]
) -> Estimate:
    value = one.value(at)
    size = std * (value if one.logarithmic else 1.0)
    status, reason = _status(one, at, std, excited)
    if status == "not_identifiable":
        return Estimate(value, float(size), None, None, unit, status, reason)
    ends = [one.value(at + z * std) for z in (-Z, Z)]
    return Estimate(value, float(size), ends[0], ends[1], unit, status, reason)


def _beyond_what_was_driven(
    axle: str, found: KindFit, by_name: Mapping[str, Estimate], excited: Sequence[float]
) -> dict[str, Estimate]:
    """Call what shapes the peak weak at best, where the axle has not come near it.

    Its interval then holds only if the axle goes on beyond the data as this kind of tyres does.
    """
    own = found.of_axle(axle)
    of_peak = [f"{axle}.{name}" for name in own if name in PEAK and f"{axle}.{name}" in by_name]
    if not of_peak:
        return {}
    load, tyre = found.body.load(axle), found.axles.of(axle)
    reached, peak = (
        float(np.abs(evaluate(tyre, np.linspace(ends[0], ends[1], POINTS), own, load)[0]).max())
        for ends in (excited, (-WIDEST, WIDEST))
    )
    peak = own.get("peak_force", peak)
    if reached > PEAK_REACHED * peak:
        return {}
    reason = (
        f"rests on the shape of the curve beyond what was driven: the {axle} force reaches "
        f"{reached / 1e3:.3g} of {peak / 1e3:.3g} kN: drive harder"
    )
    return {
        name: replace(by_name[name], status="weak", reason=reason)
        for name in of_peak
        if by_name[name].status == "identified"
    }


def _unit(name: str, found: KindFit) -> str:
    if name in PLAIN_UNITS:
        return PLAIN_UNITS[name]
    axle, _, own = name.partition(".")
    return next(one.unit for one in found.axles.of(axle).parameters if one.name == own)


def _status(
    one: Coordinate, at: float, std: float, excited: Mapping[str, Sequence[float]]
) -> tuple[Status, str | None]:
    """Verdict on one parameter, and the reason where it is not identified."""
    axle, _, own = one.name.partition(".")
    if one.name in ("steering_offset", "reference_x"):
        return ("identified", None) if std < OWN_SHARE * one.prior_std else ("weak", "hardly excited")
    held = std > OWN_SHARE * one.prior_std
    relative = std if one.logarithmic else (0.0 if not held else np.inf)
    if relative <= IDENTIFIED and not held:
        return "identified", None
    what = _what_to_drive(axle, own, excited)
    if held or relative > WEAK:
        usual = one.value(one.prior_mean)
        near = f" beyond what is usual ({usual:.3g})" if np.isfinite(one.prior_std) else ""
        if held and abs(at - one.prior_mean) > FAR * one.prior_std:
            near = f", and draw it far from the usual {usual:.3g}: the model lacks something"
        return "not_identifiable", f"the data do not tell it{near}: {what}"
    return "weak", f"known to {100 * relative:.0f} %: {what}"


def _what_to_drive(axle: str, own: str, excited: Mapping[str, Sequence[float]]) -> str:
    if own in OF_BEND:
        most = max(abs(end) for end in excited[axle])
        return f"the {axle} slip angle reaches {most:.3f} rad, and its force still grows there: drive harder"
    if axle == "yaw_inertia":
        return "drive fast changes of the steering, such as lane changes at 0.5 to 1 Hz"
    return "drive with more lateral acceleration, at more than one speed"


def _of_axle(
    axle: str, found: KindFit, by_name: Mapping[str, Estimate], covariance: Array
) -> dict[str, Estimate]:
    names = found.axles.of(axle).names
    told = {**by_name, **{name: _held(name, found) for name in found.axles.held}}
    own = {name: told[f"{axle}.{name}"] for name in names}
    if found.kind == "magic_formula":
        own["stiffness_factor"] = _stiffness_factor(axle, found, own, covariance)
    if STIFFNESS not in own:
        own[STIFFNESS] = _stiffness(axle, found, covariance)
    return own


def _held(name: str, found: KindFit) -> Estimate:
    reason = found.axles.why_held.get(name)
    return Estimate(found.parameters[name], None, None, None, _unit(name, found), "not_identifiable", reason)


def _stiffness(axle: str, found: KindFit, covariance: Array) -> Estimate:
    """Slope of the curve at zero slip [N/rad], with the error that its parameters leave."""
    value, row = found.stiffness(axle).value, _stiffness_row(axle, found)
    std = float(np.sqrt(row @ covariance @ row))
    ends = (float(value * np.exp(-Z * std)), float(value * np.exp(Z * std)))
    if std > WEAK:
        reason = "drive with more lateral acceleration, at more than one speed"
        return Estimate(value, value * std, None, None, "N/rad", "not_identifiable", reason)
    status: Status = "identified" if std <= IDENTIFIED else "weak"
    why = None if status == "identified" else f"known to {100 * std:.0f} %"
    return Estimate(value, value * std, *ends, "N/rad", status, why)


def _stiffness_row(axle: str, found: KindFit) -> Array:
    """(s,) derivative of the logarithm of an axle's cornering stiffness to each coordinate."""
    slope, row = found.stiffness(axle), np.zeros(found.fit.shared.size)
    for number, name in enumerate(found.axles.of(axle).names):
        if f"{axle}.{name}" in found.names:
            at = found.names.index(f"{axle}.{name}")
            to_coordinate = found.problem.coordinates[at].slope(float(found.fit.shared[at]))
            row[at] = slope.by_parameter[number] * to_coordinate / slope.value
    return row


def _stiffness_factor(axle: str, found: KindFit, own: Mapping[str, Estimate], covariance: Array) -> Estimate:
    """B = K/(C D) [1/rad], as uncertain as its parts are together."""
    row = np.zeros(covariance.shape[0])
    for name, power in (("cornering_stiffness", 1.0), ("shape", -1.0), ("peak_force", -1.0)):
        row[found.names.index(f"{axle}.{name}")] = power
    parts = [own[name].value or np.nan for name in ("cornering_stiffness", "shape", "peak_force")]
    value, std = parts[0] / (parts[1] * parts[2]), float(np.sqrt(row @ covariance @ row))
    ends = (value * np.exp(-Z * std), value * np.exp(Z * std))
    if own["shape"].status == "not_identifiable" or std > WEAK:
        reason = "known only together with shape and peak force"
        return Estimate(value, value * std, None, None, "1/rad", "not_identifiable", reason)
    status: Status = "identified" if std < IDENTIFIED else "weak"
    return Estimate(value, value * std, float(ends[0]), float(ends[1]), "1/rad", status)


def _understeer(found: KindFit, known: Uncertainty) -> tuple[Estimate, Estimate]:
    """K_us = m/L (l_r/C_f - l_f/C_r) [rad s²/m] and v_ch = sqrt(L/K_us) [m/s].

    The fixed values stand in it themselves, too: an error of the mass leaves it as it is, for the stiffness
    found goes with the mass.
    """
    body = found.body
    terms = {
        "front": body.mass / body.wheelbase * body.cg_to_rear_axle,
        "rear": -body.mass / body.wheelbase * body.cg_to_front_axle,
    }
    value, row = 0.0, np.zeros(found.fit.shared.size)
    for axle, term in terms.items():
        part = term / found.stiffness(axle).value
        value += part
        row -= part * _stiffness_row(axle, found)
    by_fixed = (row @ known.by_fixed + _understeer_by_fixed(found, value)) * known.relative
    std = float(np.sqrt(row @ found.fit.covariance @ row + by_fixed @ by_fixed))
    gradient = _plain(value, std, "rad s^2/m", "drive circles or curves at several speeds")
    if value - Z * std <= 0:
        kind = "it may be neutral" if value + Z * std > 0 else "the vehicle oversteers"
        reason = f"the understeer gradient is {value:.2g} ± {std:.1g} rad s²/m: {kind}"
        return gradient, Estimate(None, None, None, None, "m/s", "not_identifiable", reason)
    speed = [float(np.sqrt(body.wheelbase / k)) for k in (value, value + Z * std, value - Z * std)]
    size = speed[0] * std / (2 * value)
    status: Status = "identified" if std / (2 * value) < IDENTIFIED else "weak"
    return gradient, Estimate(speed[0], size, speed[1], speed[2], "m/s", status)


def _understeer_by_fixed(found: KindFit, gradient: float) -> Array:
    """(f,) change of the understeer gradient per relative change of each of FIXED, the coordinates held.

    The stiffness of tyres of a property file grows with the load of the axle, and so with these values.
    """
    body = found.body
    share, l_f, l_r = body.mass / body.wheelbase, body.cg_to_front_axle, body.cg_to_rear_axle
    front, rear = (found.stiffness(axle) for axle in AXLES)
    by_front = -l_f * (gradient / body.wheelbase + share / rear.value)
    by_rear = -l_r * (gradient / body.wheelbase - share / front.value)
    by_load = [
        -share * l_r / front.value * front.by_load * body.load("front") / front.value,
        share * l_f / rear.value * rear.by_load * body.load("rear") / rear.value,
    ]
    loads = np.array(  # relative change of the load of either axle per relative change of each of FIXED
        [
            [1.0, -l_f / body.wheelbase, l_f / body.wheelbase, 0.0],
            [1.0, l_r / body.wheelbase, -l_r / body.wheelbase, 0.0],
        ]
    )
    return np.asarray(np.array([gradient, by_front, by_rear, 0.0]) + np.array(by_load) @ loads)


def _plain(value: float, std: float, unit: str, advice: str) -> Estimate:
    relative = std / abs(value) if value else np.inf
    ends = (value - Z * std, value + Z * std)
    if relative <= IDENTIFIED:
        return Estimate(value, std, *ends, unit)
    return Estimate(value, std, *ends, unit, "weak", f"its error is {std:.2g}: {advice}")


def _curve(axle: str, found: KindFit, excited: Sequence[float], covariance: Array) -> AxleCurve:
    most = REACH * max(abs(end) for end in excited)
    slip = np.linspace(-most, most, POINTS)
    tyre, own = found.axles.of(axle), found.of_axle(axle)
    force, _, by_parameter = evaluate(tyre, slip, own, found.body.load(axle))
    free = [number for number, name in enumerate(tyre.names) if f"{axle}.{name}" in found.names]
    index = [found.names.index(f"{axle}.{tyre.names[number]}") for number in free]
    slopes = [found.problem.coordinates[i].slope(float(found.fit.shared[i])) for i in index]
    rows = by_parameter[:, free] * np.array(slopes)
    std = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", rows, covariance[np.ix_(index, index)], rows), 0.0))
    return AxleCurve(slip.tolist(), force.tolist(), std.tolist())


def _relative_changes(found: KindFit, by_fixed: Array) -> dict[str, dict[str, float]]:
    return {
        name: {fixed: float(by_fixed[row, column]) for column, fixed in enumerate(FIXED)}
        for row, name in enumerate(found.names)
        if name.rpartition(".")[2] not in ABSOLUTE
    }


def _warnings(found: KindFit) -> list[str]:
    told = []
    if not found.fit.converged:
        told.append("the fit has not converged: its errors are not to be trusted")
    told += [
        f"{name}: not compared, its {samples.times.size} samples are too few for its noise to be told"
        for name, samples in found.problem.windows.signals.items()
        if name not in found.problem.signals
    ]
    if found.fit.is_coloured:
        slow = ", ".join(name.replace("_", " ") for name in found.fit.slow)
        told.append(
            f"what is left of {slow} is slower than noise: the model lacks something, and the "
            "intervals rest on the spread over time"
        )
    return told
