"""The models that are evaluated, from the results of the tyre stage or from a model file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import compiled
from ident.dynamics.kinematic import kinematic
from ident.dynamics.tyres import Tyre, by_name, tyre_of
from ident.errors import BadRecipe, NotIdentifiable
from ident.estimation.evaluation import Candidate
from ident.estimation.tyre_fit import BANK
from ident.glossary import AXLES
from ident.model_file import Value, read_model
from ident.results import (
    CostRatio,
    Estimate,
    EvaluatedModel,
    ModelName,
    TwoTrackFit,
    TyreFile,
    TyresResult,
)
from ident.stages.two_track_model import two_track_candidate
from ident.stages.tyre_files import PAC2002, tyres_of_files

BODY = ("mass", "cg_to_front_axle", "cg_to_rear_axle")
OFFSET = "steering_offset"
TWO_TRACK: Literal["two_track"] = "two_track"
SOURCE_RATIO = 6.0  # PAC2002 over piecewise linear, as the source reports it


def candidates(tyres: TyresResult, names: Sequence[ModelName] | None) -> list[Candidate]:
    """Return the models that exist, the simplest first.

    names : those that are asked for, None for all
    """
    body = {name: tyres.fixed[name].value for name in BODY}
    offset = _offset(tyres)
    made = []
    if names is None or "kinematic" in names:
        known = {name: body[name] for name in BODY[1:]}
        made.append(Candidate("kinematic", compiled(kinematic()), {**known, OFFSET: offset}))
    for fit in tyres.fits:
        if names is None or fit.kind in names:
            axles = {"front": fit.front, "rear": fit.rear}
            own = _tyres(fit.kind, tyres.property_files, "tyres.json")
            parts = {
                f"{axle}.{name}": _known(axles[axle][name]) for axle in AXLES for name in own[axle].names
            }
            inertia = _known(fit.yaw_inertia)
            made.append(_bicycle(fit.kind, own, {**body, "yaw_inertia": inertia, **parts}, offset))
    if tyres.two_track is not None and (names is None or TWO_TRACK in names):
        made.append(two_track_candidate(tyres, tyres.two_track))
    if not made:
        raise NotIdentifiable(f"none of the models {', '.join(names or [])} was fitted: run `ident tyres`")
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
    own = _tyres(model.tyres.kind, model.tyres.property_files or [], str(path))
    parts = {}
    for axle in AXLES:
        for name in own[axle].names:
            parts[f"{axle}.{name}"] = _value(axles[axle].get(name), f"{path}: tyres.{axle}.{name}")
    offsets = [one.parameters["angle"].value for one in model.effects if one.name == OFFSET]
    return _bicycle(str(path), own, {**body, **parts}, (offsets or [0.0])[0] or 0.0)


def cost_ratios(models: Sequence[EvaluatedModel], tyres: TyresResult) -> list[CostRatio]:
    """How much more a step costs with PAC2002 tyres and with two tracks, and why.

    models : driven by the same input; a ratio is left out where one of both is not among them
    """
    cost = {one.name: one.cost_ns_per_step for one in models}
    made = []
    if PAC2002 in cost and cost.get("piecewise_linear", 0.0) > 0:
        ratio, why = cost[PAC2002] / cost["piecewise_linear"], _why_pac2002(tyres.property_files)
        made.append(CostRatio(PAC2002, "piecewise_linear", ratio, SOURCE_RATIO, why))
    own = tyres.two_track
    if own is not None and TWO_TRACK in cost and cost.get(own.kind, 0.0) > 0:
        ratio, why = cost[TWO_TRACK] / cost[own.kind], _why_two_tracks(own)
        made.append(CostRatio(TWO_TRACK, own.kind, ratio, None, why))
    return made


def _why_pac2002(files: Sequence[TyreFile]) -> str:
    sides = tyres_of_files(files, "tyres.json").coefficients
    curves = sum(1 if one.side == "symmetric" else 2 for one in sides.values())
    return (
        f"both axles together take {curves} PAC2002 curves in each of the four evaluations of a step (a tyre "
        "that is not symmetric stands beside its mirror image), each with a sine, two arctangents and "
        "coefficients that depend on load; a piecewise linear axle takes a product and two comparisons. What "
        "both share (slip angles, motion, sensors) brings the ratio down"
    )


def _why_two_tracks(fit: TwoTrackFit) -> str:
    wheels = 2 * sum(fit.axles.values())
    return (
        f"each of the four evaluations of a step takes {wheels} wheels, each with a slip angle, a load and a "
        "force of its own, where the bicycle with the same tyres takes two axles at constant load"
    )


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


def _tyres(kind: str, files: Sequence[TyreFile], source: str) -> Mapping[str, Tyre]:
    """Tyres of each axle; those of a property file come from the result or model that holds it."""
    return tyres_of_files(files, source).tyres if kind == PAC2002 else dict.fromkeys(AXLES, tyre_of(kind))


def _bicycle(
    name: str, tyres: Mapping[str, Tyre], parameters: Mapping[str, float], offset: float
) -> Candidate:
    level = {**dict.fromkeys(BANK, 0.0), OFFSET: offset}
    engine = compiled(bicycle(*(by_name(tyres[axle]) for axle in AXLES)))
    return Candidate(name, engine, {**parameters, **level})


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
