"""The two-track model as one more model to be evaluated, from the fitted tyres and the vehicle file.

Its tyres are those of the bicycle's fit. What it needs beyond them the vehicle file gives (track, height of
the centre of gravity) or is assumed and said so: nobody states the share of the overturning moment in front,
and the motion tells it badly.
"""

from __future__ import annotations

from collections.abc import Mapping

from ident.dynamics.axle_groups import AxleGroup
from ident.dynamics.engine import compiled
from ident.dynamics.two_track import FRONT, REAR, two_track, two_track_parameters
from ident.dynamics.tyres import Tyre, by_name, tyre_of
from ident.errors import NotIdentifiable
from ident.estimation.evaluation import Candidate
from ident.estimation.tyre_fit import AXLES, BANK
from ident.results import Estimate, TyreFit, TyreKind, TyresResult
from ident.stages.tyre_files import PAC2002, tyres_of_files
from ident.vehicle import Vehicle

NAME = "two_track"
BODY = ("mass", "cg_to_front_axle", "cg_to_rear_axle")
NEEDED = ("track", "cg_height")
OFFSET = "steering_offset"


def two_track_candidate(
    tyres: TyresResult,
    vehicle: Vehicle,
    *,
    kind: TyreKind | None = None,
    groups: tuple[AxleGroup, AxleGroup] = (FRONT, REAR),
    given: Mapping[str, float] | None = None,
) -> tuple[Candidate, list[str]]:
    """Make the two-track model with fitted tyres.

    Parameters
    ----------
    kind : of the fits; None: PAC2002, whose tyres know their load, where it was fitted, else the chosen one
    groups : axles in front and behind
    given : values that replace what is assumed, such as {"front_roll_share": 0.5}, and those that no file
        gives, such as {"rear_spacing": 1.35}

    Returns
    -------
    candidate, assumed : the model, and in words what nobody stated

    Raises
    ------
    NotIdentifiable
        If the vehicle file lacks the track or the height of the CG, or the kind was not fitted.
    ValueError
        If ``given`` names a parameter that the model does not have.
    """
    fit = _fit(tyres, kind)
    own = _tyres(fit, tyres)
    known, assumed = chassis_of(vehicle, own, groups, dict(given or {}))
    axles = {"front": fit.front, "rear": fit.rear}
    parts = {f"{axle}.{name}": _value(axles[axle][name]) for axle in AXLES for name in own[axle].names}
    body = {name: tyres.fixed[name].value for name in BODY} | {"yaw_inertia": _value(fit.yaw_inertia)}
    level = {**dict.fromkeys(BANK, 0.0), OFFSET: _offset(tyres)}
    engine = compiled(two_track(*(by_name(own[axle]) for axle in AXLES), groups=groups))
    return Candidate(NAME, engine, {**body, **parts, **known, **level}), assumed


def _fit(tyres: TyresResult, kind: TyreKind | None) -> TyreFit:
    there = {fit.kind: fit for fit in tyres.fits}
    wanted = kind or (PAC2002 if PAC2002 in there else tyres.chosen)
    if wanted not in there:
        raise NotIdentifiable(
            f"two_track: {wanted} tyres were not fitted, need {' or '.join(there)}: add it to tyres.kinds"
        )
    return there[wanted]


def _tyres(fit: TyreFit, tyres: TyresResult) -> Mapping[str, Tyre]:
    if fit.kind == PAC2002:
        return tyres_of_files(tyres.property_files, "tyres.json").tyres
    return dict.fromkeys(AXLES, tyre_of(fit.kind))


def chassis_of(
    vehicle: Vehicle,
    tyres: Mapping[str, Tyre],
    groups: tuple[AxleGroup, AxleGroup],
    given: dict[str, float],
) -> tuple[dict[str, float], list[str]]:
    """Parameters beyond those of the bicycle, and in words which of them are assumed."""
    stated = {f"{group.name}_track": vehicle.track for group in groups} | {"cg_height": vehicle.cg_height}
    known: dict[str, float] = {}
    assumed, missing = [], []
    for one in two_track_parameters(tyres["front"], tyres["rear"], groups):
        value = given.pop(one.name, stated.get(one.name))
        if value is None and one.name in stated:
            missing.append(one.name)
        elif value is None:
            assumed.append(f"{one.name.replace('_', ' ')} {one.typical:g} ({one.meaning})")
        known[one.name] = one.typical if value is None else value
    if given:
        raise ValueError(f"the two-track model has no {', '.join(sorted(given))}")
    if missing:
        lacking = " and ".join(name for name in NEEDED if any(each.endswith(name) for each in missing))
        raise NotIdentifiable(
            f"two_track: the vehicle file states no {lacking}: add {lacking} to vehicle.yaml"
        )
    return known, assumed


def _offset(tyres: TyresResult) -> float:
    found = [one.parameters["angle"].value for one in tyres.nuisance if one.name == OFFSET]
    return (found or [0.0])[0] or 0.0


def _value(one: Estimate) -> float:
    if one.value is None:
        raise NotIdentifiable(f"two_track: a parameter of the tyres has no value: {one.reason}")
    return one.value
