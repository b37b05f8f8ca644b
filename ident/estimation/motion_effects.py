"""How each effect of the catalogue joins the fit of the motion, and how it is screened.

One entry an effect (or an effect and the signal that it acts on). An effect of the compiled model brings its
parameters as coordinates; a bias is a term of each run; a play stands before the model; a late sensor behind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.effects import Effect, sensor_bias
from ident.dynamics.effects.body_roll import BODY_ROLL
from ident.dynamics.effects.catalogue import CATALOGUE
from ident.dynamics.effects.load_transfer import LOAD_TRANSFER
from ident.dynamics.effects.road_bank import BANK_COS, BANK_SIN
from ident.dynamics.effects.steering_offset import OFFSET
from ident.dynamics.effects.steering_ratio_nonlinearity import STEERING_RATIO_NONLINEARITY
from ident.dynamics.effects.tyre_relaxation import LENGTH, TYRE_RELAXATION
from ident.dynamics.effects.wheel_speed_scale import WHEEL_SPEED_SCALE
from ident.dynamics.parameter import Parameter
from ident.estimation.coordinates import Coordinate, RunTerm
from ident.estimation.layer import EffectCard
from ident.estimation.tyre_fit import BANK, MISALIGNED, SENSOR_BIAS, STEERING_OFFSET
from ident.estimation.vehicle_inputs import InputBlock, LateAngle, LinkagePlay

Array = NDArray[np.float64]

LONGEST_DELAY = 0.2  # [s]
LEAD = 0.2  # [s] by which windows begin before their samples
PLAY = Parameter("width", "rad", 5e-5, 0.06, 3e-3, "whole play between the angle sensor and the road wheels")
DELAY = Parameter("delay", "s", 0.0, LONGEST_DELAY, 0.03, "by which the sensor reads late")
EITHER_SIGN = {
    *("steering_offset", "sensor_bias", "road_bank", "antenna_offset"),
    *("steering_ratio_nonlinearity", "wheel_speed_scale"),
}
TOLD_AS = {
    ("steering_offset", "steering_offset"): "angle",
    ("road_bank", "bank_cos"): "bank_cos",
    ("road_bank", "bank_sin"): "bank_sin",
}
LATE = {
    "yaw_rate": ("yaw_rate",),
    "lateral_acceleration": ("lateral_acceleration",),
    "lateral_velocity": ("lateral_velocity",),
    "heading": ("heading",),
    "inertial_unit": ("yaw_rate", "lateral_acceleration"),
}
"""Sensor -> the signals that are late with it."""


@dataclass(frozen=True)
class MotionEffect:
    """One effect as the motion layer fits it.

    key : name, and the signal that it acts on
    parts : of the compiled model; coordinates : that it adds; run_terms : of each run
    blocks : before the model; late : signal -> coordinate that holds its delay
    sizes : coordinate (or "bias") -> parameter of the catalogue, the size first
    needs : signals without which it cannot be tested
    bends : whether the curves of the tyres can stand in for much of it, so that a fit from its whole size
        at first order may go astray
    """

    key: str
    name: str
    of: str | None
    sizes: Mapping[str, Parameter]
    parts: tuple[Effect, ...] = ()
    coordinates: tuple[Coordinate, ...] = ()
    run_terms: tuple[RunTerm, ...] = ()
    blocks: tuple[InputBlock, ...] = ()
    late: Mapping[str, str] | None = None
    needs: tuple[str, ...] = ()
    bends: bool = False

    @property
    def freedom(self) -> int:
        """Parameters that it adds, a term of the runs counted once."""
        return len(self.coordinates) + len(self.run_terms)


def _plain(name: str, parameter: Parameter, prior: float = np.inf) -> Coordinate:
    return Coordinate(name, logarithmic=False, low=parameter.low, high=parameter.high, prior_std=prior)


def _logarithmic(name: str, parameter: Parameter) -> Coordinate:
    return Coordinate(name, True, float(np.log(parameter.low)), float(np.log(parameter.high)))


def _of_model(effect: Effect, positive: Sequence[str] = ()) -> MotionEffect:
    """An effect of the compiled model."""
    coordinates = tuple(
        _logarithmic(one.name, one) if one.name in positive else _plain(one.name, one)
        for one in effect.parameters
    )
    sizes = {one.name: one for one in effect.parameters}
    return MotionEffect(
        effect.name, effect.name, None, sizes, (effect,), coordinates, needs=tuple(effect.needs)
    )


def _late(sensor: str, signals: tuple[str, ...]) -> MotionEffect:
    name = f"delay.{sensor}"
    return MotionEffect(
        f"sensor_latency {sensor}",
        "sensor_latency",
        sensor,
        {name: DELAY},
        coordinates=(_plain(name, DELAY),),
        late=dict.fromkeys(signals, name),
        needs=signals,
    )


def _bias(signal: str) -> MotionEffect:
    parameter = sensor_bias(signal).parameters[0]
    return MotionEffect(
        f"sensor_bias {signal}",
        "sensor_bias",
        signal,
        {signal: parameter},
        run_terms=(RunTerm(signal, SENSOR_BIAS[signal]),),
        needs=(signal,),
    )


def _always() -> list[MotionEffect]:
    """Effects whose parameters the base model holds at zero."""
    offset = MotionEffect(
        "steering_offset",
        "steering_offset",
        None,
        {OFFSET.name: OFFSET},
        coordinates=(_plain(OFFSET.name, OFFSET, STEERING_OFFSET),),
    )
    bank = MotionEffect(
        "road_bank",
        "road_bank",
        None,
        {one.name: one for one in (BANK_COS, BANK_SIN)},
        coordinates=tuple(_plain(one.name, one, BANK[one.name]) for one in (BANK_COS, BANK_SIN)),
        needs=("heading",),
    )
    return [offset, bank]


def _around() -> list[MotionEffect]:
    """Effects that stand before or behind the model."""
    play, angle = LinkagePlay(), LateAngle()
    turned = Parameter("heading", "rad", -0.2, 0.2, 0.02, "by which the velocity sensor is turned")
    return [
        MotionEffect(
            "steering_linkage_play",
            "steering_linkage_play",
            None,
            {play.name: PLAY},
            coordinates=(_logarithmic(play.name, PLAY),),
            blocks=(play,),
        ),
        MotionEffect(
            "sensor_latency steering_angle",
            "sensor_latency",
            "steering_angle",
            {angle.name: DELAY},
            coordinates=(_plain(angle.name, DELAY),),
            blocks=(angle,),
        ),
        MotionEffect(
            "antenna_offset lateral_velocity",
            "antenna_offset",
            "lateral_velocity",
            {MISALIGNED.name: turned},
            run_terms=(MISALIGNED,),
            needs=("lateral_velocity",),
        ),
    ]


def motion_effects() -> dict[str, MotionEffect]:
    """All effects of the motion that are built, by key."""
    made = [
        *_always(),
        *_around(),
        *(_bias(signal) for signal in ("yaw_rate", "lateral_acceleration", "lateral_velocity")),
        *(_late(sensor, signals) for sensor, signals in LATE.items()),
        _of_model(TYRE_RELAXATION, positive=(LENGTH.name,)),
        replace(_of_model(LOAD_TRANSFER), bends=True),
        _of_model(BODY_ROLL, positive=tuple(one.name for one in BODY_ROLL.parameters[1:])),
        _of_model(STEERING_RATIO_NONLINEARITY),
        _of_model(WHEEL_SPEED_SCALE),
    ]
    return {one.key: one for one in made}


def testable(one: MotionEffect, signals: Sequence[str]) -> str | None:
    """Why an effect cannot be tested with these signals, None where it can."""
    missing = [name for name in one.needs if name not in signals]
    return f"needs {', '.join(missing)}, which no run holds" if missing else None


def told_as(effect: MotionEffect, name: str) -> str:
    """Name of a parameter of an effect in the JSON."""
    if effect.name == "sensor_bias":
        return "bias"
    return TOLD_AS.get((effect.name, name), name.rpartition(".")[2])


def card_of(effect: MotionEffect) -> EffectCard:
    """What is said of an effect to a reader."""
    entry, size = CATALOGUE[effect.name], next(iter(effect.sizes.values()))
    return EffectCard(
        name=effect.name,
        enters=entry.enters,
        of=effect.of,
        size=told_as(effect, size.name),
        unit=size.unit,
        typical=abs(size.typical),
        equation=entry.equation,
        meaning=entry.meaning,
        shown_by=entry.shown_by,
        positive=effect.name not in EITHER_SIGN,
        meanings={told_as(effect, one.name): one.meaning for one in effect.sizes.values()},
    )
