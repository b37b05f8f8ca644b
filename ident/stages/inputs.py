"""What every stage needs first: the runs under LOGS, and where they came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

import ident
from ident.errors import BadRecipe
from ident.glossary import SIGNALS
from ident.logs import RunPath
from ident.results import Provenance, SplitBy
from ident.signals.run import LoadedLogs, Run, load_runs
from ident.stages.output import Context
from ident.units import parse_quantity
from ident.yaml_file import nearest

MOST_NAMES = 8


def quantity(unit: str, *, positive: bool = False) -> BeforeValidator:
    """Return a pydantic validator that reads a quantity such as "0.2 s" into ``unit``."""

    def read(value: Any) -> float:
        try:
            number = parse_quantity(value, unit=unit, quantity="value")
        except BadRecipe as error:
            raise ValueError(str(error).removeprefix("value: ")) from error
        if positive and number <= 0:
            raise ValueError(f"{value!r} is not positive")
        return number

    return BeforeValidator(read)


Seconds = Annotated[float, quantity("s")]


def _known_signals(latency: Mapping[str, float]) -> Mapping[str, float]:
    for name in latency:
        if name not in SIGNALS:
            raise ValueError(f"unknown signal {name!r}: {nearest(name, SIGNALS)}")
    return latency


def named(run: str, globs: Sequence[str]) -> bool:
    """Whether one of the globs matches the name of a run, or the last part of it."""
    return any(fnmatchcase(run, glob) or fnmatchcase(run.rpartition("/")[2], glob) for glob in globs)


def named_runs(found: list[RunPath], globs: Sequence[str] | None) -> list[RunPath]:
    """Return the runs that are to be read: those that a glob names, all where there is none.

    Raises
    ------
    BadRecipe
        If none is named.
    """
    chosen = [run for run in found if globs is None or named(run.name, globs)]
    if not chosen:
        names = ", ".join(run.name for run in found[:MOST_NAMES])
        more = f" and {len(found) - MOST_NAMES} more" if len(found) > MOST_NAMES else ""
        raise BadRecipe(f"runs: {', '.join(globs or [])} names no run: the runs are {names}{more}")
    return chosen


class AlignSettings(BaseModel):
    """How signals are brought to one time base.

    rate : of the common time base [1/s]
    max_gap : a gap longer than this stays a gap and divides a run [s]
    latency : signal -> how late it is [s]; only what is said here is corrected
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    rate: Annotated[float, quantity("Hz", positive=True)] = 100.0
    max_gap: Annotated[float, quantity("s", positive=True)] = 0.2
    latency: Annotated[dict[str, Seconds], AfterValidator(_known_signals)] = Field(default_factory=dict)


class SplitSettings(BaseModel):
    """Which data are held out of the fit for the evaluation.

    held_out : globs of runs; None: nothing was said, and a split is drawn where something is evaluated
    blocks : run -> [from, to], the part of a run that is held out [s]
    share : of the runs that is drawn to be held out
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    held_out: Annotated[list[str], Field(min_length=1)] | None = None
    blocks: dict[str, tuple[Seconds, Seconds]] | None = None
    share: Annotated[float, Field(gt=0, lt=1)] = 0.3

    @property
    def is_stated(self) -> bool:
        """Whether it says what is held out, so that nothing is to be drawn."""
        return self.held_out is not None or self.blocks is not None

    @property
    def by(self) -> SplitBy:
        """What is held out: runs, blocks of runs, or nothing."""
        if self.held_out:
            return "run"
        return "block" if self.blocks else "none"

    @classmethod
    def from_stored(cls, data: Mapping[str, Any]) -> SplitSettings:
        """Read what ``model_dump`` has written: times in seconds, without their unit."""
        blocks = {run: (begin, end) for run, (begin, end) in (data["blocks"] or {}).items()} or None
        return cls.model_construct(held_out=data["held_out"], blocks=blocks, share=data["share"])

    def holds_out(self, run: str) -> bool:
        """Whether a run is held out whole."""
        return self.held_out is not None and named(run, self.held_out)

    def block_of(self, run: str) -> tuple[float, float] | None:
        """Return the part of a run that is held out [s], None where there is none."""
        return (self.blocks or {}).get(run)


class InputSettings(BaseModel):
    """Which files apply to the logs, and how the logs are read.

    channels : "auto" (the nearest channels.yaml, else the built-in maps), a file, or several of which the
        best fitting is used for each run
    vehicle : vehicle file; None: the nearest vehicle.yaml
    runs : globs of the runs that are read, no other file of the logs is opened; None: all
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    channels: Literal["auto"] | Path | list[Path] = "auto"
    vehicle: Path | None = None
    runs: Annotated[list[str], Field(min_length=1)] | None = None
    align: AlignSettings = Field(default_factory=AlignSettings)
    split: SplitSettings = Field(default_factory=SplitSettings)
    seed: int = 0


def load(
    logs: Sequence[Path], settings: InputSettings, context: Context, *, every_topic: bool = False
) -> LoadedLogs:
    """Read the runs, with the latencies that the settings state taken out; once in a run of several stages.

    Parameters
    ----------
    every_topic : look at the topics that no signal needs, too

    Raises
    ------
    UnusableLog
        If there is no log, or none of them can be read.
    BadRecipe
        If a channel map or vehicle file is wrong, or ``runs`` names no run.
    """
    key = f"{list(logs)} {settings.channels} {settings.vehicle} {settings.runs} {settings.align}"
    known: LoadedLogs | None = context.loaded.get(key)
    if known is not None and not every_topic:
        return known
    loaded = load_runs(
        logs,
        channels=_files(settings.channels),
        vehicle=settings.vehicle,
        every_topic=every_topic,
        choose=lambda found: named_runs(found, settings.runs),
        progress=context.progress,
    )
    runs = [_without_latency(run, settings.align.latency) for run in loaded.runs]
    found = replace(loaded, runs=runs, warnings=[*_only(settings.runs), *loaded.warnings])
    if not every_topic:
        context.loaded[key] = found
    return found


def _only(globs: Sequence[str] | None) -> list[str]:
    return [] if globs is None else [f"only the runs that the recipe names were read: {', '.join(globs)}"]


def _files(channels: str | Path | list[Path]) -> list[Path] | None:
    if isinstance(channels, list):
        return channels
    return None if channels == "auto" else [Path(channels)]


def _without_latency(run: Run, latency: Mapping[str, float]) -> Run:
    """Move the signals that are said to be late to when they were true."""
    late = {name: delay for name, delay in latency.items() if name in run.signals and delay != 0}
    moved = {name: replace(run.signals[name], time=run.signals[name].time - late[name]) for name in late}
    notes = [f"{name}: moved {delay:g} s earlier, as align.latency says" for name, delay in late.items()]
    health = replace(run.health, clocks=[*run.health.clocks, *notes])
    return replace(run, signals={**run.signals, **moved}, health=health)


def provenance(context: Context, loaded: LoadedLogs) -> Provenance:
    """Say what a result was made from."""
    return Provenance(
        version=ident.__version__,
        command=context.command,
        seed=context.seed,
        date=context.date,
        files=loaded.files,
        applied={
            run.name: f"channels: {run.health.channels}; vehicle: {run.health.vehicle}" for run in loaded.runs
        },
    )
