"""Write the guesses of ``ident init``: new files only, never in place of one that is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from ident.errors import UsageError
from ident.pipeline.files import atomic
from ident.pipeline.options import Progress, RunOptions, command_line
from ident.pipeline.output_folder import refuse_inside_a_log
from ident.stages.init import init
from ident.stages.output import Context


@dataclass(frozen=True)
class Written:
    """The two files; ``found`` are the signals that the channel map names, ``notes`` what was skipped."""

    channels: Path
    vehicle: Path
    found: list[str]
    notes: list[str]


def write_guesses(logs: Sequence[Path], out: Path, progress: Progress) -> Written:
    """Write ``channels.yaml`` and ``vehicle.yaml`` into a folder.

    Raises
    ------
    UsageError
        If one of them exists, or the folder lies inside a log; this is found before any log is read.
    """
    channels, vehicle = out / "channels.yaml", out / "vehicle.yaml"
    refuse_inside_a_log(out)
    for path in (channels, vehicle):
        if path.exists():
            raise UsageError(f"{path} exists and stays as it is: name another folder with --out")
    command = command_line("init", logs, RunOptions(out=out))
    date = datetime.now(UTC).isoformat(timespec="seconds")
    texts = init(logs, Context(command=command, date=date, progress=progress))
    for path, text in ((channels, texts.channels), (vehicle, texts.vehicle)):
        with atomic(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
    return Written(channels, vehicle, texts.found, texts.notes)
