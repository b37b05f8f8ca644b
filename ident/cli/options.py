"""Options that several commands share, declared once."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from ident.cli.boundary import remember_debug
from ident.pipeline.options import RunOptions

Command = TypeVar("Command", bound=Callable[..., Any])

_PATH = click.Path(path_type=Path)
SHOWN = ("json", "quiet", "open")


@dataclass(frozen=True)
class Show:
    """What a command shows: the JSON alone, nothing but errors, the report in a browser."""

    json: bool
    quiet: bool
    open: bool


def logs_argument(command: Command, *, required: bool = True) -> Command:
    """LOGS: files or folders, checked by the reader and not by click, so that every error reads alike."""
    return click.argument("logs", nargs=-1, required=required, type=_PATH)(command)


def debug_option(command: Command) -> Command:
    """``--debug``: the traceback of an error."""
    return click.option(
        "--debug",
        is_flag=True,
        expose_value=False,
        callback=remember_debug,
        help="Show where an error comes from.",
    )(command)


def quiet_option(command: Command) -> Command:
    """``--quiet``: nothing but errors."""
    return click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")(command)


def run_options(command: Callable[..., None], *, logs_required: bool = True) -> Callable[..., None]:
    """Give a command LOGS and the options of every stage, as RunOptions and Show; the rest by their names."""

    @functools.wraps(command)
    def gathered(
        logs: tuple[Path, ...],
        recipe: Path | None,
        channels: tuple[str, ...],
        vehicle: Path | None,
        out: Path | None,
        seed: int | None,
        **rest: Any,
    ) -> None:
        shown = Show(**{name: rest.pop(name) for name in SHOWN})
        command(logs, RunOptions(recipe, channels, vehicle, out, seed), shown, **rest)

    for option in reversed([_RECIPE, *_RUN_OPTIONS]):
        gathered = option(gathered)
    return logs_argument(gathered, required=logs_required)


def recipe_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command RECIPE and LOGS, and the options of every stage but ``--recipe``."""

    @functools.wraps(command)
    def gathered(
        recipe: Path,
        logs: tuple[Path, ...],
        channels: tuple[str, ...],
        vehicle: Path | None,
        out: Path | None,
        seed: int | None,
        **shown: bool,
    ) -> None:
        command(recipe, logs, RunOptions(None, channels, vehicle, out, seed), Show(**shown))

    for option in reversed(_RUN_OPTIONS):
        gathered = option(gathered)
    return click.argument("recipe", type=_PATH)(logs_argument(gathered))


_RECIPE: Callable[[Callable[..., None]], Callable[..., None]] = click.option(
    "--recipe", type=_PATH, help="Settings of the whole pipeline (YAML)."
)
_RUN_OPTIONS: list[Callable[[Callable[..., None]], Callable[..., None]]] = [
    click.option(
        "--channels",
        multiple=True,
        metavar="auto|FILE",
        help="Which topic is which signal; of several, the first that fits is chosen for each run.",
    ),
    click.option("--vehicle", type=_PATH, help="What is known of the vehicle (YAML)."),
    click.option("--out", type=_PATH, help="Folder of the outputs.  [default: reports/<name of the logs>]"),
    click.option("--seed", type=int, help="Of what is drawn, such as a split; over that of the recipe."),
    click.option("--json", is_flag=True, help="Print the JSON and nothing else."),
    quiet_option,
    click.option("--open", is_flag=True, help="Open the report in a browser."),
    debug_option,
]
