"""What a command line says about a run; it imports nothing heavy, so that ``--help`` stays quick."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class RunOptions:
    """Options that change what is computed or where it goes; None or empty where nothing was said.

    channels : "auto", or channel maps of which the first that fits is chosen for each run
    out : folder of the outputs, else ``reports/<name of the logs>``
    seed : of what is drawn, such as a split
    against : model file that is compared with what is identified
    model : model file that is used instead of what is identified
    quick : a first look instead of the whole answer
    jobs : processes that work side by side, as many as there are processors where None
    """

    recipe: Path | None = None
    channels: tuple[str, ...] = ()
    vehicle: Path | None = None
    out: Path | None = None
    seed: int | None = None
    against: Path | None = None
    model: Path | None = None
    quick: bool = False
    jobs: int | None = None


def command_line(command: str, logs: Sequence[Path], options: RunOptions) -> str:
    """Give the command that makes the same outputs again, quoted for a POSIX shell."""
    if command == "run" and options.recipe is not None:
        told = replace(options, recipe=None)
        return shlex.join(["ident", "run", str(options.recipe), *map(str, logs), *_arguments(told)])
    return shlex.join(["ident", command, *map(str, logs), *_arguments(options)])


def _arguments(options: RunOptions) -> Iterator[str]:
    if options.recipe is not None:
        yield from ("--recipe", str(options.recipe))
    for channels in options.channels:
        yield from ("--channels", channels)
    if options.vehicle is not None:
        yield from ("--vehicle", str(options.vehicle))
    if options.out is not None:
        yield from ("--out", str(options.out))
    if options.seed is not None:
        yield from ("--seed", str(options.seed))
    if options.against is not None:
        yield from ("--against", str(options.against))
    if options.model is not None:
        yield from ("--model", str(options.model))
    if options.quick:
        yield "--quick"
