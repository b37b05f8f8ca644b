"""What every command of a stage does: run it, store it, say where the answer lies."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ident.cli.terminal import printable, progress_shown

if TYPE_CHECKING:
    from ident.cli.options import Show
    from ident.pipeline.options import RunOptions
    from ident.pipeline.run import Outcome


def run_and_show(stage: str, logs: Sequence[Path], options: RunOptions, show: Show) -> None:
    """Run a stage and print its summary, or its JSON alone."""
    with progress_shown(show.quiet) as progress:
        from ident.pipeline.run import run_stage

        outcome = run_stage(stage, logs, options, progress)
    show_outcome(outcome, show)


def show_outcome(outcome: Outcome, show: Show) -> None:
    """Print what was found, then raise what is wrong with it."""
    if show.json:
        click.echo(outcome.json, nl=False)
    elif not show.quiet:
        click.echo(printable(outcome.summary.rstrip("\n")))
        click.echo(f"\nReport: {printable(str(outcome.report))}")
    if show.open and not webbrowser.open(outcome.report.resolve().as_uri()):
        click.echo(f"no browser found: open {printable(str(outcome.report))}", err=True)
    if outcome.error is not None:
        raise outcome.error
