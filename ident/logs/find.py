"""PATHS -> RUNS: what lies under the paths that the user gave.

A run is one rosbag2 folder (with metadata.yaml) or one file; ``name_0``, ``name_1``, ... of one recorder
are one run. Its name is its path relative to the path given, without suffix. CSV and Parquet files are runs
where they are named themselves, and where the path given holds no other log: beside other logs, and in a
folder that ``ident`` wrote, they are side files.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ident.errors import UnusableLog
from ident.logs.bag import in_sequence, stem_and_number, storage_files
from ident.logs.mdf import SUFFIXES as MDF_SUFFIXES

SUFFIXES = (
    *(".mcap", ".db3", ".mcap.zstd", ".db3.zstd", ".bag", ".bag.active", ".db", ".dat"),
    *MDF_SUFFIXES,
)
TABLES = (".csv", ".parquet")
METADATA = "metadata.yaml"
REPORT = "index.html"
KEPT = ".ident"
"""Folder in which ``ident`` keeps what it knows of the outputs beside it."""


@dataclass(frozen=True)
class RunPath:
    """Where a run lies.

    path : the rosbag2 folder, or the (first) file
    root : the path that the user gave
    files : of a run of consecutive files, all of them; else empty
    """

    name: str
    path: Path
    root: Path
    files: tuple[Path, ...] = ()


def find_runs(logs: Sequence[Path]) -> list[RunPath]:
    """Find the runs under the given files and folders, sorted by name, each once.

    Raises
    ------
    UnusableLog
        If a path does not exist, or if there is no log at all.
    """
    found: dict[Path, RunPath] = {}
    for root in logs:
        if not root.exists():
            raise UnusableLog(f"{root}: no such file or folder")
        runs_here = list(_runs_under(root))
        for run in [run for run in runs_here if not _is_side_file(run, runs_here)]:
            found.setdefault(run.path.resolve(), run)
    typed = [run for run in found.values() if run.root == run.path and run.path.is_file()]
    runs = [run for run in found.values() if run not in typed] + list(_grouped(typed))
    if not runs:
        where = ", ".join(map(str, logs)) or "nothing"
        raise UnusableLog(
            f"no log found in {where} (looked for {', '.join((*SUFFIXES, *TABLES))}, rosbag2 folders)"
        )
    return sorted(_told_apart(runs), key=lambda run: _natural(run.name))


def is_rosbag2(folder: Path) -> bool:
    """Whether a folder is one log: it holds metadata.yaml and that is rosbag2's, or files beside it."""
    metadata = folder / METADATA
    if not metadata.is_file():
        return False
    try:
        with metadata.open("rb") as file:
            return b"rosbag2_bagfile_information" in file.read(4096) or bool(storage_files(folder))
    except OSError:
        return bool(storage_files(folder))


def _runs_under(root: Path) -> Iterator[RunPath]:
    if root.is_file() or is_rosbag2(root):
        yield RunPath(_without_suffix(Path(root.resolve().name)), root, root)
        return
    seen: set[Path] = set()
    closed: list[Path] = []
    for place, folders, files in os.walk(
        root, onerror=lambda e: closed.append(Path(e.filename)), followlinks=True
    ):
        folder = Path(place)
        if folder.resolve() in seen:
            folders.clear()
            continue
        seen.add(folder.resolve())
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        if is_rosbag2(folder):
            folders.clear()
            yield RunPath(str(folder.relative_to(root)), folder, root)
            continue
        ends = (*SUFFIXES, *(() if _is_written_by_ident(folder) else TABLES))
        logs = [folder / name for name in files if name.endswith(ends) and not name.startswith(".")]
        runs = [RunPath(_without_suffix(path.relative_to(root)), path, root) for path in logs]
        yield from _grouped(runs)
    # A folder that may not be looked into is a run that cannot be opened: so it is told of.
    yield from (RunPath(str(folder.relative_to(root)), folder, root) for folder in closed)


def _is_written_by_ident(folder: Path) -> bool:
    """Whether a folder holds the signals of a report, or of one that was not finished."""
    above = folder.parent
    return folder.name == "signals" and ((above / REPORT).is_file() or (above / KEPT).is_dir())


def _is_side_file(run: RunPath, runs: Sequence[RunPath]) -> bool:
    """Whether a run is a table that was found beside other logs."""
    found = run.path.name.endswith(TABLES) and run.path != run.root
    return found and any(not other.path.name.endswith(TABLES) for other in runs)


def _grouped(runs: Sequence[RunPath]) -> Iterator[RunPath]:
    """Join name_0, name_1, ... of one folder and one format; MDF files each state a start of their own."""
    groups: dict[tuple[Path, str, str], list[RunPath]] = {}
    for run in sorted(runs, key=lambda run: in_sequence(run.path)):
        stem, number = stem_and_number(run.path)
        key = (run.path.parent, stem if number is not None else run.path.name, _suffix(run.path))
        groups.setdefault(key, []).append(run)
    for group in groups.values():
        first = group[0]
        if len(group) == 1 or stem_and_number(first.path)[1] != 0 or _suffix(first.path) in MDF_SUFFIXES:
            yield from group
            continue
        name = first.name.removesuffix("_" + first.name.rpartition("_")[2])
        yield RunPath(name, first.path, first.root, tuple(run.path for run in group))


def _suffix(path: Path) -> str:
    return next((suffix for suffix in SUFFIXES if path.name.endswith(suffix)), path.suffix)


def _without_suffix(path: Path) -> str:
    suffix = next(
        (s for s in sorted((*SUFFIXES, *TABLES), key=len, reverse=True) if path.name.endswith(s)), ""
    )
    return str(path).removesuffix(suffix)


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d{1,18})", name)]


def _told_apart(runs: list[RunPath]) -> list[RunPath]:
    """Make all names different: with the suffix, then with as much of the path as it takes."""
    names = [run.name for run in runs]
    for depth in range(32):
        twice = {name for name in names if names.count(name) > 1}
        if not twice:
            break
        longer = [_longer(run, depth) for run in runs]
        names = [new if old in twice else old for old, new in zip(names, longer, strict=True)]
    return [replace(run, name=name) for run, name in zip(runs, names, strict=True)]


def _longer(run: RunPath, depth: int) -> str:
    """Name of a run with its suffix and ``depth`` folders above the path that was given."""
    name = run.name + (_suffix(run.path) if run.path.is_file() else "")
    root = run.root.resolve()
    above = (root if root.is_dir() and run.path != run.root else root.parent).parts[1:]
    return "/".join((*above[max(len(above) - depth, 0) :], name))
