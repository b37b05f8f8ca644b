"""Every file that decides on what a stage reads, found without opening a log.

Beside the files of each run these are its channel map, its vehicle file and the tyre file that this names,
the IDL files beside it, and what SQLite keeps beside a database.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ident.logs import RunPath, find_runs
from ident.signals.applied import CHANNELS, VEHICLE, nearest_file
from ident.stages.inputs import InputSettings, named_runs
from ident.vehicle import read_vehicle

BESIDE = ("-wal", "-shm", "-journal")


@dataclass(frozen=True)
class InputFile:
    """One file: the run that needs it, and what it is called there, the same wherever the logs lie."""

    run: str
    name: str
    path: Path


def input_files(logs: Sequence[Path], settings: InputSettings) -> list[InputFile]:
    """List the files of all runs under the paths that are to be read, in the order of the runs.

    Raises
    ------
    UnusableLog
        If there is no log.
    BadRecipe
        If a vehicle file is wrong, or ``runs`` names no run.
    """
    made = []
    for run in named_runs(find_runs(logs), settings.runs):
        made += [InputFile(run.name, _relative(path, run), path) for path in _logs_of(run)]
        made += [InputFile(run.name, name, path) for name, path in _applied(run, settings)]
    return made


def _logs_of(run: RunPath) -> Iterator[Path]:
    if run.path.is_dir():
        yield from sorted(path for path in run.path.rglob("*") if path.is_file())
        return
    files = run.files or (run.path,)
    yield from files
    yield from (beside for file in files for end in BESIDE if (beside := Path(f"{file}{end}")).is_file())
    yield from sorted(run.path.parent.glob("*.idl"))


def _applied(run: RunPath, settings: InputSettings) -> Iterator[tuple[str, Path]]:
    """Yield how each file that applies to a run is called, and the file."""
    if settings.channels == "auto":
        maps = [path] if (path := nearest_file(run, CHANNELS)) else []
    else:
        maps = settings.channels if isinstance(settings.channels, list) else [Path(settings.channels)]
    yield from ((f"channels {number}: {_relative(path, run)}", path) for number, path in enumerate(maps))
    vehicle = settings.vehicle or nearest_file(run, VEHICLE)
    if vehicle is not None:
        yield f"vehicle: {_relative(vehicle, run)}", vehicle
        tyres = read_vehicle(vehicle).tyres
        if tyres is not None:
            for axle, own in (("front", tyres.front), ("rear", tyres.rear)):
                yield f"{axle} tyres: {own.file.name}", own.file


def _relative(path: Path, run: RunPath) -> str:
    """Path from the one that the user gave, or the name of a file that lies elsewhere."""
    root = run.root.parent if run.root == run.path else run.root
    try:
        return str(path.absolute().relative_to(root.absolute()))
    except ValueError:
        return path.name
