"""``ident validate``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ident.cli.options import run_options
from ident.cli.stage import run_and_show

if TYPE_CHECKING:
    from ident.cli.options import Show
    from ident.pipeline.options import RunOptions


@click.command()
@partial(run_options, logs_required=False)
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    metavar="MODEL",
    help="The model.yaml of the truck, instead of what is identified from LOGS.",
)
@click.option("--quick", is_flag=True, help="A first look: one scenario, two starts, no sweeps.")
@click.option("--jobs", type=click.IntRange(min=1), help="Processes side by side.  [default: all processors]")
def validate(
    logs: tuple[Path, ...],
    options: RunOptions,
    show: Show,
    model: Path | None,
    quick: bool,
    jobs: int | None,
) -> None:
    """Say which controller, designed on the identified model, holds, and how far the model may be wrong.

    Every controller drives every scenario on simulated trucks: as identified, drawn from what the error bars
    allow, and further off; then the runs of LOGS that hold a path and a steering request are compared with
    what the model does, level by level, as far as the two agree. Steering and tyres are identified first
    where that is not up to date; with --model nothing is, and LOGS may be left out.

    \b
    Example:
      ident validate my_logs/
      ident validate my_logs/ --quick
      ident validate --model last_year/model.yaml --out reports/last_year_driven
    """
    run_and_show("validate", logs, replace(options, model=model, quick=quick, jobs=jobs), show)
