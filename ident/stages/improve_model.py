"""The improved model as a part of ``model.yaml``: body, tyres, added effects, noise, covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ident.estimation.actuator_fit import steering_model
from ident.estimation.actuator_layer import ActuatorLayer
from ident.estimation.actuator_layer_fit import ActuatorLayerFit
from ident.estimation.improvement import Improvement
from ident.estimation.motion_fit import MotionFit
from ident.estimation.motion_layer import KIND
from ident.estimation.noise import AutoRegression
from ident.glossary import AXLES
from ident.results import Estimate, SteeringModel
from ident.stages.improve_data import LayerData
from ident.stages.improve_told import estimate_of
from ident.stages.tyre_data import GIVEN, TyreData

Array = NDArray[np.float64]


def model_part(found: Improvement, data: LayerData) -> Mapping[str, Any]:
    """What the loop has identified."""
    part: dict[str, Any] = {"effects": _effects(found)}
    actuator, motion = found.fits.get("actuator"), found.fits.get("motion")
    if isinstance(actuator, ActuatorLayerFit):
        layer = found.layers["actuator"]
        assert isinstance(layer, ActuatorLayer)
        part["steering"] = _steering(actuator, layer)
    if isinstance(motion, MotionFit) and data.motion is not None:
        part |= _motion(motion, data.motion)
    return part


def _effects(found: Improvement) -> list[dict[str, Any]]:
    made = []
    for layer, key in found.added:
        card, estimate = found.layers[layer].effect(key), estimate_of(found.fits[layer], key)
        parameters = {name: _value(one) for name, one in estimate.parameters.items()}
        made.append({"name": card.name, "enters": card.enters, "parameters": parameters, "of": card.of})
    return made


def _value(one: Estimate) -> dict[str, Any]:
    return {key: asdict(one)[key] for key in ("value", "std", "unit")}


def _steering(fit: ActuatorLayerFit, layer: ActuatorLayer) -> dict[str, Any]:
    """The linear part of the actuator."""
    model = steering_model(fit.fit)
    values = {name: _value(getattr(model, name)) for name in SteeringModel.__dataclass_fields__}
    pair = "road_wheel" if layer.signal == "road_wheel_angle" else "steering_wheel"
    return {**values, "pair": pair}


def _motion(fit: MotionFit, data: TyreData) -> dict[str, Any]:
    """Body, tyres, noise and covariance of the motion."""
    final, problem = fit.final, fit.point.problem
    slopes = np.array([c.slope(at) for c, at in zip(problem.coordinates, final.shared, strict=True)])
    covariance = slopes[:, None] * final.covariance * slopes
    std = dict(zip((one.name for one in problem.coordinates), np.sqrt(np.diag(covariance)), strict=True))
    values = problem.values(final.shared)

    def told(name: str, unit: str) -> dict[str, Any]:
        return {"value": values[name], "std": float(std[name]), "unit": unit}

    given = {
        name: {"value": float(getattr(data.vehicle, name)), "std": data.vehicle.std.get(name), "unit": unit}
        for name, unit in GIVEN.items()
    }
    units = {"cornering_stiffness": "N/rad", "peak_force": "N", "shape": "1", "curvature": "1"}
    tyres = {axle: {n: told(f"{axle}.{n}", unit) for n, unit in units.items()} for axle in AXLES}
    return {
        "vehicle": {**given, "yaw_inertia": told("yaw_inertia", "kg m^2")},
        "reference_point": data.vehicle.reference_point,
        "tyres": {"kind": KIND, **tyres},
        "noise": _noise(fit),
        "parameters": [_place(one.name) for one in problem.coordinates],
        "covariance": [[float(x) for x in row] for row in covariance],
        "valid_range": _valid_range(fit),
    }


def _place(name: str) -> str:
    """Name of a coordinate by its place in the model file."""
    first = name.partition(".")[0]
    if first in AXLES:
        return f"tyres.{name}"
    return f"vehicle.{name}" if name == "yaw_inertia" else f"effects.{name}"


def _noise(fit: MotionFit) -> dict[str, Any]:
    made = {}
    for name, one in fit.point.noise.items():
        shape = one.shape
        ar = shape.coefficients.tolist() if isinstance(shape, AutoRegression) else []
        period = fit.point.residuals[name].samples.period
        made[name] = {"std": one.std, "ar": ar, "sample_period": period}
    return made


def _valid_range(fit: MotionFit) -> dict[str, list[float]]:
    point = fit.point
    outputs = point.outputs
    felt = outputs[:, point.problem.engine.outputs.index("felt_acceleration")]
    speed = point.problem.windows.inputs[:, 1]
    return {
        "speed": [float(speed.min()), float(speed.max())],
        "lateral_acceleration": [float(felt.min()), float(felt.max())],
    }
