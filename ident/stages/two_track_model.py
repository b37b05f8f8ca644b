"""The two-track model beside the bicycle: fitted with its own tyres, then one more model to be evaluated.

Tyres that were fitted to a bicycle hold what two tracks do on top of them, so that they are fitted again (see
``estimation.two_track_fit``). What the model needs beyond them the vehicle file gives: track and height of
the centre of gravity must stand there, the rest is assumed where nobody states it, and said so. The motion
tells it badly: what load and geometry do to an axle is mostly one curve with what its tyres do.
"""

from __future__ import annotations

from collections.abc import Mapping

from ident.dynamics.axle_groups import AxleGroup
from ident.dynamics.engine import compiled
from ident.dynamics.parameter import Parameter
from ident.dynamics.two_track import two_track, two_track_parameters
from ident.dynamics.tyres import Tyre, by_name, tyre_of
from ident.errors import NotIdentifiable
from ident.estimation.evaluation import Candidate
from ident.estimation.two_track_fit import fit_two_track
from ident.estimation.tyre_estimates import tyre_fit, uncertainty
from ident.estimation.tyre_fit import BANK, KindFit, criteria
from ident.glossary import AXLES
from ident.results import Estimate, FixedValue, TwoTrackFit, TyreKind, TyresResult
from ident.stages.tyre_data import TyreData
from ident.stages.tyre_files import PAC2002, tyres_of_files
from ident.vehicle import AxlesOfGroup, Vehicle

NAME = "two_track"
BODY = ("mass", "cg_to_front_axle", "cg_to_rear_axle")
OFFSET = "steering_offset"
STATED, ASSUMED = "vehicle file", "assumed"
LIFTED_WHOLLY = 1.0

Groups = tuple[AxleGroup, AxleGroup]


def groups_of(vehicle: Vehicle) -> Groups:
    """Axles in front and behind, one each where the vehicle file says nothing."""
    front, rear = (
        AxleGroup(name, own.number, None if own.lifted is None else own.lifted - 1)
        for name, own in ((name, vehicle.axles.get(name, AxlesOfGroup())) for name in AXLES)
    )
    return front, rear


def chassis_of(vehicle: Vehicle, tyres: Mapping[str, Tyre], groups: Groups) -> dict[str, FixedValue]:
    """Parameters beyond those of the bicycle, each with where its value comes from.

    Raises
    ------
    NotIdentifiable
        If the vehicle file lacks a track or the height of the CG.
    """
    known, missing = {}, []
    for one in two_track_parameters(tyres["front"], tyres["rear"], groups):
        key, value = _stated(one, vehicle)
        if value is not None:
            known[one.name] = FixedValue(value, vehicle.std.get(key), one.unit, STATED)
        elif key in {"track", "cg_height"}:
            missing.append(key)
        else:
            known[one.name] = FixedValue(one.typical, None, one.unit, ASSUMED)
    if missing:
        lacking = " and ".join(dict.fromkeys(sorted(missing, reverse=True)))
        raise NotIdentifiable(f"the vehicle file states no {lacking}: add {lacking} to vehicle.yaml")
    return known


def _stated(one: Parameter, vehicle: Vehicle) -> tuple[str, float | None]:
    """Key of the vehicle file that gives a parameter, and the value there; None where there is none."""
    axle, _, name = one.name.partition("_")
    if axle in AXLES and name in {"track", "spacing", "lift"}:
        own = vehicle.axles.get(axle, AxlesOfGroup())
        if name == "lift":
            return "axles", LIFTED_WHOLLY
        if name == "spacing" or own.track is not None:
            return "axles", own.spacing if name == "spacing" else own.track
        return "track", vehicle.track
    return one.name, getattr(vehicle, one.name)


