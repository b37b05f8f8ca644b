"""What is put on the bench: the truck as believed, the trucks that are simulated, starts and paths."""

from __future__ import annotations

import time
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from ident.control.closed_loop import Disturbance
from ident.control.disturbances import monte_carlo, one_at_a_time
from ident.control.draws import draw
from ident.control.plant import Plant
from ident.control.reference import Reference
from ident.control.scenarios import scenario
from ident.control.sensors import Sensors, noise_of
from ident.control.simulated import engine_of
from ident.control.speed_profile import SpeedLimits
from ident.control.truck import Truck
from ident.dynamics.engine import Engine
from ident.errors import BadRecipe, NotIdentifiable
from ident.model_file import Model, read_model
from ident.results import Refusal, TyresResult
from ident.stages.output import Context
from ident.stages.validate_bench import IDENTIFIED, Bench, Path
from ident.stages.validate_plan import IMPROVED, drawn_name
from ident.stages.validate_settings import ValidateSettings
from ident.stages.validate_truck import OFFSET, Believed, believed, other_models, sensor_noise

DRAWN = 8  # trucks from the error bars
REPEATS = 5  # of a timing; the fastest counts


@dataclass(frozen=True)
class Subject:
    """What is validated.

    model : as controllers are designed with it; truck : made of it
    improved : the truck with the effects that were found, None where there are none
    effects : their names
    """

    model: Model
    truck: Believed
    improved: Truck | None
    effects: list[str]
    refused: list[Refusal]


def subject_of(path: FilePath | None, context: Context) -> Subject:
    """Take the model of a file, or that of the stages before.

    Raises
    ------
    NotIdentifiable
        If a part is missing without which no truck can be simulated.
    """
    if path is not None:
        model = read_model(path)
        return _subject(model, model, str(path))
    model = context.models["tyres"]
    return _subject(model, context.models.get("improve", model), "model.yaml")


def _subject(model: Model, better: Model, source: str) -> Subject:
    """Both models may be one: that of a file, whose effects the controllers do not know of.

    The noise is that of the better one: what its residuals hold is less an error of the model.
    """
    model = replace(model, noise=better.noise)
    truck = believed(model, source)
    improved = believed(better, source, found="improve" in better.provenance)
    refused = []
    keys = list(improved.effects)
    for key in keys:
        try:
            Plant(replace(improved.truck, effects={key: improved.effects[key]}))
        except BadRecipe as error:
            refused.append(Refusal(f"effect {key}", str(error)))
            improved = improved.without(key)
    return Subject(model, truck, improved.improved if improved.found else None, improved.found, refused)


@dataclass(frozen=True)
class Setup:
    """What is driven, and on what.

    settings : without the scenarios that the truck cannot drive
    starts : the same for all; drawn : how many trucks from the error bars
    others : models that predict and simulate each other
    """

    settings: ValidateSettings
    subject: Subject
    bench: Bench
    starts: list[Disturbance]
    drawn: int
    others: list[str]
    refused: list[Refusal]
    warnings: list[str]

    @property
    def drawn_trucks(self) -> list[Truck]:
        """The trucks from the error bars."""
        return [self.bench.simulated[drawn_name(number)] for number in range(self.drawn)]


