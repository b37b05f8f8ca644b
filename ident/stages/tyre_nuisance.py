"""Offsets, biases and banks that were fitted with the tyres, as effects with their parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from ident.estimation.tyre_fit import BANK, MISALIGNED, SENSOR_BIAS, KindFit
from ident.glossary import SIGNALS
from ident.results import EffectEstimate, Estimate
from ident.stages.tyre_data import TyreData

Array = NDArray[np.float64]

Z = float(norm.ppf(0.975))
NEEDED = 0.01
UNITS = {name: SIGNALS[name].unit for name in SENSOR_BIAS}
OFFSET = "steering_offset"
REFERENCE = "reference_x"  # coordinate: place of the point that pose and velocity refer to, from the CG


def nuisance(data: TyreData, found: KindFit, covariance: Array) -> list[EffectEstimate]:
    """Offset of the steering, then the terms of each run.

    covariance : (s, s) of the coordinates
    """
    index = found.names.index(OFFSET)
    value, std = float(found.fit.shared[index]), float(np.sqrt(covariance[index, index]))
    tests = 1 + len(data.runs) * len(found.problem.run_terms)
    made = [
        _effect("steering_offset", "G", {"angle": (value, std, "rad")}, tests, held=found.prior_of(OFFSET))
    ]
    if REFERENCE in found.names:
        made.append(_reference(found, covariance))
    for number, run in enumerate(data.runs):
        made += _of_run(number, run.name, found, covariance, tests)
    return made


def told_reference(found: KindFit, covariance: Array) -> list[str]:
    """Say where the reference point was found, if it was fitted."""
    if REFERENCE not in found.names:
        return []
    where = _reference(found, covariance).parameters["x"]
    told = f"{where.value:.2f} ± {Z * (where.std or 0.0):.2f} m ahead of the CG"
    point = "the point that lateral velocity and position refer to is stated nowhere and was fitted"
    return [f"{point}: {told}: state reference_point in vehicle.yaml"]


def _reference(found: KindFit, covariance: Array) -> EffectEstimate:
    """Return where the point lies that pose and velocity refer to, which nobody has stated.

    It has no p-value: the CG is one place among others.
    """
    index = found.names.index(REFERENCE)
    value, std = float(found.fit.shared[index]), float(np.sqrt(covariance[index, index]))
    where = _estimate(value, std, "m", found.prior_of(REFERENCE))
    return EffectEstimate("antenna_offset", "M", {"x": where})


def _of_run(number: int, run: str, found: KindFit, covariance: Array, tests: int) -> list[EffectEstimate]:
    spread = found.fit.point.by_run[number].own_covariance(covariance)
    std = np.sqrt(np.maximum(np.diag(spread), 0.0))
    values = found.fit.point.of_runs[number]
    terms = [term.name for term in found.problem.run_terms]
    made = []
    for name, unit in UNITS.items():
        if name not in terms:
            continue
        i = terms.index(name)
        effect, parameter = ("antenna_offset", "heading") if name == "heading" else ("sensor_bias", "bias")
        part = {parameter: (float(values[i]), float(std[i]), unit)}
        made.append(_effect(effect, "M", part, tests, of=name, run=run, held=SENSOR_BIAS[name]))
    if MISALIGNED.name in terms:
        i = terms.index(MISALIGNED.name)
        turned = {"heading": (-float(values[i]), float(std[i]), "rad")}
        of, held = MISALIGNED.by_speed_to, MISALIGNED.prior_std
        made.append(_effect("antenna_offset", "M", turned, tests, of=of, run=run, held=held))
    if all(name in terms for name in BANK) and found.problem.has(number, "bank_cos"):
        at = [terms.index(name) for name in BANK]
        parts = {name: (float(values[i]), float(std[i]), "1") for name, i in zip(BANK, at, strict=True)}
        made.append(_effect("road_bank", "Y", parts, tests, run=run, held=BANK["bank_cos"]))
    return made


def _effect(
    name: str,
    enters: str,
    parts: dict[str, tuple[float, float, str]],
    tests: int,
    *,
    held: float,
    of: str | None = None,
    run: str | None = None,
) -> EffectEstimate:
    """Put one effect in words; it is needed where its p-value, for all that were looked at, is below 1 %."""
    parameters = {key: _estimate(*part, held) for key, part in parts.items()}
    smallest = min(2 * float(norm.sf(abs(value) / max(std, 1e-300))) for value, std, _ in parts.values())
    p = min(1.0, smallest * tests * len(parts))
    return EffectEstimate(name, enters, parameters, of, run, p, p < NEEDED)


def _estimate(value: float, std: float, unit: str, held: float) -> Estimate:
    if std > held / 2:
        reason = f"the data do not tell it; held near zero by what is usual ({held:g})"
        return Estimate(value, std, None, None, unit, "not_identifiable", reason)
    return Estimate(value, std, value - Z * std, value + Z * std, unit)