def two_track_fit(data: TyreData, found: Mapping[TyreKind, KindFit], chosen: TyreKind) -> TwoTrackFit:
    """Fit the two-track model from where a bicycle's fit ended.

    With PAC2002 tyres, which know their load, where they were fitted, else with the chosen kind.

    Raises
    ------
    NotIdentifiable
        If the vehicle file does not give what it needs, or the model blows up.
    """
    kind: TyreKind = PAC2002 if PAC2002 in found else chosen
    before = found[kind]
    groups = groups_of(data.vehicle)
    chassis = chassis_of(data.vehicle, {axle: before.axles.of(axle) for axle in AXLES}, groups)
    try:
        own = fit_two_track(before, {n: v.value for n, v in chassis.items()}, groups=groups, floor=data.floor)
    except ValueError as error:
        raise NotIdentifiable(str(error)) from error
    compared = criteria({"bicycle": before, NAME: own})  # type: ignore[dict-item]
    told = tyre_fit(own, uncertainty(own, data.ratio_std), 0.0)
    return TwoTrackFit(
        kind=kind,
        axles={group.name: group.axles for group in groups},
        lifted={group.name: group.lifted + 1 for group in groups if group.lifted is not None},
        chassis=chassis,
        front=told.front,
        rear=told.rear,
        yaw_inertia=told.yaw_inertia,
        steering_offset=own.parameters[OFFSET],
        rms=told.rms,
        criterion_gain=compared["bicycle"] - compared[NAME],  # type: ignore[index]
        converged=told.converged,
    )


def two_track_candidate(tyres: TyresResult, fit: TwoTrackFit) -> Candidate:
    """Make the two-track model of its fit.

    Raises
    ------
    NotIdentifiable
        If a parameter has no value.
    """
    own = _tyres(fit.kind, tyres)
    groups = tuple(
        AxleGroup(name, fit.axles[name], fit.lifted[name] - 1 if name in fit.lifted else None)
        for name in AXLES
    )
    axles = {"front": fit.front, "rear": fit.rear}
    parts = {f"{axle}.{name}": _value(axles[axle][name]) for axle in AXLES for name in own[axle].names}
    body = {name: tyres.fixed[name].value for name in BODY} | {"yaw_inertia": _value(fit.yaw_inertia)}
    chassis = {name: one.value for name, one in fit.chassis.items()}
    level = {**dict.fromkeys(BANK, 0.0), OFFSET: fit.steering_offset}
    system = two_track(*(by_name(own[axle]) for axle in AXLES), groups=(groups[0], groups[1]))
    return Candidate(NAME, compiled(system), {**body, **parts, **chassis, **level})


def two_track_told(fit: TwoTrackFit, kind: str) -> str:
    """What the two-track model takes as given, and the kind of tyres that it was fitted with, in words."""
    more = {name: count for name, count in fit.axles.items() if count > 1}
    axles = "".join(
        f", {count} axles {'in front' if name == 'front' else 'behind'}" for name, count in more.items()
    )
    lifted = "".join(f", axle {number} {name} off the road" for name, number in fit.lifted.items())
    parts = [
        f"{source}: "
        + ", ".join(_named(name, one) for name, one in fit.chassis.items() if one.source == source)
        for source in (STATED, ASSUMED)
        if any(one.source == source for one in fit.chassis.values())
    ]
    return f"two-track: {kind} tyres fitted again for it{axles}{lifted}; {'; '.join(parts)}"


def _named(name: str, one: FixedValue) -> str:
    unit = "" if one.unit == "1" else f" {one.unit}"
    return f"{name.replace('_', ' ')} {one.value:.3g}{unit}"


def _tyres(kind: TyreKind, tyres: TyresResult) -> Mapping[str, Tyre]:
    if kind == PAC2002:
        return tyres_of_files(tyres.property_files, "tyres.json").tyres
    return dict.fromkeys(AXLES, tyre_of(kind))


def _value(one: Estimate) -> float:
    if one.value is None:
        raise NotIdentifiable(f"{NAME}: a parameter of the tyres has no value: {one.reason}")
    return one.value
