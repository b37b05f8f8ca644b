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


def run_and_show(stage: str, logs: Sequence[Path], options: RunOptions, show: Show) -> None:
    """Run a stage and print its summary, or its JSON alone."""
    with progress_shown(show.quiet) as progress:
        from ident.pipeline.run import run_stage

        outcome = run_stage(stage, logs, options, progress)
    if show.json:
        click.echo(outcome.json.read_text(encoding="utf-8"), nl=False)
    elif not show.quiet:
        click.echo(printable(outcome.summary.rstrip("\n")))
        click.echo(f"\nReport: {printable(str(outcome.report))}")
    if show.open and not webbrowser.open(outcome.report.resolve().as_uri()):
        click.echo(f"no browser found: open {printable(str(outcome.report))}", err=True)
