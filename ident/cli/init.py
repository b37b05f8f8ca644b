"""``ident init``."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from ident.cli.options import debug_option, logs_argument, quiet_option
from ident.cli.terminal import printable, progress_shown


@click.command()
@logs_argument
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path(),
    show_default="the current folder",
    help="Folder of the two files.",
)
@quiet_option
@debug_option
def init(logs: tuple[Path, ...], out: Path, quiet: bool) -> None:
    """Write channels.yaml and vehicle.yaml for LOGS: guesses, each with its evidence, for you to check.

    Files that exist are never overwritten.

    \b
    Example:
      ident init my_logs/
      ident init my_logs/ --out my_truck/
    """
    with progress_shown(quiet) as progress:
        from ident.pipeline.init import write_guesses

        written = write_guesses(logs, out, progress)
    if quiet:
        return
    follow_up = ["ident", "info", *logs, "--channels", written.channels, "--vehicle", written.vehicle]
    lines = [
        *(f"left out: {note}" for note in written.notes),
        f"{written.channels}: {len(written.found)} signals guessed: {', '.join(written.found)}",
        f"{written.vehicle}: what the logs tell of the vehicle",
        f"Check both, then: {shlex.join(map(str, follow_up))}",
    ]
    click.echo(printable("\n".join(lines)))
