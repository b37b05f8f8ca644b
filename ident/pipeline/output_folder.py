"""Where the outputs of a run go, checked before any work: beside no log, in place of no other file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ident.errors import UsageError
from ident.pipeline.lock import KEPT
from ident.pipeline.store import RESULTS

_LOG_SUFFIXES = {".mcap", ".db3", ".bag", ".zstd"}
_OUTPUTS = ("index.html", "model.yaml", "run.rrd")


def output_folder(out: Path | None, logs: Sequence[Path]) -> Path:
    """Choose the folder of the outputs and check it, before any work.

    Raises
    ------
    UsageError
        If outputs would come to lie beside the logs or in place of files that are not ours.
    """
    folder = out if out is not None else Path("reports") / name_of(logs)
    _refuse_folder_of_logs(folder, logs)
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"--out {folder} is a file: name a folder")
    foreign = [name for name in _OUTPUTS if (folder / name).exists()]
    ours = (folder / KEPT).is_dir() or any((folder / f"{stage}.json").is_file() for stage in RESULTS)
    if foreign and not ours:
        raise UsageError(f"--out {folder} holds another {foreign[0]}: name a new or empty folder")
    return folder


def name_of(logs: Sequence[Path]) -> str:
    """Name the outputs after the logs: "sample_logs", or "run_1_and_2_more"."""
    path = logs[0].resolve()
    name = (path.name if path.is_dir() else path.stem) or "logs"
    return name if len(logs) == 1 else f"{name}_and_{len(logs) - 1}_more"


def _refuse_folder_of_logs(folder: Path, logs: Sequence[Path]) -> None:
    resolved = folder.resolve()
    beside = {path.resolve() if path.is_dir() else path.resolve().parent for path in logs}
    if resolved in beside or _holds_log(resolved):
        raise UsageError(f"the outputs would lie beside the logs in {folder}: name another folder with --out")
    refuse_inside_a_log(folder)


def refuse_inside_a_log(folder: Path) -> None:
    """Raise ``UsageError`` if a folder is, or lies inside, a rosbag2 folder: nothing is written there."""
    resolved = folder.resolve()
    for parent in (resolved, *resolved.parents):
        if (parent / "metadata.yaml").is_file() and _holds_log(parent):
            raise UsageError(f"{folder} lies inside the log {parent.name}: name another folder with --out")


def _holds_log(folder: Path) -> bool:
    return folder.is_dir() and any(path.suffix in _LOG_SUFFIXES for path in folder.iterdir())
