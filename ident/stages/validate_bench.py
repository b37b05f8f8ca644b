"""Closed loops side by side: what is driven is told in plain data, so that other processes can drive it.

Every controller drives from the same starts, against the same noise. What a run draws depends on its own seed
alone, so the order of the processes changes nothing but the solve times.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context

from ident.control.closed_loop import ClosedLoop, Disturbance, Settings, run
from ident.control.controllers import CONTROLLERS
from ident.control.controllers.controller import Controller
from ident.control.disturbances import changed
from ident.control.measures import Label, Limits, told
from ident.control.plant import Plant
from ident.control.reference import Reference
from ident.control.sensors import Sensors
from ident.control.truck import Truck
from ident.errors import BadRecipe
from ident.results import ClosedLoopRun, ControllerName, ScenarioName
from ident.stages.output import Progress

TOGETHER = 4  # drives that a process takes at a time


@dataclass(frozen=True)
class Path:
    """A scenario at a speed, as a controller with this prediction model has it."""

    scenario: ScenarioName
    speed: float
    prediction: str
    run: str | None = None


@dataclass(frozen=True)
class Drive:
    """One closed loop that is asked for.

    path : key of ``Bench.references``; simulation : key of ``Bench.simulated``
    start : where it begins beside the reference
    mismatch : what the simulated truck has beside what its model says
    told : as ``ClosedLoopRun.disturbance`` tells it
    kept : whether the course of the run is wanted
    """

    controller: ControllerName
    path: Path
    simulation: str
    start: Disturbance = field(default_factory=Disturbance)
    mismatch: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    kept: bool = False


@dataclass(frozen=True)
class Driven:
    """What came of it; ``course`` only where it was asked for."""

    drive: Drive
    run: ClosedLoopRun
    course: ClosedLoop | None = None


@dataclass(frozen=True)
class NotDriven:
    """Why something could not be driven."""

    drive: Drive
    reason: str


Outcome = Driven | NotDriven


@dataclass(frozen=True)
class Bench:
    """What all drives share.

    believed : prediction model -> truck that controllers are designed with
    simulated : name -> truck, whose model ``ClosedLoopRun.simulation_model`` tells
    named : name of a simulated truck -> what its model is called
    references : path -> reference
    """

    period: float
    lane_half_width: float
    believed: Mapping[str, Truck]
    simulated: Mapping[str, Truck]
    named: Mapping[str, str]
    references: Mapping[Path, Reference]
    sensors: Sensors


class Driver:
    """Drives one after another in this process, with each controller made once."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self._controllers: dict[tuple[str, str], Controller] = {}

    def drive(self, asked: Drive) -> Outcome:
        """Drive once; what cannot be driven is told, not raised."""
        try:
            return self._driven(asked)
        except BadRecipe as error:
            return NotDriven(asked, str(error))

    def _driven(self, asked: Drive) -> Driven:
        bench = self.bench
        truck = bench.simulated[asked.simulation]
        plant = Plant(changed(truck, asked.mismatch) if asked.mismatch else truck, bench.sensors)
        settings = Settings(lateral_limit=bench.lane_half_width, seed=asked.seed)
        reference = bench.references[asked.path]
        course = run(plant, self._controller(asked), reference, asked.start, settings)
        label = Label(
            asked.path.scenario,
            asked.path.speed,
            asked.path.prediction,
            bench.named[asked.simulation],
            asked.mismatch,
            asked.path.run,
            asked.seed,
        )
        made = told(course, label, Limits(bench.lane_half_width))
        return Driven(asked, made, course if asked.kept else None)

    def _controller(self, asked: Drive) -> Controller:
        key = asked.controller, asked.path.prediction
        if key not in self._controllers:
            truck = self.bench.believed[asked.path.prediction]
            self._controllers[key] = CONTROLLERS[asked.controller](truck, self.bench.period)
        return self._controllers[key]


_driver: list[Driver] = []


def drive_all(bench: Bench, drives: Sequence[Drive], jobs: int, progress: Progress) -> list[Outcome]:
    """Drive all, in processes side by side where there is more than one job.

    Returns
    -------
    (n,) in the order of ``drives``
    """
    if jobs == 1 or len(drives) <= TOGETHER:
        own = Driver(bench)
        return _counted((own.drive(one) for one in drives), len(drives), progress)
    pool = ProcessPoolExecutor(
        min(jobs, len(drives)), mp_context=get_context("spawn"), initializer=_begin, initargs=(bench,)
    )
    with pool:
        try:
            return _counted(pool.map(_drive, drives, chunksize=TOGETHER), len(drives), progress)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _counted(driven: Iterator[Outcome], total: int, progress: Progress) -> list[Outcome]:
    made: list[Outcome] = []
    for one in driven:
        made.append(one)
        progress("drive", len(made), total)
    return made


def _begin(bench: Bench) -> None:
    """Make a process ready; an interruption is the parent's to tell."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _driver[:] = [Driver(bench)]


def _drive(asked: Drive) -> Outcome:
    return _driver[0].drive(asked)