def set_up(subject: Subject, settings: ValidateSettings, tyres: TyresResult | None, seed: int) -> Setup:
    """Make trucks, starts and paths.

    Raises
    ------
    NotIdentifiable
        If no scenario can be driven at any of the speeds.
    """
    truck = subject.truck
    believed_as = other_models(truck.truck, tyres.fits if tyres is not None else ())
    simulated = {name: _disturbed(one, truck.offset) for name, one in believed_as.items()}
    simulated[IDENTIFIED] = _disturbed(truck.truck, truck.offset)
    warnings: list[str] = []
    drawn = _drawn(simulated[IDENTIFIED], subject.model, settings.starts, seed, warnings)
    simulated |= {drawn_name(number): one for number, one in enumerate(drawn)}
    if subject.improved is not None:
        simulated[IMPROVED] = _disturbed(subject.improved, truck.offset)
    references, refused = _references(settings, believed_as, truck.name)
    kept = [name for name in settings.scenarios if any(path.scenario == name for path in references)]
    if not kept:
        raise NotIdentifiable(f"no scenario can be driven: {refused[0].reason}")
    named = {name: one.model for name, one in simulated.items()}
    named[IMPROVED] = "+".join([truck.name, *subject.effects])
    bench = Bench(
        period=settings.period,
        lane_half_width=settings.lane_half_width,
        prediction=truck.name,
        believed=believed_as,
        simulated=simulated,
        named=named,
        references=references,
        sensors=Sensors(noise_of({name: sensor_noise(one) for name, one in subject.model.noise.items()})),
        noise=truck.noise,
        seed=seed,
    )
    driveable = {path.prediction for path in references if path.scenario == kept[0]}
    return Setup(
        settings=settings.model_copy(update={"scenarios": kept}),
        subject=subject,
        bench=bench,
        starts=one_at_a_time() if settings.disturbances == "grid" else monte_carlo(settings.starts, seed),
        drawn=len(drawn),
        others=[name for name in believed_as if name in driveable] if settings.pairs else [],
        refused=[*subject.refused, *refused],
        warnings=[*truck.notes, *warnings],
    )


def _drawn(truck: Truck, model: Model, count: int, seed: int, warnings: list[str]) -> tuple[Truck, ...]:
    try:
        return draw(truck, model, min(count, DRAWN), seed).trucks
    except (NotIdentifiable, BadRecipe) as error:
        warnings.append(f"no truck is drawn from the error bars: {error}")
        return ()


def _disturbed(truck: Truck, offset: float) -> Truck:
    """A truck whose steering does not point where its controller believes: the offset that was identified."""
    own = deepcopy(truck)
    return replace(own, effects={**own.effects, OFFSET: {"angle": offset}}) if offset else own


def _references(
    settings: ValidateSettings, trucks: Mapping[str, Truck], own: str
) -> tuple[dict[Path, Reference], list[Refusal]]:
    """Paths of all scenarios for the model of the controllers; the first one also for the other models."""
    made: dict[Path, Reference] = {}
    refused: dict[str, Refusal] = {}
    for number, name in enumerate(settings.scenarios):
        for speed in settings.speeds:
            first = number == 0 and speed == settings.speeds[0] and bool(settings.pairs)
            for prediction in trucks if first else (own,):
                limits = SpeedLimits(speed, settings.lateral_acceleration)
                try:
                    made[Path(name, speed, prediction)] = scenario(name, trucks[prediction], limits)
                except BadRecipe as error:
                    what = f"{name} at {3.6 * speed:.0f} km/h, {prediction}"
                    refused[what] = Refusal(what, str(error))
    return made, list(refused.values())


def costs_of(bench: Bench) -> dict[str, float]:
    """Processor time of one integration step of each prediction model [ns]."""
    made = {}
    for name, truck in bench.believed.items():
        engine = engine_of(truck.model, ())
        count = 2000
        inputs = np.zeros((count, len(engine.inputs)))
        inputs[:, engine.inputs.index("longitudinal_velocity")] = 20.0
        inputs[:, engine.inputs.index("road_wheel_angle")] = 0.01
        values = {**dict.fromkeys(engine.parameters, 0.0), **truck.parameters}
        vector = engine.vector({key: values[key] for key in engine.parameters})
        arguments = np.zeros((1, len(engine.states))), inputs, np.full(count, 0.005), [0, count], vector
        made[name] = 1e9 * min(_timed(engine, arguments) for _ in range(REPEATS)) / count
    return made


def _timed(engine: Engine, arguments: tuple[Any, ...]) -> float:
    begin = time.thread_time()
    engine.simulate(*arguments)
    return time.thread_time() - begin
