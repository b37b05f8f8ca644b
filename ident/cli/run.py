"""``ident run``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ident.cli.options import recipe_options
from ident.cli.stage import show_outcome
from ident.cli.terminal import progress_shown

if TYPE_CHECKING:
    from ident.cli.options import Show
    from ident.pipeline.options import RunOptions


@click.command()
@recipe_options
def run(recipe: Path, logs: tuple[Path, ...], options: RunOptions, show: Show) -> None:
    """Run all stages of RECIPE on LOGS, in order, and draw one report.

    What is up to date is skipped: made by the same code from the same logs, settings and results before it.
    An interrupted run goes on where it stopped. A stage that the logs cannot answer stops no other.

    \b
    Example:
      ident run pipelines/truck.yaml sample_logs/
      ident run my_truck.yaml day_1/ day_2/ --out reports/both --open
    """
    with progress_shown(show.quiet) as progress:
        from ident.pipeline.run import run_recipe

        outcome = run_recipe(recipe, logs, options, progress)
    show_outcome(outcome, show)
