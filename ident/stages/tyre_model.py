"""The part of ``model.yaml`` that the tyre stage knows.

The kind of tyres that goes on stands there with the covariance of its fit; PAC2002 tyres that were fitted
with it stand beside it, with their property files and standard errors, so that they can be exported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from ident.estimation.tyre_estimates import Uncertainty
from ident.estimation.tyre_fit import KindFit
from ident.glossary import AXLES
from ident.results import EffectEstimate, Estimate, TyreFit, TyresResult
from ident.stages.tyre_data import GIVEN, TyreData
from ident.stages.tyre_files import PAC2002

OF_EFFECTS = {"steering_offset": "effects.steering_offset.angle", "reference_x": "effects.antenna_offset.x"}


def model_part(data: TyreData, result: TyresResult, found: KindFit, known: Uncertainty) -> Mapping[str, Any]:
    """Return the part of ``model.yaml`` that this stage knows; ``found``: the kind that goes on."""
    by_kind = {fit.kind: fit for fit in result.fits}
    own = by_kind[result.chosen]
    beside = by_kind[PAC2002] if PAC2002 in by_kind and own.kind != PAC2002 else None
    given = {
        name: {"value": float(getattr(data.vehicle, name)), "std": data.vehicle.std.get(name), "unit": unit}
        for name, unit in GIVEN.items()
    }
    return {
        "vehicle": {**given, "yaw_inertia": _value(own.yaw_inertia)},
        "reference_point": data.vehicle.reference_point,
        "tyres": _tyres(own, result),
        "property_tyres": None if beside is None else _tyres(beside, result),
        "effects": [_effect_part(one) for one in result.nuisance],
        "noise": {
            name: {"std": one.std, "ar": one.ar, "sample_period": one.sample_period}
            for name, one in result.noise.items()
        },
        "parameters": _names(found),
        "covariance": known.covariance_of_values(found),
        "valid_range": {"speed": result.speed, "lateral_acceleration": result.lateral_acceleration},
    }


def _names(found: KindFit) -> list[str]:
    """Names of the coordinates by their place in the model."""
    names = [f"tyres.{n}" if n.partition(".")[0] in AXLES else f"vehicle.{n}" for n in found.names]
    for coordinate, parameter in OF_EFFECTS.items():
        if coordinate in found.names:
            names[found.names.index(coordinate)] = parameter
    return names


def _tyres(fit: TyreFit, result: TyresResult) -> dict[str, Any]:
    return {
        "kind": fit.kind,
        **{axle: {k: _value(v) for k, v in getattr(fit, axle).items()} for axle in AXLES},
        "property_files": result.property_files if fit.kind == PAC2002 else None,
    }


def _value(one: Estimate) -> dict[str, Any]:
    return {key: asdict(one)[key] for key in ("value", "std", "unit")}


def _effect_part(one: EffectEstimate) -> dict[str, Any]:
    parameters = {name: _value(estimate) for name, estimate in one.parameters.items()}
    return {"name": one.name, "enters": one.enters, "parameters": parameters, "of": one.of, "run": one.run}
