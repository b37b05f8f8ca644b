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
from ident.control.controllers.mpc_controller import Mpc
from ident.control.controllers.mpc_robust import mpc_robust
from ident.control.disturbances import changed
from ident.control.measures import Label, Limits, told
from ident.control.plant import Plant
from ident.control.prediction import KINEMATIC
from ident.control.reference import Reference
from ident.control.sensors import Sensors
from ident.control.truck import Truck
from ident.errors import BadRecipe, NotIdentifiable
from ident.glossary import controller_name
from ident.results import ClosedLoopRun, ControllerName, LoggedLevel, ScenarioName
from ident.stages.output import Progress
from ident.stages.validate_shadow import Shadow, closed, closed_level, shadow
from ident.stages.validate_stretch import LoggedStretch

IDENTIFIED = "identified"  # simulated truck
ROBUST = "mpc_robust"
OWN_MODEL: dict[ControllerName, str] = {"mpc_time_kinematic": KINEMATIC}
"""Controllers that predict with a model of their own, whatever the reference was made for."""
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
class Beside:
    """A controller beside the one of a log: its shadow, and where that agrees, the closed loop."""

    controller: ControllerName
    stretch: LoggedStretch
    acceptable: float
    noise: float


@dataclass(frozen=True)
class Compared:
    """What came of it; ``course`` only where the closed loop was looked at."""

    beside: Beside
    shadow: Shadow
    levels: tuple[LoggedLevel, ...]
    course: ClosedLoop | None = None


@dataclass(frozen=True)
class Driven:
    """What came of it; ``course`` only where it was asked for.

    note : what is to be said of the set of the robust controller
    """

    drive: Drive
    run: ClosedLoopRun
    course: ClosedLoop | None = None
    note: str | None = None


@dataclass(frozen=True)
class NotDriven:
    """Why something could not be driven."""

    drive: Drive | Beside
    reason: str


Outcome = Driven | Compared | NotDriven


@dataclass(frozen=True)
class Bench:
    """What all drives share.

    prediction : model that controllers are designed with where nothing else is said
    believed : prediction model -> truck that they are designed with
    simulated : name -> truck, whose model ``ClosedLoopRun.simulation_model`` tells
    named : name of a simulated truck -> what its model is called
    references : path -> reference
    sensors : of the simulated trucks; noise : signal of a log -> size of its residual, for the tube
    """

    period: float
    lane_half_width: float
    prediction: str
    believed: Mapping[str, Truck]
    simulated: Mapping[str, Truck]
    named: Mapping[str, str]
    references: Mapping[Path, Reference]
    sensors: Sensors
    noise: Mapping[str, float]
    seed: int


class Driver:
    """Drives one after another in this process, with each controller made once."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self._controllers: dict[tuple[str, str], Controller] = {}
        self._no_room: str | None = None

    def drive(self, asked: Drive | Beside) -> Outcome:
        """Drive once; what cannot be driven is told, not raised."""
        try:
            try:
                return self._done(asked)
            except NotIdentifiable as error:
                if asked.controller != ROBUST or self._no_room is not None:
                    raise
                self._no_room = str(error)
                self._controllers.clear()
                return self._done(asked)
        except (BadRecipe, NotIdentifiable) as error:
            return NotDriven(asked, str(error))

    def _done(self, asked: Drive | Beside) -> Outcome:
        return self._driven(asked) if isinstance(asked, Drive) else self._compared(asked)

    def _driven(self, asked: Drive) -> Driven:
        bench = self.bench
        truck = bench.simulated[asked.simulation]
        plant = Plant(changed(truck, asked.mismatch) if asked.mismatch else truck, bench.sensors)
        settings = Settings(lateral_limit=bench.lane_half_width, seed=asked.seed)
        reference = bench.references[asked.path]
        controller = self._controller(asked.controller, asked.path.prediction)
        course = run(plant, controller, reference, asked.start, settings)
        label = Label(
            asked.path.scenario,
            asked.path.speed,
            OWN_MODEL.get(asked.controller, asked.path.prediction),
            bench.named[asked.simulation],
            asked.mismatch,
            asked.path.run,
            asked.seed,
        )
        made = told(course, label, Limits(bench.lane_half_width))
        return Driven(asked, made, course if asked.kept else None, self._note(controller, asked.path.speed))

    def _note(self, controller: Controller, speed: float) -> str | None:
        """What is to be said of the set of the robust controller."""
        if controller.name != ROBUST or not isinstance(controller, Mpc):
            return None
        name, crowded = controller_name(ROBUST), controller.crowded(speed)
        if self._no_room is not None:
            return f"{name} has a set of usual size, not that of the residuals: {self._no_room}"
        return crowded and f"{name}: {crowded}"

    def _compared(self, asked: Beside) -> Compared:
        controller = self._controller(asked.controller, self.bench.prediction)
        looked_on = shadow(asked.controller, controller, asked.stretch)
        level = looked_on.level()
        if not level.agrees:
            return Compared(asked, looked_on, (level,))
        plant = Plant(self.bench.simulated[IDENTIFIED], self.bench.sensors)
        course = closed(controller, plant, asked.stretch, self.bench.seed)
        further = closed_level(asked.controller, course, asked.stretch, asked.acceptable, asked.noise)
        return Compared(asked, looked_on, (level, further), course)

    def _controller(self, name: ControllerName, prediction: str) -> Controller:
        key = name, prediction
        if key not in self._controllers:
            self._controllers[key] = self._made(name, self.bench.believed[prediction])
        return self._controllers[key]

    def _made(self, name: ControllerName, truck: Truck) -> Controller:
        """A controller; the set of the robust one comes from the residuals, where they leave room."""
        period = self.bench.period
        if name == ROBUST and self._no_room is None:
            return mpc_robust(truck, period, noise=self.bench.noise)
        return CONTROLLERS[name](truck, period)


_driver: list[Driver] = []


def drive_all(bench: Bench, drives: Sequence[Drive | Beside], jobs: int, progress: Progress) -> list[Outcome]:
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


def _drive(asked: Drive | Beside) -> Outcome:
    return _driver[0].drive(asked)
