"""``ident evaluate``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ident.cli.options import run_options
from ident.cli.stage import run_and_show

if TYPE_CHECKING:
    from ident.cli.options import Show
    from ident.pipeline.options import RunOptions


@click.command()
@run_options
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    metavar="MODEL",
    help="Another model.yaml, compared on the same runs.",
)
def evaluate(logs: tuple[Path, ...], options: RunOptions, show: Show, against: Path | None) -> None:
    """Say which model predicts LOGS well enough, and for what: errors on runs that took no part in the fit.

    Every model that exists, driven by the measured steering and by the request. The tyres, and the steering
    where the logs tell it, are identified first where that is not up to date. Requirements of the recipe that
    are not met end with exit code 5.

    \b
    Example:
      ident evaluate my_logs/
      ident evaluate my_logs/ --recipe my_truck.yaml --against last_year/model.yaml
    """
    run_and_show("evaluate", logs, replace(options, against=against), show)
