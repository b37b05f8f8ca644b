"""The models that are evaluated, from the results of the tyre stage or from a model file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import compiled
from ident.dynamics.kinematic import kinematic
from ident.dynamics.tyres import TYRES
from ident.errors import BadRecipe, NotIdentifiable
from ident.estimation.evaluation import Candidate
from ident.estimation.tyre_fit import AXLES, BANK
from ident.model_file import Value, read_model
from ident.results import Estimate, ModelName, TyresResult

BODY = ("mass", "cg_to_front_axle", "cg_to_rear_axle")
OFFSET = "steering_offset"


def candidates(tyres: TyresResult, names: Sequence[ModelName]) -> list[Candidate]:
    """Return the models that exist, the simplest first."""
    body = {name: tyres.fixed[name].value for name in BODY}
    offset = _offset(tyres)
    made = []
    if "kinematic" in names:
        known = {name: body[name] for name in BODY[1:]}
        made.append(Candidate("kinematic", compiled(kinematic()), {**known, OFFSET: offset}))
    for fit in tyres.fits:
        if fit.kind in names:
            axles = {"front": fit.front, "rear": fit.rear}
            parts = {
                f"{axle}.{name}": _known(axles[axle][name])
                for axle in AXLES
                for name in TYRES[fit.kind].names
            }
            inertia = _known(fit.yaw_inertia)
            made.append(_bicycle(fit.kind, fit.kind, {**body, "yaw_inertia": inertia, **parts}, offset))
    if not made:
        raise NotIdentifiable(f"none of the models {', '.join(names)} was fitted: run `ident tyres`")
    return made


def from_file(path: Path) -> Candidate:
    """Return the bicycle of a model file.

    Raises
    ------
    BadRecipe
        If the file has no vehicle or no tyres.
    """
    model = read_model(path)
    if model.tyres is None or model.vehicle is None:
        raise BadRecipe(f"{path}: holds no tyres: name the model.yaml of `ident tyres`")
    body = {
        name: _value(getattr(model.vehicle, name), f"{path}: vehicle.{name}")
        for name in (*BODY, "yaw_inertia")
    }
    axles = {"front": model.tyres.front, "rear": model.tyres.rear}
    parts = {}
    for axle in AXLES:
        for name in TYRES[model.tyres.kind].names:
            parts[f"{axle}.{name}"] = _value(axles[axle].get(name), f"{path}: tyres.{axle}.{name}")
    offsets = [one.parameters["angle"].value for one in model.effects if one.name == OFFSET]
    return _bicycle(str(path), model.tyres.kind, {**body, **parts}, (offsets or [0.0])[0] or 0.0)


def sensor_biases(tyres: TyresResult) -> dict[str, float]:
    """Mean bias of each sensor over the runs of the fit; it is the sensor's, not the vehicle's."""
    found: dict[str, list[float]] = {}
    for one in tyres.nuisance:
        if one.of is not None and one.enters == "M":
            found.setdefault(one.of, []).extend(
                float(estimate.value)
                for estimate in one.parameters.values()
                if estimate.value is not None and estimate.status == "identified"
            )
    return {name: sum(values) / len(values) for name, values in found.items() if values}


def _bicycle(name: str, kind: str, parameters: Mapping[str, float], offset: float) -> Candidate:
    level = {**dict.fromkeys(BANK, 0.0), OFFSET: offset}
    return Candidate(name, compiled(bicycle(kind, kind)), {**parameters, **level})


def _offset(tyres: TyresResult) -> float:
    found = [one.parameters["angle"].value for one in tyres.nuisance if one.name == OFFSET]
    return (found or [0.0])[0] or 0.0


def _known(one: Estimate) -> float:
    if one.value is None:
        raise NotIdentifiable(f"a parameter of the tyres has no value: {one.reason}")
    return one.value


def _value(one: Value | None, what: str) -> float:
    if one is None or one.value is None:
        raise BadRecipe(f"{what} is missing, need its value")
    return one.value
